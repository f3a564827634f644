//! Words of what makes a run: `demo`, `prepare`, `priors`, `check`, `train`.

use super::words::{BackgroundWord, PoserWord, at_least_two, budget, frame_count, seconds};
use clap::Args;
use engine::eval::EvalAppearance;
use engine::options::Purpose;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(crate) struct Demo {
    /// Run folder; an earlier demo in it is replaced
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Training steps (default: about a minute's work on two cores)
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u64>,
    /// Frames of the animation
    #[arg(long, default_value_t = 48, value_name = "N", value_parser = frame_count)]
    pub(crate) frames: usize,
    /// Method
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// Field that the method works on: `ngp` (fast) or `mlp` (networks of NeRF's published size: hours)
    #[arg(long, value_name = "KIND", value_parser = ["ngp", "mlp"])]
    pub(crate) field: Option<String>,
    /// Any setting of the parts that the system has; `config.toml` of a run lists them all. May be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = engine::options::parse_set)]
    pub(crate) set: Vec<(String, toml::Value)>,
}

#[derive(Debug, Args)]
pub(crate) struct Prepare {
    /// A video file, or a folder of photos (JPEG, PNG, WebP, HEIC)
    #[arg(value_name = "VIDEO|FOLDER")]
    pub(crate) input: PathBuf,
    /// Folder of the scene; a second call goes on where an earlier one ended
    #[arg(long, value_name = "SCENE")]
    pub(crate) out: PathBuf,
    /// Frames taken out of a video: it is cut into this many stretches of time, and the sharpest frame of each is taken
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = at_least_two)]
    pub(crate) frames: usize,
    /// Scale pictures down to this longest side
    #[arg(long, default_value_t = 1600, value_name = "PX", value_parser = clap::value_parser!(u32).range(64..))]
    pub(crate) longest_side: u32,
    /// What finds the cameras (default: the first that is there)
    #[arg(long, value_enum, value_name = "WHAT")]
    pub(crate) with: Option<PoserWord>,
}

#[derive(Debug, Args)]
pub(crate) struct Priors {
    /// Dataset folder or file with cameras, or a `synthetic:` scene (see `check`); or a folder of photos without cameras, the frames of
    /// a film in the order of their names, or one that has such a folder in it (`images`, `rgb`, `frames`, or the only one)
    ///
    /// Without cameras, what moves leaves the fundamental matrix of the flow between two photos, or their homography where the camera
    /// only turned or stood still.
    pub(crate) scene: String,
    /// Folder of the files (default: `priors` in the folder of the scene, which is read with it; `check` and `train` read another one with
    /// `--priors DIR`); a second call goes on where an earlier one ended
    ///
    /// `flow/NAME_fwd.flo` and `flow/NAME_bwd.flo` lead from a training photo to the next one in time and to the one before, `1e10` where
    /// that does not show the same; `motion_masks/NAME.png` is 255 where something moves, 0 where nothing does, 127 where nothing is
    /// known.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Only the first N training photos in time
    #[arg(long, value_name = "N", value_parser = at_least_two)]
    pub(crate) frames: Option<usize>,
    /// Write what is exactly known instead of what photos tell, of `synthetic:orbit`, `synthetic:walk` and `synthetic:mouth`; disparities,
    /// too, as `disp/NAME.npy`
    ///
    /// Flow is `1e10` where nothing is seen and where the other photo does not show the same point, disparity is 1 / depth and NaN where
    /// nothing is seen, and masks are 255 wherever a pixel shows anything of a thing that moves at some time.
    #[arg(long)]
    pub(crate) exact: bool,
    #[command(flatten)]
    pub(crate) data: Data,
}

#[derive(Debug, Args)]
pub(crate) struct Check {
    /// Dataset folder or file, or a scene that needs no files: `synthetic:tabletop`, `synthetic:plaza` (photos of many people),
    /// `synthetic:orbit` (moving), `synthetic:orbit-empty` (the same without what moves), `synthetic:walk` (the same in 24 photos
    /// of a camera that walks), `synthetic:mouth` (opening and splitting), `synthetic:tissue` (deforming, with depth)
    ///
    /// `perturbed:c:` before it changes the colours of each training photo, `perturbed:o:` covers a part of it with squares,
    /// `perturbed:co:` does both.
    pub(crate) scene: String,
    /// Read image headers only, without decoding every image
    #[arg(long)]
    pub(crate) quick: bool,
    #[command(flatten)]
    pub(crate) data: Data,
}

#[derive(Debug, Args)]
pub(crate) struct Train {
    /// Dataset folder or file, or a `synthetic:` scene (see `check`); with `--resume` it may be left out
    #[arg(required_unless_present = "resume")]
    pub(crate) scene: Option<String>,
    /// Run folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Method; the default is chosen from the scene, and the first line of the plan says why
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// What it is for, where no system is named: `viewing` (the default: whichever of `ngp` and `splat` will show new views
    /// better) or `geometry` (points, meshes, densities: `ngp`)
    #[arg(id = "for", long = "for", value_name = "WHAT", conflicts_with = "system")]
    pub(crate) purpose: Option<Purpose>,
    /// Field that the method works on: `ngp` (fast) or `mlp` (networks of NeRF's published size: hours)
    #[arg(long, value_name = "KIND", value_parser = ["ngp", "mlp"])]
    pub(crate) field: Option<String>,
    /// Stop after this number of steps, counted from the start of the run; with `--resume` the run's own stop unless given: a
    /// larger one goes on
    #[arg(long, value_name = "N", conflicts_with = "seconds")]
    pub(crate) steps: Option<u64>,
    /// Stop after this training time, evaluation not counted (default: 300); with `--resume` as `--steps`
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) seconds: Option<f64>,
    /// Measure the held-out views at these training seconds, as `60,300`
    #[arg(long, value_name = "S,S,…", value_delimiter = ',', value_parser = seconds)]
    pub(crate) eval_at: Vec<f64>,
    /// Measure the held-out views every N steps
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) eval_every: Option<u64>,
    /// Minutes between checkpoints (default: 5)
    #[arg(long, value_name = "MIN", value_parser = seconds)]
    pub(crate) checkpoint_minutes: Option<f64>,
    /// How long to try again to write the last checkpoint and the results where the disk is full or gone, seconds (default: 60)
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) disk_wait: Option<f64>,
    /// Appearance that held-out views are rendered in: `fit` (fitted on their left halves; right halves are scored; the default where
    /// photos have codes), `mean`, `nearest` (that of the training photo of the same `appearance_id`, else nearest in time),
    /// `image:NAME` (that of a training photo), `encode:left`, `encode:whole` (what the system's encoder makes of the left half or the
    /// whole; right halves are scored)
    #[arg(long, value_name = "APPEARANCE")]
    pub(crate) eval_appearance: Option<EvalAppearance>,
    /// What is behind the scene
    #[arg(long, value_enum, value_name = "COLOUR")]
    pub(crate) background: Option<BackgroundWord>,
    /// Seed of all randomness; the result depends on it, and not on the number of threads
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Error that a pixel may have from skipped work, in units of colour; 0 skips nothing
    #[arg(long, value_name = "X", value_parser = budget)]
    pub(crate) error_budget: Option<f32>,
    /// Train on the images and N - 1 halvings of them, pixels weighted with their area; `eval --scales N` measures them one by one
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=12))]
    pub(crate) scales: Option<u32>,
    /// Gaussians at most, from the first step on (`--system splat`)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_splats: Option<u32>,
    /// Any setting of the parts that the system has; `config.toml` of a run lists them all. May be given several times
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = engine::options::parse_set)]
    pub(crate) set: Vec<(String, toml::Value)>,
    /// Continue the run in `--out` at its newest checkpoint, with the run's own configuration, to its own stop
    ///
    /// It ends with the same bits as a run that was never interrupted. A word that contradicts the run's configuration is an error
    /// that names both values.
    #[arg(long)]
    pub(crate) resume: bool,
    #[command(flatten)]
    pub(crate) data: Data,
}

/// How the dataset is read.
#[derive(Debug, Args)]
pub(crate) struct Data {
    /// Scale images down to this longest side while reading
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) longest_side: Option<u32>,
    /// Frames held out to be measured: `every:8`, `every:8+4`, `names:FILE` or `none` (default: the dataset's own, else by its
    /// format, of most one frame in eight); the names are saved in `heldout.txt`
    ///
    /// `every:8+4` is every eighth frame, the first of them the one at 4, counted from 0.
    #[arg(long, value_name = "WHICH")]
    pub(crate) holdout: Option<String>,
    /// Training frames held out besides, to choose settings by: `every:8`, `every:8+4`, `names:FILE`, `dataset` (the dataset's own
    /// validation split) or `none`. They are measured in the place of the test frames, which are neither trained on nor used
    ///
    /// The names are saved in `validation.txt`.
    #[arg(long, value_name = "WHICH")]
    pub(crate) validation: Option<String>,
    /// Photos trained on where a dataset holds cluttered and clean ones: `clutter` (the default) or `clean`
    #[arg(long, value_name = "WHICH", value_parser = ["clutter", "clean"])]
    pub(crate) train_split: Option<String>,
    /// Format of the dataset, where the folder holds several
    #[arg(long, value_name = "NAME")]
    pub(crate) format: Option<String>,
    /// Folder of the images, where it is not beside the cameras
    #[arg(long, value_name = "DIR")]
    pub(crate) images: Option<PathBuf>,
    /// Folder of masks, which take pixels out of the loss (people, the sky), or `off`
    #[arg(long, value_name = "DIR|off")]
    pub(crate) masks: Option<String>,
    /// What white means in the masks: `used` (black is left out of everything), `ignored`, or `object` (the mask cuts out an object
    /// with nothing around it: it becomes the photo's alpha)
    ///
    /// The default is `used`, but for masks that all show one thing at one place: those are taken for `object`, with a warning.
    #[arg(long, value_name = "MEANING", value_parser = ["used", "ignored", "object"])]
    pub(crate) mask_white: Option<String>,
    /// Folder of optical flow, disparities and motion masks, as `priors --out` fills one (default: those beside the photos)
    #[arg(long, value_name = "DIR")]
    pub(crate) priors: Option<PathBuf>,
    /// Images that are listed and missing: `refuse` or `skip`
    #[arg(long, value_name = "WHAT", value_parser = ["refuse", "skip"])]
    pub(crate) missing_images: Option<String>,
    /// Memory for decoded images (default: 2048)
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) image_memory: Option<u64>,
}

//! The command line: words others script against. The same words mean the same in every app; see [`crate::app`] for what
//! differs.

mod families;
mod words;

pub(crate) use words::{BackgroundWord, EmptyWord, Layer, MeshMethod, PoserWord, ProgressKind, VideoWord};

use crate::app::App;
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use engine::appearance::AppearancePath;
use engine::camera_path::PathKind;
use engine::eval::EvalAppearance;
use engine::options::Purpose;
use engine::run::DefaultSystem;
use engine::time_path::TimePath;
use std::ffi::OsString;
use std::path::PathBuf;
use words::{at_least_two, budget, frame_count, moment, seconds, triangle_count};

#[derive(Debug, Parser)]
#[command(version, propagate_version = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,

    /// Threads to use (default: all cores). The result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,

    /// Memory that the program may hold at most. What does not fit is planned smaller (tables, batches, Gaussians, photos held at a
    /// time) or refused (default: what the machine has)
    #[arg(long, global = true, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..=1 << 30))]
    pub(crate) memory: Option<u64>,

    /// How progress is shown
    #[arg(long, global = true, value_enum, default_value_t = ProgressKind::Auto, value_name = "HOW")]
    pub(crate) progress: ProgressKind,

    /// Weights of the LPIPS metric, a safetensors file (or variable WILDFIELD_LPIPS); without, LPIPS is n/a
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The whole job on an embedded synthetic scene: train, evaluate, render, report
    Demo(Demo),
    /// Photos or a video to a scene with cameras, which `train` reads
    Prepare(Prepare),
    /// Read a dataset; list frames, cameras, splits, priors, problems. Exit code not 0 if it cannot be trained
    Check(Check),
    /// Reconstruct a scene into a run folder
    Train(Box<Train>),
    /// Measure the held-out views of the newest checkpoint
    Eval(Eval),
    /// Render pictures along a camera path
    Render(Render),
    /// Look around in a run or a file of Gaussians on a web page; a run also while it trains
    View(View),
    /// Write points, a mesh, Gaussians or cameras, in the input's frame and scale
    Export(Export),
    /// Write which pixels of the training photos show the place itself, and score that where the truth is known
    Masks(Masks),
}

impl Cli {
    /// The command line of an app. Words that it has not are not shown, and refused by [`Cli::read`].
    pub(crate) fn of(app: &App) -> clap::Command {
        let mut command = Self::command().name(app.name).about(app.about).mut_subcommand("demo", |demo| {
            demo.mut_arg("out", |out| out.required(false).default_value(app.demo_folder))
        });
        for word in ["demo", "train"] {
            command = command.mut_subcommand(word, |sub| sub.mut_arg("system", |arg| arg.long_help(systems_of(app))));
        }
        for (word, argument) in families::words_of_others(app.family) {
            command = command.mut_subcommand(word, |sub| match argument {
                Some(argument) => sub.mut_arg(argument, |a| a.hide(true)),
                None => sub.hide(true),
            });
        }
        command
    }

    /// Read the words of a command line, the program's name first.
    ///
    /// # Errors
    /// What is wrong with them, for the person; `--help` and `--version` come this way, too.
    pub(crate) fn read(app: &App, words: impl IntoIterator<Item = OsString>) -> Result<Self, clap::Error> {
        let mut command = Self::of(app);
        let matches = command.try_get_matches_from_mut(words)?;
        if let Some(problem) = families::foreign_word(app, &matches) {
            return Err(command.error(ErrorKind::UnknownArgument, problem));
        }
        Self::from_arg_matches(&matches).map_err(|e| e.format(&mut command))
    }
}

/// The systems of an app, for `--help`: no name of a paper without what is done otherwise here.
fn systems_of(app: &App) -> String {
    let default = match app.default_system {
        DefaultSystem::Chosen(_) => "without it `ngp` or `splat`, whichever suits the scene".into(),
        DefaultSystem::Named(name) => format!("without it `{name}`"),
    };
    let own = systems::registry::family(app.family).map(|entry| entry.claim);
    let others = systems::registry::entries().iter().filter(|entry| !entry.families.contains(&app.family));
    let others: Vec<&str> = others.map(|entry| entry.claim.name).collect();
    format!(
        "Method ({default}). What each does otherwise than the paper it is named after:\n\n{}\n\nThe systems of the other apps, \
         where they fit the scene: {}",
        systems::claims::listing(own),
        others.join(", ")
    )
}

#[derive(Debug, Args)]
pub(crate) struct Demo {
    /// Run folder; an earlier demo in it is replaced
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Training steps
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u64>,
    /// Frames of the animation
    #[arg(long, default_value_t = 48, value_name = "N", value_parser = frame_count)]
    pub(crate) frames: usize,
    /// Method
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// Field that the method works on: `ngp`, fast, or `mlp`, networks of NeRF's published size
    #[arg(long, value_name = "KIND", value_parser = ["ngp", "mlp"])]
    pub(crate) field: Option<String>,
    /// Any setting of the system
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
    /// Frames taken out of a video, the sharpest of as many stretches of time
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
pub(crate) struct Check {
    /// Dataset folder or file, `synthetic:tabletop` or `synthetic:plaza`; `perturbed:co:` before it disturbs colours and
    /// view
    pub(crate) scene: String,
    /// Look at image headers only, without decoding every image
    #[arg(long)]
    pub(crate) quick: bool,
    #[command(flatten)]
    pub(crate) data: Data,
}

#[derive(Debug, Args)]
pub(crate) struct Train {
    /// Dataset folder or file, `synthetic:tabletop` or `synthetic:plaza`; with `--resume` it may be left out
    #[arg(required_unless_present = "resume")]
    pub(crate) scene: Option<String>,
    /// Run folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Method; the default is chosen from the scene
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// What it is for, where no system is named: `viewing` (the default: whichever of `ngp` and `splat` will show new views
    /// better) or `geometry` (points, meshes, densities: `ngp`)
    #[arg(id = "for", long = "for", value_name = "WHAT", conflicts_with = "system")]
    pub(crate) purpose: Option<Purpose>,
    /// Field that the method works on: `ngp`, fast, or `mlp`, networks of NeRF's published size
    #[arg(long, value_name = "KIND", value_parser = ["ngp", "mlp"])]
    pub(crate) field: Option<String>,
    /// Stop after so many steps, counted from the start of the run; with `--resume` the run's own stop unless said
    #[arg(long, value_name = "N", conflicts_with = "seconds")]
    pub(crate) steps: Option<u64>,
    /// Stop after so much training time, evaluation not counted (default: 300)
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) seconds: Option<f64>,
    /// Measure the held-out views at these training seconds
    #[arg(long, value_name = "S,S,…", value_delimiter = ',', value_parser = seconds)]
    pub(crate) eval_at: Vec<f64>,
    /// Measure the held-out views every so many steps
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) eval_every: Option<u64>,
    /// Minutes between checkpoints (default: 5)
    #[arg(long, value_name = "MIN", value_parser = seconds)]
    pub(crate) checkpoint_minutes: Option<f64>,
    /// How long the last checkpoint and the results are tried to be written where the disk is full or gone, seconds (default: 60)
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) disk_wait: Option<f64>,
    /// Appearance of the held-out views: `fit` on their left halves (right halves are scored), `mean`, `image:NAME` (a training
    /// photo), `encode:left`, `encode:whole` (the system's encoder; right halves are scored)
    #[arg(long, value_name = "LIGHT")]
    pub(crate) eval_appearance: Option<EvalAppearance>,
    /// What is behind the scene
    #[arg(long, value_enum, value_name = "COLOUR")]
    pub(crate) background: Option<BackgroundWord>,
    /// Seed of all randomness
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Error a pixel may have from skipped work, in colour units; 0 skips nothing
    #[arg(long, value_name = "X", value_parser = budget)]
    pub(crate) error_budget: Option<f32>,
    /// Train on images at full, half, quarter … size: so many scales, pixels weighted with their area
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=12))]
    pub(crate) scales: Option<u32>,
    /// Gaussians at most, from the first step on (`--system splat`)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) max_splats: Option<u32>,
    /// Any setting of the system
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = engine::options::parse_set)]
    pub(crate) set: Vec<(String, toml::Value)>,
    /// Continue the run in `--out` at its newest checkpoint, with the run's own configuration, to its own stop
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
    /// Frames held out: `every:8`, `names:FILE` or `none`
    #[arg(long, value_name = "WHICH")]
    pub(crate) holdout: Option<String>,
    /// Training frames held out besides, to choose settings by: `every:8`, `names:FILE`, `dataset` (the dataset's own validation
    /// split) or `none`. They are measured in the place of the test frames, which are neither trained on nor looked at
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
    /// Folder of masks, or `off`
    #[arg(long, value_name = "DIR|off")]
    pub(crate) masks: Option<String>,
    /// What white means in the masks: `used` (black is left out of everything), `ignored`, or `object` (there is nothing around
    /// it: the mask becomes the photo's alpha). Where nothing is said it is `used`, but for masks that all show one thing at one
    /// place: those are taken for `object`, with a warning
    #[arg(long, value_name = "MEANING", value_parser = ["used", "ignored", "object"])]
    pub(crate) mask_white: Option<String>,
    /// Images that are listed and missing: `refuse` or `skip`
    #[arg(long, value_name = "WHAT", value_parser = ["refuse", "skip"])]
    pub(crate) missing_images: Option<String>,
    /// Memory for decoded images
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) image_memory: Option<u64>,
}

#[derive(Debug, Args)]
pub(crate) struct Eval {
    /// Run folder
    pub(crate) run: PathBuf,
    /// Measure at full, half, quarter … size instead: so many scales, against the means of the held-out pixels
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=12))]
    pub(crate) scales: Option<u32>,
    /// Appearance of the held-out views (default: the run's): `fit` on their left halves (right halves are scored), `mean`, `image:NAME` (a training
    /// photo), `encode:left`, `encode:whole` (the system's encoder; right halves are scored)
    #[arg(long, value_name = "LIGHT")]
    pub(crate) eval_appearance: Option<EvalAppearance>,
    /// Error a pixel may have from skipped work, in colour units (default: the run's); 0 skips nothing
    #[arg(long, value_name = "X", value_parser = budget)]
    pub(crate) error_budget: Option<f32>,
}

#[derive(Debug, Args)]
pub(crate) struct Render {
    /// Run folder, or a file of Gaussians (.ply, .splat, .spz)
    pub(crate) run: PathBuf,
    /// `photos` (through the training cameras), `orbit` (the arc that they cover), `spiral` (for cameras that face one way),
    /// `hold:NAME` (the camera of that frame; part of its name is enough) or a JSON file of cameras (default: `photos`; `orbit`
    /// where photos stand all round an object, and for a file of Gaussians)
    #[arg(long, value_name = "PATH")]
    pub(crate) path: Option<PathKind>,
    /// Appearance: `mean`, `image:NAME` (a training photo), `fit:FILE` (another photo, or a frame's name), or `A..B` to go from
    /// one to another over the frames
    #[arg(long, value_name = "LIGHT")]
    pub(crate) appearance: Option<AppearancePath>,
    /// Frame whose camera took the photo of `fit:FILE`; without, the frame FILE is, or the camera in `FILE`.json beside it
    #[arg(long, value_name = "NAME", requires = "appearance")]
    pub(crate) fit_camera: Option<String>,
    /// Time of a scene that moves: `T`, or `A..B` to go from one to the other over the frames, 0 the first moment and 1 the
    /// last (default: 0..1)
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub(crate) time: Option<TimePath>,
    /// Frames (default: 60, or as many as the file holds; 1 for `hold:` in one light at one time)
    #[arg(long, value_name = "N", value_parser = frame_count)]
    pub(crate) frames: Option<usize>,
    /// Folder of the pictures
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Layers written
    #[arg(long, value_enum, value_delimiter = ',', default_value = "colour", value_name = "LAYER,…")]
    pub(crate) layers: Vec<Layer>,
    /// Scale pictures down to this longest side
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) longest_side: Option<u32>,
    /// Frames per second of the animated preview
    #[arg(long, default_value_t = 15.0, value_name = "X", value_parser = seconds)]
    pub(crate) fps: f64,
    /// Error a pixel may have from skipped work, in colour units (default: 1/255); 0 skips nothing
    #[arg(long, value_name = "X", value_parser = budget)]
    pub(crate) error_budget: Option<f32>,
    /// Video of the first layer at full size, by `ffmpeg` (default: mp4, or webm, where `ffmpeg` is installed)
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub(crate) video: Option<VideoWord>,
}

#[derive(Debug, Args)]
pub(crate) struct View {
    /// Run folder, also of a training that still goes on, or a file of Gaussians (.ply, .splat, .spz)
    #[arg(value_name = "RUN|FILE")]
    pub(crate) what: PathBuf,
    /// Name or number of the network interface that the page is served at; `0.0.0.0` is all of them, for everybody
    #[arg(long, default_value = "127.0.0.1", value_name = "HOST")]
    pub(crate) host: String,
    /// Port; 0 is any that is free
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) port: u16,
    /// Seconds until a page that gives no sign of life loses its place; for tests
    #[arg(long, hide = true, default_value_t = 60, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=3600))]
    pub(crate) patience: u64,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("what").required(true).multiple(true))]
pub(crate) struct Export {
    /// Run folder, or a file of Gaussians (.ply, .splat, .spz)
    pub(crate) run: PathBuf,
    /// Coloured points with normals and opacity, PLY
    #[arg(long, value_name = "FILE.ply", group = "what")]
    pub(crate) points: Option<PathBuf>,
    /// Coloured mesh of what the photos' cameras see: `.ply`, `.obj` or `.glb`
    #[arg(long, value_name = "FILE", group = "what")]
    pub(crate) mesh: Option<PathBuf>,
    /// Gaussians: `.ply` (the layout of 3DGS), `.splat` or `.spz`; those of a `splat` run, or any field baked into some
    #[arg(long, value_name = "FILE", group = "what")]
    pub(crate) splats: Option<PathBuf>,
    /// Cameras: a `.json` file (transforms.json), or a folder (COLMAP text)
    #[arg(long, value_name = "FILE|DIR", group = "what")]
    pub(crate) cameras: Option<PathBuf>,
    /// Folder of one PLY for each photo, in the order of time: the surface its camera sees at its moment, depth smoothed
    /// without its edges
    #[arg(long, value_name = "DIR", group = "what")]
    pub(crate) frames: Option<PathBuf>,
    /// Leave the depth of `--frames` as it was rendered
    #[arg(long, requires = "frames")]
    pub(crate) rough: bool,
    /// Time of a scene that moves, 0 the first moment and 1 the last
    #[arg(long, default_value_t = 0.0, value_name = "T", value_parser = moment, allow_hyphen_values = true)]
    pub(crate) time: f64,
    /// Points wanted, about
    #[arg(long, default_value_t = 200_000, value_name = "N")]
    pub(crate) count: usize,
    /// How a mesh is made: `tsdf` (the default), from depth rendered at the photos' cameras, or `density`, where the density of
    /// a field crosses `--level`
    #[arg(long, value_enum, value_name = "HOW", requires = "mesh")]
    pub(crate) method: Option<MeshMethod>,
    /// Triangles of the mesh at most (default: 200000; of `--method density` all)
    #[arg(long, value_name = "N", value_parser = triangle_count)]
    pub(crate) triangles: Option<usize>,
    /// Cells of the mesh along the longest side of the box (default: as fine as the photos' pixels are there; of `--method
    /// density` 256)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=2048))]
    pub(crate) resolution: Option<u16>,
    /// Density the mesh is cut at, 1 / world unit (default: opaque within 2 % of the longest side); means `--method density`
    #[arg(long, value_name = "X", value_parser = seconds)]
    pub(crate) level: Option<f64>,
    /// JSON file of cameras to look from, instead of the photos' (of a file of Gaussians: instead of some all around it)
    #[arg(long, value_name = "FILE.json")]
    pub(crate) look_from: Option<PathBuf>,
    /// Box that is exported: x0,y0,z0,x1,y1,z1 in world units (default: of a mesh what several photos show, else
    /// the scene's)
    #[arg(long = "box", value_name = "NUMBERS", value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    pub(crate) crop: Vec<f64>,
    /// Export everything, also where the viewer wrote a `crop.json`
    #[arg(long, conflicts_with = "crop")]
    pub(crate) no_crop: bool,
}

#[derive(Debug, Args)]
pub(crate) struct Masks {
    /// Run folder
    pub(crate) run: PathBuf,
    /// Folder of the masks, white = the place itself (default: `masks` in the run, which the report shows)
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Every so many training photos only
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = frame_count)]
    pub(crate) every: usize,
    /// What a class scores in a photo where neither mask nor truth has a pixel of it
    #[arg(long, value_enum, default_value_t = EmptyWord::One, value_name = "SCORE")]
    pub(crate) empty_class: EmptyWord,
}

#[cfg(test)]
mod tests;

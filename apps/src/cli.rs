//! The command line: words others script against.

use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use systems::camera_path::PathKind;
use systems::options::Background;

/// Radiance fields of static scenes, reconstructed on the CPU.
#[derive(Debug, Parser)]
#[command(name = "nerf-static", version, about, propagate_version = true)]
pub(crate) struct Cli {
    #[command(subcommand)]
    pub(crate) command: Command,

    /// Threads to use (default: all cores). The result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub(crate) threads: Option<u16>,

    /// How progress is shown
    #[arg(long, global = true, value_enum, default_value_t = ProgressKind::Auto, value_name = "HOW")]
    pub(crate) progress: ProgressKind,

    /// Weights of the LPIPS metric, a safetensors file (or variable WILDFIELD_LPIPS); without, LPIPS is n/a
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) lpips_weights: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressKind {
    /// A redrawn line on a terminal, a line per interval otherwise
    Auto,
    /// A line per interval
    Lines,
    /// A JSON object a line, on standard error
    Json,
    /// None
    Off,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The whole job on an embedded synthetic scene: train, evaluate, render, report
    Demo(Demo),
    /// Read a dataset; list frames, cameras, splits, priors, problems. Exit code not 0 if it cannot be trained
    Check(Check),
    /// Reconstruct a scene into a run folder
    Train(Train),
    /// Measure the held-out views of the newest checkpoint
    Eval(Eval),
    /// Render pictures along a camera path
    Render(Render),
    /// Write points, a mesh or cameras, in the input's frame and scale
    Export(Export),
}

#[derive(Debug, Args)]
pub(crate) struct Demo {
    /// Run folder; an earlier demo in it is replaced
    #[arg(long, default_value = "runs/demo", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Training steps
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u64>,
    /// Frames of the rendered orbit
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub(crate) frames: usize,
    /// Method
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// Any setting of the system
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = systems::options::parse_set)]
    pub(crate) set: Vec<(String, toml::Value)>,
}

#[derive(Debug, Args)]
pub(crate) struct Check {
    /// Dataset folder or file, or `synthetic:tabletop`; `perturbed:co:` before it disturbs colours and view
    pub(crate) scene: String,
    /// Look at image headers only, without decoding every image
    #[arg(long)]
    pub(crate) quick: bool,
    #[command(flatten)]
    pub(crate) data: Data,
}

#[derive(Debug, Args)]
pub(crate) struct Train {
    /// Dataset folder or file, or `synthetic:tabletop`; with `--resume` it may be left out
    #[arg(required_unless_present = "resume")]
    pub(crate) scene: Option<String>,
    /// Run folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Method; the default is chosen from the scene
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// Stop after so many steps, counted from the start of the run
    #[arg(long, value_name = "N", conflicts_with = "seconds")]
    pub(crate) steps: Option<u64>,
    /// Stop after so much training time, evaluation not counted
    #[arg(long, value_name = "S", value_parser = seconds)]
    pub(crate) seconds: Option<f64>,
    /// Measure the held-out views at these training seconds
    #[arg(long, value_name = "S,S,…", value_delimiter = ',', value_parser = seconds)]
    pub(crate) eval_at: Vec<f64>,
    /// Measure the held-out views every so many steps
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) eval_every: Option<u64>,
    /// Minutes between checkpoints
    #[arg(long, default_value_t = 5.0, value_name = "MIN", value_parser = seconds)]
    pub(crate) checkpoint_minutes: f64,
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
    /// Any setting of the system
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = systems::options::parse_set)]
    pub(crate) set: Vec<(String, toml::Value)>,
    /// Continue the run in `--out` at its newest checkpoint, with the run's own configuration
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
    /// Format of the dataset, where the folder holds several
    #[arg(long, value_name = "NAME")]
    pub(crate) format: Option<String>,
    /// Folder of the images, where it is not beside the cameras
    #[arg(long, value_name = "DIR")]
    pub(crate) images: Option<PathBuf>,
    /// Folder of ignore masks, or `off`
    #[arg(long, value_name = "DIR|off")]
    pub(crate) masks: Option<String>,
    /// What white means in the masks: `used` (the default) or `ignored`
    #[arg(long, value_name = "MEANING", value_parser = ["used", "ignored"])]
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
    /// Error a pixel may have from skipped work, in colour units (default: the run's); 0 skips nothing
    #[arg(long, value_name = "X", value_parser = budget)]
    pub(crate) error_budget: Option<f32>,
}

#[derive(Debug, Args)]
pub(crate) struct Render {
    /// Run folder
    pub(crate) run: PathBuf,
    /// `orbit`, `spiral` or a JSON file of cameras
    #[arg(long, value_name = "PATH")]
    pub(crate) path: PathKind,
    /// Frames (default: 60, or as many as the file holds)
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
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Layer {
    /// Colour
    #[value(alias = "color")]
    Colour,
    /// Distance along the ray, near bright
    Depth,
    /// Opacity
    Opacity,
    /// Normals of the world's frame
    Normals,
}

#[derive(Debug, Args)]
#[command(group = clap::ArgGroup::new("what").required(true).multiple(true))]
pub(crate) struct Export {
    /// Run folder
    pub(crate) run: PathBuf,
    /// Coloured points with normals and opacity, PLY
    #[arg(long, value_name = "FILE.ply", group = "what")]
    pub(crate) points: Option<PathBuf>,
    /// Marching-cubes mesh, PLY
    #[arg(long, value_name = "FILE.ply", group = "what")]
    pub(crate) mesh: Option<PathBuf>,
    /// Cameras: a `.json` file (transforms.json), or a folder (COLMAP text)
    #[arg(long, value_name = "FILE|DIR", group = "what")]
    pub(crate) cameras: Option<PathBuf>,
    /// Points wanted, about
    #[arg(long, default_value_t = 200_000, value_name = "N")]
    pub(crate) count: usize,
    /// Cells of the mesh along its longest side
    #[arg(long, default_value_t = 256, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=2048))]
    pub(crate) resolution: u16,
    /// Density the mesh is cut at, 1 / world unit (default: opaque within 2 % of the longest side)
    #[arg(long, value_name = "X", value_parser = seconds)]
    pub(crate) level: Option<f64>,
    /// Box that is exported: x0,y0,z0,x1,y1,z1 in world units (default: the scene's)
    #[arg(long = "box", value_name = "NUMBERS", value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    pub(crate) crop: Vec<f64>,
}

/// `white | black | random`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackgroundWord {
    White,
    Black,
    /// Another colour for each training ray; evaluated on white
    Random,
}

impl From<BackgroundWord> for Background {
    fn from(word: BackgroundWord) -> Self {
        match word {
            BackgroundWord::White => Self::White,
            BackgroundWord::Black => Self::Black,
            BackgroundWord::Random => Self::Random,
        }
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("write a number above 0".into()),
    }
}

fn budget(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if (0.0..=1.0).contains(&x) => Ok(x),
        _ => Err("write a number from 0 to 1".into()),
    }
}

fn frame_count(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n @ 1..=100_000) => Ok(n),
        _ => Err("write a whole number from 1 to 100000".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn agreed_words_are_understood() {
        for line in [
            "demo --out d",
            "check s --holdout every:8",
            "train s --out d --system ngp --steps 10 --eval-every 5 --longest-side 100 --holdout none --background black \
             --seed 3 --threads 2 --error-budget 0.001 --set lr=0.1 --set space=ndc --image-memory 100",
            "train s --out d --seconds 60 --eval-at 10,30.5 --progress json",
            "train --resume --out d",
            "eval d --lpips-weights w",
            "train s --out d --system mip-nerf --scales 4 --set width=64",
            "eval d --scales 4",
            "render d --path orbit --frames 10 --out e --layers colour,depth,opacity,normals --longest-side 50",
            "render d --path cameras.json --out e",
            "export d --points p.ply --mesh m.ply --cameras c.json --box -1,-1,-1,1,1,1",
        ] {
            let words = std::iter::once("nerf-static").chain(line.split_whitespace());
            Cli::try_parse_from(words).unwrap_or_else(|e| panic!("{line}: {e}"));
        }
        for line in
            ["train s", "train --out d", "train s --out d --steps 1 --seconds 1", "export d", "render d --out e"]
        {
            let words = std::iter::once("nerf-static").chain(line.split_whitespace());
            assert!(Cli::try_parse_from(words).is_err(), "{line}");
        }
    }
}

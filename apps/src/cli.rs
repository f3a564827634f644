//! The command line: words others script against. The same words mean the same in every app; see [`crate::app`] for what
//! differs.

use crate::app::App;
use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};
use losses::metrics::EmptyClass;
use std::ffi::OsString;
use std::path::PathBuf;
use systems::appearance::LightPath;
use systems::camera_path::PathKind;
use systems::eval::EvalAppearance;
use systems::options::Background;
use systems::plan::Purpose;
use systems::time_path::TimePath;

#[derive(Debug, Parser)]
#[command(version, propagate_version = true)]
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

/// Words of apps for photos from the wild: subcommand and argument, or a subcommand alone.
const WILD: &[(&str, Option<&str>)] = &[
    ("demo", Some("field")),
    ("train", Some("field")),
    ("train", Some("eval_appearance")),
    ("eval", Some("eval_appearance")),
    ("render", Some("appearance")),
    ("render", Some("fit_camera")),
    ("masks", None),
];

/// Words of `nerf-dynamic` alone.
const DYNAMIC: &[(&str, Option<&str>)] = &[("render", Some("time")), ("export", Some("time"))];

/// Words of `nerf-static` alone.
const STATIC: &[(&str, Option<&str>)] = &[("train", Some("for"))];

impl Cli {
    /// The command line of an app. Words that it has not are not shown, and refused by [`Cli::read`].
    pub(crate) fn of(app: &App) -> clap::Command {
        let mut command = Self::command().name(app.name).about(app.about).mut_subcommand("demo", |demo| {
            demo.mut_arg("out", |out| out.required(false).default_value(app.demo_folder))
        });
        for (words, has) in [(WILD, app.is_wild), (DYNAMIC, app.is_dynamic), (STATIC, app.is_static())] {
            for (word, argument) in words.iter().filter(|_| !has) {
                command = command.mut_subcommand(word, |sub| match argument {
                    Some(argument) => sub.mut_arg(argument, |a| a.hide(true)),
                    None => sub.hide(true),
                });
            }
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
        if let Some(problem) = foreign(app, &matches) {
            return Err(command.error(ErrorKind::UnknownArgument, problem));
        }
        Self::from_arg_matches(&matches).map_err(|e| e.format(&mut command))
    }
}

/// What is wrong with a word given that the app has not.
fn foreign(app: &App, matches: &ArgMatches) -> Option<String> {
    let (word, given) = matches.subcommand()?;
    let found = |words: &[(&str, Option<&str>)]| {
        words.iter().filter(|(sub, _)| *sub == word).find_map(|(_, argument)| match argument {
            None => Some(word.to_string()),
            Some(argument) => (given.value_source(argument) == Some(ValueSource::CommandLine))
                .then(|| format!("--{}", argument.replace('_', "-"))),
        })
    };
    let wild = || found(WILD).map(|word| (word, "nerf-wild", "knows one light and no passers-by"));
    let dynamic = || found(DYNAMIC).map(|word| (word, "nerf-dynamic", "knows one moment only"));
    let fixed = || found(STATIC).map(|word| (word, "nerf-static", "takes the system that is named, or its own"));
    let given = (!app.is_wild).then(wild).flatten().or_else(|| (!app.is_dynamic).then(dynamic).flatten());
    let given = given.or_else(|| (!app.is_static()).then(fixed).flatten());
    given.map(|(word, other, why)| format!("`{word}` is a word of {other}: {} {why}", app.name))
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
    #[arg(long, default_value_t = 48, value_name = "N")]
    pub(crate) frames: usize,
    /// Method
    #[arg(long, value_name = "NAME")]
    pub(crate) system: Option<String>,
    /// Field that the method works on: `ngp`, fast, or `mlp`, the networks of the papers
    #[arg(long, value_name = "KIND", value_parser = ["ngp", "mlp"])]
    pub(crate) field: Option<String>,
    /// Any setting of the system
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = systems::options::parse_set)]
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

/// `sfm | colmap | glomap`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PoserWord {
    /// The crate openmvg-sfm, in programs built with the feature `sfm`
    Sfm,
    /// The program colmap, 3.8 or newer
    Colmap,
    /// The program glomap, after colmap's features and matches
    Glomap,
}

impl From<PoserWord> for prepare::Poser {
    fn from(word: PoserWord) -> Self {
        match word {
            PoserWord::Sfm => Self::Sfm,
            PoserWord::Colmap => Self::Colmap,
            PoserWord::Glomap => Self::Glomap,
        }
    }
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
    /// Field that the method works on: `ngp`, fast, or `mlp`, the networks of the papers
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
    /// Light of the held-out views: `fit` on their left halves (right halves are scored), `mean`, `image:NAME` (a training
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
    #[arg(long = "set", value_name = "KEY=VALUE", value_parser = systems::options::parse_set)]
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
    /// Light of the held-out views (default: the run's): `fit` on their left halves (right halves are scored), `mean`, `image:NAME` (a training
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
    /// Light: `mean`, `image:NAME` (a training photo), `fit:FILE` (another photo, or a frame's name), or `A..B` to go from
    /// one to another over the frames
    #[arg(long, value_name = "LIGHT")]
    pub(crate) appearance: Option<LightPath>,
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum VideoWord {
    /// H.264 in preview.mp4
    Mp4,
    /// VP9 in preview.webm
    Webm,
    /// None
    Off,
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
    /// Which point of the scene at rest is seen, as colour: x, y, z within the scene's box
    Canonical,
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

/// `tsdf | density`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum MeshMethod {
    /// Depth rendered at the photos' cameras, fused: fields and Gaussians
    Tsdf,
    /// Where the density of a field crosses a level, in the whole box
    Density,
}

/// `one | zero | left-out`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum EmptyWord {
    /// 1: both say that there is nothing
    One,
    /// 0
    Zero,
    /// Nothing: it stays out of the means
    LeftOut,
}

impl From<EmptyWord> for EmptyClass {
    fn from(word: EmptyWord) -> Self {
        match word {
            EmptyWord::One => Self::One,
            EmptyWord::Zero => Self::Zero,
            EmptyWord::LeftOut => Self::LeftOut,
        }
    }
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

/// A time of a scene that moves.
fn moment(text: &str) -> Result<f64, String> {
    let path: TimePath = text.parse()?;
    if path.is_still() {
        Ok(path.at(0, 1))
    } else {
        Err(format!("`{text}` is a way from one time to another: give one time"))
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

/// Cameras need two pictures.
fn at_least_two(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n @ 2..=100_000) => Ok(n),
        _ => Err("write a whole number from 2 to 100000".into()),
    }
}

fn triangle_count(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n @ 4..=100_000_000) => Ok(n),
        _ => Err("write a whole number from 4 to 100000000".into()),
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
    use crate::app::{STATIC, WILD as WILD_APP};

    fn read(app: &App, line: &str) -> Result<Cli, clap::Error> {
        Cli::read(app, std::iter::once(app.name).chain(line.split_whitespace()).map(Into::into))
    }

    #[test]
    fn the_command_lines_are_consistent() {
        for app in [&STATIC, &WILD_APP] {
            Cli::of(app).debug_assert();
        }
    }

    const SHARED: [&str; 19] = [
        "demo --out d",
        "demo",
        "check s --holdout every:8",
        "train s --out d --system ngp --steps 10 --eval-every 5 --longest-side 100 --holdout none --background black \
         --seed 3 --threads 2 --error-budget 0.001 --set lr=0.1 --set space=ndc --image-memory 100",
        "train s --out d --seconds 60 --eval-at 10,30.5 --progress json",
        "train s --out d --train-split clean",
        "train --resume --out d",
        "eval d --lpips-weights w",
        "train s --out d --system mip-nerf --scales 4 --set width=64",
        "eval d --scales 4",
        "render d --path orbit --frames 10 --out e --layers colour,depth,opacity,normals,canonical --longest-side 50",
        "render d --path hold:train/r_0 --out e",
        "render d --out e --video webm",
        "render d --path photos --out e --video off",
        "view d",
        "view d --host 0.0.0.0 --port 8080",
        "export d --points p.ply --mesh m.ply --cameras c.json --box -1,-1,-1,1,1,1",
        "export d --mesh m.glb --triangles 50000 --method tsdf --resolution 300",
        "export c.spz --mesh m.obj --look-from c.json",
    ];

    const OF_WILD: [&str; 9] = [
        "demo --field mlp",
        "train s --out d --field ngp",
        "train s --out d --eval-appearance fit",
        "eval d --eval-appearance encode:whole",
        "eval d --eval-appearance image:train/r_0.png",
        "render d --path orbit --out e --appearance mean",
        "render d --path hold:a --out e --appearance image:a..fit:../b.png --fit-camera b",
        "masks d --out m --every 4 --empty-class left-out",
        "masks d",
    ];

    #[test]
    fn agreed_words_are_understood() {
        for line in SHARED {
            for app in [&STATIC, &WILD_APP] {
                read(app, line).unwrap_or_else(|e| panic!("{}: {line}: {e}", app.name));
            }
        }
        for line in OF_WILD {
            read(&WILD_APP, line).unwrap_or_else(|e| panic!("{line}: {e}"));
            let error = read(&STATIC, line).unwrap_err();
            assert!(error.exit_code() == 2 && error.to_string().contains("word of nerf-wild"), "{line}: {error}");
        }
        for line in [
            "train s",
            "train --out d",
            "train s --out d --steps 1 --seconds 1",
            "export d",
            "render d --out e --path circle",
            "render d --out e --video avi",
            "export d --method tsdf",
            "export d --mesh m.ply --triangles 3",
            "train s --out d --train-split dirty",
            "train s --out d --field fog",
            "train s --out d --eval-appearance encode:right",
            "render d --path orbit --out e --appearance noon",
            "render d --path orbit --out e --fit-camera b",
            "view",
            "view d --port 70000",
            "masks d --every 0",
            "masks d --empty-class two",
        ] {
            assert!(read(&WILD_APP, line).is_err(), "{line}");
        }
    }

    #[test]
    fn help_shows_the_words_of_the_app_alone() {
        for (app, has) in [(&STATIC, false), (&WILD_APP, true)] {
            let help = |line: &str| read(app, line).unwrap_err().to_string();
            assert_eq!(help("--help").contains("masks"), has, "{}", app.name);
            assert_eq!(help("train --help").contains("--eval-appearance"), has, "{}", app.name);
            assert_eq!(help("render --help").contains("--appearance"), has, "{}", app.name);
            assert!(
                help("--help").contains(app.about) && help("demo --help").contains(app.demo_folder),
                "{}",
                app.name
            );
        }
    }
}

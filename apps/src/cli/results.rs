//! Words of what is made of a run: `eval`, `render`, `view`, `export`, `masks`.

use super::training::Data;
use super::words::{
    BackgroundWord, EmptyWord, Layer, MeshMethod, VideoWord, budget, frame_count, seconds, time_step, triangle_count,
};
use clap::Args;
use engine::appearance::{AppearancePath, PhotoAppearance};
use engine::camera_path::PathKind;
use engine::eval::EvalAppearance;
use engine::time_path::TimePath;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub(crate) struct Eval {
    /// Run folder, or a file of Gaussians (.ply, .splat, .spz) with `--scene`
    #[arg(value_name = "RUN|FILE")]
    pub(crate) run: PathBuf,
    /// Of a file of Gaussians: the dataset whose held-out views are measured, a folder or file, or a `synthetic:` scene; the file is in
    /// its frame and unit
    #[arg(long, value_name = "SCENE")]
    pub(crate) scene: Option<String>,
    /// Of a file of Gaussians: folder of `eval.json`, `eval.csv` and `renders/` (default: scores are printed alone)
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Of a file of Gaussians: what is behind it, and behind photos with alpha (default: `white`)
    #[arg(long, value_enum, value_name = "COLOUR")]
    pub(crate) background: Option<BackgroundWord>,
    /// Measure at N scales instead (full size, half, quarter, …), against the means of the held-out pixels
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=12))]
    pub(crate) scales: Option<u32>,
    /// Appearance that held-out views are rendered in (default: the run's): `fit` (fitted on their left halves; right halves are
    /// scored), `mean`, `nearest` (that of the training photo of the same `appearance_id`, else nearest in time), `image:NAME` (that
    /// of a training photo), `encode:left`, `encode:whole` (what the system's encoder makes of the left half or the whole; right
    /// halves are scored)
    #[arg(long, value_name = "APPEARANCE")]
    pub(crate) eval_appearance: Option<EvalAppearance>,
    /// Error that a pixel may have from skipped work, in units of colour (default: the run's); 0 skips nothing
    #[arg(long, value_name = "X", value_parser = budget)]
    pub(crate) error_budget: Option<f32>,
    #[command(flatten)]
    pub(crate) data: Data,
}

#[derive(Debug, Args)]
pub(crate) struct Render {
    /// Run folder, or a file of Gaussians (.ply, .splat, .spz)
    pub(crate) run: PathBuf,
    /// `photos` (smoothly through the training cameras), `orbit` (the arc that they cover), `spiral` (for cameras that face one
    /// way), `hold:NAME` (the camera of that frame; part of its name is enough) or a JSON file of cameras (default: `photos`;
    /// `orbit` where photos stand all round an object, and for a file of Gaussians)
    ///
    /// A path stays where at least two photos saw nine tenths of each frame; the shares are written to `coverage.csv`, and frames
    /// below are named. A file of cameras is a `transforms.json` or the camera path of nerfstudio's viewer.
    #[arg(long, value_name = "PATH")]
    pub(crate) path: Option<PathKind>,
    /// Appearance: `mean`, `image:NAME` (that of a training photo), `fit:FILE` (that of another photo, or a frame's name), or `A..B`
    /// to go from one to another over the frames
    #[arg(long, value_name = "APPEARANCE")]
    pub(crate) appearance: Option<AppearancePath>,
    /// Frame whose camera took the photo of `fit:FILE`, at the frame's time; without, the frame FILE is, or the camera (and of a scene
    /// that moves the `time`, 0 to 1) in `FILE`.json beside it
    #[arg(long, value_name = "NAME", requires = "appearance")]
    pub(crate) fit_camera: Option<String>,
    /// Time of a scene that moves: `T`, or `A..B` to go from one to the other over the frames; 0 is the first time step and 1 the
    /// last (default: 0..1)
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub(crate) time: Option<TimePath>,
    /// Frames (default: 60, or as many as the file holds; 1 for `hold:` in one appearance at one time)
    #[arg(long, value_name = "N", value_parser = frame_count)]
    pub(crate) frames: Option<usize>,
    /// Folder of the pictures: PNG frames, `preview.gif`, `coverage.csv`, and a video where `ffmpeg` is installed
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Layers written
    ///
    /// `canonical` draws which point of the canonical scene each pixel sees, by its place in the scene's box (x red, y green, z blue):
    /// a point that moves keeps its colour. Where nothing is warped it is the surface itself. `flow` draws where each pixel goes until
    /// the next frame, by the motion of the camera and of what it shows, on the colour wheel of Middlebury (right red, down yellow, left
    /// cyan, up violet; white stands still, black is not known), with one scale for the whole path, which is said at the end. There is
    /// none of the last frame. Beside each of its pictures the flow itself is written, `flow_0000.flo` (Middlebury's form: pixels, x
    /// right, y down; `1e10` where it is not known). A system that neither warps points nor has scene flow shows the flow of the camera
    /// alone, and says so.
    #[arg(long, value_enum, value_delimiter = ',', default_value = "colour", value_name = "LAYER,…")]
    pub(crate) layers: Vec<Layer>,
    /// Scale pictures down to this longest side
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) longest_side: Option<u32>,
    /// Frames per second of the animated preview
    #[arg(long, default_value_t = 15.0, value_name = "X", value_parser = seconds)]
    pub(crate) fps: f64,
    /// Error that a pixel may have from skipped work, in units of colour (default: 1/255); 0 skips nothing
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
    /// Name or address of the network interface that the page is served at; `0.0.0.0` is all of them, for everybody in the network
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
    /// Coloured mesh of the surface that the photos' cameras see: `.ply`, `.obj` or `.glb`
    #[arg(long, value_name = "FILE", group = "what")]
    pub(crate) mesh: Option<PathBuf>,
    /// Gaussians: `.ply` (the layout of 3DGS), `.splat` or `.spz`; those of a `splat` run, or any field baked into Gaussians
    #[arg(long, value_name = "FILE", group = "what")]
    pub(crate) splats: Option<PathBuf>,
    /// Cameras: a `.json` file (transforms.json), or a folder (COLMAP text)
    #[arg(long, value_name = "FILE|DIR", group = "what")]
    pub(crate) cameras: Option<PathBuf>,
    /// Folder of one PLY for each photo, in the order of time: the surface that its camera sees at its time step, depth smoothed
    /// but for its edges
    #[arg(long, value_name = "DIR", group = "what")]
    pub(crate) frames: Option<PathBuf>,
    /// Leave the depth of `--frames` as it was rendered
    #[arg(long, requires = "frames")]
    pub(crate) rough: bool,
    /// Time of a scene that moves: 0 is the first time step and 1 the last
    #[arg(long, default_value_t = 0.0, value_name = "T", value_parser = time_step, allow_hyphen_values = true)]
    pub(crate) time: f64,
    /// Appearance of photos that differ: `mean` (the default), `image:NAME` (that of a training photo) or `fit:FILE` (fitted to
    /// another photo); as in `render`, but for one appearance only
    #[arg(long, value_name = "APPEARANCE")]
    pub(crate) appearance: Option<PhotoAppearance>,
    /// Frame whose camera took the photo of `fit:FILE`
    #[arg(long, value_name = "NAME", requires = "appearance")]
    pub(crate) fit_camera: Option<String>,
    /// Points wanted, about
    #[arg(long, default_value_t = 200_000, value_name = "N")]
    pub(crate) count: usize,
    /// How a mesh is made: `tsdf` (the default), from depth rendered at the photos' cameras and fused on a grid, or `density`, where
    /// the density of a field crosses `--level`
    #[arg(long, value_enum, value_name = "HOW", requires = "mesh")]
    pub(crate) method: Option<MeshMethod>,
    /// Triangles of the mesh at most (default: 200000; of `--method density` all)
    #[arg(long, value_name = "N", value_parser = triangle_count)]
    pub(crate) triangles: Option<usize>,
    /// Cells of the mesh along the longest side of the box (default: as fine as the photos' pixels are there; of `--method
    /// density` 256)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=2048))]
    pub(crate) resolution: Option<u16>,
    /// Density that the mesh is cut at, 1 / world unit (default: opaque within 2 % of the longest side); means `--method density`
    #[arg(long, value_name = "X", value_parser = seconds)]
    pub(crate) level: Option<f64>,
    /// JSON file of cameras that the mesh is seen from, instead of the photos' (for a file of Gaussians: instead of cameras all
    /// around it)
    #[arg(long, value_name = "FILE.json")]
    pub(crate) look_from: Option<PathBuf>,
    /// Box that is exported: x0,y0,z0,x1,y1,z1 in world units (default: the crop that was saved in the viewer; without one, of a
    /// mesh what several photos show, else the scene's box)
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
    /// Only every Nth training photo
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = frame_count)]
    pub(crate) every: usize,
    /// What a class scores in a photo where neither mask nor truth has a pixel of it
    #[arg(long, value_enum, default_value_t = EmptyWord::One, value_name = "SCORE")]
    pub(crate) empty_class: EmptyWord,
}

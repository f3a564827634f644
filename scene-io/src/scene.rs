//! A dataset as every system sees it: frames, cameras, points. Dialects end here.

use crate::depth::DepthSource;
use crate::perturbation::Perturbation;
use crate::picture::Image;
use crate::priors::{FlowTruth, Priors, SceneFlow, TrackPoint, TruthMask};
use crate::size::Size;
use glam::DVec3;
use render_core::camera::Camera;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A set of posed images with what else the dataset knows.
///
/// World axes and unit are those of the file that was read; camera axes are CV (x right, y down, z forward).
#[derive(Clone, Debug)]
pub struct Scene {
    /// A name for people: the folder's.
    pub name: String,
    /// The dataset's folder; relative names are relative to it.
    pub root: PathBuf,
    /// The file format it came in.
    pub dialect: Dialect,
    /// Images and cameras, in the order the dialect defines.
    pub frames: Vec<Frame>,
    /// Reconstructed surface points, empty if the dataset has none. In a moving scene they are taken for background that stands
    /// still: those of the Nerfies form, of `synthetic::orbit` and of `synthetic::mouth` are known to, those of structure from motion
    /// mostly do.
    pub points: Vec<Point>,
    /// What the dialect itself says about the arrangement of cameras and scene.
    pub layout: LayoutHint,
    /// The box the file says the scene lies in, world units.
    pub bounds: Option<Bounds>,
    /// What was skipped, matched or assumed, for people.
    pub notes: Vec<String>,
}

impl Scene {
    /// Indices of the frames of a split, ascending.
    pub fn split(&self, split: Split) -> impl Iterator<Item = usize> + '_ {
        self.frames.iter().enumerate().filter(move |(_, f)| f.split == split).map(|(i, _)| i)
    }

    /// Number of frames of a split.
    #[must_use]
    pub fn count(&self, split: Split) -> usize {
        self.split(split).count()
    }

    /// Names of the test frames, in frame order: what is written beside a run so that it can be repeated.
    #[must_use]
    pub fn held_out_names(&self) -> Vec<String> {
        self.split(Split::Test).map(|i| self.frames[i].name.clone()).collect()
    }
}

/// The file format of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Dialect {
    /// `transforms_train.json`, `transforms_val.json`, `transforms_test.json`; D-NeRF's and HDR-HexPlane's too.
    Blender,
    /// `transforms.json` as instant-ngp writes it.
    InstantNgp,
    /// `transforms.json` as nerfstudio writes it.
    Nerfstudio,
    /// A sparse model of COLMAP, text or binary.
    Colmap,
    /// `poses_bounds.npy`.
    Llff,
    /// `precomputed.json` as NR-NeRF writes it: images in time order.
    NrNerf,
    /// A folder of Nerfies, HyperNeRF or DyCheck: `dataset.json`, `metadata.json`, `scene.json`, `camera/`.
    Nerfies,
    /// `poses_bounds.npy` with `images`, `masks` and `depth` of an endoscope, as EndoNeRF reads it.
    EndoNerf,
    /// Made here, from no file.
    Synthetic,
}

impl Dialect {
    /// Name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Blender => "blender",
            Self::InstantNgp => "instant-ngp",
            Self::Nerfstudio => "nerfstudio",
            Self::Colmap => "colmap",
            Self::Llff => "llff",
            Self::NrNerf => "nr-nerf",
            Self::Nerfies => "nerfies",
            Self::EndoNerf => "endonerf",
            Self::Synthetic => "synthetic",
        }
    }

    /// The dialects that can be read from files.
    pub const READABLE: [Self; 8] = [
        Self::Blender,
        Self::InstantNgp,
        Self::Nerfstudio,
        Self::Colmap,
        Self::Llff,
        Self::NrNerf,
        Self::Nerfies,
        Self::EndoNerf,
    ];
}

impl fmt::Display for Dialect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl std::str::FromStr for Dialect {
    type Err = String;

    /// Accepts the names of [`Dialect::name`]; the error lists them.
    fn from_str(text: &str) -> Result<Self, String> {
        Self::READABLE.into_iter().find(|d| d.name() == text).ok_or_else(|| {
            let names: Vec<_> = Self::READABLE.iter().map(|d| d.name()).collect();
            format!("`{text}` is not a dataset format: use one of {}", names.join(", "))
        })
    }
}

/// What a dialect says about the arrangement of cameras and scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LayoutHint {
    /// Cameras around an object on an empty background.
    Object {
        /// Distance before which there is nothing, world units.
        near: f64,
        /// Distance behind which there is nothing, world units.
        far: f64,
    },
    /// Cameras side by side looking the same way: NDC fits.
    ForwardFacing,
    /// The background reaches to infinity.
    Unbounded,
    /// The dialect does not say.
    Unknown,
}

/// An axis-aligned box, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: DVec3,
    /// Largest coordinates.
    pub max: DVec3,
}

/// A coloured point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Position, world units.
    pub xyz: DVec3,
    /// Colour, sRGB.
    pub rgb: [u8; 3],
}

/// One image, its camera and what belongs to it: [`Frame::new`] makes one of a picture and a camera, all other fields may be set.
///
/// What is trained on and what is for scoring only are apart: the latter is in [`Frame::truth`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Frame {
    /// Unique within the scene: the path as the dataset writes it, without a leading `./`.
    pub name: String,
    /// The picture.
    pub image: ImageSource,
    /// Mask; see [`Frame::mask_polarity`].
    pub mask: Option<PathBuf>,
    /// What white means in [`Frame::mask`].
    pub mask_polarity: MaskPolarity,
    /// Depth: measured (stereo, lidar) in training frames, truth to score against in test frames.
    pub depth: Option<DepthSource>,
    /// What other programs made of the photo.
    pub priors: Priors,
    /// What is known for certain: for scoring only, never for training.
    pub truth: Truth,
    /// Features that belong to reconstructed points (COLMAP), in the order of the model.
    pub tracks: Vec<TrackPoint>,
    /// What is done to the picture when it is decoded; see [`crate::perturb`].
    pub perturbation: Option<Arc<Perturbation>>,
    /// What the alpha of the picture means.
    pub alpha: AlphaMeaning,
    /// Numbers the dataset gives the frame's time step, appearance and camera.
    pub ids: Option<FrameIds>,
    /// Camera at the image's native size.
    pub camera: Camera,
    /// What the frame is for.
    pub split: Split,
    /// Time in `[0, 1]` over the sequence, whatever the dialect wrote: see [`crate::time`].
    pub time: Option<f64>,
    /// Smallest and largest z depth of what is seen, world units.
    pub z_bounds: Option<[f64; 2]>,
    /// Sharpness as the dataset scores it (larger is sharper; instant-ngp).
    pub sharpness: Option<f64>,
}

impl Frame {
    /// A training frame with nothing but an image and a camera.
    #[must_use]
    pub fn new(name: impl Into<String>, image: ImageSource, camera: Camera) -> Self {
        Self {
            name: name.into(),
            image,
            mask: None,
            mask_polarity: MaskPolarity::WhiteIsUsed,
            depth: None,
            priors: Priors::default(),
            truth: Truth::default(),
            tracks: Vec::new(),
            perturbation: None,
            alpha: AlphaMeaning::Opacity,
            ids: None,
            camera,
            split: Split::Train,
            time: None,
            z_bounds: None,
            sharpness: None,
        }
    }

    /// Where the photo lies in the folder `root` of its dataset; its name where it lies elsewhere or in memory.
    #[must_use]
    pub fn path_within(&self, root: &Path) -> &Path {
        let inside = match &self.image {
            ImageSource::File(path) => path.strip_prefix(root).ok(),
            ImageSource::Memory(_) => None,
        };
        inside.unwrap_or(Path::new(&self.name))
    }

    /// The photo's native size.
    pub(crate) fn size(&self) -> Size {
        Size::from(&self.camera)
    }
}

/// What is known for certain about a frame. For scoring only: nothing that trains may read it.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct Truth {
    /// What does not belong to the place: passers-by, tools.
    pub transient: Option<TruthMask>,
    /// What moves at some time.
    pub moving: Option<TruthMask>,
    /// Which pixels show what training frames saw, too (DyCheck's covisibility).
    pub covisible: Option<TruthMask>,
    /// Where another frame shows what this one does.
    pub flow: Option<FlowTruth>,
    /// Where the surface points that it shows go.
    pub scene_flow: Option<Arc<SceneFlow>>,
}

/// What the alpha of a picture means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AlphaMeaning {
    /// How opaque the pixel is.
    #[default]
    Opacity,
    /// Whether the pixel may be used (DyCheck: its depth is known): 0 is as an ignore mask's black.
    Used,
}

/// Numbers that a dataset of the Nerfies form gives a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FrameIds {
    /// Time step: `time_id`, else `warp_id`. Frames of several cameras may share one.
    pub time: u32,
    /// Appearance: `appearance_id`.
    pub appearance: u32,
    /// Camera: `camera_id`.
    pub camera: u32,
}

/// Where the pixels of a frame are.
#[derive(Clone, Debug)]
pub enum ImageSource {
    /// In a file, decoded when asked for.
    File(PathBuf),
    /// In memory already.
    Memory(Arc<Image>),
}

/// What a frame is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Split {
    /// Trained on.
    Train,
    /// For choosing settings.
    Val,
    /// Held out and measured.
    Test,
    /// Neither trained on nor measured.
    Unused,
}

impl Split {
    /// All splits, in the order of reports.
    pub const ALL: [Self; 4] = [Self::Train, Self::Val, Self::Test, Self::Unused];

    /// Whether frames of it are compared with what is rendered: held out for the last word, or for choosing settings.
    #[must_use]
    pub fn is_measured(self) -> bool {
        matches!(self, Self::Test | Self::Val)
    }

    /// Lower-case name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
            Self::Unused => "unused",
        }
    }
}

/// What white means in a mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MaskPolarity {
    /// White pixels are used, black ones ignored (COLMAP, nerfstudio).
    #[default]
    WhiteIsUsed,
    /// White pixels are ignored (masks of passers-by or tools).
    WhiteIsIgnored,
    /// White pixels show the object, and there is nothing around it (NeRD): the mask becomes the photo's alpha, and no pixel
    /// is ignored.
    WhiteIsObject,
}

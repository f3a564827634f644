//! What a dialect's files say: its own words for frames, splits and masks, before any image was read.

use crate::depth::DepthSource;
use crate::options::MissingImages;
use crate::pose::Mended;
use crate::priors::{FlowTruth, TrackPoint};
use crate::{AlphaMeaning, Bounds, FrameIds, LayoutHint, MaskPolarity, Point, Problem, Size, Split};
use render_core::camera::{Camera, Lens, Pose};
use std::path::{Path, PathBuf};

/// What a dialect's files say, before any image was read.
#[derive(Debug)]
pub(crate) struct Reading {
    pub(crate) root: PathBuf,
    pub(crate) frames: Vec<RawFrame>,
    pub(crate) points: Vec<Point>,
    pub(crate) layout: LayoutHint,
    /// Whether the layout holds only where images have alpha: the dialect's custom, and not written in the file.
    pub(crate) layout_needs_alpha: bool,
    pub(crate) bounds: Option<Bounds>,
    pub(crate) splits: DialectSplits,
    /// What this dialect's own tools do about missing images.
    pub(crate) missing: MissingImages,
    /// Folder that mask folders stand beside, where it is not an `images*` folder under the root.
    pub(crate) images_folder: Option<PathBuf>,
    /// Whether [`Masks::Auto`] looks for a mask folder.
    pub(crate) mask_folder: MaskFolder,
    /// What white means in this dialect's masks, where the caller says nothing else.
    pub(crate) mask_polarity: MaskPolarity,
    /// What alpha means in this dialect's pictures.
    pub(crate) alpha: AlphaMeaning,
    /// Whether images are looked for.
    pub(crate) need: Need,
    pub(crate) notes: Vec<String>,
    pub(crate) problems: Vec<Problem>,
}

/// What is wanted of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Need {
    /// Everything: without images there is nothing to train on.
    Images,
    /// Cameras and times; images need not be there.
    Cameras,
}

/// Whether a dialect has mask folders by custom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskFolder {
    Usual,
    Unknown,
}

/// How a dialect splits its frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DialectSplits {
    /// The files say: [`RawFrame::split`] holds.
    Explicit,
    /// Of the frames sorted by name, those at 0, N, 2N, … are for testing.
    Every(usize),
    /// A share of the frames sorted by name, evenly spaced and with both ends, is trained on: nine of ten.
    NineOfTen,
}

impl Reading {
    pub(crate) fn new(root: &Path) -> Self {
        Self {
            root: root.to_path_buf(),
            frames: Vec::new(),
            points: Vec::new(),
            layout: LayoutHint::Unknown,
            layout_needs_alpha: false,
            bounds: None,
            splits: DialectSplits::Every(8),
            missing: MissingImages::Refuse,
            images_folder: None,
            mask_folder: MaskFolder::Usual,
            mask_polarity: MaskPolarity::WhiteIsUsed,
            alpha: AlphaMeaning::Opacity,
            need: Need::Images,
            notes: Vec::new(),
            problems: Vec::new(),
        }
    }
}

/// A frame as a dialect lists it.
#[derive(Clone, Debug)]
pub(crate) struct RawFrame {
    pub(crate) name: String,
    /// Where the image should be; an extension may be missing.
    pub(crate) image: PathBuf,
    /// The file and the way in it, for problems.
    pub(crate) listed: (PathBuf, String),
    /// Image size the intrinsics belong to; `None`: that of the image.
    pub(crate) size: Option<Size>,
    pub(crate) intrinsics: Intrinsics,
    pub(crate) lens: Lens,
    pub(crate) pose: Pose,
    pub(crate) mended: Mended,
    pub(crate) split: Split,
    pub(crate) time: Option<f64>,
    pub(crate) mask: Option<PathBuf>,
    pub(crate) depth: Option<DepthSource>,
    /// Truth mask, white = occluder: for scoring.
    pub(crate) transient: Option<PathBuf>,
    /// Truth mask, white = moves at some time: for scoring.
    pub(crate) moving: Option<PathBuf>,
    /// Truth mask, white = seen in training, too: for scoring.
    pub(crate) covisible: Option<PathBuf>,
    /// Truth about where another frame shows what this one does: for scoring.
    pub(crate) flow: Option<FlowTruth>,
    pub(crate) ids: Option<FrameIds>,
    /// At the size of [`RawFrame::size`].
    pub(crate) tracks: Vec<TrackPoint>,
    pub(crate) z_bounds: Option<[f64; 2]>,
    pub(crate) sharpness: Option<f64>,
}

/// Focal length and principal point as a dialect gives them, checked to be finite and positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Intrinsics {
    /// In pixels; a missing principal point is the image's centre.
    Pixels { fx: f64, fy: f64, cx: Option<f64>, cy: Option<f64> },
    /// Full angles of view in radians; without a vertical one, pixels are square.
    Angles { x: f64, y: Option<f64>, cx: Option<f64>, cy: Option<f64> },
}

impl Intrinsics {
    pub(crate) fn camera(&self, width: u32, height: u32, lens: Lens, pose: Pose) -> Camera {
        let (w, h) = (f64::from(width), f64::from(height));
        let (fx, fy, cx, cy) = match *self {
            Self::Pixels { fx, fy, cx, cy } => (fx, fy, cx, cy),
            Self::Angles { x, y, cx, cy } => {
                let fx = w / (2.0 * (x / 2.0).tan());
                (fx, y.map_or(fx, |y| h / (2.0 * (y / 2.0).tan())), cx, cy)
            }
        };
        Camera { width, height, fx, fy, cx: cx.unwrap_or(w / 2.0), cy: cy.unwrap_or(h / 2.0), lens, pose }
    }
}

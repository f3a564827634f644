//! Values of the words: lists of choices, and numbers in their range.

use clap::ValueEnum;
use engine::options::Background;
use engine::time_path::TimePath;
use losses::metrics::EmptyClass;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressKind {
    /// One line that is redrawn on a terminal, a line per interval otherwise
    Auto,
    /// A line per interval, for logs
    Lines,
    /// A JSON object a line on standard error, for programs
    Json,
    /// Nothing is shown
    Off,
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum VideoWord {
    /// H.264 in preview.mp4
    Mp4,
    /// VP9 in preview.webm
    Webm,
    /// No video
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
    /// Which point of the canonical scene is seen, as colour: x, y, z within the scene's box
    Canonical,
    /// Optical flow to the next frame: hue is direction, saturation length
    Flow,
    /// What stands still, without what moves before it: of systems that know the two apart (`degauss`)
    Background,
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
    /// White
    White,
    /// Black
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
pub(super) fn time_step(text: &str) -> Result<f64, String> {
    let path: TimePath = text.parse()?;
    if path.is_still() {
        Ok(path.at(0, 1))
    } else {
        Err(format!("`{text}` goes from one time to another: give one time"))
    }
}

pub(super) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("write a number above 0".into()),
    }
}

pub(super) fn budget(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if (0.0..=1.0).contains(&x) => Ok(x),
        _ => Err("write a number from 0 to 1".into()),
    }
}

/// Cameras need two pictures.
pub(super) fn at_least_two(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n @ 2..=100_000) => Ok(n),
        _ => Err("write a whole number from 2 to 100000".into()),
    }
}

pub(super) fn triangle_count(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n @ 4..=100_000_000) => Ok(n),
        _ => Err("write a whole number from 4 to 100000000".into()),
    }
}

pub(super) fn frame_count(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(n @ 1..=100_000) => Ok(n),
        _ => Err("write a whole number from 1 to 100000".into()),
    }
}

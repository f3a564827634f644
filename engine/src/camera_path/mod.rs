//! Cameras to render along.
//!
//! | word | path |
//! | --- | --- |
//! | `photos` | a smooth path through the training cameras, at constant speed |
//! | `orbit` | the arc about what they look at that they cover, to and fro; a circle where they stand all round |
//! | `spiral` | a spiral among cameras that face one way |
//! | `hold:NAME` | the camera of one frame |
//! | `FILE.json` | cameras of a [mod@file] |
//!
//! [`film`] measures each frame with a [`Sight`]: which share of it at least two photos saw. Paths that are made here are
//! made shorter until every frame has [`BOUND`] of it; [`cameras`] makes them without that.

mod choose;
pub mod file;
mod hold;
mod orbit;
mod photos;
mod rig;
mod sight;
mod spiral;
mod stretch;

pub use choose::{FRAMES, Film, cameras, film};
pub use file::from_file;
pub(crate) use file::read;
pub use sight::{Draw, SEEN_FILE, Sight, coverage_csv, coverage_line};

use std::path::PathBuf;
use std::str::FromStr;

/// Share of a frame that at least two photos saw below which the frame is named.
pub const BOUND: f64 = 0.9;

/// The paths there are, for messages.
pub const PATHS: &str =
    "`photos`, `orbit`, `spiral`, `hold:NAME` (the camera of a frame) and FILE.json (a file of cameras)";

/// Which path.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathKind {
    /// Through the training cameras.
    Photos,
    /// About what the cameras look at.
    Orbit,
    /// A spiral among forward-facing cameras.
    Spiral,
    /// The camera of a frame, again and again: for an appearance that changes while nothing else does.
    Hold(String),
    /// From a file.
    File(PathBuf),
}

impl FromStr for PathKind {
    type Err = String;

    /// `photos`, `orbit`, `spiral`, `hold:NAME`, or a file: a name that ends with `.json`, or any file that is there.
    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text {
            "photos" => Self::Photos,
            "orbit" => Self::Orbit,
            "spiral" => Self::Spiral,
            other => match other.strip_prefix("hold:") {
                Some(name) => Self::Hold(name.into()),
                None => {
                    let path = PathBuf::from(other);
                    let json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
                    if !json && !path.is_file() {
                        return Err(format!("there is no path of this name; the paths are {PATHS}"));
                    }
                    Self::File(path)
                }
            },
        })
    }
}

impl std::fmt::Display for PathKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Photos => f.write_str("photos"),
            Self::Orbit => f.write_str("orbit"),
            Self::Spiral => f.write_str("spiral"),
            Self::Hold(name) => write!(f, "hold:{name}"),
            Self::File(path) => write!(f, "{}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_word_is_a_path_and_another_word_lists_the_paths() {
        for (word, want) in [
            ("photos", PathKind::Photos),
            ("orbit", PathKind::Orbit),
            ("spiral", PathKind::Spiral),
            ("hold:a/b.png", PathKind::Hold("a/b.png".into())),
            ("nowhere/x.json", PathKind::File("nowhere/x.json".into())),
        ] {
            assert_eq!(word.parse::<PathKind>().unwrap(), want);
            assert_eq!(want.to_string(), word);
        }
        for wrong in ["", "orbits", "circle", "Photos"] {
            let error = wrong.parse::<PathKind>().unwrap_err();
            assert!(
                ["photos", "orbit", "spiral", "hold:NAME", "FILE.json"].iter().all(|p| error.contains(p)),
                "{error}"
            );
        }
    }
}

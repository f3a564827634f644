//! The words for the appearance in which held-out views are measured.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The appearance of held-out views: `fit`, `mean`, `nearest`, `image:NAME`, `encode:whole`, `encode:left`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum EvalAppearance {
    /// Fitted on the left half of each view; the right half is scored, whether or not the system has anything to fit.
    Fit,
    /// The mean of the training photos; whole views are scored.
    Mean,
    /// That of the training photo that the dataset gives the same appearance, else of the one nearest in time; whole views are scored.
    Nearest,
    /// That of a training photo; whole views are scored.
    Image(String),
    /// What the system's own encoder makes of part of each view; the right half is scored.
    Encode(Part),
}

/// Part of a photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    Whole,
    /// Columns `0 .. W / 2`.
    Left,
}

impl FromStr for EvalAppearance {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "fit" => Ok(Self::Fit),
            "mean" => Ok(Self::Mean),
            "nearest" => Ok(Self::Nearest),
            "encode:whole" => Ok(Self::Encode(Part::Whole)),
            "encode:left" => Ok(Self::Encode(Part::Left)),
            _ => match text.strip_prefix("image:").filter(|name| !name.is_empty()) {
                Some(name) => Ok(Self::Image(name.into())),
                None => Err(format!(
                    "`{text}`: write `fit`, `mean`, `nearest`, `image:NAME`, `encode:left` or `encode:whole`"
                )),
            },
        }
    }
}

impl TryFrom<String> for EvalAppearance {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<EvalAppearance> for String {
    fn from(what: EvalAppearance) -> Self {
        what.to_string()
    }
}

impl fmt::Display for EvalAppearance {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fit => f.write_str("fit"),
            Self::Mean => f.write_str("mean"),
            Self::Nearest => f.write_str("nearest"),
            Self::Image(name) => write!(f, "image:{name}"),
            Self::Encode(Part::Whole) => f.write_str("encode:whole"),
            Self::Encode(Part::Left) => f.write_str("encode:left"),
        }
    }
}

//! In which appearance held-out views are rendered, and which of their pixels are scored.
//!
//! A held-out photo has an appearance of its own that no training photo tells. In the half-image protocol the appearance code is
//! fitted to the left half of the photo, everything else frozen, and the right half is scored: what is scored was never
//! seen. An encoder's code may be had from the left half or from the whole photo; with the whole photo the scored half
//! leaks into the code, and tables must say so. In a film a training photo may be from the same time, or nearly: its appearance is
//! taken as it is, and whole views are scored.
//!
//! Source: Martin-Brualla et al., "NeRF in the Wild", 2021, section 4.4; Chen et al., "Ha-NeRF", 2022, section 5; of films Park et
//! al., "Nerfies", 2021, section 5.

use super::half;
use crate::data::{Dataset, View};
use crate::error::RunError;
use crate::names;
use crate::options::{EvalAppearance, Part};
use crate::system::{Appearance, Fit, Query, System};
use image::RgbImage;
use scene_io::Image;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

/// Steps of a fit: past these, codes of 4 to 48 numbers have settled.
pub const FIT_STEPS: u64 = 300;
/// Learning rate at the start of a fit.
pub const FIT_LR: f64 = 0.05;

/// Which pixels are scored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scored {
    /// All.
    #[default]
    Whole,
    /// Columns `W / 2 .. W`, `W / 2` rounded down.
    RightHalf,
}

/// When a photo was taken, and the number of its appearance where the dataset gives one.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Taken {
    time: f64,
    appearance: Option<u32>,
}

impl Taken {
    fn of(view: &View) -> Self {
        Self { time: view.time, appearance: view.source.ids.map(|ids| ids.appearance) }
    }
}

/// A held-out photo.
#[derive(Clone, Copy)]
pub(super) struct HeldOutPhoto<'a> {
    pub(super) image: &'a Image,
    /// The same, composited on the background.
    pub(super) on_background: &'a RgbImage,
}

/// How held-out views are measured; part of `eval.json`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Protocol {
    /// In which appearance; absent where the system has one appearance only and nothing was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub appearance: Option<EvalAppearance>,
    /// Which pixels count.
    pub scored: Scored,
    /// Steps of each fit; absent where nothing is fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit_steps: Option<u64>,
    /// Learning rate at the start of each fit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit_lr: Option<f64>,
    /// The training photos, where the nearest of them is asked for.
    #[serde(skip)]
    training: Arc<[Taken]>,
}

impl Protocol {
    /// The protocol for `asked`, or where nothing is asked for: a fit where the system has appearance codes, whole views in
    /// its only one otherwise. `train` are the views it was trained on.
    ///
    /// # Errors
    /// [`RunError::Option`] for an appearance that the system does not have.
    ///
    /// # Panics
    /// If [`EvalAppearance::Encode`] is asked for and `train` has no view.
    pub fn new(asked: Option<&EvalAppearance>, system: &dyn System, train: &Dataset) -> Result<Self, RunError> {
        let has_codes = system.appearance_code(&Appearance::Mean).is_some();
        let appearance = match (asked, has_codes) {
            (None, false) => return Ok(Self::default()),
            (None, true) => EvalAppearance::Fit,
            (Some(asked), _) => asked.clone(),
        };
        match &appearance {
            EvalAppearance::Fit | EvalAppearance::Mean => {}
            EvalAppearance::Nearest => need_nearest(system, train)?,
            EvalAppearance::Image(name) => {
                view_of(system, train, name, "--eval-appearance")?;
            }
            EvalAppearance::Encode(_) => {
                if system.encode_appearance(train.image(0)?.as_ref()).is_none() {
                    return Err(RunError::Option(format!(
                        "`--eval-appearance {appearance}`: `{}` has no encoder of photos; use `fit` or `mean`",
                        system.name()
                    )));
                }
            }
        }
        let fits = has_codes && appearance == EvalAppearance::Fit;
        Ok(Self {
            scored: match appearance {
                EvalAppearance::Fit | EvalAppearance::Encode(_) => Scored::RightHalf,
                EvalAppearance::Mean | EvalAppearance::Nearest | EvalAppearance::Image(_) => Scored::Whole,
            },
            training: match appearance {
                EvalAppearance::Nearest => train.views().iter().map(Taken::of).collect(),
                _ => Arc::default(),
            },
            fit_steps: fits.then_some(FIT_STEPS),
            fit_lr: fits.then_some(FIT_LR),
            appearance: Some(appearance),
        })
    }

    /// What is the same for all views: `query` in the mean appearance or that of a training view.
    ///
    /// # Errors
    /// As [`Protocol::new`].
    pub fn query(&self, query: Query, system: &dyn System, train: &Dataset) -> Result<Query, RunError> {
        Ok(match &self.appearance {
            Some(EvalAppearance::Image(name)) => {
                Query { appearance: Appearance::View(view_of(system, train, name, "--eval-appearance")?), ..query }
            }
            _ => query,
        })
    }

    /// The appearance of one view, where it has one of its own. A view without a usable pixel in its left half has none.
    pub(super) fn appearance_of(
        &self,
        system: &dyn System,
        data: &Dataset,
        view: usize,
        photo: HeldOutPhoto<'_>,
        query: &Query,
        seed: u64,
    ) -> Option<Appearance> {
        if self.appearance == Some(EvalAppearance::Nearest) {
            return self.nearest(Taken::of(data.view(view))).map(Appearance::View);
        }
        let HeldOutPhoto { image: photo, on_background: truth } = photo;
        let code = match (&self.appearance, self.fit_steps, self.fit_lr) {
            (Some(EvalAppearance::Fit), Some(steps), Some(lr)) => {
                let columns = 0..half::middle(photo.width);
                let (rays, rgb) = half::pixels(photo, truth, columns, |x, y| data.ray(view, x, y));
                if rays.is_empty() {
                    return None;
                }
                let (time, background, halt) = (data.view(view).time, query.background, &query.halt);
                system.fit_appearance(&Fit { rays: &rays, rgb: &rgb, time, background, steps, lr, seed, halt })
            }
            (Some(EvalAppearance::Encode(Part::Whole)), ..) => system.encode_appearance(photo),
            (Some(EvalAppearance::Encode(Part::Left)), ..) => system.encode_appearance(&half::left(photo)),
            _ => None,
        };
        code.map(|code| Appearance::Code(Arc::from(code)))
    }

    /// The training photo of the same appearance, else the one nearest in time; of several the first.
    fn nearest(&self, own: Taken) -> Option<usize> {
        let same = |id| self.training.iter().position(|other| other.appearance == Some(id));
        let far = |i: usize| (self.training[i].time - own.time).abs();
        let in_time = || (0..self.training.len()).min_by(|&a, &b| far(a).total_cmp(&far(b)));
        own.appearance.and_then(same).or_else(in_time)
    }
}

impl fmt::Display for Protocol {
    /// A sentence for tables.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (&self.appearance, self.fit_steps) {
            (None, _) => f.write_str("one appearance")?,
            (Some(EvalAppearance::Fit), Some(steps)) => {
                write!(f, "appearance fitted on the left half of each view ({steps} steps)")?;
            }
            (Some(EvalAppearance::Fit), None) => f.write_str("one appearance, nothing to fit")?,
            (Some(EvalAppearance::Mean), _) => f.write_str("mean appearance of the training photos")?,
            (Some(EvalAppearance::Nearest), _) => {
                f.write_str("appearance of the training photo of the same appearance_id, else nearest in time")?;
            }
            (Some(EvalAppearance::Image(name)), _) => write!(f, "appearance of training photo `{name}`")?,
            (Some(EvalAppearance::Encode(Part::Left)), _) => {
                f.write_str("appearance encoded from each view's left half")?
            }
            (Some(EvalAppearance::Encode(Part::Whole)), _) => {
                f.write_str("appearance encoded from each whole view, so that the scored half leaks into it")?;
            }
        }
        f.write_str(match self.scored {
            Scored::Whole => "; whole views scored",
            Scored::RightHalf => "; right half scored",
        })
    }
}

/// The training view `name` of a system that has a code for it.
///
/// # Errors
/// [`RunError::Option`] beginning with `option` where there is no such view, or no code for it.
pub(crate) fn view_of(system: &dyn System, train: &Dataset, name: &str, option: &str) -> Result<usize, RunError> {
    let option = format!("`{option} image:{name}`");
    need_codes(system, &option)?;
    let names: Vec<&str> = train.views().iter().filter(|v| v.level == 0).map(|v| v.name.as_str()).collect();
    names::find(&names, name, &option)
}

/// Refuses systems that have one appearance only, and photos of which none is nearer than another.
fn need_nearest(system: &dyn System, train: &Dataset) -> Result<(), RunError> {
    let option = "`--eval-appearance nearest`";
    need_codes(system, option)?;
    if train.time_steps() > 1 || train.views().iter().any(|view| view.source.ids.is_some()) {
        return Ok(());
    }
    Err(RunError::Option(format!("{option}: the photos have no times; use `fit`, `mean` or `image:NAME`")))
}

/// Refuses systems that have one appearance only.
///
/// # Errors
/// [`RunError::Option`] beginning with `option`.
pub(crate) fn need_codes(system: &dyn System, option: &str) -> Result<(), RunError> {
    match system.appearance_code(&Appearance::Mean) {
        Some(_) => Ok(()),
        None => Err(RunError::Option(format!(
            "{option}: `{}` has one appearance only; train a system with appearance codes, or leave the option out",
            system.name()
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_back_as_they_are_written() {
        for word in ["fit", "mean", "nearest", "image:a:b.png", "encode:whole", "encode:left"] {
            assert_eq!(word.parse::<EvalAppearance>().unwrap().to_string(), word);
        }
        for wrong in ["", "image:", "encode", "encode:right", "Fit"] {
            assert!(wrong.parse::<EvalAppearance>().unwrap_err().contains("encode:left"), "{wrong}");
        }
    }

    #[test]
    fn the_nearest_photo_is_of_the_same_appearance_or_else_of_nearly_the_same_time() {
        let taken = |time, appearance| Taken { time, appearance };
        let training = Arc::from([taken(0.0, Some(4)), taken(0.5, None), taken(1.0, Some(9)), taken(0.5, None)]);
        let protocol = Protocol { appearance: Some(EvalAppearance::Nearest), training, ..Protocol::default() };
        let nearest = |time, appearance| protocol.nearest(taken(time, appearance));
        assert_eq!(nearest(0.1, Some(9)), Some(2), "whatever its time");
        assert_eq!([nearest(0.1, Some(5)), nearest(0.1, None), nearest(0.9, None)], [Some(0), Some(0), Some(2)]);
        assert_eq!(nearest(0.6, None), Some(1), "the first of two at one time");
        assert_eq!(Protocol::default().nearest(taken(0.3, None)), None);
        let json = serde_json::to_string(&protocol).unwrap();
        assert_eq!(json, r#"{"appearance":"nearest","scored":"whole"}"#, "the photos are not written down");
    }

    #[test]
    fn a_protocol_is_short_in_json_and_a_sentence_in_tables() {
        let protocol = Protocol {
            appearance: Some(EvalAppearance::Fit),
            scored: Scored::RightHalf,
            fit_steps: Some(300),
            fit_lr: Some(0.05),
            ..Protocol::default()
        };
        let json = serde_json::to_string(&protocol).unwrap();
        assert_eq!(json, r#"{"appearance":"fit","scored":"right-half","fit_steps":300,"fit_lr":0.05}"#);
        assert_eq!(serde_json::from_str::<Protocol>(&json).unwrap(), protocol);
        assert!(protocol.to_string().contains("left half of each view (300 steps); right half"), "{protocol}");
        assert_eq!(serde_json::to_string(&Protocol::default()).unwrap(), r#"{"scored":"whole"}"#);
    }
}

//! Appearance of a cloud of Gaussians: its colours as each photo shows them.
//!
//! | part | file |
//! | --- | --- |
//! | settings | [`settings`] |
//! | a code for each photo, and a network that turns it and that of a Gaussian ([`crate::views::PlaceCodes`]) into a tone | [`tone`] |
//!
//! Source: Kulhanek et al., "WildGaussians: 3D Gaussian Splatting in the Wild", 2024, section 3.2.

mod settings;
#[cfg(test)]
mod tests;
mod tone;

pub(crate) use settings::{AppearanceChoice, CloudAppearance, ToneSettings, rate_left};
pub(crate) use tone::Tone;

//! Appearance of a cloud of Gaussians from a reference photo: its colours as a network reads them from feature maps of it.
//!
//! | part | file |
//! | --- | --- |
//! | settings | [`settings`] |
//! | maps of the photo; where a Gaussian lies in it, and where it learnt to look | [`feature_maps`] |
//!
//! What it shares with other kinds: [`crate::cloud_reference`].
//!
//! Source: Zhang et al., "Gaussian in the Wild: 3D Gaussian Splatting for Unconstrained Image Collections", 2024.

mod feature_maps;
#[cfg(test)]
mod learning_tests;
mod settings;
#[cfg(test)]
mod tests;

pub(crate) use feature_maps::FeatureMaps;
pub(crate) use settings::MapSettings;

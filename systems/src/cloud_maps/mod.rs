//! Appearance of a cloud of Gaussians from a reference photo: its colours as a network reads them from feature maps of it.
//!
//! | part | file |
//! | --- | --- |
//! | settings | [`settings`] |
//! | a photo made small, and its camera; the code of an appearance: maps and camera | [`reference`] |
//! | the network that makes feature maps of a photo | [`map_network`] |
//! | features of a Gaussian: where it lies in the photo, and where it learnt to look | [`sampling`] |
//! | the network that fuses them with what a Gaussian is, to a tone | [`fusion`] |
//! | what is worked out once for a reference that stays | [`cached`] |
//! | all of it as an appearance | [`feature_maps`] |
//!
//! Source: Zhang et al., "Gaussian in the Wild: 3D Gaussian Splatting for Unconstrained Image Collections", 2024.

mod cached;
mod feature_maps;
mod fusion;
#[cfg(test)]
mod learning_tests;
mod map_network;
#[cfg(test)]
mod network_tests;
mod reference;
mod sampling;
mod settings;
#[cfg(test)]
mod tests;

pub(crate) use feature_maps::FeatureMaps;
pub(crate) use settings::MapSettings;

//! Appearance of a cloud of Gaussians from a reference photo: what all kinds of it share.
//!
//! | part | file |
//! | --- | --- |
//! | a photo made small, its camera, depths of what it shows | [`reference`] |
//! | what kinds differ in: the code of a photo, and where Gaussians read it | [`reading`] |
//! | the network that makes maps of a picture | [`map_network`] |
//! | maps, read between their pixels | [`sampling`] |
//! | the network that fuses what a Gaussian reads with what it is, to a tone | [`fusion`] |
//! | what is worked out once for a reference that stays | [`cached`] |
//! | all of it as an appearance | [`appearance`] |
//!
//! Kinds: [`crate::cloud_maps`], [`crate::cloud_triplane`].

mod appearance;
mod cached;
mod fusion;
mod map_network;
#[cfg(test)]
mod network_tests;
mod reading;
mod reference;
mod sampling;
#[cfg(test)]
pub(crate) mod test_scene;

pub(crate) use appearance::{ReferenceAppearance, ReferenceSettings};
pub(crate) use map_network::{MapMemory, MapNetwork, MapShape, SIDE, TILTS, is_side};
pub(crate) use reading::{Joined, PhotoCode, Places, Reading};
#[cfg(test)]
pub(crate) use reference::camera_rows;
pub(crate) use reference::{CAMERA, Reference};
pub(crate) use sampling::{Tap, Texels};

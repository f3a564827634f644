//! Pixels in memory, and how they get there.

mod decode;
pub(crate) mod foreign;
mod image;
mod jpeg;
mod plan;
mod png;
mod refusal;
mod resize;
mod shape;
mod webp;

pub(crate) use decode::{decode, decode_grey, decode_labels, with_mask};
pub use decode::{decode_photo, photo_size, with_photo};
pub use image::{Image, Picture};
pub(crate) use plan::{Plan, exr_blocks, wrong_size};
pub(crate) use resize::{fitted, resize, resize_mask, scaling_bytes};
pub(crate) use shape::same_shape;

//! Where the next picture shows what this one does: dense optical flow without a network.
//!
//! From small pictures to large ones, patches are searched for in the other picture, the flow is spread over all pixels and made finer. It
//! is the same to the bit with any number of threads.
//!
//! Index coordinates, pixels; a flow vector is the place in the other picture minus the place in this one, x to the right, y down.
//!
//! # Source
//! Kroeger, Timofte, Dai and Van Gool, "Fast optical flow using dense inverse search", ECCV 2016.

mod check;
mod confidence;
mod dense;
mod field;
mod patches;
mod plane;
mod pyramid;
mod variational;

pub use check::is_occluded;
pub use dense::{DenseFlow, dense_flow};
pub use plane::Plane;

use scene_io::{BitMask, Flow, Image};

/// Opacity of a pixel that shows a surface, of 255.
const SURFACE: u8 = 128;

/// The flow from one photo to another of the same size, and back, with the pixels of which the other photo truly shows the same: see
/// [`is_occluded`]; where a photo is transparent it shows nothing.
///
/// # Panics
/// If the sizes differ.
#[must_use]
pub fn flow_both_ways(first: &Image, second: &Image) -> [Flow; 2] {
    let [a, b] = [first, second].map(Plane::grey);
    let (forward, backward) = (dense_flow(&a, &b), dense_flow(&b, &a));
    let surfaces = [first, second].map(surface);
    let [here, there] = [&surfaces[0], &surfaces[1]];
    [check::checked(&forward, &backward, [here, there]), check::checked(&backward, &forward, [there, here])]
}

/// The pixels that show a surface.
fn surface(image: &Image) -> BitMask {
    BitMask::from_fn(image.width, image.height, |column, row| {
        image.pixel(column, row).get(3).is_none_or(|alpha| *alpha >= SURFACE)
    })
}

#[cfg(test)]
pub(crate) mod tests;

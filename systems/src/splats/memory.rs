//! How much memory a training takes at most.

/// Arrays of a Gaussian's numbers: parameters, gradient, two moments; and what the old and the new cloud take while rows move.
const ARRAYS: usize = 4 + 2;
/// Bytes of a visible Gaussian: footprint, colour, record, keys and lists.
const SEEN: usize = 64 + 12 + 36 + 16 + 8;
/// Bytes of a pair of Gaussian and tile: entry, place, record; pairs of a Gaussian, of which there are more the larger the
/// picture, and rarely this many.
const PAIR: usize = 8 + 36;
const PAIRS: usize = 16;
/// Bytes of a pixel: planes and tiles, forwards and backwards, photo, loss.
const PIXEL: usize = 4 * (4 + 4 + 4 + 4) + 160;

/// Bytes of a training of at most `splats` Gaussians of so many numbers, with pictures of so many pixels and copies of photos.
pub(super) fn most(splats: usize, numbers: usize, [pixels, copies]: [usize; 2]) -> usize {
    splats * (4 * numbers * ARRAYS + SEEN + PAIR * PAIRS) + pixels * PIXEL + copies
}

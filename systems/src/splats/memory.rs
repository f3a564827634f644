//! How much memory a training takes at most.

/// Arrays of a Gaussian's numbers: parameters, gradient, two moments; a checkpoint's copy of all but the gradient while it is
/// written; the new cloud beside the old one while rows move, and what the allocator has not given back since.
const ARRAYS: usize = 4 + 3 + 2;
/// Bytes of a Gaussian that pictures see: footprint and colour, in chunks and in one piece; two keys, where its pairs begin.
const DRAWN: usize = 2 * (44 + 12) + 2 * 8 + 4;
/// Bytes of a visible Gaussian: drawn for training and for measuring, where it has colour and depth; its record and its pull.
const SEEN: usize = 2 * DRAWN + 16 + 36 + 12;
/// Bytes of a pair of Gaussian and tile: for training entry, place (a list that grows by doubling), record; for measuring the
/// first two. Pairs of a Gaussian, of which there are more the larger the picture, and rarely this many.
const PAIR: usize = 2 * (4 + 8) + 36;
const PAIRS: usize = 12;
/// Bytes of a pixel: planes and tiles, forwards and backwards, photo, loss.
const PIXEL: usize = 4 * (4 + 4 + 4 + 4) + 160;
/// Bytes of a pixel of a photo that is drawn onto a plane: its image there, with alpha and mask.
const COPY: usize = 4 + 1;
/// Bytes of a pixel of a picture through a lens: where it is on the canvas, and its ray; where it is in the photo; of each of the
/// canvas's pixels tiles, planes, layers.
const BENT: usize = 8 + 24 + 8 + 4 * (20 + 20 + 24);

/// What a training looks at.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pictures {
    /// Pixels of the largest one.
    pub(super) pixels: usize,
    /// Pixels of the largest one through a lens that bends light.
    pub(super) bent: usize,
    /// Pixels of all photos through such lenses.
    pub(super) copied: usize,
}

/// Bytes of a training of at most `splats` Gaussians of so many numbers.
pub(super) fn most(splats: usize, numbers: usize, pictures: Pictures) -> usize {
    let Pictures { pixels, bent, copied } = pictures;
    splats * (4 * numbers * ARRAYS + SEEN + PAIR * PAIRS) + pixels * PIXEL + bent * BENT + copied * COPY
}

//! How much memory a training takes at most.

use engine::data::Dataset;

/// Arrays of a Gaussian's parameters: themselves, gradient, two moments; a checkpoint's copy of all but the gradient while it is
/// written; the new cloud beside the old one while rows move, and what the allocator has not given back since.
const ARRAYS: usize = 4 + 3 + 2;
/// Bytes of a Gaussian that pictures show: projection and colour, in chunks and in one piece; two keys; where its pairs begin in each of
/// eight bands, in chunks and in one piece.
const DRAWN: usize = 2 * (64 + 12) + 2 * 8 + 2 * 8 * 4;
/// Bytes of a visible Gaussian: drawn for training and for measuring, where it has colour and depth; colour and features of training;
/// its projected gradient, its view-space gradient and their sums; the size of its 3D filter, and what that makes of it.
const SEEN: usize = 2 * DRAWN + 16 + 12 + 12 + 36 + 8 + 12 + 4 + 16;
/// Bytes of a pair of Gaussian and tile: for training entry, place (a list that grows by doubling), blocks, gradient; for measuring
/// the first three. Pairs of a Gaussian, of which there are more the larger the picture, and rarely this many.
const PAIR: usize = 2 * (4 + 8 + 2) + 36;
const PAIRS: usize = 12;
/// Bytes of a pixel: planes and tiles, forwards and backwards, photo, loss.
const PIXEL: usize = 4 * (4 + 4 + 4 + 4) + 160;
/// Bytes of a pixel of a photo that is drawn onto a plane: its image there, with alpha and mask.
const COPY: usize = 4 + 1;
/// Bytes of a pixel of a picture through a lens: where it is on the canvas, and its ray; where it is in the photo; of each of the
/// canvas's pixels tiles, planes, layers.
const BENT: usize = 8 + 24 + 8 + 4 * (20 + 20 + 24);

/// What a training reads.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pictures {
    /// Pixels of the largest one.
    pub(super) pixels: usize,
    /// Pixels of the largest one through a lens that bends light.
    pub(super) bent: usize,
    /// Pixels of the copies of photos through such lenses that are kept.
    pub(super) copied: usize,
}

impl Pictures {
    /// Those of a dataset.
    pub(super) fn of(data: &Dataset) -> Self {
        let mut pictures = Self::default();
        for camera in data.views().iter().map(|v| &v.camera) {
            let pixels = camera.width as usize * camera.height as usize;
            pictures.pixels = pictures.pixels.max(pixels);
            if !camera.lens.is_pinhole() {
                pictures.bent = pictures.bent.max(pixels);
                pictures.copied += pixels;
            }
        }
        if !keeps_copies(data) {
            pictures.copied = pictures.bent;
        }
        pictures
    }

    /// Bytes that colours before the appearance take besides: planes and tiles, forwards and backwards.
    pub(super) fn toned_bytes(self) -> usize {
        self.pixels * 4 * 12
    }

    /// Bytes that they take.
    pub(super) fn bytes(self) -> usize {
        self.pixels * PIXEL + self.bent * BENT + self.copied * COPY
    }
}

/// Bytes of Gaussians in an appearance, besides [`of_gaussians`]: three features more of each pair of Gaussian and tile, and of each
/// Gaussian that is seen; colours before and after, and gradients of both; what a network sees of it, forwards and backwards, and its
/// gradient, one for each [`CHUNK`] of Gaussians, `learnt` numbers at most.
pub(super) fn toned(gaussians: usize, learnt: usize) -> usize {
    const NETWORK: usize = 2 * 4 * 64;
    gaussians * (12 * PAIRS + 8 * 12 + NETWORK) + gaussians.div_ceil(CHUNK) * 4 * learnt
}

/// Gaussians of a network's task.
pub(super) const CHUNK: usize = 1024;

/// Whether all copies of photos that are drawn onto a plane are kept: in the memory that decoded photos leave free.
pub(super) fn keeps_copies(data: &Dataset) -> bool {
    let bent = data.views().iter().map(|v| &v.camera).filter(|camera| !camera.lens.is_pinhole());
    let pixels = bent.map(|camera| u64::from(camera.width) * u64::from(camera.height)).fold(0, u64::saturating_add);
    pixels.saturating_mul(COPY as u64) <= data.spare_bytes()
}

/// Bytes of `gaussians` Gaussians of `parameters` numbers each, while they are trained.
pub(super) fn of_gaussians(gaussians: usize, parameters: usize) -> usize {
    gaussians * (4 * parameters * ARRAYS + SEEN + PAIR * PAIRS)
}

//! Errors of pixels, how they are distributed over the last photos, and which of them are small.
//!
//! ```text
//! e(r) = mean over channels of |render - photo|
//! H <- 0.95 H + h                                    h: counts of a photo's errors in 10 000 bins over 0 to 1
//! t_q: the end of the first bin up to which H has a share q of all
//! inlier(q) = 1 where e < t_q, or most of the 3 x 3 pixels around have e < t_q, else 0
//! ```
//!
//! # Source
//! Sabour et al., "SpotLessSplats: Ignoring Distractors in 3D Gaussian Splatting", 2024, sections 4.1 and 4.2.4; the vote of 3 x 3 pixels:
//! Sabour et al., "RobustNeRF: Ignoring Distractors with Robust Losses", 2023.

use crate::views::Beside;
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, take_numbers};

const BINS: usize = 10_000;
/// What is left of earlier counts after a photo.
const KEPT: f32 = 0.95;
const CHANNELS: usize = 3;
/// Name in checkpoints.
const NAME: &str = "masks.errors";

/// Errors of a picture's pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Errors {
    /// Columns and rows.
    pub(super) size: [usize; 2],
    /// `[rows][columns]`.
    pub(super) values: Vec<f32>,
}

impl Errors {
    /// Of a photo and its render.
    pub(super) fn of(beside: &Beside<'_>) -> Self {
        let pixels = beside.size[0] * beside.size[1];
        let mut values = vec![0.0; pixels];
        let planes = beside.render.chunks_exact(pixels.max(1)).zip(beside.photo.chunks_exact(pixels.max(1)));
        for (render, photo) in planes.take(CHANNELS) {
            for (error, (x, y)) in values.iter_mut().zip(render.iter().zip(photo)) {
                *error += (x - y).abs() / CHANNELS as f32;
            }
        }
        Self { size: beside.size, values }
    }

    /// Whether each pixel has an error below `limit`, or most of the pixels around it that there are, itself among them.
    pub(super) fn inliers(&self, limit: f32) -> Vec<bool> {
        let [width, height] = self.size;
        let near = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
        let mut out = Vec::with_capacity(self.values.len());
        for y in 0..height {
            for x in 0..width {
                let below = |x: usize, y: usize| self.values[y * width + x] < limit;
                out.push(
                    below(x, y) || {
                        let votes =
                            near(y, height).map(|y| near(x, width).filter(|x| below(*x, y)).count()).sum::<usize>();
                        2 * votes > near(x, width).len() * near(y, height).len()
                    },
                );
            }
        }
        out
    }
}

/// How errors are distributed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ErrorHistogram {
    bins: Vec<f32>,
}

impl Default for ErrorHistogram {
    /// Nothing is known.
    fn default() -> Self {
        Self { bins: vec![0.0; BINS] }
    }
}

impl ErrorHistogram {
    /// The counts of a picture's errors, those of pixels that did not count `before` left out, and those that are not finite.
    pub(super) fn counts(errors: &Errors, before: Option<&[f32]>) -> Vec<u32> {
        let mut counts = vec![0; BINS];
        for (i, error) in errors.values.iter().enumerate() {
            let counts_itself = before.and_then(|before| before.get(i)).is_none_or(|weight| *weight > 0.0);
            if counts_itself && error.is_finite() {
                counts[((error * BINS as f32) as usize).min(BINS - 1)] += 1;
            }
        }
        counts
    }

    /// See [`counts`](Self::counts) of a picture.
    pub(super) fn add(&mut self, counts: &[u32]) {
        self.bins.iter_mut().zip(counts).for_each(|(bin, count)| *bin = KEPT * *bin + *count as f32);
    }

    /// The error that a `share` of them is below; without any, infinity: all are.
    pub(super) fn quantile(&self, share: f32) -> f32 {
        let all: f64 = self.bins.iter().map(|bin| f64::from(*bin)).sum();
        if all <= 0.0 {
            return f32::INFINITY;
        }
        let mut below = 0.0;
        let last = self.bins.iter().position(|bin| {
            below += f64::from(*bin);
            below >= f64::from(share) * all && *bin > 0.0
        });
        (last.unwrap_or(BINS - 1) + 1) as f32 / BINS as f32
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor(NAME, &self.bins));
    }

    /// # Errors
    /// [`SystemError::State`] where the array is missing, of another length, or counts less than nothing.
    pub(super) fn take(state: &TensorMap) -> Result<Self, SystemError> {
        let bins = take_numbers(state, NAME, BINS)?;
        if bins.iter().all(|bin| *bin >= 0.0 && bin.is_finite()) {
            return Ok(Self { bins });
        }
        Err(SystemError::State { name: NAME.into(), problem: "counts less than nothing".into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use float_core::rng::Rng;

    fn errors(size: [usize; 2], stream: u64) -> Errors {
        let rng = Rng::new(7, stream);
        // Most are small.
        Errors { size, values: (0..(size[0] * size[1]) as u64).map(|i| rng.uniform_at(i).powi(3)).collect() }
    }

    #[test]
    fn quantiles_are_those_of_a_sort_in_which_older_photos_count_less() {
        let photos: Vec<Errors> = (0..4).map(|k| errors([31, 17 + k], k as u64)).collect();
        let mut histogram = ErrorHistogram::default();
        let mut sorted = Vec::new();
        for (k, photo) in photos.iter().enumerate() {
            histogram.add(&ErrorHistogram::counts(photo, None));
            let weight = f64::from(KEPT).powi((photos.len() - 1 - k) as i32);
            sorted.extend(photo.values.iter().map(|e| (*e, weight)));
        }
        sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all: f64 = sorted.iter().map(|(_, weight)| weight).sum();
        for share in [0.01_f32, 0.5, 0.7, 0.9, 1.0] {
            let mut below = 0.0;
            let at = sorted.iter().find(|(_, weight)| {
                below += weight;
                below >= f64::from(share) * all * (1.0 - 1e-6)
            });
            let (got, want) = (histogram.quantile(share), at.unwrap().0);
            assert!(got >= want - 1e-6 && got <= want + 1.1 / BINS as f32, "{share}: {got} {want}");
        }
    }

    #[test]
    fn all_pixels_are_inliers_where_nothing_is_known() {
        let photo = errors([9, 5], 1);
        let histogram = ErrorHistogram::default();
        assert_eq!(histogram.quantile(0.5), f32::INFINITY);
        assert!(photo.inliers(histogram.quantile(0.5)).iter().all(|inlier| *inlier));
        assert!(photo.inliers(0.0).iter().all(|inlier| !inlier));
    }

    #[test]
    fn votes_are_those_of_the_definition() {
        for (size, limit) in [([12, 9], 0.1), ([12, 9], 0.5), ([1, 7], 0.3), ([5, 1], 0.3), ([1, 1], 0.9)] {
            let photo = errors(size, 3);
            let inliers = photo.inliers(limit);
            for (i, inlier) in inliers.iter().enumerate() {
                let (x, y) = ((i % size[0]) as i64, (i / size[0]) as i64);
                let (mut votes, mut of) = (0, 0);
                for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                    let (x, y) = (x + dx, y + dy);
                    if (0..size[0] as i64).contains(&x) && (0..size[1] as i64).contains(&y) {
                        of += 1;
                        votes += i32::from(photo.values[y as usize * size[0] + x as usize] < limit);
                    }
                }
                assert_eq!(*inlier, photo.values[i] < limit || 2 * votes > of, "{size:?} {i}");
            }
        }
        assert!(Errors::default().inliers(0.5).is_empty());
    }

    #[test]
    fn pixels_that_do_not_count_or_are_not_finite_say_nothing() {
        let photo = Errors { size: [4, 1], values: vec![0.25, f32::NAN, 5.0, 0.75] };
        let counts = ErrorHistogram::counts(&photo, Some(&[1.0, 1.0, 1.0, 0.0]));
        assert_eq!((counts.iter().sum::<u32>(), counts[2500], counts[BINS - 1]), (2, 1, 1));
        assert_eq!(photo.inliers(f32::INFINITY), [true, true, true, true]);
        assert_eq!(photo.inliers(0.5), [true, false, false, false]);
    }

    #[test]
    fn a_state_comes_back_or_is_refused() {
        let mut histogram = ErrorHistogram::default();
        histogram.add(&ErrorHistogram::counts(&errors([8, 8], 2), None));
        let state = |bins: &[f32]| {
            let tensor = f32_tensor(NAME, bins).into_owned();
            TensorMap::from_iter([(tensor.name.clone(), tensor)])
        };
        assert_eq!(ErrorHistogram::take(&state(&histogram.bins)).unwrap(), histogram);
        for bad in [vec![0.0; 3], vec![-1.0; BINS], vec![f32::NAN; BINS]] {
            assert!(ErrorHistogram::take(&state(&bad)).is_err());
        }
        assert!(ErrorHistogram::take(&TensorMap::default()).is_err());
    }
}

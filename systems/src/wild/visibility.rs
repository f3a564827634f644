//! Which pixels of a photo show what is not part of the scene: a small network over the photo's plane with a code for each
//! photo (Ha-NeRF, section 3.3).
//!
//! `m`, 0 to 1, says how far a pixel is left out. A pixel costs `(1 - m) e^2 + 2 lambda m^2` with `e^2` its squared error, the
//! mean over channels: twice what [`losses::visibility`] says, so that a pixel which counts costs what it does elsewhere.

use super::codes::CodeTable;
use super::config::WildConfig;
use super::net::Net;
use crate::method::{Outcome, ViewSeen};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::mlp::{Mlp, MlpConfig};
use field_core::rng::Rng;
use float_core::Simd;
use losses::visibility::SizeSchedule;
use std::ops::Range;

/// Stream of the initial parameters.
const INIT: u64 = 0x0076_6973_6962_6c65;

/// The network, what it sees, and the map of a batch.
pub(super) struct Visibility {
    input: Input,
    net: Net,
    schedule: SizeSchedule,
    lr: f64,
    code_lr: f64,
    /// Weight of the size of the map in this step.
    lambda: f32,
    /// `[pixels of the batch]`
    m: Vec<f32>,
}

/// What the network sees of a pixel: the code of its photo, and where in the photo it is.
struct Input {
    codes: CodeTable,
    octaves: Frequency,
    simd: Simd,
}

impl Input {
    /// `[code, place, octaves of it][pixels]` for pixels whose photo and place are `of(i)`.
    fn fill(&self, of: impl Fn(usize) -> (usize, [f32; 2]), pixels: Range<usize>, x: &mut [f32]) {
        let (n, codes) = (pixels.len(), self.codes.codes());
        let (rows, octaves) = x.split_at_mut(codes.dims * n);
        let mut places = vec![0.0; 2 * n];
        for (j, i) in pixels.enumerate() {
            let (view, place) = of(i);
            for (k, &value) in codes.of(view).iter().enumerate() {
                rows[k * n + j] = value;
            }
            [places[j], places[n + j]] = place;
        }
        self.octaves.encode(self.simd, &places, None, octaves).expect("two rows in, theirs out");
    }
}

fn logistic(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

impl Visibility {
    /// # Errors
    /// [`SystemError::Config`] for a network without size.
    pub(super) fn new(config: &WildConfig, data: &Dataset, seed: u64) -> Result<Self, SystemError> {
        Self::of_views(config, data.len(), seed)
    }

    fn of_views(config: &WildConfig, views: usize, seed: u64) -> Result<Self, SystemError> {
        let bad =
            |field, value: usize, problem: String| SystemError::Config { field, value: value.to_string(), problem };
        let octaves = Frequency::new(2, config.visibility_octaves, Base::One, Identity::Include)
            .map_err(|e| bad("visibility_octaves", config.visibility_octaves, e.to_string()))?;
        let mlp = Mlp::new(&MlpConfig::new(
            config.visibility_dims + octaves.out_rows(),
            vec![config.visibility_width; config.visibility_depth],
            1,
        ))
        .map_err(|e| bad("visibility_width", config.visibility_width, e.to_string()))?;
        let (start, floor) = (f64::from(config.mask_size_start), f64::from(config.mask_size));
        // The floor is met where the exponential is.
        let rate = if start > floor { (start / floor).ln() / config.mask_size_steps.max(1) as f64 } else { 0.0 };
        Ok(Self {
            input: Input {
                codes: CodeTable::new("visibility", views, config.visibility_dims, seed),
                octaves,
                simd: Simd::best(),
            },
            net: Net::new("visibility_net", mlp, Rng::new(seed, INIT)),
            schedule: SizeSchedule { start, rate, floor },
            lr: f64::from(config.visibility_lr),
            code_lr: f64::from(config.visibility_code_lr),
            lambda: config.mask_size_start,
            m: Vec::new(),
        })
    }

    /// The map of a batch.
    pub(super) fn begin(&mut self, batch: &Batch, step: u64) {
        self.lambda = self.schedule.at(step) as f32;
        let Self { input, net, m, .. } = self;
        m.clear();
        let of = |i: usize| (batch.view[i] as usize, batch.place[i]);
        let fill = |pixels: Range<usize>, x: &mut [f32]| input.fill(of, pixels, x);
        net.forward(input.simd, batch.len(), fill, |_, y| m.extend(y.iter().map(|&y| logistic(y))));
    }

    /// How much pixel `i` of the batch counts, and what leaving it out costs.
    pub(super) fn weight(&self, i: usize) -> (f32, f32) {
        let m = self.m[i];
        (1.0 - m, 2.0 * self.lambda * m * m)
    }

    /// Returns the count of non-finite gradients.
    pub(super) fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let (dims, batch) = (self.input.codes.codes().dims, outcome.batch);
        let mut code_bar = vec![0.0; batch.len() * dims];
        let Self { net, m, lambda, .. } = self;
        let bar = |i: usize| {
            let e2: f32 = (0..3).map(|c| (outcome.pixels[i].rgb[c] - outcome.truth[i][c]).powi(2)).sum::<f32>() / 3.0;
            let m_bar = outcome.share * batch.weight[i] * (4.0 * *lambda * m[i] - e2);
            m_bar * m[i] * (1.0 - m[i])
        };
        net.backward(
            outcome.simd,
            |pixels, y_bar| y_bar.iter_mut().zip(pixels).for_each(|(y_bar, i)| *y_bar = bar(i)),
            |pixels, x_bar| {
                let n = pixels.len();
                for (j, bars) in code_bar[pixels.start * dims..pixels.end * dims].chunks_exact_mut(dims).enumerate() {
                    bars.iter_mut().enumerate().for_each(|(k, bar)| *bar = x_bar[k * n + j]);
                }
            },
        );
        net.step(outcome.simd, outcome.lr * self.lr)
            + self.input.codes.learn(outcome.simd, outcome.lr * self.code_lr, batch, &code_bar, 0.0)
    }

    /// The map of a whole photo, row by row.
    pub(super) fn of_view(&self, seen: &ViewSeen<'_>) -> Vec<f32> {
        let [width, height] = seen.size;
        let at = |n: usize, size: usize| (n as f32 + 0.5) / size as f32;
        let of = |i: usize| (seen.view, [at(i % width, width), at(i / width, height)]);
        let fill = |pixels: Range<usize>, x: &mut [f32]| self.input.fill(of, pixels, x);
        let mut m = self.net.infer(self.input.simd, width * height, fill);
        m.iter_mut().for_each(|m| *m = logistic(*m));
        m
    }

    pub(super) fn len(&self) -> usize {
        self.input.codes.len() + self.net.params.len()
    }

    pub(super) fn bytes(&self) -> usize {
        self.input.codes.bytes() + self.net.bytes() + 4 * self.m.capacity()
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.input.codes.push_state(out);
        self.net.push_state(out);
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.input.codes.load_state(state)?;
        self.net.load_state(state)
    }
}

#[cfg(test)]
mod tests {
    use super::super::config::{AppearanceKind, FieldKind, OccluderKind};
    use super::*;
    use crate::method::Pixel;
    use glam::DVec3;
    use losses::visibility::{best_map, masked, masked_backward, size, size_backward};
    use render_core::ray::Ray;

    fn config() -> WildConfig {
        WildConfig::new(FieldKind::Ngp, AppearanceKind::None, OccluderKind::Visibility)
    }

    /// Pixels of views 0, 1, 0, 1 …, all over their photos.
    fn batch(n: usize, rgb: f32) -> Batch {
        let rays = vec![Ray { o: DVec3::ONE * f64::from(rgb), d: DVec3::Z }; n];
        let mut batch = Batch::of_rays(&rays, &vec![[rgb; 3]; n]);
        for i in 0..n {
            batch.view[i] = i as u32 % 2;
            batch.place[i] = [(i / 2 % 8) as f32 / 8.0 + 0.0625, (i / 16 % 8) as f32 / 8.0 + 0.0625];
        }
        batch
    }

    fn outcome<'a>(batch: &'a Batch, pixels: &'a [Pixel], truth: &'a [[f32; 3]]) -> Outcome<'a> {
        Outcome {
            step: 0,
            lr: 1e-2,
            simd: Simd::best(),
            batch,
            share: 1.0 / batch.len() as f32,
            pixels,
            truth,
            appearance_bar: &[],
            transient_bar: &[],
        }
    }

    #[test]
    fn the_map_depends_on_photo_and_place_alone() {
        let mut visibility = Visibility::of_views(&config(), 2, 5).unwrap();
        visibility.begin(&batch(128, 0.2), 0);
        let first = visibility.m.clone();
        // Other rays, other colours, another step, another order.
        let mut other = batch(128, 0.9);
        other.view.reverse();
        other.place.reverse();
        visibility.begin(&other, 700);
        assert!(visibility.m.iter().rev().eq(&first));
        assert!(first[0] != first[1] && first[0] != first[2], "neither photo nor place matter");
        // And the same once more as a picture.
        let seen = ViewSeen { view: 1, size: [8, 8], stride: 1, pixels: &[], truth: &[], alpha: &[], place: &[] };
        for (i, m) in visibility.of_view(&seen).into_iter().enumerate() {
            assert!((m - first[2 * i + 1]).abs() < 1e-6, "pixel {i}: {m} {}", first[2 * i + 1]);
        }
    }

    #[test]
    fn descent_meets_the_closed_form() {
        let mut config = config();
        config.mask_size_start = config.mask_size;
        let lambda = f64::from(config.mask_size);
        let mut visibility = Visibility::of_views(&config, 2, 5).unwrap();
        let batch = batch(128, 0.0);
        // Photo 0 fits on the left half and half-way on the right; photo 1 does not fit on the right.
        let e2 = |i: usize| match (batch.view[i], batch.place[i][0] < 0.5) {
            (_, true) => 0.0,
            (0, false) => 2.0 * config.mask_size,
            _ => 40.0 * config.mask_size,
        };
        let pixels: Vec<Pixel> = (0..128).map(|i| Pixel { rgb: [e2(i).sqrt(); 3], ..Pixel::default() }).collect();
        for step in 0..1500 {
            visibility.begin(&batch, step);
            assert_eq!(visibility.learn(&outcome(&batch, &pixels, &batch.rgb)), 0);
        }
        visibility.begin(&batch, 1500);
        for i in 0..128 {
            let (m, best) = (visibility.m[i], best_map(f64::from(e2(i)), lambda) as f32);
            assert!((m - best).abs() < 0.1, "pixel {i}: {m}, best {best}");
        }
    }

    #[test]
    fn the_loss_of_a_pixel_is_twice_the_released_one() {
        let mut visibility = Visibility::of_views(&config(), 2, 5).unwrap();
        visibility.begin(&batch(64, 0.0), 100);
        let (lambda, m) = (f64::from(visibility.lambda), visibility.m.clone());
        assert!((lambda - 0.05 * (0.12_f64).powf(0.2)).abs() < 1e-6, "{lambda}");
        let e2: Vec<f32> = (0..64).map(|i| 0.001 * i as f32).collect();
        let sum: f32 = (0..64).map(|i| visibility.weight(i)).zip(&e2).map(|((w, size), e2)| w * e2 + size).sum();
        let released = masked(&m, &e2).unwrap() + lambda * size(&m);
        assert!((f64::from(sum) / 64.0 - 2.0 * released).abs() < 1e-6);
        // And its derivative, which the photos' codes and the network learn from.
        let (mut m_bar, mut e2_bar) = (vec![0.0; 64], vec![0.0; 64]);
        masked_backward(&m, &e2, 2.0, Some(&mut m_bar), &mut e2_bar).unwrap();
        size_backward(&m, 2.0 * lambda, &mut m_bar).unwrap();
        for i in 0..64 {
            let own = (4.0 * visibility.lambda * m[i] - e2[i]) / 64.0;
            assert!((own - m_bar[i]).abs() < 1e-7);
            assert!((e2_bar[i] - visibility.weight(i).0 / 64.0).abs() < 1e-7);
        }
    }

    #[test]
    fn pixels_that_do_not_count_teach_nothing() {
        let mut visibility = Visibility::of_views(&config(), 2, 5).unwrap();
        let mut batch = batch(64, 0.0);
        batch.weight.fill(0.0);
        visibility.begin(&batch, 0);
        let before = visibility.net.params.clone();
        let pixels = vec![Pixel { rgb: [1.0; 3], ..Pixel::default() }; 64];
        visibility.learn(&outcome(&batch, &pixels, &batch.rgb));
        assert_eq!(visibility.net.params, before);
    }
}

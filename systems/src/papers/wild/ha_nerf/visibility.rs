//! The map, the price of leaving pixels out, and the loss with both.

use super::config::VisibilityConfig;
use super::visibility_map::VisibilityMap;
use crate::occluders::OccluderModel;
use crate::occluders::pixel_error::kernel_loss;
use crate::photo_model::{Outcome, PhotoAndRender, Pixel, PixelBar};
use engine::data::Batch;
use engine::system::{SystemError, Tensor, TensorMap};
use losses::kernel::Kernel;
use losses::visibility::SizeSchedule;

/// The map, and the loss with it.
pub(super) struct Visibility {
    map: VisibilityMap,
    /// The price of leaving pixels out, and that of this step.
    schedule: SizeSchedule,
    lambda: f32,
    /// Of the scene's errors.
    kernel: Kernel,
    /// `[pixels of the batch]`
    m: Vec<f32>,
}

impl Visibility {
    pub(super) fn new(
        settings: &VisibilityConfig,
        kernel: Kernel,
        views: usize,
        seed: u64,
    ) -> Result<Self, SystemError> {
        Ok(Self {
            map: VisibilityMap::new(settings, views, seed)?,
            schedule: settings.schedule(),
            lambda: settings.mask_size_start,
            kernel,
            m: Vec::new(),
        })
    }

    /// `1 - m` and `2 lambda m^2` of pixel `i` of the batch.
    fn weight_and_size(&self, i: usize) -> (f32, f32) {
        let m = self.m[i];
        (1.0 - m, 2.0 * self.lambda * m * m)
    }
}

/// The derivative of `(1 - m) e2 + 2 lambda m^2` with respect to `m`.
fn map_bar(m: f32, e2: f32, lambda: f32) -> f32 {
    4.0 * lambda * m - e2
}

impl OccluderModel for Visibility {
    fn begin(&mut self, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        self.lambda = self.schedule.at(step) as f32;
        self.map.forward(batch, &mut self.m);
        Ok(())
    }

    /// `(1 - m) |C - Y|^2 + 2 lambda m^2`, the square for the scene as `kernel` has it.
    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        let (weight, size) = self.weight_and_size(i);
        let (loss, bar) = kernel_loss(self.kernel, pixel.rgb, truth, weight);
        (loss + size, bar)
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        let (weight, _) = self.weight_and_size(i);
        let (loss, bar) = kernel_loss(self.kernel, rgb, truth, weight);
        (loss, bar.rgb)
    }

    /// The network learns from the square.
    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let m = std::mem::take(&mut self.m);
        let lambda = self.lambda;
        let bad = self.map.learn(outcome, &m, |i| {
            let e2 = (0..3).map(|c| (outcome.pixels[i].rgb[c] - outcome.truth[i][c]).powi(2)).sum::<f32>() / 3.0;
            outcome.share * outcome.batch.weight[i] * map_bar(m[i], e2, lambda)
        });
        self.m = m;
        bad
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        let mut out = self.map.of_view(seen);
        out.iter_mut().for_each(|m| *m = if *m < 0.5 { 1.0 } else { 0.0 });
        Some(out)
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.map.push_state(out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.map.load_state(state)
    }

    fn parameter_count(&self) -> usize {
        self.map.parameter_count()
    }

    fn memory_bytes(&self) -> usize {
        self.map.memory_bytes() + 4 * self.m.capacity()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::nerf_w::CHARBONNIER;
    use super::*;
    use float_core::Simd;
    use glam::DVec3;
    use losses::visibility::{best_map, masked, masked_backward, size, size_backward};
    use render_core::ray::Ray;

    fn visibility(settings: &VisibilityConfig) -> Visibility {
        Visibility::new(settings, CHARBONNIER.kernel(), 2, 5).unwrap()
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
        let mut visibility = visibility(&VisibilityConfig::HASH_GRID);
        visibility.begin(&mut batch(128, 0.2), 0).unwrap();
        let first = visibility.m.clone();
        // Other rays, other colours, another step, another order.
        let mut other = batch(128, 0.9);
        other.view.reverse();
        other.place.reverse();
        visibility.begin(&mut other, 700).unwrap();
        assert!(visibility.m.iter().rev().eq(&first));
        assert!(first[0] != first[1] && first[0] != first[2], "neither photo nor place matter");
        // The same as a picture.
        let seen = PhotoAndRender { view: 1, size: [8, 8], stride: 1, pixels: &[], truth: &[], alpha: &[], place: &[] };
        for (i, m) in visibility.map.of_view(&seen).into_iter().enumerate() {
            assert!((m - first[2 * i + 1]).abs() < 1e-6, "pixel {i}: {m} {}", first[2 * i + 1]);
        }
    }

    #[test]
    fn descent_meets_the_closed_form() {
        let mask_size = VisibilityConfig::HASH_GRID.mask_size;
        let lambda = f64::from(mask_size);
        let mut visibility =
            visibility(&VisibilityConfig { mask_size_start: mask_size, ..VisibilityConfig::HASH_GRID });
        let mut batch = batch(128, 0.0);
        // Photo 0 fits on the left half and half-way on the right; photo 1 does not fit on the right.
        let squares: Vec<f32> = (0..128)
            .map(|i| match (batch.view[i], batch.place[i][0] < 0.5) {
                (_, true) => 0.0,
                (0, false) => 2.0 * mask_size,
                _ => 40.0 * mask_size,
            })
            .collect();
        let pixels: Vec<Pixel> = squares.iter().map(|e2| Pixel { rgb: [e2.sqrt(); 3], ..Pixel::default() }).collect();
        for step in 0..1500 {
            visibility.begin(&mut batch, step).unwrap();
            assert_eq!(visibility.learn(&outcome(&batch, &pixels, &batch.rgb)), 0);
        }
        visibility.begin(&mut batch, 1500).unwrap();
        for (i, (&m, &e2)) in visibility.m.iter().zip(&squares).enumerate() {
            let best = best_map(f64::from(e2), lambda) as f32;
            assert!((m - best).abs() < 0.1, "pixel {i}: {m}, best {best}");
        }
    }

    #[test]
    fn the_loss_of_a_pixel_is_twice_the_released_one() {
        let mut visibility = visibility(&VisibilityConfig::HASH_GRID);
        visibility.begin(&mut batch(64, 0.0), 100).unwrap();
        let (lambda, m) = (f64::from(visibility.lambda), visibility.m.clone());
        assert!((lambda - 0.05 * (0.12_f64).powf(0.2)).abs() < 1e-6, "{lambda}");
        let e2: Vec<f32> = (0..64).map(|i| 0.001 * i as f32).collect();
        let loss = |i: usize, e2: f32| {
            let (weight, size) = visibility.weight_and_size(i);
            weight * e2 + size
        };
        let sum: f32 = e2.iter().enumerate().map(|(i, &e2)| loss(i, e2)).sum();
        let released = masked(&m, &e2).unwrap() + lambda * size(&m);
        assert!((f64::from(sum) / 64.0 - 2.0 * released).abs() < 1e-6);
        // And its derivative, which the photos' codes and the network learn from.
        let (mut m_bar, mut e2_bar) = (vec![0.0; 64], vec![0.0; 64]);
        masked_backward(&m, &e2, 2.0, Some(&mut m_bar), &mut e2_bar).unwrap();
        size_backward(&m, 2.0 * lambda, &mut m_bar).unwrap();
        for i in 0..64 {
            let own = map_bar(m[i], e2[i], visibility.lambda) / 64.0;
            assert!((own - m_bar[i]).abs() < 1e-7);
            assert!((e2_bar[i] - visibility.weight_and_size(i).0 / 64.0).abs() < 1e-7);
        }
    }

    #[test]
    fn pixels_that_do_not_count_teach_nothing() {
        let mut visibility = visibility(&VisibilityConfig::HASH_GRID);
        let mut batch = batch(64, 0.0);
        batch.weight.fill(0.0);
        visibility.begin(&mut batch, 0).unwrap();
        let before = visibility.map.network.params.clone();
        let pixels = vec![Pixel { rgb: [1.0; 3], ..Pixel::default() }; 64];
        visibility.learn(&outcome(&batch, &pixels, &batch.rgb));
        assert_eq!(visibility.map.network.params, before);
    }
}

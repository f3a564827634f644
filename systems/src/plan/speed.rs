//! How fast this machine is: schedules of runs that stop after seconds are of as many steps as it makes in them.

use field_core::rng::Rng;
use float_core::Simd;
use losses::dssim::{Dssim, Pair, Target};
use optim::{Adam, AdamConfig};
use splat_core::{Cloud, Gaussians, GradientOptions, Gradients, RasterSettings, Renderer, View};
use std::time::Instant;

/// Seconds of a [`Step`] on the two cores that the seconds in [`pace`](super::pace) are of.
const ON_TWO_CORES: f64 = 0.012;
/// Steps whose time is not taken, and seconds of those whose time is.
const WARM_UP: usize = 3;
const SECONDS: f64 = 0.6;
/// Factors beyond these are errors of a clock.
const FACTORS: [f64; 2] = [1.0 / 64.0, 64.0];
/// What is drawn: rows and columns, and Gaussians in a cube in front of the camera.
const SIDE: usize = 256;
const GAUSSIANS: usize = 20_000;
const DEGREE: usize = 3;

/// How fast this machine is now, with the threads of this process: 1 like the one that schedules are planned for, 2 for twice as many
/// steps in a second. Takes some tenths of a second.
#[must_use]
pub fn machine_speed() -> f64 {
    let mut step = Step::new();
    (0..WARM_UP).for_each(|_| step.make());
    let clock = Instant::now();
    let mut steps = 0.0;
    // The mean: what takes the cores away from this program will do so later, too.
    while clock.elapsed().as_secs_f64() < SECONDS {
        step.make();
        steps += 1.0;
    }
    (ON_TWO_CORES * steps / clock.elapsed().as_secs_f64()).clamp(FACTORS[0], FACTORS[1])
}

/// A step of a made-up cloud: drawn, compared with grey, differentiated, every parameter moved.
struct Step {
    simd: Simd,
    cloud: Gaussians,
    view: View,
    renderer: Renderer<3>,
    gradients: Gradients,
    loss: Dssim,
    adam: Vec<Adam>,
    grey: Vec<f32>,
    bar: Vec<f32>,
}

impl Step {
    fn new() -> Self {
        let (simd, pixels) = (Simd::best(), SIDE * SIDE);
        let cloud = cloud();
        let side = SIDE as f32;
        Self {
            simd,
            view: View {
                r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                t: [0.0; 3],
                f: [side; 2],
                c: [0.5 * side; 2],
                size: [SIDE; 2],
            },
            renderer: Renderer::new(RasterSettings::DEFAULT),
            gradients: Gradients::default(),
            loss: Dssim::new(simd),
            adam: cloud.fields().iter().map(|(_, values)| Adam::new(values.len(), AdamConfig::DEFAULT)).collect(),
            grey: vec![0.5; 3 * pixels],
            bar: vec![0.0; 4 * pixels],
            cloud,
        }
    }

    fn make(&mut self) {
        let drawn = [Cloud::new(&self.cloud)];
        let mut picture = self.renderer.render(&drawn, &self.view).expect("a camera that sees");
        self.bar.fill(0.0);
        let (colour, _) = self.bar.split_at_mut(self.grey.len());
        let pair = Pair {
            channels: 3,
            height: SIDE,
            width: SIDE,
            x: &picture.planes()[..self.grey.len()],
            target: Target::Planes(&self.grey),
            weights: None,
        };
        self.loss.l1_dssim_backward(&pair, 0.2, 1.0, colour).expect("pictures of one size");
        picture.backward(&self.bar, GradientOptions::DEFAULT, &mut self.gradients).expect("as large");
        drop(picture);
        let gradient = &self.gradients.clouds[0].gaussians;
        let fields = self.cloud.fields_mut().into_iter().zip(gradient.fields());
        for (((_, values), (_, gradient)), adam) in fields.zip(&mut self.adam) {
            // Nothing is learnt: the next step is like this one.
            let _ = adam.step(self.simd, 0.0, values, gradient);
        }
    }
}

/// Gaussians in a cube in front of the camera, half as large as the way to the nearest three others, half opaque.
fn cloud() -> Gaussians {
    let (n, rng) = (GAUSSIANS, Rng::new(1, 0));
    let mut cloud = Gaussians::new(n, DEGREE).expect("a degree");
    let size = 0.5 * 0.7 * 2.0 / (n as f32).cbrt();
    for (i, x) in cloud.mean.iter_mut().enumerate() {
        *x = 2.0 * rng.uniform_at(i as u64) - 1.0 + if i >= 2 * n { 3.0 } else { 0.0 };
    }
    cloud.log_scale.fill(size.ln());
    cloud.logit.fill(0.0);
    rng.substream(1).fill_normal(0, &mut cloud.dc);
    cloud
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_made_up_step_draws_something_and_stays_as_it_is() {
        let mut step = Step::new();
        let before = step.cloud.clone();
        step.make();
        assert!(step.gradients.clouds[0].gaussians.dc.iter().filter(|g| **g != 0.0).count() > 3 * GAUSSIANS / 2);
        assert_eq!(step.cloud, before);
        assert!((FACTORS[0]..=FACTORS[1]).contains(&machine_speed()));
    }
}

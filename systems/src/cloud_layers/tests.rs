//! Pixels of two clouds against differences, and the step as the driver makes it.

use super::composite::{Composed, ComposedBar, FrontPixel, compose, pull_back};
use field_core::rng::Rng;
use testkit::gradient::central_difference;

/// Everything that a pixel depends on: colour, masks and transmittance of the front, colour behind.
fn pixel(x: &[f64]) -> (FrontPixel, [f32; 3]) {
    let at = |k: usize| x[k] as f32;
    let front = FrontPixel { colour: [at(0), at(1), at(2)], masks: [at(3), at(4), at(5)], transmittance: at(6) };
    (front, [at(7), at(8), at(9)])
}

/// The definition, in `f64`: the sum of what is composed, times `bar`.
fn twin(x: &[f64], bar: &ComposedBar, shades: bool) -> f64 {
    const LEAST: f64 = 1e-6;
    let share = (x[3] + LEAST) / (x[3] + x[4] + x[6] + 2.0 * LEAST);
    let bright = x[5] + 0.5 * x[6];
    let steep = if bright <= 0.75 { bright } else { 0.75 + 37.0 * (bright - 0.75) };
    let brightness = if shades { 0.5 + steep } else { 1.0 };
    let mut sum = f64::from(bar.share) * share + f64::from(bar.brightness) * brightness;
    for c in 0..3 {
        let own = x[c] / (1.0 - x[6] + 1e-4);
        let lit = brightness * x[7 + c];
        let colour = share * own + (1.0 - share) * lit.clamp(0.0, 1.0);
        sum += f64::from(bar.colour[c]) * colour + f64::from(bar.front[c]) * own + f64::from(bar.behind[c]) * lit;
    }
    sum
}

#[test]
fn a_pixel_and_its_gradient_are_those_of_the_definition() {
    let rng = Rng::new(4, 1);
    for case in 0..64 {
        let mut u = [0.0_f32; 24];
        rng.fill_uniform(24 * case, &mut u);
        // A front of some opacity, whose masks are parts of it.
        let opacity = 0.05 + 0.9 * u[0];
        let mut x: Vec<f64> = u[1..8].iter().map(|u| f64::from(opacity * u)).collect();
        x[6] = f64::from(1.0 - opacity);
        x.extend(u[8..11].iter().map(|u| f64::from(0.9 * u)));
        let bar = ComposedBar {
            colour: [u[11] - 0.5, u[12] - 0.5, u[13] - 0.5],
            front: [u[14] - 0.5, u[15] - 0.5, u[16] - 0.5],
            behind: [u[17] - 0.5, u[18] - 0.5, u[19] - 0.5],
            share: u[20] - 0.5,
            brightness: u[21] - 0.5,
        };
        for shades in [false, true] {
            let (front, behind) = pixel(&x);
            let seen = compose(&front, behind, shades);
            // Corners of the brightness and of what is clamped have no derivative.
            let near = |value: f32, corner: f32| (value - corner).abs() < 1e-2;
            if near(front.masks[2] + 0.5 * front.transmittance, 0.75) || seen.behind.iter().any(|&c| near(c, 1.0)) {
                continue;
            }
            let got = pull_back(&front, behind, shades, &seen, &bar);
            let got: Vec<f32> = got
                .front
                .colour
                .into_iter()
                .chain(got.front.masks)
                .collect::<Vec<_>>()
                .into_iter()
                .chain([got.front.transmittance])
                .chain(got.behind)
                .collect();
            let want = central_difference(&x, |x| twin(x, &bar, shades));
            for (k, (got, want)) in got.iter().zip(&want).enumerate() {
                assert!(
                    (f64::from(*got) - want).abs() < 2e-3 * (1.0 + want.abs()),
                    "{case} {shades} {k}: {got} {want}"
                );
            }
        }
    }
}

#[test]
fn where_nothing_is_in_front_all_is_behind() {
    let nothing = FrontPixel { transmittance: 1.0, ..FrontPixel::default() };
    let behind = [0.2, 0.5, 0.9];
    let seen = compose(&nothing, behind, true);
    assert!(seen.share < 1e-5 && seen.brightness == 1.0, "{seen:?}");
    assert!((0..3).all(|c| (seen.colour[c] - behind[c]).abs() < 1e-5), "{seen:?}");
    // An opaque front is all there is.
    let opaque = FrontPixel { colour: [0.3; 3], masks: [1.0, 0.0, 0.5], transmittance: 0.0 };
    let seen: Composed = compose(&opaque, behind, true);
    assert!(seen.share > 0.999 && (seen.colour[0] - 0.3).abs() < 1e-3, "{seen:?}");
}

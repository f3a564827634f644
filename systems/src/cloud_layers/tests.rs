//! Pixels of two clouds against differences, and the step as the driver makes it.

use super::composite::{Composed, ComposedBar, FrontPixel, compose, pull_back};
use super::{LayerSettings, MASK_ROWS, TwoLayers};
use crate::views::{CloudLayers, CloudParameters, DrawnCloud, LossParts, StepCamera, TargetPicture, ViewSpaceGradient};
use field_core::rng::Rng;
use float_core::Simd;
use splat_core::{Gaussians, RasterSettings, View};
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

pub(super) const SETTINGS: LayerSettings = LayerSettings {
    front_from: 0.1,
    front_first_stage: 0.0,
    front_at_camera: false,
    front_apart: false,
    front_shades: true,
    front_mask_lr: 0.05,
    front_structure: 0.2,
    front_each: 0.25,
    front_divergence: 0.1,
    front_entropy: 0.05,
    front_sparsity: 0.05,
    front_sparsity_start: 0.02,
    front_separation: 0.1,
    front_smoothness: 0.05,
    front_brightness: 0.2,
    front_brightness_photo: 0.05,
    front_anisotropy: 0.0,
    front_prune: 0.0,
};
const SIZE: [usize; 2] = [28, 24];
const HORIZON: u64 = 100;

/// Gaussians before a camera at the origin, about `z` away.
fn cloud(n: usize, z: f32, stream: u64, rows: usize) -> CloudParameters {
    let mut cloud = Gaussians::new(n, 1).unwrap();
    let rng = Rng::new(11, stream);
    for (k, (_, values)) in cloud.fields_mut().into_iter().enumerate() {
        let [middle, spread] = [[0.0, 0.5], [-1.6, 0.3], [0.3, 0.9], [1.0, 1.0], [0.1, 0.6], [0.0, 0.2]][k];
        let mut u = vec![0.0; values.len()];
        rng.substream(k as u64).fill_uniform(0, &mut u);
        values.iter_mut().zip(u).for_each(|(value, u)| *value = middle + spread * (2.0 * u - 1.0));
    }
    cloud.mean[2 * n..].iter_mut().for_each(|depth| *depth += z);
    let mut parameters = CloudParameters::new(cloud, rows);
    rng.substream(9).fill_uniform(0, &mut parameters.extra);
    parameters.extra.iter_mut().for_each(|x| *x -= 0.7);
    parameters
}

/// What a step says of two clouds.
struct Said {
    loss: f64,
    gradients: [CloudParameters; 2],
    /// Of each cloud, what the density control is given.
    uv: [Vec<[f32; 2]>; 2],
    /// What it needs of each Gaussian in front.
    uses: Vec<f32>,
}

fn step(settings: LayerSettings, clouds: &[CloudParameters; 2], step: u64) -> Said {
    step_from(&View::at_origin(SIZE), settings, clouds, step)
}

/// The same of a camera.
fn step_from(view: &View, settings: LayerSettings, clouds: &[CloudParameters; 2], step: u64) -> Said {
    let mut photo = vec![0.0; 3 * SIZE[0] * SIZE[1]];
    Rng::new(3, 3).fill_uniform(0, &mut photo);
    let mut pass = TwoLayers::new(settings, HORIZON).pass(Simd::best());
    let drawn = [0, 1].map(|index| DrawnCloud {
        index,
        gaussians: &clouds[index].gaussians,
        extra: &clouds[index].extra,
        composited: 0,
        degree: 1,
    });
    let camera = StepCamera { view, settings: &RasterSettings::DEFAULT, background: [0.3, 0.6, 0.2] };
    let target = TargetPicture { view: 0, colour: &photo, weights: None };
    let mut parts = LossParts {
        terms: &mut [],
        appearance: None,
        judge: None,
        judged: None,
        view_space: ViewSpaceGradient::Plain,
        step,
        camera: None,
        seconds: &mut [0.0; 6],
    };
    let mut gradients = clouds.clone();
    let loss = pass.run(&drawn, &camera, &target, &mut parts, &mut gradients).unwrap().loss;
    let uv = [0, 1].map(|index| pass.seen(index).uv.to_vec());
    Said { loss, gradients, uv, uses: pass.uses(1).to_vec() }
}

/// The fields of a cloud and its extra rows.
fn fields(cloud: &mut CloudParameters) -> Vec<&mut [f32]> {
    let CloudParameters { gaussians, extra, .. } = cloud;
    gaussians.fields_mut().into_iter().map(|(_, values)| values).chain([&mut extra[..]]).collect()
}

/// A way for one kind of a cloud's parameters: each by as much, to where the loss grows.
struct Uphill<'a> {
    index: usize,
    kind: usize,
    gradient: &'a [f32],
}

/// The central difference of a step's loss along a way.
fn difference(settings: LayerSettings, clouds: &[CloudParameters; 2], at: u64, way: &Uphill<'_>, h: f32) -> f64 {
    let moved = |h: f32| {
        let mut moved = clouds.clone();
        let values = fields(&mut moved[way.index]).remove(way.kind);
        values.iter_mut().zip(way.gradient).for_each(|(x, g)| *x += if *g < 0.0 { -h } else { h });
        step(settings, &moved, at).loss
    };
    (moved(h) - moved(-h)) / (2.0 * f64::from(h))
}

#[test]
fn the_gradient_of_a_step_is_that_of_differences_in_every_kind_of_parameter() {
    // The median over steps of several lengths: now and then a difference holds an edge at which a Gaussian is cut off, or a pixel that comes
    // to be of the other cloud, which no gradient knows.
    const STEPS: [f32; 5] = [1e-3, 6e-4, 3e-4, 2e-4, 1e-4];
    let clouds = [cloud(40, 3.0, 1, 0), cloud(12, 2.0, 2, MASK_ROWS)];
    let plain = LayerSettings { front_each: 0.0, front_shades: false, front_brightness_photo: 0.0, ..SETTINGS };
    let apart = LayerSettings { front_apart: true, ..SETTINGS };
    let round = LayerSettings { front_anisotropy: 0.1, ..SETTINGS };
    for (settings, at) in [(SETTINGS, 80), (round, 80), (SETTINGS, 81), (SETTINGS, 5), (plain, 30), (apart, 80)] {
        let said = step(settings, &clouds, at);
        for index in 0..2 {
            for kind in 0..7 {
                // What the front shows says nothing of how much it should have: that has another gradient than the cost.
                if settings.front_apart && index == 1 && !(4..6).contains(&kind) {
                    continue;
                }
                let mut gradient = said.gradients[index].clone();
                let gradient = fields(&mut gradient).remove(kind).to_vec();
                let mut differences =
                    STEPS.map(|h| difference(settings, &clouds, at, &Uphill { index, kind, gradient: &gradient }, h));
                differences.sort_by(f64::total_cmp);
                let want = differences[STEPS.len() / 2];
                let got: f64 = gradient.iter().map(|g| f64::from(g.abs())).sum();
                // Places, sizes, rotations and opacities move edges.
                let share = if kind < 4 { 0.15 } else { 0.01 };
                let off = (got - want).abs();
                assert!(off < share * want.abs() + 3e-4, "step {at}, cloud {index}, kind {kind}: {got} {want}");
            }
        }
        let begun = at as f64 >= SETTINGS.front_from * HORIZON as f64;
        let front = fields(&mut said.gradients[1].clone()).iter().any(|values| values.iter().any(|g| *g != 0.0));
        assert_eq!(front, begun, "step {at}");
    }
}

/// Of a step in the paper's first stage.
const FIRST: LayerSettings =
    LayerSettings { front_from: 0.0, front_first_stage: 0.2, front_smoothness: 0.0, ..SETTINGS };

/// Of colours and masks, against differences: the rest moves edges, and is taken back as everywhere.
fn front_has_the_gradient_of_the_cost(settings: LayerSettings, clouds: &[CloudParameters; 2], at: u64) {
    let said = step(settings, clouds, at);
    for kind in 4..7 {
        let gradient = fields(&mut said.gradients[1].clone()).remove(kind).to_vec();
        let want = difference(settings, clouds, at, &Uphill { index: 1, kind, gradient: &gradient }, 3e-4);
        let got: f64 = gradient.iter().map(|g| f64::from(g.abs())).sum();
        assert!(got > 0.0 && (got - want).abs() < 0.01 * want.abs() + 3e-4, "step {at}, kind {kind}: {got} {want}");
    }
}

#[test]
fn in_the_first_stage_the_cloud_behind_learns_by_itself_and_the_front_what_is_left() {
    let clouds = [cloud(40, 3.0, 1, 0), cloud(12, 2.0, 2, MASK_ROWS)];
    let said = step(FIRST, &clouds, 5);
    front_has_the_gradient_of_the_cost(FIRST, &clouds, 5);
    // The cloud behind does not hear of the front: neither of what it shows nor of how bright it makes what is behind.
    let mut other = clouds.clone();
    other[1].gaussians.dc.iter_mut().for_each(|dc| *dc = -*dc);
    other[1].extra.iter_mut().for_each(|mask| *mask += 1.0);
    let there = step(FIRST, &other, 5);
    assert_ne!(said.gradients[1], there.gradients[1]);
    let [here, there] = [said, there].map(|mut said| fields(&mut said.gradients[0]).concat());
    let largest = here.iter().fold(0.0_f32, |most, g| most.max(g.abs()));
    let off = here.iter().zip(&there).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(largest > 0.0 && off < 1e-3 * largest, "{off} {largest}");
    // After it both are one picture again.
    assert_eq!(
        step(FIRST, &clouds, 20).loss,
        step(LayerSettings { front_first_stage: 0.0, ..FIRST }, &clouds, 20).loss
    );
}

#[test]
fn brightness_is_held_to_the_photo_at_first_and_needles_now_and_then() {
    let clouds = [cloud(40, 3.0, 1, 0), cloud(12, 2.0, 2, MASK_ROWS)];
    let loss = |settings: LayerSettings, at: u64| step(settings, &clouds, at).loss;
    let without = LayerSettings { front_from: 0.0, front_brightness_photo: 0.0, ..SETTINGS };
    let with = LayerSettings { front_brightness_photo: 0.05, ..without };
    assert!(loss(with, 5) > loss(without, 5));
    front_has_the_gradient_of_the_cost(LayerSettings { front_brightness_photo: 1.0, ..with }, &clouds, 5);
    assert_eq!(loss(with, 80), loss(without, 80), "the weight of other brightness is larger by then");
    let mut needles = clouds.clone();
    needles[0].gaussians.log_scale[..40].fill(1.0);
    let round = LayerSettings { front_anisotropy: 0.1, ..without };
    let cost = |clouds: &[CloudParameters; 2], at| step(round, clouds, at).loss - step(without, clouds, at).loss;
    assert!(cost(&needles, 20) > cost(&clouds, 20) && cost(&clouds, 20) >= 0.0);
    assert_eq!(cost(&needles, 21), 0.0, "every tenth step");
}

#[test]
fn the_utility_part_changes_gradients_and_not_where_gaussians_come() {
    let clouds = [cloud(40, 3.0, 1, 0), cloud(12, 2.0, 2, MASK_ROWS)];
    let more = LayerSettings { front_structure: 1.0, front_entropy: 1.0, front_brightness: 1.0, ..SETTINGS };
    let [a, b] = [SETTINGS, more].map(|settings| step(settings, &clouds, 80));
    assert_eq!(a.uv, b.uv);
    assert!(a.uv.iter().all(|uv| uv.iter().any(|uv| uv[0] != 0.0)));
    assert!(a.gradients != b.gradients && a.loss < b.loss);
    let main = LayerSettings { front_separation: 1.0, front_smoothness: 1.0, ..SETTINGS };
    assert!(step(main, &clouds, 80).uv != a.uv);
}

#[test]
fn clouds_that_are_compared_apart_share_pixels_by_how_far_the_one_behind_is_off() {
    let clouds = [cloud(40, 3.0, 1, 0), cloud(12, 2.0, 2, MASK_ROWS)];
    let only = LayerSettings {
        front_apart: true,
        front_structure: 0.0,
        front_each: 0.0,
        front_divergence: 0.0,
        front_entropy: 0.0,
        front_sparsity: 0.0,
        front_sparsity_start: 0.0,
        front_separation: 0.0,
        front_brightness: 0.0,
        ..SETTINGS
    };
    let own = |settings| step(settings, &clouds, 80).gradients[1].extra[..12].iter().sum::<f32>();
    // It is off everywhere, by less than 1: masks grow where that is free, and fade where it costs as much.
    let [free, dear] = [0.0, 1.0].map(|front_sparsity| own(LayerSettings { front_sparsity, ..only }));
    assert!(free < 0.0 && dear > 0.0, "{free} {dear}");
    // Whatever the front shows.
    let mut other = clouds.clone();
    other[1].gaussians.dc.iter_mut().for_each(|dc| *dc = -*dc);
    let masks = |clouds: &[CloudParameters; 2]| step(only, clouds, 80).gradients[1].extra.clone();
    let alike = masks(&clouds).iter().zip(&masks(&other)).all(|(a, b)| (a - b).abs() < 1e-6);
    assert!(alike);
}

#[test]
fn what_goes_with_the_camera_is_the_same_from_everywhere_and_what_is_transparent_is_not_needed() {
    let mut front = cloud(12, 2.0, 2, MASK_ROWS);
    front.gaussians.logit[3] = -20.0;
    front.extra[5] = -20.0;
    let clouds = [CloudParameters::new(Gaussians::new(0, 1).unwrap(), 0), front];
    let settings = LayerSettings { front_at_camera: true, front_prune: 1e-3, ..SETTINGS };
    let here = step(settings, &clouds, 80);
    let there =
        View { r: [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], t: [3.0, 1.0, -7.0], ..View::at_origin(SIZE) };
    let seen = step_from(&there, settings, &clouds, 80);
    assert_eq!((seen.loss, &seen.gradients[1]), (here.loss, &here.gradients[1]));
    assert_ne!(step_from(&there, SETTINGS, &clouds, 80).loss, here.loss);
    assert!(here.uses[3] < 1e-3 && here.uses[5] < 1e-3 && here.uses.iter().filter(|u| **u > 1e-3).count() > 3);
    assert!(step(SETTINGS, &clouds, 80).uses.is_empty(), "nothing is counted where none are dropped");
    assert!(step(settings, &clouds, 5).uses.iter().all(|u| *u == 0.0), "it has not begun");
}

#[test]
fn rows_after_the_masks_are_not_shown_and_learn_nothing() {
    let of = |rows: usize| step(SETTINGS, &[cloud(40, 3.0, 1, 0), cloud(12, 2.0, 2, rows)], 80);
    let (masks, more) = (of(MASK_ROWS), of(MASK_ROWS + 1));
    let [with, without] = [&more.gradients[1], &masks.gradients[1]];
    assert_eq!((more.loss, &with.gaussians), (masks.loss, &without.gaussians));
    assert_eq!(with.extra[..12 * MASK_ROWS], without.extra);
    assert!(with.extra[12 * MASK_ROWS..].iter().all(|bar| *bar == 0.0));
}

#[test]
fn clouds_of_nothing_cost_what_the_background_costs() {
    let nothing = || CloudParameters::new(Gaussians::new(0, 1).unwrap(), 0);
    let empty_front = CloudParameters::new(Gaussians::new(0, 1).unwrap(), MASK_ROWS);
    let both = step(SETTINGS, &[nothing(), empty_front.clone()], 80);
    assert!(both.loss.is_finite() && both.loss > 0.0);
    let one = step(SETTINGS, &[cloud(9, 3.0, 1, 0), empty_front], 80);
    assert!(one.loss.is_finite() && one.uv[1].is_empty());
}

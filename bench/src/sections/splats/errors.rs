//! How far the kernels are from the plain `f64` rasteriser.
//!
//! A pixel whose decisions (is a Gaussian in it, is it at its densest, is the pixel finished) are nearer to falling otherwise than
//! rounding moves them says nothing about rounding: such pixels are left out, with their gradients, and counted.

use super::ground::Shot;
use super::stage::{BACKGROUND, COLOUR, DSSIM, Stage};
use crate::error::BenchError;
use crate::measure::worst;
use losses::dssim::{Dssim, Pair, Target};
use losses::metrics::{Image, SsimVariant, ssim};
use rayon::prelude::*;
use splat_core::{Field, Gaussians, ProjectedGaussian, RasterSettings, Widening};
use testkit::reference::splats::{
    Camera, Ellipse, EllipseBar, Pixel, Rules as Wide, front_to_back, parameters_bar, pixel, pixel_backward, project,
};

/// Pixels compared, about: every n-th along both axes of larger pictures.
const PIXELS: usize = 33_000;
/// Pixels of one task; gradients of tasks are added in order.
const CHUNK: usize = 2048;
/// What rounding moves decisions by: of the same ellipses, and where these were rounded before.
const UNCLEAR: f64 = 3e-6;
const UNCLEAR_WHOLE: f64 = 1e-4;
/// Depths nearer to each other than this may change places, relative.
const UNCLEAR_ORDER: f64 = 1e-6;
/// A colour is black from 0 on: where it begins on that corner there is no gradient to compare.
const CORNER: f64 = 1e-4;
/// Side of the cut that the loss is compared on, and how many of its values.
const CUT: usize = 64;
const VALUES: usize = 24;

/// Pictures in colour units; gradients as a share of the largest of their kind.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errors {
    /// Centres, pixels; colours.
    pub(super) projection: f64,
    /// Picture of the same ellipses.
    pub(super) drawing: f64,
    /// Picture of the same Gaussians.
    pub(super) picture: f64,
    /// Pixels compared, share of them that was left out, contributions a pixel.
    pub(super) pixels: usize,
    pub(super) unclear: f64,
    pub(super) contributions: f64,
    pub(super) gradients: Option<GradientErrors>,
}

/// Shares of the largest.
#[derive(Clone, Copy, Debug)]
pub(super) struct GradientErrors {
    /// Of the loss, with respect to the picture; `None` where it nowhere differs from the photo.
    pub(super) loss: Option<f64>,
    /// With respect to the ellipses, of the same ellipses and picture gradient.
    pub(super) drawing: f64,
    /// With respect to the parameters, of the same gradient of ellipses.
    pub(super) projection: f64,
    /// With respect to the parameters, of the same picture gradient.
    pub(super) step: f64,
}

/// Whether gradients are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Backwards {
    Compare,
    Leave,
}

/// One picture of a cloud.
pub(super) fn compare(
    stage: &mut Stage,
    cloud: &Gaussians,
    shot: &Shot,
    rules: &RasterSettings,
    backwards: Backwards,
) -> Result<Errors, BenchError> {
    stage.render(cloud, shot, rules)?;
    let (camera, wide) = (camera(shot), wide(rules));
    let parameters: Vec<f64> = cloud.fields().into_iter().flat_map(|(_, x)| x.iter().map(|&x| f64::from(x))).collect();
    let exact = project(&parameters, cloud.len(), cloud.degree(), &camera, &wide);
    let same = rounded(stage);
    let chosen = chosen(shot.view.size);
    let pixels: Vec<[Pixel; 2]> = chosen
        .par_iter()
        .map(|&i| {
            let at = [i % shot.view.size[0], i / shot.view.size[0]];
            [pixel(&same, at, &wide), pixel(&exact, at, &wide)]
        })
        .collect();
    let clear_same = |p: &Pixel| p.margin >= UNCLEAR;
    let clear = |p: &[Pixel; 2]| clear_same(&p[0]) && p[1].margin >= UNCLEAR_WHOLE && p[1].order >= UNCLEAR_ORDER;
    let all = shot.view.size[0] * shot.view.size[1];
    let mut errors = Errors {
        projection: projection(stage, &exact),
        drawing: 0.0,
        picture: 0.0,
        pixels: chosen.len(),
        unclear: pixels.iter().filter(|p| !clear(p)).count() as f64 / chosen.len().max(1) as f64,
        contributions: pixels.iter().map(|p| p[0].count as f64).sum::<f64>() / chosen.len().max(1) as f64,
        gradients: None,
    };
    for (&i, p) in chosen.iter().zip(&pixels) {
        let difference = |want: &Pixel| {
            let colours = (0..COLOUR).map(|c| {
                let want = want.values[c] + want.values[4] * f64::from(BACKGROUND);
                (f64::from(stage.planes[c * all + i]) - want).abs()
            });
            colours.fold(0.0, larger)
        };
        if clear_same(&p[0]) {
            errors.drawing = larger(errors.drawing, difference(&p[0]));
        }
        if clear(p) {
            errors.picture = larger(errors.picture, difference(&p[1]));
        }
    }
    if backwards == Backwards::Compare {
        let clear: Vec<usize> = chosen.iter().zip(&pixels).filter(|(_, p)| clear(p)).map(|(&i, _)| i).collect();
        let world = World { parameters: &parameters, camera: &camera, rules: &wide };
        errors.gradients =
            Some(gradients(stage, cloud, shot, rules, &Drawn { same: &same, exact: &exact, clear: &clear }, &world)?);
    }
    Ok(errors)
}

/// What the twin looks at.
struct World<'a> {
    parameters: &'a [f64],
    camera: &'a Camera,
    rules: &'a Wide,
}

/// The ellipses of a picture as the rasteriser had them and without rounding, and the pixels that no rounding decides.
struct Drawn<'a> {
    same: &'a [Ellipse],
    exact: &'a [Ellipse],
    clear: &'a [usize],
}

/// Gradients of the loss, taken over pixels that are clear.
fn gradients(
    stage: &mut Stage,
    cloud: &Gaussians,
    shot: &Shot,
    rules: &RasterSettings,
    drawn: &Drawn<'_>,
    world: &World<'_>,
) -> Result<GradientErrors, BenchError> {
    let Drawn { same, exact, clear } = *drawn;
    stage.compare(shot)?;
    let all = shot.view.size[0] * shot.view.size[1];
    let mut kept = vec![0.0; stage.bars.len()];
    for &i in clear {
        (0..=COLOUR).for_each(|k| kept[k * all + i] = stage.bars[k * all + i]);
    }
    stage.bars = kept;
    stage.draw_backward(rules)?;
    stage.project_backward(cloud, shot, rules)?;

    let width = shot.view.size[0];
    let back = |ellipses: &[Ellipse]| -> Vec<EllipseBar> {
        let parts: Vec<Vec<EllipseBar>> = clear
            .par_chunks(CHUNK)
            .map(|part| {
                let mut bars = vec![EllipseBar::default(); ellipses.len()];
                for &i in part {
                    let value = |k: usize| f64::from(stage.bars[k * all + i]);
                    let bar = [value(0), value(1), value(2), 0.0, value(3)];
                    pixel_backward(ellipses, [i % width, i / width], world.rules, bar, &mut bars);
                }
                bars
            })
            .collect();
        let mut sum = vec![EllipseBar::default(); ellipses.len()];
        for part in &parts {
            sum.iter_mut().zip(part).for_each(|(sum, more)| sum.add(more));
        }
        sum
    };
    let of_cloud = |ellipses: &[Ellipse], bars: &[EllipseBar]| to_parameters(cloud, ellipses, bars, world);
    let mut compared = vec![true; cloud.len()];
    exact.iter().for_each(|e| compared[e.index] = e.rgb.iter().all(|&c| c > CORNER));
    let far = |want: &[f64]| parameters_far(&stage.grad, want, &compared);
    let footprints = &stage.projection.gaussians;
    let of_records: Vec<EllipseBar> = stage.records.iter().map(widened).collect();
    let of_footprints: Vec<Ellipse> =
        footprints.iter().zip(&stage.projection.rgb).map(|(gaussian, rgb)| ellipse(gaussian, rgb)).collect();
    Ok(GradientErrors {
        loss: loss(stage, shot)?,
        drawing: records_far(stage, same, &back(same)),
        projection: far(&of_cloud(&of_footprints, &of_records)),
        step: far(&of_cloud(exact, &back(exact))),
    })
}

/// Gradient of all parameters, in the order of the fields, from that of some ellipses.
fn to_parameters(cloud: &Gaussians, ellipses: &[Ellipse], bars: &[EllipseBar], world: &World<'_>) -> Vec<f64> {
    let (n, numbers) = (cloud.len(), cloud.parameters_per_gaussian());
    let rows: Vec<(usize, Vec<f64>)> = ellipses
        .par_iter()
        .zip(bars)
        .filter(|(_, bar)| **bar != EllipseBar::default())
        .map(|(e, bar)| {
            let own: Vec<f64> = (0..numbers).map(|k| world.parameters[k * n + e.index]).collect();
            (e.index, parameters_bar(&own, cloud.degree(), world.camera, world.rules, bar))
        })
        .collect();
    let mut out = vec![0.0; numbers * n];
    for (i, row) in rows {
        row.into_iter().enumerate().for_each(|(k, x)| out[k * n + i] = x);
    }
    out
}

/// Largest distance of a gradient of parameters from `want`, field by field. Gaussians that are round have no gradient of their
/// rotation: it is a share of that of sizes, where that is larger.
fn parameters_far(got: &Gaussians, want: &[f64], compared: &[bool]) -> f64 {
    let (mut most, mut rest, mut sizes) = (0.0, want, 0.0);
    for (field, got) in got.fields() {
        let (want, more) = rest.split_at(got.len());
        rest = more;
        let of = |i: &usize| compared[i % compared.len()];
        let kept: Vec<usize> = (0..got.len()).filter(of).collect();
        let got: Vec<f32> = kept.iter().map(|&i| got[i]).collect();
        let want: Vec<f64> = kept.iter().map(|&i| want[i]).collect();
        let largest = want.iter().fold(0.0, |m: f64, w| m.max(w.abs()));
        if field == Field::LogScale {
            sizes = largest;
        }
        let scale = if field == Field::Wxyz { sizes.max(largest) } else { largest };
        // `worst` gives a share of the largest.
        let error = worst(&got, &want) * largest.max(f64::MIN_POSITIVE);
        most = larger(most, if error == 0.0 { 0.0 } else { error / scale });
    }
    most
}

/// Largest distance of the records from `want`, gradients of the ellipses `same`; kind by kind.
fn records_far(stage: &Stage, same: &[Ellipse], want: &[EllipseBar]) -> f64 {
    let mut place = vec![usize::MAX; same.iter().map(|e| e.index + 1).max().unwrap_or(0)];
    for (k, e) in same.iter().enumerate() {
        place[e.index] = k;
    }
    let (mut got, mut wanted): ([Vec<f32>; 4], [Vec<f64>; 4]) = Default::default();
    for (f, r) in stage.projection.gaussians.iter().zip(&stage.records) {
        let w = &want[place[f.index as usize]];
        got[0].extend(r.uv);
        wanted[0].extend(w.uv);
        got[1].extend(r.conic);
        wanted[1].extend(w.conic);
        got[2].push(r.opacity);
        wanted[2].push(w.opacity);
        got[3].extend(r.features);
        wanted[3].extend(w.rgb);
    }
    got.iter().zip(&wanted).map(|(got, want)| worst(got, want)).fold(0.0, larger)
}

/// Largest difference of a visible ellipse's centre (pixels) and colour.
fn projection(stage: &Stage, exact: &[Ellipse]) -> f64 {
    let mut by_index: Vec<&Ellipse> = exact.iter().collect();
    by_index.sort_by_key(|e| e.index);
    let mut most = 0.0;
    for (f, rgb) in stage.projection.gaussians.iter().zip(&stage.projection.rgb) {
        let Ok(at) = by_index.binary_search_by_key(&(f.index as usize), |e| e.index) else { return f64::NAN };
        let e = by_index[at];
        let pairs = f.uv.iter().zip(e.uv).chain(rgb.iter().zip(e.rgb));
        most = pairs.map(|(&got, want)| (f64::from(got) - want).abs()).fold(most, larger);
    }
    most
}

/// Gradient of the loss on a cut of the picture, against central differences of the same loss in `f64`.
fn loss(stage: &Stage, shot: &Shot) -> Result<Option<f64>, BenchError> {
    let [w, h] = shot.view.size;
    let [cw, ch] = [w.min(CUT), h.min(CUT)];
    let cut = |planes: &[f32]| -> Vec<f32> {
        let row = |c: usize, y: usize| planes[(c * h + (h - ch) / 2 + y) * w + (w - cw) / 2..][..cw].to_vec();
        (0..COLOUR).flat_map(|c| (0..ch).map(move |y| (c, y))).flat_map(|(c, y)| row(c, y)).collect()
    };
    let (x, y) = (cut(&stage.planes), cut(&shot.truth));
    let mut got = vec![0.0; x.len()];
    let pair = Pair { channels: COLOUR, height: ch, width: cw, x: &x, target: Target::Planes(&y), weights: None };
    Dssim::new(stage.simd).l1_dssim_backward(&pair, DSSIM, 1.0, &mut got).map_err(BenchError::part)?;
    let by_pixel = |planes: &[f32]| -> Vec<f32> {
        (0..cw * ch).flat_map(|i| (0..COLOUR).map(move |c| (i, c))).map(|(i, c)| planes[c * cw * ch + i]).collect()
    };
    let truth = by_pixel(&y);
    let value = |x: &[f32]| -> Result<f64, BenchError> {
        let moved = by_pixel(x);
        let image = |data| Image::from_f32(cw, ch, COLOUR, data).map_err(BenchError::part);
        let s = ssim(&image(&moved)?, &image(&truth)?, SsimVariant::ZERO_PADDED).map_err(BenchError::part)?;
        let l1 = x.iter().zip(&y).map(|(x, y)| (f64::from(*x) - f64::from(*y)).abs()).sum::<f64>() / x.len() as f64;
        let lambda = f64::from(DSSIM);
        Ok((1.0 - lambda) * l1 + lambda * (1.0 - s))
    };
    const H: f32 = 3e-5;
    let (mut some, mut want) = (Vec::new(), Vec::new());
    // All over the cut; not at the corner of |x - y|.
    let all_over = (0..x.len()).map(|k| k.wrapping_mul(7919) % x.len());
    for i in all_over.filter(|&i| (x[i] - y[i]).abs() > 2.0 * H).take(VALUES) {
        let (mut more, mut less) = (x.clone(), x.clone());
        (more[i], less[i]) = (x[i] + H, x[i] - H);
        some.push(got[i]);
        want.push((value(&more)? - value(&less)?) / (f64::from(more[i]) - f64::from(less[i])));
    }
    Ok((!some.is_empty()).then(|| worst(&some, &want)))
}

/// The larger; NaN is: it is not a small difference.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b <= a { a } else { b }
}

/// Pixels compared.
fn chosen([w, h]: [usize; 2]) -> Vec<usize> {
    let every = ((w * h) as f64 / PIXELS as f64).sqrt().ceil().max(1.0) as usize;
    (every / 2..h).step_by(every).flat_map(|y| (every / 2..w).step_by(every).map(move |x| y * w + x)).collect()
}

fn camera(shot: &Shot) -> Camera {
    let view = &shot.view;
    Camera {
        r: view.r.map(|row| row.map(f64::from)),
        t: view.t.map(f64::from),
        f: view.f.map(f64::from),
        c: view.c.map(f64::from),
        size: view.size,
    }
}

fn wide(rules: &RasterSettings) -> Wide {
    Wide {
        near: rules.near.into(),
        blur: rules.blur.into(),
        dims: rules.widening == Widening::Dims,
        alpha_min: rules.alpha_min.into(),
        alpha_max: rules.alpha_max.into(),
        stop: rules.transmittance_min.into(),
    }
}

/// The ellipses as the rasteriser had them, front to back.
fn rounded(stage: &Stage) -> Vec<Ellipse> {
    let mut out: Vec<Ellipse> = stage
        .projection
        .gaussians
        .iter()
        .zip(&stage.projection.rgb)
        .map(|(gaussian, rgb)| ellipse(gaussian, rgb))
        .collect();
    front_to_back(&mut out);
    out
}

fn ellipse(f: &ProjectedGaussian, rgb: &[f32; 3]) -> Ellipse {
    Ellipse::rounded(f.index as usize, f.uv, f.conic, [f.opacity, f.q_max, f.z], *rgb)
}

fn widened(r: &splat_core::ProjectedGradient<COLOUR>) -> EllipseBar {
    EllipseBar {
        uv: r.uv.map(f64::from),
        conic: r.conic.map(f64::from),
        opacity: r.opacity.into(),
        rgb: r.features.map(f64::from),
        z: 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;
    use float_core::Simd;
    use splat_core::View;

    /// Gaussians before a camera, and a photo of noise.
    fn scene() -> (Gaussians, Shot) {
        let mut cloud = Gaussians::new(150, 3).unwrap();
        for (k, (field, numbers)) in cloud.fields_mut().into_iter().enumerate() {
            let rng = Rng::new(3, k as u64);
            for (i, x) in numbers.iter_mut().enumerate() {
                let u = rng.normal_at(i as u64);
                *x = match field {
                    Field::Mean => 0.5 * u,
                    Field::LogScale => -2.0 + 0.5 * u,
                    Field::Rest => 0.2 * u,
                    _ => u,
                };
            }
        }
        let r = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let view = View::from_c2w(r, [0.0, 0.0, -3.0], [50.0; 2], [22.0, 17.0], [45, 33]);
        let rng = Rng::new(4, 0);
        (cloud, Shot { view, truth: (0..3 * 45 * 33).map(|i| rng.uniform_at(i)).collect() })
    }

    #[test]
    fn kernels_are_as_near_the_twin_as_their_tests_say() {
        let ((cloud, shot), rules) = (scene(), RasterSettings::DEFAULT);
        for simd in Simd::available() {
            let e = compare(&mut Stage::new(simd, &cloud), &cloud, &shot, &rules, Backwards::Compare).unwrap();
            let g = e.gradients.unwrap();
            println!("{:?}: {e:?}", simd.level());
            let small = [(e.drawing, 1e-5), (e.picture, 1e-4), (e.projection, 1e-3), (g.loss.unwrap(), 1e-4)];
            for (x, bound) in small.into_iter().chain([(g.drawing, 1e-4), (g.projection, 1e-3), (g.step, 1e-3)]) {
                assert!(x > 0.0 && x < bound, "{x}, bound {bound}: {e:?}");
            }
            assert!(e.pixels == 45 * 33 && e.unclear < 0.2 && e.contributions > 1.0, "{e:?}");
        }
    }

    #[test]
    fn a_wrong_gradient_is_seen() {
        let mut got = Gaussians::new(2, 0).unwrap();
        for (_, numbers) in got.fields_mut() {
            numbers.fill(0.0);
        }
        let mut want = vec![0.0; got.len() * got.parameters_per_gaussian()];
        assert_eq!(parameters_far(&got, &want, &[true; 2]), 0.0);
        (want[6], got.log_scale[0]) = (2.0, 1.0);
        assert_eq!(parameters_far(&got, &want, &[true; 2]), 0.5);
        // Rotations that should have none, as a share of sizes.
        got.wxyz[0] = 3.0;
        assert_eq!(parameters_far(&got, &want, &[true; 2]), 1.5);
        assert_eq!(parameters_far(&got, &want, &[false, true]), 0.0, "the first is left out");
        got.wxyz[0] = f32::NAN;
        assert!(parameters_far(&got, &want, &[true; 2]).is_nan());
    }
}

//! One step, as it is wired, against the definition in `f64`: the gradient of its loss with respect to every kind of parameter.

use super::cloud::{CloudTraining, TrainedCloud};
use super::cloud_frame::CloudFrame;
use super::cloud_parameters::CloudParameters;
use super::config::{CloudConfig, CloudRates, ExtraRows, PictureConfig, RowStart, WideningKind};
use super::density_config::{AdcConfig, ControlConfig, DensityConfig, DensityKind, DensityRules};
use super::drawing::{DrawnCloud, VisibleCloud};
use super::driver::{ViewParts, Views};
use super::hooks::{CloudMotion, ColourAppearance, ColourBars, Learns};
use super::pass::ViewSpaceGradient;
use super::photo::view;
use super::planes::{PlaneBars, RenderedPicture};
use super::smoothing::Smoothing;
use super::terms::{DepthMap, DepthTerm, L1Dssim, L1DssimConfig, PictureTerm, Structure, TargetPicture};
use super::uses::UsePruning;
use super::weights::{PlaneWeight, WeightPlane, nearest};
use crate::plan::made;
use engine::data::Dataset;
use engine::options::Background;
use engine::system::{Appearance, SystemError, Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use losses::LossError;
use splat_core::{Gaussians, RasterSettings};
use std::sync::{Arc, Mutex};
use testkit::reference::splats as reference;

pub(super) const FRAME: CloudFrame = CloudFrame { centre: [0.0; 3], scale: 2.0 };
const SIDE: usize = made::SIDE as usize;
const PIXELS: usize = SIDE * SIDE;
const DSSIM: f32 = 0.3;
const DEPTH: f32 = 0.7;
const LABEL: f32 = 0.4;
const GAIN: f64 = 0.6;
const BASE: f64 = 0.3;
const SPEED: f64 = 0.2;
const BACKGROUND: [f32; 3] = [1.0; 3];
/// Columns and rows of measured depths and of weights: any, of the whole picture.
const COARSE: [usize; 2] = [12, 8];

/// What the made-up parts of a step leave behind.
#[derive(Clone, Debug, Default)]
pub(super) struct Record {
    view: usize,
    gain_bar: f64,
    speed_bar: f64,
}

pub(super) type Shared = Arc<Mutex<Record>>;

/// `factor * mean w e^2` of the first extra row.
struct LabelTerm(Shared);

impl PictureTerm for LabelTerm {
    fn add(
        &mut self,
        picture: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut PlaneBars,
        loss: &mut f64,
    ) -> Result<(), LossError> {
        self.0.lock().unwrap().view = target.view;
        let share = LABEL / PIXELS as f32;
        for (i, (e, bar)) in picture.extras.iter().zip(bars.extras()).enumerate() {
            let weight = share * target.weights.map_or(1.0, |weights| weights[i]);
            *loss += f64::from(weight * e * e);
            *bar += 2.0 * weight * e;
        }
        Ok(())
    }
}

/// Colours of the first cloud times `1 + gain * (second extra row) + BASE * (coefficient of degree 0)`.
struct Gain(Shared);

impl Gain {
    /// The factors of Gaussian `i`.
    fn factors(cloud: &DrawnCloud<'_>, i: usize) -> [f32; 3] {
        let n = cloud.gaussians.len();
        let code = cloud.extra[n + i];
        [0, 1, 2].map(|c| 1.0 + GAIN as f32 * code + BASE as f32 * cloud.gaussians.dc[c * n + i])
    }
}

impl Learns for Gain {
    fn step(&mut self, _simd: Simd, _step: u64) -> usize {
        0
    }
    fn forget(&mut self) {}
    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }
    fn load(&mut self, _state: &TensorMap) -> Result<(), SystemError> {
        Ok(())
    }
    fn parameter_count(&self) -> usize {
        1
    }
}

impl ColourAppearance for Gain {
    fn code(&self, _appearance: &Appearance) -> Vec<f32> {
        Vec::new()
    }

    fn code_bar(&self, _code: &[f32], _seen: VisibleCloud<'_>, _rgb: &[[f32; 3]], _bar: &mut [[f32; 3]]) -> Vec<f32> {
        Vec::new()
    }

    fn forward(
        &self,
        _appearance: &Appearance,
        VisibleCloud { cloud, gaussians: visible, .. }: VisibleCloud<'_>,
        rgb: &mut [[f32; 3]],
    ) {
        if cloud.index == 0 {
            for (f, rgb) in visible.iter().zip(rgb) {
                let factors = Self::factors(&cloud, f.index as usize);
                (0..3).for_each(|c| rgb[c] *= factors[c]);
            }
        }
    }

    fn backward(
        &mut self,
        _appearance: &Appearance,
        VisibleCloud { cloud, gaussians: visible, .. }: VisibleCloud<'_>,
        rgb: &[[f32; 3]],
        bars: ColourBars<'_>,
    ) {
        if cloud.index == 0 {
            for (((f, rgb), bar), base) in visible.iter().zip(rgb).zip(bars.rgb).zip(bars.base) {
                let factors = Self::factors(&cloud, f.index as usize);
                (0..3).for_each(|c| base[c] += BASE as f32 * rgb[c] * bar[c]);
                let at = cloud.gaussians.len() + f.index as usize;
                let along: f32 = (0..3).map(|c| rgb[c] * bar[c]).sum();
                bars.extra[at] += GAIN as f32 * along;
                self.0.lock().unwrap().gain_bar += f64::from(cloud.extra[at] * along);
                (0..3).for_each(|c| bar[c] *= factors[c]);
            }
        }
    }
}

/// Positions times `1 + speed (time + 1/2)`.
struct Expansion(Shared);

impl Learns for Expansion {
    fn step(&mut self, _simd: Simd, _step: u64) -> usize {
        0
    }
    fn forget(&mut self) {}
    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }
    fn load(&mut self, _state: &TensorMap) -> Result<(), SystemError> {
        Ok(())
    }
    fn parameter_count(&self) -> usize {
        1
    }
}

impl CloudMotion for Expansion {
    fn cloud_at(&self, time: f64, _index: usize, canonical: &CloudParameters) -> CloudParameters {
        let mut at = canonical.clone();
        let factor = 1.0 + SPEED * (time + 0.5);
        at.gaussians.mean.iter_mut().for_each(|x| *x *= factor as f32);
        at
    }

    fn pull_back(&mut self, time: f64, _index: usize, canonical: &CloudParameters, bar: &mut CloudParameters) {
        let factor = 1.0 + SPEED * (time + 0.5);
        for (bar, x) in bar.gaussians.mean.iter_mut().zip(&canonical.gaussians.mean) {
            self.0.lock().unwrap().speed_bar += (time + 0.5) * f64::from(*bar * x);
            *bar *= factor as f32;
        }
    }
}

/// `n` Gaussians about the origin, every parameter different.
fn cloud(n: usize, degree: usize, stream: u64) -> Gaussians {
    let mut cloud = Gaussians::new(n, degree).unwrap();
    let rng = Rng::new(11, stream);
    for (k, (_, values)) in cloud.fields_mut().into_iter().enumerate() {
        let [middle, spread] = [[0.0, 0.35], [-1.7, 0.3], [0.3, 0.9], [0.2, 1.0], [0.1, 0.6], [0.0, 0.2]][k];
        for (i, value) in values.iter_mut().enumerate() {
            *value = middle + spread * (2.0 * rng.substream(k as u64).uniform4_at(i as u64)[0] - 1.0);
        }
    }
    cloud
}

fn training(extra: ExtraRows) -> CloudTraining {
    CloudTraining {
        cloud: CloudConfig {
            centre: FRAME.centre,
            radius: FRAME.scale,
            max_splats: 10,
            near_size: 0.0,
            sh_degree: 1,
            sh_every: 0,
        },
        rates: CloudRates {
            horizon: 1,
            fade_from: 1.0,
            fade_to: 1.0,
            lr_mean: 1e-30,
            lr_mean_end: 1e-30,
            lr_dc: 0.0,
            lr_logit: 0.0,
            lr_scale: 0.0,
            lr_rotation: 0.0,
        },
        density: DensityRules {
            schedule: DensityConfig {
                density: DensityKind::Adc,
                densify_from: 1000,
                densify_until: 1001,
                densify_every: 100,
                densify_absolute: false,
                free_space: false,
            },
            control: ControlConfig::Adc(AdcConfig { densify_gradient: 1.0, reset_every: 0, prune_size: 0.0 }),
        },
        extra,
        pruning: UsePruning::default(),
    }
}

/// Weights of some pixels, one of them 0.
fn weight_plane() -> WeightPlane {
    let weights = (0..COARSE[0] * COARSE[1]).map(|i| [1.0, 0.5, 0.0, 2.0][i * 5 % 4]).collect();
    WeightPlane { size: COARSE, weights }
}

/// Depths about those of the cloud; one in three is not known.
fn depth_map() -> DepthMap {
    let z = (0..COARSE[0] * COARSE[1]).map(|i| if i % 3 == 0 { 0.0 } else { 1.4 + 0.01 * i as f32 }).collect();
    DepthMap { size: COARSE, z }
}

pub(super) fn system(data: &Dataset, shared: &Shared, view_space: ViewSpaceGradient) -> Views {
    let rows = ExtraRows { rows: 2, composited: 1, rate: 0.0, start: RowStart::Zero };
    let mut clouds = vec![
        TrainedCloud::new(training(rows), 0, &cloud(5, 1, 1)).unwrap(),
        TrainedCloud::new(training(ExtraRows::default()), 1, &cloud(3, 1, 2)).unwrap(),
    ];
    let rng = Rng::new(12, 0);
    for (i, value) in clouds[0].parameters.extra.iter_mut().enumerate() {
        *value = rng.uniform4_at(i as u64)[0] - 0.3;
    }
    let views = data.len();
    let parts = ViewParts {
        name: "made",
        frame: FRAME,
        pictures: PictureConfig {
            near: 0.01,
            widening: WideningKind::Keeps,
            smoothing: 0.0,
            coarse: 0,
            coarse_steps: 1,
        },
        clouds,
        terms: vec![
            Box::new(L1Dssim::new(Simd::best(), &L1DssimConfig { dssim: DSSIM }).with_structure(Structure::Plain)),
            Box::new(DepthTerm { factor: DEPTH, maps: vec![Some(depth_map()); views] }),
            Box::new(LabelTerm(shared.clone())),
        ],
        weights: vec![Box::new(PlaneWeight { planes: vec![Some(weight_plane()); views] })],
        appearance: Some(Box::new(Gain(shared.clone()))),
        judge: None,
        surveys: None,
        motion: Some(Box::new(Expansion(shared.clone()))),
        layers: None,
        times: crate::views::PhotoTimes::Own,
        view_space,
        background: Background::White,
        time: None,
        seed: 5,
    };
    Views::new(parts, data).unwrap()
}

/// All that the loss of a step depends on.
#[derive(Clone)]
pub(super) struct Point {
    /// Parameters of both clouds, row by row.
    pub(super) clouds: [Vec<f64>; 2],
    /// `[2][5]` extra rows of the first.
    pub(super) extra: Vec<f64>,
    pub(super) gain: f64,
    pub(super) speed: f64,
}

impl Point {
    /// That of a system.
    pub(super) fn of(system: &Views) -> Self {
        let clouds = &system.parts.clouds;
        Self {
            clouds: [wide(&clouds[0].parameters.gaussians), wide(&clouds[1].parameters.gaussians)],
            extra: clouds[0].parameters.extra.iter().map(|&x| f64::from(x)).collect(),
            gain: GAIN,
            speed: SPEED,
        }
    }
}

/// The step in `f64`.
#[derive(Clone)]
pub(super) struct Twin {
    pub(super) camera: reference::Camera,
    rules: reference::Rules,
    time: f64,
    /// `[3][pixels]`
    photo: Vec<f64>,
    weights: Vec<f64>,
    depth: Vec<f64>,
    /// Standard deviations of the 3D filters of both clouds; none where there are no filters.
    filters: [Vec<f64>; 2],
}

impl Twin {
    pub(super) fn new(data: &Dataset, index: usize) -> Self {
        let seen = view(&data.view(index).camera, &FRAME);
        let settings = RasterSettings::DEFAULT;
        let image = data.image(index).unwrap();
        let coarse = |i: usize| nearest([i % SIDE, i / SIDE], [SIDE; 2], COARSE);
        let (weights, depth) = (weight_plane().weights, depth_map().z);
        Self {
            camera: reference::Camera {
                r: seen.r.map(|row| row.map(f64::from)),
                t: seen.t.map(f64::from),
                f: seen.f.map(f64::from),
                c: seen.c.map(f64::from),
                size: seen.size,
            },
            rules: reference::Rules {
                near: settings.near.into(),
                blur: settings.blur.into(),
                dims: false,
                alpha_min: settings.alpha_min.into(),
                alpha_max: settings.alpha_max.into(),
                stop: settings.transmittance_min.into(),
            },
            time: data.view(index).time,
            photo: (0..3 * PIXELS).map(|i| f64::from(image.data[i % PIXELS * 3 + i / PIXELS]) / 255.0).collect(),
            weights: (0..PIXELS).map(|i| weights[coarse(i)].into()).collect(),
            depth: (0..PIXELS).map(|i| depth[coarse(i)].into()).collect(),
            filters: [Vec::new(), Vec::new()],
        }
    }

    /// The same seen from elsewhere.
    pub(super) fn from(&self, camera: reference::Camera) -> Self {
        Self { camera, ..self.clone() }
    }

    pub(super) fn loss(&self, at: &Point) -> f64 {
        let mut all = Vec::new();
        for (index, (parameters, n)) in at.clouds.iter().zip([5, 3]).enumerate() {
            let mut moved = parameters.clone();
            moved[..3 * n].iter_mut().for_each(|x| *x *= 1.0 + at.speed * (self.time + 0.5));
            if !self.filters[index].is_empty() {
                reference::smooth(&mut moved, n, &self.filters[index]);
            }
            for mut ellipse in reference::project(&moved, n, 1, &self.camera, &self.rules) {
                let (mut label, plain) = (0.0, ellipse.rgb);
                if index == 0 {
                    // Rows of degree 0 come after three of places, three of sizes, four of rotations, one of opacities.
                    let dc = |c: usize| moved[(11 + c) * n + ellipse.index];
                    let factor = |c: usize| 1.0 + at.gain * at.extra[5 + ellipse.index] + BASE * dc(c);
                    ellipse.rgb = [0, 1, 2].map(|c| plain[c] * factor(c));
                    label = at.extra[ellipse.index];
                }
                ellipse.index += 5 * index;
                all.push((ellipse, label, plain));
            }
        }
        all.sort_by(|a, b| a.0.z.total_cmp(&b.0.z).then(a.0.index.cmp(&b.0.index)));
        let ellipses: Vec<_> = all.iter().map(|(ellipse, ..)| *ellipse).collect();
        let labels: Vec<_> = all.iter().map(|(e, label, _)| reference::Ellipse { rgb: [*label; 3], ..*e }).collect();
        let plain: Vec<_> = all.iter().map(|(e, _, rgb)| reference::Ellipse { rgb: *rgb, ..*e }).collect();
        let picture = reference::draw(&ellipses, [SIDE; 2], &self.rules).planes;
        let label = reference::draw(&labels, [SIDE; 2], &self.rules).planes;
        let plain = reference::draw(&plain, [SIDE; 2], &self.rules).planes;
        let transmittance = &picture[4 * PIXELS..];
        let over = |planes: &[f64]| -> Vec<f64> {
            let over = |i: usize| planes[i] + transmittance[i % PIXELS] * f64::from(BACKGROUND[i / PIXELS]);
            (0..3 * PIXELS).map(over).collect()
        };
        let mut loss = l1_dssim(&over(&picture), &over(&plain), &self.photo, &self.weights);
        for i in 0..PIXELS {
            let opacity = 1.0 - transmittance[i];
            if opacity >= 0.05 && self.depth[i] > 0.0 {
                let error = (picture[3 * PIXELS + i] / opacity - self.depth[i]).abs();
                loss += f64::from(DEPTH) * self.weights[i] * error / PIXELS as f64;
            }
            loss += f64::from(LABEL) * self.weights[i] * label[i] * label[i] / PIXELS as f64;
        }
        loss
    }
}

/// `(1 - lambda) mean w |t - y| + lambda mean w (1 - s)`, `s` of `x` and `y`: 121 taps at every pixel.
fn l1_dssim(t: &[f64], x: &[f64], y: &[f64], weights: &[f64]) -> f64 {
    // What is left out is black in both.
    let used = |x: &[f64]| -> Vec<f64> {
        x.iter().enumerate().map(|(i, x)| if weights[i % PIXELS] == 0.0 { 0.0 } else { *x }).collect()
    };
    let (t, x, y) = (&used(t)[..], &used(x)[..], &used(y)[..]);
    let raw = |d: i64| (-(d * d) as f64 / 4.5).exp();
    let total: f64 = (-5..=5).map(raw).sum();
    let (side, lambda) = (SIDE as i64, f64::from(DSSIM));
    let mut loss = 0.0;
    for i in 0..x.len() {
        let (plane, pixel) = (i / PIXELS * PIXELS, (i % PIXELS) as i64);
        let mut m = [0.0; 5];
        for (dy, dx) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dy, dx))) {
            let (row, column) = (pixel / side + dy, pixel % side + dx);
            if (0..side).contains(&row) && (0..side).contains(&column) {
                let (k, w) = (plane + (row * side + column) as usize, raw(dy) * raw(dx) / (total * total));
                for (m, v) in m.iter_mut().zip([x[k], y[k], x[k] * x[k], y[k] * y[k], x[k] * y[k]]) {
                    *m += w * v;
                }
            }
        }
        let [mx, my, xx, yy, xy] = m;
        let s = (2.0 * mx * my + 1e-4) * (2.0 * (xy - mx * my) + 9e-4)
            / ((mx * mx + my * my + 1e-4) * (xx - mx * mx + yy - my * my + 9e-4));
        loss += weights[i % PIXELS] * ((1.0 - lambda) * (t[i] - y[i]).abs() + lambda * (1.0 - s));
    }
    loss / x.len() as f64
}

fn wide(cloud: &Gaussians) -> Vec<f64> {
    cloud.fields().iter().flat_map(|(_, values)| values.iter().map(|&x| f64::from(x))).collect()
}

/// Largest difference between the gradient of `values` and differences of the loss, relative to the largest gradient.
fn worst(twin: &Twin, at: &Point, got: &[f64], value: impl Fn(&mut Point, usize) -> &mut f64) -> f64 {
    let want: Vec<f64> = (0..got.len())
        .map(|k| {
            let along = |h: f64| {
                let mut at = at.clone();
                *value(&mut at, k) += h;
                twin.loss(&at)
            };
            (along(1e-6) - along(-1e-6)) / 2e-6
        })
        .collect();
    let largest = want.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!(largest > 1e-6, "a gradient that is 0 says nothing: {want:?}");
    got.iter().zip(&want).map(|(got, want)| (got - want).abs() / largest).fold(0.0, f64::max)
}

/// Photos of noise.
pub(super) fn noise() -> Vec<scene_io::Frame> {
    let rng = Rng::new(3, 1);
    made::frames(3, |k, x, y| {
        rng.uniform4_at((k as u64 * 1000 + u64::from(y)) * 1000 + u64::from(x)).map(|u| (255.0 * u) as u8)
    })
}

#[test]
fn the_gradient_of_a_step_is_that_of_differences_for_every_kind_of_parameter() {
    let (_, data) = made::scene(noise(), Vec::new());
    let shared = Shared::default();
    let mut system = system(&data, &shared, ViewSpaceGradient::Plain);
    check_step(&data, &shared, &mut system);
}

#[test]
fn filtered_clouds_have_the_gradient_of_differences_too() {
    let (_, data) = made::scene(noise(), Vec::new());
    let shared = Shared::default();
    let mut system = system(&data, &shared, ViewSpaceGradient::Plain);
    // A filter as large as the Gaussians are.
    let pictures = PictureConfig { smoothing: 6.0, ..system.parts.pictures };
    system.smoothing = Smoothing::new(&pictures, &data, &FRAME, &system.parts.clouds).unwrap();
    let before: Vec<CloudParameters> = system.parts.clouds.iter().map(|cloud| cloud.parameters.clone()).collect();
    let filter = system.smoothing.as_ref().unwrap().sizes(0)[0];
    let log_scale = &before[0].gaussians.log_scale;
    assert!(log_scale.iter().any(|s| s.exp() < 2.0 * filter), "{filter} {log_scale:?}");
    check_step(&data, &shared, &mut system);
    // What is drawn is not what learns: rows stay, and parameters move by no more than a step.
    for (cloud, before) in system.parts.clouds.iter().zip(&before) {
        for (after, before) in cloud.parameters.gaussians.log_scale.iter().zip(&before.gaussians.log_scale) {
            assert!((after - before).abs() < 0.1, "{after} {before}");
        }
    }
}

/// A step of `system`, its first, against its twin.
fn check_step(data: &Dataset, shared: &Shared, system: &mut Views) {
    let at = Point::of(system);
    let filters = [0, 1].map(|index| {
        let sizes = system.smoothing.iter().flat_map(|smoothing| smoothing.sizes(index));
        sizes.map(|&size| f64::from(size)).collect()
    });
    let stats = system.train_step(data, 0).unwrap();
    let record = shared.lock().unwrap().clone();
    let twin = Twin { filters, ..Twin::new(data, record.view) };
    let want = twin.loss(&at);
    assert!((stats.loss - want).abs() < 1e-5 * want, "loss {} for {want}", stats.loss);
    for (index, cloud) in system.parts.clouds.iter().enumerate() {
        let mut first = 0;
        for (field, bar) in cloud.gradient.gaussians.fields() {
            let got: Vec<f64> = bar.iter().map(|&x| f64::from(x)).collect();
            let error = worst(&twin, &at, &got, |at, k| &mut at.clouds[index][first + k]);
            assert!(error < 1e-3, "cloud {index}, {}: {error:e}", field.name());
            first += bar.len();
        }
    }
    let extra: Vec<f64> = system.parts.clouds[0].gradient.extra.iter().map(|&x| f64::from(x)).collect();
    for (row, got) in extra.chunks_exact(5).enumerate() {
        let error = worst(&twin, &at, got, |at, k| &mut at.extra[5 * row + k]);
        assert!(error < 1e-3, "extra row {row}: {error:e}");
    }
    let error = worst(&twin, &at, &[record.gain_bar], |at, _| &mut at.gain);
    assert!(error < 1e-3, "appearance: {error:e}");
    let error = worst(&twin, &at, &[record.speed_bar], |at, _| &mut at.speed);
    assert!(error < 1e-3, "motion: {error:e}");
}

#[test]
fn absolute_view_space_gradients_leave_the_gradient_as_it_is() {
    let (_, data) = made::scene(noise(), Vec::new());
    let [plain, absolute] = [ViewSpaceGradient::Plain, ViewSpaceGradient::Absolute].map(|view_space| {
        let mut system = system(&data, &Shared::default(), view_space);
        system.train_step(&data, 0).unwrap();
        system.parts.clouds.into_iter().map(|cloud| cloud.gradient).collect::<Vec<_>>()
    });
    assert_eq!(plain, absolute);
}

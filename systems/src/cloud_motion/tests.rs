//! The motion of a cloud against its definition in `f64`, and what it must not do.

use super::deformation_field::DeformationField;
use super::*;
use crate::fields::{FeatureSource, PlaneGridSettings, PlaneGridSource};
use crate::views::cloud_frame::CloudFrame;
use crate::views::{CloudMotion, CloudParameters, Learns};
use engine::system::{Tensor, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use glam::DVec3;
use scene_io::Bounds;
use splat_core::{Field, Gaussians, rest_len};
use testkit::gradient::central_difference;
use testkit::reference::network::{Bias, Network};
use testkit::reference::planes::{Combine, Planes};

const SIDE: u32 = 4;
const TIMES: u32 = 3;
const SCALES: [u32; 2] = [1, 2];
const FEATURES: usize = 2;
const WIDTH: usize = 5;
const DEGREE: usize = 1;
const N: usize = 7;
const TIME: f64 = 0.37;
const PAIRS: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
/// The rows of each field that moves, in the order of the offsets.
const ROWS: [usize; 6] = [3, 3, 4, 1, 3, 3 * rest_len(DEGREE)];
/// Those of the masks, behind them.
const MASKS: usize = 3;

pub(super) const SETTINGS: MotionSettings = MotionSettings {
    motion_from: 0.0,
    motion_width: WIDTH,
    motion_layers: 1,
    motion_opacity: true,
    motion_colour: true,
    motion_masks: true,
    motion_lr: 1e-2,
    motion_lr_end: 1e-3,
    motion_feature_lr: 1e-2,
    motion_feature_lr_end: 1e-3,
    motion_coherence: 0.0,
    motion_reach: 2.0,
    motion_rest: 0.0,
};

fn planes() -> PlaneGridSource {
    let settings = PlaneGridSettings {
        plane_vertices: SIDE,
        plane_scales: SCALES.to_vec(),
        plane_features: FEATURES,
        plane_times: TIMES,
        plane_variation: 0.0,
        plane_smoothness: 0.0,
        plane_transients: 0.0,
    };
    PlaneGridSource::new(settings, [-1.0, 0.0, 1.0].into())
}

fn field(settings: MotionSettings) -> DeformationField {
    field_in(settings, 100)
}

/// The same, with a schedule of `horizon` steps.
pub(super) fn field_in(settings: MotionSettings, horizon: u64) -> DeformationField {
    let bounds = Bounds { min: DVec3::new(-1.0, -1.5, -2.0), max: DVec3::new(1.0, 1.5, 2.0) };
    let cube = UnitBox::new(&bounds, &CloudFrame { centre: [0.0; 3], scale: 1.0 });
    let features = planes().features(Rng::new(4, 0)).unwrap();
    DeformationField::new(settings, features, cube, 0, DEGREE, horizon, 9).unwrap()
}

/// The same with networks and planes of noise: everything moves.
fn busy(settings: MotionSettings) -> DeformationField {
    busy_in(settings, 100)
}

/// The same, with a schedule of `horizon` steps.
pub(super) fn busy_in(settings: MotionSettings, horizon: u64) -> DeformationField {
    let mut field = field_in(settings, horizon);
    let noise = |n: usize, stream: u64| -> Vec<f32> {
        let mut out = vec![0.0; n];
        Rng::new(6, stream).fill_uniform(0, &mut out);
        out
    };
    let params = noise(field.decoder().param_count(), 1).into_iter().map(|u| 1.2 * (u - 0.4)).collect();
    field.decoder_mut().set_parameters(params);
    let table = field.features_mut().parameters_mut();
    table.copy_from_slice(&noise(table.len(), 2).into_iter().map(|u| 0.5 + u).collect::<Vec<_>>());
    field
}

/// Gaussians in the box.
pub(super) fn cloud() -> CloudParameters {
    let mut cloud = Gaussians::new(N, DEGREE).unwrap();
    for (k, (_, values)) in (0..).zip(cloud.fields_mut()) {
        Rng::new(2, k).fill_uniform(0, values);
        values.iter_mut().for_each(|x| *x = 1.6 * (*x - 0.5));
    }
    let mut cloud = CloudParameters::new(cloud, MASKS);
    Rng::new(2, 99).fill_uniform(0, &mut cloud.extra);
    cloud
}

/// All parameters of a cloud, field after field, the masks last.
fn all(cloud: &CloudParameters) -> Vec<f64> {
    let fields = cloud.gaussians.fields();
    fields.iter().flat_map(|(_, values)| wide(values)).chain(wide(&cloud.extra)).collect()
}

pub(super) fn map(tensors: Vec<Tensor<'_>>) -> TensorMap {
    tensors.into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&x| f64::from(x)).collect()
}

/// Everything that a moved cloud depends on, in `f64`.
#[derive(Clone)]
struct Twin {
    /// Parameters of the cloud, field after field.
    cloud: Vec<f64>,
    table: Vec<f64>,
    networks: Vec<f64>,
}

impl Twin {
    fn of(field: &DeformationField, cloud: &CloudParameters) -> Self {
        Self {
            cloud: all(cloud),
            table: wide(field.features().parameters()),
            networks: wide(field.decoder().parameters()),
        }
    }

    fn features(&self, x: [f64; 4]) -> Vec<f64> {
        let mut from = 0;
        let mut out = Vec::new();
        for scale in SCALES {
            let side = SIDE * scale;
            let resolution = [side, side, side, TIMES];
            let planes =
                Planes { resolution: &resolution, features: FEATURES, pairs: &PAIRS, combine: Combine::Product };
            let table = &self.table[from..][..planes.table_len()];
            out.extend((0..FEATURES).map(|feature| planes.point(table, &x, feature).value));
            from += planes.table_len();
        }
        out
    }

    /// Parameters of the cloud at [`TIME`], field after field.
    fn moved(&self) -> Vec<f64> {
        let mut out = self.cloud.clone();
        for i in 0..N {
            let half = [1.0, 1.5, 2.0];
            let x = [0, 1, 2].map(|axis| self.cloud[axis * N + i] / half[axis]);
            let features = self.features([x[0], x[1], x[2], 2.0 * TIME - 1.0]);
            // One layer more than the shared ones ends in ReLU, too: that of a network whose last layer is any.
            let trunk = Network { widths: &[2 * FEATURES, WIDTH, WIDTH], skips: &[], bias: Bias::Each };
            let shared = trunk.param_count();
            let hidden: Vec<f64> =
                trunk.forward(&self.networks[..shared], &features).into_iter().map(|h| h.max(0.0)).collect();
            let (mut from, mut row) = (shared, 0);
            for rows in ROWS.into_iter().chain([MASKS]) {
                // That of the masks is a layer deeper.
                let deeper = [WIDTH, WIDTH, WIDTH, rows];
                let widths = if row == ROWS.iter().sum::<usize>() { &deeper[..] } else { &deeper[1..] };
                let head = Network { widths, skips: &[], bias: Bias::Each };
                let params = &self.networks[from..][..head.param_count()];
                for offset in head.forward(params, &hidden) {
                    out[row * N + i] += offset;
                    row += 1;
                }
                from += params.len();
            }
        }
        out
    }

    fn value(&self, weights: &[f64]) -> f64 {
        self.moved().iter().zip(weights).map(|(x, w)| x * w).sum()
    }
}

/// Largest difference between gradients and differences of the twin, relative to the largest gradient.
fn worst(twin: &Twin, weights: &[f64], got: &[f64], part: impl Fn(&mut Twin) -> &mut Vec<f64>) -> f64 {
    let want = central_difference(&part(&mut twin.clone()).clone(), |values| {
        let mut at = twin.clone();
        part(&mut at).copy_from_slice(values);
        at.value(weights)
    });
    let largest = want.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    assert!(largest > 1e-3, "a gradient that is 0 says nothing");
    got.iter().zip(&want).map(|(got, want)| (got - want).abs() / largest).fold(0.0, f64::max)
}

#[test]
fn a_moved_cloud_and_its_gradient_are_those_of_the_definition() {
    let (mut field, cloud) = (busy(SETTINGS), cloud());
    let twin = Twin::of(&field, &cloud);
    let moved = field.cloud_at(TIME, 0, &cloud);
    let got = all(&moved);
    for (got, want) in got.iter().zip(twin.moved()) {
        assert!((got - want).abs() < 1e-5 * (1.0 + want.abs()), "{got} {want}");
    }
    assert!(got.iter().zip(&twin.cloud).all(|(at, before)| at != before), "everything moves");
    let mut bar = cloud.clone();
    for (k, (_, values)) in (0..).zip(bar.gaussians.fields_mut()) {
        Rng::new(8, k).fill_uniform(0, values);
    }
    Rng::new(8, 99).fill_uniform(0, &mut bar.extra);
    let weights = all(&bar);
    field.pull_back(TIME, 0, &cloud, &mut bar);
    let of_cloud = all(&bar);
    let (table, networks) = field.gradients();
    for (name, error) in [
        ("cloud", worst(&twin, &weights, &of_cloud, |twin| &mut twin.cloud)),
        ("planes", worst(&twin, &weights, &wide(&table), |twin| &mut twin.table)),
        ("networks", worst(&twin, &weights, &wide(&networks), |twin| &mut twin.networks)),
    ] {
        assert!(error < 1e-4, "{name}: {error:e}");
    }
}

#[test]
fn coherence_pulls_on_neighbours_and_only_where_it_is_asked_for() {
    let cloud = cloud();
    // The gradient of the networks, where that of the picture is the cloud's own numbers, multiplied by `times`.
    let networks = |motion_coherence: f32, times: f32| {
        let mut field = busy(MotionSettings { motion_coherence, ..SETTINGS });
        let mut bar = cloud.clone();
        for (_, values) in bar.gaussians.fields_mut() {
            values.iter_mut().for_each(|x| *x *= times);
        }
        bar.extra.iter_mut().for_each(|x| *x *= times);
        field.pull_back(TIME, 0, &cloud, &mut bar);
        field.gradients().1
    };
    let twice = |gradient: Vec<f32>| gradient.iter().map(|x| 2.0 * x).collect::<Vec<_>>();
    // What the picture alone says is twice as much where that is; a term of its own stays as it is.
    assert_eq!(networks(0.0, 2.0), twice(networks(0.0, 1.0)));
    assert_ne!(networks(1.0, 2.0), twice(networks(1.0, 1.0)));
    assert_ne!(networks(0.0, 1.0), networks(1.0, 1.0));
}

#[test]
fn nothing_moves_at_the_start_before_it_begins_or_in_another_cloud() {
    let cloud = cloud();
    assert_eq!(field(SETTINGS).cloud_at(0.3, 0, &cloud), cloud, "offsets begin at 0");
    let mut late = busy(MotionSettings { motion_from: 0.5, ..SETTINGS });
    assert_eq!(late.cloud_at(0.3, 0, &cloud), cloud);
    let mut bar = cloud.clone();
    late.pull_back(0.3, 0, &cloud, &mut bar);
    assert_eq!(bar, cloud, "a gradient of what does not move is as it was");
    late.step(Simd::best(), 49);
    assert_ne!(late.cloud_at(0.3, 0, &cloud), cloud, "half of a hundred steps are done");
    assert_eq!(late.cloud_at(0.3, 1, &cloud), cloud);
}

#[test]
fn what_no_photo_shows_teaches_nothing() {
    let (mut field, cloud) = (busy(SETTINGS), cloud());
    let mut bar = CloudParameters::new(Gaussians::new(N, DEGREE).unwrap(), 0);
    bar.gaussians.wxyz.fill(0.0);
    let before = map(field.state());
    field.pull_back(TIME, 0, &cloud, &mut bar);
    assert_eq!(field.step(Simd::best(), 0), 0);
    let mut after = map(field.state());
    after.insert("motion.done".into(), before["motion.done"].clone());
    assert_eq!(after, before);
}

#[test]
fn times_outside_are_the_first_and_the_last_and_places_outside_are_those_of_the_border() {
    let (field, cloud) = (busy(SETTINGS), cloud());
    assert_eq!(field.cloud_at(-3.0, 0, &cloud), field.cloud_at(0.0, 0, &cloud));
    assert_eq!(field.cloud_at(7.0, 0, &cloud), field.cloud_at(1.0, 0, &cloud));
    let [mut far, mut border] = [cloud.clone(), cloud.clone()];
    (far.gaussians.mean[0], border.gaussians.mean[0]) = (1e30, 1.0);
    let offset = |of: &CloudParameters| field.cloud_at(TIME, 0, of).gaussians.log_scale[0] - of.gaussians.log_scale[0];
    assert!((offset(&far) - offset(&border)).abs() < 1e-6);
}

#[test]
fn an_empty_cloud_moves_nowhere() {
    let mut field = busy(SETTINGS);
    let empty = CloudParameters::new(Gaussians::new(0, DEGREE).unwrap(), 0);
    assert_eq!(field.cloud_at(0.5, 0, &empty), empty);
    let mut bar = empty.clone();
    field.pull_back(0.5, 0, &empty, &mut bar);
    assert_eq!(field.step(Simd::best(), 0), 0);
}

#[test]
fn any_number_of_threads_moves_and_learns_the_same_bits() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut field = busy(SETTINGS);
            // More than three chunks.
            let mut cloud = Gaussians::new(3500, DEGREE).unwrap();
            for (k, (_, values)) in (0..).zip(cloud.fields_mut()) {
                Rng::new(2, k).fill_uniform(0, values);
            }
            let cloud = CloudParameters::new(cloud, 0);
            for step in 0..3 {
                let mut bar = field.cloud_at(0.25 * step as f64, 0, &cloud);
                field.pull_back(0.25 * step as f64, 0, &cloud, &mut bar);
                assert_eq!(field.step(Simd::best(), step), 0);
            }
            map(field.state())
        })
    };
    let one = run(1);
    assert!([2, 5].into_iter().all(|threads| run(threads) == one));
}

#[test]
fn a_checkpoint_goes_on_with_the_same_bits_and_one_without_networks_is_refused() {
    let cloud = cloud();
    let mut whole = busy(MotionSettings { motion_from: 0.02, ..SETTINGS });
    let go = |field: &mut DeformationField, steps: std::ops::Range<u64>| {
        for step in steps {
            let mut bar = field.cloud_at(0.1 * step as f64, 0, &cloud);
            field.pull_back(0.1 * step as f64, 0, &cloud, &mut bar);
            field.step(Simd::best(), step);
        }
    };
    go(&mut whole, 0..5);
    let state = map(whole.state());
    let mut resumed = field(MotionSettings { motion_from: 0.02, ..SETTINGS });
    resumed.load(&state).unwrap();
    go(&mut whole, 5..9);
    go(&mut resumed, 5..9);
    assert_eq!(map(whole.state()), map(resumed.state()));
    let mut without = state;
    without.remove("motion.networks");
    let before = map(resumed.state());
    assert!(resumed.load(&without).unwrap_err().to_string().contains("motion.networks"));
    assert_eq!(map(resumed.state()), before, "nothing has changed");
}

#[test]
fn what_cannot_work_is_refused_by_its_name() {
    for (name, settings) in [
        ("motion_from", MotionSettings { motion_from: 1.0, ..SETTINGS }),
        ("motion_width", MotionSettings { motion_width: 0, ..SETTINGS }),
        ("motion_layers", MotionSettings { motion_layers: 9, ..SETTINGS }),
        ("motion_lr", MotionSettings { motion_lr: f64::NAN, ..SETTINGS }),
        ("motion_feature_lr_end", MotionSettings { motion_feature_lr_end: 0.0, ..SETTINGS }),
        ("motion_coherence", MotionSettings { motion_coherence: -1.0, ..SETTINGS }),
        ("motion_reach", MotionSettings { motion_reach: f32::NAN, ..SETTINGS }),
        ("motion_rest", MotionSettings { motion_rest: f32::NAN, ..SETTINGS }),
    ] {
        let error = settings.check().unwrap_err().to_string();
        assert!(error.contains(name), "{name}: {error}");
    }
    assert!(SETTINGS.check().is_ok());
    let rows: usize = field(SETTINGS).decoder().fields().map(|(_, rows)| rows.len()).sum();
    assert_eq!(rows, ROWS.iter().sum::<usize>());
    let alone = field(MotionSettings { motion_opacity: false, motion_colour: false, ..SETTINGS });
    let moved: Vec<Field> = alone.decoder().fields().map(|(field, _)| field).collect();
    assert_eq!(moved, [Field::Mean, Field::LogScale, Field::Wxyz]);
}

#[test]
fn a_cloud_without_masks_moves_as_without_the_network_of_them() {
    let mut field = busy(SETTINGS);
    let mut without = cloud();
    (without.rows, without.extra) = (0, Vec::new());
    let (moved, with) = (field.cloud_at(TIME, 0, &without), field.cloud_at(TIME, 0, &cloud()));
    assert_eq!((moved.gaussians, moved.extra.len()), (with.gaussians, 0));
    let mut bar = without.clone();
    field.pull_back(TIME, 0, &without, &mut bar);
    assert!(bar.gaussians.mean.iter().all(|g| g.is_finite()) && bar.extra.is_empty());
    let still = self::field(MotionSettings { motion_masks: false, ..SETTINGS });
    assert_eq!(still.cloud_at(TIME, 0, &cloud()).extra, cloud().extra);
}

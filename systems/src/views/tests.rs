//! Extra rows and several clouds through steps, density changes and checkpoints.

use super::cloud::{CloudTraining, TrainedCloud};
use super::cloud_frame::CloudFrame;
use super::cloud_parameters::CloudParameters;
use super::config::{CloudConfig, CloudRates, ExtraRows, PictureConfig, RowStart, WideningKind};
use super::density_config::{
    AdcConfig, ControlConfig, DensityConfig, DensityKind, DensityRules, McmcConfig, SplitConfig,
};
use super::density_control::ChangeTime;
use super::driver::{ViewParts, Views};
use super::outside::PhotoPixels;
use super::pass::ViewSpaceGradient;
use super::planes::{PlaneBars, RenderedPicture};
use super::start::Place;
use super::terms::{L1Dssim, L1DssimConfig, PictureTerm, TargetPicture};
use super::uses::UsePruning;
use crate::plan::made;
use engine::data::Dataset;
use engine::options::Background;
use engine::render::plain_query;
use engine::system::{System, Tensor, TensorData, TensorMap};
use field_core::rng::Rng;
use float_core::Simd;
use glam::DVec3;
use losses::LossError;
use splat_core::Gaussians;

/// Draws the label, which is the first extra row, to the photo's red.
struct RedLabel;

impl PictureTerm for RedLabel {
    fn add(
        &mut self,
        picture: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut PlaneBars,
        loss: &mut f64,
    ) -> Result<(), LossError> {
        let share = 1.0 / picture.extras.len() as f32;
        for ((e, red), bar) in picture.extras.iter().zip(target.colour).zip(bars.extras()) {
            *loss += f64::from(share * (e - red) * (e - red));
            *bar += 2.0 * share * (e - red);
        }
        Ok(())
    }
}

fn cloud(n: usize, stream: u64) -> Gaussians {
    let mut cloud = Gaussians::new(n, 1).unwrap();
    let rng = Rng::new(11, stream);
    for (i, x) in cloud.mean.iter_mut().enumerate() {
        *x = 0.6 * (rng.uniform4_at(i as u64)[0] - 0.5);
    }
    cloud.log_scale.fill(-3.0);
    cloud
}

fn training(kind: DensityKind, extra: ExtraRows) -> CloudTraining {
    let control = match kind {
        DensityKind::Adc => ControlConfig::Adc(AdcConfig { densify_gradient: 1e-6, reset_every: 7, prune_size: 0.0 }),
        DensityKind::Split => {
            ControlConfig::Split(SplitConfig { densify_gradient: 1e-6, opacity_decay: 0.9, refill: 0.0 })
        }
        DensityKind::Mcmc => ControlConfig::Mcmc(McmcConfig { mcmc_cost: 0.01, mcmc_noise: 5e3 }),
    };
    CloudTraining {
        cloud: CloudConfig { centre: [0.0; 3], radius: 3.3, max_splats: 60, near_size: 0.0, sh_degree: 1, sh_every: 3 },
        rates: CloudRates {
            horizon: 100,
            fade_from: 1.0,
            fade_to: 1.0,
            lr_mean: 1e-3,
            lr_mean_end: 1e-4,
            lr_dc: 1e-2,
            lr_logit: 0.05,
            lr_scale: 5e-3,
            lr_rotation: 1e-3,
        },
        density: DensityRules {
            schedule: DensityConfig {
                density: kind,
                densify_from: 1,
                densify_until: 100,
                densify_every: 5,
                densify_absolute: false,
                free_space: false,
            },
            control,
        },
        extra,
        pruning: UsePruning::default(),
    }
}

fn system(data: &Dataset, kind: DensityKind, view_space: ViewSpaceGradient) -> Views {
    let rows = ExtraRows { rows: 2, composited: 1, rate: 0.02, start: RowStart::Zero };
    let clouds = vec![
        TrainedCloud::new(training(kind, rows), 0, &cloud(20, 1)).unwrap(),
        TrainedCloud::new(training(kind, ExtraRows::default()), 1, &cloud(10, 2)).unwrap(),
    ];
    let parts = ViewParts {
        name: "made",
        frame: CloudFrame { centre: [0.0; 3], scale: 3.3 },
        pictures: PictureConfig {
            near: 0.01,
            widening: WideningKind::Keeps,
            smoothing: 0.2,
            coarse: 0,
            coarse_steps: 1,
        },
        clouds,
        terms: vec![Box::new(L1Dssim::new(Simd::best(), &L1DssimConfig { dssim: 0.2 })), Box::new(RedLabel)],
        weights: Vec::new(),
        appearance: None,
        judge: None,
        surveys: None,
        layers: None,
        motion: None,
        times: crate::views::PhotoTimes::Own,
        view_space,
        background: Background::Random,
        time: None,
        seed: 5,
    };
    Views::new(parts, data).unwrap()
}

fn map(tensors: Vec<Tensor<'_>>) -> TensorMap {
    tensors.into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
}

#[test]
fn extra_rows_and_a_second_cloud_go_through_density_changes_and_checkpoints() {
    let (_, data) = made::capture(made::Points::None);
    for kind in [DensityKind::Adc, DensityKind::Split, DensityKind::Mcmc] {
        let mut whole = system(&data, kind, ViewSpaceGradient::Plain);
        for step in 0..8 {
            assert!(whole.step(&data, step).unwrap().loss.is_finite());
        }
        let [first, second] = &whole.parts.clouds[..] else { panic!("two clouds") };
        assert!(first.parameters.len() != 20 && second.parameters.len() != 10, "their numbers changed");
        let CloudParameters { extra, .. } = &first.parameters;
        assert_eq!(extra.len(), 2 * first.parameters.len());
        let (label, unused) = extra.split_at(first.parameters.len());
        assert!(label.iter().all(|x| *x > 0.0), "photos are red everywhere: {label:?}");
        assert!(unused.iter().all(|x| *x == 0.0), "nothing asks for the second row");
        assert!(second.parameters.extra.is_empty());
        let mut resumed = system(&data, kind, ViewSpaceGradient::Plain);
        resumed.load_state(&map(whole.state())).unwrap();
        for step in 8..16 {
            whole.step(&data, step).unwrap();
            resumed.step(&data, step).unwrap();
        }
        assert_eq!(map(whole.state()), map(resumed.state()), "the same bits as without a break");
        let names: Vec<String> = whole.state().into_iter().map(|t| t.name).collect();
        for name in ["splats.mean", "splats.extra", "adam.extra.m", "splats.cloud1.mean", "adam.cloud1.mean.v"] {
            assert!(names.iter().any(|n| n == name), "{name}: {names:?}");
        }
    }
}

#[test]
fn nothing_is_large_beside_a_camera_where_that_is_limited() {
    let (_, data) = made::capture(made::Points::None);
    for kind in [DensityKind::Adc, DensityKind::Split, DensityKind::Mcmc] {
        let mut system = system(&data, kind, ViewSpaceGradient::Plain);
        system.parts.clouds[0].training.cloud.near_size = 0.2;
        for cloud in &mut system.parts.clouds {
            cloud.parameters.gaussians.log_scale.fill(1.0);
        }
        for step in 0..10 {
            system.step(&data, step).unwrap();
        }
        let frame = system.parts.frame;
        let cameras: Vec<DVec3> = data.views().iter().map(|v| frame.to_internal(v.camera.pose.c)).collect();
        let parts = system.parts.clouds.iter().map(|cloud| {
            let (g, n) = (&cloud.parameters.gaussians, cloud.parameters.len());
            let part = |i: usize| {
                let size = (0..3).map(|k| f64::from(g.log_scale[k * n + i]).exp()).fold(0.0, f64::max);
                let x = DVec3::from([0, 1, 2].map(|k| f64::from(g.mean[k * n + i])));
                if size > 0.011 { size / cameras.iter().map(|c| c.distance(x)).fold(f64::MAX, f64::min) } else { 0.0 }
            };
            (0..n).map(part).fold(0.0, f64::max)
        });
        let parts: Vec<f64> = parts.collect();
        assert!((0.1..0.2001).contains(&parts[0]) && parts[1] > 0.5, "{kind:?}: {parts:?}");
    }
}

#[test]
fn the_extra_rows_of_new_gaussians_are_those_of_their_sources() {
    let extra = ExtraRows { rows: 1, composited: 1, rate: 0.0, start: RowStart::Zero };
    let mut trained = TrainedCloud::new(training(DensityKind::Mcmc, extra), 0, &cloud(20, 1)).unwrap();
    // A label that says where a Gaussian is.
    let along = |parameters: &CloudParameters| parameters.gaussians.dc[..parameters.len()].to_vec();
    for i in 0..20 {
        trained.parameters.gaussians.dc[i] = i as f32;
        trained.parameters.extra[i] = i as f32;
    }
    trained.parameters.gaussians.logit[3] = -9.0;
    trained
        .change(0, ChangeTime { step: 4, position: 4, steps_done: 5, fades_done: 5 }, 0, &[], 4, |_| Ok(None))
        .unwrap();
    assert!(trained.parameters.len() > 20);
    assert_eq!(trained.parameters.extra, along(&trained.parameters));
    assert!(!trained.parameters.extra.contains(&3.0), "what is dead was relocated");
}

#[test]
fn a_checkpoint_without_the_rows_is_refused_by_name_and_nothing_changes() {
    let (_, data) = made::capture(made::Points::None);
    let mut made = system(&data, DensityKind::Adc, ViewSpaceGradient::Plain);
    let (before, mut without) = (map(made.state()), map(made.state()));
    without.remove("splats.extra");
    let error = made.load_state(&without).unwrap_err().to_string();
    assert!(error.contains("splats.extra"), "{error}");
    assert_eq!(map(made.state()), before);
}

#[test]
fn absolute_gradients_are_the_larger_ones_for_density_and_the_same_for_learning() {
    let (_, data) = made::capture(made::Points::None);
    let [plain, absolute] = [ViewSpaceGradient::Plain, ViewSpaceGradient::Absolute].map(|view_space| {
        let mut system = system(&data, DensityKind::Adc, view_space);
        system.step(&data, 0).unwrap();
        map(system.state())
    });
    let sum = |state: &TensorMap, name: &str| match &state[name].data {
        engine::system::TensorData::F32(values) => values.iter().map(|&x| f64::from(x)).sum::<f64>(),
        engine::system::TensorData::U64(_) => panic!("{name}"),
    };
    assert!(sum(&absolute, "pull.sum") > 1.01 * sum(&plain, "pull.sum"));
    assert_eq!(plain["splats.mean"], absolute["splats.mean"]);
}

#[test]
fn both_clouds_are_in_pictures_and_in_what_is_exported() {
    let (_, data) = made::capture(made::Points::None);
    let both = system(&data, DensityKind::Adc, ViewSpaceGradient::Plain);
    let mut one = system(&data, DensityKind::Adc, ViewSpaceGradient::Plain);
    one.parts.clouds[1].parameters.gaussians.logit.fill(-30.0);
    let query = plain_query([0.0; 3], 0.0);
    let opacity =
        |system: &Views| -> f32 { system.render_view(&data.view(0).camera, &query).unwrap().opacity.iter().sum() };
    assert!(opacity(&both) > 1.05 * opacity(&one));
    assert_eq!(both.splats(&query).unwrap().gaussians.len(), 30);
    assert_eq!(both.parameter_count(), 20 * (23 + 2) + 10 * 23);
}

#[test]
fn gaussians_from_outside_join_a_cloud_and_leave_the_others_as_they_were() {
    let (_, data) = made::capture(made::Points::None);
    let mut system = system(&data, DensityKind::Split, ViewSpaceGradient::Plain);
    for step in 0..3 {
        system.step(&data, step).unwrap();
    }
    let before = map(system.state());
    let new = [1.0, 2.0].map(|x| Place { x: DVec3::new(x, 0.0, 3.3), pixel: 0.11, rgb: [0.5, 0.25, 1.0] });
    system.insert(&new, 3.0).unwrap();
    let after = map(system.state());
    let rows = |state: &TensorMap, name: &str| match state.get(name).map(|t| &t.data) {
        Some(TensorData::F32(x)) => x.to_vec(),
        _ => panic!("{name}: {:?}", state.keys().collect::<Vec<_>>()),
    };
    for (name, fresh) in
        [("splats.mean", None), ("splats.extra", Some(0.0)), ("adam.mean.m", Some(0.0)), ("pull.sum", Some(0.0))]
    {
        let (old, all) = (rows(&before, name), rows(&after, name));
        let components = old.len() / 20;
        for k in 0..components {
            assert_eq!(all[k * 22..][..20], old[k * 20..][..20], "{name}");
            assert!(fresh.is_none_or(|x| all[k * 22 + 20..][..2] == [x; 2]), "{name}");
        }
    }
    let mean = rows(&after, "splats.mean");
    assert_eq!(
        [mean[20], mean[21], mean[22 + 20], mean[44 + 20]],
        [1.0 / 3.3, 2.0 / 3.3, 0.0, 1.0].map(|x: f64| x as f32)
    );
    assert!((rows(&after, "splats.log_scale")[20] - 0.1_f32.ln()).abs() < 1e-6);
    assert!((rows(&after, "splats.logit")[21] - (0.1_f32 / 0.9).ln()).abs() < 1e-6);
    for step in 3..8 {
        assert!(system.step(&data, step).unwrap().loss.is_finite());
    }
}

#[test]
fn pixels_are_drawn_by_their_error_and_spread_over_all_photos() {
    // All photos are black but for one pixel, and the clouds are far away from what is seen.
    let frames = made::frames(3, |_, x, y| if (x, y) == (5, 9) { [255; 4] } else { [0; 4] });
    let (_, data) = made::scene(frames, Vec::new());
    let mut system = system(&data, DensityKind::Split, ViewSpaceGradient::Plain);
    system.parts.background = Background::Black;
    for cloud in &mut system.parts.clouds {
        cloud.parameters.gaussians.logit.fill(-20.0);
    }
    system.step(&data, 0).unwrap();
    let worst = system.erring_pixels(0, 7);
    assert_eq!(worst.pixels, [(9 * made::SIDE as usize + 5, [1.0; 3])]);
    let spread = system.spread_pixels(&data, 50).unwrap();
    assert_eq!((spread.len(), spread.iter().map(|photo| photo.pixels.len()).sum::<usize>()), (data.len(), 50));
    let rows = |photo: &PhotoPixels| photo.pixels.iter().map(|(i, _)| i / made::SIDE as usize).collect::<Vec<_>>();
    assert!(spread.iter().all(|photo| rows(photo).windows(2).all(|w| w[0] <= w[1])));
    assert!(rows(&spread[0]).first().is_some_and(|&y| y < 8) && rows(&spread[0]).last().is_some_and(|&y| y > 15));
}

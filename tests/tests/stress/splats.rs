//! Clouds of Gaussians that begin with too little, too far away or nothing at all; photos that say nothing; settings that
//! nobody should write.

use crate::common::{End, dataset, guarded, pictures, says, state_is_finite, tiny_scene, train_psnr};
use engine::data::Dataset;
use engine::options::{Background, Plan, RunOptions};
use engine::system::{System, SystemError};
use glam::DVec3;
use scene_io::{Image, ImageSource, LayoutHint, Point, Scene};
use std::sync::Arc;
use stress::{Tally, Verdict, ensure, finite};

const STEPS: u64 = 45;
/// Density control and fading within the steps.
const TINY: [&str; 4] = ["max_splats=120", "sh_every=10", "densify_from=4", "densify_every=5"];
/// Settings of the parts that are there only where they are chosen.
const OF_ADC: [&str; 2] = ["densify_gradient=1e-6", "reset_every=20"];
const OF_SPLIT: [&str; 2] = ["densify_gradient=1e-6", "opacity_decay=0.8"];
const OF_MCMC: [&str; 1] = ["mcmc_cost=0.02"];
const OF_RANDOM_PLACES: [&str; 1] = ["start_count=60"];
const DENSITIES: [&str; 3] = ["density=split", "density=adc", "density=mcmc"];

fn build(scene: &Scene, data: &Dataset, set: &[&str]) -> Result<(Box<dyn System>, Plan), SystemError> {
    let control: &[&str] = match set {
        _ if set.contains(&"density=mcmc") => &OF_MCMC,
        _ if set.contains(&"density=adc") => &OF_ADC,
        _ => &OF_SPLIT,
    };
    let usable = scene.points.iter().any(|p| p.xyz.as_vec3().is_finite());
    let random: &[&str] = if usable && !set.contains(&"start=\"random\"") { &[] } else { &OF_RANDOM_PLACES };
    let set =
        TINY.iter().chain(control).chain(random).chain(set).map(|s| engine::options::parse_set(s).unwrap()).collect();
    let options = RunOptions { seed: 1, background: Some(Background::White), error_budget: None, stop: None, set };
    systems::registry::build("splat", scene, data, &options)
}

/// Every number of the exported cloud is finite, and there are no more Gaussians than are allowed.
fn exports(system: &dyn System, max: usize) -> Verdict {
    let splats = system.splats(&engine::render::plain_query([0.0; 3], 0.5)).ok_or("nothing to export")?.gaussians;
    for (field, numbers) in splats.fields() {
        finite(field.name(), numbers)?;
    }
    ensure(splats.len() <= max, || format!("{} Gaussians of at most {max}", splats.len()))
}

/// Trains with all kinds of density control, everything finite all the time; the plan has a line with `told`.
fn trains(scene: &Scene, set: &[&str], told: &str) -> Verdict {
    for density in DENSITIES {
        let data = dataset(scene);
        let set = [set, &[density]].concat();
        let (mut system, plan) = build(scene, &data, &set).map_err(|e| format!("{density}: {e}"))?;
        ensure(plan.lines.iter().any(|line| line.contains(told)), || format!("`{told}` is not in {:?}", plan.lines))?;
        let max = plan.config["max_splats"].as_integer().unwrap_or(0) as usize;
        exports(system.as_ref(), max).map_err(|e| format!("{density}, start: {e}"))?;
        let end = guarded(system.as_mut(), &data, STEPS, state_is_finite).map_err(|e| format!("{density}: {e}"))?;
        ensure(end == End::Trained, || format!("{density}: the guard stopped it"))?;
        exports(system.as_ref(), max).map_err(|e| format!("{density}, end: {e}"))?;
        train_psnr(system.as_ref(), &data).map_err(|e| format!("{density}: {e}"))?;
    }
    Ok(())
}

fn with_points(mut scene: Scene, points: impl IntoIterator<Item = DVec3>) -> Scene {
    scene.points = points.into_iter().map(|xyz| Point { xyz, rgb: [90, 130, 170] }).collect();
    scene
}

/// Points of the table.
fn normal() -> impl Iterator<Item = DVec3> {
    (0..40_u32).map(|k| DVec3::new(f64::from(k % 7) - 3.0, f64::from(k / 7) - 3.0, f64::from(k % 3)) * 0.2)
}

fn sized(views: usize, width: u32, height: u32) -> Scene {
    let mut scene = tiny_scene(views, 0.82);
    for frame in &mut scene.frames {
        frame.camera = frame.camera.resized(width, height);
        if let ImageSource::Memory(image) = &frame.image {
            frame.image = ImageSource::Memory(Arc::new(image.resized(width, height)));
        }
    }
    scene
}

fn far_away(scene: Scene, by: DVec3) -> Scene {
    let mut scene = with_points(scene, normal().map(|x| x + by));
    for frame in &mut scene.frames {
        frame.camera.pose.c += by;
    }
    if let Some(bounds) = &mut scene.bounds {
        (bounds.min, bounds.max) = (bounds.min + by, bounds.max + by);
    }
    scene
}

fn masked(views: usize, hides: impl Fn(usize) -> bool) -> Scene {
    pictures(tiny_scene(views, 0.82), |k, image| Image {
        mask: hides(k).then(|| vec![0; (image.width * image.height) as usize]),
        ..image.clone()
    })
}

fn transparent(views: usize, which: impl Fn(usize) -> bool) -> Scene {
    pictures(tiny_scene(views, 0.82), |k, image| {
        let mut image = image.clone();
        if which(k) {
            image.data.chunks_exact_mut(4).for_each(|p| p[3] = 0);
        }
        image
    })
}

fn one_place(views: usize, turns: bool) -> Scene {
    let mut scene = with_points(tiny_scene(views, 0.82), normal());
    let pose = scene.frames[0].camera.pose;
    for frame in &mut scene.frames {
        frame.camera.pose.c = pose.c;
        if !turns {
            frame.camera.pose = pose;
        }
    }
    scene
}

/// A box of one colour: photos without alpha.
fn opaque(views: usize) -> Scene {
    let mut scene = pictures(tiny_scene(views, 0.82), |k, image| {
        let n = (image.width * image.height) as usize;
        Image::rgb(image.width, image.height, (0..3 * n).map(|i| ((i * 7 + k) % 251) as u8).collect()).unwrap()
    });
    scene.layout = LayoutHint::Unbounded;
    scene
}

const MILLION: DVec3 = DVec3::new(1e6, -1e6, 1e6);

/// Scenes, settings, and how the cloud says that it begins.
fn beginnings() -> Vec<(&'static str, Scene, &'static [&'static str], &'static str)> {
    const RANDOM: &str = "Gaussians at random in a box";
    let table = || tiny_scene(4, 0.82);
    let behind = {
        let scene = table();
        // Away from what all cameras look at.
        let places = scene.frames.iter().map(|f| f.camera.pose.c * 3.0 + DVec3::Z * 50.0).collect::<Vec<_>>();
        with_points(scene, places)
    };
    vec![
        ("no points", table(), &[], RANDOM),
        ("no points and no alpha", opaque(4), &[], RANDOM),
        ("points asked for, and none there", table(), &["start=\"points\""], RANDOM),
        ("one point", with_points(table(), [DVec3::ZERO]), &[], "1 Gaussians at the points"),
        ("two points", with_points(table(), [DVec3::ZERO, DVec3::Z]), &[], "2 Gaussians at the points"),
        (
            "50 points at one place",
            with_points(table(), vec![DVec3::splat(0.1); 50]),
            &[],
            "50 Gaussians at the points",
        ),
        (
            "points on a line",
            with_points(table(), (0..50).map(|k| DVec3::X * 0.02 * f64::from(k))),
            &[],
            "50 Gaussians",
        ),
        ("all points behind all cameras", behind, &[], "4 Gaussians at the points"),
        ("points and cameras at 1e6", far_away(table(), MILLION), &[], "40 Gaussians at the points"),
        ("no points, cameras at 1e6", Scene { points: Vec::new(), ..far_away(table(), MILLION) }, &[], RANDOM),
        ("a point at 1e6", with_points(table(), normal().chain([MILLION])), &[], "41 Gaussians at the points"),
        ("a point at 1e30", with_points(table(), normal().chain([MILLION * 1e24])), &[], "Gaussians at the points"),
        ("a point at 1e300", with_points(table(), normal().chain([MILLION * 1e294])), &[], "1 of 41 points left out"),
        ("a point that is none", with_points(table(), normal().chain([DVec3::NAN])), &[], "1 of 41 points left out"),
        ("only points that are none", with_points(table(), [DVec3::NAN, DVec3::INFINITY]), &[], RANDOM),
        (
            "a point in a camera",
            {
                let scene = table();
                let o = scene.frames[0].camera.pose.c;
                with_points(scene, normal().chain([o]))
            },
            &[],
            "41 Gaussians",
        ),
        ("more points than are allowed", with_points(table(), normal()), &["max_splats=7"], "7 Gaussians at points"),
        ("one Gaussian", table(), &["max_splats=1"], "at most 1 Gaussians"),
        ("one photo", tiny_scene(1, 0.82), &[], "one camera: the scene's extent is taken to be 1"),
        ("one photo and points", with_points(tiny_scene(1, 0.82), normal()), &[], "one camera"),
        ("cameras that turn at one place", one_place(4, true), &[], "4 cameras at one place"),
        ("cameras all the same, accepted", one_place(4, false), &["accept_no_parallax=true"], "4 cameras at one place"),
        ("photos of 1x1 pixel", sized(4, 1, 1), &[], RANDOM),
        ("photos of 7x5 pixels", sized(4, 7, 5), &[], RANDOM),
        ("photos of 1x33 pixels", sized(4, 1, 33), &[], RANDOM),
        ("photos of 7x5 pixels, begun at a quarter", sized(4, 7, 5), &["coarse=2", "coarse_steps=10"], RANDOM),
        ("photos of 1x1 pixel, begun at a quarter", sized(4, 1, 1), &["coarse=2", "coarse_steps=10"], RANDOM),
        ("a mask over all of a photo", masked(4, |k| k == 1), &[], RANDOM),
        ("masks over all of all photos", masked(4, |_| true), &[], RANDOM),
        ("a transparent photo", transparent(4, |k| k == 1), &[], RANDOM),
        ("transparent photos", transparent(4, |_| true), &[], RANDOM),
        ("transparent photos and points", with_points(transparent(4, |_| true), normal()), &[], "40 Gaussians"),
        ("a field of view of 0.01 degrees", tiny_scene(4, 0.01_f64.to_radians()), &[], RANDOM),
        ("a field of view of 179 degrees", tiny_scene(4, 179_f64.to_radians()), &[], RANDOM),
    ]
}

pub(crate) fn scenes(tally: &mut Tally) {
    for (what, scene, set, told) in beginnings() {
        tally.case(format!("splat, {what}"), "says how it begins, trains, all that is exported is finite", || {
            trains(&scene, set, told)
        });
    }
    tally.case("splat, all cameras the same", "one error that says `parallax`", || {
        let scene = one_place(4, false);
        let error = build(&scene, &dataset(&scene), &[]).map(drop).err().ok_or("trained")?;
        says(&error, &["parallax"])
    });
    tally.case("splat, all cameras the same, accepted", "a resumed run is told again", || {
        let scene = one_place(4, false);
        let (_, plan) = build(&scene, &dataset(&scene), &["accept_no_parallax=true"]).map_err(|e| e.to_string())?;
        ensure(plan.config.contains_key("accept_no_parallax"), || format!("{:?}", plan.config))
    });
    tally.case("splat, no picture at all", "no panic, everything finite, or one error", || {
        let scene = tiny_scene(0, 0.82);
        let data = dataset(&scene);
        match build(&scene, &data, &[]) {
            Ok((mut system, _)) => {
                guarded(system.as_mut(), &data, 5, state_is_finite)?;
                exports(system.as_ref(), 120)
            }
            Err(e) => says(&e, &[]),
        }
    });
    tally.case("splat at 1e6", "as good as at the origin, to 1 dB", || {
        let at = |by: DVec3| {
            let scene = far_away(tiny_scene(4, 0.82), by);
            let data = dataset(&scene);
            let (mut system, _) = build(&scene, &data, &[]).map_err(|e| e.to_string())?;
            guarded(system.as_mut(), &data, 150, state_is_finite)?;
            train_psnr(system.as_ref(), &data)
        };
        stress::close("PSNR", at(MILLION)?, at(DVec3::ZERO)?, 1.0)
    });
}

const SETTINGS: &str = "
    max_splats=0 max_splats=1 max_splats=50000001 start_count=0 start_count=1 sh_degree=0 sh_degree=4 sh_every=0 sh_every=1
    radius=0.0 radius=-1.0 radius=nan radius=inf radius=1e-30 radius=1e30
    near=0.0 near=-1.0 near=nan near=1e-38 near=100.0 near=3e38 near=inf
    lr_mean=0.0 lr_mean=nan lr_mean=1e30 lr_mean=1e-300 lr_mean_end=0.0 lr_mean_end=inf lr_mean_end=10.0 horizon=0 horizon=1
    lr_dc=-1.0 lr_dc=nan lr_dc=0.0 lr_dc=1e30 lr_logit=nan lr_logit=1e30 lr_scale=nan lr_scale=1e30 lr_scale=50.0
    lr_rotation=nan lr_rotation=1e30 lr_rotation=0.0
    densify_every=0 densify_every=1 densify_until=0 densify_from=1000 densify_gradient=0.0 densify_gradient=-1.0
    densify_gradient=nan densify_gradient=1e-38 densify_gradient=1e30 reset_every=0 reset_every=1
    opacity_decay=0.0 opacity_decay=1.0 opacity_decay=1.5 opacity_decay=nan opacity_decay=1e-30
    fade_from=-0.1 fade_from=0.0 fade_from=1.0 fade_from=nan fade_to=0.0 fade_to=1.0 fade_to=2.0 fade_to=nan
    mcmc_cost=-1.0 mcmc_cost=nan mcmc_cost=1e30 mcmc_noise=nan mcmc_noise=-1.0 mcmc_noise=0.0 mcmc_noise=1e30
    dssim=-0.1 dssim=1.1 dssim=nan dssim=0.0 dssim=1.0 coarse=1 coarse=40 coarse_steps=0
    start=\"random\" start=\"anywhere\" density=\"none\" widening=\"dims\" widening=\"keeps\" nonsense=1";

pub(crate) fn settings(tally: &mut Tally) {
    let scene = tiny_scene(3, 0.82);
    let data = dataset(&scene);
    for setting in SETTINGS.split_whitespace() {
        for density in DENSITIES {
            tally.case(
                format!("splat, {density}, --set {setting}"),
                "one error that names the setting, or finite numbers",
                || {
                    let mut system = match build(&scene, &data, &[density, setting]) {
                        Ok((system, _)) => system,
                        Err(e) => {
                            let key = setting.split('=').next().unwrap_or_default();
                            return says(&e, &[key]);
                        }
                    };
                    match guarded(system.as_mut(), &data, 24, state_is_finite)? {
                        End::Trained => train_psnr(system.as_ref(), &data).map(drop),
                        End::Guarded => Ok(()),
                    }
                },
            );
        }
    }
}

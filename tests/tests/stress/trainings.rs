//! Learning rates 1000 times too high, 10^5 steps, pictures without contrast, scenes at the end of the map.

use crate::common::{End, build, build_before, dataset, guarded, state_is_finite, tiny_scene, train_psnr};
use engine::options::Background;
use engine::system::SystemError;
use float_core::{Simd, SimdLevel};
use glam::DVec3;
use scene_io::{Image, ImageSource, LayoutHint, Scene};
use std::sync::Arc;
use stress::{Tally, close, ensure};

pub(crate) fn learning_rates(tally: &mut Tally) {
    let scene = tiny_scene(6, 0.82);
    let data = dataset(&scene);
    for (system, rates) in
        [("ngp", ["lr=0.02", "lr=20.0", "lr=1e4", "lr=1e30"]), ("nerf", ["lr=5e-4", "lr=0.5", "lr=1e4", "lr=1e30"])]
    {
        for rate in rates {
            tally.case(
                format!("{system}, {rate}, 300 steps"),
                "all parameters finite, or one error of the guard",
                || {
                    let mut system = build(system, &scene, &data, &[rate]).map_err(|e| e.to_string())?;
                    // Whatever it learnt, it draws no NaN.
                    match guarded(system.as_mut(), &data, 300, state_is_finite)? {
                        End::Trained => train_psnr(system.as_ref(), &data).map(drop),
                        End::Guarded => Ok(()),
                    }
                },
            );
        }
    }
}

pub(crate) fn long_run(tally: &mut Tally) {
    let scene = tiny_scene(3, 0.82);
    let data = dataset(&scene);
    // Steps of microseconds: it is their number that counts.
    let set = [
        "levels=2",
        "log2_table=6",
        "width=8",
        "geometry=2",
        "sh_degree=1",
        "rays_per_side=1",
        "batch_samples=32",
        "batch_rays=16",
        "occupancy_every=500",
    ];
    // Plain numbers take several times as long and are what the other levels are compared with: a tenth there.
    let shorter = if Simd::best().level() == SimdLevel::Scalar { 10 } else { 1 };
    for (rate, steps) in [("lr=0.02", 100_000 / shorter), ("lr=20.0", 10_000 / shorter)] {
        tally.case(
            format!("ngp, {rate}, {steps} steps"),
            "no parameter is ever non-finite, or one error of the guard",
            || {
                // One thread: the steps are too small to share.
                let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|e| e.to_string())?;
                pool.install(|| {
                    let set: Vec<&str> = set.into_iter().chain([rate]).collect();
                    let mut system = build("ngp", &scene, &data, &set).map_err(|e| e.to_string())?;
                    for step in 0..steps {
                        match system.step(&data, step) {
                            Ok(_) => {}
                            Err(SystemError::NonFinite { .. }) if rate == "lr=20.0" => {
                                return state_is_finite(system.as_ref());
                            }
                            Err(e) => return Err(format!("step {step}: {e}")),
                        }
                        if step % 1000 == 999 {
                            state_is_finite(system.as_ref()).map_err(|e| format!("step {step}: {e}"))?;
                        }
                    }
                    state_is_finite(system.as_ref())?;
                    train_psnr(system.as_ref(), &data).map(drop)
                })
            },
        );
    }
}

/// The same cameras, and pictures of one colour.
fn constant(views: usize, colour: [u8; 3]) -> Scene {
    let mut scene = tiny_scene(views, 0.82);
    for frame in &mut scene.frames {
        frame.image = ImageSource::Memory(Arc::new(Image::rgb(16, 16, colour.repeat(256)).unwrap()));
    }
    // Pictures without alpha show what is everywhere.
    scene.layout = LayoutHint::Unbounded;
    scene
}

/// The scene somewhere else, and larger.
fn moved(mut scene: Scene, by: DVec3, scale: f64) -> Scene {
    for frame in &mut scene.frames {
        frame.camera.pose.c = frame.camera.pose.c * scale + by;
    }
    if let Some(bounds) = &mut scene.bounds {
        (bounds.min, bounds.max) = (bounds.min * scale + by, bounds.max * scale + by);
    }
    if let LayoutHint::Object { near, far } = &mut scene.layout {
        (*near, *far) = (*near * scale, *far * scale);
    }
    scene
}

pub(crate) fn scenes(tally: &mut Tally) {
    for colour in [[0, 0, 0], [255, 255, 255], [128, 128, 128], [51, 179, 102]] {
        tally.case(format!("constant pictures {colour:?}"), "more than 40 dB", || {
            let scene = constant(6, colour);
            let data = dataset(&scene);
            // The plan takes plain black for a backdrop; pictures are drawn on white here.
            let asked = (colour == [0; 3]).then_some(Background::White);
            // All of space must be of that colour: the smallest table is too small for it.
            let set = ["log2_table=12"];
            let mut system = build_before(asked, "ngp", &scene, &data, &set).map_err(|e| e.to_string())?;
            guarded(system.as_mut(), &data, 300, state_is_finite)?;
            let psnr = train_psnr(system.as_ref(), &data)?;
            ensure(psnr > 40.0, || format!("{psnr:.2} dB"))
        });
    }
    let reference = |scene: &Scene| -> Result<f64, String> {
        let data = dataset(scene);
        let mut system = build("ngp", scene, &data, &[]).map_err(|e| e.to_string())?;
        guarded(system.as_mut(), &data, 100, state_is_finite)?;
        train_psnr(system.as_ref(), &data)
    };
    let at_home = reference(&tiny_scene(6, 0.82));
    for (by, scale) in
        [(DVec3::splat(1e6), 1.0), (DVec3::new(-1e6, 1e6, 0.0), 1.0), (DVec3::ZERO, 1e6), (DVec3::ZERO, 1e-6)]
    {
        tally.case(format!("the scene at {by}, scaled by {scale:e}"), "as good as at the origin, to 1.5 dB", || {
            let psnr = reference(&moved(tiny_scene(6, 0.82), by, scale))?;
            close("PSNR", psnr, at_home.clone()?, 1.5)
        });
    }
    for degrees in [0.01_f64, 120.0, 170.0, 179.0] {
        for system in ["ngp", "nerf"] {
            tally.case(format!("{system}, a field of view of {degrees} degrees"), "trains, everything finite", || {
                let scene = tiny_scene(4, degrees.to_radians());
                let data = dataset(&scene);
                let mut system = build(system, &scene, &data, &[]).map_err(|e| e.to_string())?;
                guarded(system.as_mut(), &data, 40, state_is_finite)?;
                train_psnr(system.as_ref(), &data).map(drop)
            });
        }
    }
    for system in ["ngp", "nerf"] {
        tally.case(format!("{system}, a single picture"), "trains, everything finite", || {
            let scene = tiny_scene(1, 0.82);
            let data = dataset(&scene);
            let mut system = build(system, &scene, &data, &[]).map_err(|e| e.to_string())?;
            guarded(system.as_mut(), &data, 40, state_is_finite)?;
            train_psnr(system.as_ref(), &data).map(drop)
        });
        tally.case(format!("{system}, no picture at all"), "no panic, everything finite, or one error", || {
            let scene = tiny_scene(0, 0.82);
            let data = dataset(&scene);
            match build(system, &scene, &data, &[]) {
                Ok(mut system) => guarded(system.as_mut(), &data, 5, state_is_finite).map(drop),
                Err(e) => ensure(!e.to_string().contains('\n'), || format!("said: {e}")),
            }
        });
        tally.case(
            format!("{system}, all cameras at one place"),
            "one error that says `parallax`, unless overridden",
            || {
                let mut scene = tiny_scene(4, 0.82);
                let pose = scene.frames[0].camera.pose;
                scene.frames.iter_mut().for_each(|f| f.camera.pose = pose);
                let data = dataset(&scene);
                match build(system, &scene, &data, &[]) {
                    Ok(_) => return Err("trained".into()),
                    Err(e) => ensure(e.to_string().contains("parallax"), || format!("said: {e}"))?,
                }
                let mut system =
                    build(system, &scene, &data, &["accept_no_parallax=true"]).map_err(|e| e.to_string())?;
                guarded(system.as_mut(), &data, 20, state_is_finite).map(drop)
            },
        );
    }
}

//! Photos that say little, or nothing, or of which some lack what others have.

use super::{CLOUDS, METHODS, STEPS, build, trains};
use crate::common::{dataset, pictures, says, tiny_scene};
use glam::DVec3;
use scene_io::{Image, ImageSource, LayoutHint, PerturbationKind, Point, Scene, TrackPoint, perturb};
use std::sync::Arc;
use stress::Tally;

/// What is promised of some methods on a scene.
struct Case {
    what: &'static str,
    scene: Scene,
    set: &'static [&'static str],
    /// Methods that refuse it, with the words of the line that says so; all others train.
    refuse: fn(name: &str) -> Option<&'static [&'static str]>,
}

const NOBODY: fn(&str) -> Option<&'static [&'static str]> = |_| None;

/// Scenes whose needs are looked for: photos of which others say nothing, and photos that say nothing themselves.
const LOOKED_AT: [&str; 4] = ["one photo", "photos of 1x1 pixel", "transparent photos", "masks over all of all photos"];

/// Encoders need a photo they can halve.
const ENCODERS: fn(&str) -> Option<&'static [&'static str]> =
    |name| matches!(name, "ha-nerf" | "ha-nerf-a").then_some(&["photo `", "the encoder needs", "`codes`"]);

/// Pictures without alpha, so that all of them shows something.
fn opaque(views: usize, value: impl Fn(usize, usize) -> u8) -> Scene {
    let mut scene = pictures(tiny_scene(views, 0.82), |k, image| {
        let pixels = image.width * image.height;
        Image::rgb(image.width, image.height, (0..pixels as usize * 3).map(|i| value(k, i)).collect()).unwrap()
    });
    scene.layout = LayoutHint::Unbounded;
    scene
}

/// The same cameras with pictures of `size(photo)`.
fn sized(views: usize, size: impl Fn(usize) -> (u32, u32)) -> Scene {
    let mut scene = perturb(tiny_scene(views, 0.82), PerturbationKind::Both, 3);
    for (k, frame) in scene.frames.iter_mut().enumerate() {
        let (width, height) = size(k);
        frame.camera = frame.camera.resized(width, height);
        frame.perturbation = None;
        if let ImageSource::Memory(image) = &frame.image {
            frame.image = ImageSource::Memory(Arc::new(image.resized(width, height)));
        }
    }
    scene
}

/// A mask over all of some photos.
fn covered(views: usize, which: impl Fn(usize) -> bool) -> Scene {
    pictures(perturb(tiny_scene(views, 0.82), PerturbationKind::Both, 3), |k, image| {
        let mut image = image.clone();
        image.mask = which(k).then(|| vec![0; (image.width * image.height) as usize]);
        image
    })
}

/// Reconstructed points, and features of them in some photos.
fn with_points(has: impl Fn(usize) -> bool, length: u32) -> Scene {
    let mut scene = opaque(4, |k, i| ((i * 7 + k) % 251) as u8);
    let at = |k: u32| DVec3::new(f64::from(k % 3) - 1.0, f64::from(k / 3) - 1.0, 0.0) * 0.3;
    scene.points = (0..9).map(|k| Point { xyz: at(k), rgb: [100, 120, 140] }).collect();
    for (k, frame) in scene.frames.iter_mut().enumerate().filter(|(k, _)| has(*k)) {
        let track = |point: u32| TrackPoint { pixel: [(point + k as u32) as f32, 1.5 * point as f32], point, length };
        frame.tracks = (0..9).map(track).collect();
    }
    scene
}

fn all() -> Vec<Case> {
    let plain = |what, scene| Case { what, scene, set: &[], refuse: NOBODY };
    let noise = |k: usize, i: usize| ((i * (2 * k + 3) * 40_503) >> 7) as u8;
    let mut identical = perturb(tiny_scene(3, 0.82), PerturbationKind::Both, 3);
    let first = identical.frames[0].clone();
    for frame in &mut identical.frames {
        (frame.image, frame.camera, frame.perturbation) =
            (first.image.clone(), first.camera, first.perturbation.clone());
    }
    let mut alike = perturb(tiny_scene(3, 0.82), PerturbationKind::Both, 3);
    let first = alike.frames[0].clone();
    for frame in &mut alike.frames {
        (frame.image, frame.perturbation) = (first.image.clone(), first.perturbation.clone());
    }
    let some_alpha = pictures(tiny_scene(4, 0.82), |k, image| {
        if k % 2 == 0 {
            return image.clone();
        }
        let rgb = image.data.chunks(usize::from(image.channels)).flat_map(|p| [p[0], p[1], p[2]]).collect();
        Image::rgb(image.width, image.height, rgb).unwrap()
    });
    let clear = pictures(tiny_scene(3, 0.82), |_, image| {
        Image::rgba(image.width, image.height, vec![0; (image.width * image.height * 4) as usize]).unwrap()
    });
    let batch: fn(&str) -> Option<&'static [&'static str]> = |name| match name {
        "robust-nerf" => Some(&["`patch`", "must fit"]),
        _ => ENCODERS(name),
    };
    vec![
        plain("one photo", perturb(tiny_scene(1, 0.82), PerturbationKind::Both, 3)),
        plain("two photos of different sizes", sized(2, |k| [(16, 16), (40, 24)][k % 2])),
        plain("photos in upright and in lying format", sized(4, |k| [(16, 48), (48, 16)][k % 2])),
        Case { refuse: ENCODERS, ..plain("photos of 1x1 pixel", sized(4, |_| (1, 1))) },
        Case { refuse: ENCODERS, ..plain("photos of 2x1 and 1x3 pixels", sized(4, |k| [(2, 1), (1, 3)][k % 2])) },
        Case { refuse: ENCODERS, ..plain("photos of 3x3 pixels", sized(4, |_| (3, 3))) },
        Case {
            refuse: ENCODERS,
            ..plain("one photo of 1x1 pixel among others", sized(4, |k| [(16, 16), (1, 1)][k / 3]))
        },
        Case { refuse: ENCODERS, ..plain("one photo of one pixel", sized(1, |_| (1, 1))) },
        Case {
            set: &["judging=batch"],
            refuse: batch,
            ..plain("photos of 3x3 pixels, judged in patches", sized(4, |_| (3, 3)))
        },
        plain("black photos", opaque(4, |_, _| 0)),
        plain("white photos", opaque(4, |_, _| 255)),
        plain("photos of 0 and 255 by turns", opaque(4, |_, i| if i / 3 % 2 == 0 { 0 } else { 255 })),
        plain("black and white photos by turns", opaque(4, |k, _| if k % 2 == 0 { 0 } else { 255 })),
        plain("transparent photos", clear),
        plain("nothing but occluders", opaque(4, noise)),
        plain("a mask over all of one photo", covered(4, |k| k == 1)),
        plain("masks over all of all photos", covered(4, |_| true)),
        plain("one photo, and a mask over all of it", covered(1, |_| true)),
        Case { set: &["accept_no_parallax=true"], ..plain("identical photos from one place", identical) },
        plain("identical pictures from several places", alike),
        plain("alpha in every other photo", some_alpha),
        plain("features in all photos but one", with_points(|k| k != 2, 3)),
        plain("features in one photo", with_points(|k| k == 2, 1)),
        plain("features that no photo shares", with_points(|_| true, 0)),
        plain("points without features", with_points(|_| false, 0)),
    ]
}

/// Without settings of parts that the system does not have.
fn of_system<'a>(name: &str, set: &[&'a str]) -> Vec<&'a str> {
    set.iter().copied().filter(|s| name == "robust-nerf" || !s.starts_with("judging=")).collect()
}

pub(crate) fn cases(tally: &mut Tally) {
    for Case { what, scene, set, refuse } in all() {
        let data = dataset(&scene);
        for name in ["robust-nerf", "nerf-w", "ha-nerf", "ha-nerf-t", "sf-nerf", "hugs"].into_iter().chain(CLOUDS) {
            tally.case(
                format!("{name}, {what}"),
                "trains, everything finite, or one line that says why not",
                || match (build(name, &scene, &data, &of_system(name, set)), refuse(name)) {
                    (Ok(mut system), None) => trains(system.as_mut(), &data, STEPS),
                    (Err(e), Some(words)) => says(&e, words),
                    (Ok(_), Some(_)) => Err("taken".into()),
                    (Err(e), None) => Err(e.to_string()),
                },
            );
        }
        let mlp: Vec<&str> = set.iter().copied().chain(["field=mlp", "judging=photos"]).collect();
        for name in ["robust-nerf", "nerf-w", "ha-nerf-t", "sf-nerf"] {
            tally.case(format!("{name} on the published networks, {what}"), "trains, everything finite", || {
                let mut system = build(name, &scene, &data, &of_system(name, &mlp)).map_err(|e| e.to_string())?;
                trains(system.as_mut(), &data, STEPS)
            });
        }
    }
    // Each of these is a training of its own size.
    for Case { what, scene, .. } in all().into_iter().filter(|case| LOOKED_AT.contains(&case.what)) {
        tally.case(format!("auto, {what}"), "trains, everything finite", || {
            let data = dataset(&scene);
            let mut system = build("auto", &scene, &data, &[]).map_err(|e| e.to_string())?;
            trains(system.as_mut(), &data, STEPS)
        });
    }
    tally.case("no photo at all", "no panic, everything finite, or one error", || {
        let scene = tiny_scene(0, 0.82);
        let data = dataset(&scene);
        for name in METHODS.into_iter().chain(["auto"]).chain(CLOUDS) {
            match build(name, &scene, &data, &[]) {
                Ok(mut system) => trains(system.as_mut(), &data, STEPS)?,
                Err(e) => says(&e, &[])?,
            }
        }
        Ok(())
    });
}

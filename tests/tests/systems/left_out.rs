//! Rows of the table of skips for training pixels that are drawn but not rendered: they count what masks say.

use engine::data::{Batch, Dataset, Patches, Shape};
use engine::options::{Background, RunOptions, parse_set};
use engine::system::{SkipRow, System};
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{Image, ImageSource, PerturbationKind, Scene, perturb};
use std::sync::Arc;
use tests::views;

const SEED: u64 = 3;
const STEPS: u64 = 9;
const IGNORED: &str = "ignore";
const OCCLUDERS: &str = "occluders";

/// 24x24 pixels, with what each photo's mask shows of itself where there is one.
fn scene(mask: Option<fn(u32) -> u8>) -> (Scene, Dataset) {
    let options = TabletopOptions { width: 24, height: 24, train: 6, test: 0, rays: 1, ..TabletopOptions::default() };
    let mut scene = perturb(tabletop(&options), PerturbationKind::Both, 3);
    for frame in &mut scene.frames {
        if let (ImageSource::Memory(image), Some(mask)) = (&frame.image, mask) {
            let of = |i: u32| mask(i % 24);
            let image = Image { mask: Some((0..24 * 24).map(of).collect()), ..(**image).clone() };
            frame.image = ImageSource::Memory(Arc::new(image));
        }
    }
    let train = views(&scene, 1).0;
    (scene, train)
}

fn system(name: &str, (scene, train): &(Scene, Dataset), set: &[&str]) -> Box<dyn System> {
    let small: &[&str] = match name {
        "robust-nerf" => &["judge_first=4", "patch=8", "patch_inner=4"],
        "hugs" => &["warmup_steps=4", "patch=8", "patch_inner=4"],
        _ => &[],
    };
    let set = small.iter().chain(set).map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: SEED, background: Some(Background::White), error_budget: None, stop: None, set };
    systems::registry::build(name, scene, train, &run).unwrap().0
}

const NGP: &[&str] =
    &["levels=4", "log2_table=10", "n_max=64", "batch_rays=512", "batch_samples=8192", "rays_per_side=1"];
const MLP: &[&str] = &["field=mlp", "width=16", "depth=2", "coarse=4", "fine=4", "batch_rays=256"];

fn row(system: &dyn System, word: &str) -> Option<SkipRow> {
    system.skips().into_iter().find(|row| row.what.contains(word))
}

fn counts(system: &dyn System, word: &str) -> Option<(u64, u64)> {
    row(system, word).map(|row| (row.skipped, row.total))
}

#[test]
fn pixels_that_a_file_ignores_are_counted() {
    let patches = Patches { shape: Shape::Window, side: 8 };
    let some = scene(Some(|x| if x < 10 { 0 } else { 255 }));
    let set: Vec<&str> = NGP.iter().copied().chain(["judging=batch"]).collect();
    let mut trained = system("robust-nerf", &some, &set);
    let (mut ignored, mut drawn, mut batch) = (0, 0, Batch::default());
    for step in 0..STEPS {
        let rays = trained.step(&some.1, step).unwrap().rays;
        some.1.draw_patches(SEED, step, rays as usize / patches.pixels(), patches, &mut batch).unwrap();
        ignored += batch.pixel.iter().filter(|[x, _]| *x < 10).count() as u64;
        drawn += rays;
    }
    assert_eq!(counts(trained.as_ref(), IGNORED), Some((ignored, drawn)));
    assert!(ignored > drawn / 4 && row(trained.as_ref(), IGNORED).unwrap().bound.starts_with("0:"));
    assert!(row(trained.as_ref(), OCCLUDERS).is_none(), "this method weighs pixels, and leaves none out");

    // Where a mask covers everything no other pixel is found instead.
    let all = scene(Some(|_| 0));
    let mut trained = system("plain", &all, NGP);
    let drawn = (0..3).map(|step| trained.step(&all.1, step).unwrap().rays).sum();
    assert_eq!(counts(trained.as_ref(), IGNORED), Some((drawn, drawn)));
}

#[test]
fn pixels_of_occluders_are_counted() {
    for (name, field) in [("robust-nerf", NGP), ("hugs", NGP), ("robust-nerf", MLP), ("hugs", MLP)] {
        let set: Vec<&str> = field
            .iter()
            .copied()
            .chain(if name == "hugs" {
                ["restart=anew", "segments=pixels"]
            } else {
                ["judging=photos", "judge_first=4"]
            })
            .chain(["judge_scale=1.5"])
            .collect();
        let data = scene(None);
        let mut trained = system(name, &data, &set);
        let (mut occluders, mut drawn, mut batch) = (0, 0, Batch::default());
        for step in 0..STEPS {
            let rays = trained.step(&data.1, step).unwrap().rays;
            drawn += rays;
            // A field that began anew draws by its own steps.
            let since = if name == "hugs" && step >= 4 { step - 4 } else { step };
            data.1.draw(SEED, since, rays as usize, &mut batch).unwrap();
            let maps: Vec<Option<Vec<f32>>> =
                (0..data.1.len()).map(|view| trained.visibility(&data.1, view).unwrap()).collect();
            let gone = |(&view, &[x, y]): (&u32, &[u16; 2])| {
                maps[view as usize].as_ref().is_some_and(|map| map[usize::from(y) * 24 + usize::from(x)] == 0.0)
            };
            occluders += batch.view.iter().zip(&batch.pixel).filter(|pixel| gone(*pixel)).count() as u64;
            if occluders == 0 {
                assert!(row(trained.as_ref(), OCCLUDERS).is_none(), "{name}: no occluder was found yet");
            }
        }
        let at = format!("{name} {field:?}");
        assert_eq!(counts(trained.as_ref(), OCCLUDERS), Some((occluders, drawn)), "{at}");
        assert!(occluders > 0 && row(trained.as_ref(), IGNORED).is_none(), "{at}");
    }
}

#[test]
fn without_masks_there_is_no_row() {
    let data = scene(None);
    for name in ["plain", "nerf-w", "ha-nerf-t", "sf-nerf", "robust-nerf"] {
        let mut trained = system(name, &data, NGP);
        for step in 0..3 {
            trained.step(&data.1, step).unwrap();
        }
        assert!(row(trained.as_ref(), IGNORED).is_none() && row(trained.as_ref(), OCCLUDERS).is_none(), "{name}");
    }
}

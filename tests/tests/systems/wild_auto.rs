//! What `auto` decides about appearance and occluders: on clean photos, on photos with other colours, with something in front, with
//! both, on an object before a backdrop, and on a place with passers-by.

use engine::data::Dataset;
use engine::options::{Background, RunOptions};
use engine::system::System;
use scene_io::synthetic::{PlazaOptions, TabletopOptions, plaza, tabletop};
use scene_io::{
    Image, ImageSource, LayoutHint, LoadOptions, MaskPolarity, PerturbationKind, Scene, Split, TrainPhotos, perturb,
};
use std::sync::Arc;
use systems::registry::build;
use testkit::golden::data_or_skip;
use tests::views;

/// What was decided: appearance, occluders; and the lines about it.
fn decided(scene: &Scene, background: Option<Background>) -> ([String; 2], String) {
    let (_, plan) = built(scene, &views(scene, 1).0, background);
    let word = |key: &str| plan.config[key].as_str().unwrap().to_string();
    let about = |line: &&String| line.starts_with("appearance:") || line.starts_with("occluders:");
    let lines: Vec<&str> = plan.lines.iter().filter(about).map(String::as_str).collect();
    println!("{}", lines.join("\n"));
    ([word("appearance"), word("occluders")], lines.join("\n"))
}

fn built(scene: &Scene, train: &Dataset, background: Option<Background>) -> (Box<dyn System>, engine::options::Plan) {
    let run = RunOptions { seed: 0, background, error_budget: None, stop: None, set: Default::default() };
    build("auto", scene, train, &run).unwrap()
}

fn table() -> Scene {
    tabletop(&TabletopOptions { width: 48, height: 48, train: 24, test: 1, rays: 2, ..TabletopOptions::default() })
}

/// The table as a photographer cuts it out: before plain white, without alpha, each photo of its own brightness.
fn before_white(range: f32) -> Scene {
    let mut scene = table();
    for (i, frame) in scene.frames.iter_mut().enumerate() {
        let ImageSource::Memory(image) = &frame.image else { panic!("a drawn scene is in memory") };
        let gain = [0, 1, 2].map(|c| 1.0 + range * (((i * 7 + c * 2) % 11) as f32 / 5.0 - 1.0));
        let pixel = |p: &[u8]| -> [u8; 3] {
            let alpha = f32::from(p[3]) / 255.0;
            [0, 1, 2].map(|c| ((f32::from(p[c]) * gain[c]).min(255.0) * alpha + 255.0 * (1.0 - alpha)).round() as u8)
        };
        let data = image.data.chunks_exact(4).flat_map(pixel).collect();
        frame.image = ImageSource::Memory(Arc::new(Image::rgb(image.width, image.height, data).unwrap()));
    }
    Scene { layout: LayoutHint::Unknown, bounds: None, ..scene }
}

#[test]
fn perturbed_photos_get_what_they_need_and_clean_ones_nothing() {
    for (what, appearance, occluders) in [
        (None, "none", "none"),
        (Some(PerturbationKind::Colour), "codes", "none"),
        (Some(PerturbationKind::Occluder), "none", "robust"),
        (Some(PerturbationKind::Both), "codes", "robust"),
    ] {
        let scene = what.map_or_else(table, |what| perturb(table(), what, 0));
        let (decided, lines) = decided(&scene, None);
        assert_eq!(decided, [appearance, occluders], "{what:?}: {lines}");
    }
}

#[test]
fn an_object_before_a_backdrop_is_not_an_occluder() {
    for range in [0.0, 0.3] {
        let ([appearance, occluders], lines) = decided(&before_white(range), Some(Background::White));
        assert_eq!(occluders, "none", "{range}: {lines}");
        // A code too many costs little where photos are alike.
        assert!(range == 0.0 || appearance == "codes", "{lines}");
    }
}

#[test]
fn passers_by_on_a_square_are_occluders() {
    let options = PlazaOptions { width: 96, height: 72, rays: 2, ..PlazaOptions::default() };
    let (found, lines) = decided(&plaza(&options), None);
    assert_eq!(found, ["codes", "robust"], "{lines}");
    let (found, lines) = decided(&plaza(&PlazaOptions { photos: TrainPhotos::Clean, ..options }), None);
    assert_eq!(found, ["none", "none"], "{lines}");
}

/// The training photos of a real scene, scaled to `side` pixels.
fn real(name: &str, test: &str, side: u32, options: &LoadOptions) -> Option<(Scene, Dataset)> {
    let path = data_or_skip(env!("CARGO_MANIFEST_DIR"), name, test)?;
    let scene = scene_io::load(&path, options).unwrap();
    let store = scene_io::StoreOptions::default().with_longest_side(side).with_budget_bytes(1 << 30);
    let store = Arc::new(scene_io::ImageStore::new(&scene.frames, store).unwrap());
    let train = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
    Some((scene, train))
}

#[test]
fn the_carton_and_the_statue_are_not_occluders() {
    const TEST: &str = "the_carton_and_the_statue_are_not_occluders";
    let object = LoadOptions::default().with_mask_polarity(MaskPolarity::WhiteIsObject);
    for (name, options, background) in [
        ("neroic_like/milk", LoadOptions::default(), Some(Background::White)),
        ("nerd_in_the_wild/statue_of_liberty_40", object, None),
    ] {
        let Some((scene, train)) = real(name, TEST, 160, &options) else { return };
        let (_, plan) = built(&scene, &train, background);
        assert_eq!(plan.config["occluders"].as_str(), Some("none"), "{name}: {:#?}", plan.lines);
        assert_eq!(plan.config["appearance"].as_str(), Some("codes"), "{name}: {:#?}", plan.lines);
    }
}

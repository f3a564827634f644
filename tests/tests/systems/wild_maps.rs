//! Clouds that read their colours in a reference photo: any photo has an appearance without a fit, and it is worth what it costs.

use crate::wild_clouds::{SIDE, check_bits, check_worth, off, photo, scene, trained};
use engine::halt::Halt;
use engine::options::{RunOptions, parse_set};
use engine::render::{plain_query, render};
use engine::system::{Appearance, Fit, Query};
use scene_io::PerturbationKind;
use std::sync::Arc;
use systems::registry::build;
use systems::splats::Cloud;
use tests::views;

const NAME: &str = "gs-w";

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let field = ["start=field", "field_steps=3", "refill=0.5", "judge_first=1"];
    check_bits(NAME, &[&["judge_first=2"], &["occluders=visibility", "judge_from=0.0"], &field]);
}

#[test]
fn an_appearance_changes_colours_alone_is_read_off_another_photo_and_baked() {
    let scene = scene(8, PerturbationKind::Colour);
    let train = views(&scene, 1).0;
    let system = trained(NAME, &scene, &train, &["occluders=none"], 300);
    let camera = train.view(0).camera;
    let query = |appearance| Query { appearance, ..plain_query([1.0; 3], 0.0) };
    let shown = |appearance| render(system.as_ref(), &camera, &query(appearance)).layers;
    let [a, b, mean] = [Appearance::View(0), Appearance::View(1), Appearance::Mean].map(shown);
    assert!(a.depth == b.depth && a.opacity == b.opacity && a.median_depth == b.median_depth);
    assert!(off(&a.rgb, &b.rgb) > 0.02, "two photos of different appearance are nearly the same");
    let code: Arc<[f32]> = system.appearance_code(&Appearance::View(1)).unwrap().into();
    assert_eq!(shown(Appearance::Code(code)).rgb, b.rgb);

    // From the left half of a photo, the right half; and from the whole of it, without its camera.
    let view = train.view(0);
    let left = |i: &usize| i % (SIDE as usize) < SIDE as usize / 2;
    let truth = photo(&train, 0);
    let rays: Vec<_> = view.rays(0..camera.height).map(Option::unwrap).collect();
    let half: Vec<usize> = (0..truth.len()).filter(left).collect();
    let (rays, rgb): (Vec<_>, Vec<_>) = half.iter().map(|&i| (rays[i], truth[i])).unzip();
    let fit = Fit {
        rays: &rays,
        rgb: &rgb,
        time: 0.0,
        background: [1.0; 3],
        steps: 200,
        lr: 0.05,
        seed: 1,
        halt: &Halt::NEVER,
    };
    let found = shown(Appearance::Code(system.fit_appearance(&fit).unwrap().into()));
    let encoded = shown(Appearance::Code(system.encode_appearance(&train.image(0).unwrap()).unwrap().into()));
    let right = |rgb: &[[f32; 3]]| -> Vec<[f32; 3]> { (0..rgb.len()).filter(|i| !left(i)).map(|i| rgb[i]).collect() };
    let far = |rgb: &[[f32; 3]]| off(&right(rgb), &right(&truth));
    let (of_half, of_whole, of_mean) = (far(&found.rgb), far(&encoded.rgb), far(&mean.rgb));
    println!("off by {of_half} from the left half, {of_whole} without camera, {of_mean} in the mean appearance");
    // Eight photos teach an encoder little: a photo that it is asked for is no further off than the mean, about.
    assert!(of_half < 1.2 * of_mean && of_whole < 1.2 * of_mean, "{of_half} {of_whole} {of_mean}");

    // Baked, it is what was rendered, but where colours were cut off at 0.
    let baked = system.splats(&query(Appearance::View(1))).unwrap();
    let picture = Cloud::exact(baked).render(&camera, &query(Appearance::Mean)).unwrap().layers;
    let far = off(&picture.rgb, &b.rgb);
    println!("baked: off by {far}");
    assert!(far < 0.06, "baked: off by {far}");
}

#[test]
fn maps_of_each_photo_are_worth_what_they_cost() {
    check_worth(NAME);
}

#[test]
fn a_setting_that_cannot_work_is_named() {
    let scene = scene(2, PerturbationKind::Both);
    let train = views(&scene, 1).0;
    for (set, word) in [
        ("encoder_side=20", "encoder_side"),
        ("sampled_maps=5", "sampled_maps"),
        ("map_channels=0", "map_channels"),
        ("encoder_lr=0.2", "encoder_lr"),
        ("appearance_dims=8", "appearance_dims"),
        ("appearance=encoder", "appearance"),
        ("visibility_weight=0.1", "visibility_weight"),
    ] {
        let set = [parse_set(set).unwrap()].into_iter().collect();
        let run = RunOptions { seed: 3, background: None, error_budget: None, stop: None, set };
        let error = build(NAME, &scene, &train, &run).err().map(|e| e.to_string());
        assert!(error.as_ref().is_some_and(|e| e.contains(word)), "{word}: {error:?}");
    }
}

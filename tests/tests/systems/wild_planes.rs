//! Clouds that read their colours in a photo which is projected back into the scene; depth files shape their depth.

use crate::wild_clouds::{
    check_bits, check_named, check_read_off, check_worth, off_photos, planned, scene, system, trained,
};
use engine::data::Dataset;
use engine::render::{plain_query, render};
use engine::system::{Appearance, Query, System};
use losses::depth::pearson::pearson;
use scene_io::synthetic::Tabletop;
use scene_io::{DepthMap, DepthMeaning, DepthSource, ImageSource, PerturbationKind, Scene};
use std::sync::Arc;
use tests::{assert_same_bits, state_after, views};

const NAME: &str = "wild-gs";

/// The same photos with their true depth as files of other programs have it; `of` changes each map.
fn with_depths(mut scene: Scene, of: impl Fn(&mut DepthMap)) -> Scene {
    let table = Tabletop::new(0);
    for frame in &mut scene.frames {
        let truth = table.truth(&frame.camera);
        let z = truth.distance.iter().map(|t| *t as f32).collect();
        let mut map = DepthMap::new(truth.width, truth.height, z).unwrap();
        of(&mut map);
        frame.depth = Some(DepthSource { meaning: DepthMeaning::Distance, ..DepthSource::memory(map) });
    }
    scene
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let field = ["start=field", "field_steps=3", "refill=0.5", "judge_first=1", "plane_from=0.0"];
    let late = ["judge_first=2", "plane_from=0.005"];
    check_bits(
        NAME,
        &[&late, &["occluders=visibility", "plane_from=0.0"], &["photo_dims=0", "plane_from=0.0"], &field],
    );
    let scene = with_depths(scene(8, PerturbationKind::Both), |_| {});
    assert_same_bits(|steps, state| {
        let train = views(&scene, 1).0;
        state_after(system(NAME, &scene, &train, &["judge_first=2", "depth_weight=0.5"]), &train, steps, state)
    });
}

#[test]
fn an_appearance_changes_colours_alone_is_read_off_another_photo_and_baked() {
    check_read_off(NAME);
}

#[test]
fn planes_and_tones_of_each_photo_are_worth_what_they_cost() {
    check_worth(NAME, 2.8);
}

/// Mean over the training photos of how unlike the shapes of rendered nearness and of the true one are.
fn unlike(system: &dyn System, train: &Dataset, scene: &Scene) -> f64 {
    let of = |view: usize| {
        let query = Query { appearance: Appearance::View(view), ..plain_query([1.0; 3], 0.0) };
        let layers = render(system, &train.view(view).camera, &query).layers;
        let truth = Tabletop::new(0).truth(&scene.frames[train.view(view).frame].camera).distance;
        let seen = |i: &usize| truth[*i].is_finite() && layers.opacity[*i] > 0.5;
        let both: Vec<usize> = (0..truth.len()).filter(seen).collect();
        let near = |of: &dyn Fn(usize) -> f32| -> Vec<f32> { both.iter().map(|i| 1.0 / of(*i)).collect() };
        pearson(&near(&|i| layers.depth[i]), &near(&|i| truth[i] as f32), 64).unwrap()
    };
    (0..train.len()).map(of).sum::<f64>() / train.len() as f64
}

#[test]
fn depth_files_shape_the_depth_and_a_plan_says_whether_there_are_any() {
    let (plain, scene) = (scene(8, PerturbationKind::Colour), with_depths(scene(8, PerturbationKind::Colour), |_| {}));
    let train = views(&scene, 1).0;
    let line = |scene: &Scene, set: &[&str]| {
        let lines = planned(NAME, scene, &views(scene, 1).0, set).unwrap().1.lines;
        lines.into_iter().find(|line| line.starts_with("depth: "))
    };
    assert!(line(&scene, &[]).unwrap().contains("weight 0.05"));
    assert!(line(&plain, &[]).unwrap().contains("no photo has a file"));
    assert!(line(&plain, &["depth_weight=0"]).is_none() && line(&scene, &["depth_weight=0"]).is_none());
    let of = |set: &[&str]| {
        let system = trained(NAME, &scene, &train, &[&["occluders=none"], set].concat(), 300);
        (unlike(system.as_ref(), &train, &scene), off_photos(system.as_ref(), &train))
    };
    let ((with, error), (without, plain_error)) = (of(&[]), of(&["depth_weight=0"]));
    println!("unlike by {with} with depth files, {without} without; photos are off by {error}, {plain_error}");
    assert!(with < 0.8 * without && error < 1.1 * plain_error);
}

/// It trains for a few steps, planes from the first on; renders and masks of photos are finite.
fn trains(what: &str, scene: &Scene, set: &[&str]) {
    let train = views(scene, 1).0;
    let all = [&["plane_from=0.0"], set].concat();
    let system = trained(NAME, scene, &train, &all, 8);
    for view in 0..train.len() {
        for appearance in [Appearance::View(view), Appearance::Mean] {
            let query = Query { appearance, ..plain_query([1.0; 3], 0.0) };
            let layers = render(system.as_ref(), &train.view(view).camera, &query).layers;
            assert!(layers.rgb.as_flattened().iter().all(|x| x.is_finite()), "{what}");
        }
        let code = system.encode_appearance(&train.image(view).unwrap()).unwrap();
        assert!(code.iter().all(|x| x.is_finite()), "{what}");
    }
}

#[test]
fn photos_that_say_little_train_and_a_broken_file_is_named() {
    let few = || scene(4, PerturbationKind::Both);
    trains("no depth files", &few(), &["judge_first=3"]);
    trains("one photo", &scene(1, PerturbationKind::Both), &[]);
    trains("flat depth", &with_depths(few(), |map| map.z.fill(3.0)), &["depth_weight=10"]);
    trains("no depth is known", &with_depths(few(), |map| map.z.fill(0.0)), &[]);
    let mut some = with_depths(few(), |_| {});
    some.frames[1].depth = None;
    trains("one photo has no depth", &some, &["depth_weight=10"]);
    let mut covered = few();
    for frame in &mut covered.frames {
        if let ImageSource::Memory(image) = &mut frame.image {
            let mut masked = (**image).clone();
            masked.mask = Some(vec![0; (masked.width * masked.height) as usize]);
            *image = Arc::new(masked);
        }
    }
    trains("masks over all of all photos", &covered, &[]);
    trains("nothing is seen", &few(), &["start_count=1"]);
    trains("the paper's mask leaves nothing", &few(), &["occluders=visibility", "visibility_weight=1e-30"]);

    let mut broken = few();
    broken.frames[2].depth = Some(DepthSource::file("no/such/depth.npy"));
    let train = views(&broken, 1).0;
    let error = planned(NAME, &broken, &train, &[]).err().map(|e| e.to_string());
    assert!(error.as_ref().is_some_and(|e| e.contains("no/such/depth.npy")), "{error:?}");
    assert!(planned(NAME, &broken, &train, &["depth_weight=0"]).is_ok());
}

#[test]
fn a_setting_that_cannot_work_is_named() {
    let of_planes = ["encoder_side=20", "plane_side=8", "plane_channels=0", "plane_crop=0.6", "plane_from=2.0"];
    check_named(NAME, &of_planes);
    check_named(
        NAME,
        &["photo_dims=300", "encoder_lr=0.2", "depth_weight=-1.0", "map_channels=2", "appearance=encoder"],
    );
}

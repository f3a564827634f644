use super::*;
use crate::synthetic::{TabletopOptions, tabletop};
use crate::{Image, ImageStore, StoreOptions};
use glam::DVec3;

fn scene(train: usize) -> Scene {
    tabletop(&TabletopOptions { width: 96, height: 72, train, test: 1, ..TabletopOptions::default() })
}

fn thumbs(scene: &Scene, change: impl Fn(usize, Image) -> Image) -> Vec<Option<Thumb>> {
    let store = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    (0..store.len()).map(|i| Some(Thumb::of(&change(i, (*store.get(i).unwrap()).clone())))).collect()
}

/// As a camera takes it: without alpha.
fn before_black(image: &Image) -> Image {
    let pixels = image.data.chunks_exact(usize::from(image.channels));
    let over = |p: &[u8], c: usize| (u32::from(p[c]) * u32::from(*p.get(3).unwrap_or(&255)) / 255) as u8;
    Image::rgb(image.width, image.height, pixels.flat_map(|p| [0, 1, 2].map(|c| over(p, c))).collect()).unwrap()
}

/// Means over squares of 9 x 9 pixels.
fn blurred(image: &Image) -> Image {
    let (w, h) = (image.width as i32, image.height as i32);
    let at = |x: i32, y: i32, c: usize| u32::from(image.pixel(x.clamp(0, w - 1) as u32, y.clamp(0, h - 1) as u32)[c]);
    let mean = |x: i32, y: i32, c: usize| (0..81).map(|k| at(x + k % 9 - 4, y + k / 9 - 4, c)).sum::<u32>() / 81;
    let data = (0..h)
        .flat_map(|y| (0..w).flat_map(move |x| (0..3).map(move |c| (x, y, c))))
        .map(|(x, y, c)| mean(x, y, c) as u8);
    Image::rgb(image.width, image.height, data.collect()).unwrap()
}

fn lines(problems: &[Problem]) -> Vec<String> {
    problems.iter().map(|p| p.what.clone()).collect()
}

#[test]
fn a_good_capture_has_no_finding() {
    let scene = scene(60);
    let found = find_problems(&scene, &thumbs(&scene, |_, image| image));
    assert!(found.is_empty(), "{:?}", lines(&found));
}

#[test]
fn a_folded_model_is_noticed_by_its_pictures() {
    let mut scene = scene(60);
    // Photos of the far side get cameras that stand where those of the near side do.
    let trained: Vec<usize> = scene.split(Split::Train).collect();
    let opposite = |c: DVec3, other: DVec3| (c.truncate() + other.truncate()).length() + (c.z - other.z).abs();
    for k in 0..6 {
        let i = trained[k];
        let c = scene.frames[i].camera.pose.c;
        let j = *trained[6..]
            .iter()
            .min_by(|a, b| {
                let d = |j: usize| opposite(c, scene.frames[j].camera.pose.c);
                d(**a).total_cmp(&d(**b))
            })
            .unwrap();
        scene.frames[i].camera.pose = scene.frames[j].camera.pose;
    }
    let found = lines(&find_problems(&scene, &thumbs(&scene, |_, image| image)));
    assert!(found.iter().any(|line| line.starts_with("cameras contradict each other")), "{found:?}");
}

#[test]
fn exposure_jumps_and_blur_are_noticed() {
    let scene = scene(120);
    let darker = |i: usize, image: Image| {
        let mut image = before_black(&image);
        if i.is_multiple_of(3) {
            image.data.iter_mut().for_each(|v| *v = (f32::from(*v) * 0.6) as u8);
        }
        image
    };
    let dark = thumbs(&scene, darker);
    let problems = find_problems(&scene, &dark);
    let found = lines(&problems);
    let photos: Vec<Photo<'_>> = photos(&scene, &dark);
    let pairs: Vec<_> = neighbours(&photos).iter().map(|n| (n.photos, n.agreement)).collect();
    assert!(found.iter().any(|line| line.starts_with("exposure jumps")), "{found:?} of {pairs:?}");
    // As a person reads it: of a drawn scene, which has no folder, by its name; and no program is named.
    let line = problems.iter().map(Problem::to_string).find(|line| line.contains("exposure jumps")).unwrap();
    assert!(
        scene.root.as_os_str().is_empty() && line.starts_with(&format!("{}: exposure jumps", scene.name)),
        "{line}"
    );
    assert!(line.contains("a system that learns the appearance of each photo") && !line.contains("nerf-"), "{line}");
    let soft = |i: usize, image: Image| {
        let image = before_black(&image);
        if i == 7 { blurred(&image) } else { image }
    };
    let found = lines(&find_problems(&scene, &thumbs(&scene, soft)));
    assert!(found.iter().any(|line| line.contains(&format!("neighbours: {}", scene.frames[7].name))), "{found:?}");
}

#[test]
fn few_photos_and_points_behind_a_camera_are_noticed() {
    let mut scene = scene(5);
    let z = scene.frames[2].camera.optical_axis();
    let behind = scene.frames[2].camera.pose.c - z;
    scene.points = vec![crate::Point { xyz: behind, rgb: [0; 3] }];
    scene.frames[2].tracks = vec![crate::TrackPoint { point: 0, ..track() }];
    let found = lines(&without_pictures(&scene));
    assert!(found[0].starts_with("5 training photos are few"), "{found:?}");
    assert!(found[1].contains(&scene.frames[2].name) && found[1].contains("behind its camera"), "{found:?}");
    scene.frames.clear();
    assert!(find_problems(&scene, &[]).is_empty());
}

fn track() -> crate::TrackPoint {
    let camera = scene(2).frames[0].camera;
    crate::TrackPoint { point: 0, pixel: [camera.cx as f32, camera.cy as f32], length: 2 }
}

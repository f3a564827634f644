//! Priors of a small drawn scene.

use super::*;
use crate::flow::flow_both_ways;
use crate::watch::Silent;
use scene_io::synthetic::{OrbitCamera, OrbitOptions, orbit, write_orbit};
use scene_io::{LoadOptions, MotionFiles, Split, load};

fn options(camera: OrbitCamera) -> OrbitOptions {
    OrbitOptions { width: 40, height: 36, train: 5, test: 1, rays: 1, camera, ..OrbitOptions::default() }
}

fn scene(camera: OrbitCamera) -> Scene {
    orbit(&options(camera))
}

fn request<'a>(scene: &'a Scene, out: &Path) -> PriorsRequest<'a> {
    PriorsRequest { scene, out: out.to_path_buf(), frames: None, longest_side: None }
}

/// Every file below a folder but the markers, by its path from there, with its bytes.
fn files_in(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let (mut found, mut open) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_string_lossy().replace('\\', "/");
            match path.is_dir() {
                true if name == MADE => {}
                true => open.push(path),
                false => found.push((name, std::fs::read(&path).unwrap())),
            }
        }
    }
    found.sort();
    found
}

fn names_in(folder: &Path) -> Vec<String> {
    files_in(folder).into_iter().map(|(name, _)| name).collect()
}

/// Asks to stop once so many parts are done.
struct Impatient {
    parts: usize,
    most: usize,
}

impl Watch for Impatient {
    fn event(&mut self, event: Event<'_>) {
        if let Event::Part { .. } = event {
            self.parts += 1;
        }
    }

    fn stop_asked(&self) -> bool {
        self.parts >= self.most
    }
}

#[test]
fn each_training_photo_has_flow_to_its_neighbours_and_a_mask() {
    let (folder, scene) = (tempfile::tempdir().unwrap(), scene(OrbitCamera::Walking));
    let out = folder.path().join("priors");
    let summary = priors(&request(&scene, &out), &mut Silent).unwrap();
    assert_eq!((summary.photos, summary.kept, summary.alone.len()), (5, 0, 0));
    let mut wanted = Vec::new();
    for i in 0..5 {
        wanted.extend((i > 0).then(|| format!("flow/train/r_{i:03}_bwd.flo")));
        wanted.extend((i < 4).then(|| format!("flow/train/r_{i:03}_fwd.flo")));
        wanted.push(format!("motion_masks/train/r_{i:03}.png"));
    }
    wanted.sort();
    assert_eq!(names_in(&out), wanted);
    // 12 bytes of header, 8 for each pixel.
    assert!(files_in(&out).iter().all(|(name, bytes)| name.ends_with(".png") || bytes.len() == 12 + 8 * 40 * 36));
}

#[test]
fn what_is_there_is_kept_and_what_changed_is_made_anew() {
    let (folder, mut scene) = (tempfile::tempdir().unwrap(), scene(OrbitCamera::Walking));
    let out = folder.path().join("priors");
    priors(&request(&scene, &out), &mut Silent).unwrap();
    let first = files_in(&out);
    assert_eq!(priors(&request(&scene, &out), &mut Silent).unwrap().kept, 5);

    // A file that is gone is made again, with the same bytes.
    std::fs::remove_file(out.join("flow/train/r_002_fwd.flo")).unwrap();
    assert_eq!(priors(&request(&scene, &out), &mut Silent).unwrap().kept, 4);
    assert!(files_in(&out) == first, "the same bytes");

    // A camera that moved changes the masks beside it, too.
    scene.frames[0].camera.pose.c.x += 0.05;
    assert_eq!(priors(&request(&scene, &out), &mut Silent).unwrap().kept, 3);

    // Fewer photos: the last one has no next one any more.
    let few = PriorsRequest { frames: Some(3), ..request(&scene, &out) };
    let summary = priors(&few, &mut Silent).unwrap();
    assert_eq!((summary.photos, summary.kept), (3, 2));
    assert!(!out.join("flow/train/r_002_fwd.flo").exists() && out.join("flow/train/r_002_bwd.flo").exists());
}

#[test]
fn what_is_made_in_the_folder_of_a_scene_is_read_with_it() {
    let folder = tempfile::tempdir().unwrap();
    // A camera that stands still: most of the flow is known.
    write_orbit(&options(OrbitCamera::Frozen), folder.path()).unwrap();
    let read = || load(folder.path(), &LoadOptions::default()).unwrap();
    let before = read();
    priors(&request(&before, &before.root.join(MotionFiles::MADE)), &mut Silent).unwrap();
    let scene = read();
    let training: Vec<usize> = scene.split(Split::Train).collect();
    assert!(training.iter().all(|i| scene.frames[*i].priors.motion.mask.is_some()));
    assert!(scene.split(Split::Test).all(|i| scene.frames[i].priors.motion == MotionFiles::default()));
    let photos = ImageStore::new(&scene.frames, StoreOptions::default()).unwrap();
    let [first, second] = [training[0], training[1]];
    let made = flow_both_ways(&photos.get(first).unwrap(), &photos.get(second).unwrap());
    let found = [first, second].map(|i| scene.frames[i].read_flow_prior().unwrap());
    assert!(found[0].backward.is_none() && found[1].forward.is_some());
    for (made, found) in made.iter().zip([&found[0].forward, &found[1].backward]) {
        let found = found.as_ref().unwrap();
        assert!(found.seen == made.seen && found.seen.count() > 0, "{:?} and {:?}", found.seen, made.seen);
        let both = found.vectors.iter().zip(&made.vectors).zip(made.seen.iter());
        assert!(both.filter(|(_, is_seen)| *is_seen).all(|((found, made), _)| found == made));
    }
}

#[test]
fn a_stop_is_heeded_and_gone_on_from_to_the_same_bytes() {
    let (folder, scene) = (tempfile::tempdir().unwrap(), scene(OrbitCamera::Walking));
    let [whole, parts] = ["whole", "parts"].map(|name| folder.path().join(name));
    priors(&request(&scene, &whole), &mut Silent).unwrap();
    let stopped = priors(&request(&scene, &parts), &mut Impatient { parts: 0, most: 2 });
    assert!(matches!(stopped, Err(PrepareError::Stopped)), "{stopped:?}");
    assert_eq!(priors(&request(&scene, &parts), &mut Silent).unwrap().kept, 2);
    assert!(files_in(&whole) == files_in(&parts), "the same bytes");
}

#[test]
fn a_camera_that_stands_still_is_said_and_gives_empty_masks() {
    let (folder, scene) = (tempfile::tempdir().unwrap(), scene(OrbitCamera::Frozen));
    let out = folder.path().join("priors");
    let summary = priors(&request(&scene, &out), &mut Silent).unwrap();
    assert_eq!(summary.too_near.len(), 5);
    assert!(summary.warnings().iter().any(|warning| warning.contains("nearly the same place")), "{summary:?}");
    let mask = image::open(out.join("motion_masks/train/r_001.png")).unwrap().into_luma8();
    assert!(mask.pixels().all(|pixel| pixel.0 == [names::NOT_JUDGED]));
}

#[test]
fn what_cannot_be_made_is_said() {
    let (folder, mut scene) = (tempfile::tempdir().unwrap(), scene(OrbitCamera::Walking));
    std::fs::create_dir_all(folder.path().join("flow/train")).unwrap();
    std::fs::write(folder.path().join("flow/train/r_000_fwd.flo"), b"of a network").unwrap();
    let error = priors(&request(&scene, folder.path()), &mut Silent).unwrap_err().to_string();
    assert!(error.contains("flow") && error.contains("not made by `priors`"), "{error}");
    for frame in &mut scene.frames[1..] {
        frame.split = Split::Test;
    }
    let error = priors(&request(&scene, &folder.path().join("new")), &mut Silent).unwrap_err().to_string();
    assert!(error.contains("1 training photos") && !folder.path().join("new").exists(), "{error}");
}

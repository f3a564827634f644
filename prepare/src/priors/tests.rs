//! Priors of a small drawn scene.

use super::*;
use crate::flow::flow_both_ways;
use crate::watch::Silent;
use glam::{DVec2, DVec3};
use scene_io::synthetic::{Orbit, OrbitCamera, OrbitOptions, orbit, write_orbit};
use scene_io::{LoadOptions, MotionFiles, Scene, Split, load};

fn options(camera: OrbitCamera) -> OrbitOptions {
    OrbitOptions { width: 40, height: 36, train: 5, test: 1, rays: 1, camera, ..OrbitOptions::default() }
}

fn scene(camera: OrbitCamera) -> Scene {
    orbit(&options(camera))
}

fn request<'a>(scene: &'a Scene, out: &Path) -> PriorsRequest<'a> {
    let sequence = Sequence::Scene(scene);
    PriorsRequest { sequence, exact: None, out: out.to_path_buf(), frames: None, longest_side: None }
}

/// What the scenes here are drawn from.
fn drawn() -> Drawn {
    let OrbitOptions { seed, motion, .. } = options(OrbitCamera::Walking);
    Drawn::Orbit(Orbit::new(seed, motion))
}

/// Every file below a folder but the markers, by its path from there, with its bytes.
pub(super) fn files_in(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let (mut found, mut open) = (Vec::new(), vec![folder.to_path_buf()]);
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_string_lossy().replace('\\', "/");
            match path.is_dir() {
                true if [MADE, EXACT].contains(&name.as_str()) => {}
                true => open.push(path),
                false => found.push((name, std::fs::read(&path).unwrap())),
            }
        }
    }
    found.sort();
    found
}

pub(super) fn names_in(folder: &Path) -> Vec<String> {
    files_in(folder).into_iter().map(|(name, _)| name).collect()
}

/// Asks to stop once so many parts are done.
pub(super) struct Impatient {
    pub(super) parts: usize,
    pub(super) most: usize,
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

#[test]
fn exact_flow_leads_to_where_the_camera_of_the_other_photo_shows_the_point_at_its_time() {
    let (folder, drawn) = (tempfile::tempdir().unwrap(), drawn());
    let mut counts = [0; 3];
    for camera in [OrbitCamera::Walking, OrbitCamera::Jumping] {
        let (mut scene, out) = (scene(camera), folder.path().join(format!("{camera:?}")));
        let exact = PriorsRequest { exact: Some(&drawn), ..request(&scene, &out) };
        let summary = priors(&exact, &mut Silent).unwrap();
        assert_eq!((summary.photos, summary.exact, summary.warnings()), (5, true, Vec::new()));
        scene.take_priors(&out).unwrap();
        for (from, to) in (0..4).flat_map(|i| [(i, i + 1), (i + 1, i)]) {
            let prior = scene.frames[from].read_flow_prior().unwrap();
            let flow = if to > from { prior.forward } else { prior.backward };
            let flow = flow.unwrap();
            let [here, there] = [from, to].map(|i| &scene.frames[i].camera);
            let [now, then] = [from, to].map(|i| drawn.at(scene.frames[i].time.unwrap()));
            // The twin: the way of each point in the world, and both ends of it through the lenses.
            for point in now.scene_flow(here, &then).points {
                let x = DVec3::from(point.x);
                let goes = x + DVec3::from(point.way);
                let start = here.project(x).unwrap();
                let (column, row) = (start.x as u32, start.y as u32);
                let end = there.project(goes).filter(|p| p.cmpge(DVec2::ZERO).all() && p.x < 40.0 && p.y < 36.0);
                let shown = end.and_then(|end| then.hit(there, end));
                let off = shown.map_or(f64::INFINITY, |hit| (hit.x - goes).length());
                let seen = flow.seen.get(column, row);
                // At a grazing angle a point is found again less exactly.
                assert!(if seen { off < 1e-3 } else { off > 1e-8 }, "{from} to {to}, {start}: {seen} and {off}");
                if let Some(end) = end.filter(|_| seen) {
                    let [u, v] = flow.vectors[(row * 40 + column) as usize].map(f64::from);
                    assert!((start + DVec2::new(u, v) - end).length() < 1e-4, "{from} to {to}, {start}: {u}, {v}");
                }
                counts[if seen { usize::from(point.moves) } else { 2 }] += 1;
            }
            let surface = drawn.at(scene.frames[from].time.unwrap()).truth(here);
            let empty = surface.z.iter().zip(flow.seen.iter()).filter(|(z, seen)| **z == 0.0 && *seen);
            assert_eq!(empty.count(), 0, "nothing leads nowhere");
        }
    }
    assert!(counts.iter().all(|n| *n > 100), "{counts:?}: still, moving, not seen");
}

#[test]
fn exact_disparities_and_masks_come_back_from_their_files() {
    let (folder, drawn) = (tempfile::tempdir().unwrap(), drawn());
    let (mut scene, out) = (scene(OrbitCamera::Walking), folder.path().join("exact"));
    let exact = PriorsRequest { exact: Some(&drawn), ..request(&scene, &out) };
    let summary = priors(&exact, &mut Silent).unwrap();
    let names = names_in(&out);
    assert_eq!(names.len(), 5 + 5 + 4 + 4, "masks, disparities, flows each way: {names:?}");
    scene.take_priors(&out).unwrap();
    let mut moving = 0.0;
    for frame in scene.frames.iter().filter(|frame| frame.split == Split::Train) {
        let (found, truth) = (frame.read_disparity().unwrap().unwrap(), drawn.at(frame.time.unwrap()));
        let z = truth.truth(&frame.camera).z;
        for ((value, known), z) in found.values.iter().zip(found.known.iter()).zip(&z) {
            assert_eq!(known, *z > 0.0, "{}", frame.name);
            assert!(!known || (f64::from(*value) * z - 1.0).abs() < 1e-6, "{value} at {z}");
        }
        let mask = frame.read_motion_mask().unwrap().unwrap();
        assert_eq!(Some(&mask), frame.read_moving().unwrap().as_ref());
        moving += mask.share() / 5.0;
    }
    assert!(moving > 0.0 && (summary.moving - moving).abs() < 1e-12, "{moving} and {}", summary.moving);
    // The same again is there already; half as large is not.
    assert_eq!(priors(&PriorsRequest { exact: Some(&drawn), ..request(&scene, &out) }, &mut Silent).unwrap().kept, 5);
    let half = PriorsRequest { exact: Some(&drawn), longest_side: Some(20), ..request(&scene, &out) };
    assert_eq!(priors(&half, &mut Silent).unwrap().kept, 0);
    let small = scene.frames[1].read_disparity().unwrap().unwrap();
    assert_eq!((small.width, small.height, small.known.count() > 20), (20, 18, true));
}

#[test]
fn exact_priors_and_those_of_photos_do_not_share_a_folder() {
    let (folder, drawn) = (tempfile::tempdir().unwrap(), drawn());
    let scene = scene(OrbitCamera::Walking);
    let [exact, made, foreign] = ["exact", "made", "foreign"].map(|name| folder.path().join(name));
    let all = |exact: bool, out: &Path| {
        let exact = exact.then_some(&drawn);
        priors(&PriorsRequest { exact, frames: Some(2), ..request(&scene, out) }, &mut Silent)
    };
    assert!(all(true, &exact).is_ok() && all(false, &made).is_ok());
    std::fs::create_dir_all(foreign.join("disp")).unwrap();
    std::fs::write(foreign.join("disp/r_000.png"), b"of a network").unwrap();
    for (wrong, words) in [
        (all(false, &exact), "holds what `priors --exact` made"),
        (all(true, &made), "holds what `priors` made"),
        (all(true, &foreign), "not made by `priors --exact`"),
    ] {
        let error = wrong.unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("--out"), "{error}");
    }
    // Disparities of a network are no matter of flow and masks.
    assert!(all(false, &foreign).is_ok());
}

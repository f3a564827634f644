//! Priors of films whose cameras are not known: made-up ones, and a real one beside the flow of a network and masks drawn by people.

use super::tests::{Impatient, files_in, names_in};
use super::*;
use crate::flow::tests::texture as wall;
use crate::watch::Silent;
use image::{Rgb, RgbImage};
use scene_io::BitMask;
use scene_io::synthetic::{Orbit, OrbitOptions, orbit};

// Bounds of the test on a real film. They are cautious and have to be set from a measurement: the test prints what it finds when it fails.
/// Photos of it, four at least, and their longest side, half of what they have.
const FRAMES: usize = 6;
const LONGEST_SIDE: u32 = 224;
/// Median distance from the network's flow, pixels of this size. A flow of zeros has more than twice as much.
const MEDIAN_ERROR: f32 = 0.5;
/// F1 of the masks, all frames together. A mask that is all white has less than half of it, an empty one 0.
const LEAST_F1: f64 = 0.3;

/// The square in photo `i` of [`film`].
fn is_square(i: u32, column: u32, row: u32, way: u32) -> bool {
    (20 + way * i..44 + way * i).contains(&column) && (20..44).contains(&row)
}

/// Photos of 96 x 72 pixels in `rgb` of a folder: a square goes `way` pixels to the right from photo to photo before a wall.
fn film(folder: &Path, photos: u32, way: u32) -> Film {
    std::fs::create_dir_all(folder.join("rgb")).unwrap();
    for i in 0..photos {
        let grey = |column: u32, row: u32| {
            let (x, y) = (column as f32, row as f32);
            let grey =
                if is_square(i, column, row, way) { wall(x - (way * i) as f32 + 300.0, y - 200.0) } else { wall(x, y) };
            Rgb([grey as u8; 3])
        };
        RgbImage::from_fn(96, 72, grey).save(folder.join(format!("rgb/f_{i}.png"))).unwrap();
    }
    Film::find(folder).unwrap().unwrap()
}

fn request<'a>(film: &'a Film, out: &Path) -> PriorsRequest<'a> {
    let sequence = Sequence::Film(film);
    PriorsRequest { sequence, exact: None, out: out.to_path_buf(), frames: None, longest_side: None }
}

/// The mask of a photo, white alone.
fn mask(out: &Path, name: &str) -> BitMask {
    let grey = image::open(out.join(MASKS).join(format!("{name}.png"))).unwrap().into_luma8();
    BitMask::from_fn(grey.width(), grey.height(), |column, row| grey.get_pixel(column, row).0 == [names::MOVES])
}

#[test]
fn a_film_has_flow_and_masks_and_is_gone_on_with_where_it_was_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let film = film(folder.path(), 4, 4);
    let [whole, parts] = ["priors", "parts"].map(|name| folder.path().join(name));
    let summary = priors(&request(&film, &whole), &mut Silent).unwrap();
    let fits = summary.fits.unwrap();
    assert_eq!((summary.photos, fits.fundamental + fits.homography + fits.neither), (4, 6), "{summary:?}");
    let flows =
        ["f_0_fwd", "f_1_bwd", "f_1_fwd", "f_2_bwd", "f_2_fwd", "f_3_bwd"].map(|name| format!("flow/{name}.flo"));
    let masks = [0, 1, 2, 3].map(|i| format!("motion_masks/f_{i}.png"));
    assert_eq!(names_in(&whole), [&flows[..], &masks].concat());

    // Photos of priors are none of the film.
    assert_eq!(Film::find(folder.path()).unwrap().unwrap().count(), 4);
    let stopped = priors(&request(&film, &parts), &mut Impatient { parts: 0, most: 2 });
    assert!(matches!(stopped, Err(PrepareError::Stopped)), "{stopped:?}");
    let again = priors(&request(&film, &parts), &mut Silent).unwrap();
    assert_eq!(again.kept, 2);
    assert!(files_in(&whole) == files_in(&parts), "the same bytes");
    // What was found before is told again.
    let told = priors(&request(&film, &whole), &mut Silent).unwrap();
    assert_eq!((told.kept, told.told_by()), (4, summary.told_by()));

    // The same photos with cameras are others.
    let film = Film::find(folder.path()).unwrap().unwrap();
    let jobs_of = |sequence: Sequence<'_>| {
        let request = PriorsRequest { sequence, ..request(&film, &whole) };
        let photos = ImageStore::new(sequence.frames(), StoreOptions::default()).unwrap();
        let places = neighbours::in_time(sequence.frames(), None);
        jobs(&request, &photos, &places).unwrap().iter().map(|job| job.inputs.clone()).collect::<Vec<_>>()
    };
    let drawn = OrbitOptions { width: 8, height: 8, train: 2, test: 0, rays: 1, ..OrbitOptions::default() };
    let mut scene = orbit(&drawn);
    (scene.root, scene.frames) = (folder.path().to_path_buf(), film.frames().to_vec());
    let both = [Sequence::Film(&film), Sequence::Scene(&scene)].map(jobs_of);
    assert!(both[0].iter().zip(&both[1]).all(|(film, scene)| film != scene));
}

#[test]
fn a_film_has_no_exact_priors() {
    let folder = tempfile::tempdir().unwrap();
    let (film, out) = (film(folder.path(), 2, 4), folder.path().join("out"));
    let OrbitOptions { seed, motion, .. } = OrbitOptions::default();
    let drawn = Drawn::Orbit(Orbit::new(seed, motion));
    let error = priors(&PriorsRequest { exact: Some(&drawn), ..request(&film, &out) }, &mut Silent).unwrap_err();
    let line = error.to_string();
    assert!(line.contains("holds photos alone") && line.contains("--exact") && !out.exists(), "{line}");
}

#[test]
fn what_moves_before_a_camera_that_stands_still_is_in_the_masks() {
    let folder = tempfile::tempdir().unwrap();
    let film = film(folder.path(), 3, 4);
    let out = folder.path().join("out");
    let summary = priors(&request(&film, &out), &mut Silent).unwrap();
    assert!(summary.fits.unwrap().homography == 4 && summary.unexplained.is_empty(), "{summary:?}");
    assert!(summary.told_by().unwrap().contains("a homography in 4"), "{summary:?}");
    let moving = mask(&out, "f_1");
    let inside =
        BitMask::from_fn(96, 72, |column, row| is_square(1, column, row, 4) && moving.get(column, row)).count();
    let outside = moving.count() - inside;
    assert!(inside > 150 && inside > outside, "{inside} pixels of the square's 576, {outside} elsewhere");
}

#[test]
fn two_photos_of_which_nothing_moves_have_black_masks() {
    let folder = tempfile::tempdir().unwrap();
    let film = film(folder.path(), 2, 0);
    let out = folder.path().join("out");
    let summary = priors(&request(&film, &out), &mut Silent).unwrap();
    assert_eq!((summary.photos, summary.moving, summary.fits.unwrap().homography), (2, 0.0, 2));
    assert!(summary.warnings().is_empty(), "{:?}", summary.warnings());
    let grey = image::open(out.join("motion_masks/f_0.png")).unwrap().into_luma8();
    let judged = grey.pixels().filter(|pixel| pixel.0 == [names::STAYS]).count();
    assert!(judged > 96 * 72 / 2 && grey.pixels().all(|pixel| pixel.0 != [names::MOVES]), "{judged}");
}

#[test]
fn photos_that_show_nothing_alike_are_not_judged_and_that_is_said() {
    let folder = tempfile::tempdir().unwrap();
    // All one grey: no flow is known.
    for i in 0..3_u8 {
        RgbImage::from_pixel(48, 40, Rgb([90 + 10 * i; 3])).save(folder.path().join(format!("{i}.png"))).unwrap();
    }
    let film = Film::find(folder.path()).unwrap().unwrap();
    let out = folder.path().join("out");
    let summary = priors(&request(&film, &out), &mut Silent).unwrap();
    assert_eq!((summary.unexplained.len(), summary.too_near.len(), summary.fits.unwrap().neither), (3, 0, 4));
    let warnings = summary.warnings();
    assert!(warnings.iter().any(|line| line.starts_with("3 of 3 photos have flow that neither")), "{warnings:?}");
    let grey = image::open(out.join("motion_masks/1.png")).unwrap().into_luma8();
    assert!(grey.pixels().all(|pixel| pixel.0 == [names::NOT_JUDGED]));
}

/// Distances of flow vectors from those that are right, where both are known, and of zeros.
fn errors(flow: &Flow, right: &Flow) -> Vec<[f32; 2]> {
    let both = flow.seen.iter().zip(right.seen.iter()).map(|(a, b)| a && b);
    let pairs = flow.vectors.iter().zip(&right.vectors).zip(both).filter(|(_, is_known)| *is_known);
    pairs.map(|((a, b), _)| [(a[0] - b[0]).hypot(a[1] - b[1]), b[0].hypot(b[1])]).collect()
}

fn middle(mut values: Vec<f32>) -> f32 {
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f32::INFINITY)
}

#[test]
fn a_real_film_moves_as_a_network_and_people_say() {
    let test = "a_real_film_moves_as_a_network_and_people_say";
    let Some(folder) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), "davis/tennis", test) else { return };
    let film = Film::find(&folder).unwrap().unwrap();
    assert_eq!((film.count(), film.frames()[0].name.as_str()), (70, "rgb/0001.jpg"));
    let out = tempfile::tempdir().unwrap();
    let small = Some(LONGEST_SIDE);
    let request = PriorsRequest { frames: Some(FRAMES), longest_side: small, ..request(&film, out.path()) };
    let summary = priors(&request, &mut Silent).unwrap();
    let told = summary.told_by().unwrap_or_default();

    let mut distances = Vec::new();
    for (k, frame) in film.frames().iter().enumerate().take(4) {
        let read = |path: PathBuf| {
            let mut frame = frame.clone();
            frame.priors.motion.forward = Some(path);
            frame.read_flow_prior().unwrap().forward.unwrap()
        };
        let ours = read(out.path().join(format!("flow/{:04}_fwd.flo", k + 1)));
        let network = read(folder.join(format!("flow_sample/{:04}.flo", k + 1))).resized(ours.width, ours.height);
        distances.extend(errors(&ours, &network));
    }
    let share = distances.len() as f64 / (4.0 * 224.0 * 128.0);
    let [error, zeros] = [0, 1].map(|i| middle(distances.iter().map(|both| both[i]).collect()));
    assert!(zeros > 2.0 * MEDIAN_ERROR, "zeros are {zeros} pixels off: the test is void");
    assert!(share > 0.4 && error < MEDIAN_ERROR, "median distance {error} of {share} of the pixels; {summary:?}");

    let (mut both, mut found, mut right, mut all) = (0, 0, 0, 0);
    for (k, frame) in film.frames().iter().enumerate().take(FRAMES) {
        let ours = mask(out.path(), &format!("{:04}", k + 1));
        let mut frame = frame.clone();
        frame.priors.motion.mask = Some(folder.join(format!("mask/{:04}.png", k + 1)));
        let truth = frame.read_motion_mask().unwrap().unwrap().resized(ours.width(), ours.height());
        both += ours.iter().zip(truth.iter()).filter(|(a, b)| *a && *b).count();
        (found, right) = (found + ours.count(), right + truth.count());
        all += Size::new(ours.width(), ours.height()).pixels();
    }
    let f1 = |both: f64, found: u64| 2.0 * both / (found + right).max(1) as f64;
    let (ours, white) = (f1(both as f64, found), f1(right as f64, all));
    assert!(2.0 * white < LEAST_F1, "a white mask has F1 {white}: the test is void");
    assert!(ours > LEAST_F1, "F1 {ours}, {found} pixels found and {right} right; {told}; {summary:?}");
    assert!(summary.fits.unwrap().homography > 0 && summary.unexplained.is_empty(), "{told}");
    assert_eq!(summary.fits.map(|fits| fits.fundamental + fits.homography), Some(2 * (FRAMES - 1)), "{told}");
}

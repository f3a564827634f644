//! What moves where no camera is known: flow of a made-up place, and photos of a wall.

use super::*;
use crate::flow::flow_both_ways;
use crate::flow::tests::texture;
use glam::{DVec2, DVec3};
use render_core::camera::Pose;
use render_core::float_core::rng::Rng;
use scene_io::{BitMask, Image};

const SIZE: Size = Size::new(160, 120);
/// Columns and rows of the square.
const SQUARE: [std::ops::Range<u32>; 2] = [40..88, 40..80];

/// What happens between two pictures.
#[derive(Clone, Copy)]
struct Change {
    /// The way of the camera, in the unit of the depths, which are between 2 and 4.
    way: [f64; 3],
    /// Its turn about x, y and z, small.
    turn: [f64; 3],
    /// What the square does besides, pixels.
    own: [f64; 2],
}

const STILL: Change = Change { way: [0.0; 3], turn: [0.0; 3], own: [0.0; 2] };
const TURN: Change = Change { turn: [0.01, -0.05, 0.015], ..STILL };
const WALK: Change = Change { way: [0.3, 0.1, 0.15], turn: [0.01, -0.02, 0.015], own: [0.0; 2] };

fn is_square(column: u32, row: u32) -> bool {
    SQUARE[0].contains(&column) && SQUARE[1].contains(&row)
}

/// The flow, wrong by a tenth of a pixel at most along each axis.
fn flow(change: Change) -> Flow {
    let rng = Rng::new(5, 2);
    let wrong = |k: u32| 0.1 * (2.0 * f64::from(rng.uniform_at(k.into())) - 1.0);
    let vector = |k: u32| {
        let (column, row) = (k % SIZE.width, k / SIZE.width);
        let place = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
        let depth = 3.0 + (0.05 * place.x).sin() * (0.06 * place.y).cos();
        let ray = (place - DVec2::new(80.0, 60.0)) / 150.0;
        let ([a, b, c], [x, y, z]) = (change.way, change.turn);
        let turned = [ray.x + y - z * ray.y, ray.y - x + z * ray.x, 1.0 - y * ray.x + x * ray.y];
        let [u, v, w] = [turned[0] + a / depth, turned[1] + b / depth, turned[2] + c / depth];
        let there = DVec2::new(150.0 * u / w + 80.0, 150.0 * v / w + 60.0);
        let own = if is_square(column, row) { DVec2::from_array(change.own) } else { DVec2::ZERO };
        let way = there + own - place;
        [(way.x + wrong(2 * k)) as f32, (way.y + wrong(2 * k + 1)) as f32]
    };
    let vectors = (0..SIZE.width * SIZE.height).map(vector).collect();
    Flow {
        width: SIZE.width,
        height: SIZE.height,
        vectors,
        seen: BitMask::from_fn(SIZE.width, SIZE.height, |_, _| true),
    }
}

/// Twice the pixels that move and should, by those that move and those that should.
fn f1(moving: &BitMask, should: impl Fn(u32, u32) -> bool) -> f64 {
    let (mut both, mut sum) = (0, 0);
    for (column, row) in (0..moving.height()).flat_map(|row| (0..moving.width()).map(move |column| (column, row))) {
        let (is, should) = (moving.get(column, row), should(column, row));
        both += usize::from(is && should);
        sum += usize::from(is) + usize::from(should);
    }
    2.0 * both as f64 / sum.max(1) as f64
}

#[test]
fn the_square_is_found_whatever_the_camera_does() {
    let cases = [
        (Change { own: [0.0, 6.0], ..WALK }, FitKind::Fundamental),
        (Change { own: [3.0, 2.0], ..TURN }, FitKind::Homography),
        (Change { own: [3.0, 2.0], ..STILL }, FitKind::Homography),
    ];
    for (change, by) in cases {
        let (motion, fits) = motion_without_cameras(SIZE, &[&flow(change)]);
        let found = f1(&motion.moving, is_square);
        assert!(fits.len() == 1 && fits[0].by == Some(by), "{fits:?}");
        assert!(found > 0.95 && motion.judged.share() == 1.0, "F1 {found}, {fits:?}");
        let share = fits[0].score().unwrap().share;
        assert!((share - 0.9).abs() < 0.03, "{share}: a tenth of the picture moves");
    }
}

#[test]
fn where_nothing_moves_nothing_is_found() {
    for (change, by) in [(WALK, FitKind::Fundamental), (TURN, FitKind::Homography), (STILL, FitKind::Homography)] {
        let (motion, fits) = motion_without_cameras(SIZE, &[&flow(change)]);
        assert_eq!((motion.moving.count(), motion.judged.share(), fits[0].by), (0, 1.0, Some(by)), "{fits:?}");
    }
    // Not even noise: there is no fundamental matrix at all.
    let seen = BitMask::from_fn(SIZE.width, SIZE.height, |_, _| true);
    let vectors = vec![[0.0; 2]; SIZE.pixels() as usize];
    let still = Flow { width: SIZE.width, height: SIZE.height, vectors, seen };
    let (motion, fits) = motion_without_cameras(SIZE, &[&still]);
    assert_eq!((motion.moving.count(), fits[0].fundamental), (0, None));
    assert!(fits[0].by == Some(FitKind::Homography) && fits[0].score().unwrap().share == 1.0, "{fits:?}");
}

#[test]
fn what_moves_to_either_neighbour_moves() {
    // Along the lines of the one, across those of the other.
    let along = flow(Change { own: [0.0; 2], ..WALK });
    let across = flow(Change { own: [0.0, 6.0], ..WALK });
    for flows in [[&along, &across], [&across, &along]] {
        let (motion, fits) = motion_without_cameras(SIZE, &flows);
        assert!(fits.len() == 2 && f1(&motion.moving, is_square) > 0.95, "{fits:?}");
    }
}

#[test]
fn flow_without_sense_judges_nothing() {
    let rng = Rng::new(6, 2);
    let vector = |k: u64| [0, 1].map(|i| 60.0 * rng.uniform_at(2 * k + i) - 30.0);
    let noise = Flow { vectors: (0..SIZE.pixels()).map(vector).collect(), ..flow(STILL) };
    let unknown = Flow { seen: BitMask::new(SIZE.width, SIZE.height), ..flow(WALK) };
    for nonsense in [&noise, &unknown] {
        let (motion, fits) = motion_without_cameras(SIZE, &[nonsense]);
        assert!(motion.is_blind() && fits[0].by.is_none() && fits[0].score().is_none(), "{fits:?}");
    }
    // The other neighbour judges.
    let (motion, fits) = motion_without_cameras(SIZE, &[&noise, &flow(Change { own: [3.0, 2.0], ..TURN })]);
    assert!(fits[1].by.is_some() && f1(&motion.moving, is_square) > 0.95, "{fits:?}");
    assert!(motion_without_cameras(SIZE, &[]).0.is_blind());
}

#[test]
fn known_cameras_and_none_find_the_same_square() {
    let known = {
        let pose = Pose::IDENTITY;
        let here = Camera::pinhole(SIZE.width, SIZE.height, 150.0, 150.0, 80.0, 60.0, pose);
        // Without a turn: the way of points is the camera's, the other way round.
        let c = -DVec3::from_array(WALK.way);
        let there = Camera { pose: Pose { c, ..pose }, ..here };
        let flow = flow(Change { turn: [0.0; 3], own: [0.0, 6.0], ..WALK });
        motion(&here, &[Neighbour { camera: &there, flow: &flow }])
    };
    let (unknown, _) = motion_without_cameras(SIZE, &[&flow(Change { turn: [0.0; 3], own: [0.0, 6.0], ..WALK })]);
    let both = f1(&unknown.moving, |column, row| known.moving.get(column, row));
    assert!(f1(&known.moving, is_square) > 0.95 && both > 0.98, "{both}");
}

#[test]
fn photos_of_a_camera_that_stands_still_give_what_moves() {
    // A square of 32 pixels goes 8 pixels to the right before a wall, and the wall by itself.
    let grey = |x: f32, y: f32| texture(x, y) as u8;
    let is_square =
        |column: u32, row: u32, shift: u32| (32 + shift..64 + shift).contains(&column) && (32..64).contains(&row);
    let photo = |shift: u32| {
        let pixels = (0..96).flat_map(|row| (0..112).map(move |column| (column, row)));
        let data = pixels.flat_map(|(column, row)| {
            let (x, y) = (column as f32, row as f32);
            let is_before = is_square(column, row, shift);
            [if is_before { grey(x - shift as f32 + 300.0, y - 200.0) } else { grey(x, y) }; 3]
        });
        Image::rgb(112, 96, data.collect()).unwrap()
    };
    let [forward, _] = flow_both_ways(&photo(0), &photo(8));
    let (motion, fits) = motion_without_cameras(Size::new(112, 96), &[&forward]);
    let found = f1(&motion.moving, |column, row| is_square(column, row, 0));
    assert!(fits[0].by == Some(FitKind::Homography) && found > 0.6, "F1 {found}, {fits:?}");
    let [forward, _] = flow_both_ways(&photo(0), &photo(0));
    let (motion, fits) = motion_without_cameras(Size::new(112, 96), &[&forward]);
    assert!(motion.judged.count() > 5000 && motion.moving.count() == 0, "{fits:?}");
}

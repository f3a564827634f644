//! Flow of pictures whose flow is known.

use super::*;
use render_core::camera::{Camera, Pose};
use scene_io::{Frame, ImageSource, Size, decode_photo};
use std::sync::Arc;

/// Grey of a surface that is textured at wavelengths from 5 to 37 pixels, in 8 bits.
pub(crate) fn texture(x: f32, y: f32) -> f32 {
    let waves = (0..10).map(|k| {
        let k = k as f32;
        let (sin, cos) = (2.4 * k).sin_cos();
        let length = 5.0 * 1.25_f32.powf(k);
        10.0 * (std::f32::consts::TAU / length * (cos * x + sin * y) + 1.7 * k).sin()
    });
    (127.5 + waves.sum::<f32>()).clamp(0.0, 255.0).round()
}

fn picture(size: Size, at: impl Fn(f32, f32) -> f32 + Sync) -> Plane {
    Plane::from_fn(size.width as usize, size.height as usize, |x, y| at(x as f32, y as f32))
}

/// Mean and largest distance from the truth, of the pixels at least `rim` from the border.
fn errors(flow: &DenseFlow, rim: usize, truth: impl Fn(f32, f32) -> [f32; 2]) -> (f32, f32) {
    let (mut sum, mut largest, mut count) = (0.0, 0.0_f32, 0.0);
    for y in rim..flow.height() - rim {
        for x in rim..flow.width() - rim {
            let (is, should) = (flow.at(x, y), truth(x as f32, y as f32));
            let error = (is[0] - should[0]).hypot(is[1] - should[1]);
            (sum, largest, count) = (sum + error, largest.max(error), count + 1.0);
        }
    }
    (sum / count, largest)
}

/// As photos have it.
fn photo(plane: &Plane) -> Image {
    let (width, height) = (plane.width(), plane.height());
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let data = pixels.flat_map(|(x, y)| [plane.at(x, y) as u8; 3]).collect();
    Image::rgb(width as u32, height as u32, data).unwrap()
}

const SIZE: Size = Size::new(112, 96);

#[test]
fn a_shift_is_found_to_a_twentieth_of_a_pixel() {
    let first = picture(SIZE, texture);
    for [u, v] in [[0.0, 0.0], [0.4, -0.3], [3.3, -2.6], [-11.4, 5.2]] {
        let second = picture(SIZE, |x, y| texture(x - u, y - v));
        let (mean, largest) = errors(&dense_flow(&first, &second), 16, |_, _| [u, v]);
        assert!(mean < 0.05 && largest < 0.5, "({u}, {v}): mean {mean}, largest {largest}");
    }
}

#[test]
fn a_zoom_and_a_turn_are_found_to_a_tenth_of_a_pixel() {
    let first = picture(SIZE, texture);
    let (sin, cos) = 2.0_f32.to_radians().sin_cos();
    for (zoom, turn) in [(1.04, [1.0, 0.0]), (1.0, [cos, sin]), (0.97, [cos, -sin])] {
        let middle = [56.0, 48.0];
        let [c, s] = turn;
        // Where a point of the first picture goes, and where one of the second came from.
        let there = |x: f32, y: f32| {
            let (x, y) = (x - middle[0], y - middle[1]);
            [middle[0] + zoom * (c * x - s * y), middle[1] + zoom * (s * x + c * y)]
        };
        let back = |x: f32, y: f32| {
            let (x, y) = ((x - middle[0]) / zoom, (y - middle[1]) / zoom);
            [middle[0] + c * x + s * y, middle[1] - s * x + c * y]
        };
        let second = picture(SIZE, |x, y| {
            let [x, y] = back(x, y);
            texture(x, y)
        });
        let truth = |x: f32, y: f32| {
            let [u, v] = there(x, y);
            [u - x, v - y]
        };
        let (mean, largest) = errors(&dense_flow(&first, &second), 12, truth);
        assert!(mean < 0.1 && largest < 0.8, "zoom {zoom}, turn {turn:?}: mean {mean}, largest {largest}");
    }
}

#[test]
fn where_all_is_one_grey_nothing_moves_and_nothing_is_known() {
    let plane = picture(SIZE, |_, _| 90.0);
    let flow = dense_flow(&plane, &plane);
    assert!(flow.vectors().iter().all(|way| *way == [0.0, 0.0]));
    assert!((0..96).all(|y| (0..112).all(|x| flow.confidence(x, y) == 0.0)));
    let [forward, backward] = flow_both_ways(&photo(&plane), &photo(&plane));
    assert_eq!((forward.seen.count(), backward.seen.count()), (0, 0));
}

#[test]
fn tiny_pictures_have_a_flow() {
    for (width, height) in [(1, 1), (3, 2), (1, 40), (40, 1), (7, 8), (9, 9)] {
        let [first, second] =
            [0.0, 1.0].map(|shift| photo(&picture(Size::new(width, height), |x, y| texture(x - shift, y))));
        let [forward, backward] = flow_both_ways(&first, &second);
        for flow in [forward, backward] {
            assert_eq!((flow.width, flow.height, flow.vectors.len()), (width, height, (width * height) as usize));
            assert!(flow.vectors.iter().flatten().all(|length| length.is_finite()), "{width}x{height}");
        }
    }
    let empty = Plane::from_fn(0, 5, |_, _| 0.0);
    assert_eq!(dense_flow(&empty, &empty).vectors().len(), 0);
}

#[test]
fn what_something_moves_in_front_of_is_not_seen() {
    // A square of 32 pixels, 8 pixels to the right before a wall that stays.
    let (begin, side, way) = (32.0, 32.0, 8.0);
    let scene = |shift: f32| {
        picture(SIZE, move |x, y| {
            let square = begin + shift..begin + side + shift;
            if square.contains(&x) && (begin..begin + side).contains(&y) {
                texture(x - shift + 300.0, y - 200.0)
            } else {
                texture(x, y)
            }
        })
    };
    let [forward, _] = flow_both_ways(&photo(&scene(0.0)), &photo(&scene(way)));
    let share = |columns: std::ops::Range<u32>, rows: std::ops::Range<u32>, truth: Option<[f32; 2]>| {
        let all: Vec<(u32, u32)> = rows.flat_map(|y| columns.clone().map(move |x| (x, y))).collect();
        let is_so = |(x, y): &&(u32, u32)| {
            let is = forward.vectors[(*y * SIZE.width + *x) as usize];
            let close = truth.is_none_or(|truth| (is[0] - truth[0]).hypot(is[1] - truth[1]) < 0.5);
            close && forward.seen.get(*x, *y)
        };
        all.iter().filter(is_so).count() as f32 / all.len() as f32
    };
    let hidden = share(64..72, 36..60, None);
    assert!(hidden < 0.4, "{hidden} of what is covered counts as seen");
    let on_it = share(40..56, 40..56, Some([way, 0.0]));
    let wall = share(8..24, 16..80, Some([0.0, 0.0])).min(share(84..104, 16..80, Some([0.0, 0.0])));
    assert!(on_it > 0.95 && wall > 0.95, "{on_it} of the square, {wall} of the wall");
}

#[test]
fn what_is_transparent_is_not_seen() {
    let opaque = photo(&picture(SIZE, texture));
    let pixels = opaque.data.chunks_exact(3).zip(0_u32..);
    let data = pixels.flat_map(|(p, k)| [p[0], p[1], p[2], if k % SIZE.width < 56 { 255 } else { 0 }]).collect();
    let half = Image::rgba(SIZE.width, SIZE.height, data).unwrap();
    let [forward, _] = flow_both_ways(&half, &half);
    assert!((0..96).all(|y| (56..112).all(|x| !forward.seen.get(x, y))));
    assert!((8..88).all(|y| (8..48).all(|x| forward.seen.get(x, y))));
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let first = picture(SIZE, texture);
    let second = picture(SIZE, |x, y| texture(0.98 * x - 1.3, 1.01 * y + 2.2));
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| dense_flow(&first, &second))
    };
    let bits = |flow: &DenseFlow| -> Vec<u32> { flow.vectors().iter().flatten().map(|x| x.to_bits()).collect() };
    let one = with(1);
    for threads in [2, 4] {
        let many = with(threads);
        assert!(bits(&one) == bits(&many) && one == many, "{threads} threads");
    }
}

#[test]
fn a_real_video_moves_as_a_network_says() {
    let test = "a_real_video_moves_as_a_network_says";
    let Some(folder) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), "davis/tennis", test) else { return };
    let [first, second] = [1, 2].map(|k| {
        let picture = decode_photo(&folder.join(format!("rgb/{k:04}.jpg"))).unwrap().into_rgb8();
        Image::rgb(picture.width(), picture.height(), picture.into_raw()).unwrap()
    });
    let [forward, _] = flow_both_ways(&first, &second);
    let camera = Camera::pinhole(448, 256, 400.0, 400.0, 224.0, 128.0, Pose::IDENTITY);
    let mut frame = Frame::new("0001", ImageSource::Memory(Arc::new(first)), camera);
    frame.priors.motion.forward = Some(folder.join("flow_sample/0001.flo"));
    let network = frame.read_flow_prior().unwrap().forward.unwrap();
    let pairs = forward.vectors.iter().zip(&network.vectors).zip(forward.seen.iter());
    let mut errors: Vec<f32> = pairs
        .filter(|(_, is_seen)| *is_seen)
        .map(|((is, should), _)| (is[0] - should[0]).hypot(is[1] - should[1]))
        .collect();
    errors.sort_by(f32::total_cmp);
    let share = errors.len() as f64 / f64::from(448 * 256);
    assert!(share > 0.5, "{share} of the pixels are seen");
    let middle = errors[errors.len() / 2];
    assert!(middle < 0.15, "median distance {middle} pixels");
}

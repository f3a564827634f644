//! Flow against closed forms: a plane before a camera that moves, and a plane that moves before a camera.

use super::*;
use crate::data::Dataset;
use crate::system::{Layers, Query, SkipRow, StepStats, SystemError, Tensor, TensorMap};
use glam::DMat3;
use render_core::camera::Pose;
use render_core::ray::Ray;

/// A plane across z.
const DEPTH: f64 = 4.0;
const FOCAL: f64 = 50.0;

/// All of it has gone `way` at time 1; what lies beyond `lost` goes nobody knows where.
struct Moving {
    way: DVec3,
    lost: f64,
    says: FlowSource,
}

impl Moving {
    fn by(way: DVec3) -> Self {
        Self { way, lost: f64::INFINITY, says: FlowSource::Canonical }
    }
}

impl System for Moving {
    fn name(&self) -> &'static str {
        "moving"
    }
    fn step(&mut self, _: &Dataset, _: u64) -> Result<StepStats, SystemError> {
        Ok(StepStats::default())
    }
    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        Layers::nothing(rays.len(), query)
    }
    fn density(&self, _: &[[f64; 3]], _: f64, out: &mut [f32]) {
        out.fill(0.0);
    }
    fn colour(&self, _: &[[f64; 3]], _: &[[f32; 3]], _: f64, out: &mut [[f32; 3]]) {
        out.fill([0.0; 3]);
    }
    fn canonical(&self, points: &[[f64; 3]], time: f64, out: &mut [[f64; 3]]) {
        for (p, out) in points.iter().zip(out) {
            let known = p[0] < self.lost;
            *out = if known { (DVec3::from(*p) - time * self.way).to_array() } else { [f64::NAN; 3] };
        }
    }
    fn flow_source(&self) -> FlowSource {
        self.says
    }
    fn bounds(&self) -> [[f64; 3]; 2] {
        [[-5.0; 3], [5.0; 3]]
    }
    fn state(&self) -> Vec<Tensor<'_>> {
        Vec::new()
    }
    fn load_state(&mut self, _: &TensorMap) -> Result<(), SystemError> {
        Ok(())
    }
    fn skips(&self) -> Vec<SkipRow> {
        Vec::new()
    }
    fn timings(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
    fn parameter_count(&self) -> usize {
        0
    }
    fn memory_bytes(&self) -> usize {
        0
    }
}

fn still() -> Moving {
    Moving::by(DVec3::ZERO)
}

/// At `c`, rolled by an angle.
fn camera(c: DVec3, roll: f64) -> Camera {
    Camera::pinhole(20, 16, FOCAL, FOCAL, 10.0, 8.0, Pose { r: DMat3::from_rotation_z(roll), c })
}

/// What a camera sees of the plane.
fn plane(camera: &Camera) -> Rendered {
    let (width, height) = (camera.width, camera.height);
    let prepared = camera.prepare();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x), f64::from(y)) + 0.5));
    let depth = |pixel: DVec2| {
        let ray = prepared.ray(pixel).unwrap();
        ((DEPTH - ray.o.z) / ray.d.z) as f32
    };
    Rendered { width, height, layers: Layers { median_depth: pixels.map(depth).collect(), ..Layers::default() } }
}

/// Flow of all pixels, each with its place from the middle of the picture.
fn flows(system: &Moving, here: &Camera, next: &Camera, times: [f64; 2]) -> Vec<(DVec2, Option<DVec2>)> {
    let [here, next] = [Shot { camera: here, time: times[0] }, Shot { camera: next, time: times[1] }];
    let mut out = Vec::new();
    let is_whole = each_flow(system, &plane(here.camera), here, next, &|| true, |i, flow| {
        let pixel = DVec2::new((i % 20) as f64 + 0.5, (i / 20) as f64 + 0.5);
        out.push((pixel - DVec2::new(10.0, 8.0), flow));
    });
    assert!(is_whole && out.len() == 20 * 16, "{}", out.len());
    out
}

#[test]
fn flow_of_a_camera_that_moves_before_a_plane_is_the_closed_form() {
    let here = camera(DVec3::ZERO, 0.0);
    let roll = 0.3_f64;
    let turned = |from_middle: DVec2| DVec2::from_angle(-roll).rotate(from_middle) - from_middle;
    let shift = DVec2::new(-0.2, 0.5);
    let all: [(Camera, &dyn Fn(DVec2) -> DVec2); 4] = [
        (here, &|_| DVec2::ZERO),
        // Aside: all goes the other way, by focal length times way over depth.
        (camera(DVec3::new(0.2, -0.5, 0.0), 0.0), &|_| FOCAL / DEPTH * shift),
        // Ahead: away from the middle.
        (camera(DVec3::new(0.0, 0.0, 1.0), 0.0), &|from_middle| from_middle * (DEPTH / (DEPTH - 1.0) - 1.0)),
        (camera(DVec3::ZERO, roll), &turned),
    ];
    for (next, want) in all {
        for (from_middle, flow) in flows(&still(), &here, &next, [0.0, 1.0]) {
            let off = (flow.unwrap() - want(from_middle)).length();
            // Depths are `f32`.
            assert!(off < 1e-4, "{off} at {from_middle}");
        }
    }
}

#[test]
fn flow_of_what_moves_is_added_to_that_of_the_camera() {
    let here = camera(DVec3::ZERO, 0.0);
    let moving = Moving::by(DVec3::new(1.0, 0.5, 0.0));
    let next = camera(DVec3::new(0.2, 0.0, 0.0), 0.0);
    for (camera, want) in [(&here, DVec2::new(0.4, 0.2)), (&next, DVec2::new(0.2, 0.2))] {
        for (_, flow) in flows(&moving, &here, camera, [0.1, 0.5]) {
            // The search ends within a hundred-thousandth of the box: a thousandth of a pixel here.
            assert!((flow.unwrap() - FOCAL / DEPTH * want).length() < 5e-3, "{flow:?}");
        }
    }
}

#[test]
fn flow_is_not_known_where_nothing_is_seen_nobody_knows_the_way_or_the_next_camera_is_past_it() {
    let here = camera(DVec3::ZERO, 0.0);
    let past = camera(DVec3::new(0.0, 0.0, DEPTH + 1.0), 0.0);
    assert!(flows(&still(), &here, &past, [0.0, 1.0]).iter().all(|(_, flow)| flow.is_none()));
    // The right half of the picture.
    let half = Moving { lost: 0.0, ..still() };
    for (from_middle, flow) in flows(&half, &here, &here, [0.0, 1.0]) {
        assert_eq!(flow.is_none(), from_middle.x > 0.0, "{from_middle}");
    }
    let mut view = plane(&here);
    view.layers.median_depth[7] = f32::INFINITY;
    let shot = Shot { camera: &here, time: 0.0 };
    let mut called = Vec::new();
    each_flow(&still(), &view, shot, shot, &|| true, |i, flow| called.push((i, flow.is_some())));
    assert!(called.len() == 20 * 16 - 1 && called.iter().all(|(i, known)| *i != 7 && *known));
}

#[test]
fn the_flow_of_a_picture_holds_that_of_each_pixel_and_ends_when_it_is_stopped() {
    let here = camera(DVec3::ZERO, 0.0);
    let next = camera(DVec3::new(0.2, 0.0, 0.0), 0.1);
    // The right half of the picture is lost.
    let half = Moving { lost: 0.0, ..Moving::by(DVec3::new(0.0, 0.5, 0.0)) };
    let [at, then] = [Shot { camera: &here, time: 0.1 }, Shot { camera: &next, time: 0.5 }];
    let flow = whole_flow(&half, &plane(&here), at, then, &|| true).unwrap();
    let each = flows(&half, &here, &next, [0.1, 0.5]);
    assert_eq!((flow.width, flow.height, flow.seen.count()), (20, 16, 10 * 16));
    for ((vector, seen), (from_middle, want)) in flow.vectors.iter().zip(flow.seen.iter()).zip(each) {
        let want = want.map(|flow| flow.as_vec2().to_array());
        assert_eq!((seen, *vector), (want.is_some(), want.unwrap_or_default()), "{from_middle}");
    }
    assert_eq!(whole_flow(&half, &plane(&here), at, then, &|| false), None);
    assert_eq!(flow_in_place(&half, &plane(&here), at, &|| false), None);
}

#[test]
fn flow_in_place_goes_one_frame_on_and_at_the_end_as_it_came() {
    let here = camera(DVec3::new(0.1, 0.0, 0.0), 0.0);
    // A pixel down and two to the left in each of the 59 intervals.
    let moving = Moving::by(59.0 * DEPTH / FOCAL * DVec3::new(-2.0, 1.0, 0.0));
    assert_eq!(usual_step(), 1.0 / 59.0);
    for time in [0.0, 0.3, 58.0 / 59.0, 0.99, 1.0] {
        let flow = flow_in_place(&moving, &plane(&here), Shot { camera: &here, time }, &|| true).unwrap();
        assert_eq!(flow.seen.count(), 20 * 16);
        for [x, y] in &flow.vectors {
            assert!((x + 2.0).abs() < 5e-3 && (y - 1.0).abs() < 5e-3, "{time}: {x} {y}");
        }
    }
}

#[test]
fn a_path_has_one_scale_and_its_last_frame_no_flow() {
    let draw = |camera: &Camera, _: f64| Ok::<_, RunError>(plane(camera));
    let never = AtomicBool::new(false);
    let path = |system: &Moving, frames: usize| -> Result<(Vec<Option<RgbImage>>, Vec<String>), RunError> {
        let cameras = vec![camera(DVec3::ZERO, 0.0); frames];
        let path = FlowPath::new(system, cameras.clone(), TimePath::WHOLE, &draw, &never)?;
        let flow = |(i, camera): (usize, &Camera)| path.flow(i, &plane(camera));
        let pictures = cameras.iter().enumerate().map(|frame| flow(frame).map(|flow| path.picture(&flow))).collect();
        Ok((pictures, path.lines()))
    };
    // One pixel down in all three intervals. (Not to the right: there the wheel has its seam, and the last digit says on which side.)
    let (pictures, lines) = path(&Moving::by(DVec3::new(0.0, 3.0 * DEPTH / FOCAL, 0.0)), 4).unwrap();
    assert!(pictures.len() == 4 && pictures[3].is_none());
    for picture in pictures[..3].iter().flatten() {
        // Nine tenths of the way from red to yellow.
        for pixel in picture.pixels() {
            let off = pixel.0.iter().zip([255_u8, 231, 12]).map(|(got, want)| got.abs_diff(want)).max();
            assert!(off < Some(5), "{pixel:?}");
        }
    }
    assert!(lines.len() == 1 && lines[0].contains("fullest at 1.05 pixels"), "{lines:?}");
    // Nothing moves, and nobody says that anything does.
    let (pictures, lines) = path(&Moving { says: FlowSource::Nothing, ..still() }, 2).unwrap();
    assert!(pictures[0].iter().flat_map(|picture| picture.pixels()).all(|p| p.0 == [255; 3]), "white");
    assert!(lines[0].contains("fullest at 1.00 pixels"), "{lines:?}");
    assert!(lines.len() == 2 && lines[1].contains("the camera alone: `moving`"), "{lines:?}");
    let (pictures, _) = path(&Moving { lost: f64::NEG_INFINITY, ..still() }, 2).unwrap();
    assert!(pictures[0].iter().flat_map(|picture| picture.pixels()).all(|p| p.0 == [0; 3]), "not known");

    for frames in [0, 1] {
        let error = path(&still(), frames).unwrap_err().to_string();
        assert!(error.contains("`--layers flow`") && error.contains("--frames") && !error.contains('\n'), "{error}");
    }
    let failing = |_: &Camera, _: f64| Err::<Rendered, _>(RunError::Option("no picture".into()));
    let cameras = || vec![camera(DVec3::ZERO, 0.0); 2];
    assert!(FlowPath::new(&still(), cameras(), TimePath::WHOLE, &failing, &never).is_err());
    // Once it is stopped nothing more is drawn.
    let stopped = AtomicBool::new(true);
    assert!(FlowPath::new(&still(), cameras(), TimePath::WHOLE, &failing, &stopped).is_ok());
}

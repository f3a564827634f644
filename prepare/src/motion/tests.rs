//! What moves on the drawn stage.

use super::*;
use crate::flow::flow_both_ways;
use glam::DVec2;
use scene_io::synthetic::{Orbit, OrbitCamera, OrbitOptions, Snapshot, SnapshotView, orbit_views};
use scene_io::{BitMask, Image};

/// A picture of the stage with the two beside it in time.
struct Shot {
    views: [SnapshotView; 3],
    stage: [Snapshot; 3],
    photos: [Image; 3],
}

fn shot(camera: OrbitCamera, middle: usize) -> Shot {
    let options = OrbitOptions { train: 24, test: 0, camera, ..OrbitOptions::default() };
    let stage = Orbit::new(options.seed, options.motion);
    let all = orbit_views(&options);
    let views = [middle - 1, middle, middle + 1].map(|i| all[i].clone());
    let stage = [0, 1, 2].map(|i: usize| stage.at(views[i].time));
    let photos = [0, 1, 2].map(|i: usize| stage[i].render(&views[i].camera, options.rays).0);
    Shot { views, stage, photos }
}

impl Shot {
    /// Exact flow from the picture in the middle.
    fn exact(&self, to: usize) -> Flow {
        self.stage[1].flow_to(&self.views[1].camera, &self.stage[to], &self.views[to].camera).to_flow()
    }

    fn motion(&self, flows: [&Flow; 2]) -> Motion {
        let [back, on] = flows;
        let cameras = self.views.each_ref().map(|view| &view.camera);
        motion(cameras[1], &[Neighbour { camera: cameras[0], flow: back }, Neighbour { camera: cameras[2], flow: on }])
    }

    /// How far the point of a pixel of the picture in the middle goes off its line in another one, pixels, at most; 0 of what is still. `None` of
    /// what shows nothing.
    fn own_way(&self, column: u32, row: u32) -> Option<f64> {
        let camera = &self.views[1].camera;
        let hit = self.stage[1].hit(camera, DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5))?;
        let behind = camera.pose.c + (hit.x - camera.pose.c) * 1.2;
        let ways = [0, 2].map(|to: usize| {
            let camera = &self.views[to].camera;
            let (moved, stayed) = (camera.project(self.stage[to].place(&hit))?, camera.project(hit.x)?);
            let line = (camera.project(behind)? - stayed).normalize();
            Some((moved - stayed).perp_dot(line).abs())
        });
        Some(if hit.moves { ways.into_iter().flatten().fold(0.0, f64::max) } else { 0.0 })
    }
}

/// Intersection over union of what was found and what truly goes 2 pixels or more off its line, over judged pixels that do or are still; and how
/// many of these move.
fn score(shot: &Shot, motion: &Motion) -> (f64, usize) {
    let (mut both, mut either, mut moving) = (0, 0, 0);
    for (x, y) in (0..motion.moving.height()).flat_map(|y| (0..motion.moving.width()).map(move |x| (x, y))) {
        let way = shot.own_way(x, y).filter(|way| *way == 0.0 || *way >= 2.0);
        let Some(way) = way.filter(|_| motion.judged.get(x, y)) else { continue };
        let (is, should) = (motion.moving.get(x, y), way > 0.0);
        both += usize::from(is && should);
        either += usize::from(is || should);
        moving += usize::from(should);
    }
    (both as f64 / either.max(1) as f64, moving)
}

#[test]
fn exact_flow_gives_what_moves() {
    let shot = shot(OrbitCamera::Walking, 9);
    let motion = shot.motion([&shot.exact(0), &shot.exact(2)]);
    let (iou, moving) = score(&shot, &motion);
    assert!(moving > 200, "{moving} pixels move by 2 pixels: the test is void");
    assert!(!motion.is_blind() && iou > 0.6, "IoU {iou} of {moving} pixels");
}

#[test]
fn flow_of_photos_gives_what_moves() {
    let shot = shot(OrbitCamera::Walking, 9);
    let [before, here, after] = &shot.photos;
    let ([back, _], [on, _]) = (flow_both_ways(here, before), flow_both_ways(here, after));
    let truth = shot.exact(2);
    let both = (0..truth.height).flat_map(|y| (0..truth.width).map(move |x| (x, y)));
    let mut errors: Vec<f64> = both
        .filter(|(x, y)| truth.seen.get(*x, *y) && on.seen.get(*x, *y))
        .map(|(x, y)| {
            let k = (y * truth.width + x) as usize;
            let (is, should) = (on.vectors[k], truth.vectors[k]);
            f64::from((is[0] - should[0]).hypot(is[1] - should[1]))
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let middle = errors[errors.len() / 2];
    assert!(errors.len() > 1500 && middle < 0.3, "median error {middle} of {} pixels", errors.len());

    let motion = shot.motion([&back, &on]);
    let (iou, moving) = score(&shot, &motion);
    assert!(!motion.is_blind() && iou > 0.45, "IoU {iou} of {moving} pixels");
}

#[test]
fn where_nothing_moves_nothing_is_found() {
    let shot = shot(OrbitCamera::Walking, 9);
    // The same time from three places: only the camera moves.
    let [before, here, after] = shot.views.each_ref().map(|view| shot.stage[1].render(&view.camera, 3).0);
    let ([back, _], [on, _]) = (flow_both_ways(&here, &before), flow_both_ways(&here, &after));
    let motion = shot.motion([&back, &on]);
    let share = motion.moving.count() as f64 / motion.judged.count().max(1) as f64;
    assert!(motion.judged.count() > 1500 && share < 0.05, "{share} of {} pixels", motion.judged.count());
}

#[test]
fn a_camera_that_stands_still_judges_nothing() {
    let shot = shot(OrbitCamera::Frozen, 9);
    let motion = shot.motion([&shot.exact(0), &shot.exact(2)]);
    assert!(motion.is_blind());
    assert_eq!((motion.moving.count(), motion.judged.count()), (0, 0));
    let alone = super::motion(&shot.views[1].camera, &[]);
    assert!(alone.is_blind() && alone.judged.count() == 0);
}

#[test]
fn a_way_too_short_for_its_direction_judges_nothing() {
    let shot = shot(OrbitCamera::Frozen, 9);
    let mut near = shot.views[2].camera;
    // A tenth of a pixel at the distance of the stage.
    near.pose.c += near.pose.r.x_axis * 0.002;
    let flow = shot.stage[1].flow_to(&shot.views[1].camera, &shot.stage[1], &near);
    let vectors = flow.flow.iter().map(|way| [way.x as f32, way.y as f32]).collect();
    let seen = BitMask::from_fn(flow.width, flow.height, |_, _| true);
    let flow = Flow { width: flow.width, height: flow.height, vectors, seen };
    assert!(super::motion(&shot.views[1].camera, &[Neighbour { camera: &near, flow: &flow }]).is_blind());
}

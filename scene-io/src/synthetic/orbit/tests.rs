//! The stage against itself: what one picture knows, another must agree with.

use super::*;
use crate::Split;
use crate::synthetic::snapshot::testing::{is_deterministic, on_threads, pixels};
use crate::synthetic::snapshot::{Sight, SnapshotView};
use glam::DVec2;
use render_core::ray::Ray;

fn small() -> OrbitOptions {
    OrbitOptions { width: 36, height: 28, train: 5, val: 2, test: 3, rays: 2, ..OrbitOptions::default() }
}

#[test]
fn the_same_options_give_the_same_bytes_with_any_number_of_threads_and_other_seeds_do_not() {
    is_deterministic(|seed, threads| on_threads(threads, || orbit(&OrbitOptions { seed, ..small() })));
}

#[test]
fn a_scene_has_what_was_asked_for() {
    let scene = orbit(&small());
    assert_eq!([Split::Train, Split::Val, Split::Test].map(|s| scene.count(s)), [5, 2, 3]);
    let times = |split| scene.split(split).map(|i| scene.frames[i].time.unwrap()).collect::<Vec<_>>();
    assert_eq!(times(Split::Train), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(times(Split::Val), [0.125, 0.625]);
    assert!(times(Split::Test).iter().zip([1.0 / 6.0, 0.5, 5.0 / 6.0]).all(|(a, b)| (a - b).abs() < 1e-15));
    let names: std::collections::HashSet<_> = scene.frames.iter().map(|f| &f.name).collect();
    assert_eq!(names.len(), 10);
    for (frame, data) in scene.frames.iter().zip(pixels(&scene)) {
        let alpha: Vec<u8> = data.iter().skip(3).step_by(4).copied().collect();
        let share = |wanted: u8| alpha.iter().filter(|a| **a == wanted).count() as f64 / alpha.len() as f64;
        assert!(share(0) > 0.3 && share(255) > 0.2, "empty {}, full {}", share(0), share(255));
        assert!(share(0) + share(255) < 1.0, "no antialiased edge");
        assert_eq!(frame.depth.is_some(), frame.split != Split::Train);
        let moving = frame.read_moving().unwrap().unwrap().count() as f64 / alpha.len() as f64;
        assert!((0.04..0.3).contains(&moving), "{moving} of {} moves", frame.name);
    }
}

#[test]
fn cameras_jump_all_round_between_15_and_60_degrees() {
    let views = orbit_views(&OrbitOptions { train: 60, test: 20, ..small() });
    let away: Vec<DVec3> = views.iter().map(|v| (v.camera.pose.c - DVec3::new(0.0, 0.0, 0.3)).normalize()).collect();
    for (view, away) in views.iter().zip(&away) {
        assert!((14.9..60.1).contains(&away.z.asin().to_degrees()), "{}", view.name);
        assert!((view.camera.optical_axis() + *away).length() < 1e-12 && view.camera.pose.r.y_axis.z < 0.0);
    }
    // Neighbours in time are far apart, held-out poses are new but not far from a training pose.
    let far = (1..60).filter(|i| away[*i].dot(away[i - 1]).acos() > 0.6).count();
    assert!(far > 50, "{far} of 59 jumps");
    for test in &away[60..] {
        let nearest = away[..60].iter().map(|a| a.dot(*test).acos().to_degrees()).fold(f64::INFINITY, f64::min);
        assert!((0.2..22.0).contains(&nearest), "{nearest} degrees from the nearest training view");
    }
}

#[test]
fn everything_stays_in_its_box_at_all_times() {
    for motion in [OrbitMotion::Some, OrbitMotion::Everything] {
        for seed in 0..4 {
            let stage = Orbit::new(seed, motion);
            let Bounds { min, max } = stage.bounds();
            let camera = orbit_views(&OrbitOptions { train: 9, val: 0, test: 0, seed, ..small() });
            for view in camera {
                let truth = stage.at(view.time);
                for hit in truth.centres(&view.camera).into_iter().flatten() {
                    assert!(hit.x.cmpge(min).all() && hit.x.cmple(max).all(), "{} at {}", hit.x, view.time);
                }
            }
        }
    }
}

#[test]
fn points_lie_on_what_stands_still() {
    let scene = orbit(&small());
    assert!(scene.points.len() > 20, "{} points", scene.points.len());
    for time in [0.0, 0.3, 1.0] {
        let snapshot = Orbit::new(small().seed, OrbitMotion::Some).at(time);
        for point in &scene.points {
            // A short ray from just outside meets a thing that stands still there, at all times.
            let on = |away: DVec3| {
                let ray = Ray { o: point.xyz + away * 1e-3, d: -away };
                snapshot.trace(&ray).is_some_and(|hit| !hit.moves && (hit.x - point.xyz).length() < 1e-6)
            };
            let around =
                (0..26).map(|k| DVec3::new(f64::from(k % 3) - 1.0, f64::from(k / 3 % 3) - 1.0, f64::from(k / 9) - 1.0));
            assert!(around.filter(|d| *d != DVec3::ZERO).any(|d| on(d.normalize())), "{}", point.xyz);
        }
    }
    assert!(orbit(&OrbitOptions { motion: OrbitMotion::Everything, ..small() }).points.is_empty());
}

#[test]
fn nothing_runs_into_anything_else() {
    // The arm's parts hold together; everything else keeps apart, and above the ground.
    let arm = |thing: usize| thing == 4 || thing >= 8;
    for (seed, i) in (0..3).flat_map(|seed| (0..=20).map(move |i| (seed, i))) {
        let snapshot = Orbit::new(seed, OrbitMotion::Some).at(f64::from(i) * 0.05);
        let c = DVec3::new(0.0, 0.0, 0.3);
        for (a, thing) in snapshot.things.iter().enumerate().skip(1) {
            let middle = thing.posed.placement.c.lerp(c, 0.02);
            for k in 0..200_u64 {
                let draw = |j: u64| crate::random::random(9, 2 * k + j);
                let (z, turn) = (2.0 * draw(0) - 1.0, std::f64::consts::TAU * draw(1));
                let d = (DVec2::from_angle(turn) * (1.0 - z * z).sqrt()).extend(z);
                let ray = Ray { o: middle + d * 2.0, d: -d };
                let Some(hit) = thing.posed.hit(&ray, 0.0) else { continue };
                let x = ray.at(hit.t);
                assert!(x.z > -1e-9, "thing {a} is in the ground at {x}");
                for (b, other) in snapshot.things.iter().enumerate().skip(1) {
                    let apart = a == b || (arm(a) && arm(b)) || !other.posed.contains(x);
                    assert!(apart, "{a} runs into {b} at {}, seed {seed}", snapshot.time());
                }
            }
        }
    }
}

/// Pairs of views of a stage: all times, all poses.
fn pairs() -> (Orbit, Vec<SnapshotView>) {
    let options = OrbitOptions { width: 40, height: 40, train: 7, val: 0, test: 0, seed: 1, ..OrbitOptions::default() };
    (Orbit::new(1, OrbitMotion::Some), orbit_views(&options))
}

#[test]
fn a_followed_point_has_the_depth_and_the_colour_the_other_picture_shows() {
    let (stage, views) = pairs();
    let mut seen = [0; 2];
    for (a, b) in views.iter().flat_map(|a| views.iter().map(move |b| (a, b))) {
        let (now, then) = (stage.at(a.time), stage.at(b.time));
        let flow = now.flow_to(&a.camera, &then, &b.camera);
        for (i, hit) in now.centres(&a.camera).into_iter().enumerate() {
            let Some(hit) = hit else {
                assert_eq!((flow.sight[i], flow.flow[i]), (Sight::Empty, DVec2::ZERO));
                continue;
            };
            let centre = DVec2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
            let target = centre + flow.flow[i];
            let x = then.place(&hit);
            assert!((x - hit.x - flow.moved[i]).length() < 1e-12);
            if !hit.moves {
                assert!(flow.moved[i].length() < 1e-12, "a thing that stands still moves by {}", flow.moved[i]);
            }
            let Some(there) = then.hit(&b.camera, target) else {
                // Grazing points may fall off the silhouette by rounding.
                assert_ne!(flow.sight[i], Sight::Seen);
                continue;
            };
            let way = |p: DVec3| (p - b.camera.pose.c).dot(b.camera.optical_axis());
            match flow.sight[i] {
                Sight::Seen => {
                    assert!((way(there.x) - way(x)).abs() < 1e-6, "{} against {}", way(there.x), way(x));
                    assert!((there.rgb - hit.rgb).length() < 1e-4, "{} against {}", there.rgb, hit.rgb);
                    assert_eq!(there.thing, hit.thing);
                    seen[usize::from(hit.moves)] += 1;
                }
                Sight::Hidden => assert!(way(there.x) < way(x) + 1e-6, "{} is in front of {}", x, there.x),
                Sight::Outside | Sight::Empty => {}
            }
        }
        if a == b {
            assert!(flow.flow.iter().all(|f| f.length() < 1e-9));
            assert!(flow.sight.iter().all(|s| matches!(s, Sight::Seen | Sight::Empty)));
        }
    }
    assert!(seen[0] > 5_000 && seen[1] > 1_000, "{seen:?} points compared");
}

#[test]
fn flow_there_and_back_is_nothing() {
    let (stage, views) = pairs();
    let (a, b) = (&views[1], &views[4]);
    let (now, then) = (stage.at(a.time), stage.at(b.time));
    let mut compared = 0;
    for hit in now.centres(&a.camera).into_iter().flatten() {
        let (Some(pixel), Sight::Seen) = then.find(&hit, &b.camera) else { continue };
        let there = then.hit(&b.camera, pixel).unwrap();
        let (back, sight) = now.find(&there, &a.camera);
        let (start, _) = now.find(&hit, &a.camera);
        assert_eq!(sight, Sight::Seen);
        assert!((back.unwrap() - start.unwrap()).length() < 1e-5);
        compared += 1;
    }
    assert!(compared > 50, "{compared} points");
}

#[test]
fn truth_is_what_the_picture_shows() {
    let (stage, views) = pairs();
    for view in &views {
        let snapshot = stage.at(view.time);
        let truth = snapshot.truth(&view.camera);
        let (image, moving) = snapshot.render(&view.camera, 3);
        for (i, z) in truth.z.iter().enumerate() {
            let (column, row) = (i as u32 % 40, i as u32 / 40);
            // The middle ray of nine is the pixel's centre.
            assert!(*z == 0.0 || image.pixel(column, row)[3] > 0);
            assert!(!truth.moving[i] || moving.get(column, row));
            assert_eq!(*z == 0.0, truth.thing[i].is_none());
            assert!(*z == 0.0 || (2.8..5.2).contains(z), "{z}");
        }
        let centres = truth.moving.iter().filter(|m| **m).count() as u64;
        assert!(moving.count() >= centres && moving.count() < 3 * centres, "{} of {centres}", moving.count());
    }
}

#[test]
fn nothing_moves_everything_moves_and_some_things_do() {
    let scene = |motion| orbit(&OrbitOptions { motion, camera: OrbitCamera::Frozen, ..small() });
    let still = scene(OrbitMotion::Nothing);
    let all = pixels(&still);
    assert!(all.iter().all(|p| *p == all[0]), "a frozen camera before a stage where nothing moves");
    assert!(still.frames.iter().all(|f| f.read_moving().unwrap().unwrap().count() == 0));
    assert!(still.frames.iter().all(|f| f.camera == still.frames[0].camera));
    let some = scene(OrbitMotion::Some);
    assert!(pixels(&some)[1..].iter().all(|p| *p != pixels(&some)[0]));
    // Only what the masks of both pictures name changes.
    let (a, b) = (&some.frames[0], &some.frames[2]);
    let masks = [a, b].map(|f| f.read_moving().unwrap().unwrap());
    for (i, (a, b)) in pixels(&some)[0].chunks(4).zip(pixels(&some)[2].chunks(4)).enumerate() {
        let at = (i as u32 % 36, i as u32 / 36);
        assert!(a == b || masks.iter().any(|m| m.get(at.0, at.1)), "{at:?} changes and nothing moves there");
    }
    let everything = scene(OrbitMotion::Everything);
    for (frame, data) in everything.frames.iter().zip(pixels(&everything)) {
        let covered = data.iter().skip(3).step_by(4).filter(|a| **a > 0).count() as u64;
        assert_eq!(frame.read_moving().unwrap().unwrap().count(), covered);
    }
}

#[test]
fn one_frame_is_at_time_0_and_none_are_none() {
    let one = orbit(&OrbitOptions { train: 1, val: 0, test: 0, ..small() });
    assert_eq!((one.frames.len(), one.frames[0].time), (1, Some(0.0)));
    assert!(orbit(&OrbitOptions { train: 0, val: 0, test: 0, ..small() }).frames.is_empty());
}

#[test]
fn test_frames_know_where_the_one_nearby_shows_their_points() {
    for camera in [OrbitCamera::Jumping, OrbitCamera::Frozen] {
        let options = OrbitOptions { camera, test: 4, ..small() };
        let scene = orbit(&options);
        let tests: Vec<&crate::Frame> = scene.frames.iter().filter(|f| f.split == Split::Test).collect();
        assert!(scene.frames.iter().all(|f| f.truth.flow.is_some() == (f.split == Split::Test)));
        let stage = Orbit::new(options.seed, options.motion);
        for (i, frame) in tests.iter().enumerate() {
            let (flow, to) = frame.read_flow().unwrap().unwrap();
            let other = tests.iter().find(|f| f.name == to).unwrap();
            assert_ne!(other.name, frame.name);
            if camera == OrbitCamera::Frozen {
                assert_eq!(other.name, tests[(i + 1) % 4].name, "all stand in one place: the next one");
            }
            let away = |f: &crate::Frame| (f.camera.pose.c - frame.camera.pose.c).length();
            assert!(tests.iter().all(|f| f.name == frame.name || away(f) >= away(other)));
            let moments = [frame.time, other.time].map(|t| stage.at(t.unwrap()));
            let exact = moments[0].flow_to(&frame.camera, &moments[1], &other.camera);
            assert!(flow.seen.count() > 0);
            for (k, (way, exact)) in flow.vectors.iter().zip(&exact.flow).enumerate() {
                assert!((way[0] - exact.x as f32).abs() + (way[1] - exact.y as f32).abs() < 1e-4, "pixel {k}");
            }
        }
    }
    // One alone has no other.
    assert!(orbit(&OrbitOptions { test: 1, ..small() }).frames.iter().all(|f| f.truth.flow.is_none()));
}

#[test]
fn held_out_frames_know_where_their_points_go_one_training_frame_on() {
    let options = small();
    let scene = orbit(&options);
    let stage = Orbit::new(options.seed, options.motion);
    let mut longest = 0.0_f64;
    for frame in &scene.frames {
        assert_eq!(frame.truth.scene_flow.is_some(), frame.split.is_measured(), "{}", frame.name);
        let Some(truth) = &frame.truth.scene_flow else { continue };
        let time = frame.time.unwrap();
        // Five training frames, a quarter of the sequence apart; at the end one frame back.
        let to = if time > 0.75 { time - 0.25 } else { time + 0.25 };
        assert!((truth.to - to).abs() < 1e-12, "{} goes to {}, not {to}", frame.name, truth.to);
        let (now, then) = (stage.at(time), stage.at(truth.to));
        // A camera that stays where it is shows the way of a point as its optical flow.
        let (flow, camera) = (now.flow_to(&frame.camera, &then, &frame.camera), frame.camera.prepare());
        let mut count = [0; 2];
        for point in &truth.points {
            let pixel = camera.project(point.x.into()).unwrap();
            let k = pixel.y as usize * options.width as usize + pixel.x as usize;
            assert!((DVec3::from(point.way) - flow.moved[k]).length() < 1e-9, "{point:?}");
            assert!((point.optical_flow(&camera).unwrap() - flow.flow[k]).length() < 1e-6, "{point:?}");
            let way = DVec3::from(point.way).length();
            assert!(point.moves || way < 1e-12, "what stands still goes {way}");
            count[usize::from(point.moves)] += 1;
            longest = longest.max(way);
        }
        assert!(count.iter().all(|n| *n > 10), "{count:?} of {}", frame.name);
    }
    assert!((0.2..2.0).contains(&longest), "{longest}");
    // Nothing is beside a single frame.
    assert!(orbit(&OrbitOptions { train: 1, ..small() }).frames.iter().all(|f| f.truth.scene_flow.is_none()));
}

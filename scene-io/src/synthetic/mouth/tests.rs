//! The mouth against itself: its pieces come apart and together, and what one picture knows another must agree with.

use super::lips::{HALF, MIDDLE, ROUND};
use super::*;
use crate::bit_mask::BitMask;
use crate::random::random;
use crate::synthetic::shape::{Placed, Shape};
use crate::synthetic::snapshot::testing::{is_deterministic, on_threads, pixels};
use crate::synthetic::snapshot::{Sight, SnapshotView};
use crate::{Frame, Split};
use glam::{DMat3, DVec2};
use render_core::camera::{Camera, Pose};
use render_core::ray::Ray;

/// Where the lips are among the things: upper, left half, right half.
const LIPS: [usize; 3] = [4, 5, 6];

fn small() -> MouthOptions {
    MouthOptions { width: 36, height: 28, train: 5, val: 2, test: 4, rays: 2, ..MouthOptions::default() }
}

/// Someone who stands right before the mouth.
fn front(side: u32) -> Camera {
    let pose = Pose::look_at(DVec3::new(0.03, -3.9, 0.02), DVec3::ZERO, DVec3::Z).unwrap();
    let (half, focal) = (0.5 * f64::from(side), 1.6 * f64::from(side));
    Camera::pinhole(side, side, focal, focal, half, half, pose)
}

/// Cameras of a few training, validation and test pictures of 40 x 40 pixels.
fn views() -> Vec<SnapshotView> {
    mouth_views(&MouthOptions { width: 40, height: 40, train: 7, val: 3, test: 4, seed: 1, ..MouthOptions::default() })
}

/// The pixels whose centre shows the mouth.
fn seen(snapshot: &Snapshot, camera: &Camera) -> BitMask {
    let moving = snapshot.truth(camera).moving;
    BitMask::from_fn(camera.width, camera.height, |column, row| moving[(row * camera.width + column) as usize])
}

/// Number of connected pieces of a mask, over sides of pixels.
fn pieces(mask: &BitMask) -> usize {
    let (w, h) = (mask.width(), mask.height());
    let mut found = BitMask::new(w, h);
    let mut count = 0;
    for (column, row) in (0..h).flat_map(|row| (0..w).map(move |column| (column, row))) {
        if !mask.get(column, row) || found.get(column, row) {
            continue;
        }
        count += 1;
        let mut open = vec![[column, row]];
        while let Some([x, y]) = open.pop() {
            if x >= w || y >= h || !mask.get(x, y) || found.get(x, y) {
                continue;
            }
            found.set(x, y);
            // Left of column 0 is beyond the last one.
            open.extend([[x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]]);
        }
    }
    count
}

#[test]
fn pieces_of_a_mask_are_counted() {
    let mask = |rows: [&str; 3]| {
        let set = |column: u32, row: u32| rows[row as usize].as_bytes()[column as usize] == b'#';
        pieces(&BitMask::from_fn(5, 3, set))
    };
    assert_eq!(mask([".....", ".....", "....."]), 0);
    assert_eq!(mask(["#####", "#...#", "#####"]), 1);
    assert_eq!(mask(["##.##", "#....", "##..#"]), 3);
    assert_eq!(mask(["#.#.#", ".#.#.", "#.#.#"]), 8, "corners do not connect");
}

#[test]
fn the_mouth_is_one_piece_then_two_then_three_and_then_one_again() {
    let mouth = Mouth::new(0);
    let camera = front(64);
    let counts = [0.0, 0.05, 0.31, 0.5, 0.69, 0.95, 1.0].map(|time| pieces(&seen(&mouth.at(time), &camera)));
    assert_eq!(counts, [1, 1, 2, 3, 2, 1, 1]);
    for view in views() {
        let count = |time: f64| pieces(&seen(&mouth.at(time), &view.camera));
        assert_eq!([count(0.0), count(1.0)], [1, 1], "{}", view.name);
        assert!(count(0.5) >= 2, "{}: split, and {} pieces", view.name, count(0.5));
    }
}

#[test]
fn time_1_looks_as_time_0_does_and_no_time_between() {
    let mouth = Mouth::new(2);
    let camera = front(48);
    let picture = |time: f64| mouth.at(time).render(&camera, 2);
    let (first, mask) = picture(0.0);
    let (last, last_mask) = picture(1.0);
    assert_eq!(first.data, last.data);
    assert_eq!(mask, last_mask);
    assert_eq!(mouth.at(0.0).truth(&camera), mouth.at(1.0).truth(&camera));
    for time in [0.2, 0.31, 0.4, 0.5, 0.6, 0.8] {
        assert_ne!(picture(time).0.data, first.data, "at {time}");
    }
}

#[test]
fn closed_lips_are_the_whole_block_and_nothing_of_a_cut_is_seen() {
    let mouth = Mouth::new(0);
    let mut met = 0;
    // Bowed a little at the times between.
    for time in [0.0, 0.05, 0.95, 1.0] {
        let snapshot = mouth.at(time);
        let upper = snapshot.placement(LIPS[0]);
        let shape = Shape::Cut { radii: HALF * ROUND, low: -HALF, high: HALF };
        let whole = Placed { shape, r: upper.r, c: upper.c };
        for view in views() {
            for (column, row) in (0..40).flat_map(|row| (0..40).map(move |column| (column, row))) {
                let ray = view.camera.ray(DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5)).unwrap();
                let hit = snapshot.trace(&ray);
                let Some((t, normal, q)) = whole.hit(&ray, 0.0) else {
                    assert!(hit.is_none_or(|hit| !hit.moves), "a lip beside the block");
                    continue;
                };
                let hit = hit.unwrap();
                assert!(hit.moves && (hit.t - t).abs() < 1e-12, "{} against {t}", hit.t);
                assert!((hit.normal - normal).length() < 1e-12 && (hit.material - q).length() < 1e-12);
                met += 1;
            }
        }
    }
    assert!(met > 5_000, "{met} points");
    assert_eq!(mouth.at(0.0).placement(LIPS[1]).c, MIDDLE);
}

#[test]
fn flesh_is_seen_while_the_mouth_is_open_and_looks_different() {
    let mouth = Mouth::new(0);
    // How many pixels show a cut, and the means of red less green there and on the skin.
    let flesh = |time: f64| {
        let snapshot = mouth.at(time);
        let (mut count, mut red) = ([0_u32; 2], [0.0; 2]);
        for hit in snapshot.centres(&front(64)).into_iter().flatten().filter(|hit| hit.moves) {
            let rest_normal = snapshot.placement(hit.thing).r.transpose() * hit.normal;
            let k = usize::from(hit.material.dot(rest_normal).abs() < 1e-9);
            count[k] += 1;
            red[k] += hit.rgb.x - hit.rgb.y;
        }
        (count[1], [0, 1].map(|k| red[k] / f64::from(count[k].max(1))))
    };
    assert_eq!([0.0, 0.05, 0.95, 1.0].map(|time| flesh(time).0), [0; 4]);
    for time in [0.31, 0.5, 0.69] {
        let (count, [skin, flesh]) = flesh(time);
        assert!(count > 40 && flesh > skin + 0.1, "{count} pixels, {flesh} against {skin}");
    }
}

#[test]
fn rays_meet_the_lips_where_the_material_ends() {
    let mouth = Mouth::new(0);
    let mut met = [0; 3];
    for (view, time) in views().iter().zip([0.0, 0.15, 0.25, 0.36, 0.4, 0.45, 0.5, 0.6, 0.65, 0.8, 0.9]) {
        let snapshot = mouth.at(time);
        for hit in snapshot.centres(&view.camera).into_iter().flatten().filter(|hit| hit.moves) {
            let q = hit.material;
            assert!((snapshot.placement(hit.thing).place(q) - hit.x).length() < 1e-12);
            assert!((snapshot.placement(hit.thing).material(hit.x) - q).length() < 1e-12);
            let thing = &snapshot.things[hit.thing];
            let [outside, inside] = [1e-6, -1e-6].map(|way| hit.x + hit.normal * way);
            assert!(!thing.posed.contains(outside) && thing.posed.contains(inside), "{q} at {time}");
            // On one of: the ellipsoid, a plane of the whole block, a cut through its middle.
            let round = ((q / (HALF * ROUND)).length_squared() - 1.0).abs() < 1e-12;
            let plane = (0..3).any(|axis| (q[axis].abs() - HALF[axis]).abs() < 1e-12);
            let cut = q.x.abs() < 1e-12 || q.z.abs() < 1e-12;
            assert!(round || plane || cut, "{q} at {time}");
            met[hit.thing - LIPS[0]] += 1;
        }
    }
    assert!(met.iter().all(|met| *met > 200), "{met:?}");
}

#[test]
fn a_followed_point_keeps_its_material_and_has_the_depth_and_the_colour_the_other_picture_shows() {
    let (mouth, views) = (Mouth::new(1), views());
    let mut seen = [0; 2];
    for (a, b) in views.iter().flat_map(|a| views.iter().map(move |b| (a, b))) {
        let (now, then) = (mouth.at(a.time), mouth.at(b.time));
        let flow = now.flow_to(&a.camera, &then, &b.camera);
        for (i, hit) in now.centres(&a.camera).into_iter().enumerate() {
            let Some(hit) = hit else {
                assert_eq!((flow.sight[i], flow.flow[i]), (Sight::Empty, DVec2::ZERO));
                continue;
            };
            let x = then.place(&hit);
            assert!((x - hit.x - flow.moved[i]).length() < 1e-12);
            if !hit.moves {
                assert!(flow.moved[i].length() < 1e-12, "the board moves by {}", flow.moved[i]);
            }
            let centre = DVec2::new((i % 40) as f64 + 0.5, (i / 40) as f64 + 0.5);
            let Some(there) = then.hit(&b.camera, centre + flow.flow[i]) else {
                // Grazing points may fall off the silhouette by rounding.
                assert_ne!(flow.sight[i], Sight::Seen);
                continue;
            };
            let way = |p: DVec3| (p - b.camera.pose.c).dot(b.camera.optical_axis());
            match flow.sight[i] {
                Sight::Seen => {
                    assert_eq!(there.thing, hit.thing);
                    assert!((there.material - hit.material).length() < 1e-6);
                    assert!((way(there.x) - way(x)).abs() < 1e-6, "{} against {}", way(there.x), way(x));
                    assert!((there.rgb - hit.rgb).length() < 1e-4, "{} against {}", there.rgb, hit.rgb);
                    seen[usize::from(hit.moves)] += 1;
                }
                Sight::Hidden => assert!(way(there.x) < way(x) + 1e-6, "{} is in front of {}", x, there.x),
                Sight::Outside | Sight::Empty => {}
            }
        }
    }
    assert!(seen[0] > 20_000 && seen[1] > 5_000, "{seen:?} points compared");
}

#[test]
fn no_lip_runs_into_anything() {
    let mouth = Mouth::new(0);
    let middles = [[0.0, 0.0, 0.5], [-0.5, 0.0, -0.5], [0.5, 0.0, -0.5]].map(|m| DVec3::from(m) * HALF);
    for time in (0..=100).map(|i| f64::from(i) * 0.01) {
        let snapshot = mouth.at(time);
        for (a, middle) in LIPS.into_iter().zip(middles) {
            let lip = &snapshot.things[a];
            let o = lip.posed.placement.place(middle);
            for k in 0..100_u64 {
                let (z, turn) = (2.0 * random(9, 2 * k) - 1.0, std::f64::consts::TAU * random(9, 2 * k + 1));
                let d = (DVec2::from_angle(turn) * (1.0 - z * z).sqrt()).extend(z);
                let out = lip.posed.hit(&Ray { o, d }, 0.0).unwrap();
                // Lips that touch have their faces in one place, and nothing behind them.
                let x = o + d * out.t - out.normal * 1e-6;
                for (b, other) in snapshot.things.iter().enumerate() {
                    assert!(a == b || !other.posed.contains(x), "{a} runs into {b} at {time}: {x}");
                }
            }
        }
    }
}

#[test]
fn everything_stays_in_its_box_and_the_board_where_it_is() {
    let mouth = Mouth::new(3);
    let Bounds { min, max } = mouth.bounds();
    for time in (0..=20).map(|i| f64::from(i) * 0.05) {
        let snapshot = mouth.at(time);
        for hit in views().iter().flat_map(|view| snapshot.centres(&view.camera)).flatten() {
            assert!(hit.x.cmpge(min).all() && hit.x.cmple(max).all(), "{} at {time}", hit.x);
            assert_eq!(hit.moves, LIPS.contains(&hit.thing));
        }
        let still = (0..LIPS[0]).map(|thing| snapshot.placement(thing));
        assert!(still.clone().all(|p| p.r == DMat3::IDENTITY), "{time}");
        assert!(still.zip(0..).all(|(p, thing)| p == mouth.at(0.0).placement(thing)), "{time}");
    }
}

#[test]
fn points_lie_on_what_stands_still() {
    let scene = mouth(&small());
    assert!(scene.points.len() > 50, "{} points", scene.points.len());
    for time in [0.0, 0.5, 1.0] {
        let snapshot = Mouth::new(small().seed).at(time);
        for point in &scene.points {
            // A short ray from just outside meets a thing that stands still there, at all times.
            let on = |away: DVec3| {
                let ray = Ray { o: point.xyz + away * 1e-3, d: -away };
                snapshot.trace(&ray).is_some_and(|hit| !hit.moves && (hit.x - point.xyz).length() < 1e-6)
            };
            let sides = [-DVec3::Y, -DVec3::X, DVec3::X, -DVec3::Z, DVec3::Z];
            assert!(sides.into_iter().any(on), "{}", point.xyz);
        }
    }
}

#[test]
fn the_same_options_give_the_same_bytes_with_any_number_of_threads_and_other_seeds_do_not() {
    is_deterministic(|seed, threads| on_threads(threads, || mouth(&MouthOptions { seed, ..small() })));
}

#[test]
fn a_scene_has_what_was_asked_for() {
    let scene = mouth(&small());
    assert_eq!([Split::Train, Split::Val, Split::Test].map(|s| scene.count(s)), [5, 2, 4]);
    let times = |split| scene.split(split).map(|i| scene.frames[i].time.unwrap()).collect::<Vec<_>>();
    assert_eq!(times(Split::Train), [0.0, 0.25, 0.5, 0.75, 1.0]);
    assert_eq!(times(Split::Val), [0.125, 0.625]);
    assert_eq!(times(Split::Test), [0.0, 0.375, 0.5, 0.875], "by turns at a training picture's time and between two");
    let names: std::collections::HashSet<_> = scene.frames.iter().map(|f| &f.name).collect();
    assert_eq!(names.len(), 11);
    for (frame, data) in scene.frames.iter().zip(pixels(&scene)) {
        let alpha: Vec<u8> = data.iter().skip(3).step_by(4).copied().collect();
        let share = |wanted: u8| alpha.iter().filter(|a| **a == wanted).count() as f64 / alpha.len() as f64;
        assert!(share(0) > 0.05 && share(255) > 0.4, "empty {}, full {}", share(0), share(255));
        assert_eq!(frame.depth.is_some(), frame.split != Split::Train);
        let moving = frame.read_moving().unwrap().unwrap().count() as f64 / alpha.len() as f64;
        assert!((0.08..0.5).contains(&moving), "{moving} of {} moves", frame.name);
    }
}

#[test]
fn half_of_the_test_pictures_are_taken_at_times_of_training_pictures() {
    for train in [2, 13, 80] {
        let views = mouth_views(&MouthOptions { train, val: 0, test: 12, ..small() });
        let times: Vec<f64> = views[..train].iter().map(|v| v.time).collect();
        for (i, view) in views[train..].iter().enumerate() {
            assert_eq!(times.contains(&view.time), i.is_multiple_of(2), "picture {i} at {}", view.time);
            assert!((0.0..=1.0).contains(&view.time));
        }
    }
}

#[test]
fn cameras_stand_before_the_mouth_and_held_out_ones_between_the_others() {
    let views = mouth_views(&MouthOptions { train: 60, val: 10, test: 20, ..small() });
    let away: Vec<DVec3> = views.iter().map(|v| -v.camera.optical_axis()).collect();
    for (view, away) in views.iter().zip(&away) {
        let (turn, rise) = (away.x.atan2(-away.y), away.z.asin());
        let share = if view.split == Split::Train { 1.0 } else { 0.86 };
        assert!(turn.abs() < 0.61 * share && (rise - 0.08).abs() < 0.27 * share, "{}: {turn} {rise}", view.name);
        assert!(view.camera.pose.r.y_axis.z < 0.0, "{} is upright", view.name);
    }
    for held_out in &away[60..] {
        let nearest = away[..60].iter().map(|a| a.dot(*held_out).acos().to_degrees()).fold(f64::INFINITY, f64::min);
        assert!((0.05..12.0).contains(&nearest), "{nearest} degrees from the nearest training view");
    }
}

#[test]
fn held_out_frames_know_where_the_one_of_their_split_nearby_shows_their_points() {
    let options = small();
    let scene = mouth(&options);
    assert!(scene.frames.iter().all(|f| f.truth.flow.is_some() == f.split.is_measured()));
    assert!(scene.frames.iter().all(|f| f.truth.scene_flow.is_some() == f.split.is_measured()));
    let stage = Mouth::new(options.seed);
    for frame in scene.frames.iter().filter(|f| f.split.is_measured()) {
        let (flow, to) = frame.read_flow().unwrap().unwrap();
        let all: Vec<&Frame> = scene.frames.iter().filter(|f| f.split == frame.split && f.name != frame.name).collect();
        let other = all.iter().find(|f| f.name == to).unwrap();
        let away = |f: &Frame| (f.camera.pose.c - frame.camera.pose.c).length();
        assert!(all.iter().all(|f| away(f) >= away(other)));
        let [now, then] = [frame.time, other.time].map(|t| stage.at(t.unwrap()));
        let exact = now.flow_to(&frame.camera, &then, &other.camera);
        assert!(flow.seen.count() > 0);
        for (k, (way, exact)) in flow.vectors.iter().zip(&exact.flow).enumerate() {
            assert!((way[0] - exact.x as f32).abs() + (way[1] - exact.y as f32).abs() < 1e-4, "pixel {k}");
        }
    }
    // One alone has no other.
    let alone = mouth(&MouthOptions { val: 1, test: 1, ..options });
    assert!(alone.frames.iter().all(|f| f.truth.flow.is_none()));
}

#[test]
fn one_frame_is_at_time_0_none_are_none_and_one_pixel_shows_the_mouth() {
    let one = mouth(&MouthOptions { train: 1, val: 0, test: 0, ..small() });
    assert_eq!((one.frames.len(), one.frames[0].time), (1, Some(0.0)));
    assert!(mouth(&MouthOptions { train: 0, val: 0, test: 0, ..small() }).frames.is_empty());
    // Nothing to be between.
    for train in [0, 1] {
        let views = mouth_views(&MouthOptions { train, val: 0, test: 2, ..small() });
        assert!(views[train..].iter().map(|v| v.time).eq([0.25, 0.75]));
    }
    let dot = mouth(&MouthOptions { width: 1, height: 1, angle: 0.01, train: 2, val: 1, test: 1, ..small() });
    for frame in dot.frames.iter().filter(|f| f.split == Split::Train) {
        assert_eq!(frame.read_moving().unwrap().unwrap().count(), 1, "{}", frame.name);
    }
}

use super::made::MadeSettings;
use super::time::TimeSteps;
use super::*;
use field_core::rng::Rng;
use std::sync::atomic::Ordering::Relaxed;

pub(super) fn settings(kind: TimeKind, motion: Motion) -> MadeSettings {
    MadeSettings {
        time: TimeSettings { kind, octaves: 2, dims: 4, width: 16, rate: 1.0, code_rate: 1.0, warmup: 0.0 },
        warp: WarpSettings { motion, origin: Origin::Free, octaves: 3, anneal: 0.0, depth: 2 },
        ambient: AmbientSettings { dims: 2, octaves: 2, width: 8, depth: 2, from: 0.0, anneal: 0.0 },
        planes: PlaneSettings {
            cells: vec![3, 5],
            features: 2,
            times: 4,
            rate: 1.0,
            seen_by: SeenBy::Both,
            ..PlaneSettings::NONE
        },
        density: DensitySettings { sees: Sees::Point, octaves: 2 },
    }
}

/// The same with a warp alone.
fn warp_alone(kind: TimeKind, motion: Motion) -> MadeSettings {
    let all = settings(kind, motion);
    MadeSettings {
        ambient: AmbientSettings { dims: 0, ..all.ambient },
        planes: PlaneSettings::NONE,
        density: DensitySettings::PLACE,
        ..all
    }
}

/// A deformation whose parameters are all of some size.
pub(super) fn busy(settings: MadeSettings) -> Deform {
    let mut deform = settings.deform(Times::of_list(&[0.0, 0.4, 1.0]), 3);
    let mut noise = vec![0.0; deform.params.len()];
    Rng::new(5, 7).fill_uniform(0, &mut noise);
    deform.params.iter_mut().zip(noise).for_each(|(p, u)| *p += 0.3 * (u - 0.5));
    deform.done = 0.01;
    deform.renew();
    deform
}

fn points(n: usize) -> (Vec<f32>, Vec<u32>) {
    let mut x = vec![0.0; 3 * n];
    Rng::new(1, 2).fill_uniform(0, &mut x);
    (x, (0..n as u32).map(|i| i % 3).collect())
}

/// Sum of the outputs times fixed factors.
fn value(deform: &Deform, x: &[f32], which: &[u32], bars: &(Vec<f32>, Vec<f32>)) -> f64 {
    let n = which.len();
    let (mut there, mut seen) = (vec![0.0; 3 * n], vec![0.0; deform.seen_rows() * n]);
    let points = Points { x, which, time_steps: deform.time_steps() };
    deform.place(points, &mut there, &mut seen, &mut DeformScratch::default());
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    dot(&there, &bars.0) + dot(&seen, &bars.1)
}

#[test]
fn gradients_of_networks_time_steps_and_points_are_those_of_differences() {
    for (kind, motion) in [
        (TimeKind::Time, Motion::Translation),
        (TimeKind::Codes, Motion::Rigid),
        (TimeKind::Network, Motion::Translation),
    ] {
        let mut deform = busy(settings(kind, motion));
        let n = 7;
        let (x, which) = points(n);
        let mut bars = (vec![0.0; 3 * n], vec![0.0; deform.seen_rows() * n]);
        Rng::new(8, 9).fill_uniform(0, &mut bars.0);
        Rng::new(8, 10).fill_uniform(0, &mut bars.1);
        let mut grad = DeformGrad::default();
        grad.begin(&deform);
        let mut x_bar = bars.0.clone();
        let at = Points { x: &x, which: &which, time_steps: deform.time_steps() };
        deform.learn(at, &mut x_bar, &bars.1, &mut grad, &mut DeformScratch::default());
        // Where a hidden unit opens or closes within the step, the gradient is that of one side.
        let close = |got: f32, [minus, here, plus]: [f64; 3], h: f64, what: &str| {
            let [before, after] = [(here - minus) / h, (plus - here) / h];
            let room = 2e-2 * before.abs().max(after.abs()).max(0.3);
            let [low, high] = [before.min(after) - room, before.max(after) + room];
            assert!(
                (low..high).contains(&f64::from(got)),
                "{kind:?} {motion:?} {what}: {got}, not {before} to {after}"
            );
        };
        let h = 5e-4_f32;
        for i in (0..deform.params.len()).step_by(29) {
            let kept = deform.params[i];
            let mut at = |value_there: f32| {
                deform.params[i] = value_there;
                deform.renew();
                value(&deform, &x, &which, &bars)
            };
            let around = [at(kept - h), at(kept), at(kept + h)];
            at(kept);
            close(grad.params[i], around, f64::from(h), &format!("parameter {i}"));
        }
        for i in 0..3 * n {
            let at = |value_there: f32| {
                let mut x = x.clone();
                x[i] = value_there;
                value(&deform, &x, &which, &bars)
            };
            close(x_bar[i], [at(x[i] - h), at(x[i]), at(x[i] + h)], f64::from(h), &format!("coordinate {i}"));
        }
        // Rows of time steps: those of codes are the codes themselves.
        for i in 0..deform.steps.rows.len() {
            let kept = deform.steps.rows[i];
            let mut at = |value_there: f32| {
                deform.steps.rows[i] = value_there;
                value(&deform, &x, &which, &bars)
            };
            let around = [at(kept - h), at(kept), at(kept + h)];
            at(kept);
            close(grad.times[i], around, f64::from(h), &format!("time step {i}"));
        }
    }
}

#[test]
fn nothing_is_warped_at_the_canonical_time_and_its_gradient_passes() {
    let free = warp_alone(TimeKind::Time, Motion::Translation);
    let deform = busy(MadeSettings { warp: WarpSettings { origin: Origin::Exact, ..free.warp }, ..free });
    let (x, _) = points(5);
    let which = vec![0; 5];
    let mut there = vec![0.0; 15];
    let at = Points { x: &x, which: &which, time_steps: deform.time_steps() };
    deform.place(at, &mut there, &mut [], &mut DeformScratch::default());
    assert_eq!(there, x, "bit for bit");
    assert_eq!(deform.counts.warped.load(Relaxed), 0, "no network runs");
    let mut grad = DeformGrad::default();
    grad.begin(&deform);
    let mut x_bar = vec![1.5; 15];
    deform.learn(at, &mut x_bar, &[], &mut grad, &mut DeformScratch::default());
    assert!(x_bar.iter().all(|&b| b == 1.5) && grad.params.iter().all(|&g| g == 0.0));
}

#[test]
fn points_begin_where_they_are() {
    for motion in [Motion::Translation, Motion::Rigid] {
        let start = warp_alone(TimeKind::Codes, motion);
        let start = MadeSettings { time: TimeSettings { dims: 8, ..start.time }, ..start };
        let deform = start.deform(Times::of_list(&[0.0, 1.0]), 1);
        let (x, _) = points(9);
        let which = vec![1; 9];
        let mut there = vec![0.0; 27];
        let at = Points { x: &x, which: &which, time_steps: deform.time_steps() };
        deform.place(at, &mut there, &mut [], &mut DeformScratch::default());
        let furthest = there.iter().zip(&x).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(furthest > 0.0 && furthest < 5e-3, "{furthest}");
    }
}

#[test]
fn smoothing_planes_lowers_first_differences_in_space_and_second_ones_in_time() {
    for ([variation, smoothness], along_time) in [([1.0, 0.0], false), ([0.0, 1.0], true)] {
        let all = settings(TimeKind::Time, Motion::Rigid);
        let time = TimeSettings { octaves: 1, ..all.time };
        let planes = PlaneSettings { variation, smoothness, ..all.planes };
        let mut deform = busy(MadeSettings { time, planes, ..all });
        deform.grad.fill(0.0);
        let part = deform.deformation.planes().unwrap();
        part.smooth(&deform.params, &mut deform.grad);
        let before = deform.params.clone();
        let moved: Vec<usize> = (0..before.len()).filter(|&i| deform.grad[i] != 0.0).collect();
        assert!(moved.iter().all(|&i| i >= deform.networks), "networks are left alone");
        for (planes, params) in part.sets() {
            let at = params.start;
            for (k, pair) in planes.pairs().enumerate() {
                let range = planes.plane_range(k);
                let touched = moved.iter().any(|i| (at + range.start..at + range.end).contains(i));
                assert_eq!(touched, !along_time || pair.contains(&3), "{pair:?}");
            }
        }
        // The gradient against differences of the value, whose sum over planes is what is lowered: pairs of neighbours along an axis of
        // space, triples along the time.
        let value = |params: &[f32]| {
            let mut sum = 0.0;
            for (planes, all) in part.sets() {
                let at = all.start;
                for (k, pair) in planes.pairs().enumerate() {
                    let range = planes.plane_range(k);
                    let [wide, high] = pair.map(|axis| planes.resolution()[axis] as usize);
                    let c = planes.features();
                    let of =
                        |i: usize, j: usize, f: usize| f64::from(params[at + range.start + (j * wide + i) * c + f]);
                    for axis in [0, 1] {
                        if (pair[axis] == 3) != along_time {
                            continue;
                        }
                        let [right, down] = [1 - axis, axis];
                        // Vertices before the last pair, or triple, along the axis.
                        let reach = 1 + usize::from(along_time);
                        let (columns, rows) = (wide - reach * right, high - reach * down);
                        for (i, j, f) in
                            (0..columns).flat_map(|i| (0..rows).flat_map(move |j| (0..c).map(move |f| (i, j, f))))
                        {
                            let at = |k: usize| of(i + k * right, j + k * down, f);
                            let difference = if along_time { at(2) - 2.0 * at(1) + at(0) } else { at(1) - at(0) };
                            sum += difference.powi(2) / (columns * rows * c) as f64;
                        }
                    }
                }
            }
            sum
        };
        for &i in moved.iter().step_by(7) {
            let h = 1e-2;
            let at = |step: f32| {
                let mut params = before.clone();
                params[i] += step;
                value(&params)
            };
            let want = (at(h) - at(-h)) / (2.0 * f64::from(h));
            assert!(
                (f64::from(deform.grad[i]) - want).abs() < 1e-3 * want.abs().max(0.1),
                "{i}: {} {want}",
                deform.grad[i]
            );
        }
    }
}

#[test]
fn closed_windows_are_not_computed_and_change_nothing() {
    let all = settings(TimeKind::Time, Motion::Rigid);
    let mut deform = busy(MadeSettings {
        ambient: AmbientSettings { from: 0.2, anneal: 0.2, ..all.ambient },
        planes: PlaneSettings::NONE,
        warp: WarpSettings { anneal: 1.0, ..all.warp },
        ..all
    });
    let windows = deform.deformation.windows();
    assert!(windows.ambient == [0.0] && windows.warp[1..] == [0.0, 0.0]);
    let warp_window = windows.warp.to_vec();
    let n = 7;
    let (x, which) = points(n);
    let (mut there, mut seen) = (vec![f32::NAN; 3 * n], vec![f32::NAN; deform.seen_rows() * n]);
    let mut grad = DeformGrad::default();
    grad.begin(&deform);
    let at = Points { x: &x, which: &which, time_steps: deform.time_steps() };
    deform.place(at, &mut there, &mut seen, &mut DeformScratch::default());
    assert!(seen[..4 * n].iter().all(|&s| s == 0.0) && seen.iter().all(|s| s.is_finite()));
    let (mut x_bar, seen_bar) = (vec![1.0; 3 * n], vec![1.0; seen.len()]);
    deform.learn(at, &mut x_bar, &seen_bar, &mut grad, &mut DeformScratch::default());
    // Parameters of the warp come first: two layers of 16 units behind 21 rows of the point and 5 of the time, and 6 outputs.
    let warps = (21 + 5) * 16 + 16 + 16 * 16 + 16 + 16 * 6 + 6;
    assert!(grad.params[warps..].iter().all(|&g| g == 0.0) && grad.params[..warps].iter().any(|&g| g != 0.0));
    let rows = deform.skips();
    let row = rows.iter().find(|row| row.what == "octaves of closed windows").unwrap();
    // Two of the warp's three, and the sheet's one; there and back.
    assert_eq!((row.skipped, row.total), (2 * 7 * 3, 2 * 7 * 4));
    // A sheet that is hardly open changes hardly anything.
    deform.deformation.set_windows(&warp_window, &[1e-7]);
    let (mut there_open, mut seen_open) = (there.clone(), seen.clone());
    let at = Points { x: &x, which: &which, time_steps: deform.time_steps() };
    deform.place(at, &mut there_open, &mut seen_open, &mut DeformScratch::default());
    assert_eq!(there, there_open);
    assert!(seen.iter().zip(&seen_open).all(|(a, b)| (a - b).abs() <= 1e-7) && seen != seen_open);
}

#[test]
fn what_is_seen_at_the_canonical_time_is_computed_without_the_warp() {
    let all = settings(TimeKind::Time, Motion::Rigid);
    let deform = busy(MadeSettings { warp: WarpSettings { origin: Origin::Exact, ..all.warp }, ..all });
    let (x, which) = points(9);
    let at_all = |steps: &TimeSteps| {
        let (mut there, mut seen) = (vec![f32::NAN; 27], vec![f32::NAN; 9 * deform.seen_rows()]);
        let at = Points { x: &x, which: &which, time_steps: steps };
        deform.place(at, &mut there, &mut seen, &mut DeformScratch::default());
        (there, seen)
    };
    let (there, seen) = at_all(deform.time_steps());
    let warped = deform.counts.warped.load(Relaxed);
    assert_eq!(warped, which.iter().filter(|&&w| w != 0).count() as u64);
    // The same where the warp runs everywhere.
    let (there_free, seen_free) = at_all(&TimeSteps { still: vec![false; 3], ..deform.time_steps().clone() });
    assert_eq!(seen, seen_free);
    for i in 0..27 {
        assert_eq!(there[i], if which[i % 9] == 0 { x[i] } else { there_free[i] });
    }
}

#[test]
fn planes_that_change_steadily_cost_nothing_in_time() {
    let all = settings(TimeKind::Time, Motion::Translation);
    let mut deform = busy(MadeSettings { planes: PlaneSettings { smoothness: 1.0, ..all.planes }, ..all });
    let gradient = |deform: &Deform| {
        let mut grad = vec![0.0; deform.params.len()];
        deform.deformation.planes().unwrap().smooth(&deform.params, &mut grad);
        grad.iter().fold(0.0, |most: f32, g| most.max(g.abs()))
    };
    assert!(gradient(&deform) > 1e-3);
    let mut steady = deform.params.clone();
    for (planes, all) in deform.deformation.planes().unwrap().sets() {
        for (k, pair) in planes.pairs().enumerate().filter(|(_, pair)| pair.contains(&3)) {
            let row = planes.resolution()[pair[0]] as usize * planes.features();
            let range = planes.plane_range(k);
            for (i, value) in steady[all.start + range.start..all.start + range.end].iter_mut().enumerate() {
                *value = 0.3 + 0.2 * (i / row) as f32 + 0.1 * (i % row) as f32;
            }
        }
    }
    deform.params = steady;
    assert!(gradient(&deform) < 1e-5, "{}", gradient(&deform));
}

#[test]
fn beside_the_time_that_the_canonical_scene_is_tied_to_next_to_nothing_moves() {
    for motion in [Motion::Translation, Motion::Rigid] {
        let way = |origin, t: f64| {
            let all = settings(TimeKind::Time, motion);
            let made = MadeSettings { warp: WarpSettings { origin, ..all.warp }, ..all };
            let deform = busy(made);
            let (x, _) = points(9);
            let steps = deform.time_steps_at(&[t]);
            let (mut there, mut seen) = (vec![0.0; 27], vec![0.0; 9 * deform.seen_rows()]);
            let at = Points { x: &x, which: &[0; 9], time_steps: &steps };
            deform.place(at, &mut there, &mut seen, &mut DeformScratch::default());
            there.iter().zip(&x).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        assert_eq!(way(Origin::Tied, 0.0), 0.0);
        let [near, nearer, far] = [1e-2, 1e-3, 1.0].map(|t| way(Origin::Tied, t));
        assert!(far > 1e-2 && near < 0.1 * far && nearer < 0.2 * near, "{motion:?}: {nearer} {near} {far}");
        // As published nothing is tied: beside that time points are anywhere.
        assert!(way(Origin::Exact, 0.0) == 0.0 && way(Origin::Exact, 1e-3) > 10.0 * nearer, "{motion:?}");
    }
}

#[test]
fn gradients_of_a_warp_that_is_tied_are_those_of_differences() {
    let all = settings(TimeKind::Time, Motion::Rigid);
    let mut deform = busy(MadeSettings { warp: WarpSettings { origin: Origin::Tied, ..all.warp }, ..all });
    let (x, which) = points(7);
    let n = which.len();
    let mut bars = (vec![0.0; 3 * n], vec![0.0; deform.seen_rows() * n]);
    Rng::new(8, 9).fill_uniform(0, &mut bars.0);
    let mut grad = DeformGrad::default();
    grad.begin(&deform);
    let mut x_bar = bars.0.clone();
    let at = Points { x: &x, which: &which, time_steps: deform.time_steps() };
    deform.learn(at, &mut x_bar, &bars.1, &mut grad, &mut DeformScratch::default());
    let h = 5e-4_f32;
    let mut sum = 0.0;
    for i in (0..deform.params.len()).step_by(23) {
        let kept = deform.params[i];
        let mut at = |value_there: f32| {
            deform.params[i] = value_there;
            deform.renew();
            value(&deform, &x, &which, &bars)
        };
        let [minus, here, plus] = [at(kept - h), at(kept), at(kept + h)];
        at(kept);
        let [before, after] = [(here - minus) / f64::from(h), (plus - here) / f64::from(h)];
        let room = 2e-2 * before.abs().max(after.abs()).max(0.3);
        let got = f64::from(grad.params[i]);
        sum += got.abs();
        let inside = (before.min(after) - room..before.max(after) + room).contains(&got);
        assert!(inside, "parameter {i}: {got}, not {before} to {after}");
    }
    assert!(sum > 0.1, "next to no gradient: {sum}");
}

#[test]
fn a_time_that_is_learned_cannot_be_tied_to() {
    let all = settings(TimeKind::Codes, Motion::Translation);
    let mut parameters = Parameters::new(1);
    let time = Time::new(all.time, Times::of_list(&[0.0, 1.0]), &parameters).unwrap();
    let tied = WarpSettings { origin: Origin::Tied, ..all.warp };
    let error = Warp::new(&tied, &time, 0, &mut parameters).err().unwrap().to_string();
    assert!(error.contains("origin") && error.contains("time_input=time"), "{error}");
}

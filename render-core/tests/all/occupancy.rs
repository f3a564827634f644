//! The occupancy grid: cells, updates, and marches against a plain walk along the lattice.

use core::ops::ControlFlow;
use proptest::prelude::*;
use render_core::occupancy::{GridError, GridSettings, Marched, OccupancyGrid, RaySpan, StepRule};

pub(crate) fn settings(resolution: u32, cascades: u32) -> GridSettings {
    GridSettings::default().with_resolution(resolution).with_cascades(cascades)
}

/// A hash of an index as a number in `[0, 1)`.
pub(crate) fn u(seed: u32, i: u32) -> f32 {
    let mut x = i.wrapping_mul(0x9E37_79B9) ^ seed.wrapping_mul(0x85EB_CA6B);
    for _ in 0..3 {
        x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D);
    }
    (x >> 8) as f32 / (1 << 24) as f32
}

/// A grid where exactly these cells are occupied (and the coarser ones around them).
fn grid_of(settings: GridSettings, occupied: impl Fn(&OccupancyGrid, u32) -> bool) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(settings).unwrap();
    let cells: Vec<u32> = (0..grid.cells() as u32).collect();
    let thickness: Vec<f32> = cells.iter().map(|&c| if occupied(&grid, c) { 1.0 } else { 0.0 }).collect();
    grid.update(&cells, &thickness);
    grid
}

pub(crate) fn samples(grid: &OccupancyGrid, ray: &RaySpan, rule: &StepRule, jitter: f32) -> (Vec<(f32, f32)>, Marched) {
    let mut out = vec![];
    let marched = grid.march(ray, rule, jitter, u32::MAX, |t, dt| {
        out.push((t, dt));
        ControlFlow::Continue(())
    });
    (out, marched)
}

pub(crate) fn at(ray: &RaySpan, t: f32) -> [f32; 3] {
    std::array::from_fn(|a| ray.o[a] + t * ray.d[a])
}

fn any_coordinate(half: f32) -> impl Strategy<Value = f32> {
    // Also exactly on faces of cells, and outside.
    prop_oneof![4 => -half..half, 1 => (-8_i32..=8).prop_map(|i| i as f32 / 8.0), 1 => -3.0 * half..3.0 * half]
}

pub(crate) fn any_ray(half: f32) -> impl Strategy<Value = RaySpan> {
    let component = || prop_oneof![5 => -1.0_f32..1.0, 1 => Just(0.0_f32), 1 => Just(-0.0_f32), 1 => Just(1e-7_f32)];
    let o = [any_coordinate(half), any_coordinate(half), any_coordinate(half)];
    (o, [component(), component(), component()], 0.0_f32..0.5, 0.0_f32..8.0).prop_map(|(o, d, t_min, span)| {
        let length = d.iter().map(|x| x * x).sum::<f32>().sqrt();
        let d = if length > 1e-3 { d.map(|x| x / length) } else { [0.0, 0.0, 1.0] };
        RaySpan { o, d, t_min, t_max: t_min + span }
    })
}

/// Cells occupied in clusters, so that there are empty blocks of every size: a cell with a share `dense` inside blocks of
/// 8 cells with a share `blocks`.
pub(crate) fn clusters(settings: GridSettings, seed: u32, blocks: f32, dense: f32) -> OccupancyGrid {
    grid_of(settings, |grid, cell| {
        let (k, x) = grid.coordinates(cell);
        let block = x[0] / 8 + 100 * (x[1] / 8 + 100 * (x[2] / 8 + 100 * k));
        u(seed, block) < blocks && u(seed + 1, cell) < dense
    })
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn skipping_takes_exactly_the_samples_in_occupied_cells(
        seed in any::<u32>(), cascades in 1_u32..4, resolution in prop_oneof![Just(16_u32), Just(32), Just(48)],
        share in 0.0_f32..0.6, jitter in 0.0_f32..1.0,
        rays in prop::collection::vec(any_ray(2.0), 16), dt in 0.003_f32..0.1,
    ) {
        let settings = settings(resolution, cascades);
        let full = OccupancyGrid::new(settings).unwrap();
        let grid = clusters(settings, seed, share, 0.5);
        let rule = StepRule::uniform(dt);
        for ray in &rays {
            let (all, every) = samples(&full, ray, &rule, jitter);
            let (taken, marched) = samples(&grid, ray, &rule, jitter);
            let length = ray.d.iter().map(|x| x * x).sum::<f32>().sqrt();
            let want: Vec<_> = all.iter().copied().filter(|&(t, _)| grid.occupied(at(ray, t), dt * length)).collect();
            prop_assert_eq!(&taken, &want, "{:?}", ray);
            prop_assert_eq!(every.samples as usize, all.len());
            prop_assert_eq!(marched.samples as usize, taken.len());
            // Skipped samples are counted, the last jump perhaps one too far.
            prop_assert!(marched.candidates.abs_diff(every.candidates) <= 1, "{} {}", marched.candidates, every.candidates);
            prop_assert!(marched.lookups <= every.candidates + 1);
        }
    }

    #[test]
    fn growing_steps_keep_the_lattice(
        seed in any::<u32>(), rays in prop::collection::vec(any_ray(4.0), 16), share in 0.0_f32..0.6, jitter in 0.0_f32..1.0,
    ) {
        let settings = settings(32, 3);
        let full = OccupancyGrid::new(settings).unwrap();
        let grid = clusters(settings, seed, share, 0.5);
        let rule = StepRule { dt_min: 0.01, cone: 1.0 / 64.0, dt_max: 0.08 };
        for ray in &rays {
            let (all, _) = samples(&full, ray, &rule, jitter);
            for pair in all.windows(2) {
                let (t, dt) = pair[0];
                prop_assert!((0.01..=0.08).contains(&dt));
                prop_assert!((pair[1].0 - t - dt).abs() <= 1e-6 * (1.0 + t), "{:?}", pair);
            }
            let length = ray.d.iter().map(|x| x * x).sum::<f32>().sqrt();
            let (taken, _) = samples(&grid, ray, &rule, jitter);
            let mut rest = all.iter();
            for sample in &taken {
                prop_assert!(rest.any(|s| s == sample), "{:?} is not on the lattice", sample);
                prop_assert!(grid.occupied(at(ray, sample.0), sample.1 * length), "{:?} of {:?}", sample, ray);
            }
            // What was passed by is empty where it matters: in the cascade of its place, whatever the step.
            for sample in all.iter().filter(|s| !taken.contains(s)) {
                prop_assert!(!grid.occupied(at(ray, sample.0), 0.0), "{:?} of {:?}", sample, ray);
            }
        }
    }

    #[test]
    fn picked_cells_are_ordered_unique_visible_and_half_of_all(seed in any::<u32>(), share in 0.0_f32..1.0) {
        let mut grid = clusters(settings(16, 2), seed, 1.0, share);
        grid.mark_invisible(|corner, _| corner[0] < 0.0 || corner[1] < 0.5);
        let mut out = vec![];
        let mut asked = std::collections::HashSet::new();
        grid.pick(|i| { assert!(asked.insert(i)); u(seed, i) }, &mut out);
        prop_assert!(asked.iter().all(|&i| (i as usize) < grid.cells() / 2));
        prop_assert!(out.is_sorted_by(|a, b| a < b));
        prop_assert!(out.iter().all(|&c| grid.thickness()[c as usize] >= 0.0));
        let occupied: Vec<u32> = (0..grid.cells() as u32).filter(|&c| grid.bits()[c as usize / 64] >> (c % 64) & 1 == 1).collect();
        let quarter = grid.cells() / 4;
        let hit = occupied.iter().filter(|c| out.binary_search(c).is_ok()).count();
        if occupied.len() <= quarter {
            let visible = occupied.iter().filter(|&&c| grid.thickness()[c as usize] >= 0.0).count();
            prop_assert_eq!(hit, visible, "all occupied cells");
        }
        prop_assert!(out.len() <= 2 * quarter);
    }

    #[test]
    fn cells_are_numbered_both_ways(seed in any::<u32>()) {
        let grid = OccupancyGrid::new(settings(48, 3)).unwrap();
        for i in 0..200 {
            let id = (u(seed, i) * grid.cells() as f32) as u32;
            let (k, x) = grid.coordinates(id);
            prop_assert_eq!(grid.cell(k, x), id);
            let p = grid.cell_point(id, [u(seed, i + 1000), u(seed, i + 2000), 0.5]);
            let (corner, side) = grid.cell_box(id);
            prop_assert!((0..3).all(|a| (corner[a]..=corner[a] + side).contains(&p[a])));
            prop_assert!(p.iter().all(|x| x.abs() <= (1 << k) as f32));
        }
    }
}

#[test]
fn a_field_of_known_support_is_never_missed() {
    // Two balls, one in each cascade. A measurement is the field at a random point of the cell.
    let inside_by = |p: [f32; 3], skin: [f32; 2]| {
        let distance = |c: [f32; 3]| (0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f32>().sqrt();
        distance([0.3, 0.2, -0.4]) < 0.35 - skin[0] || distance([-1.5, 0.5, 0.1]) < 0.4 - skin[1]
    };
    let field = |p| if inside_by(p, [0.0; 2]) { 20.0_f32 } else { 0.0 };
    let mut grid = OccupancyGrid::new(settings(32, 2)).unwrap();
    let dt_min = 2.0 * 3.0_f32.sqrt() / 1024.0;
    let mut cells = vec![];
    for step in 0..64 {
        if step < 16 {
            grid.pick_all(&mut cells);
        } else {
            grid.pick(|i| u(77 + step, i), &mut cells);
        }
        let thickness: Vec<f32> = cells
            .iter()
            .map(|&c| {
                let p = grid.cell_point(c, std::array::from_fn(|a| u(step * 3 + a as u32, c)));
                field(p) * dt_min * (1 << grid.coordinates(c).0) as f32
            })
            .collect();
        grid.update(&cells, &thickness);
    }
    assert_eq!(grid.updates(), 64);
    // Points deeper than the diagonal of a cell are in cells that are full: none may be missed.
    let skin = [0, 1].map(|k| 1.75 * grid.cell_side(k));
    let mut inside = 0;
    for i in 0..200_000 {
        let p = std::array::from_fn(|a| 4.0 * u(a as u32 + 500, i) - 2.0);
        if inside_by(p, skin) {
            inside += 1;
            assert!(grid.occupied(p, 0.0), "{p:?}");
        }
    }
    assert!(inside > 200, "{inside}");
    // And most of space is skipped.
    assert!(grid.occupied_cells() * 5 < grid.cells() as u64, "{}", grid.occupied_cells());
}

#[test]
fn the_picture_is_the_same_with_and_without_skipping() {
    // A smooth ball in a grid that covers its support.
    let sigma = |p: [f32; 3]| {
        let r2 = p.iter().map(|x| x * x).sum::<f32>();
        if r2 < 0.25 { 30.0 * (0.25 - r2) } else { 0.0 }
    };
    let settings = settings(64, 1);
    let full = OccupancyGrid::new(settings).unwrap();
    let grid = grid_of(settings, |grid, cell| {
        let (corner, side) = grid.cell_box(cell);
        let nearest = corner.map(|c| 0.0_f32.clamp(c, c + side));
        nearest.iter().map(|x| x * x).sum::<f32>() < 0.25
    });
    let rule = StepRule::uniform(2.0 * 3.0_f32.sqrt() / 1024.0);
    let mut skipped = 0.0;
    for i in 0..200 {
        let d = [u(1, i) - 0.5, u(2, i) - 0.5, 2.0];
        let length = d.iter().map(|x| x * x).sum::<f32>().sqrt();
        let ray = RaySpan { o: [0.1, -0.2, -2.0], d: d.map(|x| x / length), t_min: 0.0, t_max: 10.0 };
        let render = |grid: &OccupancyGrid| {
            let (mut trans, mut colour) = (1.0_f32, 0.0);
            let marched = grid.march(&ray, &rule, 0.5, 1024, |t, dt| {
                let p = at(&ray, t);
                let next = trans * (-sigma(p) * dt).exp();
                colour += (trans - next) * (0.5 + 0.5 * p[0]);
                trans = next;
                ControlFlow::Continue(())
            });
            (colour, trans, marched)
        };
        let (a, b) = (render(&full), render(&grid));
        assert_eq!((a.0, a.1), (b.0, b.1), "ray {i}");
        assert!(b.2.samples <= a.2.samples && a.2.samples <= 1024);
        skipped += f64::from(a.2.samples - b.2.samples) / f64::from(a.2.samples) / 200.0;
    }
    assert!(skipped > 0.5, "only {skipped} of the samples were skipped");
}

#[test]
fn growing_steps_in_a_grid_of_the_support_lose_less_than_a_thousandth() {
    let sigma = |p: [f32; 3]| {
        let r2 = (p[0] - 1.5).powi(2) + p[1] * p[1] + p[2] * p[2];
        if r2 < 1.0 { 4.0 * (1.0 - r2) } else { 0.0 }
    };
    let settings = settings(64, 3);
    let full = OccupancyGrid::new(settings).unwrap();
    let grid = grid_of(settings, |grid, cell| {
        let (corner, side) = grid.cell_box(cell);
        let nearest = [
            1.5_f32.clamp(corner[0], corner[0] + side),
            0.0_f32.clamp(corner[1], corner[1] + side),
            0.0_f32.clamp(corner[2], corner[2] + side),
        ];
        sigma(nearest) > 0.0
    });
    let rule = StepRule { dt_min: 0.004, cone: 1.0 / 128.0, dt_max: 0.1 };
    for i in 0..100 {
        let ray = RaySpan {
            o: [-3.9, 0.3 * (u(3, i) - 0.5), 0.0],
            d: [1.0, u(1, i) * 0.2 - 0.1, u(2, i) * 0.2 - 0.1],
            t_min: 0.0,
            t_max: 20.0,
        };
        let trans = |grid: &OccupancyGrid| {
            let mut depth = 0.0;
            grid.march(&ray, &rule, 0.5, 4096, |t, dt| {
                depth += sigma(at(&ray, t)) * dt;
                ControlFlow::Continue(())
            });
            (-depth).exp()
        };
        assert!((trans(&full) - trans(&grid)).abs() < 1e-3, "ray {i}");
    }
}

#[test]
fn marches_end_where_they_must() {
    let grid = OccupancyGrid::new(settings(16, 2)).unwrap();
    let ray = RaySpan { o: [-5.0, 0.0, 0.0], d: [1.0, 0.0, -0.0], t_min: 0.0, t_max: 100.0 };
    let rule = StepRule::uniform(0.5);
    let (all, marched) = samples(&grid, &ray, &rule, 0.5);
    // From x = -2 to x = 2.
    assert_eq!(all, [3.25, 3.75, 4.25, 4.75, 5.25, 5.75, 6.25, 6.75].map(|t| (t, 0.5)));
    assert_eq!((marched.samples, marched.candidates), (8, 8));
    assert_eq!(grid.march(&ray, &rule, 0.5, 3, |_, _| ControlFlow::Continue(())).samples, 3);
    assert_eq!(grid.march(&ray, &rule, 0.5, 9, |_, _| ControlFlow::Break(())).samples, 1);
    assert_eq!(grid.march(&ray, &rule, 0.5, 0, |_, _| panic!("no samples wanted")).samples, 0);
    let spans = [
        RaySpan { t_max: 2.9, ..ray },
        RaySpan { t_min: 7.1, ..ray },
        RaySpan { t_min: f32::NAN, t_max: f32::NAN, ..ray },
        RaySpan { o: [f32::NAN, 0.0, 0.0], ..ray },
        RaySpan { o: [f32::INFINITY, 0.0, 0.0], ..ray },
        RaySpan { d: [0.0; 3], ..ray },
        RaySpan { d: [f32::NAN, 1.0, 0.0], ..ray },
        RaySpan { d: [f32::INFINITY, 1.0, 0.0], ..ray },
        RaySpan { o: [0.0, 2.5, 0.0], ..ray },
    ];
    for span in spans {
        assert_eq!(samples(&grid, &span, &rule, 0.5).0, [], "{span:?}");
    }
}

#[test]
fn cells_no_camera_sees_stay_empty() {
    let mut grid = OccupancyGrid::new(settings(16, 1)).unwrap();
    grid.mark_invisible(|corner, _| corner[2] < 0.0);
    assert_eq!(grid.occupied_cells(), 16 * 16 * 8);
    assert_eq!(grid.visible_cells(), 16 * 16 * 8);
    let mut cells = vec![];
    grid.pick_all(&mut cells);
    assert_eq!(cells.len(), 16 * 16 * 8);
    let all: Vec<u32> = (0..4096).collect();
    for _ in 0..3 {
        grid.update(&all, &vec![5.0; 4096]);
        assert_eq!(grid.occupied_cells(), 16 * 16 * 8);
        assert!(!grid.occupied([0.1, 0.1, 0.1], 0.0) && grid.occupied([0.1, 0.1, -0.1], 0.0));
    }
}

#[test]
fn a_cell_clears_after_as_many_updates_as_the_decay_says() {
    let mut grid = OccupancyGrid::new(settings(16, 1)).unwrap();
    let all: Vec<u32> = (0..4096).collect();
    let mut thickness = vec![0.1; 4096];
    grid.update(&all, &thickness);
    thickness[7] = 0.0;
    // 0.1 * 0.95^n <= 0.01 at n = 45.
    for n in 1..=45 {
        grid.update(&all, &thickness);
        assert_eq!(grid.bits()[0] >> 7 & 1 == 1, n < 45, "{n}");
    }
    assert_eq!(grid.occupied_cells(), 4095);
    // NaN is not a measurement.
    grid.update(&[8], &[f32::NAN]);
    assert_eq!(grid.thickness()[8], 0.095);
}

#[test]
fn a_field_that_is_the_same_everywhere_stays() {
    let mut grid = OccupancyGrid::new(settings(16, 1)).unwrap();
    let all: Vec<u32> = (0..4096).collect();
    grid.update(&all, &vec![1e-4; 4096]);
    assert_eq!(grid.occupied_cells(), 4096);
    grid.update(&[], &[]);
    assert_eq!(grid.occupied_cells(), 4096);
    let mut empty = OccupancyGrid::new(settings(16, 1)).unwrap();
    empty.update(&all, &vec![0.0; 4096]);
    assert_eq!(empty.occupied_cells(), 0);
}

#[test]
fn state_comes_back() {
    let mut grid = clusters(settings(32, 2), 5, 0.4, 0.4);
    grid.mark_invisible(|corner, side| corner[1] + side < 1.5);
    let copy = OccupancyGrid::from_state(grid.settings(), grid.thickness(), grid.updates()).unwrap();
    assert_eq!(copy, grid);
    let fresh = OccupancyGrid::new(settings(16, 1)).unwrap();
    assert_eq!(OccupancyGrid::from_state(settings(16, 1), fresh.thickness(), 0).unwrap(), fresh);
    let refused = OccupancyGrid::from_state(settings(16, 1), &[0.0; 5], 0).unwrap_err();
    assert_eq!(refused, GridError::State { got: 5, want: 4096 });
    assert_eq!(refused.to_string(), "saved occupancy has 5 cells, the grid has 4096");
    let mut bad = vec![0.0; 4096];
    bad[9] = f32::NAN;
    assert_eq!(OccupancyGrid::from_state(settings(16, 1), &bad, 1).unwrap_err(), GridError::Nan(9));
    assert_eq!(OccupancyGrid::new(settings(20, 1)).unwrap_err(), GridError::Resolution(20));
    assert_eq!(OccupancyGrid::new(settings(16, 0)).unwrap_err(), GridError::Cascades(0));
    assert_eq!(OccupancyGrid::new(settings(1024, 4)).unwrap_err(), GridError::Cells(1 << 32));
    assert_eq!(OccupancyGrid::new(settings(1 << 22, 1)).unwrap_err(), GridError::Cells(u64::MAX));
}

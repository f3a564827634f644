//! Sets of cells of an occupancy grid: marches through them, and what lies around them, against plain twins.

use crate::occupancy::{any_ray, at, clusters, samples, settings, u};
use core::ops::ControlFlow;
use proptest::prelude::*;
use render_core::occupancy::{CellBits, Marched, OccupancyGrid, RaySpan, StepRule};

/// Some cells of a grid, and the coarser ones that they lie in.
fn some_in(grid: &OccupancyGrid, seed: u32) -> CellBits {
    let mut some = some_of(grid.bits(), seed);
    grid.lift(&mut some);
    assert!(some.iter().zip(grid.bits()).all(|(some, all)| some & !all == 0), "the grid is lifted itself");
    CellBits::new(some)
}

/// Some of these cells: whole words of them, none, or half.
fn some_of(bits: &[u64], seed: u32) -> Vec<u64> {
    let half = |i: u32| (0..64).fold(0, |mask, b| mask | u64::from(u(seed.wrapping_add(1), i * 64 + b) < 0.5) << b);
    let part = |(i, &word): (usize, &u64)| match u(seed, i as u32) {
        x if x < 0.3 => 0,
        x if x < 0.6 => word,
        _ => word & half(i as u32),
    };
    bits.iter().enumerate().map(part).collect()
}

fn samples_in(
    grid: &OccupancyGrid,
    cells: &CellBits,
    ray: &RaySpan,
    rule: &StepRule,
    jitter: f32,
) -> (Vec<(f32, f32)>, Marched) {
    let mut out = vec![];
    let marched = grid.march_in(cells, ray, rule, jitter, u32::MAX, |t, dt| {
        out.push((t, dt));
        ControlFlow::Continue(())
    });
    (out, marched)
}

/// [`OccupancyGrid::dilate`], a cell at a time.
fn dilated(grid: &OccupancyGrid, bits: &[u64]) -> Vec<u64> {
    let (cells, mut out) = (CellBits::new(bits.to_vec()), bits.to_vec());
    for id in (0..grid.cells() as u32).filter(|&id| cells.contains(id)) {
        let (k, x) = grid.coordinates(id);
        for i in 0..27 {
            let beside = [0, 1, 2].map(|a| (x[a] + i / 3_u32.pow(a as u32) % 3).wrapping_sub(1));
            if beside.iter().all(|&x| x < grid.settings().resolution) {
                let beside = grid.cell(k, beside);
                out[beside as usize / 64] |= 1 << (beside % 64);
            }
        }
    }
    out
}

/// [`OccupancyGrid::lift`], a cell at a time.
fn lifted(grid: &OccupancyGrid, bits: &[u64]) -> Vec<u64> {
    let mut out = bits.to_vec();
    for id in 0..grid.cells() as u32 {
        let (k, x) = grid.coordinates(id);
        if out[id as usize / 64] >> (id % 64) & 1 == 1 && k + 1 < grid.settings().cascades {
            let above = grid.cell(k + 1, x.map(|x| grid.settings().resolution / 4 + x / 2));
            out[above as usize / 64] |= 1 << (above % 64);
        }
    }
    out
}

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    #[test]
    fn a_march_through_some_cells_is_the_march_through_all_less_what_lies_in_others(
        seed in any::<u32>(), cascades in 1_u32..4, resolution in prop_oneof![Just(16_u32), Just(32), Just(48)],
        share in 0.0_f32..0.8, jitter in 0.0_f32..1.0,
        rays in prop::collection::vec(any_ray(2.0), 16), dt in 0.003_f32..0.1,
    ) {
        let grid = clusters(settings(resolution, cascades), seed >> 1, share, 0.7);
        let some = some_in(&grid, seed);
        let rule = StepRule::uniform(dt);
        for ray in &rays {
            let (all, every) = samples(&grid, ray, &rule, jitter);
            let (taken, marched) = samples_in(&grid, &some, ray, &rule, jitter);
            let length = ray.d.iter().map(|x| x * x).sum::<f32>().sqrt();
            let want: Vec<_> = all.iter().copied().filter(|&(t, _)| grid.holds(&some, at(ray, t), dt * length)).collect();
            prop_assert_eq!(&taken, &want, "{:?}", ray);
            prop_assert_eq!(marched.samples as usize, taken.len());
            prop_assert!(marched.candidates.abs_diff(every.candidates) <= 2, "{} {}", marched.candidates, every.candidates);
            // Of all of its cells it is the march that there was before.
            prop_assert_eq!(samples_in(&grid, grid.occupied_set(), ray, &rule, jitter), (all, every));
        }
    }

    #[test]
    fn growing_steps_keep_the_lattice_of_some_cells(
        seed in any::<u32>(), rays in prop::collection::vec(any_ray(4.0), 16), share in 0.0_f32..0.6, jitter in 0.0_f32..1.0,
    ) {
        let grid = clusters(settings(32, 3), seed >> 1, share, 0.5);
        let some = some_in(&grid, seed);
        let rule = StepRule { dt_min: 0.01, cone: 1.0 / 64.0, dt_max: 0.08 };
        let full = OccupancyGrid::new(grid.settings()).unwrap();
        for ray in &rays {
            let (all, _) = samples(&full, ray, &rule, jitter);
            let (taken, _) = samples_in(&grid, &some, ray, &rule, jitter);
            let length = ray.d.iter().map(|x| x * x).sum::<f32>().sqrt();
            let mut rest = all.iter();
            for sample in &taken {
                prop_assert!(rest.any(|s| s == sample), "{:?} is not on the lattice", sample);
                prop_assert!(grid.holds(&some, at(ray, sample.0), sample.1 * length), "{:?} of {:?}", sample, ray);
            }
            for sample in all.iter().filter(|s| !taken.contains(s)) {
                prop_assert!(!grid.holds(&some, at(ray, sample.0), 0.0), "{:?} of {:?}", sample, ray);
            }
        }
    }

    #[test]
    fn sets_grow_as_their_twins_do(
        seed in any::<u32>(), cascades in 1_u32..4, resolution in prop_oneof![Just(16_u32), Just(32), Just(48)],
        share in 0.0_f32..0.3, dense in 0.0_f32..0.2,
    ) {
        let grid = clusters(settings(resolution, cascades), seed >> 1, share, dense);
        let some = some_of(grid.bits(), seed);
        let (mut grown, mut above) = (some.clone(), some.clone());
        grid.dilate(&mut grown);
        prop_assert!(grown == dilated(&grid, &some));
        grid.lift(&mut above);
        prop_assert!(above == lifted(&grid, &some));
        prop_assert_eq!(CellBits::new(above.clone()).count(), above.iter().map(|w| u64::from(w.count_ones())).sum::<u64>());
        // What was lifted before it grew is lifted still.
        grid.dilate(&mut above);
        let mut twice = above.clone();
        grid.lift(&mut twice);
        prop_assert!(twice == above);
    }
}

#[test]
fn a_cell_has_26_neighbours_and_fewer_at_the_border_of_its_cascade() {
    let grid = OccupancyGrid::new(settings(32, 2)).unwrap();
    for (k, x, count) in [
        (0, [7, 8, 15], 27),
        (1, [16, 3, 20], 27),
        (0, [0, 8, 15], 18),
        (1, [31, 0, 15], 12),
        (0, [31, 31, 31], 8),
        (1, [0, 0, 0], 8),
    ] {
        let mut bits = vec![0; grid.bits().len()];
        let id = grid.cell(k, x);
        bits[id as usize / 64] |= 1 << (id % 64);
        grid.dilate(&mut bits);
        let grown = CellBits::new(bits);
        assert!(grown.contains(id) && grown.count() == count, "{x:?} of cascade {k}: {}", grown.count());
    }
}

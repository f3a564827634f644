//! Marching through grids: axis-parallel rays, far cameras, near planes of 1e-6, spans to the end of the numbers.

use core::ops::ControlFlow;
use render_core::occupancy::{GridSettings, OccupancyGrid, RaySpan, StepRule};
use stress::{Tally, Verdict, ensure};

fn grid(cascades: u32, thickness: impl Fn(u32) -> f32) -> OccupancyGrid {
    let mut grid = OccupancyGrid::new(GridSettings::default().with_resolution(32).with_cascades(cascades)).unwrap();
    let cells: Vec<u32> = (0..grid.cells() as u32).collect();
    let thickness: Vec<f32> = cells.iter().map(|&c| thickness(c)).collect();
    grid.update(&cells, &thickness);
    grid
}

fn march(grid: &OccupancyGrid, ray: &RaySpan, rule: &StepRule, most: u32) -> Vec<(f32, f32)> {
    let mut samples = Vec::new();
    grid.march(ray, rule, 0.5, most, |t, dt| {
        samples.push((t, dt));
        ControlFlow::Continue(())
    });
    samples
}

fn promised(part: &OccupancyGrid, full: &OccupancyGrid, ray: &RaySpan, rule: &StepRule) -> Verdict {
    const MOST: u32 = 1 << 16;
    let (some, all) = (march(part, ray, rule, MOST), march(full, ray, rule, MOST));
    ensure(all.len() < MOST as usize, || "more samples than the cube has steps".into())?;
    let bad = all.iter().find(|(t, dt)| !(*t >= ray.t_min && *t <= ray.t_max && *dt > 0.0 && dt.is_finite()));
    ensure(bad.is_none(), || format!("a sample {bad:?} outside of the span"))?;
    ensure(all.is_sorted_by(|a, b| a.0 <= b.0), || "distances decrease".into())?;
    // Bit for bit those of the full grid.
    let mut rest = all.iter();
    let strange = some.iter().find(|s| !rest.any(|t| t == *s));
    ensure(strange.is_none(), || format!("a sample {strange:?} that a full grid does not have"))
}

pub(crate) fn cases(tally: &mut Tally) {
    let tiny = [0.0_f32, -0.0, 1e-45, 1e-38, 1e-20, 1e-7];
    for cascades in [1, 4] {
        let (full, part) = (grid(cascades, |_| 1.0), grid(cascades, |c| if c.is_multiple_of(3) { 1.0 } else { 0.0 }));
        for cone in [0.0, 1e-7, 1.0 / 256.0, 1.0] {
            let rule = StepRule { dt_min: 0.002, cone, dt_max: 0.1 };
            for (t_min, t_max) in [(0.0, 3e38), (1e-6, f32::MAX), (1e-6, f32::INFINITY), (1e-45, 1.0), (0.5, 0.5)] {
                for axis in 0..3 {
                    for other in tiny {
                        for sign in [1.0, -1.0] {
                            let mut d = [other; 3];
                            d[axis] = sign;
                            for o in [[0.0; 3], [1.0, -1.0, 1.0], [0.31, 0.0625, -0.4], [-5.0, 0.5, 5.0]] {
                                let ray = RaySpan { o, d, t_min, t_max };
                                let name = format!("{cascades} cascades, cone {cone}, {ray:?}");
                                tally.case(name, "samples inside of the span, those of a full grid", || {
                                    promised(&part, &full, &ray, &rule)
                                });
                            }
                        }
                    }
                }
            }
        }
        for away in [1e3, 1e6, 1e20, 3e38] {
            let ray = RaySpan { o: [-away, 0.01, 0.02], d: [1.0, 1e-9, 0.0], t_min: 1e-6, t_max: f32::MAX };
            let rule = StepRule::uniform(0.01);
            tally.case(format!("{cascades} cascades, a camera {away:e} away"), "ends, in order", || {
                promised(&part, &full, &ray, &rule)
            });
        }
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for place in 0..8 {
                let mut ray = RaySpan { o: [0.1; 3], d: [0.6, 0.8, 0.0], t_min: 0.0, t_max: 10.0 };
                match place {
                    0..3 => ray.o[place] = bad,
                    3..6 => ray.d[place - 3] = bad,
                    6 => ray.t_min = bad,
                    _ => ray.t_max = bad,
                }
                tally.case(format!("{cascades} cascades, {ray:?}"), "no samples, or finite ones", || {
                    let samples = march(&full, &ray, &StepRule::uniform(0.01), 1 << 16);
                    ensure(samples.iter().all(|(t, dt)| t.is_finite() && *dt > 0.0), || "a sample is not finite".into())
                });
            }
        }
    }
    for thickness in [f32::NAN, f32::INFINITY, f32::MAX, 1e-45, -1.0] {
        tally.case(format!("measured thickness {thickness}"), "no NaN in the grid; later updates empty it", || {
            let mut grid = grid(1, |c| if c == 7 { thickness } else { 0.5 });
            let nan = grid.thickness().iter().position(|t| t.is_nan());
            ensure(nan.is_none(), || format!("cell {nan:?} is NaN"))?;
            let ray = RaySpan { o: [0.01; 3], d: [0.6, 0.8, 0.0], t_min: 0.0, t_max: 10.0 };
            ensure(!march(&grid, &ray, &StepRule::uniform(0.01), 1 << 16).is_empty(), || "the grid is empty".into())?;
            for _ in 0..2000 {
                grid.update(&[7], &[0.0]);
            }
            ensure(grid.thickness()[7] < 0.01, || format!("cell 7 stays at {}", grid.thickness()[7]))
        });
    }
}

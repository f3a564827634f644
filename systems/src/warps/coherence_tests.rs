//! What the coherence loss costs: nothing where things move as a whole, something where they are stretched.

use super::made::MadeSettings;
use super::*;
use field_core::rng::Rng;

/// Units of both hidden layers, and rows that the first of them sees: 15 of the point, 5 of the time.
const WIDTH: usize = 8;
const INPUTS: usize = 20;
/// Parameters in front of the second layer, and of the last one.
const SECOND: usize = (INPUTS + 1) * WIDTH;
const LAST: usize = SECOND + (WIDTH + 1) * WIDTH;
/// Points, each with its weight.
const W: [f32; 6] = [1.0, 0.5, 0.25, 0.0, 0.75, 0.125];

/// A warp of three times whose parameters are all 0, then as `set` has them.
fn warp(motion: Motion, origin: Origin, set: impl FnOnce(&mut [f32])) -> Deform {
    let made = MadeSettings::of_time(TimeKind::Time, 2, 1);
    let warp = WarpSettings { motion, origin, ..made.warp.clone() };
    let mut deform = MadeSettings { warp, ..made }.deform(Times::of_list(&[0.0, 0.4, 1.0]), 3);
    let parameters = match motion {
        Motion::None => 0,
        Motion::Translation => LAST + (WIDTH + 1) * 3,
        Motion::Rigid => LAST + (WIDTH + 1) * 6,
    };
    assert_eq!(deform.params.len(), parameters);
    deform.params.fill(0.0);
    set(&mut deform.params);
    deform.renew();
    deform
}

/// All space turned and shifted.
fn turned() -> Deform {
    warp(Motion::Rigid, Origin::Free, |params| {
        params[LAST + 6 * WIDTH..].copy_from_slice(&[0.9, -0.5, 1.2, 0.1, 0.2, -0.1]);
    })
}

/// All space stretched about its middle: displacements of `s` times the point, through rectified units that are never closed.
fn stretched(origin: Origin, s: f32) -> Deform {
    warp(Motion::Translation, origin, |params| {
        for a in 0..3 {
            // x + 2, the same, and s times that less 2.
            params[a * INPUTS + a] = 1.0;
            params[INPUTS * WIDTH + a] = 2.0;
            params[SECOND + a * WIDTH + a] = 1.0;
            params[LAST + a * WIDTH + a] = s;
            params[LAST + 3 * WIDTH + a] = -2.0 * s;
        }
    })
}

/// What a deformation costs at points of these times, and the gradient of that.
fn cost(deform: &Deform, which: [u32; 6]) -> (f64, DeformGrad) {
    let mut x = vec![0.0; 18];
    Rng::new(1, 2).fill_uniform(0, &mut x);
    let points = Points { x: &x, which: &which, time_steps: deform.time_steps() };
    let mut grad = DeformGrad::default();
    grad.begin(deform);
    let sum = deform.coherence(points, &W, Rng::new(4, 2), 1.0, &mut grad, &mut DeformScratch::default());
    (sum, grad)
}

const MIXED: [u32; 6] = [0, 1, 2, 0, 1, 2];

/// `sum w rho(s)`.
fn expected(s: f64) -> f64 {
    let scale = f64::from(CoherenceSettings::NONE.coherence_scale);
    let weights: f64 = W.iter().map(|&w| f64::from(w)).sum();
    weights * ((1.0 + (s / scale).powi(2)).sqrt() - 1.0)
}

#[test]
fn what_turns_and_shifts_as_a_whole_costs_nothing_and_what_is_stretched_does() {
    // Points in f32 a 256th apart: stretches of 1e-4 by rounding, each half of (1e-3)^2.
    let (sum, _) = cost(&turned(), MIXED);
    assert!((0.0..1e-4).contains(&sum), "{sum}");
    for s in [0.3, 0.05, -0.2] {
        let (sum, grad) = cost(&stretched(Origin::Free, s as f32), MIXED);
        assert!((sum / expected(s) - 1.0).abs() < 1e-2, "{s}: {sum}, not {}", expected(s));
        // Less of it costs less: the gradient of the three numbers that stretch has their sign.
        let along: f32 = (0..3).map(|a| grad.params[LAST + a * WIDTH + a]).sum();
        assert!(f64::from(along) * s > 0.0, "{s}: {along}");
    }
}

#[test]
fn a_displacement_alike_everywhere_costs_nothing() {
    let shift = warp(Motion::Translation, Origin::Free, |params| {
        params[LAST + 3 * WIDTH..].copy_from_slice(&[0.3, -0.2, 0.4]);
    });
    let (sum, _) = cost(&shift, MIXED);
    assert!((0.0..1e-4).contains(&sum), "{sum}");
}

#[test]
fn nothing_is_compared_where_nothing_moves_or_nothing_weighs() {
    let exact = stretched(Origin::Exact, 0.3);
    let (sum, grad) = cost(&exact, [0; 6]);
    assert!(sum == 0.0 && grad.params.iter().all(|&g| g == 0.0));
    let (some, _) = cost(&exact, MIXED);
    let (all, _) = cost(&stretched(Origin::Free, 0.3), MIXED);
    // Of the six points two are of the canonical time, one of them without weight.
    let share = (W[1] + W[2] + W[4] + W[5]) / W.iter().sum::<f32>();
    assert!((some / all - f64::from(share)).abs() < 1e-2, "{some} of {all}");
    let nothing = warp(Motion::None, Origin::Free, |_| {});
    assert!(!nothing.costs_by_weight());
}

#[test]
fn a_factor_makes_a_loss_of_samples_where_points_are_moved() {
    let settings = CoherenceSettings { coherence: 0.5, ..CoherenceSettings::NONE };
    let deform = turned();
    assert!(!deform.costs_by_weight() && deform.coherence_factor() == 0.0);
    let deform = deform.with_coherence(settings).unwrap();
    assert!(deform.costs_by_weight() && deform.coherence_factor() == 0.5);
    for (coherence, coherence_reach, coherence_scale, name) in [
        (-1.0, 0.1, 0.1, "coherence"),
        (f32::NAN, 0.1, 0.1, "coherence"),
        (1.0, 0.0, 0.1, "coherence_reach"),
        (1.0, 0.3, 0.1, "coherence_reach"),
        (1.0, 0.1, 0.0, "coherence_scale"),
        (1.0, 0.1, f32::NAN, "coherence_scale"),
    ] {
        let settings = CoherenceSettings { coherence, coherence_reach, coherence_scale };
        let error = turned().with_coherence(settings).err().unwrap().to_string();
        assert!(error.contains(&format!("`{name}`")), "{error}");
    }
}

#[test]
fn neighbours_are_as_far_away_as_is_asked_for_in_all_directions_and_in_the_cube() {
    let (draws, n) = (Rng::new(7, 3), 4000_u64);
    for (x, reach) in [([0.5; 3], 0.25_f32), ([0.5; 3], 1.0 / 256.0), ([0.0, 1.0, 0.999], 0.1), ([1.0; 3], 0.25)] {
        let (mut sum, mut squares) = ([0.0_f32; 3], [0.0_f32; 3]);
        for i in 0..n {
            let there = neighbour(x, reach, draws, i);
            assert!(there.iter().all(|x| (0.0..=1.0).contains(x)), "{there:?}");
            let e = [0, 1, 2].map(|a| (there[a] - x[a]) / reach);
            let length = e.iter().map(|e| e * e).sum::<f32>().sqrt();
            assert!((length - 1.0).abs() < 1e-4, "{length}");
            for a in 0..3 {
                sum[a] += e[a] / n as f32;
                squares[a] += e[a] * e[a] / n as f32;
            }
        }
        // A third of the square along each axis; the standard error is 0.005.
        assert!(squares.iter().all(|square| (square - 1.0 / 3.0).abs() < 0.03), "{squares:?}");
        assert!(x != [0.5; 3] || sum.iter().all(|mean| mean.abs() < 0.05), "{sum:?}");
    }
}

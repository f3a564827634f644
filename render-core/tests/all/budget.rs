//! What a skip may cost: each bound against the full sum, over random rays, radiances and backgrounds.

use proptest::collection::vec;
use proptest::prelude::*;
use render_core::budget::{
    Account, Budget, Entry, Ledger, ROUNDING, Radiance, Sides, Skip, SkipSet, blend_bound, blend_sides, empty_bound,
    faint_bound, harmonics_bound, harmonics_degree, open_levels, termination_bound,
};

/// A ray: optical depths, radiances, what is behind.
#[derive(Clone, Debug)]
struct Scene {
    tau: Vec<f32>,
    rgb: Vec<[f32; 3]>,
    background: [f32; 3],
    radiance: Radiance,
}

fn tau() -> impl Strategy<Value = f32> {
    prop_oneof![
        Just(0.0_f32),
        Just(f32::INFINITY),
        (-14.0..-3.0_f32).prop_map(f32::exp),
        (-3.0..3.0_f32).prop_map(f32::exp)
    ]
}

fn scene() -> impl Strategy<Value = Scene> {
    let radiance = prop_oneof![
        Just(Radiance::UNIT),
        (-2.0..0.5_f32, 0.5..40.0_f32).prop_map(|(low, high)| Radiance { low, high })
    ];
    (0_usize..65, radiance).prop_flat_map(|(n, radiance)| {
        let channel = prop_oneof![Just(radiance.low), Just(radiance.high), radiance.low..=radiance.high];
        let rgb = vec([channel.clone(), channel.clone(), channel], n);
        (vec(tau(), n), rgb, [-0.5..1.5_f32, -0.5..1.5, -0.5..1.5]).prop_map(move |(tau, rgb, background)| Scene {
            tau,
            rgb,
            background,
            radiance,
        })
    })
}

fn any_budget() -> impl Strategy<Value = f32> {
    prop_oneof![Just(0.0), Just(1.0 / 255.0), Just(1.0 / 2048.0), Just(1e-2), Just(0.1), Just(2.0), 1e-9..0.5_f32]
}

/// The full sum, in `f64`.
fn full(s: &Scene) -> [f64; 3] {
    let (mut depth, mut out) = (0.0_f64, [0.0; 3]);
    for (&tau, rgb) in s.tau.iter().zip(&s.rgb) {
        let w = (-depth).exp() * -(-f64::from(tau)).exp_m1();
        for (out, &c) in out.iter_mut().zip(rgb) {
            *out += w * f64::from(c);
        }
        depth += f64::from(tau);
    }
    for (out, b) in out.iter_mut().zip(s.background) {
        *out += (-depth).exp() * f64::from(b);
    }
    out
}

/// What a renderer does that deals its budget out: how many samples it looked at, how many colours it asked for.
fn thrifty(s: &Scene, budget: &Budget) -> ([f64; 3], usize, usize) {
    let mut account = Account::default();
    let (mut depth, mut out, mut looked, mut colours) = (0.0_f64, [0.0; 3], 0, 0);
    let n = s.tau.len() as u32;
    for (i, (&tau, rgb)) in s.tau.iter().zip(&s.rgb).enumerate() {
        if budget.stops(&mut account, (-depth).exp()) {
            break;
        }
        looked += 1;
        let w = ((-depth).exp() * -(-f64::from(tau)).exp_m1()) as f32;
        if !budget.drops(&mut account, w, n - i as u32) {
            colours += 1;
            for (out, &c) in out.iter_mut().zip(rgb) {
                *out += f64::from(w) * f64::from(c);
            }
        }
        depth += f64::from(tau);
    }
    for (out, b) in out.iter_mut().zip(s.background) {
        *out += (-depth).exp() * f64::from(b);
    }
    (out, looked, colours)
}

fn largest_difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn the_picture_stays_inside_the_budget(s in scene(), eps in any_budget()) {
        let budget = Budget::new(eps, s.radiance, s.background);
        // Weights are rounded to `f32`, which scales with what they multiply.
        let rounding = ROUNDING * s.radiance.largest().max(1.0);
        for skips in [SkipSet::ALL, SkipSet::only(Skip::Behind), SkipSet::only(Skip::Faint)] {
            let error = largest_difference(thrifty(&s, &budget.only(skips)).0, full(&s));
            prop_assert!(error <= f64::from(eps).max(rounding) + rounding, "{error} > {eps}");
        }
    }

    #[test]
    fn unit_radiances_stay_inside_the_budget_with_all_rounding(s in scene(), eps in any_budget()) {
        let s = Scene { rgb: s.rgb.iter().map(|c| c.map(|c| c.clamp(0.0, 1.0))).collect(), ..s };
        let s = Scene { background: s.background.map(|b| b.clamp(0.0, 1.0)), ..s };
        let skipping = thrifty(&s, &Budget::new(eps, Radiance::UNIT, s.background)).0;
        let nothing = thrifty(&s, &Budget::new(0.0, Radiance::UNIT, s.background)).0;
        let pixel = |c: [f64; 3]| c.map(|c| f64::from(c as f32));
        prop_assert!(largest_difference(pixel(skipping), pixel(nothing)) <= f64::from(eps));
    }

    #[test]
    fn a_budget_of_nothing_skips_nothing(s in scene(), eps in prop_oneof![Just(0.0_f32), Just(-1.0), Just(f32::NAN), Just(1e-9)]) {
        let (_, looked, colours) = thrifty(&s, &Budget::new(eps, s.radiance, s.background));
        prop_assert_eq!((looked, colours), (s.tau.len(), s.tau.len()));
    }

    #[test]
    fn accounts_are_never_overdrawn(s in scene(), eps in any_budget(), costs in vec(0.0..0.1_f64, 0..20)) {
        let budget = Budget::new(eps, s.radiance, s.background);
        let mut account = Account::default();
        for (i, cost) in costs.into_iter().enumerate() {
            match i % 3 {
                0 => drop(budget.affords(&mut account, Skip::Branch, cost)),
                1 => drop(budget.drops(&mut account, cost as f32, 3)),
                _ => drop(budget.stops(&mut account, cost)),
            }
            prop_assert!(account.spent() <= f64::from(eps).max(0.0) * (1.0 + 1e-12));
        }
    }

    #[test]
    fn stopping_costs_at_most_its_bound(s in scene(), at in 0_usize..65) {
        let at = at.min(s.tau.len());
        let cut = Scene { tau: s.tau[..at].to_vec(), rgb: s.rgb[..at].to_vec(), ..s.clone() };
        let depth: f64 = cut.tau.iter().map(|&t| f64::from(t)).sum();
        let bound = termination_bound((-depth).exp() as f32, s.radiance.spread(s.background) as f32);
        let error = largest_difference(full(&cut), full(&s));
        prop_assert!(error <= f64::from(bound) * (1.0 + 1e-6) + 1e-12, "{error} > {bound}");
    }

    #[test]
    fn taking_intervals_away_costs_at_most_its_bound(s in scene(), gone in vec(any::<bool>(), 65)) {
        let mut rest = s.clone();
        let mut taken = 0.0_f64;
        for (tau, &gone) in rest.tau.iter_mut().zip(&gone) {
            if gone {
                taken += f64::from(*tau);
                *tau = 0.0;
            }
        }
        let spread = s.radiance.spread(s.background);
        let bound = f64::from(empty_bound(taken as f32, spread as f32));
        let error = largest_difference(full(&rest), full(&s));
        prop_assert!(error <= bound * (1.0 + 1e-6) + 1e-12, "{error} > {bound}");
        prop_assert!(bound <= (taken * spread) * (1.0 + 1e-6) && bound <= spread * (1.0 + 1e-6));
    }

    #[test]
    fn a_colour_left_out_costs_at_most_its_bound(s in scene(), which in 0_usize..65) {
        prop_assume!(which < s.tau.len());
        let mut black = s.clone();
        black.rgb[which] = [0.0; 3];
        let before: f64 = s.tau[..which].iter().map(|&t| f64::from(t)).sum();
        let w = (-before).exp() * -(-f64::from(s.tau[which])).exp_m1();
        let bound = f64::from(faint_bound(w as f32, s.radiance.largest() as f32));
        prop_assert!(largest_difference(full(&black), full(&s)) <= bound * (1.0 + 1e-6) + 1e-12);
    }

    #[test]
    fn a_blend_stays_within_its_allowance(a in 0.0..=1.0_f32, x in -1.0..1.0_f32, y in -1.0..1.0_f32, allowance in 0.0..0.6_f32) {
        let blend = (1.0 - a) * x + a * y;
        let taken = match blend_sides(a, 2.0, allowance) {
            Sides::Both => blend,
            Sides::First => x,
            Sides::Second => y,
        };
        prop_assert!((taken - blend).abs() <= allowance + 1e-6);
        prop_assert_eq!(blend_sides(a, 2.0, 0.0), Sides::Both);
        prop_assert_eq!(blend_bound(a, Sides::Both, 2.0), 0.0);
    }

    #[test]
    fn closed_levels_give_nothing(window in vec(prop_oneof![Just(0.0_f32), 0.0..1.0_f32], 0..12), features in vec(-9.0..9.0_f32, 12)) {
        let sum = |n: usize| window.iter().zip(&features).take(n).map(|(w, f)| w * f).sum::<f32>();
        let open = open_levels(&window);
        prop_assert_eq!(sum(open), sum(window.len()));
        prop_assert!(open == 0 || window[open - 1] != 0.0);
    }

    #[test]
    fn harmonics_left_out_stay_within_their_bound(c in vec(-2.0..2.0_f32, 9), d in [-1.0..1.0_f64, -1.0..1.0, -1.0..1.0], from in 0_usize..4) {
        let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
        prop_assume!(length > 1e-3);
        let y = basis(d.map(|x| x / length));
        let left_out: f64 = (from * from..9).map(|i| y[i] * f64::from(c[i])).sum();
        let bound = harmonics_bound(&c, from);
        prop_assert!(left_out.abs() <= bound * (1.0 + 1e-5), "{left_out} > {bound}");
        let degrees = harmonics_degree(&c, bound.max(1e-30));
        prop_assert!(degrees <= from.min(3));
        prop_assert_eq!(harmonics_degree(&c, 0.0), 3);
    }

    #[test]
    fn ledgers_merge_to_the_same_bits_in_any_order(parts in vec((0_u64..99, 0.0..1.0_f64), 0..20), cut in 0_usize..20) {
        let ledger = |parts: &[(u64, f64)]| {
            let mut ledger = Ledger::default();
            for &(count, bound) in parts {
                ledger.count(Skip::Faint, count, count + 1);
                ledger.spend(Skip::Faint, bound);
            }
            ledger
        };
        let (a, b) = parts.split_at(cut.min(parts.len()));
        let (whole, mut backwards) = (ledger(&parts), ledger(b));
        backwards.merge(&ledger(a));
        prop_assert_eq!(whole, backwards);
        let entry = whole.entry(Skip::Faint);
        let sum: f64 = parts.iter().map(|p| p.1).sum();
        prop_assert!(entry.spent() >= sum && entry.spent() <= sum + 1e-9 + parts.len() as f64 * 2e-12);
        prop_assert!(entry.most() >= parts.iter().map(|p| p.1).fold(0.0, f64::max));
        prop_assert_eq!(entry.pixels, parts.len() as u64);
    }
}

/// Real orthonormal spherical harmonics of degrees 0 to 2.
fn basis([x, y, z]: [f64; 3]) -> [f64; 9] {
    [
        0.282_094_791_773_878,
        0.488_602_511_902_92 * y,
        0.488_602_511_902_92 * z,
        0.488_602_511_902_92 * x,
        1.092_548_430_592_08 * x * y,
        1.092_548_430_592_08 * y * z,
        0.315_391_565_252_52 * (3.0 * z * z - 1.0),
        1.092_548_430_592_08 * x * z,
        0.546_274_215_296_04 * (x * x - y * y),
    ]
}

#[test]
fn a_ray_stops_behind_what_is_opaque_and_shows_the_background_with_what_is_left() {
    let s = Scene {
        tau: vec![8.0; 10],
        rgb: vec![[1.0, 0.0, 0.5]; 10],
        background: [0.0, 1.0, 0.5],
        radiance: Radiance::UNIT,
    };
    let (rgb, looked, _) = thrifty(&s, &Budget::new(1.0 / 2048.0, s.radiance, s.background));
    assert_eq!(looked, 1);
    // Weight and transmittance still add up to 1.
    assert!((rgb[2] - 0.5).abs() < 1e-7, "{rgb:?}");
}

#[test]
fn one_skip_can_be_had_alone() {
    let budget = Budget::new(0.1, Radiance::UNIT, [0.0; 3]);
    for skip in Skip::ALL {
        let only = budget.only(SkipSet::only(skip));
        assert_eq!(Skip::ALL.map(|s| only.takes(s)), Skip::ALL.map(|s| s == skip));
        assert!(!skip.name().is_empty() && !Budget::new(0.0, Radiance::UNIT, [0.0; 3]).takes(skip));
    }
    assert!(!budget.only(SkipSet::NONE).takes(Skip::Empty));
}

#[test]
fn what_a_ledger_never_saw_is_nothing() {
    assert_eq!(Ledger::default().entry(Skip::Behind), Entry::default());
    let mut ledger = Ledger::default();
    ledger.spend(Skip::Behind, f64::NAN);
    ledger.spend(Skip::Behind, 0.0);
    assert_eq!((ledger.entry(Skip::Behind).spent(), ledger.entry(Skip::Behind).pixels), (0.0, 2));
}

#[test]
fn bounds_at_the_edges() {
    assert_eq!(empty_bound(0.0, 1.0), 0.0);
    assert_eq!(empty_bound(f32::INFINITY, 2.0), 2.0);
    assert_eq!((open_levels(&[]), open_levels(&[0.0, 0.0]), open_levels(&[0.0, 1.0, 0.0])), (0, 0, 2));
    assert_eq!((harmonics_bound(&[], 0), harmonics_degree(&[], 1.0)), (0.0, 0));
    assert_eq!(Radiance::UNIT.spread([-1.0, 0.5, 1.5]), 2.0);
}

//! Rays and what lies along them.

use super::any_unit_vector;
use proptest::collection::vec;
use proptest::prelude::*;

/// A point: near the origin mostly, sometimes exactly there or far away (up to `1e4`).
pub fn any_point() -> impl Strategy<Value = [f64; 3]> {
    prop_oneof![
        6 => [-4.0..4.0, -4.0..4.0, -4.0..4.0_f64],
        1 => Just([0.0; 3]),
        1 => [-1e4..1e4, -1e4..1e4, -1e4..1e4_f64],
    ]
}

/// Origin and unit direction.
pub fn any_ray() -> impl Strategy<Value = ([f64; 3], [f64; 3])> {
    (any_point(), any_unit_vector())
}

/// A distance between neighbours: 0, one or a few ulps, tiny, ordinary, long.
pub fn any_step() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => 0.001..1.0_f32,
        2 => Just(0.0),
        2 => (1..4_u32).prop_map(|ulps| ulps as f32 * f32::EPSILON),
        1 => 1e-30..1e-6_f32,
        1 => 1.0..100.0_f32,
    ]
}

/// `n + 1` edges of `n` intervals, finite, `>= 0`, non-decreasing; some intervals are empty or one ulp long.
///
/// `n` is a number or a range of them, as for [`proptest::collection::vec`].
pub fn any_edges(n: impl Into<proptest::collection::SizeRange>) -> impl Strategy<Value = Vec<f32>> {
    let start = prop_oneof![3 => 0.01..4.0_f32, 1 => Just(0.0), 1 => 1e-38..1e-6_f32];
    let n = n.into();
    let (low, high) = (n.start(), n.end_excl());
    (start, vec(any_step(), low..high), any::<bool>()).prop_map(|(start, steps, nudge)| {
        let mut edges = Vec::with_capacity(steps.len() + 1);
        let mut t = start;
        edges.push(t);
        for step in steps {
            let next = t + step;
            // A step that rounds away becomes the next number, half of the time.
            t = if next == t && step > 0.0 && nudge { t.next_up() } else { next };
            edges.push(t);
        }
        edges
    })
}

/// One density: 0, denormal, tiny, ordinary, dense, huge (`1e30`). Always finite.
pub fn any_density() -> impl Strategy<Value = f32> {
    prop_oneof![
        6 => 0.01..50.0_f32,
        2 => Just(0.0),
        1 => (1..0x0080_0000_u32).prop_map(f32::from_bits),
        1 => 1e-30..1e-4_f32,
        1 => 50.0..1e6_f32,
        1 => 1e6..1e30_f32,
    ]
}

/// Densities of `n` intervals, sometimes all 0, sometimes all the same.
pub fn any_densities(n: impl Into<proptest::collection::SizeRange>) -> impl Strategy<Value = Vec<f32>> {
    let n = n.into();
    prop_oneof![
        8 => vec(any_density(), n.clone()),
        1 => vec(Just(0.0), n.clone()),
        1 => (any_density(), vec(Just(()), n)).prop_map(|(sigma, v)| vec![sigma; v.len()]),
    ]
}

/// A histogram along a ray: edges `[n + 1]` as [`any_edges`] and weights `[n]`, `>= 0`, summing to at most 1 (up to
/// rounding); sometimes all 0, sometimes all in one bin.
pub fn any_histogram(n: impl Into<proptest::collection::SizeRange>) -> impl Strategy<Value = (Vec<f32>, Vec<f32>)> {
    let weight = prop_oneof![5 => 0.0..1.0_f32, 2 => Just(0.0), 1 => 1e-38..1e-6_f32];
    (any_edges(n), any::<proptest::sample::Index>(), 0..8_u8, 0.05..1.0_f32).prop_flat_map(
        move |(edges, one, kind, total)| {
            let n = edges.len() - 1;
            let weights = vec(weight.clone(), n).prop_map(move |mut w| {
                match kind {
                    0 => w.fill(0.0),
                    1 if n > 0 => {
                        w.fill(0.0);
                        w[one.index(n)] = total;
                    }
                    _ => {
                        let sum: f32 = w.iter().sum();
                        if sum > 0.0 {
                            w.iter_mut().for_each(|w| *w *= total / sum);
                        }
                    }
                }
                w
            });
            (Just(edges), weights)
        },
    )
}

#[cfg(test)]
mod tests {
    use super::super::tests::count;
    use super::*;

    proptest! {
        #![proptest_config(crate::property::cases(128))]

        #[test]
        fn edges_are_finite_and_do_not_decrease(t in any_edges(0..65)) {
            prop_assert!((1..=65).contains(&t.len()));
            prop_assert!(t.iter().all(|t| t.is_finite() && *t >= 0.0));
            prop_assert!(t.windows(2).all(|t| t[0] <= t[1]));
        }

        #[test]
        fn densities_are_finite_and_not_negative(sigma in any_densities(5)) {
            prop_assert_eq!(sigma.len(), 5);
            prop_assert!(sigma.iter().all(|s| s.is_finite() && *s >= 0.0));
        }

        #[test]
        fn histograms_fit_together((t, w) in any_histogram(0..65)) {
            prop_assert_eq!(t.len(), w.len() + 1);
            prop_assert!(w.iter().all(|w| (0.0..=1.0).contains(w)));
            prop_assert!(w.iter().sum::<f32>() <= 1.0 + 1e-5);
        }

        #[test]
        fn rays_are_finite_with_unit_direction((o, d) in any_ray()) {
            prop_assert!(o.iter().all(|x| x.abs() <= 1e4));
            prop_assert!((d.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn the_special_cases_come_up() {
        assert!(count(any_density(), |s| *s == 0.0) > 20);
        assert!(count(any_density(), |s| *s > 0.0 && !s.is_normal()) > 10);
        assert!(count(any_density(), |s| *s > 1e20) > 10);
        assert!(count(any_edges(8), |t| t.windows(2).any(|t| t[0] == t[1])) > 100);
        assert!(count(any_edges(8), |t| t.windows(2).any(|t| t[1] == t[0].next_up())) > 20);
        assert!(count(any_edges(0..3), |t| t.len() == 1) > 50);
        assert!(count(any_densities(9), |s| s.iter().all(|s| *s == 0.0)) > 10);
        assert!(count(any_histogram(9), |(_, w)| w.iter().all(|w| *w == 0.0)) > 10);
        assert!(count(any_histogram(9), |(_, w)| w.iter().filter(|w| **w > 0.0).count() == 1) > 10);
    }
}

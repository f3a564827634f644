//! Where a polynomial first becomes zero: the fold of a lens.

/// Coefficients of the polynomials here, constant term first.
pub(super) type Coefficients = [f64; 16];

/// `c[0] + c[1] x + ...` by Horner's rule.
pub(super) fn evaluate(c: &[f64], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |acc, &c| acc * x + c)
}

/// Smallest root in `(0, limit)` at which `c` changes sign, or `limit` when there is none.
///
/// A root at which the sign stays (the curve only touches zero) does not count.
pub(super) fn first_sign_change(c: &Coefficients, limit: f64) -> f64 {
    let mut roots = [0.0; 16];
    match sign_changes(c, limit, &mut roots) {
        0 => limit,
        _ => roots[0],
    }
}

/// All sign changes in `(0, limit)`, ascending; returns how many there are.
///
/// The roots of the derivative cut the line into pieces on which the polynomial is monotone; each piece holds at most
/// one root and is bisected. Descartes' rule of signs ends most calls early.
fn sign_changes(c: &[f64], limit: f64, roots: &mut Coefficients) -> usize {
    let (Some(lowest), Some(highest)) = (c.iter().position(|&c| c != 0.0), c.iter().rposition(|&c| c != 0.0)) else {
        return 0;
    };
    // Without its power of x the polynomial has the same positive roots, and a sign at 0.
    let c = &c[lowest..=highest];
    let degree = highest - lowest;
    let mut turning = [0.0; 16];
    let turns = match sign_variations(c) {
        0 => return 0,
        1 => 0, // exactly one positive root: the whole line is its bracket
        _ => {
            let mut derivative = [0.0; 16];
            for (i, d) in derivative[..degree].iter_mut().enumerate() {
                *d = c[i + 1] * (i + 1) as f64;
            }
            sign_changes(&derivative[..degree], limit, &mut turning)
        }
    };
    let (mut found, mut lo, mut positive) = (0, 0.0, c[0] > 0.0);
    for &hi in turning[..turns].iter().chain(&[limit]) {
        let value = evaluate(c, hi);
        // At 0 the curve touches or crosses: the next piece tells.
        if value != 0.0 && (value > 0.0) != positive {
            roots[found] = bisect(c, lo, hi, positive);
            found += 1;
            positive = !positive;
        }
        lo = hi;
    }
    found
}

/// How often the sign changes from one nonzero coefficient to the next.
fn sign_variations(c: &[f64]) -> usize {
    let mut signs = c.iter().filter(|&&c| c != 0.0).map(|&c| c > 0.0);
    let Some(mut last) = signs.next() else { return 0 };
    signs.filter(|&sign| core::mem::replace(&mut last, sign) != sign).count()
}

/// The sign change between `lo` and `hi`, to the last bit; the returned point is on the side of `lo`, where `c` is
/// `positive` or not.
fn bisect(c: &[f64], mut lo: f64, mut hi: f64, positive: bool) -> f64 {
    loop {
        let mid = 0.5 * (lo + hi);
        if mid <= lo || mid >= hi {
            return lo;
        }
        if (evaluate(c, mid) > 0.0) == positive { lo = mid } else { hi = mid }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn padded<const N: usize>(c: [f64; N]) -> Coefficients {
        core::array::from_fn(|i| c.get(i).copied().unwrap_or(0.0))
    }

    #[test]
    fn first_sign_change_finds_the_smallest_of_several_roots() {
        // (x - 0.5)(x - 2)(x - 3)
        let c = padded([-3.0, 8.5, -5.5, 1.0]);
        assert!((first_sign_change(&c, 1e12) - 0.5).abs() < 1e-12);
        assert_eq!(first_sign_change(&c, 0.4), 0.4);
    }

    #[test]
    fn first_sign_change_is_found_where_a_derivative_vanishes_at_zero() {
        // -(x^2 - 1)(x^2 - 4)(x^2 - 9) / 36, whose odd derivatives begin with a power of x; and the same with a little of x.
        let even = [1.0, 0.0, -49.0 / 36.0, 0.0, 14.0 / 36.0, 0.0, -1.0 / 36.0];
        assert!((first_sign_change(&padded(even), 1e12) - 1.0).abs() < 1e-12);
        let bent = first_sign_change(&padded([1.0, -0.01, even[2], 0.0, even[4], 0.0, even[6]]), 1e12);
        assert!((0.98..1.0).contains(&bent), "{bent}");
        // x^3 - x^5
        assert!((first_sign_change(&padded([0.0, 0.0, 0.0, 1.0, 0.0, -1.0]), 1e12) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn first_sign_change_of_a_positive_polynomial_is_the_limit() {
        assert_eq!(first_sign_change(&padded([1.0]), 7.0), 7.0);
        // 1 - x + x^2 has no real root.
        assert_eq!(first_sign_change(&padded([1.0, -1.0, 1.0]), 1e12), 1e12);
    }

    #[test]
    fn first_sign_change_handles_tiny_coefficients_and_high_degrees() {
        let root = first_sign_change(&padded([1.0, -1e-9]), 1e12);
        assert!((root * 1e-9 - 1.0).abs() < 1e-12);
        // 1 - x^15
        let mut c = padded([1.0]);
        c[15] = -1.0;
        assert!((first_sign_change(&c, 1e6) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_derivative_that_starts_at_zero_hides_no_root() {
        // (1 - x^2)(4 - x^2)(9 - x^2): first, second and third derivatives have no constant, or no linear, term.
        let even = padded([36.0, 0.0, -49.0, 0.0, 14.0, 0.0, -1.0]);
        assert!((first_sign_change(&even, 1e6) - 1.0).abs() < 1e-12);
        // The same with a little slope, as tangential terms give it.
        let bent = padded([36.0, -0.1, -49.0, 0.0, 14.0, 0.0, -1.0]);
        assert!((first_sign_change(&bent, 1e6) - 1.0).abs() < 1e-2);
        // x^2 (x - 2): the root at 0 is not inside of (0, limit).
        assert!((first_sign_change(&padded([0.0, 0.0, -2.0, 1.0]), 1e6) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_curve_that_only_touches_zero_has_no_sign_change_there() {
        // (1 - x)^2, and (1 - x)^2 (3 - x).
        assert_eq!(first_sign_change(&padded([1.0, -2.0, 1.0]), 1e6), 1e6);
        assert!((first_sign_change(&padded([3.0, -7.0, 5.0, -1.0]), 1e6) - 3.0).abs() < 1e-12);
        // (1 - x)^3 crosses.
        assert!((first_sign_change(&padded([1.0, -3.0, 3.0, -1.0]), 1e6) - 1.0).abs() < 1e-4);
    }

    proptest! {
        #![proptest_config(testkit::property::cases(256))]

        #[test]
        fn no_sample_before_the_first_sign_change_has_another_sign(
            c in prop::array::uniform8(prop_oneof![Just(0.0), -1.0..1.0_f64]),
        ) {
            // 1 + c0 x + ... + c7 x^8, with gaps.
            let mut all = padded([1.0]);
            all[1..9].copy_from_slice(&c);
            let limit = 8.0;
            let first = first_sign_change(&all, limit);
            for i in 0..2000 {
                let x = first * f64::from(i) / 2000.0;
                let rounding = 1e-13 * all.iter().rev().fold(0.0, |acc, &c| acc * x + c.abs());
                prop_assert!(evaluate(&all, x) > -rounding, "{x} of {first}: {}", evaluate(&all, x));
            }
            prop_assert!(first == limit || evaluate(&all, first.next_up()) <= 0.0, "{first} is not a root");
        }
    }
}

//! Real roots of polynomials, to the last bits.

/// Degree of the highest polynomial handled.
const MAX_DEGREE: usize = 4;

/// The value of `c[0] + c[1] x + c[2] x^2 + ..`.
fn value(c: &[f64], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// The real roots in `[low, high]`, ascending, each once. Double roots, where the curve only touches zero, are found if
/// rounding leaves a change of sign.
///
/// Between neighbouring roots of the derivative the polynomial is monotone: every change of sign holds exactly one root,
/// which bisection cannot miss. Slower than closed forms for degree 4 and free of their cancellation.
pub(super) fn roots(c: &[f64], low: f64, high: f64) -> ([f64; MAX_DEGREE], usize) {
    let mut found = ([0.0; MAX_DEGREE], 0);
    assert!(c.len() <= MAX_DEGREE + 1, "polynomial of degree {}", c.len() - 1);
    if c.len() < 2 || low > high {
        return found;
    }
    let mut derivative = [0.0; MAX_DEGREE];
    for (i, d) in derivative[..c.len() - 1].iter_mut().enumerate() {
        *d = (i + 1) as f64 * c[i + 1];
    }
    let (turns, count) = roots(&derivative[..c.len() - 1], low, high);
    let mut left = low;
    for &right in turns[..count].iter().chain(&[high]) {
        if let Some(root) = bisect(c, left, right) {
            let (known, n) = (&mut found.0, &mut found.1);
            // A root exactly on a turning point is the end of one piece and the start of the next.
            if *n < MAX_DEGREE && (*n == 0 || known[*n - 1] < root) {
                known[*n] = root;
                *n += 1;
            }
        }
        left = right;
    }
    found
}

/// The root between two points of different sign, or of which one is a root.
fn bisect(c: &[f64], mut low: f64, mut high: f64) -> Option<f64> {
    let (at_low, at_high) = (value(c, low), value(c, high));
    if at_low == 0.0 {
        return Some(low);
    }
    if at_high == 0.0 {
        return Some(high);
    }
    if (at_low > 0.0) == (at_high > 0.0) {
        return None;
    }
    // Newton where it stays inside the bracket, else halving: at most about 60 rounds, usually 6.
    let mut x = 0.5 * (low + high);
    for _ in 0..100 {
        let y = value(c, x);
        if y == 0.0 {
            return Some(x);
        }
        if (y > 0.0) == (at_low > 0.0) {
            low = x;
        } else {
            high = x;
        }
        let slope = c.iter().enumerate().skip(1).rev().fold(0.0, |sum, (i, c)| sum * x + i as f64 * c);
        let newton = x - y / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        // No number lies between, or the step is below rounding.
        if next <= low || next >= high || (next - x).abs() <= 1e-16 * x.abs() {
            return Some(next);
        }
        x = next;
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `(x - r0) (x - r1) ..`, lowest coefficient first.
    fn from_roots(roots: &[f64]) -> Vec<f64> {
        roots.iter().fold(vec![1.0], |c, r| {
            let mut next = vec![0.0; c.len() + 1];
            for (i, c) in c.iter().enumerate() {
                next[i + 1] += c;
                next[i] -= r * c;
            }
            next
        })
    }

    fn found(c: &[f64], low: f64, high: f64) -> Vec<f64> {
        let (roots, n) = roots(c, low, high);
        roots[..n].to_vec()
    }

    #[test]
    fn known_roots_are_found_and_others_are_not() {
        assert_eq!(found(&[-6.0, 5.0, 1.0], -10.0, 10.0), [-6.0, 1.0]);
        assert!(found(&[1.0, 0.0, 1.0], -10.0, 10.0).is_empty());
        assert_eq!(found(&[-6.0, 5.0, 1.0], 0.0, 10.0), [1.0]);
        assert_eq!(found(&[0.0, -1.0, 0.0, 1.0], -2.0, 2.0), [-1.0, 0.0, 1.0]);
        assert!(found(&[5.0], -1.0, 1.0).is_empty());
        assert!(found(&[], -1.0, 1.0).is_empty());
        // A double root at a turning point is reported once.
        assert_eq!(found(&[1.0, -2.0, 1.0], -5.0, 5.0), [1.0]);
    }

    proptest! {
        #![proptest_config(testkit::property::cases(128))]

        #[test]
        fn quartics_give_back_their_roots(start in -3.0..0.0_f64, gaps in [0.05..2.0, 0.05..2.0, 0.05..2.0_f64]) {
            let want = [start, start + gaps[0], start + gaps[0] + gaps[1], start + gaps.iter().sum::<f64>()];
            let got = found(&from_roots(&want), -10.0, 10.0);
            prop_assert_eq!(got.len(), 4);
            for (got, want) in got.iter().zip(want) {
                // Conditioning: the gaps of 0.05 amplify the rounding of the coefficients.
                prop_assert!((got - want).abs() < 1e-9, "{} for {}", got, want);
            }
        }
    }
}

//! Order statistics by selection.

use alloc::vec::Vec;

/// The smallest value that at least the share `quantile` of all values do not exceed (for one half and an even count: the
/// lower median). A value of the input, never between two. NaN counts as `+inf`; no values give `+inf`.
///
/// Linear time; nothing is allocated once `scratch` has held as many values.
pub(crate) fn lower_quantile(values: &[f32], quantile: f32, scratch: &mut Vec<f32>) -> f32 {
    if values.is_empty() {
        return f32::INFINITY;
    }
    scratch.clear();
    scratch.extend(values.iter().map(|&e| if e.is_nan() { f32::INFINITY } else { e }));
    let rank = rank(values.len(), quantile);
    *scratch.select_nth_unstable_by(rank, f32::total_cmp).1
}

/// `ceil(quantile n) - 1`, kept within `0 .. n`.
fn rank(n: usize, quantile: f32) -> usize {
    // One ulp less: 0.1 as an f32 is a little more than a tenth, and a tenth of 10 values is one, not two.
    let share = f64::from(quantile) * (1.0 - f64::from(f32::EPSILON)) * n as f64;
    // `as` cuts off what is behind the point and saturates.
    let whole = share as usize;
    let up = if whole as f64 == share { whole } else { whole + 1 };
    up.clamp(1, n) - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    #[test]
    fn rank_is_exact_where_the_share_is_a_whole_number() {
        assert_eq!([1, 2, 3, 4, 5, 4096].map(|n| rank(n, 0.5)), [0, 0, 1, 1, 2, 2047]);
        assert_eq!([10, 11, 20].map(|n| rank(n, 0.1)), [0, 1, 1]);
        assert_eq!([5, 10, 4096].map(|n| rank(n, 0.8)), [3, 7, 3276]);
        assert_eq!([1, 7].map(|n| (rank(n, 0.0), rank(n, 1.0))), [(0, 0), (0, 6)]);
    }

    #[test]
    fn lower_quantile_is_the_value_at_its_rank() {
        let mut scratch = vec![];
        assert_eq!(lower_quantile(&[], 0.5, &mut scratch), f32::INFINITY);
        assert_eq!(lower_quantile(&[3.0, 1.0, 2.0, 4.0], 0.5, &mut scratch), 2.0);
        // NaN of either sign comes last.
        assert_eq!(lower_quantile(&[f32::NAN, 1.0, -f32::NAN, 0.5], 0.5, &mut scratch), 1.0);
        assert_eq!(lower_quantile(&[f32::NAN, 1.0, -f32::NAN], 1.0, &mut scratch), f32::INFINITY);
    }
}

//! Adaptive Gauss-Kronrod integration.

/// Positive nodes of the 15-point Kronrod rule on `[-1, 1]` with its weight and that of the 7-point Gauss rule (0 where
/// that has no node); the last one is the middle.
const KRONROD: [(f64, f64, f64); 8] = [
    (0.991_455_371_120_812_6, 0.022_935_322_010_529_225, 0.0),
    (0.949_107_912_342_758_5, 0.063_092_092_629_978_55, 0.129_484_966_168_869_7),
    (0.864_864_423_359_769_1, 0.104_790_010_322_250_19, 0.0),
    (0.741_531_185_599_394_5, 0.140_653_259_715_525_92, 0.279_705_391_489_276_64),
    (0.586_087_235_467_691_1, 0.169_004_726_639_267_9, 0.0),
    (0.405_845_151_377_397_2, 0.190_350_578_064_785_4, 0.381_830_050_505_118_9),
    (0.207_784_955_007_898_47, 0.204_432_940_075_298_9, 0.0),
    (0.0, 0.209_482_141_084_727_82, 0.417_959_183_673_469_4),
];

/// Halvings after which an interval counts as done whatever the estimate says: it is then `1e-12` of the whole.
const MOST_HALVINGS: u32 = 40;

/// `int(f, from..to)` to an absolute error of about `tolerance`, for `f` that is smooth but for a few corners or jumps.
///
/// 15-point Gauss-Kronrod rules on intervals that are halved until the two rules inside agree, each half with half of the
/// tolerance; or until they agree to `1e-15` of themselves, beyond which there is nothing to gain.
#[must_use]
pub fn integrate(from: f64, to: f64, tolerance: f64, f: impl Fn(f64) -> f64) -> f64 {
    halve(from, to, tolerance, 0, &f)
}

fn halve(from: f64, to: f64, tolerance: f64, depth: u32, f: &impl Fn(f64) -> f64) -> f64 {
    let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
    let (mut kronrod, mut gauss, mut size) = (0.0, 0.0, 0.0);
    for (x, k, g) in KRONROD {
        let both = if x > 0.0 { f(middle - half * x) + f(middle + half * x) } else { f(middle) };
        kronrod += k * both;
        gauss += g * both;
        size += k * both.abs();
    }
    let error = half.abs() * (kronrod - gauss).abs();
    if error <= tolerance.max(1e-15 * half.abs() * size) || depth == MOST_HALVINGS {
        return half * kronrod;
    }
    halve(from, middle, 0.5 * tolerance, depth + 1, f) + halve(middle, to, 0.5 * tolerance, depth + 1, f)
}

/// The Gauss rule alone, on `[-1, 1]`.
#[cfg(test)]
pub(super) fn gauss_alone(f: impl Fn(f64) -> f64) -> f64 {
    KRONROD.iter().map(|&(x, _, g)| g * if x > 0.0 { f(-x) + f(x) } else { f(0.0) }).sum()
}

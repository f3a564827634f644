//! Bounds of the skips that are not about the end of the ray.

use float_core::m64;

/// Largest error of a channel when the colour of a sample of weight `w` counts as 0: `w * largest`, where `largest` is the
/// largest radiance, sign aside.
#[must_use]
pub fn faint_bound(w: f32, largest: f32) -> f32 {
    w * largest
}

/// Largest error of a channel when intervals of the optical thickness `tau` together are taken out of a ray, wherever on it
/// they lie: `(1 - exp(-tau)) * spread`, at most `tau * spread`. `spread` is the largest difference between any two of
/// the radiances and the background.
///
/// A bound for the thickness that the intervals have; an estimate where `tau` is one.
#[must_use]
pub fn empty_bound(tau: f32, spread: f32) -> f32 {
    (-m64::exp_m1(-f64::from(tau)) * f64::from(spread)) as f32
}

/// Sides of a blend that are worth computing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sides {
    /// Both.
    Both,
    /// The first alone: the blend's weight is near 0.
    First,
    /// The second alone: it is near 1.
    Second,
}

/// Largest error when the blend `(1 - a) * x + a * y` is replaced by one of its sides: the other's weight times the largest
/// distance of the two.
#[must_use]
pub fn blend_bound(a: f32, sides: Sides, distance: f32) -> f32 {
    match sides {
        Sides::Both => 0.0,
        Sides::First => a * distance,
        Sides::Second => (1.0 - a) * distance,
    }
}

/// Which sides of the blend `(1 - a) * x + a * y` must be computed for an error of at most `allowance`, where `x` and `y` are
/// never further apart than `distance`. An allowance of 0 takes both, whatever `a` is.
#[must_use]
pub fn blend_sides(a: f32, distance: f32, allowance: f32) -> Sides {
    let side = if a <= 0.5 { Sides::First } else { Sides::Second };
    if allowance > 0.0 && blend_bound(a, side, distance) <= allowance { side } else { Sides::Both }
}

/// Levels of a hash grid, or bands of a frequency encoding, up to and with the last whose window is not 0. What lies
/// behind is multiplied by 0: leaving it out is exact as long as it is finite.
#[must_use]
pub fn open_levels(window: &[f32]) -> usize {
    window.iter().rposition(|&w| w != 0.0).map_or(0, |last| last + 1)
}

/// Largest value, over all directions, of `sum(c[l][m] * Y[l][m])` over the degrees `from ..`: by Cauchy-Schwarz and
/// `sum(Y[l][m]^2, m) = (2 l + 1) / 4 pi` it is `sum(sqrt((2 l + 1) / 4 pi) * |c[l]|, l >= from)`.
///
/// * `c` `[degrees^2]` coefficients of one channel in an orthonormal real basis, degree by degree
///
/// # Panics
/// May do so where the square of `from` does not fit `usize`.
#[must_use]
pub fn harmonics_bound(c: &[f32], from: usize) -> f64 {
    let mut bound = 0.0;
    let mut degree = from;
    while degree * degree < c.len() {
        let end = ((degree + 1) * (degree + 1)).min(c.len());
        let energy: f64 = c[degree * degree..end].iter().map(|&c| f64::from(c) * f64::from(c)).sum();
        bound += m64::sqrt((2 * degree + 1) as f64 / (4.0 * core::f64::consts::PI) * energy);
        degree += 1;
    }
    bound
}

/// Fewest degrees, counted from the constant, that give `sum(c[l][m] * Y[l][m])` in every direction to within
/// `allowance`. An allowance of 0 takes all.
///
/// * `c` as in [`harmonics_bound`]
#[must_use]
pub fn harmonics_degree(c: &[f32], allowance: f64) -> usize {
    let mut degrees = 0;
    while degrees * degrees < c.len() && !(allowance > 0.0 && harmonics_bound(c, degrees) <= allowance) {
        degrees += 1;
    }
    degrees
}

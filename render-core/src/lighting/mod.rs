//! Lighting by real spherical harmonics of order 2: what a distant environment sends to a surface, in nine coefficients a channel.
//!
//! Coefficients are ordered `L00, L1-1, L10, L11, L2-2, L2-1, L20, L21, L22`; the basis is orthonormal and has no
//! Condon-Shortley signs, so that band 1 is `0.4886 (y, z, x)`. What a lighting's coefficients *are* is its [`Kind`], and both
//! exist in files: never load one without it.
//!
//! | function | out of | into |
//! | --- | --- | --- |
//! | [`basis`] | direction | nine numbers |
//! | [`Lighting::irradiance`], [`Lighting::irradiance_backward`] | lighting, normal | irradiance |
//! | [`Lighting::rotated`], [`Lighting::inside_out`] | lighting | the same lighting, turned |
//! | [`project_equirect`] | environment map | lighting |
//! | [`fit_irradiance`] | irradiances of some normals | lighting |
//! | [`shade`], [`shade_backward`] | albedo, shadow, irradiance | colour |
//! | [`sun_and_sky`], [`sun_and_sky_backward`] | the same with a sun | colour |
//! | [`outward_normal`], [`outward_normal_backward`] | density gradient | unit normal |
//!
//! Everything exists in `f32` and `f64`.
//!
//! ```
//! use render_core::lighting::{Kind, Lighting, Tone, shade};
//!
//! // Radiance 1 from everywhere: irradiance pi on every surface.
//! let white = Lighting::<f64>::constant([1.0; 3]);
//! assert_eq!(white.kind, Kind::Radiance);
//! let e = white.irradiance([0.6, 0.0, -0.8]);
//! assert!((e[0] - core::f64::consts::PI).abs() < 1e-12);
//! // Albedo is a reflectance here: divide by pi. A shadow of 1 is none.
//! let colour = shade(Tone::Gamma, [0.5, 0.25, 1.0], 1.0, e.map(|e| e / core::f64::consts::PI));
//! assert!((colour[1] - 0.25).abs() < 1e-12);
//! ```
//!
//! # Source
//! Ramamoorthi and Hanrahan, "An efficient representation for irradiance environment maps", 2001; Rudnev et al., "NeRF for
//! outdoor scene relighting", 2022, eq. 4 to 6.

mod environment;
mod fit;
mod rotate;
mod shade;

pub use environment::project_equirect;
pub use fit::{FitError, fit_irradiance};
pub use shade::{
    MIN_IRRADIANCE, Sun, SunBar, Tone, outward_normal, outward_normal_backward, shade, shade_backward, sun_and_sky,
    sun_and_sky_backward,
};

use crate::real::Real;
use core::f64::consts::PI;

/// Number of coefficients.
pub const COEFFICIENTS: usize = 9;

/// Degree of each coefficient.
const DEGREE: [usize; COEFFICIENTS] = [0, 1, 1, 1, 2, 2, 2, 2, 2];

/// `sqrt(1 / (4 pi))`, `sqrt(3 / (4 pi))`, `sqrt(15 / (4 pi))`, `sqrt(5 / (16 pi))`, `sqrt(15 / (16 pi))`.
const C0: f64 = 0.282_094_791_773_878_14;
const C1: f64 = 0.488_602_511_902_919_9;
const C2: f64 = 1.092_548_430_592_079_2;
const C3: f64 = 0.315_391_565_252_520_05;
const C4: f64 = 0.546_274_215_296_039_6;

/// The cosine lobe in spherical harmonics, by degree: what `max(0, cos)` does to radiance.
pub const COSINE_LOBE: [f64; 3] = [PI, 2.0 * PI / 3.0, PI / 4.0];

/// What the coefficients of a lighting describe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// The radiance that arrives from each direction: what an environment map projects to. Irradiance takes the cosine lobe.
    Radiance,
    /// The irradiance of each normal: the plain sum of the basis, which is what relightable fields fit.
    Irradiance,
}

/// Lighting in three channels, linear colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lighting<T = f32> {
    /// What the coefficients describe.
    pub kind: Kind,
    /// `[coefficient][channel]`
    pub coefficients: [[T; 3]; COEFFICIENTS],
}

/// The basis at a unit direction. Away from the sphere these are polynomials: `0.315 (3 z^2 - 1)` and so on.
#[inline]
#[must_use]
pub fn basis<T: Real>(d: [T; 3]) -> [T; COEFFICIENTS] {
    let [x, y, z] = d;
    let [c0, c1, c2, c3, c4] = constants();
    let three = T::of(3.0);
    [
        c0,
        c1 * y,
        c1 * z,
        c1 * x,
        c2 * x * y,
        c2 * y * z,
        c3 * (three * z * z - T::ONE),
        c2 * x * z,
        c4 * (x * x - y * y),
    ]
}

/// Derivatives of [`basis`] by the three coordinates.
#[inline]
#[must_use]
pub fn basis_gradient<T: Real>(d: [T; 3]) -> [[T; 3]; COEFFICIENTS] {
    let [x, y, z] = d;
    let [_, c1, c2, c3, c4] = constants();
    let zero = T::ZERO;
    let (c3, c4) = (T::of(6.0) * c3, T::TWO * c4);
    [
        [zero; 3],
        [zero, c1, zero],
        [zero, zero, c1],
        [c1, zero, zero],
        [c2 * y, c2 * x, zero],
        [zero, c2 * z, c2 * y],
        [zero, zero, c3 * z],
        [c2 * z, zero, c2 * x],
        [c4 * x, -(c4 * y), zero],
    ]
}

#[inline(always)]
fn constants<T: Real>() -> [T; 5] {
    [C0, C1, C2, C3, C4].map(T::of)
}

impl<T: Real> Lighting<T> {
    /// No light.
    #[must_use]
    pub fn dark(kind: Kind) -> Self {
        Self { kind, coefficients: [[T::ZERO; 3]; COEFFICIENTS] }
    }

    /// The same radiance from everywhere: `L00 = sqrt(4 pi)` times it.
    #[must_use]
    pub fn constant(radiance: [T; 3]) -> Self {
        let mut lighting = Self::dark(Kind::Radiance);
        lighting.coefficients[0] = radiance.map(|r| r / T::of(C0));
        lighting
    }

    /// A mild sky: where fitting starts, for random lighting often diverges. Coefficients of irradiance, in the axes and to two
    /// digits of the released NeRF-OSR.
    #[must_use]
    pub fn mild_sky() -> Self {
        #[rustfmt::skip]
        const ROWS: [[f64; 3]; COEFFICIENTS] = [
            [2.99, 3.46, 3.96], [0.10, -0.07, -0.31], [-0.83, -0.53, -0.10],
            [0.00, 0.00, 0.00], [-0.01, 0.01, -0.02], [0.11, -0.06, -0.20],
            [0.79, 0.77, 0.56], [0.07, 0.04, -0.17], [-0.07, 0.05, 0.23],
        ];
        Self { kind: Kind::Irradiance, coefficients: ROWS.map(|row| row.map(T::of)) }
    }

    /// What each degree is multiplied by to become irradiance.
    #[inline(always)]
    fn lobe(&self) -> [T; 3] {
        match self.kind {
            Kind::Radiance => COSINE_LOBE.map(T::of),
            Kind::Irradiance => [T::ONE; 3],
        }
    }

    /// Irradiance on a surface of unit normal `n`, linear colour; radiance times pi. May be negative where nine
    /// coefficients are not enough. A zero normal (a ray that met nothing) gets the constant term alone.
    #[inline]
    #[must_use]
    pub fn irradiance(&self, n: [T; 3]) -> [T; 3] {
        let (lobe, y) = (self.lobe(), self.seen(n));
        let mut out = [T::ZERO; 3];
        for ((row, y), degree) in self.coefficients.iter().zip(y).zip(DEGREE) {
            let y = lobe[degree] * y;
            for (out, &l) in out.iter_mut().zip(row) {
                *out += y * l;
            }
        }
        out
    }

    /// Gradient of [`Lighting::irradiance`] with respect to coefficients and normal: adds. The normal's is that of the
    /// polynomials of [`basis`], not projected to the sphere; that of a zero normal is 0.
    #[inline]
    pub fn irradiance_backward(
        &self,
        n: [T; 3],
        out_bar: [T; 3],
        coefficients_bar: &mut [[T; 3]; COEFFICIENTS],
        n_bar: &mut [T; 3],
    ) {
        let (lobe, y) = (self.lobe(), self.seen(n));
        let derivatives = if is_zero(n) { [[T::ZERO; 3]; COEFFICIENTS] } else { basis_gradient(n) };
        for (k, (row_bar, row)) in coefficients_bar.iter_mut().zip(&self.coefficients).enumerate() {
            let a = lobe[DEGREE[k]];
            let mut through = T::ZERO;
            for ((row_bar, &l), bar) in row_bar.iter_mut().zip(row).zip(out_bar) {
                *row_bar += a * y[k] * bar;
                through += l * bar;
            }
            for (n_bar, derivative) in n_bar.iter_mut().zip(derivatives[k]) {
                *n_bar += a * through * derivative;
            }
        }
    }

    /// The basis, of which a zero normal sees the constant.
    #[inline(always)]
    fn seen(&self, n: [T; 3]) -> [T; COEFFICIENTS] {
        let mut y = basis(n);
        if is_zero(n) {
            y[1..].fill(T::ZERO);
        }
        y
    }

    /// The same lighting in coefficients of the other kind, or as it is.
    #[must_use]
    pub fn to_kind(&self, kind: Kind) -> Self {
        let mut out = *self;
        out.kind = kind;
        for (row, degree) in out.coefficients.iter_mut().zip(DEGREE) {
            let a = T::of(COSINE_LOBE[degree]);
            match (self.kind, kind) {
                (Kind::Radiance, Kind::Irradiance) => *row = row.map(|l| l * a),
                (Kind::Irradiance, Kind::Radiance) => *row = row.map(|l| l / a),
                _ => {}
            }
        }
        out
    }

    /// Luminance of each coefficient, `0.2126 R + 0.7152 G + 0.0722 B`: what a shadow network sees.
    #[must_use]
    pub fn grey(&self) -> [T; COEFFICIENTS] {
        let [r, g, b] = [0.2126, 0.7152, 0.0722].map(T::of);
        self.coefficients.map(|row| r * row[0] + g * row[1] + b * row[2])
    }
}

#[inline(always)]
fn is_zero<T: Real>(n: [T; 3]) -> bool {
    n.iter().all(|&x| x == T::ZERO)
}

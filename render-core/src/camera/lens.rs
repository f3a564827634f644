//! Lens models.

use super::distortion::Distortion;

/// How a lens bends the ideal picture. Coefficients are those of OpenCV and COLMAP.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lens {
    /// Rational radial and tangential distortion of the tangent plane; a pinhole when all are zero.
    ///
    /// `k[0..3]` are `k1 k2 k3` of the numerator, `k[3..6]` are `k4 k5 k6` of the denominator: not the order of
    /// OpenCV's own vector, which is `k1 k2 p1 p2 k3 k4 k5 k6`.
    Perspective {
        /// `k1 k2 k3 | k4 k5 k6`.
        k: [f64; 6],
        /// `p1 p2`.
        p: [f64; 2],
    },
    /// `theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`. Sees beyond 90 degrees.
    Fisheye {
        /// `k1 k2 k3 k4`.
        k: [f64; 4],
    },
    /// `r_d = atan(2 r tan(omega / 2)) / omega`.
    Fov {
        /// Opening angle of the model, radians, in `(-pi, pi)`.
        omega: f64,
    },
    /// An equidistant fisheye followed by radial, tangential and thin-prism terms.
    ThinPrismFisheye {
        /// `k1 k2 k3 k4`.
        k: [f64; 4],
        /// `p1 p2`.
        p: [f64; 2],
        /// `sx1 sy1`.
        s: [f64; 2],
    },
}

impl Lens {
    /// No distortion at all.
    pub const PINHOLE: Self = Self::Perspective { k: [0.0; 6], p: [0.0; 2] };

    /// OpenCV's five coefficients, in OpenCV's order `k1 k2 p1 p2 k3`.
    #[must_use]
    pub const fn opencv5([k1, k2, p1, p2, k3]: [f64; 5]) -> Self {
        Self::Perspective { k: [k1, k2, k3, 0.0, 0.0, 0.0], p: [p1, p2] }
    }

    /// True when straight lines stay straight.
    #[must_use]
    pub fn is_pinhole(&self) -> bool {
        *self == Self::PINHOLE
    }

    /// Every coefficient with its name.
    pub fn parameters(&self) -> impl Iterator<Item = (&'static str, f64)> {
        const K: [&str; 6] = ["k1", "k2", "k3", "k4", "k5", "k6"];
        let mut out = [("", 0.0); 8];
        let mut n = 0;
        let mut push = |names: &[&'static str], values: &[f64]| {
            for (&name, &value) in names.iter().zip(values) {
                out[n] = (name, value);
                n += 1;
            }
        };
        match self {
            Self::Perspective { k, p } => {
                push(&K, k);
                push(&["p1", "p2"], p);
            }
            Self::Fisheye { k } => push(&K, k),
            Self::Fov { omega } => push(&["omega"], &[*omega]),
            Self::ThinPrismFisheye { k, p, s } => {
                push(&K, k);
                push(&["p1", "p2"], p);
                push(&["sx1", "sy1"], s);
            }
        }
        out.into_iter().take(n)
    }

    /// The polynomial map of the model, `None` for [`Lens::Fov`].
    pub(super) fn distortion(&self) -> Option<Distortion> {
        Some(match *self {
            Self::Perspective { k: [k1, k2, k3, k4, k5, k6], p } => {
                Distortion { num: [k1, k2, k3, 0.0], den: [k4, k5, k6], p, s: [0.0; 2] }
            }
            Self::Fisheye { k } => Distortion { num: k, den: [0.0; 3], p: [0.0; 2], s: [0.0; 2] },
            Self::ThinPrismFisheye { k, p, s } => Distortion { num: k, den: [0.0; 3], p, s },
            Self::Fov { .. } => return None,
        })
    }
}

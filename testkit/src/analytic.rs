//! Densities and colours along a ray whose pixel is known: what quadrature rules and samplers are measured against.
//!
//! A [`Field`] is a [`Density`], a polynomial colour for each channel, the part of the ray that is looked at and what is
//! behind it. [`Field::pixel`] is
//!
//! ```text
//! C = int(T(t) sigma(t) c(t), near..far) + T(far) background      T(t) = exp(-int(sigma, near..t))
//! ```
//!
//! to about `1e-13`: the optical depth of every density here is known in closed form, and so is the outer integral where the
//! density is constant in pieces; elsewhere it is a Gauss-Kronrod rule that halves its intervals until the estimate holds,
//! started at the places where the density jumps or is large.
//!
//! ```
//! use testkit::analytic::{Density, Field};
//!
//! let slab = Density::Slab { sigma: 2.0, from: 3.0, to: 4.5 };
//! let field = Field::new("slab", slab, [vec![1.0], vec![0.0], vec![0.0, 1.0]], [2.0, 6.0], [0.0; 3]);
//! let pixel = field.pixel();
//! let opacity = 1.0 - (-3.0_f64).exp();
//! assert!((pixel.colour[0] - opacity).abs() < 1e-14 && pixel.colour[1] == 0.0);
//! ```

mod integrate;
#[cfg(test)]
mod tests;

pub use integrate::integrate;

/// A density along a ray, 1 / world unit, `>= 0` where it is looked at.
#[derive(Clone, Debug, PartialEq)]
pub enum Density {
    /// The same everywhere.
    Constant {
        /// Its value.
        sigma: f64,
    },
    /// Linear in the distance. Must not be negative on the part of the ray that is looked at.
    Linear {
        /// Value at distance 0.
        at_zero: f64,
        /// Change for each unit of distance.
        slope: f64,
    },
    /// A Gaussian bump, smooth everywhere.
    Gaussian {
        /// Largest value.
        peak: f64,
        /// Where that is.
        mean: f64,
        /// Standard deviation.
        width: f64,
    },
    /// Fog that thins out, `sigma exp(-rate t)`.
    Fog {
        /// Value at distance 0.
        sigma: f64,
        /// Inverse of the distance over which it falls by `e`; not 0.
        rate: f64,
    },
    /// Constant between two distances, nothing elsewhere: it jumps.
    Slab {
        /// Value inside.
        sigma: f64,
        /// Where it begins.
        from: f64,
        /// Where it ends.
        to: f64,
    },
    /// Several on top of each other.
    Sum(Vec<Self>),
}

impl Density {
    /// Density at distance `t`.
    #[must_use]
    pub fn at(&self, t: f64) -> f64 {
        match *self {
            Self::Constant { sigma } => sigma,
            Self::Linear { at_zero, slope } => at_zero + slope * t,
            Self::Gaussian { peak, mean, width } => {
                let x = (t - mean) / width;
                peak * (-0.5 * x * x).exp()
            }
            Self::Fog { sigma, rate } => sigma * (-rate * t).exp(),
            Self::Slab { sigma, from, to } => {
                if (from..to).contains(&t) {
                    sigma
                } else {
                    0.0
                }
            }
            Self::Sum(ref parts) => parts.iter().map(|part| part.at(t)).sum(),
        }
    }

    /// Optical depth between two distances, in closed form.
    #[must_use]
    pub fn depth(&self, from: f64, to: f64) -> f64 {
        match *self {
            Self::Constant { sigma } => sigma * (to - from),
            Self::Linear { at_zero, slope } => (at_zero + 0.5 * slope * (from + to)) * (to - from),
            Self::Gaussian { peak, mean, width } => {
                let x = |t: f64| (t - mean) / (width * std::f64::consts::SQRT_2);
                let (a, b) = (x(from), x(to));
                // On one side of the bump the difference of two complements keeps its digits.
                let share = if a > 0.0 {
                    libm::erfc(a) - libm::erfc(b)
                } else if b < 0.0 {
                    libm::erfc(-b) - libm::erfc(-a)
                } else {
                    libm::erf(b) - libm::erf(a)
                };
                peak * width * (0.5 * std::f64::consts::PI).sqrt() * share
            }
            Self::Fog { sigma, rate } => -sigma / rate * (-rate * from).exp() * (-rate * (to - from)).exp_m1(),
            Self::Slab { sigma, from: start, to: end } => sigma * (to.min(end) - from.max(start)).max(0.0),
            Self::Sum(ref parts) => parts.iter().map(|part| part.depth(from, to)).sum(),
        }
    }

    /// Where an integral over it should be cut: jumps, and the feet of bumps.
    #[must_use]
    pub fn breaks(&self) -> Vec<f64> {
        match *self {
            Self::Constant { .. } | Self::Linear { .. } | Self::Fog { .. } => vec![],
            Self::Gaussian { mean, width, .. } => [-6.0, -3.0, 0.0, 3.0, 6.0].map(|k| mean + k * width).to_vec(),
            Self::Slab { from, to, .. } => vec![from, to],
            Self::Sum(ref parts) => parts.iter().flat_map(Self::breaks).collect(),
        }
    }

    /// Whether it has no jumps: rules then show their full order.
    #[must_use]
    pub fn is_smooth(&self) -> bool {
        match self {
            Self::Slab { .. } => false,
            Self::Sum(parts) => parts.iter().all(Self::is_smooth),
            _ => true,
        }
    }

    /// Whether it is constant between its breaks.
    fn is_step(&self) -> bool {
        match self {
            Self::Constant { .. } | Self::Slab { .. } => true,
            Self::Sum(parts) => parts.iter().all(Self::is_step),
            _ => false,
        }
    }
}

/// What a ray sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// With the background.
    pub colour: [f64; 3],
    /// Transmittance to the background.
    pub trans_end: f64,
}

/// A density and a colour along a ray. See the [module](self).
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// For tables and file names: no spaces.
    pub name: &'static str,
    /// What absorbs and shines.
    pub density: Density,
    /// Coefficients of each channel's polynomial in the distance, the constant first.
    pub colour: [Vec<f64>; 3],
    /// `near`, `far`.
    pub span: [f64; 2],
    /// Colour behind `far`.
    pub background: [f64; 3],
}

impl Field {
    /// All of its parts.
    #[must_use]
    pub fn new(
        name: &'static str,
        density: Density,
        colour: [Vec<f64>; 3],
        span: [f64; 2],
        background: [f64; 3],
    ) -> Self {
        Self { name, density, colour, span, background }
    }

    /// The fields that rules are compared on, seen from 2 to 6 in front of a grey background, with colours that change along
    /// the ray: `constant`, `linear`, `fog`, `gaussian` and `bumps` are smooth, `surface` is a thin, dense bump, `slab` and
    /// `steps` jump, at distances that no binary fraction meets.
    #[must_use]
    pub fn all() -> Vec<Self> {
        let colour = || [vec![0.2, 0.1], vec![1.0, -0.3, 0.03], vec![0.1, 0.2, -0.05, 0.004]];
        let bump = |peak, mean, width| Density::Gaussian { peak, mean, width };
        let slab = |sigma, from, to| Density::Slab { sigma, from, to };
        [
            ("constant", Density::Constant { sigma: 0.7 }),
            ("linear", Density::Linear { at_zero: -0.8, slope: 0.5 }),
            ("fog", Density::Fog { sigma: 6.0, rate: 0.9 }),
            ("gaussian", bump(2.5, 3.9, 0.4)),
            ("bumps", Density::Sum(vec![bump(1.2, 2.8, 0.3), bump(3.0, 4.1, 0.25), bump(5.0, 5.2, 0.2)])),
            ("surface", bump(150.0, 4.123, 0.04)),
            ("slab", slab(2.0, 3.137, 4.519)),
            ("steps", Density::Sum(vec![slab(0.8, 2.313, 3.709), slab(40.0, 4.211, 4.287)])),
        ]
        .map(|(name, density)| Self::new(name, density, colour(), [2.0, 6.0], [0.5; 3]))
        .to_vec()
    }

    /// Colour at distance `t`, by Horner's rule.
    #[must_use]
    pub fn colour_at(&self, t: f64) -> [f64; 3] {
        std::array::from_fn(|c| horner(&self.colour[c], t))
    }

    /// What the whole of its part of the ray looks like.
    #[must_use]
    pub fn pixel(&self) -> Pixel {
        self.pixel_between(self.span)
    }

    /// What another part of the ray looks like.
    #[must_use]
    pub fn pixel_between(&self, [near, far]: [f64; 2]) -> Pixel {
        let trans_end = (-self.density.depth(near, far)).exp();
        let mut edges = vec![near];
        let mut breaks = self.density.breaks();
        breaks.retain(|t| near < *t && *t < far);
        breaks.sort_by(f64::total_cmp);
        edges.extend(breaks);
        edges.push(far);
        let mut colour = self.background.map(|b| trans_end * b);
        for ends in edges.windows(2) {
            let (from, to) = (ends[0], ends[1]);
            let middle = self.density.at(0.5 * (from + to));
            // The closed form divides by the optical depth, once for each degree.
            let closed = self.density.is_step() && middle * (to - from) > 0.05;
            let trans = (-self.density.depth(near, from)).exp();
            for (c, out) in colour.iter_mut().enumerate() {
                *out += if closed {
                    trans * constant_density(&self.colour[c], middle, from, to)
                } else {
                    integrate(from, to, 1e-14, |t| {
                        let sigma = self.density.at(t.min(to.next_down()));
                        (-self.density.depth(near, t)).exp() * sigma * horner(&self.colour[c], t)
                    })
                };
            }
        }
        Pixel { colour, trans_end }
    }
}

/// `int(sigma exp(-sigma (t - from)) p(t), from..to)`: integrating by parts until nothing is left of the polynomial.
fn constant_density(p: &[f64], sigma: f64, from: f64, to: f64) -> f64 {
    let trans = (-sigma * (to - from)).exp();
    let (mut p, mut scale, mut sum) = (p.to_vec(), 1.0, 0.0);
    while !p.is_empty() {
        sum += scale * (horner(&p, from) - trans * horner(&p, to));
        scale /= sigma;
        p = p.iter().enumerate().skip(1).map(|(k, c)| k as f64 * c).collect();
    }
    sum
}

fn horner(p: &[f64], t: f64) -> f64 {
    p.iter().rev().fold(0.0, |sum, c| sum * t + c)
}

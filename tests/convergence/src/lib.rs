//! Error of quadrature rules and samplers against their number of samples, on fields whose pixel is known.
//!
//! Every row is one [`Method`] with one [`Sampler`] and about one number of samples on one [`Field`], rendered by
//! `render-core` in `f32` along a batch of rays, each of which sees another part of the field: near and far ends move by a
//! step of the coarsest sampling, so that no rule is lucky with where its samples meet a jump.
//!
//! ```
//! use testkit::analytic::Field;
//! use convergence::{Method, Sampler, Study, order};
//!
//! let study = Study { rays: 16, ..Study::default() };
//! let field = &Field::all()[3];
//! let rows: Vec<_> = [16, 32, 64].map(|n| study.measure(field, Method::Trapezoid, Sampler::Uniform, n)).to_vec();
//! assert!((1.7..2.4).contains(&order(&rows)), "{rows:?}");
//! ```

#![forbid(unsafe_code)]

mod method;
mod sampler;
mod study;

pub use method::Method;
pub use sampler::Sampler;
pub use study::Study;

use render_core::quadrature::{Composite, LastInterval, Points, Rule, Samples, Values, composite, intervals};
use sampler::Rays;
use std::time::Instant;
use study::uniform;
use testkit::analytic::Field;

/// One measurement.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// [`Method::name`]
    pub rule: &'static str,
    /// [`Sampler::name`]
    pub sampler: &'static str,
    /// [`Field::name`]
    pub density: &'static str,
    /// Mean number of times that a ray asked the field, in all passes.
    pub samples: f64,
    /// Root mean square over rays and channels of the pixel's error.
    pub error: f64,
    /// The largest.
    pub worst: f64,
    /// Mean over rays and channels, with its sign: what random sampling does not average out.
    pub bias: f64,
    /// Time for each ray to place samples, apply the rule and composite: without the field, which in a system costs a
    /// thousand times more and here next to nothing. Median of [`Study::repeats`].
    pub seconds: f64,
}

/// What each ray of a study sees.
struct Truth {
    /// Near and far ends.
    spans: Vec<[f32; 2]>,
    /// `[rays][3]`
    colour: Vec<f64>,
}

impl Study {
    /// Every method with every sampler on every field of [`Field::all`], at 8 to `most` samples by factors of two.
    #[must_use]
    pub fn rows(&self, most: usize) -> Vec<Row> {
        let mut rows = vec![];
        for field in Field::all() {
            let truth = self.truth(&field);
            for sampler in Sampler::ALL {
                for method in Method::ALL {
                    let mut n = 8;
                    while n <= most {
                        rows.push(self.compare(&field, &truth, method, sampler, n));
                        n *= 2;
                    }
                }
            }
        }
        rows
    }

    /// One row, with about `n` samples a ray.
    ///
    /// # Panics
    /// When `n` is less than 6: too few for a coarse and a fine pass; or there are no rays.
    #[must_use]
    pub fn measure(&self, field: &Field, method: Method, sampler: Sampler, n: usize) -> Row {
        self.compare(field, &self.truth(field), method, sampler, n)
    }

    fn compare(&self, field: &Field, truth: &Truth, method: Method, sampler: Sampler, n: usize) -> Row {
        assert!(n >= 6 && self.rays > 0, "at least 6 samples and a ray");
        let spans = &truth.spans;
        let mut times = vec![];
        let (mut colour, mut asked) = (vec![], 0);
        for _ in 0..self.repeats.max(1) {
            let mut seconds = 0.0;
            let rays = sampler.place(self, field, spans, method, n, &mut seconds);
            asked = rays.asked;
            colour = self.render(field, &rays, method.rule(), &mut seconds);
            times.push(seconds / self.rays as f64);
        }
        times.sort_by(f64::total_cmp);
        let (mut square, mut worst, mut sum) = (0.0, 0.0_f64, 0.0);
        for (got, want) in colour.iter().zip(&truth.colour) {
            let error = f64::from(*got) - want;
            square += error * error;
            sum += error;
            worst = worst.max(error.abs());
        }
        let values = (3 * self.rays) as f64;
        Row {
            rule: method.name(),
            sampler: sampler.name(),
            density: field.name,
            samples: asked as f64 / self.rays as f64,
            error: (square / values).sqrt(),
            worst,
            bias: sum / values,
            seconds: times[times.len() / 2],
        }
    }

    /// The part of the field that each ray sees: both ends moved inwards, by up to a sixteenth of the whole.
    fn truth(&self, field: &Field) -> Truth {
        let [near, far] = field.span;
        let move_by = (far - near) / 16.0;
        let span = |r: usize| {
            let [u, v] = [0, 1].map(|k| f64::from(uniform(self.seed, (2 * r + k) as u64)));
            [(near + u * move_by) as f32, (far - v * move_by) as f32]
        };
        let spans: Vec<[f32; 2]> = (0..self.rays).map(span).collect();
        let colour = spans.iter().flat_map(|span| field.pixel_between(span.map(f64::from)).colour).collect();
        Truth { spans, colour }
    }

    /// Apply the rule and composite: `[rays][3]`.
    fn render(&self, field: &Field, rays: &Rays, rule: Rule, seconds: &mut f64) -> Vec<f32> {
        let n = rays.t.len();
        let sigma: Vec<f32> = rays.t.iter().map(|&t| field.density.at(t.into()) as f32).collect();
        let mut rgb = vec![0.0; 3 * n];
        for (i, &t) in rays.t.iter().enumerate() {
            for (c, v) in field.colour_at(t.into()).into_iter().enumerate() {
                rgb[c * n + i] = v as f32;
            }
        }
        let background: Vec<f32> = (0..3 * self.rays).map(|k| field.background[k % 3] as f32).collect();
        let (mut tau, mut values, mut w) = (vec![0.0; n], vec![0.0; 3 * n], vec![0.0; n]);
        let (mut colour, mut opacity, mut end) = (vec![0.0; 3 * self.rays], vec![0.0; self.rays], vec![0.0; self.rays]);
        let start = Instant::now();
        let values_in = Values { data: &rgb, stride: n, channels: 3 };
        let points = Points { offsets: &rays.offsets, dt: &rays.dt, sigma: &sigma, values: values_in };
        intervals(self.simd, rule, points, &mut tau, &mut values);
        let samples = Samples { offsets: &rays.offsets, tau: &tau, last: LastInterval::Finite };
        let out = Composite { colour: &mut colour, opacity: &mut opacity, w: &mut w, trans_end: &mut end };
        composite(self.simd, samples, Values { data: &values, stride: n, channels: 3 }, &background, out);
        *seconds += start.elapsed().as_secs_f64();
        colour
    }
}

/// Order of convergence: minus the slope of `log error` over `log samples`, by least squares.
///
/// Rows without an error, or below `3e-7` where `f32` ends, do not count; fewer than two give NaN.
#[must_use]
pub fn order(rows: &[Row]) -> f64 {
    let points: Vec<(f64, f64)> =
        rows.iter().filter(|r| r.error > 3e-7).map(|r| (r.samples.ln(), r.error.ln())).collect();
    let n = points.len() as f64;
    let mean = points.iter().fold((0.0, 0.0), |m, p| (m.0 + p.0 / n, m.1 + p.1 / n));
    let (xy, xx) =
        points.iter().fold((0.0, 0.0), |s, p| (s.0 + (p.0 - mean.0) * (p.1 - mean.1), s.1 + (p.0 - mean.0).powi(2)));
    -xy / xx
}

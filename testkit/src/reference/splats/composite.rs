//! Ellipses to pixels and back.

use super::ellipse::{Ellipse, Rules};

/// Values of a pixel: colour, depth, transmittance.
const PLANES: usize = 5;

/// One pixel.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Colour, depth, transmittance.
    pub values: [f64; PLANES],
    /// How far the nearest decision was from falling otherwise, in units of the numbers it was made of.
    pub margin: f64,
    /// The least relative distance in depth of two contributions that follow on each other.
    pub order: f64,
    /// What a relative error of 1 of all those numbers would do to the values.
    pub slack: f64,
    /// Ellipses that are in it.
    pub count: usize,
}

/// Gradient with respect to one ellipse.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EllipseBar {
    /// Of the centre.
    pub uv: [f64; 2],
    /// Of the conic `a, b, c`; `b` stands in it twice.
    pub conic: [f64; 3],
    /// Of the opacity.
    pub opacity: f64,
    /// Of the colour.
    pub rgb: [f64; 3],
    /// Of the depth, where it is composited.
    pub z: f64,
}

impl EllipseBar {
    /// Add another.
    pub fn add(&mut self, more: &Self) {
        let pairs = self.uv.iter_mut().zip(more.uv).chain(self.conic.iter_mut().zip(more.conic));
        pairs.chain(self.rgb.iter_mut().zip(more.rgb)).for_each(|(sum, x)| *sum += x);
        self.opacity += more.opacity;
        self.z += more.z;
    }

    /// Inner product with the difference of two ellipses.
    pub(super) fn along(&self, more: &Ellipse, less: &Ellipse) -> f64 {
        let sum = |bar: &[f64], a: &[f64], b: &[f64]| {
            bar.iter().zip(a.iter().zip(b)).map(|(bar, (a, b))| bar * (a - b)).sum::<f64>()
        };
        sum(&self.uv, &more.uv, &less.uv)
            + sum(&self.conic, &more.conic, &less.conic)
            + sum(&self.rgb, &more.rgb, &less.rgb)
            + self.opacity * (more.opacity - less.opacity)
            + self.z * (more.z - less.z)
    }
}

/// An ellipse at a pixel.
struct Cover {
    /// Pixel to centre.
    d: [f64; 2],
    q: f64,
    /// Error bound of `q`, relative to its terms.
    sure: f64,
}

fn cover(e: &Ellipse, [x, y]: [usize; 2]) -> Cover {
    let d = [e.uv[0] - (x as f64 + 0.5), e.uv[1] - (y as f64 + 0.5)];
    let terms = [e.conic[0] * d[0] * d[0], 2.0 * e.conic[1] * d[0] * d[1], e.conic[2] * d[1] * d[1]];
    Cover { d, q: terms.iter().sum::<f64>().max(0.0), sure: 1.0 + terms.iter().map(|t| t.abs()).sum::<f64>() }
}

/// Composite ellipses that are in order over pixel `at` (column, row).
#[must_use]
pub fn pixel(ellipses: &[Ellipse], at: [usize; 2], rules: &Rules) -> Pixel {
    let mut out = Pixel { values: [0.0; PLANES], margin: f64::INFINITY, order: f64::INFINITY, slack: 0.0, count: 0 };
    let mut t = 1.0;
    // Relative error bound of the transmittance.
    let mut loose = 1.0;
    let mut before = None;
    for e in ellipses {
        let Cover { q, sure, .. } = cover(e, at);
        let mut decide = |by: f64| out.margin = out.margin.min(by.abs());
        decide((q - e.q_max) / sure);
        if q >= e.q_max {
            continue;
        }
        let full = e.opacity * (-0.5 * q).exp();
        decide((full / rules.alpha_max - 1.0) / sure);
        let alpha = full.min(rules.alpha_max);
        let next = t * (1.0 - alpha);
        loose += sure * alpha / (1.0 - alpha);
        decide((next / rules.stop - 1.0) / loose);
        out.order = out.order.min(before.map_or(f64::INFINITY, |z| (e.z - z) / e.z));
        before = Some(e.z);
        if next <= rules.stop {
            break;
        }
        let values = [e.rgb[0], e.rgb[1], e.rgb[2], e.z];
        for (sum, c) in out.values.iter_mut().zip(values) {
            *sum += alpha * t * c;
        }
        out.slack += alpha * t * (sure + loose) * values.into_iter().fold(1.0, f64::max);
        out.count += 1;
        t = next;
    }
    out.slack += t * loose;
    out.values[PLANES - 1] = t;
    out
}

/// Add the gradient of `<bar, values>` of a pixel to `bars`, one for each ellipse in the order given.
///
/// ```text
/// w = alpha T,   alpha_bar = T <c, bar> - (sum behind of w <c, bar> + T_end bar_T) / (1 - alpha)
/// ```
///
/// # Panics
/// Where there are fewer `bars` than ellipses.
pub fn pixel_backward(
    ellipses: &[Ellipse],
    at: [usize; 2],
    rules: &Rules,
    bar: [f64; PLANES],
    bars: &mut [EllipseBar],
) {
    let mut t = 1.0;
    let mut drawn = Vec::new();
    for (i, e) in ellipses.iter().enumerate() {
        let cover = cover(e, at);
        if cover.q >= e.q_max {
            continue;
        }
        let full = e.opacity * (-0.5 * cover.q).exp();
        let alpha = full.min(rules.alpha_max);
        if t * (1.0 - alpha) <= rules.stop {
            break;
        }
        drawn.push((i, cover, full, alpha, t));
        t *= 1.0 - alpha;
    }
    let mut behind = t * bar[PLANES - 1];
    for (i, Cover { d, .. }, full, alpha, t) in drawn.into_iter().rev() {
        let (e, out) = (&ellipses[i], &mut bars[i]);
        let w = alpha * t;
        for (sum, bar) in out.rgb.iter_mut().zip(bar) {
            *sum += w * bar;
        }
        out.z += w * bar[3];
        let along = e.rgb.iter().zip(bar).map(|(c, bar)| c * bar).sum::<f64>() + e.z * bar[3];
        let alpha_bar = t * along - behind / (1.0 - alpha);
        behind += w * along;
        if full >= rules.alpha_max {
            continue;
        }
        out.opacity += alpha_bar * full / e.opacity;
        let q_bar = -0.5 * alpha * alpha_bar;
        let [a, b, c] = e.conic;
        out.conic[0] += q_bar * d[0] * d[0];
        out.conic[1] += q_bar * 2.0 * d[0] * d[1];
        out.conic[2] += q_bar * d[1] * d[1];
        out.uv[0] += q_bar * 2.0 * (a * d[0] + b * d[1]);
        out.uv[1] += q_bar * 2.0 * (b * d[0] + c * d[1]);
    }
}

/// A picture.
#[derive(Clone, Debug)]
pub struct Picture {
    /// `[5][rows][columns]`: colour, depth, transmittance.
    pub planes: Vec<f64>,
    /// `[rows][columns]`, see [`Pixel::margin`].
    pub margins: Vec<f64>,
    /// `[rows][columns]`, see [`Pixel::slack`].
    pub slack: Vec<f64>,
}

/// Margins of decisions that rounding may turn; what an `f32` of a few operations is off by.
const UNCLEAR: f64 = 3e-6;
const ROUNDING: f64 = 2e-7;

impl Picture {
    /// The nearest of all decisions.
    #[must_use]
    pub fn margin(&self) -> f64 {
        self.margins.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Largest difference of a pixel whose decisions are clear, in units of its bound; and the share of those that are not.
    ///
    /// # Panics
    /// If `got` is shorter than the planes.
    #[must_use]
    pub fn worst(&self, got: &[f32]) -> (f64, f64) {
        let pixels = self.margins.len();
        let (mut worst, mut unclear) = (0.0_f64, 0);
        for i in 0..pixels {
            if self.margins[i] < UNCLEAR {
                unclear += 1;
                continue;
            }
            for k in 0..PLANES {
                let (got, want) = (f64::from(got[k * pixels + i]), self.planes[k * pixels + i]);
                let error = (got - want).abs() / (2e-6 * (1.0 + want.abs()) + ROUNDING * self.slack[i]);
                worst = if error <= worst { worst } else { error };
            }
        }
        (worst, f64::from(unclear) / pixels as f64)
    }
}

/// Composite ellipses that are in order over a picture of `size` (columns, rows).
#[must_use]
pub fn draw(ellipses: &[Ellipse], [w, h]: [usize; 2], rules: &Rules) -> Picture {
    let mut out = Picture { planes: vec![0.0; PLANES * w * h], margins: vec![0.0; w * h], slack: vec![0.0; w * h] };
    for i in 0..w * h {
        let got = pixel(ellipses, [i % w, i / w], rules);
        (out.margins[i], out.slack[i]) = (got.margin, got.slack);
        for (k, v) in got.values.into_iter().enumerate() {
            out.planes[k * w * h + i] = v;
        }
    }
    out
}

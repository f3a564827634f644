//! What renders of the moving part cost: their errors, and weight that is spread along a ray. Letters are those of `flow_terms`.
//!
//! Source: Li et al., "Neural scene flow fields", 2021, section 3.2 and released code; Gao et al., "Dynamic view synthesis from dynamic
//! monocular video", 2021, released code.

use crate::rays::{BEYOND, FlowRays, FlowTerm, HERE, NEXT, PASSES, SeenBars};
use losses::entropy;

/// Errors of the moving part's renders.
#[derive(Debug)]
pub(super) struct Renders {
    pub(super) factor: f64,
    /// Whether they count by the moving part's share of the ray, once the factors of priors have fallen for the first time.
    pub(super) by_share: bool,
}

impl FlowTerm for Renders {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let (rays, [_, m]) = (seen.rays, seen.rays.samples());
        let by_share = self.by_share && seen.fade < 1.0;
        for (pass, other) in seen.seen.iter().enumerate() {
            // Two frames on or back are believed as the frame on the way there is.
            let way = if pass == BEYOND { seen.chained.unwrap_or(NEXT) } else { pass };
            let hidden = if way == NEXT { 0 } else { m };
            let of_hidden = (pass != HERE && !seen.seen[HERE].hidden.is_empty()).then_some(hidden);
            for r in (0..other.known.len()).filter(|&r| other.known[r]) {
                let rendered = &other.colour[3 * r..3 * r + 3];
                let e = [0, 1, 2].map(|c| f64::from(rendered[c]) - f64::from(rays.truth[r][c]));
                let error = e.iter().map(|e| e * e).sum::<f64>() / 3.0;
                // The share is held: else the moving part would leave what it shows wrongly.
                let counts = if by_share { f64::from(seen.seen[HERE].moving_share[r]) } else { 1.0 };
                let factor = self.factor * f64::from(rays.factor[r]) * counts;
                let mut trust = 1.0;
                if let Some(first) = of_hidden {
                    trust = rays.span(r).map(|i| f64::from(other.w[i])).sum();
                    for k in rays.movers(r) {
                        let w = f64::from(other.w[rays.at[k] as usize]);
                        trust -= w * f64::from(seen.seen[HERE].hidden[first + k]);
                        bars[HERE].hidden[first + k] -= (f64::from(seen.share) * factor * error * w) as f32;
                    }
                }
                *loss += factor * trust * error;
                let bar = f64::from(seen.share) * factor * trust * 2.0 / 3.0;
                for (c, e) in e.into_iter().enumerate() {
                    bars[pass].colour[3 * r + c] += (bar * e) as f32;
                }
            }
        }
    }
}

/// Weight that is spread along a ray.
#[derive(Debug)]
pub(super) struct Entropy {
    pub(super) factor: f64,
}

impl FlowTerm for Entropy {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let (rays, w) = (seen.rays, &seen.seen[HERE].w);
        for r in 0..rays.len() {
            let factor = self.factor * f64::from(rays.factor[r]);
            *loss += factor * entropy::weights(&w[rays.span(r)]);
            let (factor, bar) = (factor * f64::from(seen.share), &mut bars[HERE].w[rays.span(r)]);
            entropy::weights_backward(&w[rays.span(r)], factor, bar).expect("as many gradients as weights");
        }
    }
}

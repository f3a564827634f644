//! What masks of motion say of the moving part: where nothing moves it is no other than the still part. Letters are those of
//! `flow_terms`.
//!
//! Source: Gao et al., "Dynamic view synthesis from dynamic monocular video", 2021, section 3.3 and released code.

use crate::rays::{FlowRays, FlowTerm, HERE, PASSES, SeenBars};
use losses::kernel::Kernel;

/// What a mask says of the pixel of ray `r`; `None` where there is none.
fn moves(seen: &FlowRays<'_>, r: usize) -> Option<bool> {
    seen.film.moves(seen.rays.frames[r].view, seen.rays.place[r])
}

/// Whether a mask says that nothing moves in the pixel of ray `r`.
fn rests(seen: &FlowRays<'_>, r: usize) -> bool {
    moves(seen, r) == Some(false)
}

/// What moves is where the still part is, in pixels in which nothing moves.
#[derive(Debug)]
pub(super) struct Order {
    pub(super) factor: f64,
}

impl FlowTerm for Order {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        let (rays, w) = (seen.rays, &seen.seen[HERE].w);
        for r in (0..rays.len()).filter(|&r| rests(seen, r)) {
            let (mut ours, mut still, mut depth) = (0.0, 0.0, 0.0_f64);
            for i in rays.span(r) {
                let (q, tau) = (f64::from(rays.disparity[i]), f64::from(rays.still[i]));
                ours += f64::from(w[i]) * q;
                still += (-depth).exp() * -(-tau).exp_m1() * q;
                depth += tau;
            }
            let factor = self.factor * f64::from(rays.factor[r]);
            *loss += factor * (ours - still) * (ours - still);
            let bar = 2.0 * f64::from(seen.share) * factor * (ours - still);
            for i in rays.span(r) {
                bars[HERE].w[i] += (bar * f64::from(rays.disparity[i])) as f32;
            }
        }
    }
}

/// The moving part is not used where nothing moves.
#[derive(Debug)]
pub(super) struct Still {
    pub(super) factor: f64,
}

impl FlowTerm for Still {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        if seen.fade < 1.0 {
            return;
        }
        let factor = self.factor * seen.per_sample;
        for k in (0..seen.rays.len()).filter(|&r| rests(seen, r)).flat_map(|r| seen.rays.movers(r)) {
            *loss += factor * f64::from(seen.seen[HERE].blend[k]);
            bars[HERE].blend[k] += (f64::from(seen.share) * factor) as f32;
        }
    }
}

/// The moving part's share of a ray is what the mask says.
#[derive(Debug)]
pub(super) struct Mask {
    pub(super) factor: f64,
}

impl FlowTerm for Mask {
    fn add(&self, seen: &FlowRays<'_>, bars: &mut [SeenBars; PASSES], loss: &mut f64) {
        if seen.fade < 1.0 {
            return;
        }
        for r in 0..seen.rays.len() {
            let Some(moves) = moves(seen, r) else { continue };
            let (share, said) = (seen.seen[HERE].moving_share[r], f32::from(u8::from(moves)));
            let factor = self.factor * f64::from(seen.rays.factor[r]);
            *loss += factor * f64::from(Kernel::L1.value(share, said));
            let derivative = f64::from(Kernel::L1.derivative(share, said));
            bars[HERE].moving_share[r] += (f64::from(seen.share) * factor * derivative) as f32;
        }
    }
}

//! Both parts of a field at the points where something moves, forwards and backwards.
//!
//! ```text
//! r_m = r_s + delta_r, g_m = g_s + delta_g        a moving part on top of the still one: its network gives delta (else r_m, g_m)
//! ```

use super::blend::{Parts, blend, blend_backward};
use super::moving_part::MovingPart;
use super::moving_points::MovingColumns;
use crate::buffers::sized;
use float_core::Simd;

/// Points at which something moves, mixed of both parts.
#[derive(Default)]
pub(crate) struct Mixed {
    acts: Vec<f32>,
    /// `[outputs][m]` of the still part alone, and of the mixture.
    still: Vec<f32>,
    out: Vec<f32>,
    /// `[outputs + 1 + more][m]` of the moving part: its gate, and what it knows besides, come last.
    moving: Vec<f32>,
    /// `[m]`, the moving part's share.
    share: Vec<f32>,
    share_bar: Vec<f32>,
    still_bar: Vec<f32>,
    moving_bar: Vec<f32>,
    scratch: Vec<f32>,
}

impl Mixed {
    /// Mix the moving part into `raw` `[outputs][n]`, which holds what the still part's network gave.
    pub(crate) fn infer(&mut self, simd: Simd, part: &MovingPart, of: MovingColumns<'_>, raw: &mut [f32]) {
        let (m, mlp) = (of.len(), &part.network);
        if m == 0 {
            return;
        }
        let scratch = sized(&mut self.scratch, mlp.infer_scratch_len());
        let moving = sized(&mut self.moving, mlp.outputs() * m);
        mlp.infer(simd, &part.packed, &of.features[of.first..], of.stride, m, moving, m, scratch);
        self.mix(part, of, raw);
    }

    /// The same, for [`Mixed::backward`].
    pub(crate) fn forward(&mut self, simd: Simd, part: &MovingPart, of: MovingColumns<'_>, raw: &mut [f32]) {
        let (m, mlp) = (of.len(), &part.network);
        if m == 0 {
            return;
        }
        let acts = sized(&mut self.acts, mlp.activations_len(m));
        let moving = sized(&mut self.moving, mlp.outputs() * m);
        mlp.forward(simd, &part.packed, &of.features[of.first..], of.stride, m, moving, m, acts);
        self.mix(part, of, raw);
    }

    fn mix(&mut self, part: &MovingPart, of: MovingColumns<'_>, raw: &mut [f32]) {
        let (m, rows) = (of.len(), part.still_rows());
        let n = raw.len() / rows;
        let still = sized(&mut self.still, rows * m);
        of.gather(raw, n, still);
        if part.on_top {
            self.moving.iter_mut().zip(still.iter()).for_each(|(moving, still)| *moving += still);
        }
        let (out, share) = (sized(&mut self.out, rows * m), sized(&mut self.share, m));
        blend(Parts { still, moving: &self.moving[..(rows + 1) * m], n: m }, out, share);
        of.scatter(out, raw, n);
    }

    /// The moving part's share of each of the points of the last pass, written over `out` `[n]`, which is 0 elsewhere.
    pub(crate) fn shares(&self, of: MovingColumns<'_>, out: &mut [f32]) {
        out.fill(0.0);
        of.at().zip(&self.share).for_each(|(i, share)| out[i] = *share);
    }

    /// What the moving part's network gave after its gate at the points of the last pass, `[more][m]`.
    pub(crate) fn after_gate(&self, part: &MovingPart, of: MovingColumns<'_>) -> &[f32] {
        &self.moving[(part.still_rows() + 1) * of.len()..part.network.outputs() * of.len()]
    }

    /// Each of the points of the last pass, with the raw log-density of the still part alone there.
    pub(crate) fn each_still(&self, of: MovingColumns<'_>, mut each: impl FnMut(usize, f32)) {
        of.at().zip(&self.still).for_each(|(i, still)| each(i, *still));
    }

    /// Bring the gradients `raw_bar` `[outputs][n]` of the mixture, and those of the shares, `[n]`, back: `raw_bar` becomes that of the
    /// still part; that of the moving part's features is written over theirs in `features_bar` `[rows][stride]`, that of its network
    /// added to `grad`.
    #[expect(clippy::too_many_arguments, reason = "both parts, and where the gradients of each go")]
    pub(crate) fn backward(
        &mut self,
        simd: Simd,
        part: &MovingPart,
        of: MovingColumns<'_>,
        raw_bar: &mut [f32],
        n: usize,
        share_bar: Option<&[f32]>,
        features_bar: &mut [f32],
        grad: &mut [f32],
    ) {
        let (m, mlp) = (of.len(), &part.network);
        if m == 0 {
            return;
        }
        let rows = part.still_rows();
        let out_bar = sized(&mut self.out, rows * m);
        of.gather(&raw_bar[..rows * n], n, out_bar);
        let bars = sized(&mut self.share_bar, m);
        match share_bar {
            Some(share_bar) => of.gather(&share_bar[..n], n, bars),
            None => bars.fill(0.0),
        }
        let (still_bar, moving_bar) =
            (sized(&mut self.still_bar, rows * m), sized(&mut self.moving_bar, mlp.outputs() * m));
        let parts = Parts { still: &self.still[..rows * m], moving: &self.moving[..(rows + 1) * m], n: m };
        moving_bar[(rows + 1) * m..].fill(0.0);
        blend_backward(parts, &self.share[..m], out_bar, bars, still_bar, moving_bar);
        if part.on_top {
            still_bar.iter_mut().zip(&*moving_bar).for_each(|(still, moving)| *still += moving);
        }
        of.scatter(still_bar, &mut raw_bar[..rows * n], n);
        let scratch = sized(&mut self.scratch, mlp.backward_scratch_len());
        let x_bar = Some((&mut features_bar[of.first..], of.stride));
        mlp.backward(simd, &part.packed, &self.acts, moving_bar, m, m, x_bar, grad, scratch);
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        let floats = [&self.acts, &self.still, &self.out, &self.moving, &self.still_bar, &self.moving_bar];
        let floats = floats.into_iter().chain([&self.share, &self.share_bar, &self.scratch]);
        4 * floats.map(|b| b.capacity()).sum::<usize>()
    }
}

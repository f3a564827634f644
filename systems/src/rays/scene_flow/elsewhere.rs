//! A pass: the moving part alone at the moving samples of some rays, where these are in a frame, and back.

use super::both_parts::{BothParts, MovingMatter};
use super::chosen::Chosen;
use super::head::FlowHead;
use super::rendered::Rendered;
use super::term::{Seen, SeenBars};
use crate::buffers::sized;
use crate::fields::{Columns, Detail, Field, MovingPart, Part, Places, Placing, When};
use crate::warps::{DeformGrad, DeformScratch, Points};
use float_core::Simd;
use float_core::m32::logistic;

/// What colours depend on besides places: `[rows][rays]` of a whole chunk.
#[derive(Clone, Copy)]
pub(super) struct Basis<'a> {
    pub(super) rows: &'a [f32],
    /// Rays of the chunk.
    pub(super) rays: usize,
}

/// Where the gradients of a pass go, besides those of its features.
pub(super) struct PassGradients<'a> {
    /// Packed gradients of the moving part's network and of that of colours, added to.
    pub(super) network: &'a mut [f32],
    pub(super) colour: &'a mut [f32],
    pub(super) deform: &'a mut DeformGrad,
    pub(super) room: &'a mut DeformScratch,
}

/// A pass, and its buffers.
#[derive(Default)]
pub(super) struct Pass {
    pub(super) seen: Seen,
    /// `[3][m]`, whether a coordinate was held in the unit cube: 0 where it was, else 1.
    free: Vec<f32>,
    /// `[3][m]`, canonical places.
    x: Vec<f32>,
    /// `[m]`, views whose time it is, and times; the latter only where the features know them.
    which: Vec<u32>,
    times: Vec<f32>,
    /// `[rows][m]`
    features: Vec<f32>,
    placing: Placing,
    acts: Vec<f32>,
    /// `[outputs][m]`
    out: Vec<f32>,
    /// `[colour inputs][m]`
    input: Vec<f32>,
    colour_acts: Vec<f32>,
    rendered: Rendered,
    both: BothParts,
    out_bar: Vec<f32>,
    input_bar: Vec<f32>,
    features_bar: Vec<f32>,
    raw_bar: Vec<f32>,
    x_bar: Vec<f32>,
    /// `[3][m]`, of where the samples are, from a pass that begins there; empty without one.
    carried: Vec<f32>,
    scratch: Vec<f32>,
}

impl Pass {
    /// Of no rays.
    pub(super) fn clear(&mut self) {
        let Seen { known, x, flow, hidden, blend, colour, w, moving_share } = &mut self.seen;
        known.clear();
        self.which.clear();
        self.carried.clear();
        let own = [&mut self.x, &mut self.times, &mut self.free];
        for buffer in [x, flow, hidden, blend, colour, w, moving_share].into_iter().chain(own) {
            buffer.clear();
        }
    }

    /// Begin where the samples are `from` `[3][m]`, moved by `flow` `[3][m]` and held in the unit cube. A ray that has no such frame stays in
    /// its own.
    pub(super) fn place(&mut self, rays: &Chosen, pass: usize, from: &[f32], flow: Option<&[f32]>) {
        self.clear();
        for (r, frames) in rays.frames.iter().enumerate() {
            let frame = frames.beside[pass];
            self.seen.known.push(frame.is_some());
            self.which.extend(rays.movers(r).map(|_| frame.unwrap_or(frames.view)));
        }
        match flow {
            None => self.seen.x.extend_from_slice(from),
            Some(flow) => {
                let there = from.iter().zip(flow).map(|(x, s)| x + s);
                self.free.extend(there.clone().map(|x| if (0.0..=1.0).contains(&x) { 1.0 } else { 0.0 }));
                self.seen.x.extend(there.map(|x| x.clamp(0.0, 1.0)));
            }
        }
        self.x.extend_from_slice(&self.seen.x);
    }

    /// What is seen there.
    pub(super) fn forward(
        &mut self,
        field: &Field,
        part: &MovingPart,
        head: FlowHead,
        rays: &Chosen,
        basis: Basis<'_>,
    ) {
        let [_, m] = rays.samples();
        let (simd, geometry) = (field.simd, part.still_rows());
        let when = When { time_steps: part.time_steps(), which: &self.which };
        let features = sized(&mut self.features, part.rows() * m);
        part.seen(&mut self.x, when, &mut self.times, features, &mut self.placing);
        let out = sized(&mut self.out, part.network.outputs() * m);
        part.forward(simd, features, m, out, sized(&mut self.acts, part.network.activations_len(m)));
        head.read(&out[(geometry + 1) * m..], m, &mut self.seen.flow, &mut self.seen.hidden);
        let gate = &out[geometry * m..(geometry + 1) * m];
        self.seen.blend.extend(gate.iter().map(|gate| logistic(*gate)));

        let inputs = field.colour.inputs();
        let input = sized(&mut self.input, inputs * m);
        input[..geometry * m].copy_from_slice(&out[..geometry * m]);
        for (r, &ray) in rays.rays.iter().enumerate() {
            for k in 0..inputs - geometry {
                input[(geometry + k) * m..][rays.movers(r)].fill(basis.rows[k * basis.rays + ray as usize]);
            }
        }
        let rgb = sized(&mut self.rendered.rgb_of_moving, 3 * m);
        let acts = sized(&mut self.colour_acts, field.colour.activations_len(m));
        field.colour.forward(simd, &field.colour_packed, input, m, Columns::Rays(&rays.moving), rgb, acts);
        let sigma = sized(&mut self.rendered.sigma, m);
        sigma.iter_mut().zip(&out[..m]).for_each(|(sigma, raw)| *sigma = field.density_of(*raw));
        self.rendered.forward(simd, rays, &mut self.seen);
    }

    /// How much of the picture is the moving part's, after [`Pass::forward`] at the rays' own time.
    pub(super) fn share(&mut self, simd: Simd, rays: &Chosen) {
        let [_, m] = rays.samples();
        let matter = MovingMatter { sigma: &self.rendered.sigma[..m], blend: &self.seen.blend };
        self.both.forward(simd, rays, matter, &mut self.seen.moving_share);
    }

    /// The way back. What `bars` hold is brought to features, networks and deformation; returned is the gradient of where the samples are,
    /// `[3][m]`, where `detail` asks for it.
    #[expect(clippy::too_many_arguments, reason = "a pass of all that a ray is made of")]
    pub(super) fn backward(
        &mut self,
        field: &Field,
        part: &MovingPart,
        head: FlowHead,
        rays: &Chosen,
        bars: &SeenBars,
        detail: Detail,
        out: &mut PassGradients<'_>,
    ) -> &[f32] {
        let [_, m] = rays.samples();
        let (simd, geometry) = (field.simd, part.still_rows());
        self.rendered.backward(simd, rays, &self.seen, bars);
        let input_bar = sized(&mut self.input_bar, field.colour.inputs() * m);
        input_bar.fill(0.0);
        let scratch_len = field.colour.backward_scratch_len().max(part.network.backward_scratch_len());
        let scratch = sized(&mut self.scratch, scratch_len);
        let (rgb_bar, columns) = (&self.rendered.rgb_of_moving_bar[..], Columns::Rays(&rays.moving));
        let x_bar = Some(&mut *input_bar);
        field.colour.backward(
            simd,
            &field.colour_packed,
            &self.colour_acts,
            rgb_bar,
            m,
            columns,
            x_bar,
            out.colour,
            scratch,
        );
        let out_bar = sized(&mut self.out_bar, part.network.outputs() * m);
        out_bar[..geometry * m].copy_from_slice(&input_bar[..geometry * m]);
        for (bar, tau_bar) in out_bar.iter_mut().zip(&self.rendered.raw_bar) {
            *bar += tau_bar;
        }
        let gates = out_bar[geometry * m..(geometry + 1) * m].iter_mut();
        for (out, (bar, b)) in gates.zip(bars.blend.iter().zip(&self.seen.blend)) {
            *out = bar * b * (1.0 - b);
        }
        if !bars.moving_share.is_empty() {
            let matter = MovingMatter { sigma: &self.rendered.sigma[..m], blend: &self.seen.blend };
            self.both.backward(simd, rays, matter, &bars.moving_share);
            let (raw, gates) = out_bar.split_at_mut(geometry * m);
            raw.iter_mut().zip(&self.both.raw_bar).for_each(|(out, bar)| *out += bar);
            gates.iter_mut().zip(&self.both.gate_bar).for_each(|(out, bar)| *out += bar);
        }
        let said = [&self.seen.flow[..], &self.seen.hidden[..]];
        head.read_backward(said, [&bars.flow, &bars.hidden], &mut out_bar[(geometry + 1) * m..]);
        let features_bar = sized(&mut self.features_bar, part.rows() * m);
        features_bar.fill(0.0);
        part.backward(simd, &self.acts, out_bar, m, features_bar, out.network, scratch);
        self.positions_back(part, m, detail, out)
    }

    /// From features to the table, the deformation and places.
    fn positions_back(&mut self, part: &MovingPart, m: usize, detail: Detail, out: &mut PassGradients<'_>) -> &[f32] {
        let rows = part.features.rows();
        let x_bar = sized(&mut self.x_bar, 3 * m);
        x_bar.fill(0.0);
        let (bars, seen_bar) = self.features_bar[..part.rows() * m].split_at_mut(rows * m);
        let raw = part.features.pull(&self.features[..rows * m], m, bars, &mut self.raw_bar);
        let warps = part.deform.as_ref().is_some_and(|deform| deform.warps());
        if warps || detail == Detail::All {
            part.features.pull_positions(Places { x: &self.x, times: &self.times }, raw, detail, x_bar);
        }
        if let Some(deform) = &part.deform {
            let points = Points { x: &self.seen.x, which: &self.which, time_steps: deform.time_steps() };
            deform.learn(points, x_bar, seen_bar, out.deform, out.room);
        }
        x_bar.iter_mut().zip(&self.carried).for_each(|(bar, carried)| *bar += carried);
        x_bar.iter_mut().zip(&self.free).for_each(|(bar, free)| *bar *= free);
        x_bar
    }

    /// Keep the gradient of where the samples are, from a pass that begins there, for [`Pass::backward`].
    pub(super) fn carry(&mut self, x_bar: &[f32]) {
        self.carried.clear();
        self.carried.extend_from_slice(x_bar);
    }

    /// What it brings to the gradient of the features.
    pub(super) fn part(&self, pulls_in_place: bool) -> Part<'_> {
        let raw_bar = if pulls_in_place { &self.features_bar } else { &self.raw_bar };
        Part { places: Places { x: &self.x, times: &self.times }, raw_bar }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        let floats =
            [&self.features, &self.features_bar, &self.acts, &self.out, &self.out_bar, &self.input, &self.input_bar];
        let parts = self.placing.bytes() + self.rendered.bytes() + self.both.bytes();
        4 * floats.iter().map(|b| b.capacity()).sum::<usize>() + parts
    }
}

//! The deformation as the papers write it, on the tape.

use super::Deform;
use super::config::{Motion, SeenBy, Sees};
use crate::networks::parts::Part;
use field_core::deform;
use field_core::encoding::frequency::Frequency;
use field_core::encoding::planes::Planes;
use field_core::tape::{EncodingOp, Node, Tape, TapeError, Windowed};

/// The tape operations of a deformation.
pub(super) struct Ops<'a> {
    warp: Option<(EncodingOp<Windowed<'a>>, Part<'a>)>,
    /// Planes of place and time, each with where its parameters begin.
    planes: Vec<(EncodingOp<Planes>, usize, usize)>,
    ambient: Option<(EncodingOp<Frequency>, Part<'a>, EncodingOp<Windowed<'a>>)>,
    seen_point: Option<EncodingOp<Frequency>>,
}

/// Whether points are asked where they come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Warps {
    /// They are.
    Yes,
    /// They stay where they are; only what the density network sees besides is asked for.
    No,
}

/// Points that have been moved.
pub(super) struct Moved {
    /// Canonical points, `[3 x n]` in the unit cube.
    pub(super) x: Node,
    /// What the density network sees besides features, `[rows x n]`; `None` for nothing.
    pub(super) seen: Option<Node>,
}

impl Deform {
    pub(super) fn ops(&self) -> Ops<'_> {
        let windowed = |encoding: &Frequency, window| Windowed { encoding: *encoding, window: Some(window) };
        let at = self.warp.as_ref().map_or(0, |mlp| mlp.param_count());
        let warp = self.warp.as_ref().zip(self.warp_point.as_ref()).map(|(mlp, point)| {
            let encoding = EncodingOp::new(windowed(point, &self.warp_window[..]), self.simd);
            (encoding, Part::new(mlp, &self.packed[0], 0, self.simd))
        });
        let ambient = self.ambient.as_ref().zip(self.ambient_point.as_ref()).zip(self.seen_ambient.as_ref());
        let ambient = ambient.map(|((mlp, point), seen)| {
            let seen = EncodingOp::new(windowed(seen, &self.ambient_window[..]), self.simd);
            (EncodingOp::new(*point, self.simd), Part::new(mlp, &self.packed[1], at, self.simd), seen)
        });
        let seen_point = self.seen_point.as_ref().map(|point| EncodingOp::new(*point, self.simd));
        let planes = self.planes.iter().scan(self.plane_start, |at, planes| {
            let from = *at;
            *at += planes.params_len();
            Some((EncodingOp::new(*planes, self.simd), from, planes.params_len()))
        });
        Ops { warp, planes: planes.collect(), ambient, seen_point }
    }

    /// Record the deformation of points `x` `[3 x n]` of the unit cube at moments `[dims x n]`, whose times in `[-1, 1]` are
    /// `times` `[n]`.
    pub(super) fn record<'a>(
        &self,
        ops: &'a Ops<'a>,
        tape: &mut Tape<'a>,
        x: Node,
        (moment, times): (Node, &[f32]),
        warps: Warps,
    ) -> Result<Moved, TapeError> {
        // Encodings and rotations are about the middle of the scene: the cube [-1, 1]^3.
        let q = tape.affine(x, 2.0, -1.0)?;
        let mut moved = Moved { x, seen: None };
        let mut planes = Vec::with_capacity(ops.planes.len());
        if !ops.planes.is_empty() && (warps == Warps::Yes || self.planes_for(SeenBy::Density)) {
            let t = tape.constant(1, times.len(), times)?;
            let place_and_time = tape.concat(&[q, t])?;
            for (op, from, len) in &ops.planes {
                let table = tape.param(*from, *len, 1)?;
                planes.push(tape.custom(op, &[place_and_time, table])?);
            }
        }
        if let Some((encoding, network)) = ops.warp.as_ref().filter(|_| warps == Warps::Yes) {
            let point = tape.custom(encoding, &[q])?;
            let mut sees = vec![point, moment];
            sees.extend(planes.iter().filter(|_| self.planes_for(SeenBy::Warp)));
            let input = tape.concat(&sees)?;
            let said = network.apply(tape, input)?;
            let there = match self.config.warp.as_ref().map(|w| w.motion) {
                Some(Motion::Rigid) => {
                    let (omega, v) = (tape.slice(said, 0..3)?, tape.slice(said, 3..6)?);
                    deform::rigid(tape, q, omega, v)?
                }
                _ => deform::translate(tape, q, said)?,
            };
            moved.x = tape.affine(there, 0.5, 0.5)?;
        }
        let mut seen = Vec::with_capacity(3);
        if let Some((point, network, windowed)) = &ops.ambient {
            seen.push(if self.ambient_is_closed() {
                // All of it would be multiplied by 0, and so would its gradients.
                let columns = tape.shape(x)?.cols;
                tape.fill(self.seen_ambient.as_ref().map_or(0, Frequency::out_rows), columns, 0.0)
            } else {
                let point = tape.custom(point, &[q])?;
                let input = tape.concat(&[point, moment])?;
                let w = network.apply(tape, input)?;
                tape.custom(windowed, &[w])?
            });
        }
        if self.config.sees != Sees::Place {
            seen.push(moment);
        }
        if let Some(point) = &ops.seen_point {
            seen.push(tape.custom(point, &[q])?);
        }
        seen.extend(planes.iter().filter(|_| self.planes_for(SeenBy::Density)));
        moved.seen = match seen[..] {
            [] => None,
            [one] => Some(one),
            _ => Some(tape.concat(&seen)?),
        };
        Ok(moved)
    }
}

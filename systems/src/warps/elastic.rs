//! The elastic loss: a deformation should be nearly rigid where matter is (Nerfies, section 3.3).

use super::Deform;
use super::deformation::{Moved, Moves};
use super::pass::{DeformGrad, DeformScratch, Points, recorded};
use super::settings::in_range;
use engine::system::SystemError;
use field_core::tape::Tape;
use losses::elastic;
use serde::{Deserialize, Serialize};
use std::sync::atomic::Ordering;

/// Points of a tile: the tangents of a network need several times the memory of the network.
const TILE: usize = 128;

/// Which samples of a ray an elastic loss depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ElasticAt {
    /// The one behind which half of the transmittance is left.
    Middle,
    /// All, by their weights; those of next to no weight are left out.
    All,
}

/// Settings of the elastic loss.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ElasticSettings {
    /// Factor of the loss; 0: none.
    pub(crate) elastic: f32,
    /// Size of a logarithmic stretch from which on it hardly costs more.
    pub(crate) elastic_scale: f32,
    /// Samples it depends on: `middle` (one a ray) or `all` that carry weight.
    pub(crate) elastic_at: ElasticAt,
}

impl ElasticSettings {
    /// No elastic loss.
    pub(crate) const NONE: Self = Self { elastic: 0.0, elastic_scale: 0.03, elastic_at: ElasticAt::Middle };

    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub(crate) fn check(&self) -> Result<(), SystemError> {
        in_range("elastic", self.elastic, 0.0..=1e3)?;
        in_range("elastic_scale", self.elastic_scale, 1e-6..=1e3)
    }
}

impl Deform {
    /// Sum over points of `w` times the robust elastic energy of the deformation there (equations 5 and 6), and `factor` times
    /// its gradient, added to `grad`. Points without weight are left out.
    pub(crate) fn elastic(
        &self,
        points: Points<'_>,
        w: &[f32],
        factor: f64,
        grad: &mut DeformGrad,
        scratch: &mut DeformScratch,
    ) -> f64 {
        if !self.warps() {
            return 0.0;
        }
        let DeformScratch { tape: arena, columns, x, time, t, x_bar: j_bar, .. } = scratch;
        columns.clear();
        columns.extend((0..points.which.len() as u32).filter(|&i| w[i as usize] > 0.0 && !points.rests(i)));
        let (dims, mut sum) = (points.moments.dims, 0.0);
        for columns in columns.chunks(TILE) {
            let m = columns.len();
            points.gather(columns, x, time, t);
            self.count_octaves(m, Moves::Yes);
            let w: Vec<f32> = columns.iter().map(|&i| w[i as usize]).collect();
            let mut tape = Tape::new(arena, &self.params);
            let at = recorded(tape.input(3, m, x));
            let when = recorded(tape.input(dims, m, time));
            let Moved { x: there, .. } = recorded(self.record(&mut tape, at, when, t, Moves::Yes));
            let there = there.expect("a warp moves points");
            let jacobian = recorded(tape.jacobian(there, at));
            let j = recorded(tape.value(jacobian)).data;
            j_bar.clear();
            j_bar.resize(9 * m, 0.0);
            let fits = "nine rows, as many weights";
            sum += elastic::elastic_backward(j, &w, self.elastic.elastic_scale, factor, j_bar).expect(fits);
            let flips = elastic::orientation_flips(j).expect(fits) as u64;
            self.counts.elastic.fetch_add(m as u64, Ordering::Relaxed);
            self.counts.folded.fetch_add(flips, Ordering::Relaxed);
            recorded(tape.backward(&[(jacobian, &j_bar[..])], &mut grad.params));
            grad.add_times(&points, columns, recorded(tape.gradient(when)));
        }
        sum
    }
}

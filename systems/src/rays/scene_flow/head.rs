//! Scene flow, and what is hidden in the frames beside, from rows of the moving part's network.
//!
//! ```text
//! S = reach tanh(raw)            six rows: to the next frame, to the previous one; sides of the unit cube
//! p = sigmoid(raw)               two rows: hidden in the next frame, in the previous one
//! ```

use float_core::m32::logistic;

/// Rows of scene flow.
pub(crate) const FLOW: usize = 6;
/// Rows of what is hidden.
pub(crate) const HIDDEN: usize = 2;

/// Which rows there are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FlowHead {
    /// Largest scene flow along an axis.
    pub(crate) reach: f32,
    /// Whether there are rows for what is hidden.
    pub(crate) hides: bool,
}

impl FlowHead {
    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        FLOW + if self.hides { HIDDEN } else { 0 }
    }

    /// `raw` `[rows][m]` to `flow` `[6][m]` and `hidden` `[2][m]`, which is empty where nothing is said of it; written.
    pub(crate) fn read(&self, raw: &[f32], m: usize, flow: &mut Vec<f32>, hidden: &mut Vec<f32>) {
        let (of_flow, of_hidden) = raw[..self.rows() * m].split_at(FLOW * m);
        flow.clear();
        flow.extend(of_flow.iter().map(|raw| self.reach * raw.tanh()));
        hidden.clear();
        hidden.extend(of_hidden.iter().map(|raw| logistic(*raw)));
    }

    /// The way back of [`FlowHead::read`], from what it gave: written over `raw_bar` `[rows][m]`.
    pub(crate) fn read_backward(
        &self,
        [flow, hidden]: [&[f32]; 2],
        [flow_bar, hidden_bar]: [&[f32]; 2],
        raw_bar: &mut [f32],
    ) {
        let (of_flow, of_hidden) = raw_bar.split_at_mut(flow.len());
        for (out, (s, bar)) in of_flow.iter_mut().zip(flow.iter().zip(flow_bar)) {
            let tanh = s / self.reach;
            *out = bar * self.reach * (1.0 - tanh * tanh);
        }
        for (out, (p, bar)) in of_hidden.iter_mut().zip(hidden.iter().zip(hidden_bar)) {
            *out = bar * p * (1.0 - p);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use field_core::rng::Rng;
    use testkit::gradient::{Tolerance, central_difference, compare};

    fn random(len: usize, stream: u64) -> Vec<f32> {
        let mut out = vec![0.0; len];
        Rng::new(9, stream).fill_uniform(0, &mut out);
        out.iter().map(|u| 6.0 * u - 3.0).collect()
    }

    /// The equations as they stand.
    fn twin(head: FlowHead, raw: &[f64], m: usize) -> Vec<f64> {
        let flow = raw[..FLOW * m].iter().map(|x| f64::from(head.reach) * x.tanh());
        flow.chain(raw[FLOW * m..].iter().map(|x| 1.0 / (1.0 + (-x).exp()))).collect()
    }

    #[test]
    fn rows_are_their_equations_and_so_is_their_gradient() {
        for (hides, m) in [(true, 4), (false, 3), (true, 0)] {
            let head = FlowHead { reach: 0.25, hides };
            let (raw, bar) = (random(head.rows() * m, 1), random(head.rows() * m, 2));
            let (mut flow, mut hidden) = (vec![7.0; 2], vec![7.0; 2]);
            head.read(&raw, m, &mut flow, &mut hidden);
            let wide: Vec<f64> = raw.iter().map(|&x| f64::from(x)).collect();
            let got: Vec<f32> = flow.iter().chain(&hidden).copied().collect();
            compare("rows", &got, &twin(head, &wide, m), Tolerance::new(1e-6, 1e-6)).unwrap();
            let mut raw_bar = vec![f32::NAN; raw.len()];
            let (flow_bar, hidden_bar) = bar.split_at(FLOW * m);
            head.read_backward([&flow, &hidden], [flow_bar, hidden_bar], &mut raw_bar);
            let functional =
                |raw: &[f64]| twin(head, raw, m).iter().zip(&bar).map(|(y, b)| y * f64::from(*b)).sum::<f64>();
            compare("raw", &raw_bar, &central_difference(&wide, functional), Tolerance::SINGLE).unwrap();
        }
    }

    #[test]
    fn a_network_that_says_nothing_says_no_flow() {
        let head = FlowHead { reach: 0.1, hides: true };
        let (mut flow, mut hidden) = (Vec::new(), Vec::new());
        head.read(&[0.0; 8], 1, &mut flow, &mut hidden);
        assert_eq!((&flow[..], &hidden[..]), (&[0.0; 6][..], &[0.5; 2][..]));
        head.read(&[1e9, -1e9, 1e9, -1e9, 1e9, -1e9, 1e9, -1e9], 1, &mut flow, &mut hidden);
        assert!(flow.iter().all(|s| s.abs() <= 0.1) && hidden == [1.0, 0.0]);
    }
}

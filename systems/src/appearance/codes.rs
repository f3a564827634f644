//! A free code for each training photo, or for each of the appearances that a dataset numbers; codes of other photos are fitted.

use super::AppearanceModel;
use super::config::CodeConfig;
use crate::codes::CodeTable;
use crate::photo_model::{Codes, Outcome};
use engine::data::Dataset;
use engine::system::{SystemError, Tensor, TensorMap};
use scene_io::FrameIds;
use std::collections::HashMap;

/// The codes.
pub(crate) struct FreeCodes {
    table: CodeTable,
    lr: f64,
    size: f32,
    /// Where photos share codes; `None`: each photo has its own.
    shared: Option<Shared>,
}

/// Codes that photos share.
struct Shared {
    /// `[views]`, the code of each.
    of_view: Vec<u32>,
    /// `[views][dims]`, the codes view by view.
    rows: Vec<f32>,
    /// The codes of a batch's pixels.
    of_pixels: Vec<u32>,
}

impl Shared {
    /// Take the codes of a table.
    fn renew(&mut self, codes: Codes<'_>) {
        self.rows.clear();
        self.rows.extend(self.of_view.iter().flat_map(|&code| codes.of(code as usize)));
    }
}

/// The code of each view, counted in the order in which they are met: views whose ids name the same appearance share one, a view
/// without ids has its own.
pub(crate) fn codes_by_id(data: &Dataset) -> Vec<u32> {
    by_id(data.views().iter().map(|view| view.source.ids))
}

fn by_id(ids: impl Iterator<Item = Option<FrameIds>>) -> Vec<u32> {
    let (mut known, mut count) = (HashMap::new(), 0);
    let mut next = || {
        count += 1;
        count - 1
    };
    ids.map(|ids| match ids {
        Some(ids) => *known.entry(ids.appearance).or_insert_with(&mut next),
        None => next(),
    })
    .collect()
}

/// Number of codes of views that have these.
pub(crate) fn code_count(of_view: &[u32]) -> usize {
    of_view.iter().max().map_or(0, |&last| last as usize + 1)
}

impl FreeCodes {
    /// Random codes of `views` photos.
    pub(crate) fn new(settings: &CodeConfig, views: usize, seed: u64) -> Self {
        Self::of_table(settings, CodeTable::new("appearance", views, settings.appearance_dims, seed), None)
    }

    /// Codes that begin in `0..0.05`, one for each number in `of_view`, the code of each view.
    pub(crate) fn uniform(settings: &CodeConfig, of_view: Vec<u32>, seed: u64) -> Self {
        let table = CodeTable::uniform("appearance", code_count(&of_view), settings.appearance_dims, seed);
        let is_shared = of_view.iter().enumerate().any(|(view, &code)| view as u32 != code);
        let shared = is_shared.then(|| Shared { of_view, rows: Vec::new(), of_pixels: Vec::new() });
        Self::of_table(settings, table, shared)
    }

    fn of_table(settings: &CodeConfig, table: CodeTable, shared: Option<Shared>) -> Self {
        let (lr, size) = (f64::from(settings.code_lr), settings.code_size);
        let mut codes = Self { table, lr, size, shared };
        codes.renew();
        codes
    }

    /// The table has changed.
    fn renew(&mut self) {
        if let Some(shared) = &mut self.shared {
            shared.renew(self.table.codes());
        }
    }
}

impl AppearanceModel for FreeCodes {
    fn codes(&self) -> Codes<'_> {
        match &self.shared {
            Some(shared) => Codes { rows: &shared.rows, ..self.table.codes() },
            None => self.table.codes(),
        }
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let lr = outcome.lr * self.lr;
        let views = &outcome.batch.view;
        let of_pixels = match &mut self.shared {
            Some(Shared { of_view, of_pixels, .. }) => {
                of_pixels.clear();
                of_pixels.extend(views.iter().map(|&view| of_view[view as usize]));
                &*of_pixels
            }
            None => views,
        };
        let bad = self.table.learn(outcome.simd, lr, of_pixels, outcome.appearance_bar, self.size);
        self.renew();
        bad
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        self.table.push_state(out);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.table.load_state(state)?;
        self.renew();
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.table.len()
    }

    fn memory_bytes(&self) -> usize {
        self.table.bytes()
            + self
                .shared
                .as_ref()
                .map_or(0, |shared| 4 * (shared.rows.len() + shared.of_view.len() + shared.of_pixels.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::data::Batch;
    use engine::system::TensorData;
    use float_core::Simd;
    use glam::DVec3;
    use render_core::ray::Ray;

    const SETTINGS: CodeConfig = CodeConfig { appearance_dims: 2, code_lr: 1.0, code_size: 0.0 };

    fn ids(appearance: u32) -> Option<FrameIds> {
        Some(FrameIds { time: 0, appearance, camera: 0 })
    }

    #[test]
    fn views_of_one_appearance_share_a_code_whatever_its_number() {
        let of = |ids: &[Option<FrameIds>]| by_id(ids.iter().copied());
        assert_eq!(of(&[ids(7), ids(u32::MAX), ids(7), ids(0), ids(u32::MAX)]), [0, 1, 0, 2, 1]);
        assert_eq!(of(&[None, ids(3), None, ids(3)]), [0, 1, 2, 1], "photos without ids have their own");
        assert_eq!((of(&[]), code_count(&[]), code_count(&[0, 1, 0])), (vec![], 0, 2));
    }

    fn numbers(codes: &FreeCodes) -> Vec<f32> {
        let mut out = Vec::new();
        codes.push_state(&mut out);
        match &out[0].data {
            TensorData::F32(rows) => rows.to_vec(),
            TensorData::U64(_) => panic!("codes are numbers"),
        }
    }

    #[test]
    fn a_shared_code_learns_from_all_its_photos_and_each_shows_it() {
        let mut codes = FreeCodes::uniform(&SETTINGS, vec![0, 1, 0], 5);
        let before = numbers(&codes);
        assert_eq!(before.len(), 4);
        assert!(before.iter().all(|c| (0.0..0.05).contains(c)) && before[0] != before[2], "{before:?}");
        assert_eq!((codes.codes().of(0), codes.codes().of(2)), (&before[..2], &before[..2]));
        // Photos 0 and 2 pull the first number of their code the same way, and the second against each other.
        let mut batch = Batch::of_rays(&[Ray { o: DVec3::ZERO, d: DVec3::Z }; 2], &[[0.0; 3]; 2]);
        batch.view = vec![0, 2];
        let outcome = Outcome {
            step: 0,
            lr: 0.01,
            simd: Simd::best(),
            batch: &batch,
            share: 0.5,
            pixels: &[],
            truth: &[],
            appearance_bar: &[1.0, 1.0, 2.0, -1.0],
            transient_bar: &[],
        };
        assert_eq!(codes.learn(&outcome), 0);
        let after = numbers(&codes);
        // Adam's first step is as long as the learning rate.
        assert!((before[0] - after[0] - 0.01).abs() < 1e-5, "{before:?} {after:?}");
        assert_eq!(after[1..], before[1..], "what cancels and who is not there does not move");
        assert_eq!((codes.codes().of(0), codes.codes().of(1)), (&after[..2], &after[2..]));
        assert_eq!(codes.codes().of(0), codes.codes().of(2));

        let mut again = FreeCodes::uniform(&SETTINGS, vec![0, 1, 0], 6);
        let mut state = Vec::new();
        codes.push_state(&mut state);
        let state: TensorMap = state.into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
        again.load_state(&state).unwrap();
        assert_eq!(again.codes(), codes.codes());
        let other = FreeCodes::uniform(&SETTINGS, vec![0, 1, 2], 6).load_state(&state);
        assert!(other.unwrap_err().to_string().contains("appearance.codes"));
    }
}

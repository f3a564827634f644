//! Any appearance model with any occluder model: all systems of this folder are one of these pairs. Systems of scenes that move have
//! an appearance model and no occluders.

use crate::appearance::AppearanceModel;
use crate::claims::Claim;
use crate::occluders::OccluderModel;
use crate::photo_model::{
    Codes, Drawing, Outcome, PhotoAndRender, PhotoModel, Pixel, PixelBar, RenderedTwice, SecondRender,
};
use crate::static_maps::StaticMaps;
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap};

/// `plain`: neither appearance nor occluders.
pub(crate) const PLAIN: Claim = Claim {
    name: "plain",
    paper: "",
    what: "The field of `ngp` with no part for appearance or occluders",
    take: "to see what the other parts are worth",
    differs: "The field alone: one appearance, no occluders.",
    mark: "",
};

/// The pair.
pub(crate) struct Wild {
    pub(crate) name: &'static str,
    /// `None`: all photos have the same appearance.
    pub(crate) appearance: Option<Box<dyn AppearanceModel>>,
    pub(crate) occluders: Box<dyn OccluderModel>,
}

impl PhotoModel for Wild {
    fn name(&self) -> &'static str {
        self.name
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        self.appearance.as_ref().map(|model| model.codes())
    }

    fn learning_appearance(&self) -> Option<Codes<'_>> {
        self.appearance.as_ref().map(|model| model.learning_codes())
    }

    fn transient(&self) -> Option<Codes<'_>> {
        self.occluders.transient_codes()
    }

    fn drawing(&self) -> Drawing {
        let of_appearance = || self.appearance.as_ref().map_or(Drawing::Pixels, |model| model.drawing());
        self.occluders.drawing().unwrap_or_else(of_appearance)
    }

    fn begin(&mut self, data: &Dataset, batch: &mut Batch, step: u64) -> Result<(), SystemError> {
        self.occluders.begin(batch, step)?;
        self.appearance.as_mut().map_or(Ok(()), |model| model.begin(data, batch, step))
    }

    fn judges_batch(&self, _step: u64) -> bool {
        self.occluders.judges_batch()
    }

    fn judge(&mut self, batch: &Batch, _step: u64, pixels: &[Pixel], truth: &[[f32; 3]]) {
        self.occluders.judge(batch, pixels, truth);
    }

    fn loss(&self, i: usize, pixel: &Pixel, truth: [f32; 3]) -> (f32, PixelBar) {
        self.occluders.loss(i, pixel, truth)
    }

    fn coarse_loss(&self, i: usize, rgb: [f32; 3], truth: [f32; 3]) -> (f32, [f32; 3]) {
        self.occluders.coarse_loss(i, rgb, truth)
    }

    fn second_render(&self, step: u64) -> Option<SecondRender> {
        self.appearance.as_ref()?.second_render(step)
    }

    fn judge_second_render(&mut self, rendered: &RenderedTwice<'_>) -> Vec<[f32; 3]> {
        match &mut self.appearance {
            Some(model) => model.judge_second_render(rendered),
            None => vec![[0.0; 3]; rendered.other.len()],
        }
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        self.appearance.as_mut().map_or(0, |model| model.learn(outcome)) + self.occluders.learn(outcome)
    }

    fn survey(&self, step: u64) -> Option<u32> {
        self.occluders.survey(step)
    }

    fn survey_view(&mut self, data: &Dataset, seen: &PhotoAndRender<'_>) -> Result<(), SystemError> {
        self.occluders.survey_view(data, seen)
    }

    fn surveyed(&mut self) {
        self.occluders.surveyed();
    }

    fn begins_anew(&self) -> Option<u64> {
        self.occluders.begins_anew()
    }

    fn visibility(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        self.occluders.visibility(seen)
    }

    fn static_maps(&self) -> Option<&StaticMaps> {
        self.occluders.static_maps()
    }

    fn uncertainty(&self, seen: &PhotoAndRender<'_>) -> Option<Vec<f32>> {
        self.occluders.uncertainty(seen)
    }

    fn encode(&self, photo: &scene_io::Image) -> Option<Vec<f32>> {
        self.appearance.as_ref()?.encode(photo)
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        let mut out = Vec::new();
        self.appearance.iter().for_each(|model| model.push_state(&mut out));
        self.occluders.push_state(&mut out);
        out
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.appearance.as_mut().map_or(Ok(()), |model| model.load_state(state))?;
        self.occluders.load_state(state)
    }

    fn parameter_count(&self) -> usize {
        self.appearance.as_ref().map_or(0, |model| model.parameter_count()) + self.occluders.parameter_count()
    }

    fn memory_bytes(&self) -> usize {
        self.appearance.as_ref().map_or(0, |model| model.memory_bytes()) + self.occluders.memory_bytes()
    }
}

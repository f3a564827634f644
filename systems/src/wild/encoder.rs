//! The encoder that makes a code of a photo: thumbnails, codes, and what it learns from their gradients.
//!
//! As published, the encoder looks at the photo of a batch and learns from the gradient of the batch's code. The fast field
//! cannot wait for that: a batch of a few photos says little about the scene, and while the encoder still mistakes what a photo
//! shows for its light the field learns to make up for it, view by view. There the field learns with free codes, and the encoder
//! learns to say them, a few photos in each step, by turns, and parts of some. What is rendered later is in the light the encoder sees.

use super::codes::CodeTable;
use super::config::WildConfig;
use super::consistency::Consistency;
use super::glance::{Glance, Kept, Picture};
use super::thumbnail::Thumbnail;
use crate::method::{Codes, Outcome, Relit, SecondLight};
use engine::data::{Batch, Dataset};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::conv::{Encoder, EncoderConfig, Size};
use field_core::rng::Rng;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use scene_io::Image;

/// Stream of the initial parameters.
const INIT: u64 = 0x656e_636f_6465;

/// Stream of the parts of photos.
const PARTS: u64 = 0x0070_6172_7473;

/// Where the encoder follows codes its learning rate falls as `1 / (1 + step / SETTLE)`, besides that of the field: what it
/// follows comes to rest.
const SETTLE: f64 = 500.0;

/// The encoder, and the code of each photo as it was when the encoder last looked at it.
pub(super) struct PhotoEncoder {
    glance: Glance,
    params: Vec<f32>,
    grad: Vec<f32>,
    adam: Adam,
    lr: f64,
    seed: u64,
    /// Factor of the mean square of a code.
    pull: f32,
    /// Longest side of a thumbnail.
    side: usize,
    /// The codes that the field learns with, where they are not the encoder's.
    follows: Option<Follows>,
    /// Made when a photo is looked at for the first time: pictures of a trained system need none of them.
    thumbnails: Vec<Option<Thumbnail>>,
    /// `[views][code]`
    rows: Vec<f32>,
    /// The photos of the step, by number.
    tasks: Vec<Task>,
    count: usize,
    consistency: Consistency,
    /// What renders in another light bring to the gradient.
    second_grad: Vec<f32>,
}

/// What the encoder learns to say.
struct Follows {
    table: CodeTable,
    lr: f64,
    /// Photos of a step.
    photos: usize,
}

/// A photo on its way through the encoder and back.
#[derive(Default)]
struct Task {
    view: usize,
    size: Option<Size>,
    x: Vec<f32>,
    alpha: Vec<f32>,
    kept: Kept,
    code: Vec<f32>,
    code_bar: Vec<f32>,
    grad: Vec<f32>,
}

impl Task {
    fn forward(&mut self, glance: &Glance, params: &[f32], thumbnail: &Thumbnail) {
        let Self { size, x, alpha, kept, code, .. } = self;
        *size = Some(thumbnail.size);
        x.clear();
        // Around 0, which is also what transparent pixels are.
        x.extend(thumbnail.planes.iter().map(|&v| (f32::from(v) - 127.5) / 127.5));
        alpha.clear();
        alpha.extend(thumbnail.alpha.iter().map(|&a| f32::from(a) / 255.0));
        glance.forward(params, Picture { x, alpha, size: thumbnail.size }, kept, code);
    }

    /// After [`Task::forward`].
    fn backward(&mut self, glance: &Glance, params: &[f32]) {
        let Self { size, x, alpha, kept, code_bar, grad, .. } = self;
        grad.clear();
        grad.resize(params.len(), 0.0);
        if let Some(size) = *size {
            glance.backward(params, Picture { x, alpha, size }, kept, code_bar, grad, None);
        }
    }
}

impl PhotoEncoder {
    /// # Errors
    /// [`SystemError::Config`] for a shape that is none, and photos too small for it.
    pub(super) fn new(config: &WildConfig, data: &Dataset, seed: u64) -> Result<Self, SystemError> {
        let bad = |field, value: String, problem: String| Err(SystemError::Config { field, value, problem });
        let shape = EncoderConfig::new(3, config.encoder_channels.clone(), config.appearance_dims);
        let encoder = match Encoder::new(shape) {
            Ok(encoder) => encoder,
            Err(e) => return bad("encoder_channels", format!("{:?}", config.encoder_channels), e.to_string()),
        };
        let glance = Glance::new(encoder, &config.encoder_tilts);
        let least = glance.min_side();
        if config.encoder_side < least {
            let problem = format!("must be at least {least}: the encoder halves a photo so often");
            return bad("encoder_side", config.encoder_side.to_string(), problem);
        }
        if let Some(view) = data.views().iter().find(|v| (v.camera.width.min(v.camera.height) as usize) < least) {
            let problem = format!(
                "photo `{}` is {}x{} pixels and the encoder needs {least} on each side; use `codes`",
                view.name, view.camera.width, view.camera.height
            );
            return bad("appearance", "encoder".into(), problem);
        }
        if config.view_weight + config.mode_weight > 0.0 && config.lattice < least {
            let problem = format!(
                "must be at least {least}, as the encoder looks at renders; or `view_weight` and `mode_weight` 0"
            );
            return bad("lattice", config.lattice.to_string(), problem);
        }
        let mut params = vec![0.0; glance.param_count()];
        glance.init(Rng::new(seed, INIT), &mut params);
        Ok(Self {
            grad: vec![0.0; params.len()],
            second_grad: vec![0.0; params.len()],
            adam: Adam::new(params.len(), AdamConfig::DEFAULT),
            lr: f64::from(config.encoder_lr),
            seed,
            pull: config.code_size,
            side: config.encoder_side,
            follows: (config.lattices == 0).then(|| Follows {
                table: CodeTable::zeros("appearance", data.len(), config.appearance_dims),
                lr: f64::from(config.code_lr),
                photos: config.encoder_photos,
            }),
            thumbnails: (0..data.len()).map(|_| None).collect(),
            rows: vec![0.0; data.len() * glance.code()],
            tasks: Vec::new(),
            count: 0,
            consistency: Consistency::new(config, seed),
            glance,
            params,
        })
    }

    pub(super) fn codes(&self) -> Codes<'_> {
        Codes { dims: self.glance.code(), rows: &self.rows }
    }

    /// The codes that the field learns with.
    pub(super) fn learning_codes(&self) -> Codes<'_> {
        self.follows.as_ref().map_or_else(|| self.codes(), |follows| follows.table.codes())
    }

    /// Codes of the photos of a step; the others stay as they are.
    pub(super) fn begin(&mut self, data: &Dataset, batch: &Batch, step: u64) -> Result<(), SystemError> {
        let photos = self.thumbnails.len() as u64;
        let mut views: Vec<usize> = match &self.follows {
            Some(follows) if photos > 0 => {
                let count = photos.min(follows.photos as u64);
                (0..count).map(|k| ((step % photos * count + k) % photos) as usize).collect()
            }
            Some(_) => Vec::new(),
            None => batch.view.iter().map(|&v| v as usize).collect(),
        };
        views.sort_unstable();
        views.dedup();
        let whole = views.len();
        if self.follows.is_some() {
            // And at a part of every fourth: light is what the parts of a photo have in common.
            let parts: Vec<usize> = views.iter().copied().skip((step % 4) as usize).step_by(4).collect();
            views.extend(parts);
        }
        self.count = views.len();
        if self.tasks.len() < self.count {
            self.tasks.resize_with(self.count, Task::default);
        }
        for (task, view) in self.tasks.iter_mut().zip(views) {
            task.view = view;
            if self.thumbnails[view].is_none() {
                self.thumbnails[view] = Some(Thumbnail::of(&*data.image(view)?, self.side, self.glance.min_side()));
            }
        }
        let Self { glance, params, thumbnails, tasks, rows, .. } = self;
        let rng = Rng::new(self.seed, PARTS).substream(step);
        tasks[..self.count].par_iter_mut().enumerate().for_each(|(i, task)| match &thumbnails[task.view] {
            Some(thumbnail) if i < whole => task.forward(glance, params, thumbnail),
            Some(thumbnail) => {
                let u = rng.uniform4_at(task.view as u64);
                task.forward(glance, params, &thumbnail.part(glance.min_side(), u));
            }
            None => {}
        });
        let dims = glance.code();
        for task in &tasks[..whole] {
            keep_finite(&task.code, &mut rows[task.view * dims..][..dims]);
        }
        Ok(())
    }

    /// See [`crate::method::Method::second_light`].
    pub(super) fn second_light(&self, step: u64) -> Option<SecondLight> {
        self.consistency.second_light(self.codes(), step)
    }

    /// See [`crate::method::Method::judge_second`].
    pub(super) fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        let Self { glance, params, rows, consistency, second_grad, .. } = self;
        let codes = Codes { dims: glance.code(), rows };
        consistency.judge((glance, params), codes, relit, second_grad).1
    }

    /// One step from the gradients of the pixels' codes. Returns the count of non-finite gradients.
    pub(super) fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let (dims, batch) = (self.glance.code(), outcome.batch);
        let Self { glance, params, tasks, grad, second_grad, follows, .. } = self;
        let all = &mut tasks[..self.count];
        let (mut bad, mut settled) = (0, 1.0);
        if let Some(Follows { table, lr, .. }) = follows {
            // Half the mean squared distance.
            let share = 1.0 / (dims * all.len().max(1)) as f32;
            for task in all.iter_mut() {
                let Task { code, code_bar, .. } = task;
                code_bar.clear();
                code_bar.extend(code.iter().zip(table.codes().of(task.view)).map(|(code, aim)| share * (code - aim)));
            }
            settled = 1.0 / (1.0 + outcome.step as f64 / SETTLE);
            let lr = outcome.lr * *lr;
            bad = table.learn(outcome.simd, lr, batch, outcome.appearance_bar, self.pull);
        } else {
            // Codes near 0: the mean over pixels of the mean square of their codes.
            let pull = 2.0 * self.pull / (dims * batch.len().max(1)) as f32;
            for task in all.iter_mut() {
                task.code_bar.clear();
                task.code_bar.resize(dims, 0.0);
            }
            for (bars, &view) in outcome.appearance_bar.chunks_exact(dims).zip(&batch.view) {
                if let Ok(at) = all.binary_search_by_key(&(view as usize), |task| task.view) {
                    let Task { code, code_bar, .. } = &mut all[at];
                    for ((sum, bar), code) in code_bar.iter_mut().zip(bars).zip(code) {
                        *sum += bar + pull * *code;
                    }
                }
            }
        }
        all.par_iter_mut().for_each(|task| {
            task.backward(glance, params);
        });
        grad.copy_from_slice(second_grad);
        second_grad.fill(0.0);
        for task in all {
            grad.iter_mut().zip(&task.grad).for_each(|(sum, g)| *sum += g);
        }
        bad + self.adam.step(outcome.simd, outcome.lr * self.lr * settled, &mut self.params, &self.grad)
    }

    /// The code of any photo; `None` for one that is too small.
    pub(super) fn encode(&self, photo: &Image) -> Option<Vec<f32>> {
        let least = self.glance.min_side();
        if (photo.width.min(photo.height) as usize) < least {
            return None;
        }
        let mut task = Task::default();
        task.forward(&self.glance, &self.params, &Thumbnail::of(photo, self.side, least));
        Some(task.code)
    }

    pub(super) fn len(&self) -> usize {
        self.params.len() + self.follows.as_ref().map_or(0, |follows| follows.table.len())
    }

    /// Bytes of parameters, moments, gradients, thumbnails and codes.
    pub(super) fn bytes(&self) -> usize {
        let thumbnails: usize =
            self.thumbnails.iter().flatten().map(|t| t.planes.capacity() + t.alpha.capacity()).sum();
        let task = |t: &Task| t.x.capacity() + t.alpha.capacity() + t.kept.len() + t.grad.capacity();
        thumbnails + 4 * (5 * self.params.len() + 5 * self.rows.len() + self.tasks.iter().map(task).sum::<usize>())
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor("encoder.network", &self.params));
        out.push(f32_tensor("encoder.codes", &self.rows));
        self.follows.iter().for_each(|follows| follows.table.push_state(out));
        push_adam(out, "encoder", &self.adam);
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let params = take_numbers(state, "encoder.network", self.params.len())?;
        let rows = take_numbers(state, "encoder.codes", self.rows.len())?;
        self.follows.as_mut().map_or(Ok(()), |follows| follows.table.load_state(state))?;
        self.adam = take_adam(state, "encoder", &self.adam)?;
        (self.params, self.rows) = (params, rows);
        Ok(())
    }
}

/// Take down the code of a photo. One that is not finite, from a network that learns too fast, is none: the photo keeps what
/// it had, and the gradient, which is not finite either, ends the training.
fn keep_finite(code: &[f32], row: &mut [f32]) {
    if code.iter().all(|v| v.is_finite()) {
        row.copy_from_slice(code);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_keeps_its_code_when_the_new_one_is_no_number() {
        let mut row = [1.0, 2.0];
        for bad in [[f32::INFINITY, 0.0], [0.0, f32::NAN]] {
            keep_finite(&bad, &mut row);
            assert_eq!(row, [1.0, 2.0]);
        }
        keep_finite(&[3.0, -4.0], &mut row);
        assert_eq!(row, [3.0, -4.0]);
    }
}

//! The encoder that makes a code of a photo: thumbnails, codes, and its learning from their gradients.
//!
//! As published, the encoder encodes the photo of a batch and learns from the gradient of the batch's code. The hash grid
//! cannot wait for that: a batch of a few photos says little about the scene, and while the encoder still mistakes the content
//! of a photo for its appearance the field learns to make up for it, view by view. There the field learns with free codes, and
//! the encoder learns to predict them, from a few photos in each step, in turn, and from parts of some. Renders use the
//! encoder's codes.

use super::AppearanceModel;
use super::config::{CodeConfig, ConsistencyConfig, PhotoEncoderConfig};
use super::photo_network::{ForwardMemory, PhotoNetwork, Picture};
use super::thumbnail::Thumbnail;
use super::view_consistency::Consistency;
use crate::codes::CodeTable;
use crate::limits::refuse;
use crate::photo_model::{Codes, Drawing, Outcome, RenderedTwice, SecondRender};
use engine::data::{Batch, Dataset, Patches, Shape};
use engine::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_numbers};
use field_core::conv::{self, EncoderConfig, Size};
use field_core::rng::Rng;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use scene_io::Image;

/// Stream of the initial parameters.
const INIT: u64 = 0x656e_636f_6465;

/// Stream of the parts of photos.
const PARTS: u64 = 0x0070_6172_7473;

/// Where the encoder follows free codes its learning rate falls as `1 / (1 + step / SETTLE)`, besides the schedule of the
/// field: the free codes settle.
const SETTLE: f64 = 500.0;

/// The encoder, and the code of each photo as it was last encoded.
pub(crate) struct Encoder {
    network: PhotoNetwork,
    params: Vec<f32>,
    grad: Vec<f32>,
    adam: Adam,
    lr: f64,
    seed: u64,
    drawing: Drawing,
    /// Factor of the mean square of a code.
    code_size: f32,
    /// Longest side of a thumbnail.
    side: usize,
    /// The free codes that the field learns with; `None`: it learns with the encoder's.
    follows: Option<Follows>,
    /// Made when a photo is encoded for the first time: a trained system that renders needs none of them.
    thumbnails: Vec<Option<Thumbnail>>,
    /// `[views][code]`
    rows: Vec<f32>,
    /// The photos of the step, in the order of their views; then parts of some of them.
    tasks: Vec<Task>,
    count: usize,
    consistency: Consistency,
    /// Gradient of the losses on second renders.
    second_grad: Vec<f32>,
}

/// Free codes that the encoder learns to predict.
struct Follows {
    table: CodeTable,
    lr: f64,
    /// Photos of a step.
    photos: usize,
}

/// A photo that is encoded, and the gradient of that.
#[derive(Default)]
struct Task {
    view: usize,
    size: Option<Size>,
    x: Vec<f32>,
    alpha: Vec<f32>,
    memory: ForwardMemory,
    code: Vec<f32>,
    code_bar: Vec<f32>,
    grad: Vec<f32>,
}

impl Task {
    fn forward(&mut self, network: &PhotoNetwork, params: &[f32], thumbnail: &Thumbnail) {
        let Self { size, x, alpha, memory, code, .. } = self;
        *size = Some(thumbnail.size);
        x.clear();
        // Around 0, which is also what transparent pixels are.
        x.extend(thumbnail.planes.iter().map(|&v| (f32::from(v) - 127.5) / 127.5));
        alpha.clear();
        alpha.extend(thumbnail.alpha.iter().map(|&a| f32::from(a) / 255.0));
        network.forward(params, Picture { x, alpha, size: thumbnail.size }, memory, code);
    }

    /// After [`Task::forward`].
    fn backward(&mut self, network: &PhotoNetwork, params: &[f32]) {
        let Self { size, x, alpha, memory, code_bar, grad, .. } = self;
        grad.clear();
        grad.resize(params.len(), 0.0);
        if let Some(size) = *size {
            network.backward(params, Picture { x, alpha, size }, memory, code_bar, grad, None);
        }
    }
}

impl Encoder {
    /// # Errors
    /// [`SystemError::Config`] for a network that cannot be built, and photos too small for it.
    pub(crate) fn new(
        codes: &CodeConfig,
        settings: &PhotoEncoderConfig,
        consistency: &ConsistencyConfig,
        data: &Dataset,
        seed: u64,
    ) -> Result<Self, SystemError> {
        let dims = codes.appearance_dims;
        let network = network(settings, dims)?;
        let least = network.min_side();
        if let Some(view) = data.views().iter().find(|v| (v.camera.width.min(v.camera.height) as usize) < least) {
            let problem = format!(
                "photo `{}` is {}x{} pixels and the encoder needs {least} on each side; use `codes`",
                view.name, view.camera.width, view.camera.height
            );
            return refuse("appearance", "encoder", problem);
        }
        if consistency.weighs() && settings.lattice < least {
            let problem = format!(
                "must be at least {least}, as renders are encoded; or set `view_weight` and `mode_weight` to 0"
            );
            return refuse("lattice", settings.lattice, problem);
        }
        let mut params = vec![0.0; network.param_count()];
        network.init(Rng::new(seed, INIT), &mut params);
        Ok(Self {
            grad: vec![0.0; params.len()],
            second_grad: vec![0.0; params.len()],
            adam: Adam::new(params.len(), AdamConfig::DEFAULT),
            lr: f64::from(settings.encoder_lr),
            seed,
            drawing: match settings.lattices {
                0 => Drawing::Pixels,
                n => Drawing::Patches(Patches { shape: Shape::Lattice, side: settings.lattice as u32 }, n),
            },
            code_size: codes.code_size,
            side: settings.encoder_side,
            follows: (settings.lattices == 0).then(|| Follows {
                table: CodeTable::zeros("appearance", data.len(), dims),
                lr: f64::from(codes.code_lr),
                photos: settings.encoder_photos,
            }),
            thumbnails: (0..data.len()).map(|_| None).collect(),
            rows: vec![0.0; data.len() * dims],
            tasks: Vec::new(),
            count: 0,
            consistency: Consistency::new(consistency, settings.lattice, seed),
            network,
            params,
        })
    }
}

/// The network of a code of `dims` numbers.
fn network(settings: &PhotoEncoderConfig, dims: usize) -> Result<PhotoNetwork, SystemError> {
    let shape = EncoderConfig::new(3, settings.encoder_channels.clone(), dims);
    let convolutions = match conv::Encoder::new(shape) {
        Ok(convolutions) => convolutions,
        Err(e) => return refuse("encoder_channels", format!("{:?}", settings.encoder_channels), e.to_string()),
    };
    let network = PhotoNetwork::new(convolutions, &settings.encoder_tilts);
    let least = network.min_side();
    if settings.encoder_side < least {
        let problem = format!("must be at least {least}, as the encoder halves a photo once for each further channel");
        return refuse("encoder_side", settings.encoder_side, problem);
    }
    Ok(network)
}

impl AppearanceModel for Encoder {
    fn codes(&self) -> Codes<'_> {
        Codes { dims: self.network.code(), rows: &self.rows }
    }

    fn learning_codes(&self) -> Codes<'_> {
        self.follows.as_ref().map_or_else(|| self.codes(), |follows| follows.table.codes())
    }

    fn drawing(&self) -> Drawing {
        self.drawing
    }

    /// Encodes the photos of the step; the codes of others stay as they are.
    fn begin(&mut self, data: &Dataset, batch: &Batch, step: u64) -> Result<(), SystemError> {
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
            // And a part of every fourth: the parts of a photo have one appearance.
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
                self.thumbnails[view] = Some(Thumbnail::of(&*data.image(view)?, self.side, self.network.min_side()));
            }
        }
        let Self { network, params, thumbnails, tasks, rows, .. } = self;
        let rng = Rng::new(self.seed, PARTS).substream(step);
        tasks[..self.count].par_iter_mut().enumerate().for_each(|(i, task)| match &thumbnails[task.view] {
            Some(thumbnail) if i < whole => task.forward(network, params, thumbnail),
            Some(thumbnail) => {
                let u = rng.uniform4_at(task.view as u64);
                task.forward(network, params, &thumbnail.part(network.min_side(), u));
            }
            None => {}
        });
        let dims = network.code();
        for task in &tasks[..whole] {
            keep_finite(&task.code, &mut rows[task.view * dims..][..dims]);
        }
        Ok(())
    }

    fn second_render(&self, step: u64) -> Option<SecondRender> {
        self.consistency.second_render(self.codes(), step)
    }

    fn judge_second_render(&mut self, rendered: &RenderedTwice<'_>) -> Vec<[f32; 3]> {
        let Self { network, params, rows, consistency, second_grad, .. } = self;
        let codes = Codes { dims: network.code(), rows };
        consistency.judge(network, params, codes, rendered, second_grad).1
    }

    fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let (dims, batch) = (self.network.code(), outcome.batch);
        let Self { network, params, tasks, grad, second_grad, follows, .. } = self;
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
            bad = table.learn(outcome.simd, lr, &batch.view, outcome.appearance_bar, self.code_size);
        } else {
            // Codes near 0: the mean over pixels of the mean square of their codes.
            let factor = 2.0 * self.code_size / (dims * batch.len().max(1)) as f32;
            for task in all.iter_mut() {
                task.code_bar.clear();
                task.code_bar.resize(dims, 0.0);
            }
            for (bars, &view) in outcome.appearance_bar.chunks_exact(dims).zip(&batch.view) {
                if let Ok(at) = all.binary_search_by_key(&(view as usize), |task| task.view) {
                    let Task { code, code_bar, .. } = &mut all[at];
                    for ((sum, bar), code) in code_bar.iter_mut().zip(bars).zip(code) {
                        *sum += bar + factor * *code;
                    }
                }
            }
        }
        all.par_iter_mut().for_each(|task| {
            task.backward(network, params);
        });
        grad.copy_from_slice(second_grad);
        second_grad.fill(0.0);
        for task in all {
            grad.iter_mut().zip(&task.grad).for_each(|(sum, g)| *sum += g);
        }
        bad + self.adam.step(outcome.simd, outcome.lr * self.lr * settled, &mut self.params, &self.grad)
    }

    /// `None` for a photo that is too small.
    fn encode(&self, photo: &Image) -> Option<Vec<f32>> {
        let least = self.network.min_side();
        if (photo.width.min(photo.height) as usize) < least {
            return None;
        }
        let mut task = Task::default();
        task.forward(&self.network, &self.params, &Thumbnail::of(photo, self.side, least));
        Some(task.code)
    }

    fn parameter_count(&self) -> usize {
        self.params.len() + self.follows.as_ref().map_or(0, |follows| follows.table.len())
    }

    fn memory_bytes(&self) -> usize {
        let thumbnails: usize =
            self.thumbnails.iter().flatten().map(|t| t.planes.capacity() + t.alpha.capacity()).sum();
        let task = |t: &Task| t.x.capacity() + t.alpha.capacity() + t.memory.len() + t.grad.capacity();
        thumbnails + 4 * (5 * self.params.len() + 5 * self.rows.len() + self.tasks.iter().map(task).sum::<usize>())
    }

    fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor("encoder.network", &self.params));
        out.push(f32_tensor("encoder.codes", &self.rows));
        self.follows.iter().for_each(|follows| follows.table.push_state(out));
        push_adam(out, "encoder", &self.adam);
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let params = take_numbers(state, "encoder.network", self.params.len())?;
        let rows = take_numbers(state, "encoder.codes", self.rows.len())?;
        self.follows.as_mut().map_or(Ok(()), |follows| follows.table.load_state(state))?;
        self.adam = take_adam(state, "encoder", &self.adam)?;
        (self.params, self.rows) = (params, rows);
        Ok(())
    }
}

/// Store a photo's code unless it is not finite; then keep the previous one (the gradient, not finite either, ends the
/// training).
fn keep_finite(code: &[f32], row: &mut [f32]) {
    if code.iter().all(|v| v.is_finite()) {
        row.copy_from_slice(code);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_photo_keeps_its_code_when_the_new_one_is_not_finite() {
        let mut row = [1.0, 2.0];
        for bad in [[f32::INFINITY, 0.0], [0.0, f32::NAN]] {
            keep_finite(&bad, &mut row);
            assert_eq!(row, [1.0, 2.0]);
        }
        keep_finite(&[3.0, -4.0], &mut row);
        assert_eq!(row, [3.0, -4.0]);
    }
}

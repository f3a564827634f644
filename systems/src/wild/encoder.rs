//! The encoder that makes a code of a photo: thumbnails, codes, and what it learns from their gradients.

use super::config::WildConfig;
use crate::data::{Batch, Dataset};
use crate::method::{Codes, Outcome};
use crate::system::{SystemError, Tensor, TensorMap, f32_tensor, push_adam, take_adam, take_f32};
use field_core::conv::{Encoder, EncoderConfig, Size, Workspace};
use field_core::rng::Rng;
use float_core::Simd;
use optim::{Adam, AdamConfig};
use rayon::prelude::*;
use scene_io::Image;

/// Stream of the initial parameters.
const INIT: u64 = 0x656e_636f_6465;

/// What [`Encoder`] says about its images holds for all thumbnails.
const FITS: &str = "thumbnails are no smaller than the encoder needs";

/// The encoder, and the code of each photo as it was when the photo was last in a batch.
pub(super) struct PhotoEncoder {
    encoder: Encoder,
    simd: Simd,
    params: Vec<f32>,
    grad: Vec<f32>,
    adam: Adam,
    lr: f64,
    /// Factor of the mean square of a code.
    pull: f32,
    /// Longest side of a thumbnail.
    side: usize,
    /// Made when a photo is in a batch for the first time: pictures of a trained system need none of them.
    thumbnails: Vec<Option<Thumbnail>>,
    /// `[views][code]`
    rows: Vec<f32>,
    /// The photos of the batch, by number.
    tasks: Vec<Task>,
    count: usize,
}

/// `[3][height][width]`
struct Thumbnail {
    size: Size,
    planes: Vec<u8>,
}

/// A photo on its way through the encoder and back.
#[derive(Default)]
struct Task {
    view: usize,
    x: Vec<f32>,
    acts: Vec<f32>,
    code: Vec<f32>,
    code_bar: Vec<f32>,
    grad: Vec<f32>,
    work: Workspace,
}

impl Task {
    fn forward(&mut self, encoder: &Encoder, simd: Simd, params: &[f32], thumbnail: &Thumbnail) {
        let Self { x, acts, code, work, .. } = self;
        x.clear();
        // Around 0, which is also what transparent pixels are.
        x.extend(thumbnail.planes.iter().map(|&v| (f32::from(v) - 127.5) / 127.5));
        acts.resize(encoder.activations_len(thumbnail.size).expect(FITS), 0.0);
        code.resize(encoder.code(), 0.0);
        encoder.forward(simd, params, x, thumbnail.size, acts, code, work).expect(FITS);
    }

    fn backward(&mut self, encoder: &Encoder, simd: Simd, params: &[f32], thumbnail: &Thumbnail) {
        let Self { x, acts, code_bar, grad, work, .. } = self;
        grad.clear();
        grad.resize(params.len(), 0.0);
        encoder.backward(simd, params, x, thumbnail.size, acts, code_bar, grad, None, work).expect(FITS);
    }
}

impl PhotoEncoder {
    /// # Errors
    /// [`SystemError::Config`] for a shape that is none, and photos too small for it.
    pub(super) fn new(config: &WildConfig, data: &Dataset, seed: u64) -> Result<Self, SystemError> {
        let bad = |field, value: String, problem: String| Err(SystemError::Config { field, value, problem });
        let shape =
            EncoderConfig { inputs: 3, channels: config.encoder_channels.clone(), code: config.appearance_dims };
        let encoder = match Encoder::new(shape) {
            Ok(encoder) => encoder,
            Err(e) => return bad("encoder_channels", format!("{:?}", config.encoder_channels), e.to_string()),
        };
        let least = encoder.min_side();
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
        let mut params = vec![0.0; encoder.param_count()];
        encoder.init(Rng::new(seed, INIT), &mut params);
        Ok(Self {
            simd: Simd::best(),
            grad: vec![0.0; params.len()],
            adam: Adam::new(params.len(), AdamConfig::DEFAULT),
            lr: f64::from(config.encoder_lr),
            pull: config.code_size,
            side: config.encoder_side,
            thumbnails: (0..data.len()).map(|_| None).collect(),
            rows: vec![0.0; data.len() * encoder.code()],
            tasks: Vec::new(),
            count: 0,
            encoder,
            params,
        })
    }

    pub(super) fn codes(&self) -> Codes<'_> {
        Codes { dims: self.encoder.code(), rows: &self.rows }
    }

    /// Codes of the photos of a batch; the others stay as they are.
    pub(super) fn begin(&mut self, data: &Dataset, batch: &Batch) -> Result<(), SystemError> {
        let mut views = batch.view.clone();
        views.sort_unstable();
        views.dedup();
        self.count = views.len();
        if self.tasks.len() < self.count {
            self.tasks.resize_with(self.count, Task::default);
        }
        for (task, view) in self.tasks.iter_mut().zip(views) {
            task.view = view as usize;
            if self.thumbnails[task.view].is_none() {
                self.thumbnails[task.view] =
                    Some(thumbnail(&*data.image(task.view)?, self.side, self.encoder.min_side()));
            }
        }
        let Self { encoder, simd, params, thumbnails, tasks, rows, .. } = self;
        tasks[..self.count].par_iter_mut().for_each(|task| {
            if let Some(thumbnail) = &thumbnails[task.view] {
                task.forward(encoder, *simd, params, thumbnail);
            }
        });
        let dims = encoder.code();
        for task in &tasks[..self.count] {
            rows[task.view * dims..][..dims].copy_from_slice(&task.code);
        }
        Ok(())
    }

    /// One step from the gradients of the pixels' codes. Returns the count of non-finite gradients.
    pub(super) fn learn(&mut self, outcome: &Outcome<'_>) -> usize {
        let (dims, batch) = (self.encoder.code(), outcome.batch);
        let Self { encoder, simd, params, thumbnails, tasks, grad, .. } = self;
        let all = &mut tasks[..self.count];
        for task in all.iter_mut() {
            task.code_bar.clear();
            task.code_bar.resize(dims, 0.0);
        }
        // Codes near 0: the mean over pixels of the mean square of their codes.
        let pull = 2.0 * self.pull / (dims * batch.len().max(1)) as f32;
        for (bars, &view) in outcome.appearance_bar.chunks_exact(dims).zip(&batch.view) {
            if let Ok(at) = all.binary_search_by_key(&(view as usize), |task| task.view) {
                let Task { code, code_bar, .. } = &mut all[at];
                for ((sum, bar), code) in code_bar.iter_mut().zip(bars).zip(code) {
                    *sum += bar + pull * *code;
                }
            }
        }
        all.par_iter_mut().for_each(|task| {
            if let Some(thumbnail) = &thumbnails[task.view] {
                task.backward(encoder, *simd, params, thumbnail);
            }
        });
        grad.fill(0.0);
        for task in all {
            grad.iter_mut().zip(&task.grad).for_each(|(sum, g)| *sum += g);
        }
        self.adam.step(outcome.simd, outcome.lr * self.lr, &mut self.params, &self.grad)
    }

    /// The code of any photo; `None` for one that is too small.
    pub(super) fn encode(&self, photo: &Image) -> Option<Vec<f32>> {
        if (photo.width.min(photo.height) as usize) < self.encoder.min_side() {
            return None;
        }
        let mut task = Task::default();
        task.forward(&self.encoder, self.simd, &self.params, &thumbnail(photo, self.side, self.encoder.min_side()));
        Some(task.code)
    }

    pub(super) fn len(&self) -> usize {
        self.params.len()
    }

    /// Bytes of parameters, moments, gradients, thumbnails and codes.
    pub(super) fn bytes(&self) -> usize {
        let thumbnails: usize = self.thumbnails.iter().flatten().map(|t| t.planes.capacity()).sum();
        let task = |t: &Task| t.x.capacity() + t.acts.capacity() + t.grad.capacity();
        thumbnails + 4 * (4 * self.params.len() + self.rows.len() + self.tasks.iter().map(task).sum::<usize>())
    }

    pub(super) fn push_state<'a>(&'a self, out: &mut Vec<Tensor<'a>>) {
        out.push(f32_tensor("encoder.network", &self.params));
        out.push(f32_tensor("encoder.codes", &self.rows));
        push_adam(out, "encoder", &self.adam);
    }

    pub(super) fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        let params = take_f32(state, "encoder.network", self.params.len())?;
        let rows = take_f32(state, "encoder.codes", self.rows.len())?;
        self.adam = take_adam(state, "encoder", &self.adam)?;
        (self.params, self.rows) = (params, rows);
        Ok(())
    }
}

/// A photo at `side` pixels along its longer side, and at least `least` along the other. What a mask ignores and what is
/// transparent is grey: it has no light.
fn thumbnail(photo: &Image, side: usize, least: usize) -> Thumbnail {
    let (width, height) = (photo.width as usize, photo.height as usize);
    let longest = width.max(height).max(1);
    let [width, height] = [width, height].map(|n| ((n * side + longest / 2) / longest).max(least));
    let size = Size::one(height, width);
    let small = photo.resized(width as u32, height as u32);
    let mut planes = vec![0; 3 * size.pixels()];
    for i in 0..size.pixels() {
        let [x, y] = [i % width, i / width].map(|n| n as u32);
        let pixel = small.pixel(x, y);
        let alpha = if small.is_used(x, y) { pixel.get(3).map_or(255, |&a| u32::from(a)) } else { 0 };
        for c in 0..3 {
            let value = u32::from(pixel[c]) * alpha + 128 * (255 - alpha);
            planes[c * size.pixels() + i] = ((value + 127) / 255) as u8;
        }
    }
    Thumbnail { size, planes }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thumbnails_have_one_longest_side_and_no_side_too_small() {
        for (size, want) in
            [((640, 480), (32, 24)), ((480, 640), (24, 32)), ((20, 20), (32, 32)), ((3000, 20), (32, 16))]
        {
            let photo = Image::rgb(size.0, size.1, vec![9; (size.0 * size.1 * 3) as usize]).unwrap();
            let small = thumbnail(&photo, 32, 16);
            assert_eq!((small.size.width, small.size.height), want, "{size:?}");
            assert!(small.planes.len() == 3 * want.0 * want.1 && small.planes.iter().all(|&v| v == 9));
        }
    }

    #[test]
    fn what_is_transparent_or_ignored_is_grey() {
        let mut photo = Image::rgba(16, 16, [200, 100, 0, 0].repeat(256)).unwrap();
        assert!(thumbnail(&photo, 16, 16).planes.iter().all(|&v| v == 128));
        photo.data = [200, 100, 0, 255].repeat(256);
        let planes = thumbnail(&photo, 16, 16).planes;
        assert_eq!([planes[0], planes[256], planes[512]], [200, 100, 0]);
        photo.mask = Some(vec![0; 256]);
        assert!(thumbnail(&photo, 16, 16).planes.iter().all(|&v| v == 128));
    }
}

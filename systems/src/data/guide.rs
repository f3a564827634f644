//! Mask-guided rays (EndoNeRF, section 2.2): pixels under a tool are never drawn, and what tools often hide is drawn more often
//! where it is seen.

use super::batch::Drawn;
use super::{Batch, Dataset};
use field_core::rng::Rng;
use render_core::importance::{HiddenCounts, Sampler};
use scene_io::SceneError;

/// Stream of random numbers.
const GUIDED: u64 = 0x6775_6964;

/// How often each pixel of each training view is drawn. All views have the same size.
pub struct Guide {
    sampler: Sampler,
    /// `[height][width]`
    boost: Vec<f32>,
    /// `[views][height][width]`: whether a pixel is seen.
    seen: Vec<bool>,
}

impl Guide {
    /// From the ignore masks of the views. `None` where there is none, where views differ in size, or where everything is
    /// masked.
    ///
    /// # Errors
    /// [`SceneError`] when an image cannot be read.
    #[expect(clippy::missing_panics_doc, reason = "all masks are as large as the first, and weights are 0 or 1 to 2")]
    pub fn of(data: &Dataset) -> Result<Option<Self>, SceneError> {
        let Some(first) = data.views().first() else { return Ok(None) };
        let size = (first.camera.width, first.camera.height);
        if data.views().iter().any(|v| (v.camera.width, v.camera.height) != size) {
            return Ok(None);
        }
        let pixels = (size.0 * size.1) as usize;
        let (mut counts, mut seen, mut masks) = (HiddenCounts::new(pixels), Vec::new(), 0);
        for i in 0..data.len() {
            let image = data.image(i)?;
            let mask: Vec<u8> = match &image.mask {
                Some(mask) => mask.iter().map(|&m| if m >= 128 { 255 } else { 0 }).collect(),
                None => vec![255; pixels],
            };
            masks += usize::from(image.mask.is_some());
            counts.add(&mask).expect("as large as the first");
            seen.extend(mask.iter().map(|&m| m != 0));
        }
        let boost = counts.boost();
        let weight = |i: usize| if seen[i] { boost[i % pixels] } else { 0.0 };
        let sampler = Sampler::new(seen.len(), weight).expect("weights of 0 or 1 to 2");
        Ok((masks > 0 && sampler.total() > 0.0).then_some(Self { sampler, boost, seen }))
    }

    fn draw(&self, u: f64) -> Option<(usize, usize)> {
        let pixels = self.boost.len();
        let weight = |i: usize| if self.seen[i] { self.boost[i % pixels] } else { 0.0 };
        self.sampler.draw(u, weight).map(|i| (i / pixels, i % pixels))
    }
}

impl Dataset {
    /// [`Dataset::draw`] as a guide says. Where the views do not all fit in the image memory, those of the window are drawn
    /// from as without a guide: masks keep pixels under a tool out all the same.
    ///
    /// # Errors
    /// [`SceneError`] when an image cannot be read.
    pub fn draw_guided(
        &self,
        seed: u64,
        step: u64,
        n: usize,
        guide: &Guide,
        batch: &mut Batch,
    ) -> Result<(), SceneError> {
        if !self.fits {
            return self.draw(seed, step, n, batch);
        }
        batch.resize(n);
        self.ready(seed, step, batch)?;
        let Some(images) = self.resident.get() else { return self.draw(seed, step, n, batch) };
        let rng = Rng::new(seed, GUIDED).substream(step);
        batch.fill(|i, _| {
            let u = (rng.u64_at(i) >> 11) as f64 / (1_u64 << 53) as f64;
            guide.draw(u).map_or_else(Drawn::default, |(v, at)| {
                let width = self.views[v].camera.width as usize;
                self.pixel(v, &images[v], (at % width) as u32, (at / width) as u32)
            })
        });
        Ok(())
    }
}

//! Mask-guided rays (EndoNeRF): pixels under a tool are never drawn, and what tools often hide is drawn more often
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

    /// Number of views of which nothing is seen: none of their pixels is ever drawn.
    #[must_use]
    pub fn hidden_views(&self) -> usize {
        self.seen.chunks(self.boost.len().max(1)).filter(|view| !view.contains(&true)).count()
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
    ///
    /// # Panics
    /// If `guide` is of other views.
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

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::camera::Camera;
    use render_core::pose::Pose;
    use scene_io::synthetic::{TabletopOptions, tabletop};
    use scene_io::{Frame, Image, ImageSource, ImageStore, Scene, StoreOptions};
    use std::sync::Arc;

    const SIDE: u32 = 3;

    /// Photos of `sides` pixels a side; each with the pixels a mask hides, if it has one.
    fn data(photos: &[(u32, Option<&[usize]>)]) -> Dataset {
        let frame = |(i, &(side, hidden)): (usize, &(u32, Option<&[usize]>))| {
            let n = (side * side) as usize;
            let mut image = Image::rgb(side, side, vec![100; 3 * n]).unwrap();
            image.mask = hidden.map(|hidden| (0..n).map(|k| if hidden.contains(&k) { 0 } else { 255 }).collect());
            let camera = Camera::pinhole(side, side, 3.0, 3.0, 1.5, 1.5, Pose::IDENTITY);
            Frame::new(format!("{i}"), ImageSource::Memory(Arc::new(image)), camera)
        };
        let frames: Vec<Frame> = photos.iter().enumerate().map(frame).collect();
        let scene = Scene { frames, ..tabletop(&TabletopOptions { train: 0, test: 0, ..Default::default() }) };
        let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
        Dataset::new(&scene, store, (0..photos.len()).collect()).unwrap()
    }

    #[test]
    fn pixels_under_a_tool_are_never_drawn_and_the_others_by_their_importance() {
        // Pixel 0 is hidden in two photos, pixel 4 in one, the others never.
        let masks: [&[usize]; 3] = [&[0, 4], &[0], &[]];
        let data = data(&masks.map(|hidden| (SIDE, Some(hidden))));
        let guide = Guide::of(&data).unwrap().unwrap();
        assert_eq!(guide.hidden_views(), 0);
        // V = M (1 + K / |K|) with K = 2, 1, 0 ...
        let length = 5.0_f64.sqrt();
        let v = |view: usize, k: usize| match k {
            _ if masks[view].contains(&k) => 0.0,
            0 => 1.0 + 2.0 / length,
            4 => 1.0 + 1.0 / length,
            _ => 1.0,
        };
        let total: f64 = (0..3).flat_map(|view| (0..9).map(move |k| v(view, k))).sum();
        let (mut batch, n, mut counts) = (Batch::default(), 20_000, [[0_u32; 9]; 3]);
        for step in 0..5 {
            data.draw_guided(7, step, n, &guide, &mut batch).unwrap();
            assert!(batch.len() == n && batch.weight.iter().all(|&w| w == 1.0));
            for (view, [x, y]) in batch.view.iter().zip(&batch.pixel) {
                counts[*view as usize][usize::from(*y) * 3 + usize::from(*x)] += 1;
            }
        }
        let n = 5.0 * n as f64;
        for (view, counts) in counts.iter().enumerate() {
            for (k, &count) in counts.iter().enumerate() {
                let want = n * v(view, k) / total;
                // Five standard deviations.
                assert!((f64::from(count) - want).abs() <= 5.0 * want.sqrt(), "photo {view}, {k}: {count} for {want}");
            }
        }
        let mut again = Batch::default();
        data.draw_guided(7, 4, 20_000, &guide, &mut again).unwrap();
        assert!(again.pixel == batch.pixel && again.view == batch.view, "a function of seed and step");
    }

    #[test]
    fn draws_are_not_guided_where_there_is_no_mask_or_nothing_but_masks() {
        let everything: Vec<usize> = (0..9).collect();
        let of = |photos: &[(u32, Option<&[usize]>)]| Guide::of(&data(photos)).unwrap();
        assert!(of(&[]).is_none());
        assert!(of(&[(SIDE, None), (SIDE, None)]).is_none());
        assert!(of(&[(SIDE, Some(&everything)), (SIDE, Some(&everything))]).is_none());
        assert!(of(&[(SIDE, Some(&[1])), (SIDE + 1, Some(&[1]))]).is_none(), "no pixel is that of another size");
        // A mask that hides nothing is a mask.
        let all = of(&[(SIDE, Some(&[])), (SIDE, None)]).unwrap();
        assert!(all.boost.iter().all(|&b| b == 1.0) && all.seen.iter().all(|&s| s));
        let once = of(&[(SIDE, Some(&everything)), (SIDE, None)]).unwrap();
        assert_eq!(once.hidden_views(), 1);
        let shows = data(&[(SIDE, Some(&everything)), (SIDE, None)]);
        let mut batch = Batch::default();
        shows.draw_guided(1, 0, 200, &once, &mut batch).unwrap();
        assert!(batch.view.iter().all(|&view| view == 1));
    }
}

//! Random training pixels: one by one.

use super::Dataset;
use field_core::rng::Rng;
use glam::DVec3;
use rayon::prelude::*;
use render_core::camera::Camera;
use render_core::ray::Ray;
use scene_io::{Image, SceneError};
use std::sync::Arc;

/// Rays of one task: fixed, so that the batch does not depend on the number of threads.
pub(super) const CHUNK: usize = 1024;

/// Draws tried for one ray before it is given weight 0: pixels a mask ignores and pixels the lens has no ray for are
/// drawn again, which keeps the batch uniform over the usable pixels.
const ATTEMPTS: u64 = 8;

/// Steps one set of views is drawn from when not all views fit in memory; then one of them is replaced.
const STEPS_PER_WINDOW: u64 = 16;

/// Random streams: pixels of a step are substream `step` of one, the view order of a round substream `round` of the other.
const PIXELS: u64 = 0x0070_6978_656c;
const VIEWS: u64 = 0x0076_6965_7773;
const PLACES: u64 = 0x706c_6163_6573;

/// Which pixels a batch is drawn from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DrawnFrom<'a> {
    /// Views of the dataset, each as likely as the other; `None`: all, each as likely as its share of the pixels. Where they do not all
    /// fit into memory, each of those in memory is as likely as the other.
    pub views: Option<&'a [u32]>,
    /// The middle of each photo: this share of its columns and of its rows, at least one of each. `None`: all of the photo.
    pub middle: Option<f64>,
}

impl DrawnFrom<'_> {
    /// All pixels of all views.
    pub const ALL: Self = Self { views: None, middle: None };

    /// Column and row of a photo for a uniform number.
    fn within(self, camera: &Camera, u: u64) -> (u32, u32) {
        let [[left, width], [top, height]] = [camera.width, camera.height].map(|side| self.span(side));
        let (x, y) = split(scale(u, u64::from(width) * u64::from(height)), width);
        (left + x, top + y)
    }

    /// Where the drawn part of a side begins, and how long it is.
    fn span(self, side: u32) -> [u32; 2] {
        let Some(share) = self.middle else { return [0, side] };
        let length = ((share * f64::from(side)).round() as u32).clamp(1, side.max(1));
        [side.saturating_sub(length) / 2, length]
    }
}

/// A batch of training pixels, one entry a ray. Reused from step to step.
#[derive(Clone, Debug, Default)]
pub struct Batch {
    /// Rays in the scene's frame.
    pub rays: Vec<Ray>,
    /// Straight (not premultiplied) colour in `[0, 1]`.
    pub rgb: Vec<[f32; 3]>,
    /// Opacity of the pixel, 1 for images without alpha.
    pub alpha: Vec<f32>,
    /// The area of the pixel ([`View::pixel_area`](super::View::pixel_area)), 1 unless images are trained on at several scales; 0 for a ray that must
    /// not count: ignored by a mask, or without a ray through the lens.
    pub weight: Vec<f32>,
    /// View of the dataset.
    pub view: Vec<u32>,
    /// Column and row.
    pub pixel: Vec<[u16; 2]>,
    /// Where the pixel's centre is in its photo, as a share of width and height.
    pub place: Vec<[f32; 2]>,
    /// Decoded images of the current window of views, when not all fit in memory.
    pub(super) pool: Vec<(u32, Arc<Image>)>,
    /// Scratch: keys and views of one round.
    order: Vec<(u64, u32)>,
    /// What `pool` was filled for: seed and window.
    pool_key: Option<(u64, u64)>,
}

impl Batch {
    /// The colours over what is behind each, written to `out`.
    pub fn over(&self, behind: impl IntoIterator<Item = [f32; 3]>, out: &mut Vec<[f32; 3]>) {
        out.clear();
        let pixels = self.rgb.iter().zip(&self.alpha).zip(behind);
        out.extend(pixels.map(|((rgb, alpha), behind)| [0, 1, 2].map(|c| rgb[c] * alpha + behind[c] * (1.0 - alpha))));
    }

    /// Number of rays.
    pub fn len(&self) -> usize {
        self.rays.len()
    }

    /// Whether the batch holds no ray.
    pub fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    /// Rays with their colours that belong to no view but the first.
    ///
    /// # Panics
    /// If there are not as many colours as rays.
    #[must_use]
    pub fn of_rays(rays: &[Ray], rgb: &[[f32; 3]]) -> Self {
        let mut batch = Self::default();
        batch.resize(rays.len());
        batch.rays.copy_from_slice(rays);
        batch.rgb.copy_from_slice(rgb);
        batch.alpha.fill(1.0);
        batch.weight.fill(1.0);
        batch
    }

    pub(super) fn resize(&mut self, n: usize) {
        self.rays.resize(n, Ray { o: DVec3::ZERO, d: DVec3::Z });
        self.rgb.resize(n, [0.0; 3]);
        self.alpha.resize(n, 0.0);
        self.weight.resize(n, 0.0);
        self.view.resize(n, 0);
        self.pixel.resize(n, [0; 2]);
        self.place.resize(n, [0.0; 2]);
    }

    /// Write every entry `i` as `draw(i, pool)`.
    pub(super) fn fill(&mut self, draw: impl Fn(u64, &[(u32, Arc<Image>)]) -> Drawn + Sync) {
        let Self { rays, rgb, alpha, weight, view, pixel, place, pool, .. } = self;
        let pool = &pool[..];
        let colours = rgb.par_chunks_mut(CHUNK).zip(alpha.par_chunks_mut(CHUNK)).zip(weight.par_chunks_mut(CHUNK));
        let views = rays.par_chunks_mut(CHUNK).zip(view.par_chunks_mut(CHUNK));
        let places = views.zip(pixel.par_chunks_mut(CHUNK)).zip(place.par_chunks_mut(CHUNK));
        colours.zip(places).enumerate().for_each(
            |(chunk, (((rgb, alpha), weight), (((rays, view), pixel), place)))| {
                for k in 0..rays.len() {
                    let drawn = draw((chunk * CHUNK + k) as u64, pool);
                    rays[k] = drawn.ray;
                    rgb[k] = drawn.rgb;
                    alpha[k] = drawn.alpha;
                    weight[k] = drawn.weight;
                    view[k] = drawn.view;
                    pixel[k] = drawn.pixel;
                    place[k] = drawn.place;
                }
            },
        );
    }
}

impl Dataset {
    /// Fill `batch` with the `n` training pixels of step `step`: a function of `seed`, `step` and `n` alone, whatever
    /// the number of threads. No allocation once `batch` has held `n` rays.
    ///
    /// Uniform over all usable pixels of all views when the views fit in the image memory. Otherwise uniform over a
    /// window of views, of which one is replaced every 16 steps, each view coming once before any comes twice. An empty
    /// dataset gives an empty batch.
    ///
    /// # Errors
    /// [`SceneError`] when an image cannot be read.
    pub fn draw(&self, seed: u64, step: u64, n: usize, batch: &mut Batch) -> Result<(), SceneError> {
        self.draw_from(seed, step, n, DrawnFrom::ALL, batch)
    }

    /// [`Dataset::draw`] from some of the views only, each as likely as the other: see [`Dataset::draw_from`].
    ///
    /// # Errors
    /// As [`Dataset::draw`].
    ///
    /// # Panics
    /// When one of `views` does not exist.
    pub fn draw_among(
        &self,
        seed: u64,
        step: u64,
        n: usize,
        views: Option<&[u32]>,
        batch: &mut Batch,
    ) -> Result<(), SceneError> {
        self.draw_from(seed, step, n, DrawnFrom { views, middle: None }, batch)
    }

    /// [`Dataset::draw`] from some of the pixels only. Where not all views fit in the image memory, the window comes from all of
    /// them, and from the views that are asked for those that are in it, if any.
    ///
    /// # Errors
    /// As [`Dataset::draw`].
    ///
    /// # Panics
    /// When one of the views does not exist.
    pub fn draw_from(
        &self,
        seed: u64,
        step: u64,
        n: usize,
        from: DrawnFrom<'_>,
        batch: &mut Batch,
    ) -> Result<(), SceneError> {
        if self.views.is_empty() {
            batch.resize(0);
            return Ok(());
        }
        batch.resize(n);
        self.ready(seed, step, batch)?;
        let rng = self.pixels_of(seed, step);
        batch.fill(|i, pool| self.draw_one(&rng, i, pool, from));
        Ok(())
    }

    /// `side^2` rays of each pixel of a batch, one at a random place in each of as many equal squares of the pixel; for
    /// `side = 1` the ray through its centre. Written over `out`, `[pixels * side^2]`.
    ///
    /// # Panics
    /// If `batch` is of other views than these, or has a view that is not there.
    pub fn spread(&self, seed: u64, step: u64, side: u32, batch: &Batch, out: &mut Vec<Ray>) {
        let k = (side * side) as usize;
        out.resize(batch.len() * k, Ray { o: DVec3::ZERO, d: DVec3::Z });
        if side == 1 {
            out.copy_from_slice(&batch.rays);
            return;
        }
        let rng = Rng::new(seed, PLACES).substream(step);
        out.par_chunks_mut(CHUNK * k).enumerate().for_each(|(chunk, out)| {
            for (i, rays) in (chunk * CHUNK..).zip(out.chunks_exact_mut(k)) {
                let (view, [x, y]) = (&self.views[batch.view[i] as usize], batch.pixel[i].map(u32::from));
                for (j, ray) in rays.iter_mut().enumerate() {
                    let u = rng.block_at((i * k + j) as u64);
                    let cell = [j as u32 % side, j as u32 / side];
                    let offset = [0, 1].map(|a| {
                        let within = f64::from(u[a]) / 4_294_967_296.0;
                        (f64::from(cell[a]) + within) / f64::from(side) - 0.5
                    });
                    // A pixel that does not count keeps whatever ray it has.
                    *ray = view.ray_within(x, y, offset).unwrap_or(batch.rays[i]);
                }
            }
        });
    }

    /// Random numbers of the pixels of a step.
    pub(super) fn pixels_of(&self, seed: u64, step: u64) -> Rng {
        Rng::new(seed, PIXELS).substream(step)
    }

    pub(super) fn draw_one(&self, rng: &Rng, i: u64, pool: &[(u32, Arc<Image>)], from: DrawnFrom<'_>) -> Drawn {
        let mut drawn = Drawn::default();
        for attempt in 0..ATTEMPTS {
            let bits = rng.block_at(i * ATTEMPTS + attempt);
            let u = u64::from(bits[0]) << 32 | u64::from(bits[1]);
            let u_view = u64::from(bits[2]) << 32 | u64::from(bits[3]);
            let within = |camera: &Camera| from.within(camera, u);
            let (v, image, x, y) = match (self.resident.get(), from.views) {
                (Some(images), Some(views)) if !views.is_empty() => {
                    let v = views[scale(u_view, views.len() as u64) as usize] as usize;
                    let (x, y) = within(&self.views[v].camera);
                    (v, &images[v], x, y)
                }
                (Some(images), _) if from.middle.is_some() => {
                    let v = self.view_of_pixel(scale(u_view, self.pixel_count()));
                    let (x, y) = within(&self.views[v].camera);
                    (v, &images[v], x, y)
                }
                (Some(images), _) => {
                    let at = scale(u, self.pixel_count());
                    let v = self.view_of_pixel(at);
                    let (x, y) = split(at - self.first_pixel[v], self.views[v].camera.width);
                    (v, &images[v], x, y)
                }
                (None, views) => {
                    let open = |(v, _): &&(u32, Arc<Image>)| views.is_none_or(|views| views.contains(v));
                    let count = pool.iter().filter(open).count() as u64;
                    let chosen = pool.iter().filter(open).nth(scale(u_view, count) as usize);
                    let (v, image) = chosen.unwrap_or(&pool[scale(u_view, pool.len() as u64) as usize]);
                    let (x, y) = within(&self.views[*v as usize].camera);
                    (*v as usize, image, x, y)
                }
            };
            drawn = self.pixel(v, image, x, y);
            if drawn.weight > 0.0 {
                break;
            }
        }
        drawn
    }

    /// Pixel `(x, y)` of view `v`, whose image is `image`.
    pub(super) fn pixel(&self, v: usize, image: &Image, x: u32, y: u32) -> Drawn {
        let at = y as usize * image.width as usize + x as usize;
        let channels = usize::from(image.channels);
        let p = &image.data[at * channels..][..channels];
        let used = image.mask.as_ref().is_none_or(|mask| mask[at] >= 128);
        let view = &self.views[v];
        let ray = view.ray(x, y);
        Drawn {
            rgb: [p[0], p[1], p[2]].map(|c| f32::from(c) / 255.0),
            alpha: if channels == 4 { f32::from(p[3]) / 255.0 } else { 1.0 },
            weight: if used && ray.is_some() { view.pixel_area() } else { 0.0 },
            view: v as u32,
            pixel: [x as u16, y as u16],
            place: [(x, image.width), (y, image.height)].map(|(at, size)| (at as f32 + 0.5) / size as f32),
            // A ray that does not count still has to be a ray.
            ray: ray.unwrap_or(Ray { o: view.camera.pose.c, d: view.camera.optical_axis() }),
        }
    }

    /// Decode what the steps around `step` draw from, where that is not done yet.
    pub(super) fn ready(&self, seed: u64, step: u64, batch: &mut Batch) -> Result<(), SceneError> {
        if self.fits { self.decode() } else { self.fill_pool(seed, step / STEPS_PER_WINDOW, batch) }
    }

    /// A view that is in memory and its image: as likely as its share of the pixels, or as any other of the pool.
    pub(super) fn view_at<'a>(&'a self, u: u64, pool: &'a [(u32, Arc<Image>)]) -> (usize, &'a Image) {
        match self.resident.get() {
            Some(images) => {
                let v = self.view_of_pixel(scale(u, self.pixel_count()));
                (v, &images[v])
            }
            None => {
                let (v, image) = &pool[scale(u, pool.len() as u64) as usize];
                (*v as usize, image)
            }
        }
    }

    fn view_of_pixel(&self, at: u64) -> usize {
        self.first_pixel.partition_point(|&first| first <= at) - 1
    }

    /// Decode the views of window `window` into the batch's pool; does nothing when it holds them.
    fn fill_pool(&self, seed: u64, window: u64, batch: &mut Batch) -> Result<(), SceneError> {
        if batch.pool_key == Some((seed, window)) {
            return Ok(());
        }
        batch.pool_key = None;
        batch.pool.clear();
        let n = self.views.len() as u64;
        let places = window..window + self.window_views;
        for round in places.start / n..=(places.end - 1) / n {
            // An endless sequence of rounds, each all views in the order of the round's random keys.
            let rng = Rng::new(seed, VIEWS).substream(round);
            batch.order.clear();
            batch.order.extend((0..n).map(|v| (rng.u64_at(v), v as u32)));
            batch.order.sort_unstable();
            for (place, &(_, v)) in (round * n..).zip(&batch.order) {
                if places.contains(&place) {
                    batch.pool.push((v, self.read(&self.views[v as usize])?));
                }
            }
        }
        batch.pool_key = Some((seed, window));
        Ok(())
    }
}

/// One drawn pixel.
#[derive(Clone, Copy)]
pub(super) struct Drawn {
    ray: Ray,
    pub(super) rgb: [f32; 3],
    pub(super) alpha: f32,
    pub(super) weight: f32,
    view: u32,
    pixel: [u16; 2],
    place: [f32; 2],
}

impl Default for Drawn {
    fn default() -> Self {
        let ray = Ray { o: DVec3::ZERO, d: DVec3::Z };
        Self { ray, rgb: [0.0; 3], alpha: 0.0, weight: 0.0, view: 0, pixel: [0; 2], place: [0.0; 2] }
    }
}

/// A uniform 64-bit number to a uniform number below `n`.
fn scale(u: u64, n: u64) -> u64 {
    ((u128::from(u) * u128::from(n)) >> 64) as u64
}

fn split(at: u64, width: u32) -> (u32, u32) {
    ((at % u64::from(width)) as u32, (at / u64::from(width)) as u32)
}

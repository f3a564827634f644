//! Views of one split at training resolution, and the random ray batches drawn from them.
//!
//! Images stay 8 bit. A view costs its pixels (3 or 4 bytes each, one more with a mask) while it is decoded; lenses with
//! distortion add 12 bytes a pixel for a table of directions, shared by all views with equal intrinsics. Pinhole
//! directions are computed.

use field_core::rng::Rng;
use glam::DVec3;
use rayon::prelude::*;
use render_core::camera::{Camera, RayTable};
use render_core::ray::Ray;
use scene_io::{Image, ImageStore, Scene, SceneError};
use std::sync::{Arc, OnceLock};

/// Rays of one task: fixed, so that the batch does not depend on the number of threads.
const CHUNK: usize = 1024;

/// Draws tried for one ray before it is given weight 0: pixels a mask ignores and pixels the lens has no ray for are
/// drawn again, which keeps the batch uniform over the usable pixels.
const ATTEMPTS: u64 = 8;

/// Steps one set of views is drawn from when not all views fit in memory; then one of them is replaced.
const STEPS_PER_WINDOW: u64 = 16;

/// Random streams: pixels of a step are substream `step` of one, the view order of a round substream `round` of the other.
const PIXELS: u64 = 0x0070_6978_656c;
const VIEWS: u64 = 0x0076_6965_7773;

/// One view of a [`Dataset`].
#[derive(Clone, Debug)]
pub struct View {
    /// Index into [`Scene::frames`].
    pub frame: usize,
    /// Name of the frame.
    pub name: String,
    /// Camera at training resolution.
    pub camera: Camera,
    /// Directions of a lens with distortion, shared by views with equal intrinsics.
    table: Option<Arc<RayTable>>,
}

impl View {
    /// Ray through the centre of pixel `(x, y)`, or `None` where the lens has no preimage.
    ///
    /// # Panics
    /// When the pixel lies outside the image.
    pub fn ray(&self, x: u32, y: u32) -> Option<Ray> {
        let camera = &self.camera;
        assert!(x < camera.width && y < camera.height, "pixel ({x}, {y}) of a {}x{} view", camera.width, camera.height);
        match &self.table {
            Some(table) => table.ray(&camera.pose, x, y),
            None => {
                let (x, y) = (f64::from(x) + 0.5, f64::from(y) + 0.5);
                let d = DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
                Some(Ray { o: camera.pose.c, d: (camera.pose.r * d).normalize() })
            }
        }
    }

    /// Rays of all pixels of the rows `rows`, row by row; `None` where the lens has no preimage.
    pub fn rays(&self, rows: std::ops::Range<u32>) -> impl Iterator<Item = Option<Ray>> + '_ {
        rows.flat_map(move |y| (0..self.camera.width).map(move |x| self.ray(x, y)))
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
    /// 1, or 0 for a ray that must not count: ignored by a mask, or without a ray through the lens.
    pub weight: Vec<f32>,
    /// View of the dataset.
    pub view: Vec<u32>,
    /// Column and row.
    pub pixel: Vec<[u16; 2]>,
    /// Decoded images of the current window of views, when not all fit in memory.
    pool: Vec<(u32, Arc<Image>)>,
    /// Scratch: keys and views of one round.
    order: Vec<(u64, u32)>,
    /// What `pool` was filled for: seed and window.
    pool_key: Option<(u64, u64)>,
}

impl Batch {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.rays.len()
    }

    /// Whether the batch holds no ray.
    pub fn is_empty(&self) -> bool {
        self.rays.is_empty()
    }

    fn resize(&mut self, n: usize) {
        self.rays.resize(n, Ray { o: DVec3::ZERO, d: DVec3::Z });
        self.rgb.resize(n, [0.0; 3]);
        self.alpha.resize(n, 0.0);
        self.weight.resize(n, 0.0);
        self.view.resize(n, 0);
        self.pixel.resize(n, [0; 2]);
    }
}

/// Views of one split at training resolution.
pub struct Dataset {
    views: Vec<View>,
    store: Arc<ImageStore>,
    /// Whether all images fit in the store's memory.
    fits: bool,
    /// All images, decoded at the first draw, where they fit.
    resident: OnceLock<Vec<Arc<Image>>>,
    /// Views a window holds when they do not fit.
    window_views: u64,
    /// `first_pixel[v]` is the number of pixels of the views before `v`; one entry more than views.
    first_pixel: Vec<u64>,
}

impl Dataset {
    /// The frames `frames` of `scene`, to be decoded through `store`, a store of all frames of the scene.
    ///
    /// # Errors
    /// None today; kept so that reading ahead may fail.
    ///
    /// # Panics
    /// When an index in `frames` is not one of `scene.frames`.
    pub fn new(scene: &Scene, store: Arc<ImageStore>, frames: Vec<usize>) -> Result<Self, SceneError> {
        let mut tables: Vec<(Camera, Arc<RayTable>)> = Vec::new();
        let mut views = Vec::with_capacity(frames.len());
        let (mut bytes, mut largest) = (0, 0);
        for &frame in &frames {
            let camera = *store.camera(frame);
            let table = (!camera.lens.is_pinhole()).then(|| {
                let known = tables.iter().find(|(c, _)| c.same_optics(&camera)).map(|(_, table)| table.clone());
                known.unwrap_or_else(|| {
                    let table = Arc::new(RayTable::new(&camera));
                    tables.push((camera, table.clone()));
                    table
                })
            });
            let size = store.bytes(frame);
            bytes += size;
            largest = largest.max(size);
            views.push(View { frame, name: scene.frames[frame].name.clone(), camera, table });
        }
        let mut first_pixel = vec![0];
        for view in &views {
            let pixels = u64::from(view.camera.width) * u64::from(view.camera.height);
            first_pixel.push(first_pixel[first_pixel.len() - 1] + pixels);
        }
        let fits = bytes <= store.budget_bytes();
        let window = store.budget_bytes().checked_div(largest).unwrap_or(0).clamp(1, views.len().max(1) as u64);
        Ok(Self { views, store, fits, resident: OnceLock::new(), window_views: window, first_pixel })
    }

    /// Decode all views, in parallel, where they fit in the store's memory; the first [`Dataset::draw`] does it otherwise.
    ///
    /// # Errors
    /// [`SceneError`] of the first image that cannot be read.
    pub fn decode(&self) -> Result<(), SceneError> {
        if self.fits && self.resident.get().is_none() {
            let decoded: Vec<_> = self.views.par_iter().map(|view| self.store.get(view.frame)).collect();
            // Another thread may have been faster: it has the same pixels.
            let _ = self.resident.set(decoded.into_iter().collect::<Result<_, _>>()?);
        }
        Ok(())
    }

    /// Number of views.
    pub fn len(&self) -> usize {
        self.views.len()
    }

    /// Whether there is no view.
    pub fn is_empty(&self) -> bool {
        self.views.is_empty()
    }

    /// The views, in the order of the frames given.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// View `i`.
    ///
    /// # Panics
    /// When there is no such view.
    pub fn view(&self, i: usize) -> &View {
        &self.views[i]
    }

    /// Pixels of view `i`.
    ///
    /// # Errors
    /// [`SceneError`] when the image cannot be read.
    ///
    /// # Panics
    /// When there is no such view.
    pub fn image(&self, i: usize) -> Result<Arc<Image>, SceneError> {
        match self.resident.get() {
            Some(images) => Ok(images[i].clone()),
            None => self.store.get(self.views[i].frame),
        }
    }

    /// Ray through the centre of a pixel of view `i`, or `None` where the lens has no preimage.
    ///
    /// # Panics
    /// When there is no such view or pixel.
    pub fn ray(&self, i: usize, x: u32, y: u32) -> Option<Ray> {
        self.views[i].ray(x, y)
    }

    /// Pixels of all views.
    pub fn pixel_count(&self) -> u64 {
        self.first_pixel[self.views.len()]
    }

    /// Bytes the decoded views may take at one time, with the direction tables.
    pub fn memory_bytes(&self) -> u64 {
        let images: u64 = self.views.iter().map(|view| self.store.bytes(view.frame)).sum();
        let images = images.min(self.store.budget_bytes());
        let mut tables: Vec<_> = self.views.iter().filter_map(|v| v.table.as_ref()).collect();
        tables.sort_by_key(|t| Arc::as_ptr(t));
        tables.dedup_by_key(|t| Arc::as_ptr(t));
        images + tables.iter().map(|t| t.directions().len() as u64 * 12).sum::<u64>()
    }

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
        if self.views.is_empty() {
            batch.resize(0);
            return Ok(());
        }
        batch.resize(n);
        if self.fits {
            self.decode()?;
        } else {
            self.fill_pool(seed, step / STEPS_PER_WINDOW, batch)?;
        }
        let rng = Rng::new(seed, PIXELS).substream(step);
        let Batch { rays, rgb, alpha, weight, view, pixel, pool, .. } = batch;
        let pool = &pool[..];
        let colours = rgb.par_chunks_mut(CHUNK).zip(alpha.par_chunks_mut(CHUNK)).zip(weight.par_chunks_mut(CHUNK));
        let places = rays.par_chunks_mut(CHUNK).zip(view.par_chunks_mut(CHUNK)).zip(pixel.par_chunks_mut(CHUNK));
        colours.zip(places).enumerate().for_each(|(chunk, (((rgb, alpha), weight), ((rays, view), pixel)))| {
            for k in 0..rays.len() {
                let i = (chunk * CHUNK + k) as u64;
                let drawn = self.draw_one(&rng, i, pool);
                rays[k] = drawn.ray;
                rgb[k] = drawn.rgb;
                alpha[k] = drawn.alpha;
                weight[k] = drawn.weight;
                view[k] = drawn.view;
                pixel[k] = drawn.pixel;
            }
        });
        Ok(())
    }

    fn draw_one(&self, rng: &Rng, i: u64, pool: &[(u32, Arc<Image>)]) -> Drawn {
        let mut drawn = Drawn::default();
        for attempt in 0..ATTEMPTS {
            let bits = rng.block_at(i * ATTEMPTS + attempt);
            let u = u64::from(bits[0]) << 32 | u64::from(bits[1]);
            let (v, image, x, y) = match self.resident.get() {
                Some(images) => {
                    let at = scale(u, self.pixel_count());
                    let v = self.first_pixel.partition_point(|&first| first <= at) - 1;
                    let (x, y) = split(at - self.first_pixel[v], self.views[v].camera.width);
                    (v, &images[v], x, y)
                }
                None => {
                    let u_view = u64::from(bits[2]) << 32 | u64::from(bits[3]);
                    let (v, image) = &pool[scale(u_view, pool.len() as u64) as usize];
                    let camera = &self.views[*v as usize].camera;
                    let (x, y) = split(scale(u, u64::from(camera.width) * u64::from(camera.height)), camera.width);
                    (*v as usize, image, x, y)
                }
            };
            let at = y as usize * image.width as usize + x as usize;
            let channels = usize::from(image.channels);
            let p = &image.data[at * channels..][..channels];
            let used = image.mask.as_ref().is_none_or(|mask| mask[at] >= 128);
            let ray = self.views[v].ray(x, y);
            drawn = Drawn {
                rgb: [p[0], p[1], p[2]].map(|c| f32::from(c) / 255.0),
                alpha: if channels == 4 { f32::from(p[3]) / 255.0 } else { 1.0 },
                weight: if used && ray.is_some() { 1.0 } else { 0.0 },
                view: v as u32,
                pixel: [x as u16, y as u16],
                // A ray that does not count still has to be a ray.
                ray: ray.unwrap_or(Ray { o: self.views[v].camera.pose.c, d: self.views[v].camera.optical_axis() }),
            };
            if drawn.weight > 0.0 {
                break;
            }
        }
        drawn
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
                    batch.pool.push((v, self.store.get(self.views[v as usize].frame)?));
                }
            }
        }
        batch.pool_key = Some((seed, window));
        Ok(())
    }
}

/// One drawn pixel.
#[derive(Clone, Copy)]
struct Drawn {
    ray: Ray,
    rgb: [f32; 3],
    alpha: f32,
    weight: f32,
    view: u32,
    pixel: [u16; 2],
}

impl Default for Drawn {
    fn default() -> Self {
        let ray = Ray { o: DVec3::ZERO, d: DVec3::Z };
        Self { ray, rgb: [0.0; 3], alpha: 0.0, weight: 0.0, view: 0, pixel: [0; 2] }
    }
}

/// A uniform 64-bit number to a uniform number below `n`.
fn scale(u: u64, n: u64) -> u64 {
    ((u128::from(u) * u128::from(n)) >> 64) as u64
}

fn split(at: u64, width: u32) -> (u32, u32) {
    ((at % u64::from(width)) as u32, (at / u64::from(width)) as u32)
}

//! Views of one split at training resolution, and the random ray batches drawn from them.
//!
//! Images stay 8 bit. A view costs its pixels (3 or 4 bytes each, one more with a mask) while it is decoded; lenses with
//! distortion add 12 bytes a pixel for a table of directions, shared by all views with equal intrinsics. Pinhole
//! directions are computed.

use field_core::rng::Rng;
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{Camera, Prepared, RayTable};
use render_core::ray::Ray;
use scene_io::{Image, ImageStore, Scene, SceneError};
use std::ops::Range;
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
const PLACES: u64 = 0x706c_6163_6573;

/// One view of a [`Dataset`].
#[derive(Clone, Debug)]
pub struct View {
    /// Index into [`Scene::frames`].
    pub frame: usize,
    /// Name of the frame.
    pub name: String,
    /// Camera at training resolution.
    pub camera: Camera,
    /// How often the frame was halved: the view is `1 / 2^level` of the training resolution.
    pub level: u32,
    /// Directions of a lens with distortion, shared by views with equal intrinsics.
    table: Option<Arc<RayTable>>,
    /// The same lens, for what the table does not hold.
    prepared: Option<Prepared>,
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

    /// Ray through a point of pixel `(x, y)`, `offset` from its centre in pixels, `-1/2 ..= 1/2`; `None` where the lens has
    /// no preimage. Directions of a lens with distortion are interpolated between those of pixel centres.
    ///
    /// # Panics
    /// When the pixel lies outside the image.
    pub fn ray_within(&self, x: u32, y: u32, offset: [f64; 2]) -> Option<Ray> {
        let camera = &self.camera;
        let Some(table) = &self.table else {
            assert!(x < camera.width && y < camera.height, "pixel ({x}, {y}) of a view");
            let (x, y) = (f64::from(x) + 0.5 + offset[0], f64::from(y) + 0.5 + offset[1]);
            let d = DVec3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
            return Some(Ray { o: camera.pose.c, d: (camera.pose.r * d).normalize() });
        };
        let centre = table.ray(&camera.pose, x, y)?;
        let mut d = centre.d;
        for (axis, last) in [camera.width - 1, camera.height - 1].into_iter().enumerate() {
            let at = [x, y][axis];
            let neighbour = if offset[axis] < 0.0 { at.checked_sub(1) } else { (at < last).then_some(at + 1) };
            // At the border, and beside pixels without a ray, the neighbour on the other side does.
            let (next, way) = match neighbour {
                Some(next) => (next, offset[axis].abs()),
                None if last == 0 => continue,
                None => (if at == 0 { 1 } else { at - 1 }, -offset[axis].abs()),
            };
            let (nx, ny) = if axis == 0 { (next, y) } else { (x, next) };
            if let Some(other) = table.ray(&camera.pose, nx, ny) {
                d += (other.d - centre.d) * way;
            }
        }
        Some(Ray { o: centre.o, d: d.normalize() })
    }

    /// Radius of the cone of pixel `(x, y)` at distance 1, for unit directions; see [`Prepared::cone_radius`]. `None` where
    /// the lens has no preimage.
    pub fn cone_radius(&self, x: u32, y: u32) -> Option<f64> {
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        match &self.prepared {
            Some(prepared) => prepared.cone_radius(at),
            None => {
                let Camera { fx, fy, cx, cy, .. } = self.camera;
                let v = DVec3::new((at.x - cx) / fx, (at.y - cy) / fy, 1.0);
                Some(0.5 * (1.0 / fx + 1.0 / fy) / v.length() * (2.0 / 12.0_f64.sqrt()))
            }
        }
    }

    /// Area of a pixel, in pixels of the training resolution.
    pub fn pixel_area(&self) -> f32 {
        4.0_f32.powi(self.level as i32)
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
    /// The area of the pixel ([`View::pixel_area`]), 1 unless images are trained on at several scales; 0 for a ray that must
    /// not count: ignored by a mask, or without a ray through the lens.
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
        Self::with_levels(scene, store, frames, 0..1)
    }

    /// The same, each frame once for each level: a view of level `k` is the frame's mean over squares of `2^k` pixels.
    ///
    /// All pixels of all levels are equally likely in a batch, and weigh as much as their area.
    ///
    /// # Errors
    /// As [`Dataset::new`].
    ///
    /// # Panics
    /// As [`Dataset::new`].
    pub fn with_levels(
        scene: &Scene,
        store: Arc<ImageStore>,
        frames: Vec<usize>,
        levels: Range<u32>,
    ) -> Result<Self, SceneError> {
        let frames: Vec<(usize, String)> = frames.into_iter().map(|f| (f, scene.frames[f].name.clone())).collect();
        Ok(Self::of_frames(store, &frames, levels))
    }

    /// The views of this dataset at one level; see [`Dataset::with_levels`].
    #[must_use]
    pub fn at_level(&self, level: u32) -> Self {
        let mut frames: Vec<(usize, String)> = self.views.iter().map(|v| (v.frame, v.name.clone())).collect();
        let mut seen = std::collections::HashSet::new();
        frames.retain(|(frame, _)| seen.insert(*frame));
        Self::of_frames(self.store.clone(), &frames, level..level + 1)
    }

    fn of_frames(store: Arc<ImageStore>, frames: &[(usize, String)], levels: Range<u32>) -> Self {
        let mut tables: Vec<(Camera, Arc<RayTable>, Prepared)> = Vec::new();
        let mut views = Vec::with_capacity(frames.len() * levels.len());
        for level in levels {
            for (frame, name) in frames {
                let camera = level_camera(store.camera(*frame), level);
                let lens = (!camera.lens.is_pinhole()).then(|| {
                    let known = tables.iter().find(|(c, ..)| c.same_optics(&camera)).map(|(_, t, p)| (t.clone(), *p));
                    known.unwrap_or_else(|| {
                        let (table, prepared) = (Arc::new(RayTable::new(&camera)), camera.prepare());
                        tables.push((camera, table.clone(), prepared));
                        (table, prepared)
                    })
                });
                let (table, prepared) = lens.unzip();
                views.push(View { frame: *frame, name: name.clone(), camera, level, table, prepared });
            }
        }
        let mut first_pixel = vec![0];
        for view in &views {
            let pixels = u64::from(view.camera.width) * u64::from(view.camera.height);
            first_pixel.push(first_pixel[first_pixel.len() - 1] + pixels);
        }
        let bytes = views.iter().map(|view| view_bytes(&store, view));
        let (total, largest) = bytes.fold((0, 0), |(total, largest), size| (total + size, size.max(largest)));
        let fits = total <= store.budget_bytes();
        let window = store.budget_bytes().checked_div(largest).unwrap_or(0).clamp(1, views.len().max(1) as u64);
        Self { views, store, fits, resident: OnceLock::new(), window_views: window, first_pixel }
    }

    /// Decode all views, in parallel, where they fit in the store's memory; the first [`Dataset::draw`] does it otherwise.
    ///
    /// # Errors
    /// [`SceneError`] of the first image that cannot be read.
    pub fn decode(&self) -> Result<(), SceneError> {
        if self.fits && self.resident.get().is_none() {
            let decoded: Vec<_> = self.views.par_iter().map(|view| self.read(view)).collect();
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
            None => self.read(&self.views[i]),
        }
    }

    /// Decode a view's frame, at the view's level.
    fn read(&self, view: &View) -> Result<Arc<Image>, SceneError> {
        let image = self.store.get(view.frame)?;
        Ok(match view.level {
            0 => image,
            _ => Arc::new(image.resized(view.camera.width, view.camera.height)),
        })
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
        let images: u64 = self.views.iter().map(|view| view_bytes(&self.store, view)).sum();
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

    /// `side^2` rays of each pixel of a batch, one at a random place in each of as many equal squares of the pixel; for
    /// `side = 1` the ray through its centre. Written over `out`, `[pixels * side^2]`.
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
                weight: if used && ray.is_some() { self.views[v].pixel_area() } else { 0.0 },
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
                    batch.pool.push((v, self.read(&self.views[v as usize])?));
                }
            }
        }
        batch.pool_key = Some((seed, window));
        Ok(())
    }
}

/// The camera of a level: sides halved so often, rounded down, at least 1.
fn level_camera(camera: &Camera, level: u32) -> Camera {
    match level {
        0 => *camera,
        _ => camera.resized((camera.width >> level).max(1), (camera.height >> level).max(1)),
    }
}

/// Bytes of a decoded view.
fn view_bytes(store: &ImageStore, view: &View) -> u64 {
    let full = store.camera(view.frame);
    let pixels = |c: &Camera| u64::from(c.width) * u64::from(c.height);
    (store.bytes(view.frame) * pixels(&view.camera)).div_ceil(pixels(full).max(1))
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

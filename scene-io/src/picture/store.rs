//! Images of a scene, decoded on demand and kept while there is room.

use super::Image;
use super::decode::{decode, decode_grey};
use super::plan::Plan;
use super::refusal::wrong_size;
use super::resize::{fitted, resize, resize_mask, scaling_bytes};
use crate::decode_memory::{DecodeMemory, Reserved};
use crate::perturb::Perturbation;
use crate::{AlphaMeaning, ErrorKind, Frame, ImageSource, MaskPolarity, Problem, SceneError};
use render_core::camera::Camera;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// How an [`ImageStore`] keeps images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct StoreOptions {
    /// Images are scaled down by area averaging until their longest side is at most this; `None`: native size.
    pub longest_side: Option<u32>,
    /// Decoded images kept, in bytes; the least recently used one goes first. An image larger than this is decoded
    /// anew each time it is asked for.
    pub budget_bytes: u64,
}

impl Default for StoreOptions {
    /// Native size, 2 GiB.
    fn default() -> Self {
        Self { longest_side: None, budget_bytes: 2 << 30 }
    }
}

impl StoreOptions {
    /// The same for images of another size; [`StoreOptions::longest_side`].
    #[must_use]
    pub fn with_longest_side(self, longest_side: impl Into<Option<u32>>) -> Self {
        Self { longest_side: longest_side.into(), ..self }
    }

    /// The same with another budget; [`StoreOptions::budget_bytes`].
    #[must_use]
    pub fn with_budget_bytes(self, budget_bytes: u64) -> Self {
        Self { budget_bytes, ..self }
    }
}

/// Decodes the images of a scene on demand, scales them while reading, and keeps the most recently used.
///
/// Threads may share one; what [`ImageStore::get`] returns depends on the index alone. Memory: at most
/// [`StoreOptions::budget_bytes`], plus the images callers hold, plus what [`DecodeMemory`] allows all threads together for
/// decoding.
#[derive(Debug)]
pub struct ImageStore {
    entries: Vec<Entry>,
    budget_bytes: u64,
    cache: Mutex<Cache>,
}

#[derive(Debug)]
struct Entry {
    name: String,
    image: ImageSource,
    mask: Option<(PathBuf, MaskPolarity)>,
    perturbation: Option<Arc<Perturbation>>,
    /// Whether the file's alpha says which pixels may be used.
    alpha_is_mask: bool,
    /// Camera at the size images are handed out.
    camera: Camera,
    native: (u32, u32),
    channels: u8,
}

#[derive(Debug, Default)]
struct Cache {
    images: HashMap<usize, (Arc<Image>, u64)>,
    bytes: u64,
    clock: u64,
}

impl ImageStore {
    /// A store of the images of some frames, in their order. Reads headers only.
    ///
    /// # Errors
    /// Where a header cannot be read or an image has not the size its camera says.
    pub fn new(frames: &[Frame], options: StoreOptions) -> Result<Self, SceneError> {
        let entries = frames.iter().map(|frame| Entry::new(frame, options.longest_side)).collect::<Result<_, _>>()?;
        Ok(Self { entries, budget_bytes: options.budget_bytes, cache: Mutex::default() })
    }

    /// Refuse images whose pixels alone are more than decoding may take: to be asked before anything is made of their size.
    ///
    /// # Errors
    /// [`ErrorKind::Memory`] naming the first.
    pub fn check_sizes(&self) -> Result<(), SceneError> {
        self.entries.iter().try_for_each(|entry| {
            let ImageSource::File(path) = &entry.image else { return Ok(()) };
            let (width, height) = entry.native;
            let bytes = u64::from(width).saturating_mul(height.into()).saturating_mul(entry.channels.into());
            let checked = DecodeMemory::of_process().check(path, &format!("its {width}x{height} pixels"), bytes);
            checked.map_err(|e| e.in_frame(&entry.name))
        })
    }

    /// Number of images.
    #[must_use]
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The camera of an image at the size it is handed out.
    ///
    /// # Panics
    /// If `index` is not below [`ImageStore::len`].
    #[must_use]
    pub fn camera(&self, index: usize) -> &Camera {
        &self.entries[index].camera
    }

    /// Whether a mask is the alpha of an image; see [`MaskPolarity::WhiteIsObject`].
    ///
    /// # Panics
    /// If `index` is not below [`ImageStore::len`].
    #[must_use]
    pub fn is_cut_out(&self, index: usize) -> bool {
        self.entries[index].mask_is_alpha()
    }

    /// Bytes of all images once decoded and scaled, masks included: from headers alone.
    #[must_use]
    pub fn estimate_bytes(&self) -> u64 {
        self.entries.iter().map(Entry::bytes).fold(0, u64::saturating_add)
    }

    /// Bytes of one image once decoded and scaled, its mask included.
    ///
    /// # Panics
    /// If `index` is not below [`ImageStore::len`].
    #[must_use]
    pub fn bytes(&self, index: usize) -> u64 {
        self.entries[index].bytes()
    }

    /// Bytes of decoded images that are kept at most.
    #[must_use]
    pub fn budget_bytes(&self) -> u64 {
        self.budget_bytes
    }

    /// An image, decoded now unless it is kept.
    ///
    /// # Errors
    /// Names the file and what to do where an image or mask cannot be decoded or has changed its size since the store
    /// was made.
    ///
    /// # Panics
    /// If `index` is not below [`ImageStore::len`], or a picture in memory holds less than its size says.
    pub fn get(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        let entry = &self.entries[index];
        if let Some(image) = self.lock().touch(index) {
            return Ok(image);
        }
        // Outside the lock: two threads may decode the same image, and get the same pixels.
        let (image, held) = entry.read(0).map_err(|e| e.in_frame(&entry.name))?;
        drop(held);
        let image = Arc::new(image);
        self.lock().insert(index, &image, self.budget_bytes);
        Ok(image)
    }

    /// Calls `f` with an image that is not kept. Until `f` is done the image counts as being decoded; `f` takes at most `bytes` for
    /// itself.
    pub(crate) fn with_image<T>(&self, index: usize, bytes: u64, f: impl FnOnce(&Image) -> T) -> Result<T, SceneError> {
        let entry = &self.entries[index];
        let (image, _held) = entry.read(bytes).map_err(|e| e.in_frame(&entry.name))?;
        Ok(f(&image))
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Cache> {
        // The cache is consistent after every statement, so a panic elsewhere does not spoil it.
        self.cache.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Entry {
    fn new(frame: &Frame, longest_side: Option<u32>) -> Result<Self, SceneError> {
        let (native, channels) = match &frame.image {
            ImageSource::File(path) => {
                let plan = Plan::of(path).map_err(|e| e.in_frame(&frame.name))?;
                (plan.size(), plan.channels())
            }
            ImageSource::Memory(image) => ((image.width, image.height), image.channels),
        };
        let said = (frame.camera.width, frame.camera.height);
        if said != native {
            let file = match &frame.image {
                ImageSource::File(path) => path.clone(),
                ImageSource::Memory(_) => PathBuf::from("image in memory"),
            };
            return Err(SceneError::new(ErrorKind::Image, wrong_size(&file, native, said)).in_frame(&frame.name));
        }
        let (width, height) = fitted(native.0, native.1, longest_side);
        Ok(Self {
            name: frame.name.clone(),
            image: frame.image.clone(),
            mask: frame.mask.clone().map(|path| (path, frame.mask_polarity)),
            perturbation: frame.perturbation.clone(),
            alpha_is_mask: frame.alpha == AlphaMeaning::Used && channels == 4,
            camera: frame.camera.resized(width, height),
            native,
            channels,
        })
    }

    fn bytes(&self) -> u64 {
        let pixels = u64::from(self.camera.width) * u64::from(self.camera.height);
        let has_mask = match &self.image {
            ImageSource::Memory(image) => image.mask.is_some() || self.mask.is_some(),
            ImageSource::File(_) => self.mask.is_some(),
        };
        let channels = match (self.mask_is_alpha(), self.alpha_is_mask) {
            (true, _) => 4,
            (false, true) => 3,
            (false, false) => self.channels,
        };
        let has_mask = has_mask && !(self.mask_is_alpha() && matches!(self.image, ImageSource::File(_)));
        pixels.saturating_mul(u64::from(channels) + u64::from(has_mask || self.alpha_is_mask))
    }

    fn mask_is_alpha(&self) -> bool {
        self.mask.as_ref().is_some_and(|(_, polarity)| *polarity == MaskPolarity::WhiteIsObject)
    }

    /// Bytes held at one time while the image is read, the image included; and then `beside` more.
    fn reading_bytes(&self, image: Option<&Plan>, mask: Option<&Plan>, beside: u64) -> u64 {
        let pixels = u64::from(self.native.0) * u64::from(self.native.1);
        let native = match &self.image {
            ImageSource::File(_) => pixels.saturating_mul(self.channels.into()),
            ImageSource::Memory(image) => image.bytes(),
        };
        let mask_bytes = mask.map_or(0, Plan::pixels);
        let changed = if self.alpha_is_mask || self.mask_is_alpha() { pixels.saturating_mul(4) } else { 0 };
        let scaled = if (self.camera.width, self.camera.height) == self.native {
            mask_bytes
        } else {
            self.bytes().saturating_add(scaling_bytes(self.native.0, self.camera.width))
        };
        let decoding = image.map_or(native, Plan::bytes_in_8_bit);
        // Names and other small things.
        let after = native.saturating_add(changed.max(scaled.max(beside))).saturating_add(4096);
        mask.map_or(0, Plan::bytes_in_grey).max(mask_bytes.saturating_add(decoding.max(after)))
    }

    /// The image as it is handed out, and its place in [`DecodeMemory`], which has room for `beside` more bytes.
    fn read(&self, beside: u64) -> Result<(Image, Reserved<'static>), SceneError> {
        let plan = match &self.image {
            ImageSource::File(path) => {
                let plan = Plan::of(path)?;
                if plan.size() != self.native || plan.channels() != self.channels {
                    return Err(SceneError::new(ErrorKind::Image, wrong_size(path, plan.size(), self.native)));
                }
                Some(plan)
            }
            ImageSource::Memory(_) => None,
        };
        let mask_plan = match &self.mask {
            Some((path, _)) => Some(self.mask_plan(path)?),
            None => None,
        };
        let bytes = self.reading_bytes(plan.as_ref(), mask_plan.as_ref(), beside);
        let held = match (&self.image, &plan) {
            (_, Some(plan)) => plan.reserve(bytes)?,
            _ => DecodeMemory::of_process().reserve(Path::new("image in memory"), "its pixels", bytes)?,
        };
        Ok((self.read_reserved(plan.as_ref(), mask_plan.as_ref())?, held))
    }

    /// The headers of the mask, which must have the image's shape.
    fn mask_plan(&self, path: &Path) -> Result<Plan, SceneError> {
        let plan = Plan::of(path)?;
        let (size, image) = (plan.size(), self.native);
        if !same_shape(size, image) {
            let what = format!("the mask is {}x{} and its image {}x{}", size.0, size.1, image.0, image.1);
            let remedy = "make the mask as large as the image, or give `--masks off`";
            return Err(SceneError::new(ErrorKind::Image, Problem::new(path, what, remedy)));
        }
        Ok(plan)
    }

    fn read_reserved(&self, plan: Option<&Plan>, mask: Option<&Plan>) -> Result<Image, SceneError> {
        let mut mask = match (&self.mask, mask) {
            (Some((_, polarity)), Some(plan)) => Some(read_mask(plan, *polarity)?),
            _ => None,
        };
        let mut native = match (&self.image, plan) {
            (ImageSource::File(path), Some(plan)) => {
                decode(path, plan, mask.as_ref().map(|(m, size)| (m.as_slice(), *size)))?
            }
            (ImageSource::Memory(image), _) => Image::clone(image),
            (ImageSource::File(path), None) => decode(path, &Plan::of(path)?, None)?,
        };
        if self.alpha_is_mask {
            native = alpha_to_mask(native);
        }
        if let Some(perturbation) = &self.perturbation {
            perturbation.apply(&mut native);
        }
        // Before the image is scaled: colours from around the object stay out of its rim.
        if self.mask_is_alpha()
            && let Some((mask, from)) = mask.take()
        {
            native = cut_out(native, &mask, from);
        }
        let size = (self.camera.width, self.camera.height);
        let mut image = resize(native, size.0, size.1);
        if let Some((mask, from)) = mask {
            let mask = resize_mask(&mask, from, size);
            image.mask = Some(match image.mask.take() {
                Some(own) => own.iter().zip(&mask).map(|(a, b)| *a.min(b)).collect(),
                None => mask,
            });
        }
        Ok(image)
    }
}

/// The image without alpha; where that was below one half, pixels are ignored.
fn alpha_to_mask(image: Image) -> Image {
    if image.channels != 4 {
        return image;
    }
    let mut mask: Vec<u8> = image.data.chunks_exact(4).map(|p| if p[3] >= 128 { 255 } else { 0 }).collect();
    if let Some(own) = &image.mask {
        mask.iter_mut().zip(own).for_each(|(mask, own)| *mask = (*mask).min(*own));
    }
    let data = image.data.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    Image { data, channels: 3, mask: Some(mask), ..image }
}

/// The image, transparent where `mask` (of size `from`) is below one half.
fn cut_out(image: Image, mask: &[u8], from: (u32, u32)) -> Image {
    let (w, h) = (u64::from(image.width), u64::from(image.height));
    let channels = usize::from(image.channels);
    let data = image.data.chunks_exact(channels).zip(0_u64..).flat_map(|(pixel, i)| {
        // The nearest pixel of the mask.
        let (x, y) = ((2 * (i % w) + 1) * u64::from(from.0) / (2 * w), (2 * (i / w) + 1) * u64::from(from.1) / (2 * h));
        let shown = if mask[(y * u64::from(from.0) + x) as usize] >= 128 { 255 } else { 0 };
        let alpha = pixel.get(3).map_or(shown, |own| shown.min(*own));
        [pixel[0], pixel[1], pixel[2], alpha]
    });
    Image { data: data.collect(), channels: 4, ..image }
}

/// A mask with white for what is used, at its own size.
fn read_mask(plan: &Plan, polarity: MaskPolarity) -> Result<(Vec<u8>, (u32, u32)), SceneError> {
    let (mut mask, size) = decode_grey(plan)?;
    if polarity == MaskPolarity::WhiteIsIgnored {
        for v in &mut mask {
            *v = 255 - *v;
        }
    }
    Ok((mask, size))
}

/// Whether two image sizes differ by one scale only, up to the rounding of each side to whole pixels.
pub(crate) fn same_shape(a: (u32, u32), b: (u32, u32)) -> bool {
    let ((aw, ah), (bw, bh)) = ((f64::from(a.0), f64::from(a.1)), (f64::from(b.0), f64::from(b.1)));
    if [aw, ah, bw, bh].iter().any(|x| *x < 1.0) {
        return false;
    }
    let (small, large) = if aw.max(ah) <= bw.max(bh) { ((aw, ah), (bw, bh)) } else { ((bw, bh), (aw, ah)) };
    let scale = small.0.max(small.1) / large.0.max(large.1);
    (large.0 * scale - small.0).abs() <= 1.0 && (large.1 * scale - small.1).abs() <= 1.0
}

impl Cache {
    fn touch(&mut self, index: usize) -> Option<Arc<Image>> {
        self.clock += 1;
        let (image, last) = self.images.get_mut(&index)?;
        *last = self.clock;
        Some(Arc::clone(image))
    }

    fn insert(&mut self, index: usize, image: &Arc<Image>, budget: u64) {
        let bytes = image.bytes();
        if bytes > budget || self.images.contains_key(&index) {
            return;
        }
        while self.bytes + bytes > budget {
            let Some(oldest) = self.images.iter().min_by_key(|(_, (_, last))| *last).map(|(i, _)| *i) else { break };
            if let Some((gone, _)) = self.images.remove(&oldest) {
                self.bytes -= gone.bytes();
            }
        }
        self.clock += 1;
        self.bytes += bytes;
        self.images.insert(index, (Arc::clone(image), self.clock));
    }
}

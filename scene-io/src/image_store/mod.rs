//! Images of a scene, decoded on demand and kept while there is room.

mod entry;

use crate::decode_memory::DecodeMemory;
use crate::picture::{Image, Picture};
use crate::{Frame, ImageSource, Scene, SceneError};
use entry::Entry;
use render_core::camera::Camera;
use std::collections::HashMap;
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
    /// [`ErrorKind::Memory`](crate::ErrorKind::Memory) naming the first.
    pub fn check_sizes(&self) -> Result<(), SceneError> {
        self.entries.iter().try_for_each(|entry| {
            let ImageSource::File(path) = &entry.image else { return Ok(()) };
            let bytes = entry.native.pixels().saturating_mul(entry.channels.into());
            let checked = DecodeMemory::of_process().check(path, &format!("its {} pixels", entry.native), bytes);
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

    /// Whether a mask is the alpha of an image; see [`MaskPolarity::WhiteIsObject`](crate::MaskPolarity::WhiteIsObject).
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

impl Scene {
    /// A photo as numbers, at its native size: the shortest way to pixels. Many photos, or scaled ones, are better asked of an
    /// [`ImageStore`], which keeps what it decoded.
    ///
    /// # Errors
    /// Names the file where the photo or its mask cannot be decoded or has another size than its camera says.
    ///
    /// # Panics
    /// When there is no frame of this index.
    pub fn picture(&self, frame: usize) -> Result<Picture, SceneError> {
        let options = StoreOptions { longest_side: None, budget_bytes: 0 };
        let image = ImageStore::new(std::slice::from_ref(&self.frames[frame]), options)?.get(0)?;
        Ok(Picture::of(&image))
    }
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

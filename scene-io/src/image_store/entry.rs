//! One image of a store: its headers, the memory that reading takes, and reading.

use crate::decode_memory::{DecodeMemory, Reserved};
use crate::perturbation::Perturbation;
use crate::picture::{
    Image, Plan, decode, decode_grey, fitted, resize, resize_mask, same_shape, scaling_bytes, wrong_size,
};
use crate::{AlphaMeaning, ErrorKind, Frame, ImageSource, MaskPolarity, Problem, SceneError, Size};
use render_core::camera::Camera;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is known of one image before it is decoded.
#[derive(Debug)]
pub(super) struct Entry {
    pub(super) name: String,
    pub(super) image: ImageSource,
    mask: Option<(PathBuf, MaskPolarity)>,
    perturbation: Option<Arc<Perturbation>>,
    /// Whether the file's alpha says which pixels may be used.
    alpha_is_mask: bool,
    /// Camera at the size images are handed out.
    pub(super) camera: Camera,
    pub(super) native: Size,
    pub(super) channels: u8,
}

impl Entry {
    pub(super) fn new(frame: &Frame, longest_side: Option<u32>) -> Result<Self, SceneError> {
        let (native, channels) = match &frame.image {
            ImageSource::File(path) => {
                let plan = Plan::of(path).map_err(|e| e.in_frame(&frame.name))?;
                (plan.size, plan.channels())
            }
            ImageSource::Memory(image) => (image.size(), image.channels),
        };
        let said = frame.size();
        if said != native {
            let file = match &frame.image {
                ImageSource::File(path) => path.clone(),
                ImageSource::Memory(_) => PathBuf::from("image in memory"),
            };
            return Err(SceneError::new(ErrorKind::Image, wrong_size(&file, native, said)).in_frame(&frame.name));
        }
        let Size { width, height } = fitted(native, longest_side);
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

    pub(super) fn bytes(&self) -> u64 {
        let pixels = Size::from(&self.camera).pixels();
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

    pub(super) fn mask_is_alpha(&self) -> bool {
        self.mask.as_ref().is_some_and(|(_, polarity)| *polarity == MaskPolarity::WhiteIsObject)
    }

    /// Bytes held at one time while the image is read, the image included; and then `beside` more.
    fn reading_bytes(&self, image: Option<&Plan>, mask: Option<&Plan>, beside: u64) -> u64 {
        let pixels = self.native.pixels();
        let native = match &self.image {
            ImageSource::File(_) => pixels.saturating_mul(self.channels.into()),
            ImageSource::Memory(image) => image.bytes(),
        };
        let mask_bytes = mask.map_or(0, Plan::pixels);
        let changed = if self.alpha_is_mask || self.mask_is_alpha() { pixels.saturating_mul(4) } else { 0 };
        let scaled = if Size::from(&self.camera) == self.native {
            mask_bytes
        } else {
            self.bytes().saturating_add(scaling_bytes(self.native.width, self.camera.width))
        };
        let decoding = image.map_or(native, Plan::bytes_in_8_bit);
        // Names and other small things.
        let after = native.saturating_add(changed.max(scaled.max(beside))).saturating_add(4096);
        mask.map_or(0, Plan::bytes_in_grey).max(mask_bytes.saturating_add(decoding.max(after)))
    }

    /// The image as it is handed out, and its place in [`DecodeMemory`], which has room for `beside` more bytes.
    pub(super) fn read(&self, beside: u64) -> Result<(Image, Reserved<'static>), SceneError> {
        let plan = match &self.image {
            ImageSource::File(path) => {
                let plan = Plan::of(path)?;
                if plan.size != self.native || plan.channels() != self.channels {
                    return Err(SceneError::new(ErrorKind::Image, wrong_size(path, plan.size, self.native)));
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
        let (size, image) = (plan.size, self.native);
        if !same_shape(size, image) {
            let what = format!("the mask is {size} and its image {image}");
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
        let size = Size::from(&self.camera);
        let mut image = resize(native, size.width, size.height);
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
fn cut_out(image: Image, mask: &[u8], from: Size) -> Image {
    let (w, h) = (u64::from(image.width), u64::from(image.height));
    let (columns, rows) = (u64::from(from.width), u64::from(from.height));
    let channels = usize::from(image.channels);
    let data = image.data.chunks_exact(channels).zip(0_u64..).flat_map(|(pixel, i)| {
        // The nearest pixel of the mask.
        let (x, y) = ((2 * (i % w) + 1) * columns / (2 * w), (2 * (i / w) + 1) * rows / (2 * h));
        let shown = if mask[(y * columns + x) as usize] >= 128 { 255 } else { 0 };
        let alpha = pixel.get(3).map_or(shown, |own| shown.min(*own));
        [pixel[0], pixel[1], pixel[2], alpha]
    });
    Image { data: data.collect(), channels: 4, ..image }
}

/// A mask with white for what is used, at its own size.
fn read_mask(plan: &Plan, polarity: MaskPolarity) -> Result<(Vec<u8>, Size), SceneError> {
    let (mut mask, size) = decode_grey(plan)?;
    if polarity == MaskPolarity::WhiteIsIgnored {
        for v in &mut mask {
            *v = 255 - *v;
        }
    }
    Ok((mask, size))
}

//! Whether the photos stand before one plain colour: a thing on a white sheet, a render on black.

use engine::data::Dataset;
use engine::options::Background;
use engine::system::SystemError;

/// A pixel is of the backdrop's colour within this many of 255 steps of each channel.
const NEAR: u8 = 12;
/// Share of a photo's border that must be of it, and share of the photos.
const BORDER: f64 = 0.9;
const PHOTOS: f64 = 0.9;
/// Photos that are compared, at most, spread evenly; fewer than this many say nothing.
const LOOKED_AT: usize = 48;
const FEWEST: usize = 3;

/// What was found.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Backdrop {
    pub(crate) background: Background,
    /// In figures, for people.
    pub(crate) line: String,
}

/// The one colour around what the photos show: white or black; `None` where there is no such colour, or where photos have alpha.
///
/// # Errors
/// [`SystemError::Scene`] when an image cannot be read.
pub(crate) fn backdrop(data: &Dataset) -> Result<Option<Backdrop>, SystemError> {
    let count = data.len().min(LOOKED_AT);
    if count < FEWEST {
        return Ok(None);
    }
    let (mut white, mut black) = (0, 0);
    for k in 0..count {
        let image = data.image(k * data.len() / count)?;
        if image.channels != 3 {
            return Ok(None);
        }
        let (w, h) = (image.width, image.height);
        let border = (0..w).flat_map(|x| [(x, 0), (x, h - 1)]).chain((0..h).flat_map(|y| [(0, y), (w - 1, y)]));
        let (mut total, mut bright, mut dark) = (0_u32, 0_u32, 0_u32);
        for (x, y) in border.filter(|&(x, y)| image.is_used(x, y)) {
            let pixel = image.pixel(x, y);
            total += 1;
            bright += u32::from(pixel.iter().all(|&c| c >= 255 - NEAR));
            dark += u32::from(pixel.iter().all(|&c| c <= NEAR));
        }
        let most = |n: u32| total > 0 && f64::from(n) >= BORDER * f64::from(total);
        (white, black) = (white + usize::from(most(bright)), black + usize::from(most(dark)));
    }
    let (found, background) = if white >= black { (white, Background::White) } else { (black, Background::Black) };
    Ok((found as f64 >= PHOTOS * count as f64).then(|| Backdrop {
        background,
        line: format!(
            "background: {} (the border of {found} of {count} photos is; `--background random` takes it for part of the scene)",
            background.name()
        ),
    }))
}

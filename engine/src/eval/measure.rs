//! The metrics of one picture.

use super::motion::MotionScore;
use super::score::{Measures, ViewScore};
use image::RgbImage;
use losses::metrics::{
    Image, MS_SSIM_MIN_SIDE, MaskedSsim, SsimVariant, masked_psnr, masked_ssim, ms_ssim, psnr, ssim,
};

/// Scores of one picture; what is not defined for it stays `None`, with a note where that is a surprise.
pub(super) fn measure(
    picture: &RgbImage,
    truth: &RgbImage,
    mask: Option<&[u8]>,
    measures: Measures<'_>,
    note: &mut dyn FnMut(&str),
) -> ViewScore {
    let mut score = ViewScore {
        name: String::new(),
        psnr: None,
        psnr_object: None,
        motion: MotionScore::default(),
        fog: None,
        ssim: None,
        ms_ssim: None,
        lpips: None,
        flip: None,
        render_seconds: 0.0,
        files: None,
    };
    let (width, height) = (truth.width() as usize, truth.height() as usize);
    let image = |p| Image::from_u8(width, height, 3, p);
    let (a, b) = match (image(picture.as_raw()), image(truth.as_raw())) {
        (Ok(a), Ok(b)) => (a, b),
        (Err(e), _) | (_, Err(e)) => {
            note(&format!("not measured: {e}"));
            return score;
        }
    };
    let mask: Option<Vec<f32>> = mask.map(|m| m.iter().map(|&m| if m >= 128 { 1.0 } else { 0.0 }).collect());
    let measured = match &mask {
        Some(mask) => masked_psnr(&a, &b, mask),
        None => psnr(&a, &b),
    };
    match measured {
        Ok(db) if db.is_finite() => score.psnr = Some(db),
        Ok(_) => note("equals the truth in every pixel: its infinite PSNR is left out of the mean"),
        Err(e) => note(&format!("no PSNR: {e}")),
    }
    if let Measures::All(weights) = measures {
        let similarity = match &mask {
            Some(mask) => masked_ssim(&a, &b, mask, MaskedSsim::Corrected),
            None => ssim(&a, &b, SsimVariant::REFERENCE),
        };
        match similarity {
            Ok(x) => score.ssim = Some(x),
            Err(e) => note(&format!("no SSIM: {e}")),
        }
        if mask.is_none() && width.min(height) >= MS_SSIM_MIN_SIDE {
            score.ms_ssim = ms_ssim(&a, &b).ok();
        }
        if mask.is_none() {
            score.flip = flip(picture, truth, note);
        }
        if let (Some(weights), None) = (weights, &mask) {
            match weights.distance(&a, &b) {
                Ok(x) => score.lpips = Some(x),
                Err(e) => note(&format!("no LPIPS: {e}")),
            }
        }
    }
    score
}

#[cfg(feature = "flip")]
fn flip(picture: &RgbImage, truth: &RgbImage, note: &mut dyn FnMut(&str)) -> Option<f64> {
    match flip::mean_flip(truth.width(), truth.height(), truth.as_raw(), picture.as_raw()) {
        Ok(x) => Some(x),
        Err(e) => {
            note(&format!("no FLIP: {e}"));
            None
        }
    }
}

#[cfg(not(feature = "flip"))]
fn flip(_: &RgbImage, _: &RgbImage, _: &mut dyn FnMut(&str)) -> Option<f64> {
    None
}

//! What is behind what moves, against the same stage without it.

use crate::error::BenchError;
use engine::run::Run;
use engine::system::{Behind, LayerRequest, Query};
use losses::metrics::psnr_of_mse;
use scene_io::{ImageStore, Scene, StoreOptions};

/// Mean PSNR over the held-out views of what the system says is behind what moves, where pictures of `empty` with the names of these
/// views are the truth, dB; `None` for a system that does not know it apart, and where there are no such pictures.
pub(super) fn psnr_behind(run: &Run<'_>, empty: &Scene) -> Result<Option<f64>, BenchError> {
    if !run.system.knows_behind() {
        return Ok(None);
    }
    let store = ImageStore::new(&empty.frames, StoreOptions::default()).map_err(BenchError::part)?;
    let layers = LayerRequest { behind: Behind::Compute, ..LayerRequest::default() };
    let (mut sum, mut views) = (0.0, 0);
    for view in run.held_out.views() {
        let Some(frame) = empty.frames.iter().position(|frame| frame.name == view.name) else { continue };
        let image = store.get(frame).map_err(BenchError::part)?;
        let query = Query { layers, time: view.time, ..run.query() };
        let Some(seen) = run.system.render_view(&view.camera, &query) else { return Ok(None) };
        let pixels = image.data.chunks_exact(usize::from(image.channels));
        if (image.width, image.height) != (view.camera.width, view.camera.height) || seen.behind.len() != pixels.len() {
            continue;
        }
        let error: f64 = seen.behind.iter().zip(pixels).map(|(rgb, p)| squared(*rgb, &over(p, query.background))).sum();
        sum += psnr_of_mse(error / (3 * seen.behind.len()).max(1) as f64);
        views += 1;
    }
    Ok((views > 0).then(|| sum / f64::from(views)))
}

/// A pixel's colour, on the background where it has alpha.
fn over(pixel: &[u8], background: [f32; 3]) -> [f64; 3] {
    let alpha = pixel.get(3).map_or(1.0, |a| f64::from(*a) / 255.0);
    [0, 1, 2].map(|c| alpha * f64::from(pixel[c]) / 255.0 + (1.0 - alpha) * f64::from(background[c]))
}

fn squared(seen: [f32; 3], truth: &[f64; 3]) -> f64 {
    seen.iter().zip(truth).map(|(a, b)| (f64::from(a.clamp(0.0, 1.0)) - b).powi(2)).sum()
}

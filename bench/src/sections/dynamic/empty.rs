//! What is behind what moves, against the same stage without it.

use crate::error::BenchError;
use engine::picture::{behind, over_background};
use engine::render::render;
use engine::run::Run;
use engine::system::{Behind, LayerRequest, Query};
use losses::metrics::{Image, psnr};
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
        let query = Query { layers, time: view.time, ..run.query() };
        let Some(seen) = behind(&render(run.system.as_ref(), &view.camera, &query)) else { continue };
        let photo = store.get(frame).map_err(BenchError::part)?;
        let truth = over_background(&photo, query.background);
        let [seen, truth] =
            [&seen, &truth].map(|p| Image::from_u8(p.width() as usize, p.height() as usize, 3, p.as_raw()));
        sum += psnr(&seen.map_err(BenchError::part)?, &truth.map_err(BenchError::part)?).map_err(BenchError::part)?;
        views += 1;
    }
    Ok((views > 0).then(|| sum / f64::from(views)))
}

//! Messages as they are written: flat, and without a field that is not known.

use super::protocol::{self, AppearanceMix, Eye, Layer};
use engine::crop::Crop;
use serde::Deserialize;

/// As [`protocol::Draw`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Draw {
    id: u32,
    width: u32,
    height: u32,
    position: [f64; 3],
    wxyz: [f64; 4],
    fov: f64,
    layer: Layer,
    limit: u32,
    #[serde(default)]
    time: f64,
    #[serde(default)]
    appearance: AppearanceMix,
    #[serde(default)]
    background: Option<[f32; 3]>,
    #[serde(default)]
    photo: Option<usize>,
    #[serde(default)]
    crop: Crop,
}

/// As [`protocol::Pick`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Pick {
    id: u32,
    width: u32,
    height: u32,
    position: [f64; 3],
    wxyz: [f64; 4],
    fov: f64,
    at: [f64; 2],
    #[serde(default)]
    time: f64,
}

impl From<Draw> for protocol::Draw {
    fn from(draw: Draw) -> Self {
        let Draw { id, width, height, position, wxyz, fov, layer, limit, time, appearance, background, photo, crop } =
            draw;
        let eye = Eye { width, height, position, wxyz, fov };
        Self { id, eye, layer, limit, time, appearance, background, photo, crop }
    }
}

impl From<Pick> for protocol::Pick {
    fn from(pick: Pick) -> Self {
        let Pick { id, width, height, position, wxyz, fov, at, time } = pick;
        Self { id, eye: Eye { width, height, position, wxyz, fov }, at, time }
    }
}

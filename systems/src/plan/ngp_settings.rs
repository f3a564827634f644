//! Settings of the fast field from the layout and the number of pixels.

use crate::fields::{HashGridSettings, NetworkConfig, NetworkPrecision};
use crate::layout::Layout;
use crate::rays::{BatchConfig, RateConfig, RayConfig, SamplerConfig};
use crate::samplers::{OccupancyConfig, ProposalConfig};
use crate::settings::Settings;
use crate::space::SpaceConfig;
use crate::space::SpaceKind;
use crate::terms::TermConfig;
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::SystemError;
use scene_io::Scene;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Cells of the finest level to a pixel's footprint.
const CELLS_PER_PIXEL: f64 = 2.0;
/// Samples of a ray past an object whose surroundings are transparent, of one through a scene that fills the picture, and
/// those that a minute or two are good for: all roughly.
const SAMPLES_OF_AN_OBJECT: u64 = 8;
const SAMPLES_OF_A_SCENE: u64 = 64;
const SAMPLES_OF_A_RUN: u64 = 100_000_000;
/// Spans of time of which it is known where they are empty, where photos show what is.
const TIMES_TOLD_APART: usize = 24;
/// Shares of the schedule in between which fine levels begin to lead what moves.
const FINE_LEVELS_LEAD: [f64; 2] = [0.3, 0.6];

/// What training pictures show.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shown {
    /// The same scene.
    Scene,
    /// Each a time of its own.
    Times,
}

impl Shown {
    /// A scene whose photos have times moves.
    pub(crate) fn of(scene: &Scene) -> Self {
        if scene.frames.iter().any(|frame| frame.time.is_some()) { Self::Times } else { Self::Scene }
    }
}

/// Settings of `ngp` for a scene.
pub(crate) fn ngp_settings(
    layout: &Layout,
    data: &Dataset,
    shown: Shown,
    transparent: bool,
    lines: &mut Vec<String>,
) -> RayConfig {
    let pixel = layout.footprint;
    let span = f64::from(layout.kind.grid_span());
    let finest = (span / pixel * CELLS_PER_PIXEL).clamp(64.0, 4096.0);
    let n_max = (finest / 16.0).round() as u32 * 16;
    lines.push(format!(
        "finest grid: {n_max} cells along an axis ({CELLS_PER_PIXEL} to a pixel of {pixel:.4} radii at the scene)"
    ));
    let pixels = data.pixel_count();
    // Where pixels are few and their rays short, each comes often enough to be taken for the area it is. Where a run on a
    // CPU sees a pixel but once or twice, more pixels are worth more than each of them done better; and where each photo shows
    // a time of its own.
    let samples = if transparent { SAMPLES_OF_AN_OBJECT } else { SAMPLES_OF_A_SCENE };
    let often = shown == Shown::Scene && 4 * samples * pixels < SAMPLES_OF_A_RUN;
    let rays_per_side = if often { 2 } else { 1 };
    // For the same reason longer steps: a ray has fewer samples, and a step more rays. What moves keeps its short ones: longer ones were
    // not measured there.
    let step_per_pixel = match (rays_per_side, transparent, shown) {
        (1, true, _) => 1.5,
        (1, false, Shown::Scene) => 1.0,
        _ => 0.5,
    };
    lines.push(format!("pixels: the mean of {} ray(s) each ({pixels} training pixels)", rays_per_side * rays_per_side));
    // Pixels of extreme lenses are as large as the scene, or nothing.
    let step_min = (step_per_pixel * pixel).clamp(2e-4, 0.25) as f32;
    lines.push(format!("steps: {step_min:.4} radii ({step_per_pixel} of a pixel), growing with the distance"));
    let log2_table = if pixels > 4_000_000 { 18 } else { 17 };
    lines.push(format!("hash table: 2^{log2_table} entries a level ({pixels} training pixels)"));
    // Where a ray never ends, fog close to the cameras explains any picture but the next. Where something moves a tenth of the
    // loss: with all of it a dark video (`nr_nerf/example_sequence`) lost 4 dB, and everything near the camera.
    let distortion = match (layout.kind, shown) {
        (SpaceKind::Contracted, Shown::Scene) => 0.02,
        (SpaceKind::Contracted, Shown::Times) => 0.002,
        (SpaceKind::Box | SpaceKind::Ndc, _) => 0.0,
    };
    if distortion > 0.0 {
        lines.push(format!("distortion loss: {distortion} (space has no end: weight spread along a ray costs)"));
    }
    let mut grid = HashGridSettings { log2_table, n_max, ..HASH_GRID };
    if shown == Shown::Times {
        // The gradient of the finest levels says little about where to go, until points are within one of their cells.
        grid.warp_levels = HASH_GRID.levels.div_ceil(2);
        [grid.warp_levels_from, grid.warp_levels_until] = FINE_LEVELS_LEAD;
    }
    let mut config = defaults(layout, step_min, grid);
    config.batch.rays_per_side = rays_per_side;
    config.terms.distortion = distortion;
    config
}

/// What a thing that moves before nothing has besides: short rays, and empty space that is known by time.
pub(super) fn tell_times_apart(config: &mut RayConfig, lines: &mut Vec<String>) {
    let Some(occupancy) = config.occupancy_mut() else { return };
    // What is full at any time is in the way at all times: longer steps, until it is known when.
    occupancy.samples_per_ray = SAMPLES_OF_AN_OBJECT as f32;
    occupancy.occupancy_times = TIMES_TOLD_APART;
    lines.push(format!(
        "training rays: about {SAMPLES_OF_AN_OBJECT} samples each, in longer steps while there are more; for each of at most \
         {TIMES_TOLD_APART} spans of time it is known what is empty"
    ));
}

/// A hash grid for minutes on a CPU.
pub(crate) const HASH_GRID: HashGridSettings = HashGridSettings {
    levels: 8,
    features: 4,
    log2_table: 17,
    n_min: 16,
    n_max: 2048,
    levels_anneal: 0,
    levels_first: 4,
    warp_levels: 8,
    warp_levels_from: 0.0,
    warp_levels_until: 0.0,
};

/// Settings that depend on the place of the scene alone.
fn defaults(layout: &Layout, step_min: f32, grid: HashGridSettings) -> RayConfig {
    RayConfig {
        space: SpaceConfig {
            space: layout.kind,
            centre: layout.centre.to_array(),
            radius: layout.radius,
            near: 0.05,
            cascades: layout.cascades,
        },
        features: Arc::new(grid),
        networks: NetworkConfig {
            precision: NetworkPrecision::F32,
            width: 32,
            density_layers: 1,
            colour_layers: 1,
            geometry: 16,
            sh_degree: 4,
            density_bias: 0.0,
        },
        decoder: None,
        sampler: SamplerConfig::Occupancy(OccupancyConfig {
            occupancy: 64,
            occupancy_threshold: 0.01,
            occupancy_settle: 500,
            occupancy_every: 8,
            occupancy_times: 0,
            step_min,
            step_cone: if layout.kind == SpaceKind::Contracted { step_min } else { 0.0 },
            samples_per_ray: 64.0,
            free_space: false,
            sky: false,
        }),
        batch: BatchConfig {
            rays_per_side: 1,
            train_stop: 1e-4,
            train_faint: 0.0,
            batch_samples: 1 << 15,
            batch_rays: 1 << 13,
            huber: 0.0,
        },
        rates: RateConfig { lr: 2e-2, lr_hold: 500, lr_tenfold: 0.1, network_lr: 1.0, weight_decay: 1e-6 },
        terms: TermConfig::default(),
        head: None,
        moving: None,
    }
}

/// What places samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum SamplerKind {
    /// A march that skips what an occupancy grid knows to be empty.
    #[default]
    Occupancy,
    /// Small density fields that are asked first.
    Proposal,
}

#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SamplerChoice {
    sampler: SamplerKind,
}

/// The settings of a field of a scene that stands still, after `--set`, which may choose `sampler=proposal`.
pub(crate) fn chosen_sampler(mut planned: RayConfig, settings: &mut Settings<'_>) -> Result<RayConfig, SystemError> {
    if settings.of(&SamplerChoice::default())?.sampler == SamplerKind::Proposal {
        planned.sampler = SamplerConfig::Proposals(ProposalConfig::default());
    }
    planned.asked(settings)
}

/// All settings of the field by name; values are of no scene.
pub(crate) fn names() -> toml::Table {
    let nowhere = Layout {
        kind: SpaceKind::Box,
        centre: glam::DVec3::ZERO,
        radius: 1.0,
        cascades: 1,
        footprint: 1.0,
        reference: None,
        why: String::new(),
    };
    let run = |set| RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
    let mut names = toml::Table::new();
    for set in [toml::Table::new(), toml::toml! { sampler = "proposal" }] {
        let run = run(set);
        let mut settings = Settings::new(&run);
        chosen_sampler(defaults(&nowhere, 0.01, HASH_GRID), &mut settings).expect("words of its own");
        names.extend(settings.all().expect("words of its own"));
    }
    names
}

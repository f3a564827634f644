//! What does this scene need? Settings from the scene, a line of reason for each, and the system built from them.

use crate::data::Dataset;
use crate::deform::Deform;
use crate::layout::{Layout, layout, stands_still};
use crate::method::Method;
use crate::options::{Background, Plan, RunOptions};
use crate::space::{Space, SpaceKind};
use crate::static_scene::mip_nerf::{MipNerf, MipNerfConfig};
use crate::static_scene::mip_nerf_360::{MipNerf360, MipNerf360Config};
use crate::static_scene::nerf::{Nerf, NerfConfig};
use crate::static_scene::ngp::{MixtureKind, NetworkPrecision, Ngp, NgpConfig, Sampler};
use crate::system::{System, SystemError};
use float_core::Simd;
use render_core::pose::Pose;
use scene_io::Scene;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Error of a pixel from skipped work in evaluation renders, where nothing else is said.
const EVALUATION_BUDGET: f32 = 1.0 / 2048.0;

/// Systems by name.
pub const SYSTEMS: [&str; 5] = ["ngp", "nerf", "mip-nerf", "mip-nerf-360", "splat"];

/// What is known of a scene before any system is chosen.
pub(crate) struct Ground {
    pub(crate) layout: Layout,
    /// What was decided, and why.
    pub(crate) lines: Vec<String>,
    pub(crate) background: Background,
    /// The photos have alpha.
    pub(crate) transparent: bool,
    pub(crate) error_budget: f32,
}

impl Ground {
    pub(crate) fn of(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        check_parallax(data, run)?;
        Self::with_depth(scene, data, run)
    }

    /// The same where depth is known otherwise than by parallax.
    pub(crate) fn with_depth(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        let mut ground = Self::without_space(scene, data, run)?;
        ground.lines.insert(0, format!("space: {} ({})", ground.layout.kind.name(), ground.layout.why));
        Ok(ground)
    }

    /// [`of`](Self::of) for systems that fill no space.
    pub(crate) fn of_clouds(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        check_parallax(data, run)?;
        Self::without_space(scene, data, run)
    }

    fn without_space(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        let layout = layout(scene, data);
        let mut lines = Vec::new();
        let transparent = has_alpha(data)?;
        let background = run.background.unwrap_or(Background::Random);
        lines.push(match (run.background, transparent) {
            (Some(b), _) => format!("background: {} (asked for)", b.name()),
            (None, true) => "background: random (the images have alpha: empty space cannot hide as a colour)".into(),
            (None, false) => "background: random (the images have no alpha: every ray must end on something)".into(),
        });
        let error_budget = run.error_budget.unwrap_or(EVALUATION_BUDGET);
        Ok(Self { layout, lines, background, transparent, error_budget })
    }

    /// Settings of `nerf` for the scene.
    pub(crate) fn nerf_settings(&mut self) -> NerfConfig {
        self.lines.push("networks, samples and learning rate as published; smaller batches".into());
        NerfConfig {
            centre: self.layout.centre.to_array(),
            radius: self.layout.radius,
            extent: f64::from(1_u32 << (self.layout.cascades - 1)),
            ..NerfConfig::published(self.layout.kind)
        }
    }

    /// A new `nerf` that learns what a method says.
    pub(crate) fn nerf(
        &self,
        data: &Dataset,
        config: &NerfConfig,
        seed: u64,
        method: Option<Box<dyn Method>>,
    ) -> Result<Nerf, SystemError> {
        let place = (config.centre, config.radius, config.extent);
        let space = space(&self.layout, data, config.space, place, config.near)?;
        Nerf::with_method(config.clone(), space, self.background, seed, method)
    }

    /// A new `ngp` that learns what a method says.
    pub(crate) fn ngp(
        &mut self,
        data: &Dataset,
        config: &NgpConfig,
        seed: u64,
        method: Option<Box<dyn Method>>,
    ) -> Result<Ngp, SystemError> {
        let extent = f64::from(1_u32 << (config.cascades.clamp(1, 16) - 1));
        let space = space(&self.layout, data, config.space, (config.centre, config.radius, extent), config.near)?;
        let mut ngp = Ngp::with_method(config.clone(), space, self.background, seed, method)?;
        self.carve(&mut ngp, data, self.transparent)?;
        Ok(ngp)
    }

    /// A new `ngp` of a scene that moves, under a system's name.
    pub(crate) fn moving(
        &mut self,
        data: &Dataset,
        config: &NgpConfig,
        seed: u64,
        scene: &Scene,
        (name, mut deform): (&'static str, Option<Deform>),
    ) -> Result<Ngp, SystemError> {
        let extent = f64::from(1_u32 << (config.cascades.clamp(1, 16) - 1));
        let space = space(&self.layout, data, config.space, (config.centre, config.radius, extent), config.near)?;
        if let Some(deform) = &mut deform {
            let inside: Vec<[f32; 3]> = scene.points.iter().filter_map(|p| space.internal_point(p.xyz)).collect();
            let p: Vec<f32> = (0..3).flat_map(|a| inside.iter().map(move |p| p[a])).collect();
            let mut x = vec![0.0; p.len()];
            space.grid_positions(Simd::best(), &p, &mut x);
            deform.set_background(x);
        }
        let mut ngp = Ngp::moving(config.clone(), space, self.background, seed, (name, None, deform))?;
        self.carve(&mut ngp, data, false)?;
        Ok(ngp)
    }

    fn carve(&mut self, ngp: &mut Ngp, data: &Dataset, alpha: bool) -> Result<(), SystemError> {
        ngp.carve(data)?;
        self.lines.push(format!(
            "empty space: {} of the occupancy grid's cells are ruled out by the cameras{}",
            percent(ngp.carved()),
            if alpha { " and the images' alpha" } else { "" }
        ));
        Ok(())
    }
}

/// Build the system `name` for a scene.
///
/// # Errors
/// [`SystemError::Config`] for an unknown name, an unknown setting or one that cannot work; [`SystemError::Scene`] when
/// an image cannot be read.
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    if name == "splat" {
        return crate::splats::build(scene, data, run);
    }
    let Ground { layout, mut lines, background, transparent, error_budget } = Ground::of(scene, data, run)?;
    let plan = |lines, mut config: toml::Table| {
        // A resumed run must be told again.
        config.extend(run.set.get_key_value(NO_PARALLAX).map(|(k, v)| (k.clone(), v.clone())));
        Plan { lines, background, error_budget, config }
    };
    match name {
        "ngp" => {
            let config = settings(&ngp_settings(&layout, data, (Shown::Scene, transparent), &mut lines), run)?;
            let mut ground = Ground { layout, lines, background, transparent, error_budget };
            let ngp = ground.ngp(data, &config, run.seed, None)?;
            Ok((Box::new(ngp), plan(ground.lines, table(&config))))
        }
        "nerf" => {
            let mut ground = Ground { layout, lines, background, transparent, error_budget };
            let config = settings(&ground.nerf_settings(), run)?;
            let nerf = ground.nerf(data, &config, run.seed, None)?;
            Ok((Box::new(nerf), plan(ground.lines, table(&config))))
        }
        "mip-nerf" => {
            lines.push("network, intervals and learning rate as published; smaller batches".into());
            let planned = MipNerfConfig {
                centre: layout.centre.to_array(),
                radius: layout.radius,
                extent: f64::from(1_u32 << (layout.cascades - 1)),
                point_size: layout.footprint as f32,
                ..MipNerfConfig::published(layout.kind)
            };
            let config = settings(&planned, run)?;
            let place = (config.centre, config.radius, config.extent);
            let space = space(&layout, data, config.space, place, config.near)?;
            let system = MipNerf::new(config.clone(), space, background, run.seed)?;
            Ok((Box::new(system), plan(lines, table(&config))))
        }
        "mip-nerf-360" => {
            lines.push("networks, intervals and learning rate as published; smaller batches".into());
            // Objects and open scenes have different settings: those of the space asked for.
            let asked = run.set.get("space").and_then(|word| word.clone().try_into().ok());
            let planned = MipNerf360Config {
                centre: layout.centre.to_array(),
                radius: layout.radius,
                ..MipNerf360Config::published(asked.unwrap_or(layout.kind))
            };
            let config: MipNerf360Config = settings(&planned, run)?;
            config.check()?;
            let place = (config.centre, config.radius, f64::from(config.far));
            let space = space(&layout, data, config.space, place, config.near)?;
            let system = MipNerf360::new(config.clone(), space, background, run.seed)?;
            Ok((Box::new(system), plan(lines, table(&config))))
        }
        other => Err(no_such_system(other, SYSTEMS)),
    }
}

/// There is no system of this name, but of these.
pub(crate) fn no_such_system(name: &str, systems: impl IntoIterator<Item = &'static str>) -> SystemError {
    let names: Vec<&str> = systems.into_iter().collect();
    let problem = format!("there is no such system; use one of {}", names.join(", "));
    SystemError::Config { field: "system", value: name.into(), problem }
}

/// What accepts training cameras that are all the same: `--set accept_no_parallax=true`.
pub(crate) const NO_PARALLAX: &str = "accept_no_parallax";

/// Whether they were accepted.
pub(crate) fn accepts_no_parallax(run: &RunOptions) -> Result<bool, SystemError> {
    match run.set.get(NO_PARALLAX) {
        None => Ok(false),
        Some(toml::Value::Boolean(accepted)) => Ok(*accepted),
        Some(other) => {
            let problem = "must be true or false".into();
            Err(SystemError::Config { field: NO_PARALLAX, value: other.to_string(), problem })
        }
    }
}

/// Whether two or more training cameras all stand and look the same way, which tells nothing about depth.
pub(crate) fn has_no_parallax(data: &Dataset) -> bool {
    let [first, rest @ ..] = data.views() else { return false };
    let poses: Vec<Pose> = data.views().iter().map(|view| view.camera.pose).collect();
    // The same view at several scales is one view.
    rest.iter().any(|view| view.frame != first.frame) && stands_still(&poses)
}

/// The error of training cameras that are all the same: `and` what that means, and what is to be done.
pub(crate) fn no_parallax(data: &Dataset, and: &str) -> SystemError {
    let problem = format!(
        "all {} training cameras have the same pose: {and}, or set it to true to train all the same",
        data.len()
    );
    SystemError::Config { field: NO_PARALLAX, value: "false".into(), problem }
}

fn check_parallax(data: &Dataset, run: &RunOptions) -> Result<(), SystemError> {
    if accepts_no_parallax(run)? || !has_no_parallax(data) {
        return Ok(());
    }
    Err(no_parallax(data, "no parallax, so no depth; check the poses"))
}

pub(crate) fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Whether a training image has transparent pixels to speak of.
fn has_alpha(data: &Dataset) -> Result<bool, SystemError> {
    Ok(!data.is_empty() && data.image(0)?.channels == 4)
}

/// Whether a name of `--set` is read elsewhere, whatever the system.
fn elsewhere(key: &str) -> bool {
    key == NO_PARALLAX || key == crate::photo_points::provide::SETTING
}

/// Refuse names of `--set` that are none of `known`.
pub(crate) fn refuse_unknown(run: &RunOptions, known: &toml::Table) -> Result<(), SystemError> {
    match run.set.keys().find(|key| !elsewhere(key) && !known.contains_key(*key)) {
        None => Ok(()),
        Some(key) => {
            let names: Vec<&str> = known.keys().map(String::as_str).collect();
            Err(SystemError::Config {
                field: "set",
                value: key.clone(),
                problem: format!("there is no such setting; there are {}", names.join(", ")),
            })
        }
    }
}

/// Settings after `--set`: unknown names and values of the wrong kind are errors that name them.
pub(crate) fn settings<C: Serialize + DeserializeOwned>(planned: &C, run: &RunOptions) -> Result<C, SystemError> {
    let mut all = table(planned);
    refuse_unknown(run, &all)?;
    for (key, value) in &run.set {
        let Some(slot) = all.get_mut(key) else { continue };
        // `1` for a float is meant well.
        *slot = match (&*slot, value) {
            (toml::Value::Float(_), toml::Value::Integer(i)) => toml::Value::Float(*i as f64),
            _ => value.clone(),
        };
    }
    all.try_into().map_err(|e: toml::de::Error| SystemError::Config {
        field: "set",
        value: run.set.to_string().trim().replace('\n', ", "),
        problem: e.message().into(),
    })
}

/// `--set` for a method, whose settings are `ours`, and for its field.
pub(crate) fn split(run: &RunOptions, ours: &toml::Table) -> (RunOptions, RunOptions) {
    let keep = |mine: bool| RunOptions {
        set: run
            .set
            .iter()
            .filter(|(key, _)| ours.contains_key(*key) == mine)
            .map(|(k, v)| (k.clone(), v.clone()))
            .collect(),
        ..run.clone()
    };
    (keep(true), keep(false))
}

/// Every field of a configuration with its value.
pub(crate) fn table<C: Serialize>(config: &C) -> toml::Table {
    toml::Table::try_from(config).expect("settings are plain values")
}

/// What training pictures show.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shown {
    /// The same scene.
    Scene,
    /// Each a moment of its own.
    Moments,
}

/// Settings of `ngp` for a scene.
pub(crate) fn ngp_settings(
    layout: &Layout,
    data: &Dataset,
    (shown, transparent): (Shown, bool),
    lines: &mut Vec<String>,
) -> NgpConfig {
    let pixel = layout.footprint;
    // The grid spans two internal units, four where space is contracted.
    let span = if layout.kind == SpaceKind::Contracted { 4.0 } else { 2.0 };
    let finest = (span / pixel * CELLS_PER_PIXEL).clamp(64.0, 4096.0);
    let n_max = (finest / 16.0).round() as u32 * 16;
    lines.push(format!(
        "finest grid: {n_max} cells along an axis ({CELLS_PER_PIXEL} to a pixel of {pixel:.4} radii at the scene)"
    ));
    let pixels = data.pixel_count();
    // Where pixels are few and their rays short, each comes often enough to be taken for the area it is. Where a run on a
    // CPU sees a pixel but once or twice, more pixels are worth more than each of them done better; and where each photo shows
    // a moment of its own.
    let samples = if transparent { SAMPLES_OF_AN_OBJECT } else { SAMPLES_OF_A_SCENE };
    let often = shown == Shown::Scene && 4 * samples * pixels < SAMPLES_OF_A_RUN;
    let rays_per_side = if often { 2 } else { 1 };
    let step_per_pixel = if transparent && rays_per_side == 1 { 1.5 } else { 0.5 };
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
        (SpaceKind::Contracted, Shown::Moments) => 0.002,
        (SpaceKind::Box | SpaceKind::Ndc, _) => 0.0,
    };
    if distortion > 0.0 {
        lines.push(format!("distortion loss: {distortion} (space has no end: weight spread along a ray costs)"));
    }
    NgpConfig {
        space: layout.kind,
        centre: layout.centre.to_array(),
        radius: layout.radius,
        levels: 8,
        features: 4,
        levels_anneal: 0,
        levels_first: 4,
        warp_levels: 8,
        network_lr: 1.0,
        density_layers: 1,
        voxels: 0,
        voxels_every: 500,
        log2_table,
        n_min: 16,
        n_max,
        precision: NetworkPrecision::F32,
        width: 32,
        colour_layers: 1,
        geometry: 16,
        sh_degree: 4,
        density_bias: 0.0,
        sampler: Sampler::Occupancy,
        proposal_samples: vec![64, 48],
        final_samples: 32,
        occupancy: 64,
        cascades: layout.cascades,
        occupancy_threshold: 0.01,
        occupancy_settle: 500,
        occupancy_every: 8,
        near: 0.05,
        step_min,
        step_cone: if layout.kind == SpaceKind::Contracted { step_min } else { 0.0 },
        rays_per_side,
        train_stop: 1e-4,
        train_faint: 0.0,
        samples_per_ray: 64.0,
        batch_samples: 1 << 15,
        batch_rays: 1 << 13,
        lr: 2e-2,
        lr_hold: 500,
        lr_tenfold: 0.1,
        weight_decay: 1e-6,
        free_space: false,
        sky: false,
        distortion,
        sparsity: 0.0,
        background_entropy: 0.0,
        point_colour: 0.0,
        huber: 0.0,
        head_width: 64,
        head_bias: -5.0,
        mixture: MixtureKind::Paper,
    }
}

/// Cells of the finest level to a pixel's footprint.
const CELLS_PER_PIXEL: f64 = 2.0;
/// Samples of a ray past an object whose surroundings are transparent, of one through a scene that fills the picture, and
/// those that a minute or two are good for: all roughly.
const SAMPLES_OF_AN_OBJECT: u64 = 8;
const SAMPLES_OF_A_SCENE: u64 = 64;
const SAMPLES_OF_A_RUN: u64 = 100_000_000;

pub(crate) fn space(
    layout: &Layout,
    data: &Dataset,
    kind: SpaceKind,
    (centre, radius, extent): ([f64; 3], f64, f64),
    near: f32,
) -> Result<Space, SystemError> {
    let (centre, near) = (centre.into(), f64::from(near));
    match (kind, layout.reference) {
        (SpaceKind::Box, _) => Ok(Space::boxed(centre, radius, near)),
        (SpaceKind::Contracted, _) => Ok(Space::contracted(centre, radius, extent, near)),
        (SpaceKind::Ndc, Some((pose, near))) => {
            let cameras: Vec<_> = data.views().iter().map(|v| v.camera).collect();
            Space::ndc(pose, near, &cameras).ok_or_else(not_forward)
        }
        (SpaceKind::Ndc, None) => Err(not_forward()),
    }
}

fn not_forward() -> SystemError {
    SystemError::Config {
        field: "space",
        value: "ndc".into(),
        problem: "the cameras do not all look the same way; use `contracted` or `box`".into(),
    }
}

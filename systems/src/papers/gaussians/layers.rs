//! The cloud in front of another: what it is made of, what a scene makes of that, and how it begins.

use super::recipe::AskedParts;
use super::start::{Places, Seeing};
use crate::cloud_layers::{LayerSettings, MASK_ROWS, TwoLayers};
use crate::cloud_motion::UnitBox;
use crate::layout::Layout;
use crate::plan::CloudPace;
use crate::settings::Settings;
use crate::views::cloud_frame::CloudFrame;
use crate::views::start::{Start, StartOptions, scene_box};
use crate::views::{
    CloudConfig, CloudRates, CloudTraining, DensityConfig, ExtraRows, Front, PhotoTimes, RowStart, TrainedCloud,
    UsePruning, ViewLayers, first_of, refused, unless,
};
use engine::data::Dataset;
use engine::system::SystemError;
use glam::DVec3;
use scene_io::Bounds;
use serde::{Deserialize, Serialize};
use splat_core::density::logit;

/// How far before the camera a cloud begins that goes with it, internal units: a sheet, for only where it is on the picture is known.
const AT_CAMERA: [f64; 2] = [0.2, 0.202];

/// Gaussians in front that no photo needs are dropped from this share of the schedule on.
const PRUNE_FROM: f64 = 0.5;

/// A cloud in front, before a scene asks for anything.
#[derive(Clone, Copy, Debug)]
pub(super) struct LayerParts {
    /// Of photos with times of their own: what moves.
    pub(super) film: LayerKind,
    /// Of photos without: what stands before single ones.
    pub(super) photos: LayerKind,
}

/// A cloud in front: what pictures with it cost, and what it is made of.
#[derive(Clone, Copy, Debug)]
pub(super) struct LayerKind {
    pub(super) settings: LayerSettings,
    pub(super) front: FrontConfig,
}

/// The cloud in front.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FrontConfig {
    /// Number of Gaussians at the start, at random places.
    pub(super) front_count: usize,
    /// Most Gaussians that it ever has.
    pub(super) front_max: usize,
    /// Opacity of all of them at the start.
    pub(super) front_opacity: f64,
}

impl FrontConfig {
    fn check(&self) -> Result<(), SystemError> {
        first_of([
            unless(self.front_count > 0, "front_count", self.front_count, "must be at least 1"),
            unless(
                (self.front_count..=1_000_000).contains(&self.front_max),
                "front_max",
                self.front_max,
                "must be at least front_count, and at most a million",
            ),
            unless(
                self.front_opacity > 0.0 && self.front_opacity < 1.0,
                "front_opacity",
                self.front_opacity,
                "must be above 0 and below 1",
            ),
        ])
    }
}

/// Settings after `--set`.
#[derive(Clone, Copy)]
pub(super) struct AskedLayers {
    settings: LayerSettings,
    front: FrontConfig,
}

impl LayerParts {
    /// After `--set`; `pace` says how many Gaussians a scene that moves affords in a schedule of `horizon` steps.
    pub(super) fn asked(
        &self,
        pace: Option<&CloudPace>,
        horizon: u64,
        times: PhotoTimes,
        settings: &mut Settings<'_>,
    ) -> Result<AskedLayers, SystemError> {
        let planned = match times {
            PhotoTimes::Own => self.film,
            PhotoTimes::Order => self.photos,
        };
        let most = pace.map_or(planned.front.front_max, |pace| pace.gaussians(horizon as f64));
        let front = settings.of(&FrontConfig { front_max: most.max(planned.front.front_count), ..planned.front })?;
        front.check()?;
        let asked = AskedLayers { settings: settings.of(&planned.settings)?, front };
        asked.settings.check()?;
        Ok(asked)
    }
}

impl AskedLayers {
    /// Degree of the spherical harmonics in front: what goes with the camera is seen from one side.
    pub(super) fn sh_degree(&self, behind: usize) -> usize {
        if self.settings.front_at_camera { 0 } else { behind }
    }

    /// The box in which the cloud in front moves.
    pub(super) fn cube(&self, frame: &CloudFrame, layout: &Layout, data: &Dataset) -> UnitBox {
        if self.settings.front_at_camera {
            UnitBox::new(&sheet(data), &CloudFrame::WORLD)
        } else {
            UnitBox::new(&scene_box(layout, data), frame)
        }
    }

    /// The cloud in front at its start, at random places where photos do not rule them out, and what puts both together.
    pub(super) fn parts(
        &self,
        asked: &AskedParts,
        layout: &Layout,
        data: &Dataset,
        times: PhotoTimes,
        seed: u64,
    ) -> Result<(TrainedCloud, ViewLayers), SystemError> {
        let behind = &asked.training;
        let at_camera = self.settings.front_at_camera;
        let cloud = CloudConfig {
            max_splats: self.front.front_max,
            sh_degree: self.sh_degree(behind.cloud.sh_degree),
            // Cameras of the scene are nowhere near what goes with them.
            near_size: if at_camera { 0.0 } else { behind.cloud.near_size },
            ..behind.cloud
        };
        // Another stream than that of the cloud behind.
        let seed = seed ^ u64::from(u32::MAX);
        let mut start = if at_camera {
            let FrontConfig { front_count: random, front_max: max, .. } = self.front;
            let options = StartOptions { degree: 0, max, random, seed };
            Start::random(sheet(data), &CloudFrame::WORLD, &options, |_| Some([0.5; 3])).map_err(refused)?
        } else {
            let places = Places::random(self.front.front_count);
            places.start(&cloud, layout, &asked.frame, data, Seeing::ManyTimes, seed)?
        };
        start.cloud.logit.fill(logit(self.front.front_opacity));
        let mut training = self.training(behind, cloud);
        training.extra.rows += asked.rows_at_rest();
        let front = TrainedCloud::new(training, 1, &start.cloud).map_err(refused)?;
        let shown = if times == PhotoTimes::Own && !at_camera { Front::Shown } else { Front::Hidden };
        let part = Box::new(TwoLayers::new(self.settings, behind.rates.horizon));
        Ok((front, ViewLayers { part, front: shown }))
    }

    /// How `cloud`, in front of one that learns as `behind` says, learns.
    fn training(&self, behind: &CloudTraining, cloud: CloudConfig) -> CloudTraining {
        let waits = (self.settings.front_from * behind.rates.horizon as f64) as u64;
        let density = &behind.density.schedule;
        let schedule = DensityConfig { densify_from: density.densify_from + waits, free_space: false, ..*density };
        let density = behind.density.of_schedule(schedule);
        let extra =
            ExtraRows { rows: MASK_ROWS, composited: 0, rate: self.settings.front_mask_lr, start: RowStart::Zero };
        let half = (PRUNE_FROM * behind.rates.horizon as f64) as u64;
        let pruning = UsePruning { least: self.settings.front_prune as f32, from: half.max(waits) };
        let still = CloudTraining { cloud, density, extra, pruning, ..*behind };
        if self.settings.front_at_camera {
            // Every photo but one wants it transparent: opacity is what changes over time, and fades for no other.
            let rates = CloudRates { lr_logit: 0.0, ..behind.rates };
            CloudTraining { rates, density: density.without_fading(), ..still }
        } else {
            still
        }
    }

    /// For people.
    pub(super) fn line(&self, times: PhotoTimes) -> String {
        let FrontConfig { front_count, front_max, .. } = self.front;
        let (what, shown) = match times {
            PhotoTimes::Own => ("what moves", "pictures show both clouds"),
            PhotoTimes::Order => (
                "what stands before single photos",
                "each photo shows another time of it; pictures show the cloud behind alone",
            ),
        };
        format!("front: a cloud of {what}, of {front_count} Gaussians at first and at most {front_max}; {shown}")
    }
}

/// The box that photos show at [`AT_CAMERA`], in the axes of their cameras, internal units.
fn sheet(data: &Dataset) -> Bounds {
    let [near, far] = AT_CAMERA;
    let [mut min, mut max] = [DVec3::new(0.0, 0.0, near), DVec3::new(1e-3, 1e-3, far)];
    for camera in data.views().iter().map(|view| &view.camera) {
        let first = DVec3::new(-camera.cx / camera.fx, -camera.cy / camera.fy, 1.0) * far;
        let last = DVec3::new(
            (f64::from(camera.width) - camera.cx) / camera.fx,
            (f64::from(camera.height) - camera.cy) / camera.fy,
            1.0,
        ) * far;
        (min, max) = (min.min(first), max.max(last));
    }
    Bounds { min, max }
}

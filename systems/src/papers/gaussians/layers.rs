//! The cloud in front of another: what it is made of, what a scene makes of that, and how it begins.

use super::recipe::AskedParts;
use super::start::{Places, Seeing};
use crate::cloud_layers::{LayerSettings, MASK_ROWS, TwoLayers};
use crate::layout::Layout;
use crate::plan::CloudPace;
use crate::settings::Settings;
use crate::views::{
    CloudConfig, CloudTraining, DensityConfig, ExtraRows, Front, PhotoTimes, RowStart, TrainedCloud, ViewLayers,
    first_of, refused, unless,
};
use engine::data::Dataset;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// A cloud in front, before a scene asks for anything.
#[derive(Clone, Copy, Debug)]
pub(super) struct LayerParts {
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
        settings: &mut Settings<'_>,
    ) -> Result<AskedLayers, SystemError> {
        let most = pace.map_or(self.front.front_max, |pace| pace.gaussians(horizon as f64));
        let front = settings.of(&FrontConfig { front_max: most.max(self.front.front_count), ..self.front })?;
        front.check()?;
        let asked = AskedLayers { settings: settings.of(&self.settings)?, front };
        asked.settings.check()?;
        Ok(asked)
    }
}

impl AskedLayers {
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
        let cloud = CloudConfig { max_splats: self.front.front_max, ..behind.cloud };
        let waits = (self.settings.front_from * behind.rates.horizon as f64) as u64;
        let density = &behind.density.schedule;
        let schedule = DensityConfig { densify_from: density.densify_from + waits, free_space: false, ..*density };
        let density = behind.density.of_schedule(schedule);
        let extra =
            ExtraRows { rows: MASK_ROWS, composited: 0, rate: self.settings.front_mask_lr, start: RowStart::Zero };
        let training = CloudTraining { cloud, density, extra, ..*behind };
        let places = Places::random(self.front.front_count);
        // Another stream than that of the cloud behind.
        let start = places.start(&cloud, layout, &asked.frame, data, Seeing::ManyTimes, seed ^ u64::from(u32::MAX))?;
        let front = TrainedCloud::new(training, 1, &start.cloud).map_err(refused)?;
        let shown = if times == PhotoTimes::Own { Front::Shown } else { Front::Hidden };
        let part = Box::new(TwoLayers::new(self.settings, behind.rates.horizon));
        Ok((front, ViewLayers { part, front: shown }))
    }

    /// For people.
    pub(super) fn line(&self, times: PhotoTimes) -> String {
        let FrontConfig { front_count, front_max } = self.front;
        let shown = match times {
            PhotoTimes::Own => "pictures show both clouds",
            PhotoTimes::Order => "each photo shows another time of it; pictures show the cloud behind alone",
        };
        format!("front: a cloud of what moves, of {front_count} Gaussians at first and at most {front_max}; {shown}")
    }
}

//! Where the Gaussians of a cloud begin: at points, at random places, or where a field sees surfaces.

use crate::layout::Layout;
use crate::occluders::outliers::{Backdrop, Brightness, Expecting, OutlierConfig, PhotoOutliers};
use crate::papers::wild::combined::Wild;
use crate::papers::wild::nerf_w::with_codes;
use crate::papers::wild::robust_nerf;
use crate::photo_model::PhotoModel;
use crate::plan::{Ground, field_settings};
use crate::proxy::{FieldConfig, Proxied, ProxyTerms};
use crate::settings::Settings;
use crate::views::cloud_frame::CloudFrame;
use crate::views::start::{Start, StartOptions, scene_box};
use crate::views::{CloudConfig, CloudTraining, MOST, Views, VisualHull, first_of, refused, unless};
use engine::data::Dataset;
use engine::memory::room_for;
use engine::options::{Background, RunOptions};
use engine::system::{System, SystemError};
use scene_io::{Point, Scene};
use serde::{Deserialize, Serialize};
use splat_core::Gaussians;

/// A field of fewer steps knows no surfaces, and one of more sees none better.
const FIELD_STEPS: [u64; 2] = [100, 1_000];

/// Fewer points than this say less of a scene than a field that is trained first.
const FEW_POINTS: usize = 2_000;

/// Where Gaussians begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum StartKind {
    /// At the points that the scene comes with.
    Points,
    /// Anywhere in the box that the cameras look at.
    Random,
    /// Where a field sees surfaces, which is trained first.
    Field,
}

/// Where Gaussians begin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct StartConfig {
    /// Where Gaussians begin: `points`, `random`, or `field`: where a field sees surfaces that is trained first.
    pub(super) start: StartKind,
}

/// How many times of a scene its photos show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seeing {
    /// One: what a photo sees through is empty.
    OneTime,
    /// Many: what a photo sees through may hold something in another.
    ManyTimes,
}

/// A field before the cloud.
#[derive(Clone, Debug)]
pub(super) struct FieldBefore {
    pub(super) terms: ProxyTerms,
    /// The share of later Gaussians that begins where it sees surfaces.
    pub(super) refill: f64,
    pub(super) seeing: Seeing,
    pub(super) photos: PhotosBefore,
}

/// What photos differ in, for a field before the cloud.
#[derive(Clone, Debug, Default)]
pub(super) struct PhotosBefore {
    /// Numbers of a photo's code, where photos differ in appearance.
    pub(super) codes: Option<usize>,
    /// How masks of whole photos are found, where things stand before the scene.
    pub(super) masks: Option<OutlierConfig>,
}

impl PhotosBefore {
    /// The photo model of a field that is trained for `steps` steps; `None` where photos have neither codes nor masks.
    fn model(
        &self,
        steps: u64,
        data: &Dataset,
        background: Background,
        seed: u64,
    ) -> Result<Option<Box<dyn PhotoModel>>, SystemError> {
        let codes = self.codes.map(|dims| with_codes(dims, data, seed));
        let brightness = if codes.is_some() { Brightness::Each } else { Brightness::Same };
        let Some(outliers) = &self.masks else { return Ok(codes.map(|codes| Box::new(codes) as _)) };
        let judge = PhotoOutliers::new(Backdrop::new(background), brightness, Expecting::All);
        let occluders = robust_nerf::masking(steps, outliers, judge, data)?;
        let appearance = codes.and_then(|codes| codes.appearance);
        Ok(Some(Box::new(Wild { name: robust_nerf::CLAIM.name, appearance, occluders })))
    }
}

/// A start that is not at points: chosen, or because the scene has none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CountConfig {
    /// How many begin at random places, or where the field sees surfaces.
    start_count: usize,
}

const COUNT: CountConfig = CountConfig { start_count: 20_000 };

/// Where the cloud begins, and the field that is trained before it, after `--set`.
pub(super) struct AskedStart {
    pub(super) at: Places,
    pub(super) field: Option<ProxyTerms>,
}

/// Where a cloud begins.
pub(super) enum Places {
    Points(Start),
    /// Also where the field sees nothing.
    Random(CountConfig),
}

impl StartConfig {
    /// Of a scene that has many points, few or none, for a run with time for a field of `field_steps` steps.
    pub(super) fn planned(scene: &Scene, field_steps: Option<u64>) -> Self {
        let start = match (scene.points.len(), field_steps) {
            (..FEW_POINTS, Some(_)) => StartKind::Field,
            (0, None) => StartKind::Random,
            _ => StartKind::Points,
        };
        Self { start }
    }

    /// The same of a thing that is cut out, and moves, or has things before it in some photos: photos say where it is better than a
    /// field that knows nothing of that.
    pub(super) fn of_cut_out_thing(scene: &Scene) -> Self {
        Self { start: if scene.points.len() < FEW_POINTS { StartKind::Random } else { StartKind::Points } }
    }
}

impl StartKind {
    /// The share of later Gaussians that begin where a field sees them, where nothing is said.
    pub(super) fn refill(self) -> f64 {
        if self == Self::Field { 0.5 } else { 0.0 }
    }

    /// The settings of the parts that are there, after `--set`: those of places that are no points where the cloud begins at others,
    /// for it was asked to, or no point can be used; those of a field where one is trained, of `field_steps` steps where nothing is
    /// said, for seeds or for Gaussians that come later.
    pub(super) fn asked(
        self,
        points: &[Point],
        training: &CloudTraining,
        frame: &CloudFrame,
        settings: &mut Settings<'_>,
        field_steps: Option<u64>,
        seed: u64,
    ) -> Result<AskedStart, SystemError> {
        let cloud = &training.cloud;
        let at_points = match self {
            Self::Points => Some(Start::from_points(points, frame, &options(cloud, seed)).map_err(refused)?),
            Self::Random | Self::Field => None,
        };
        let at = match at_points.filter(|start| !start.cloud.is_empty()) {
            Some(start) => Places::Points(start),
            None => {
                let count = settings.of(&COUNT)?;
                count.check()?;
                Places::Random(count)
            }
        };
        let seeds = match &at {
            Places::Random(count) if self == Self::Field => Some(count.start_count),
            _ => None,
        };
        let field = if seeds.is_some() || training.density.refill() > 0.0 {
            let planned = FieldConfig { field_steps: field_steps.unwrap_or(FIELD_STEPS[1]), ..FieldConfig::PLANNED };
            let config = settings.of(&planned)?;
            config.check()?;
            Some(ProxyTerms { config, seeds, sky: None })
        } else {
            None
        };
        Ok(AskedStart { at, field })
    }
}

impl CountConfig {
    fn check(&self) -> Result<(), SystemError> {
        let count = self.start_count;
        first_of([
            unless(count <= MOST, "start_count", count, "must be at most 50 million"),
            unless(count > 0, "start_count", count, "must be at least 1 where they start at random"),
        ])
    }
}

impl Places {
    /// `count` random places.
    pub(super) fn random(count: usize) -> Self {
        Self::Random(CountConfig { start_count: count })
    }

    /// The cloud at its start; at random places only where photos do not rule them out.
    pub(super) fn start(
        self,
        cloud: &CloudConfig,
        layout: &Layout,
        frame: &CloudFrame,
        data: &Dataset,
        seeing: Seeing,
        seed: u64,
    ) -> Result<Start, SystemError> {
        let start_count = match self {
            Self::Points(start) => return Ok(start),
            Self::Random(CountConfig { start_count }) => start_count,
        };
        let count = start_count.min(cloud.max_splats);
        let one = Gaussians::new(0, cloud.sh_degree).map_err(refused)?.parameters_per_gaussian();
        room_for("start_count", count, count.saturating_mul(one))?;
        let hull = match seeing {
            Seeing::OneTime => VisualHull::new(data)?,
            Seeing::ManyTimes => VisualHull::of_many_times(data)?,
        };
        let options = StartOptions { random: start_count, ..options(cloud, seed) };
        Start::random(scene_box(layout, data), frame, &options, |x| hull.colour_at(x)).map_err(refused)
    }
}

/// The system: the cloud, or the cloud with a field before it. What the field is for is added to `lines`.
pub(super) fn with_field(
    cloud: Views,
    field: Option<FieldBefore>,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
    lines: &mut Vec<String>,
) -> Result<Box<dyn System>, SystemError> {
    let Some(FieldBefore { terms, refill, seeing, photos }) = field else { return Ok(Box::new(cloud)) };
    let is_masked = photos.masks.is_some();
    let mut ground = Ground::of(scene, data, run)?;
    let config = field_settings(&mut ground, data);
    let field = match seeing {
        Seeing::OneTime => {
            let photos = photos.model(terms.config.field_steps, data, ground.background, run.seed)?;
            ground.ngp(data, &config, run.seed, photos)?
        }
        Seeing::ManyTimes => ground.plain(data, &config, run.seed)?,
    };
    lines.push(terms.line(refill));
    if is_masked {
        lines.push("field: it leaves out occluders as the cloud does, which begins with its masks".to_owned());
    }
    Ok(Box::new(Proxied::new(terms, field, cloud)))
}

/// Steps of the field in a run of `steps` steps, of which it has this share; `None` where they are too few.
pub(super) fn field_steps(steps: f64) -> Option<u64> {
    let [least, most] = FIELD_STEPS;
    let steps = (steps as u64).min(most);
    (steps >= least).then_some(steps)
}

/// How the cloud begins, but for the number of random places.
fn options(cloud: &CloudConfig, seed: u64) -> StartOptions {
    StartOptions { degree: cloud.sh_degree, max: cloud.max_splats, random: 0, seed }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;
    use glam::DVec3;

    #[test]
    fn a_thing_that_moves_begins_where_photos_show_it() {
        let of = |points: usize| {
            let points = vec![Point { xyz: DVec3::ZERO, rgb: [0; 3] }; points];
            StartConfig::of_cut_out_thing(&made::scene(Vec::new(), points).0).start
        };
        assert_eq!([0, 1999, 2000].map(of), [StartKind::Random, StartKind::Random, StartKind::Points]);
    }

    #[test]
    fn a_field_stands_for_points_that_are_few_where_there_is_time_for_one() {
        let of = |points: usize, steps: Option<u64>| {
            let points = vec![Point { xyz: DVec3::ZERO, rgb: [0; 3] }; points];
            StartConfig::planned(&made::scene(Vec::new(), points).0, steps).start
        };
        assert_eq!([0, 1999, 2000].map(|n| of(n, Some(250))), [StartKind::Field, StartKind::Field, StartKind::Points]);
        assert_eq!([0, 1999, 2000].map(|n| of(n, None)), [StartKind::Random, StartKind::Points, StartKind::Points]);
    }
}

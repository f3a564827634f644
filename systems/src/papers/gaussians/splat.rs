//! 3D Gaussian splatting: a cloud of Gaussians, drawn and compared photo by photo.
//!
//! Kerbl, Kopanas, Leimkühler, Drettakis, "3D Gaussian Splatting for Real-Time Radiance Field Rendering", 2023.
//!
//! ```text
//! G(x) = exp(-1/2 (x - p)^T Sigma^-1 (x - p)),  Sigma = R S S^T R^T        a Gaussian (equations 4, 6)
//! Sigma' = J W Sigma W^T J^T                                              on the picture (equation 5)
//! C = sum_i c_i alpha_i prod_{j < i} (1 - alpha_j)                        compositing, nearest first (equation 3)
//! L = (1 - lambda) L1 + lambda (1 - SSIM),  lambda = 0.2                  the loss (equation 7)
//! ```
//!
//! `alpha_i` is the opacity times `G`, `c_i` spherical harmonics of the direction. In the paper a Gaussian with a mean view-space gradient
//! of at least `tau = 2e-4` is cloned where it is small and split where it is large (section 5.2, algorithm 1): `--set density=adc`.
//! Here it is split along its longest axis ([`splat_core::density::AxisSplit`]); transparent ones are pruned. `--set density=mcmc` takes
//! the Markov chain of Kheradmand et al., "3D Gaussian splatting as Markov chain Monte Carlo", 2024.
//!
//! Where `C` is composited: `splat_core`; the step: [`crate::views`]. What differs from the paper, and why:
//! `docs/decisions/0022-gaussians-on-the-cpu.md`.

mod start;

use crate::claims::Claim;
use crate::free_space::free_space_line;
use crate::plan::{Ask, Built, CloudPace, Ground};
use crate::schedule::PlannedTime;
use crate::settings::Settings;
use crate::views::cloud_frame::CloudFrame;
use crate::views::{
    AdcConfig, CloudConfig, CloudRates, CloudTraining, DensityConfig, DensityKind, DensityRules, ExtraRows, L1Dssim,
    L1DssimConfig, MaskWeight, McmcConfig, PictureConfig, PlannedDensity, SplitConfig, TrainedCloud, ViewParts,
    ViewSpaceGradient, Views, WideningKind, refused,
};
use engine::data::Dataset;
use engine::options::{Plan, RunOptions, Stop};
use engine::system::SystemError;
use float_core::Simd;
use glam::DVec3;
use scene_io::{Point, Scene};
use start::{AskedStart, StartConfig, StartKind};

/// Steps that the schedules are for where no stop is known, and the fewest that they are for.
const HORIZON: u64 = 10_000;
const SHORTEST: u64 = 1_000;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "splat",
    paper: "Kerbl et al., 2023",
    what: "A cloud of Gaussians, drawn tile by tile",
    take: "to look around smoothly, and files for other programs; a minute or more of training",
    differs: "Gaussians are split along their longest axis at an even pace, up to what pixels and steps allow; opacities \
              fade instead of being reset; large ones stay, but are smaller beside cameras. Schedules fit the run, sizes and \
              colours learn twice as fast, all rates fade in the end. Pictures are antialiased (Mip-Splatting), and of large \
              photos smaller at first; with few points Gaussians begin where a field sees surfaces.",
    mark: "axis splits, no opacity reset",
};

const START: StartConfig = StartConfig { start: StartKind::Points };
const CLOUD: CloudConfig = CloudConfig {
    centre: [0.0; 3],
    radius: 1.0,
    max_splats: 100_000,
    near_size: 0.3,
    sh_degree: 3,
    sh_every: HORIZON / 20,
};
/// Rates of sizes and colours are twice those of the released code's `OptimizationParams`, the last one of centres ten times: there
/// are fewer steps. All fade at the end, which the paper's do not.
const RATES: CloudRates = CloudRates {
    horizon: HORIZON,
    fade_from: 0.7,
    fade_to: 0.1,
    lr_mean: 1.6e-4,
    lr_mean_end: 1.6e-5,
    lr_dc: 5e-3,
    lr_logit: 0.05,
    lr_scale: 1e-2,
    lr_rotation: 1e-3,
};
const DENSITY: DensityConfig = DensityConfig {
    density: DensityKind::Split,
    densify_from: 300,
    densify_until: HORIZON / 5 * 4,
    densify_every: 100,
    free_space: false,
};
/// Half the published threshold: how many there may be at a step is what holds them back.
const SPLIT: SplitConfig = SplitConfig { densify_gradient: 1e-4, opacity_decay: 0.9, refill: 0.0 };
/// Of `density=adc`: the published threshold; `reset_every` is 3000 there and `prune_size` 0.1.
const ADC: AdcConfig = AdcConfig { densify_gradient: 2e-4, reset_every: 0, prune_size: 0.0 };
/// Kheradmand et al., 2024: `lambda_o = lambda_s = 0.01` (equation 10), `lambda_noise = 5e5` (section 5).
const MCMC: McmcConfig = McmcConfig { mcmc_cost: 0.01, mcmc_noise: 5e5 };
/// Smaller pictures at first, and opacity that falls with the area that a pixel's width adds (Yu et al., "Mip-Splatting", 2024, section
/// 4.2), are not of the paper; how small, and for how long, is planned.
const PICTURES: PictureConfig =
    PictureConfig { near: 0.01, widening: WideningKind::Dims, smoothing: 0.0, coarse: 0, coarse_steps: HORIZON / 4 };
/// Equation 7.
const LOSS: L1DssimConfig = L1DssimConfig { dssim: 0.2 };

/// What is planned of the density control.
const CONTROL: PlannedDensity = PlannedDensity { schedule: DENSITY, adc: ADC, split: SPLIT, mcmc: MCMC };

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let (scene, data, run) = (ask.scene, ask.data, ask.run);
    let mut ground = Ground::of_clouds(scene, data, run)?;
    let planned = Planned::of(scene, data, run.stop, &mut ask.settings, &mut ground.lines)?;
    let asked = planned.asked(&scene.points, &mut ask.settings, run.seed)?;
    let all = ask.settings.all()?;
    let Ground { layout, mut lines, background, error_budget, .. } = ground;
    lines.extend(planned.free_space.filter(|_| asked.training.density.schedule.free_space));
    let cloud = &asked.training.cloud;
    let time = planned.pace.map(|pace| asked.time(&pace));
    let AskedStart { at, field } = asked.start;
    let refill = asked.training.density.refill();
    let start = at.start(cloud, &layout, &asked.frame, data, run.seed)?;
    let begin =
        if field.is_some_and(|terms| terms.seeds.is_some()) { "start, should the field see nothing" } else { "start" };
    lines.extend(start.notes.iter().map(|note| format!("{begin}: {note}")));
    lines.push(format!("at most {} Gaussians", cloud.max_splats));
    let bent = data.views().iter().filter(|v| !v.camera.lens.is_pinhole()).count();
    if bent > 0 {
        lines.push(format!("lenses: {bent} photos are drawn onto a plane for training, and pictures from it"));
    }
    let parts = ViewParts {
        name: CLAIM.name,
        frame: asked.frame,
        pictures: asked.pictures,
        clouds: vec![TrainedCloud::new(asked.training, 0, &start.cloud).map_err(refused)?],
        terms: vec![Box::new(L1Dssim::new(Simd::best(), &asked.loss))],
        weights: vec![Box::new(MaskWeight)],
        appearance: None,
        motion: None,
        view_space: ViewSpaceGradient::Plain,
        background,
        time,
        seed: run.seed,
    };
    let splat = Views::new(parts, data)?;
    lines.extend(ask.claim.line());
    let system = start::with_field(splat, field, refill, scene, data, run, &mut lines)?;
    Ok((system, Plan { lines, background, error_budget, config: all }))
}

/// What a scene asks for, before `--set` but for where the cloud starts: the others depend on that.
#[derive(Clone, Debug)]
struct Planned {
    cloud: CloudConfig,
    start: StartKind,
    /// Steps of a field before the cloud, where there is time for one.
    field_steps: Option<u64>,
    rates: CloudRates,
    density: DensityConfig,
    pictures: PictureConfig,
    pace: Option<CloudPace>,
    /// Why places are known to be empty, where they are.
    free_space: Option<String>,
}

impl Planned {
    /// Of no scene.
    const OF_NOTHING: Self = Self {
        cloud: CLOUD,
        start: START.start,
        field_steps: None,
        rates: RATES,
        density: DENSITY,
        pictures: PICTURES,
        pace: None,
        free_space: None,
    };

    /// Of a scene; what was decided, and why, is added to `lines`.
    fn of(
        scene: &Scene,
        data: &Dataset,
        stop: Option<Stop>,
        settings: &mut Settings<'_>,
        lines: &mut Vec<String>,
    ) -> Result<Self, SystemError> {
        let cameras: Vec<DVec3> = data.views().iter().map(|v| v.camera.pose.c).collect();
        let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
        let (frame, note) = CloudFrame::around(&cameras, &points);
        lines.extend(note);
        lines.push(format!("frame: the cameras extend over {:.4} world units", frame.scale));
        let pace = CloudPace::of(data)?;
        let field_steps = start::field_steps(CloudPace::field_steps(stop));
        let StartConfig { start } = settings.of(&StartConfig::planned(scene, field_steps))?;
        let of_field = field_steps.filter(|_| start == StartKind::Field).unwrap_or(0);
        let stop = CloudPace::after_field(stop, of_field);
        let horizon = pace.steps(stop).map_or(HORIZON, |steps| (steps as u64).max(SHORTEST));
        let (coarse, coarse_steps) = (pace.halvings(), pace.coarse_steps(horizon));
        if coarse > 0 {
            lines.push(format!(
                "pictures begin {} times smaller ({} pixels each), and double after {coarse_steps} steps",
                1 << coarse,
                pace.pixels
            ));
        }
        lines.push(format!("schedule: of {horizon} steps"));
        let free_space = free_space_line(data);
        Ok(Self {
            cloud: CloudConfig {
                centre: frame.centre,
                radius: frame.scale,
                max_splats: pace.gaussians(horizon as f64),
                sh_every: horizon / 20,
                ..CLOUD
            },
            start,
            field_steps,
            rates: CloudRates { horizon, ..RATES },
            density: DensityConfig { free_space: free_space.is_some(), densify_until: horizon / 5 * 4, ..DENSITY },
            pictures: PictureConfig { coarse, coarse_steps, ..PICTURES },
            pace: Some(pace),
            free_space,
        })
    }

    /// The settings of the parts that are there, after `--set`.
    fn asked(&self, points: &[Point], settings: &mut Settings<'_>, seed: u64) -> Result<AskedParts, SystemError> {
        let cloud = settings.of(&self.cloud)?;
        cloud.check()?;
        let frame = CloudFrame { centre: cloud.centre, scale: cloud.radius };
        let split = SplitConfig { refill: self.start.refill(), ..SPLIT };
        let training = CloudTraining {
            cloud,
            rates: settings.of(&self.rates)?,
            density: DensityRules::asked(&PlannedDensity { schedule: self.density, split, ..CONTROL }, settings)?,
            extra: ExtraRows::default(),
        };
        training.rates.check()?;
        training.density.check()?;
        let start = self.start.asked(points, &training, &frame, settings, self.field_steps, seed)?;
        let (pictures, loss) = (settings.of(&self.pictures)?, settings.of(&LOSS)?);
        pictures.check()?;
        loss.check()?;
        Ok(AskedParts { training, frame, pictures, loss, start })
    }
}

/// Settings after `--set`.
struct AskedParts {
    training: CloudTraining,
    frame: CloudFrame,
    pictures: PictureConfig,
    loss: L1DssimConfig,
    start: AskedStart,
}

impl AskedParts {
    /// What the schedule takes of its time.
    fn time(&self, pace: &CloudPace) -> PlannedTime {
        let (rates, density) = (&self.training.rates, &self.training.density.schedule);
        let most = self.training.cloud.max_splats as f64;
        // They come evenly.
        let gaussians = |step: u64| (step as f64 / density.densify_until.max(1) as f64).min(1.0) * most;
        let shares = pace.shares(rates.horizon, |step| self.pictures.level(step), gaussians);
        PlannedTime { shares, horizon: rates.horizon }
    }
}

/// The settings of no scene, after `--set`.
fn of_nothing(points: &[Point], settings: &mut Settings<'_>) -> Result<AskedParts, SystemError> {
    let StartConfig { start } = settings.of(&START)?;
    Planned { start, ..Planned::OF_NOTHING }.asked(points, settings, 0)
}

/// All settings by name, whatever is chosen; values are of no scene.
pub(crate) fn names() -> toml::Table {
    let run = |set| RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
    let mut names = toml::Table::new();
    for set in [
        toml::toml! { start = "field" },
        toml::toml! { start = "field"
        density = "adc" },
        toml::toml! { start = "field"
        density = "mcmc" },
    ] {
        let run = run(set);
        let mut settings = Settings::new(&run);
        of_nothing(&[], &mut settings).expect("settings as published");
        names.extend(settings.all().expect("words of its own"));
    }
    names
}

#[cfg(test)]
mod tests {
    use super::start::Places;
    use super::*;

    #[test]
    fn settings_are_those_of_the_parts_that_are_there() {
        let asked = |set: toml::Table| {
            let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
            let mut settings = Settings::new(&run);
            of_nothing(&[], &mut settings).and_then(|_| settings.all())
        };
        let all = names();
        assert_eq!(all.len(), 37, "{all:?}");
        let adc = asked(toml::toml! { density = "adc" }).unwrap();
        assert!(
            adc.contains_key("reset_every") && !adc.contains_key("mcmc_cost") && !adc.contains_key("opacity_decay")
        );
        let split = asked(toml::Table::new()).unwrap();
        assert!(split.contains_key("opacity_decay") && !split.contains_key("mcmc_cost"));
        let mcmc = asked(toml::toml! { density = "mcmc" }).unwrap();
        assert!(mcmc.contains_key("mcmc_cost") && !mcmc.contains_key("reset_every"));
        let error = asked(toml::toml! { density = "mcmc"
        prune_size = 1.0 });
        assert!(error.unwrap_err().to_string().contains("prune_size"));
    }

    #[test]
    fn points_leave_no_settings_of_random_places() {
        let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: toml::Table::new() };
        let mut settings = Settings::new(&run);
        let points = [Point { xyz: DVec3::ZERO, rgb: [0; 3] }];
        let asked = of_nothing(&points, &mut settings).unwrap();
        assert!(matches!(asked.start.at, Places::Points(_)));
        assert!(!settings.all().unwrap().contains_key("start_count"));
    }

    #[test]
    fn what_cannot_work_is_refused_by_its_name() {
        for (name, value) in [
            ("radius", toml::Value::from(0.0)),
            ("max_splats", 0.into()),
            ("near_size", (-1.0).into()),
            ("sh_degree", 4.into()),
            ("start_count", 0.into()),
            ("refill", 1.5.into()),
            ("densify_every", 0.into()),
            ("densify_gradient", (-1.0).into()),
            ("lr_dc", f64::NAN.into()),
            ("near", 0.0.into()),
            ("smoothing", (-0.1).into()),
            ("coarse", 7.into()),
            ("dssim", 1.5.into()),
        ] {
            let set = toml::Table::from_iter([(name.to_owned(), value)]);
            let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
            let error = of_nothing(&[], &mut Settings::new(&run)).err().map(|e| e.to_string());
            assert!(error.as_ref().is_some_and(|e| e.contains(name)), "{name}: {error:?}");
        }
    }
}

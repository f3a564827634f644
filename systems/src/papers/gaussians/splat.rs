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

use super::recipe::{HORIZON, Recipe};
use super::start::StartKind;
use crate::claims::Claim;
use crate::plan::{Ask, Built};
use crate::views::{
    AdcConfig, CloudConfig, CloudRates, DensityConfig, DensityKind, L1DssimConfig, McmcConfig, PictureConfig,
    PlannedDensity, SplitConfig, WideningKind,
};

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

pub(super) const CLOUD: CloudConfig = CloudConfig {
    centre: [0.0; 3],
    radius: 1.0,
    max_splats: 100_000,
    near_size: 0.3,
    sh_degree: 3,
    sh_every: HORIZON / 20,
};
/// Rates of sizes and colours are twice those of the released code's `OptimizationParams`, the last one of centres ten times: there
/// are fewer steps. All fade at the end, which the paper's do not.
pub(super) const RATES: CloudRates = CloudRates {
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
    densify_absolute: false,
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
pub(super) const PICTURES: PictureConfig =
    PictureConfig { near: 0.01, widening: WideningKind::Dims, smoothing: 0.0, coarse: 0, coarse_steps: HORIZON / 4 };
/// Equation 7.
const LOSS: L1DssimConfig = L1DssimConfig { dssim: 0.2 };

/// What is planned of the density control.
pub(super) const CONTROL: PlannedDensity = PlannedDensity { schedule: DENSITY, adc: ADC, split: SPLIT, mcmc: MCMC };

/// The system.
static RECIPE: Recipe = Recipe {
    claim: CLAIM,
    start: StartKind::Points,
    cloud: CLOUD,
    rates: RATES,
    density: CONTROL,
    pictures: PICTURES,
    loss: Some(LOSS),
    motion: None,
    photos: None,
    layers: None,
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(ask: Ask<'_>) -> Built {
    RECIPE.build(ask)
}

/// All settings by name, whatever is chosen; values are of no scene.
pub(crate) fn names() -> toml::Table {
    RECIPE.names()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::papers::gaussians::start::Places;
    use crate::settings::Settings;
    use engine::options::RunOptions;
    use glam::DVec3;
    use scene_io::Point;

    #[test]
    fn settings_are_those_of_the_parts_that_are_there() {
        let asked = |set: toml::Table| {
            let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
            let mut settings = Settings::new(&run);
            RECIPE.of_nothing(&[], &mut settings).and_then(|_| settings.all())
        };
        let all = names();
        assert_eq!(all.len(), 38, "{all:?}");
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
        let asked = RECIPE.of_nothing(&points, &mut settings).unwrap();
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
            let error = RECIPE.of_nothing(&[], &mut Settings::new(&run)).err().map(|e| e.to_string());
            assert!(error.as_ref().is_some_and(|e| e.contains(name)), "{name}: {error:?}");
        }
    }
}

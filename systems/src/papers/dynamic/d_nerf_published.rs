//! D-NeRF on its published networks: `--system d-nerf --set field=mlp` (Pumarola, Corona, Pons-Moll, Moreno-Noguer, "D-NeRF: Neural
//! Radiance Fields for Dynamic Scenes", 2021).
//!
//! ```text
//! dx = Psi_t(gamma(x), gamma(t))  for t != 0,   0 for t = 0         (equation 3)   x' = x + dx
//! (c, sigma) = Psi_x(gamma(x'), gamma(d))                           (equation 2)
//! C(p, t) = sum of T alpha c along the ray of pixel p               (equations 5 to 9)
//! L = |C - C'|^2, coarse and fine                                   (equation 10)
//! ```
//!
//! `Psi_x` is the network of NeRF, 8 x 256 with 10 octaves of the point and 4 of the direction. `Psi_t` has the same trunk, sees the
//! point and the time, and the point alone once more at its sixth layer; its three outputs are the displacement. One pair of networks
//! serves both levels, 64 samples and 128 more, as in the released code.
//!
//! Equation 3 jumps at `t = 0`: nothing ties the displacement right after it to 0 (`origin=exact`). The default takes `Psi_t(x, t) -
//! Psi_t(x, 0)` instead (`origin=tied`), which is continuous, and as exactly 0 at `t = 0`. Rays of other times in the same batch are
//! displaced, those of `t = 0` are not: a batch is not of one time.
//!
//! Training (section 4.2 and the released settings): Adam, a rate that falls to a tenth, first rays of the middle of the photos only,
//! frames in the order of time. All of it in shares of the run, of which nobody here waits for the published 800 000 steps.

mod settings;

use crate::claims::Claim;
use crate::networks::{Along, Footprint, Level, NetworkShape, Recipe, Tile, TwoLevel};
use crate::papers::static_scenes::nerf::{self, NerfConfig};
use crate::papers::static_scenes::place::space_of;
use crate::plan::{Ask, Built, Ground, planned};
use crate::space::{InternalRay, Space};
use crate::warps::{Curriculum, Times};
use engine::data::DrawnFrom;
use engine::system::SystemError;
use field_core::encoding::frequency::Frequency;
use field_core::rng::Rng;
use field_core::tape::{Node, Tape, TapeError};
use optim::AdamConfig;
use render_core::ray::RayBar;
use settings::{DisplacementSettings, ScheduleSettings, likely_steps};

/// What differs from the paper; the name says how it is asked for.
pub(crate) const CLAIM: Claim = Claim {
    name: "d-nerf, field=mlp",
    paper: "Pumarola et al., 2021",
    what: "A displacement into the scene of time 0 by the published networks",
    take: "to compare with the original; days",
    differs: "Networks, samples and rates are the released ones, but displacements are less that of t = 0 (`origin=exact` jumps \
              there, as published) and begin near 0. Batches are of 128 rays of all photos instead of 500 of one, rays begin and \
              end at the scene's box, and the last interval is finite. Decay, middle crop (2 %) and curriculum are shares of the \
              run.",
    mark: "published networks, t = 0 tied, batches of 128 rays",
};

/// The published networks for some training views.
#[derive(Clone, Debug)]
pub(crate) struct DNerfNetworks {
    /// `Psi_x`, and where rays are sampled.
    canonical: NerfConfig,
    /// `Psi_t`.
    displacement: DisplacementSettings,
    schedule: ScheduleSettings,
    times: Times,
    /// `[views]`
    view_times: Vec<f32>,
    /// Which frames have come in.
    curriculum: Curriculum,
}

impl DNerfNetworks {
    fn new(
        canonical: NerfConfig,
        displacement: DisplacementSettings,
        schedule: ScheduleSettings,
        times: Times,
    ) -> Self {
        Self {
            curriculum: Curriculum::over(&times, schedule.curriculum_share),
            view_times: times.of_views().map(|t| t as f32).collect(),
            canonical,
            displacement,
            schedule,
            times,
        }
    }

    /// Small networks for views of these times, which learn fast: for tests.
    #[cfg(test)]
    pub(crate) fn small(canonical: NerfConfig, shape: crate::networks::DisplacementShape, times: &[f64]) -> Self {
        let schedule = ScheduleSettings { lr: 5e-3, ..ScheduleSettings::published(1000) };
        Self::new(canonical, DisplacementSettings::of(shape), schedule, Times::of_list(times))
    }
}

impl Recipe for DNerfNetworks {
    const NAME: &'static str = "d-nerf";
    const ADAM: AdamConfig = AdamConfig::DEFAULT;
    const FOOTPRINT: Footprint = Footprint::Point;
    type Position = Frequency;

    fn check(&self) -> Result<(), SystemError> {
        self.canonical.check()?;
        self.displacement.check()?;
        self.schedule.check()
    }

    fn networks(&self) -> usize {
        if self.displacement.fine_networks { 2 } else { 1 }
    }

    fn network(&self) -> Result<NetworkShape<Frequency>, SystemError> {
        // (c, sigma) = Psi_x(gamma(x + dx), gamma(d)) (equation 2), dx by Psi_t (equation 3).
        Ok(NetworkShape { displacement: Some(self.displacement.shape()), ..self.canonical.network()? })
    }

    fn batch_rays(&self) -> usize {
        self.canonical.batch_rays()
    }

    fn drawn_from(&self, step: u64) -> DrawnFrom<'_> {
        DrawnFrom { views: self.curriculum.open(self.schedule.passed(step)), middle: self.schedule.middle(step) }
    }

    fn view_times(&self) -> &[f32] {
        &self.view_times
    }

    fn variation(&self) -> f32 {
        self.displacement.variation
    }

    fn time_beside(&self, view: usize, u: [f32; 2]) -> f32 {
        self.times.beside(view, u) as f32
    }

    fn learning_rate(&self, step: u64) -> f64 {
        self.schedule.learning_rate(step)
    }

    fn level_weight(&self, level: usize) -> f32 {
        self.canonical.level_weight(level)
    }

    fn density_noise(&self) -> f32 {
        self.canonical.density_noise()
    }

    fn density(&self, tape: &mut Tape<'_>, raw: Node) -> Result<Node, TapeError> {
        self.canonical.density(tape, raw)
    }

    fn density_of(&self, raw: f32) -> f32 {
        self.canonical.density_of(raw)
    }

    fn fill_coarse(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        self.canonical.fill_coarse(space, rays, random, tile);
    }

    fn fill_fine(&self, space: &Space, rays: &[InternalRay], random: Option<&Rng>, tile: &mut Tile) {
        self.canonical.fill_fine(space, rays, random, tile);
    }

    fn pull_rays(&self, space: &Space, along: &Along<'_>, x_bar: &[f32], bars: &mut [RayBar]) {
        self.canonical.pull_rays(space, along, x_bar, bars);
    }

    fn place_points(&self, space: &Space, n: usize, level: &mut Level) {
        self.canonical.place_points(space, n, level);
    }
}

/// The published networks in the scene's box, before white where the photos have alpha.
pub(super) fn build(ask: Ask<'_>) -> Built {
    let Ask { scene, data, run, mut settings, .. } = ask;
    let mut ground = Ground::of_times(scene, data, run)?;
    ground.prefer_white(run);
    ground.lines.extend(CLAIM.line());
    let published = nerf::settings(&ground);
    let canonical = NerfConfig { levels: published.levels.asked(&mut settings)?, ..published };
    let displacement = settings.of(&DisplacementSettings::RELEASED)?;
    let schedule = ScheduleSettings::published(likely_steps(run.stop, &canonical.levels, &displacement));
    let schedule = settings.of(&schedule)?;
    let all = settings.all()?;
    ground.lines.push(format!("schedule: shares of {} steps", schedule.horizon));
    let config = DNerfNetworks::new(canonical, displacement, schedule, Times::of(data));
    let space = space_of(&ground, data, &canonical.levels)?;
    let system = TwoLevel::new(config, space, ground.background, run.seed)?;
    Ok((Box::new(system), planned(ground, all)))
}

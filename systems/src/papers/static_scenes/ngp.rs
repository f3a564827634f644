//! Instant-NGP: a hash grid, two tiny networks, an occupancy grid.
//!
//! Müller, Evans, Schied, Keller, "Instant Neural Graphics Primitives with a Multiresolution Hash Encoding", 2022.
//!
//! ```text
//! N_l = floor(N_min b^l),  b = (N_max / N_min)^(1 / (L - 1))          resolutions of the levels (equations 2, 3)
//! h(x) = (x_1 pi_1 xor x_2 pi_2 xor x_3 pi_3) mod T                   the entry of a corner (equation 4)
//! f(x) = concat_l trilinear_l(x)                                      features: `fields::HashGridFeatures`
//! (log sigma, g) = MLP(f(x)),  c = MLP(g, SH(d))                      density is an exponential (section 5.4)
//! t_{i+1} = t_i + dt, where the occupancy grid is not empty           `samplers::Occupancy` (appendix E)
//! ```
//!
//! Adam with `epsilon` of 1e-15, L2 on the networks' weights alone. With `sampler=proposal` small density fields place the samples
//! instead of an occupancy grid (mip-NeRF 360, section 3), for space without end.
//!
//! What differs from the paper, and why: `docs/decisions/0003-ngp-on-a-cpu.md`.

use crate::claims::Claim;
use crate::plan::{Ask, Built, CloudPace, Moving, Shown, chosen_sampler, field_settings, moving_field, planned};

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "ngp",
    paper: "Müller et al., 2022",
    what: "Features in a hash table at several resolutions, two small networks, an occupancy grid; contracted space where the \
           scene has no end, NDC where the photos face one way",
    take: "seconds to minutes of training, small photos; meshes, points and densities",
    differs: "Set for minutes on a CPU: 8 levels of 4 features, networks half as wide, squared error, no moving average of the \
          weights, cells of the occupancy grid and steps from the size of a pixel. Where space has no end it is contracted \
          and a distortion loss is added.",
    mark: "settings for a CPU",
};

/// The fast field with settings for this scene. Of photos that each show a time of its own it is what stays the same.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    if Shown::of(ask.scene) == Shown::Times {
        return moving_field(ask, &Moving::STILL);
    }
    let mut ground = ask.ground()?;
    let mut config = field_settings(&mut ground, ask.data);
    config.rates = config.rates.until(CloudPace::of_field(ask.run.stop));
    ground.lines.push(format!("rates: they fall after {} steps", config.rates.lr_hold));
    let config = chosen_sampler(config, &mut ask.settings)?;
    let all = ask.settings.all()?;
    let system = ground.ngp(ask.data, &config, ask.run.seed, None)?;
    Ok((Box::new(system), planned(ground, all)))
}

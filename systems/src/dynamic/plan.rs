//! What does this video need? The system built from its name and its settings.

use super::rays::RaySettings;
use crate::claims::{Claim, claims_of, names};
use crate::papers::dynamic::{d_nerf, endo_nerf, hyper_nerf, k_planes, nerfies, t_nerf, tineuvox};
use crate::papers::static_scenes::ngp;
use crate::plan::{Ground, Shown, accepts_no_parallax, has_no_parallax, ngp_settings, no_parallax, set_near};
use crate::rays::{RayConfig, RaySystem};
use crate::samplers::CueConfig;
use crate::settings::{Settings, no_such_system};
use crate::warps::{Deform, Times};
use engine::data::Dataset;
use engine::error::RunError;
use engine::options::{DataOptions, Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;

/// A deformation from its settings, the times of the training views and a seed.
type NewDeform = fn(&mut Settings<'_>, Times, u64) -> Result<Deform, SystemError>;

/// A system: what its name claims, its deformation, its rays, what it makes of measured depth, and what it changes of its field.
struct Known {
    claim: Claim,
    deform: Option<NewDeform>,
    rays: RaySettings,
    depth: CueConfig,
    field: fn(&mut RayConfig, &Dataset),
}

impl Known {
    /// A field in which nothing moves.
    const STILL: Self =
        Self { claim: ngp::CLAIM, deform: None, rays: RaySettings::ANYWHERE, depth: CueConfig::NONE, field: |_, _| {} };

    /// A field that a deformation moves.
    const fn moving(claim: Claim, deform: NewDeform) -> Self {
        Self { claim, deform: Some(deform), ..Self::STILL }
    }
}

const KNOWN: [Known; 8] = [
    Known::STILL,
    Known::moving(t_nerf::CLAIM, t_nerf::deform),
    Known::moving(d_nerf::CLAIM, d_nerf::deform),
    Known::moving(nerfies::CLAIM, nerfies::deform),
    Known::moving(hyper_nerf::CLAIM, hyper_nerf::deform),
    Known { field: tineuvox::field, ..Known::moving(tineuvox::CLAIM, tineuvox::deform) },
    Known { claim: k_planes::CLAIM, field: k_planes::field, ..Known::STILL },
    Known {
        rays: RaySettings { guided: endo_nerf::GUIDED, ..RaySettings::ANYWHERE },
        depth: endo_nerf::DEPTH,
        ..Known::moving(endo_nerf::CLAIM, endo_nerf::deform)
    },
];

/// Systems by name, with what differs from their papers.
pub const CLAIMS: [Claim; KNOWN.len()] = claims_of!(KNOWN);

/// Systems by name.
pub const SYSTEMS: [&str; KNOWN.len()] = names(&CLAIMS);

/// The scene a word or path names; images without times are in the order of time.
///
/// # Errors
/// As [`engine::source::load`].
pub fn load(spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    let mut scene = engine::source::load(spec, data)?;
    scene.time_by_order();
    Ok(scene)
}

/// Weight of a ray that its faintest samples may have together to be left out in training: half a step of 8 bits.
const FAINT: f32 = 0.002;

/// Build the system `name` for a scene.
///
/// # Errors
/// As [`crate::registry::build`].
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let known = KNOWN.iter().find(|known| known.claim.name == name).ok_or_else(|| no_such_system(name, SYSTEMS))?;
    let mut settings = Settings::new(run);
    let rays = settings.of(&known.rays)?;
    rays.check()?;
    let depth = settings.of(&known.depth)?;
    depth.check()?;
    let deform = known.deform.map(|new| new(&mut settings, Times::of(data), run.seed)).transpose()?;
    let deform = deform.filter(Deform::does_something).map(|deform| deform.with_curriculum(rays.curriculum));
    let has_depth = data.views().iter().any(|view| view.source.depth.is_some());
    let measured = has_depth && depth.asks();
    let frozen = !accepts_no_parallax(run)? && has_no_parallax(data);
    if frozen && has_depth {
        check_depth(name, data, measured)?;
    }
    let mut ground =
        if measured { Ground::with_depth(scene, data, run) } else { Ground::of_moments(scene, data, run) }?;
    ground.lines.extend(known.claim.line());
    let mut field = ngp_settings(&ground.layout, data, (Shown::Moments, ground.transparent), &mut ground.lines);
    set_near(&mut field.space, &mut ground, data, Shown::Moments);
    if deform.is_some() {
        // Cells that are full at some time are empty at most others.
        field.batch.train_faint = FAINT;
    }
    (known.field)(&mut field, data);
    let field = field.asked(&mut settings)?;
    let config = settings.all()?;
    let mut system = ground.moving(data, &field, run.seed, scene, known.claim.name, deform)?;
    ground.lines.extend(follow(&mut system, data, &rays)?);
    if depth.asks() {
        let known = system.follow_depth(depth, data)?;
        if frozen && !known {
            return Err(no_depth(data));
        }
        ground.lines.push(if known {
            "depth: measured depths lead samples and are held to".into()
        } else {
            "depth: none is measured, so nothing is held to it".into()
        });
    }
    let Ground { lines, background, error_budget, .. } = ground;
    Ok((Box::new(system), Plan { lines, background, error_budget, config }))
}

/// Let errors or masks lead the rays. Returns what is done, a line each.
fn follow(system: &mut RaySystem, data: &Dataset, rays: &RaySettings) -> Result<Vec<String>, SystemError> {
    let mut lines = Vec::new();
    if rays.by_error {
        system.follow_errors(data);
        lines.push("rays: half of them where the errors are".into());
    }
    if rays.guided {
        lines.push(match system.follow_masks(data)? {
            Some(0) => "rays: none under the masks, more where they often are".into(),
            Some(hidden) => format!(
                "rays: none under the masks, more where they often are; {hidden} of {} photos lie all under theirs and are \
                 left out",
                data.len()
            ),
            None => "rays: anywhere (no masks, masks over everything, or views of different sizes)".into(),
        });
    }
    Ok(lines)
}

/// A camera that stands still sees depth by what was measured, or not at all.
fn check_depth(name: &str, data: &Dataset, measured: bool) -> Result<(), SystemError> {
    if !has_known_depth(data)? {
        return Err(no_depth(data));
    }
    if measured {
        return Ok(());
    }
    let what = format!("no parallax, and `{name}` makes nothing of the depth that was measured");
    Err(no_parallax(data, &format!("{what}; use `endo-nerf`, set `depth=1`")))
}

/// Whether any pixel of any depth map is known: usually the first map answers.
fn has_known_depth(data: &Dataset) -> Result<bool, SystemError> {
    for view in data.views() {
        if view.source.read_depth()?.is_some_and(|map| map.z.iter().any(|&z| z > 0.0)) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn no_depth(data: &Dataset) -> SystemError {
    let and =
        "no parallax, and their depth maps are nothing but holes (0, or no number), so no depth; check the depth maps";
    no_parallax(data, and)
}

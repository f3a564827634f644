//! What does this scene need of a cloud of Gaussians?

use super::config::{SplatConfig, StartKind};
use super::frame::Frame;
use super::sight::Sight;
use super::splat::Splat;
use super::start::{Start, StartOptions, scene_box};
use crate::claims::Claim;
use crate::free_space::free_space_line;
use crate::plan::{Ask, Built, Ground};
use engine::memory::room_for;
use engine::options::Plan;
use engine::system::SystemError;
use glam::DVec3;
use splat_core::Gaussians;

/// Pictures of more pixels than this begin smaller: a step of half the size costs a third, and what is coarse is learnt as well.
const COARSE_PIXELS: u64 = 65_536;
/// Steps that the schedules are for.
const HORIZON: u64 = 10_000;

/// What differs from the paper.
pub(crate) const CLAIM: Claim = Claim {
    name: "splat",
    paper: "Kerbl et al., 2023",
    differs: "Opacities are never reset, large Gaussians are not pruned, there are at most 100 000, the schedules take a \
              third of the steps, and large photos are drawn at half their size first. Random starts keep to places that \
              no photo shows to be empty.",
    mark: "no opacity reset, no size prune",
};

/// A cloud at its start, and why it is as it is.
pub(crate) fn build(mut ask: Ask<'_>) -> Built {
    let (scene, data, run) = (ask.scene, ask.data, ask.run);
    let Ground { layout, mut lines, background, error_budget, .. } = Ground::of_clouds(scene, data, run)?;
    let cameras: Vec<DVec3> = data.views().iter().map(|v| v.camera.pose.c).collect();
    let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
    let (frame, note) = Frame::around(&cameras, &points);
    lines.extend(note);
    lines.push(format!("frame: the cameras extend over {:.4} world units", frame.scale));
    let pixels = data.pixel_count() / data.len().max(1) as u64;
    let coarse = (pixels.max(1) / COARSE_PIXELS).checked_ilog2().map_or(0, |octaves| octaves / 2 + 1).min(4);
    if coarse > 0 {
        lines.push(format!("pictures begin {} times smaller ({pixels} pixels each)", 1 << coarse));
    }
    let free_space = free_space_line(data);
    let planned = SplatConfig {
        coarse,
        free_space: free_space.is_some(),
        start: if scene.points.is_empty() { StartKind::Random } else { StartKind::Points },
        ..SplatConfig::published(frame.centre, frame.scale, HORIZON)
    };
    let config: SplatConfig = ask.settings.of(&planned)?;
    let all = ask.settings.all()?;
    config.check()?;
    lines.extend(free_space.filter(|_| config.free_space));
    let frame = Frame { centre: config.centre, scale: config.radius };
    let options =
        StartOptions { degree: config.sh_degree, max: config.max_splats, random: config.start_count, seed: run.seed };
    let refused = |e: splat_core::SplatError| SystemError::Config {
        field: "max_splats",
        value: config.max_splats.to_string(),
        problem: e.to_string(),
    };
    let mut start = match config.start {
        StartKind::Points => Start::from_points(&scene.points, &frame, &options).map_err(refused)?,
        StartKind::Random => Start::default(),
    };
    if start.cloud.is_empty() {
        let count = config.start_count.min(config.max_splats);
        let one = Gaussians::new(0, config.sh_degree).map_err(refused)?.parameters_per_gaussian();
        room_for("start_count", count, count.saturating_mul(one))?;
        let sight = Sight::new(data)?;
        start = Start::random(scene_box(&layout, data), &frame, &options, |x| sight.of(x)).map_err(refused)?;
    }
    lines.extend(start.notes.iter().map(|note| format!("start: {note}")));
    lines.push(format!("at most {} Gaussians", config.max_splats));
    let bent = data.views().iter().filter(|v| !v.camera.lens.is_pinhole()).count();
    if bent > 0 {
        lines.push(format!("lenses: {bent} photos are drawn onto a plane for training, and pictures from it"));
    }
    let splat = Splat::new(config, frame, start, background, run.seed, data)?;
    lines.extend(ask.claim.line());
    Ok((Box::new(splat), Plan { lines, background, error_budget, config: all }))
}

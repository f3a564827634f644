//! Settings of the fast field for photos of a scene that stands still: where rays begin and end, and what is empty before the
//! first step. `nerf-static` and `nerf-wild` share them.

use super::ground::Ground;
use super::near::set_near;
use super::ngp_settings::{Shown, ngp_settings};
use crate::free_space::{AlsoFree, free_space_line};
use crate::rays::RayConfig;
use crate::space::SpaceKind;
use engine::data::Dataset;
use engine::options::Background;

/// Settings of `ngp` for a scene, each decision with its line. Where space has no end, what one photo alone shows must not find a
/// place right before its camera: rays begin at `near`, what lies before points is empty, and rays end at the sky.
pub(crate) fn field_settings(ground: &mut Ground, data: &Dataset) -> RayConfig {
    let mut config = ngp_settings(&ground.layout, data, Shown::Scene, ground.transparent, &mut ground.lines);
    if ground.layout.kind != SpaceKind::Contracted {
        return config;
    }
    let sky = !ground.transparent && ground.background == Background::Random;
    if sky {
        ground.lines.push("sky: every ray ends at infinity, in a colour of its direction".into());
    }
    let free_space = free_space_line(data, AlsoFree::BeforePoints);
    if let Some(occupancy) = config.occupancy_mut() {
        (occupancy.sky, occupancy.free_space) = (sky, free_space.is_some());
    }
    ground.lines.extend(free_space);
    set_near(&mut config.space, ground, data, Shown::Scene);
    config
}

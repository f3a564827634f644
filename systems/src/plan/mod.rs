//! What does this scene need? Settings from the scene, with a line of reason for each.
//!
//! * `ground`: the layout, the background and the alpha of a scene;
//! * `field_settings`: where rays of a field begin and end, and what is empty before the first step;
//! * `moving`: the plan of a field where each photo shows a time of its own;
//! * `pace`: how many steps of a cloud there will be; `speed`: how fast this machine makes them;
//! * `still_part`: whether what stands still is a field of its own;
//! * `backdrop`: whether the photos stand before one plain colour.

mod ask;
mod backdrop;
mod field_settings;
mod ground;
#[cfg(test)]
pub(crate) mod made;
mod moving;
mod near;
mod ngp_settings;
mod pace;
mod parallax;
mod ray_choice;
mod speed;
mod still_part;

pub(crate) use ask::{Ask, Built, planned};
pub(crate) use backdrop::backdrop;
pub(crate) use field_settings::field_settings;
pub(crate) use ground::{Ground, MovingParts, has_alpha, percent, space};
#[cfg(test)]
pub(crate) use moving::NewFlow;
pub(crate) use moving::{DepthUse, Moving, check_still_camera, moving_field};
#[cfg(test)]
pub(crate) use ngp_settings::HASH_GRID;
pub(crate) use ngp_settings::{Shown, chosen_sampler, names as field_names};
pub(crate) use pace::{CloudPace, FieldShare};
pub(crate) use ray_choice::RaySettings;
pub use speed::machine_speed;
pub(crate) use still_part::Background;

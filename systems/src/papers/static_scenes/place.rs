//! Where a scene is, for systems of two levels.

use crate::networks::{PlaceConfig, RaysConfig, TwoLevelConfig};
use crate::plan::{Ground, space};
use crate::space::Space;
use engine::data::Dataset;
use engine::system::SystemError;

/// Settings of two levels in the place of a scene.
pub(super) fn placed(levels: TwoLevelConfig, ground: &Ground) -> TwoLevelConfig {
    let layout = &ground.layout;
    TwoLevelConfig {
        place: PlaceConfig { centre: layout.centre.to_array(), radius: layout.radius, ..levels.place },
        rays: RaysConfig { extent: f64::from(1_u32 << (layout.cascades - 1)), ..levels.rays },
        ..levels
    }
}

/// The space of these settings.
///
/// # Errors
/// [`SystemError::Config`] for a space that the cameras do not fit.
pub(in crate::papers) fn space_of(
    ground: &Ground,
    data: &Dataset,
    levels: &TwoLevelConfig,
) -> Result<Space, SystemError> {
    let (place, rays) = (levels.place, levels.rays);
    space(&ground.layout, data, place.space, place.centre, place.radius, rays.extent, rays.near)
}

//! Gaussians where photos say that nothing is: points behind are seen through there. One photo alone is explained as well by what
//! floats before its camera.

use super::cloud_frame::CloudFrame;
use crate::free_space::{AlsoFree, free_cells};
use crate::space::Space;
use engine::data::Dataset;
use engine::system::SystemError;
use glam::DVec3;
use rayon::prelude::*;
use render_core::occupancy::{GridSettings, OccupancyGrid};
use splat_core::density::Rows;
use splat_core::{Gaussians, SplatError};

/// Cells along an axis of each cube, and cubes; the innermost holds the cameras, each next one is twice as large.
const SETTINGS: GridSettings =
    GridSettings::DEFAULT.with_resolution(96).with_cascades(4).with_decay(1.0).with_threshold(0.0);

/// Bytes at most: of a cell a number that stays, and four while it is judged; bits.
pub(super) const BYTES: usize = SETTINGS.cascades as usize * (SETTINGS.resolution as usize).pow(3) * (4 + 4 + 1);

/// Cells about the cameras that points are seen through.
pub(super) struct FreeSpace {
    space: Space,
    /// Free cells are marked as those that no camera sees.
    grid: OccupancyGrid,
}

impl FreeSpace {
    /// What the points of the photos say.
    ///
    /// # Errors
    /// [`SystemError::Config`] for a grid that cannot be made.
    pub(super) fn new(data: &Dataset, frame: &CloudFrame) -> Result<Self, SystemError> {
        let refused = |e: render_core::occupancy::GridError| SystemError::Config {
            field: "free_space",
            value: "true".into(),
            problem: e.to_string(),
        };
        let mut grid = OccupancyGrid::new(SETTINGS).map_err(refused)?;
        let space = Space::contracted(frame.centre.into(), frame.scale, f64::from(grid.half_extent()), 0.0);
        let free = free_cells(&grid, &space, data, AlsoFree::WhereOthersStood);
        let mut cells = free.iter();
        // Asked for every cell in order: none is marked yet.
        grid.mark_invisible(|_, _| !cells.next().copied().unwrap_or(false));
        Ok(Self { space, grid })
    }

    /// Whether nothing is at `x`, world units.
    fn holds(&self, x: DVec3) -> bool {
        let Some(p) = self.space.internal_point(x) else { return false };
        p.iter().all(|x| x.abs() < self.grid.half_extent()) && !self.grid.occupied(p, 0.0)
    }

    /// The rows of those whose centres are not in free space; `None` where that is all of them.
    pub(super) fn without_floaters(&self, cloud: &Gaussians, frame: &CloudFrame) -> Result<Option<Rows>, SplatError> {
        cloud.check()?;
        let n = cloud.len();
        let floats: Vec<bool> = (0..n)
            .into_par_iter()
            .map(|i| self.holds(frame.to_world([0, 1, 2].map(|k| f64::from(cloud.mean[k * n + i])).into())))
            .collect();
        floats.contains(&true).then(|| Rows::keep(n, |i| !floats[i])).transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;
    use crate::registry::build;
    use engine::options::RunOptions;
    use engine::render::plain_query;
    use scene_io::{Point, Scene};

    /// A place before a camera that points are seen through: halfway to one that it shows.
    fn seen_through(data: &Dataset) -> DVec3 {
        0.5 * (data.view(0).camera.pose.c + data.view(0).points[0])
    }

    fn capture() -> (Scene, Dataset, FreeSpace, CloudFrame) {
        let (scene, data) = made::capture(made::Points::WithTracks);
        let frame = CloudFrame { centre: [0.3, -0.1, 0.2], scale: 2.5 };
        let free = FreeSpace::new(&data, &frame).unwrap();
        (scene, data, free, frame)
    }

    /// A cloud of the frame with its Gaussians at places of the world.
    fn cloud(frame: &CloudFrame, places: &[DVec3]) -> Gaussians {
        let mut cloud = Gaussians::new(places.len(), 0).unwrap();
        for (i, x) in places.iter().enumerate() {
            let x = frame.to_internal(*x).as_vec3();
            for (k, x) in x.to_array().into_iter().enumerate() {
                cloud.mean[k * places.len() + i] = x;
            }
        }
        cloud
    }

    #[test]
    fn what_points_are_seen_through_goes_and_the_rest_stays_in_its_order() {
        let (scene, data, free, frame) = capture();
        let far = DVec3::splat(1e9);
        let places = [scene.points[0].xyz, seen_through(&data), scene.points[1].xyz, far, DVec3::NAN];
        let rows = free.without_floaters(&cloud(&frame, &places), &frame).unwrap().unwrap();
        assert_eq!(rows.from(), [0, 2, 3, 4]);
        let nothing_goes = |places: &[DVec3]| free.without_floaters(&cloud(&frame, places), &frame).unwrap().is_none();
        assert!(nothing_goes(&[far, DVec3::NAN]) && nothing_goes(&[]));
        let points: Vec<DVec3> = scene.points.iter().map(|p| p.xyz).collect();
        assert!(nothing_goes(&points), "what the points are is not free");
    }

    #[test]
    fn a_training_removes_what_floats_unless_told_not_to() {
        let (mut scene, data, free, _) = capture();
        scene.points.push(Point { xyz: seen_through(&data), ..scene.points[0] });
        for (set_to, floats) in [(None, false), (Some(false), true)] {
            let set = set_to.map(|free_space: bool| ("free_space".to_owned(), free_space.into())).into_iter().collect();
            let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
            let (mut system, plan) = build("splat", &scene, &data, &run).unwrap();
            assert_eq!(plan.config["free_space"].as_bool(), Some(!floats));
            let every = plan.config["densify_every"].as_integer().unwrap() as u64;
            for step in 0..every {
                system.step(&data, step).unwrap();
            }
            let splats = system.splats(&plain_query([0.0; 3], 0.0)).unwrap().gaussians;
            assert_eq!(free.without_floaters(&splats, &CloudFrame::WORLD).unwrap().is_some(), floats);
        }
    }

    #[test]
    fn without_points_no_place_is_free() {
        let (scene, data) = made::capture(made::Points::None);
        let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set: Default::default() };
        let (_, plan) = build("splat", &scene, &data, &run).unwrap();
        assert_eq!(plan.config["free_space"].as_bool(), Some(false));
        let free = FreeSpace::new(&data, &CloudFrame::WORLD).unwrap();
        assert!([DVec3::ZERO, data.view(0).camera.pose.c, DVec3::splat(0.5)].iter().all(|x| !free.holds(*x)));
    }
}

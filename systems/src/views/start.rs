//! Where a cloud begins.
//!
//! | what | from points | at random |
//! | --- | --- | --- |
//! | position | the point | uniform in a box, but for what photos rule out |
//! | colour | the point's, the same from everywhere | the mean of the photos' there |
//! | size | `sqrt(max(m, 1e-7))`, at most a tenth of the extent; `m` the mean of the squared distances to the three nearest others | the same |
//! | opacity | 0.1 | 0.1 |
//!
//! All in the [`CloudFrame`] of training, where the extent is 1. Points behind all cameras are kept: a photo that is added later may
//! see them.

use super::cloud_frame::CloudFrame;
use super::cloud_parameters::joined;
use super::sky::{SkyPlace, SkySphere};
use crate::layout::Layout;
use crate::plan::space;
use engine::data::Dataset;
use engine::neighbours::mean_squared_distances;
use field_core::rng::Rng;
use glam::DVec3;
use rayon::prelude::*;
use scene_io::{Bounds, Point};
use splat_core::density::logit;
use splat_core::{Gaussians, SH_0, SplatError};

/// Opacity of all.
const OPACITY: f64 = 0.1;
/// Smallest mean of squared distances, largest size, and size of a point alone: internal units.
const LEAST_SQUARE: f64 = 1e-7;
const LARGEST: f64 = 0.1;
const ALONE: f64 = 0.01;
/// Places are drawn so often as many as are wanted, at most.
const ROUNDS: u64 = 64;
/// Stream of random numbers.
const STREAM: u64 = 0x5350_4C41_5453;

/// A place of a surface, as a pixel of a photo sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    /// The scene's frame.
    pub(crate) x: DVec3,
    /// Size of the pixel there, world units.
    pub(crate) pixel: f64,
    /// The photo's colour.
    pub(crate) rgb: [f32; 3],
}

/// How a cloud begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StartOptions {
    /// Degree of the spherical harmonics there is room for; all coefficients but the constant one are 0.
    pub degree: usize,
    /// No more Gaussians than this.
    pub max: usize,
    /// How many where there are no points.
    pub random: usize,
    /// Seed of everything random.
    pub seed: u64,
}

/// A cloud to begin with.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Start {
    /// In the frame of training.
    pub cloud: Gaussians,
    /// What was taken, left out and assumed, for people.
    pub notes: Vec<String>,
}

impl Start {
    /// At reconstructed points. Where there are more than `max`, every second, third, … is taken; points that no `f32` can hold are
    /// left out.
    ///
    /// # Errors
    /// [`SplatError::Degree`].
    ///
    /// # Source
    /// Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023, section 5.1 and released code.
    pub fn from_points(points: &[Point], frame: &CloudFrame, options: &StartOptions) -> Result<Self, SplatError> {
        let usable: Vec<&Point> = points.iter().filter(|p| fits(p, frame)).collect();
        let mut notes = Vec::new();
        if usable.len() < points.len() {
            notes.push(format!(
                "{} of {} points left out: their positions are not finite numbers",
                points.len() - usable.len(),
                points.len()
            ));
        }
        let count = usable.len().min(options.max);
        let taken = |k: usize| usable[(k as u128 * usable.len() as u128 / count as u128) as usize];
        let inside: Vec<[f64; 3]> = (0..count).map(|k| frame.to_internal(taken(k).xyz).to_array()).collect();
        let colour = |k: usize| taken(k).rgb.map(|v| f32::from(v) / 255.0);
        notes.push(if count < usable.len() {
            format!(
                "{count} Gaussians at points of the dataset, spread evenly over its {}: no more are allowed",
                usable.len()
            )
        } else {
            format!("{count} Gaussians at the points of the dataset")
        });
        Self::at(&inside, colour, options.degree, notes)
    }

    /// At `random` places (no more than `max`), uniform in a box of the scene's frame, where photos do not show that nothing is:
    /// what is transparent in one of them is empty, what hardly any has in the picture would not learn. Each begins with the mean of
    /// the colours seen there: `colour_at` says which, or `None` of a place that is ruled out.
    ///
    /// # Errors
    /// [`SplatError::Degree`].
    pub fn random(
        within: Bounds,
        frame: &CloudFrame,
        options: &StartOptions,
        colour_at: impl Fn(DVec3) -> Option<[f32; 3]> + Sync,
    ) -> Result<Self, SplatError> {
        let count = options.random.min(options.max);
        let rng = Rng::new(options.seed, STREAM);
        let draw = |k: u64| {
            let [x, y, z, _] = rng.uniform4_at(k).map(f64::from);
            within.min + DVec3::new(x, y, z) * (within.max - within.min)
        };
        let (mut inside, mut colours) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let batch = count.max(1) as u64;
        for round in 0..ROUNDS {
            let range = round * batch..(round + 1) * batch;
            let found: Vec<_> = range.into_par_iter().filter_map(|k| Some((draw(k), colour_at(draw(k))?))).collect();
            for (x, rgb) in found {
                if inside.len() < count {
                    inside.push(frame.to_internal(x).to_array());
                    colours.push(rgb);
                }
            }
            if inside.len() == count {
                break;
            }
        }
        let mut notes = Vec::new();
        if inside.is_empty() {
            // Nothing is certain of photos that agree on no place: anywhere, then.
            notes.push("no place is seen by two photos that both show something there".to_string());
            inside = (0..batch.min(count as u64)).map(|k| frame.to_internal(draw(k)).to_array()).collect();
            colours = vec![[0.5; 3]; inside.len()];
        }
        let size = within.max - within.min;
        notes.push(format!(
            "{} Gaussians at random in a box of {:.3} x {:.3} x {:.3}, where photos do not rule them out",
            inside.len(),
            size.x,
            size.y,
            size.z
        ));
        Self::at(&inside, |k| colours[k], options.degree, notes)
    }

    /// At places of the scene's frame with their colours, those first that there is room for.
    ///
    /// # Errors
    /// [`SplatError::Degree`].
    pub(crate) fn at_places(places: &[Place], frame: &CloudFrame, degree: usize) -> Result<Self, SplatError> {
        let inside: Vec<[f64; 3]> = places.iter().map(|place| frame.to_internal(place.x).to_array()).collect();
        Self::at(&inside, |k| places[k].rgb, degree, Vec::new())
    }

    /// Add Gaussians of the sky, as many as there is room for where no more than `most` are allowed.
    pub(crate) fn add_sky(
        &mut self,
        sphere: &SkySphere,
        places: &[SkyPlace],
        frame: &CloudFrame,
        most: usize,
    ) -> Result<(), SplatError> {
        let room = most.saturating_sub(self.cloud.len());
        let more = sphere.gaussians(places, frame, self.cloud.degree(), room)?;
        self.notes.push(format!("{} Gaussians of the sky", more.len()));
        self.cloud = joined(&[&self.cloud, &more]);
        Ok(())
    }

    /// At internal positions.
    fn at(
        inside: &[[f64; 3]],
        colour: impl Fn(usize) -> [f32; 3],
        degree: usize,
        notes: Vec<String>,
    ) -> Result<Self, SplatError> {
        let alone = inside.len() == 1;
        let size = |square: f64| if alone { ALONE } else { square.max(LEAST_SQUARE).sqrt().min(LARGEST) };
        let all = inside.iter().zip(mean_squared_distances(inside)).enumerate();
        let new: Vec<NewGaussian> =
            all.map(|(k, (x, square))| NewGaussian { x: *x, size: size(square), rgb: colour(k) }).collect();
        Ok(Self { cloud: round(&new, degree)?, notes })
    }
}

/// A Gaussian to be: round, of one colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NewGaussian {
    /// Internal units.
    pub(super) x: [f64; 3],
    /// Standard deviation, internal units.
    pub(super) size: f64,
    pub(super) rgb: [f32; 3],
}

/// Round Gaussians, the same from everywhere.
pub(super) fn round(new: &[NewGaussian], degree: usize) -> Result<Gaussians, SplatError> {
    let n = new.len();
    let mut cloud = Gaussians::new(n, degree)?;
    cloud.logit.fill(logit(OPACITY));
    for (k, one) in new.iter().enumerate() {
        for axis in 0..3 {
            cloud.mean[axis * n + k] = one.x[axis] as f32;
            cloud.log_scale[axis * n + k] = one.size.ln() as f32;
            cloud.dc[axis * n + k] = (one.rgb[axis] - 0.5) / SH_0;
        }
    }
    Ok(cloud)
}

/// An `f32` can hold it.
fn fits(point: &Point, frame: &CloudFrame) -> bool {
    frame.to_internal(point.xyz).as_vec3().is_finite()
}

/// The box a scene lies in, world units: the one of its space, or a cube around its centre where its cameras do not fit that.
#[must_use]
pub fn scene_box(layout: &Layout, data: &Dataset) -> Bounds {
    match space(layout, data, layout.kind, layout.centre.to_array(), layout.radius, 1.0, 0.0) {
        Ok(space) => {
            let [min, max] = space.world_bounds();
            Bounds { min: min.into(), max: max.into() }
        }
        Err(_) => Bounds { min: layout.centre - layout.radius, max: layout.centre + layout.radius },
    }
}

#[cfg(test)]
mod tests;

//! Where a Gaussian looks in feature maps at its start: a mean of its coordinates, with weights that each map has of its own.

use super::place_codes::PlaceCodes;
use field_core::rng::Rng;
use splat_core::Gaussians;

/// Stream of random numbers.
const STREAM: u64 = 0x7361_6d70;
/// Coordinates in a map.
const AXES: usize = 2;

/// Weights of the coordinates in space, for each map and each of its axes: none is negative, their sum is 1.
///
/// # Source
/// Zhang et al., "Gaussian in the Wild", 2024: sampling coordinates begin as random projections of the normalised places.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SamplePlaces {
    scene: PlaceCodes,
    weights: [[[f32; 3]; AXES]; SamplePlaces::MOST],
    maps: usize,
}

impl SamplePlaces {
    /// Most maps.
    pub(crate) const MOST: usize = 4;

    /// For `maps` maps of a cloud, [`MOST`](Self::MOST) at most.
    pub(crate) fn of(cloud: &Gaussians, maps: usize, seed: u64) -> Self {
        let rng = Rng::new(seed, STREAM);
        let weights = std::array::from_fn(|map| {
            std::array::from_fn(|axis| {
                let [x, y, z, _] = rng.uniform4_at((AXES * map + axis) as u64);
                let sum = x + y + z;
                if sum > 0.0 { [x / sum, y / sum, z / sum] } else { [1.0 / 3.0; 3] }
            })
        });
        Self { scene: PlaceCodes::of(cloud), weights, maps: maps.min(Self::MOST) }
    }

    /// Numbers of a Gaussian.
    pub(crate) fn rows_of(maps: usize) -> usize {
        AXES * maps
    }

    /// Coordinates of a cloud's Gaussians, -1 to 1 from border to border: `[maps][2][n]`.
    pub(crate) fn rows(&self, cloud: &Gaussians) -> Vec<f32> {
        let n = cloud.len();
        let mut rows = vec![0.0; Self::rows_of(self.maps) * n];
        let weights = self.weights.iter().take(self.maps).flatten();
        for (row, weights) in rows.chunks_exact_mut(n.max(1)).zip(weights) {
            for (i, x) in row.iter_mut().enumerate() {
                let place = [0, 1, 2].map(|axis| self.scene.within(axis, cloud.mean[axis * n + i]));
                *x = place.iter().zip(weights).map(|(x, w)| x * w).sum();
            }
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_are_means_of_places_and_each_map_has_its_own() {
        let mut cloud = Gaussians::new(5, 0).unwrap();
        for (i, x) in cloud.mean.iter_mut().enumerate() {
            *x = [-3.0, 1.0, 0.5, 9.0, -2.0, 4.0, 7.0][i % 7];
        }
        let places = SamplePlaces::of(&cloud, 2, 7);
        for row in places.weights.iter().flatten() {
            assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6 && row.iter().all(|w| *w >= 0.0), "{row:?}");
        }
        let rows = places.rows(&cloud);
        assert_eq!(rows.len(), SamplePlaces::rows_of(2) * 5);
        assert!(rows.iter().all(|x| x.abs() < 1.0 + 1e-5), "{rows:?}");
        assert!(rows[..10] != rows[10..], "two maps are read at the same places");
        assert_eq!(places, SamplePlaces::of(&cloud, 2, 7));
        assert!(places.weights != SamplePlaces::of(&cloud, 2, 8).weights);
    }

    #[test]
    fn nothing_has_no_coordinates_and_what_is_no_number_lies_in_the_middle() {
        let none = Gaussians::new(0, 0).unwrap();
        assert!(SamplePlaces::of(&none, 3, 0).rows(&none).is_empty());
        let mut one = Gaussians::new(1, 0).unwrap();
        one.mean.fill(f32::NAN);
        assert_eq!(SamplePlaces::of(&one, 1, 0).rows(&one), [0.0, 0.0]);
        assert!(SamplePlaces::of(&one, 0, 0).rows(&one).is_empty());
    }
}

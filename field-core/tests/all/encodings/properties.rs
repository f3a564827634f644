//! What all of them keep.

use super::uniform;
use field_core::encoding::dense_grid::DenseGrid;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::Interpolation;
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use float_core::Simd;
use proptest::prelude::*;

proptest! {
    #![proptest_config(testkit::property::cases(64))]

    /// A batch is its samples one by one, at every length and level.
    #[test]
    fn batches_equal_single_samples(n in 0..40_usize, seed in 0..1000_u64) {
        let encoding = Frequency::new(3, 4, Base::One, Identity::Include).unwrap();
        let basis = SphericalHarmonics::new(4, Directions::Any).unwrap();
        let grid = DenseGrid::new([5, 4, 3], 3, Interpolation::Linear).unwrap();
        let params = uniform(seed + 1, grid.params_len(), -1.0, 1.0);
        let x = uniform(seed, 3 * n, 0.01, 1.0);
        for simd in Simd::available() {
            let rows = [encoding.out_rows(), basis.out_rows(), 3];
            let run = |x: &[f32]| {
                let n = x.len() / 3;
                let mut out = rows.map(|r| vec![f32::NAN; r * n]);
                encoding.encode(simd, x, None, &mut out[0]).unwrap();
                basis.encode(simd, x, &mut out[1]).unwrap();
                grid.encode(simd, &params, x, &mut out[2]).unwrap();
                out
            };
            let batch = run(&x);
            for i in 0..n {
                let single = run(&[x[i], x[n + i], x[2 * n + i]]);
                for (batch, single) in batch.iter().zip(&single) {
                    for (r, y) in single.iter().enumerate() {
                        prop_assert_eq!(y.to_bits(), batch[r * n + i].to_bits());
                    }
                }
            }
        }
    }

    /// `sin^2 + cos^2 = 1`, and with the base pi a shift by 2 changes nothing.
    #[test]
    fn frequency_lies_on_circles_and_is_periodic(x in -64..64_i32, fraction in 0..1024_i32) {
        let encoding = Frequency::new(1, 8, Base::Pi, Identity::Omit).unwrap();
        let x = x as f32 + fraction as f32 / 1024.0;
        let (mut out, mut shifted) = ([0.0; 16], [0.0; 16]);
        encoding.encode(Simd::best(), &[x], None, &mut out).unwrap();
        encoding.encode(Simd::best(), &[x + 2.0], None, &mut shifted).unwrap();
        prop_assert_eq!(out, shifted);
        for pair in out.chunks(2) {
            prop_assert!((pair[0] * pair[0] + pair[1] * pair[1] - 1.0).abs() < 1e-6);
        }
    }

    /// The energy of a band does not depend on the direction: `(2 l + 1) / (4 pi)`.
    #[test]
    fn bands_have_the_same_energy_in_every_direction(d in testkit::strategies::any_unit_vector()) {
        let basis = SphericalHarmonics::new(5, Directions::Any).unwrap();
        let mut y = [0.0; 25];
        basis.encode(Simd::best(), &d.map(|x| x as f32), &mut y).unwrap();
        for l in 0..5_usize {
            let energy: f32 = y[l * l..(l + 1) * (l + 1)].iter().map(|y| y * y).sum();
            let want = (2 * l + 1) as f32 / (4.0 * std::f32::consts::PI);
            prop_assert!((energy - want).abs() < 1e-5, "band {}: {} against {}", l, energy, want);
        }
    }

    /// Gradients through the normalisation are tangent to the sphere: moving along the direction changes nothing.
    #[test]
    fn direction_gradients_are_tangent(d in testkit::strategies::any_unit_vector(), seed in 0..100_u64) {
        let basis = SphericalHarmonics::new(4, Directions::Any).unwrap();
        let d = d.map(|x| 3.0 * x as f32);
        let mut d_bar = [0.0; 3];
        basis.encode_backward(Simd::best(), &d, &uniform(seed, 16, -1.0, 1.0), &mut d_bar).unwrap();
        let along: f32 = (0..3).map(|a| d[a] * d_bar[a]).sum();
        prop_assert!(along.abs() < 1e-5 * (1.0 + d_bar.iter().map(|g| g.abs()).sum::<f32>()), "{}", along);
    }
}

//! Hash grids, frequencies and spherical harmonics of positions and directions that no scene has.

use field_core::FieldError;
use field_core::encoding::EncodingBars;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::{Growth, HashGrid, HashGridConfig};
use field_core::encoding::integrated::Integrated;
use field_core::encoding::multi_distance::MultiDistance;
use field_core::encoding::planes::{Combine, Planes};
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use float_core::Simd;
use stress::{MAGNITUDES, Tally, close, ensure, finite};

pub(crate) fn cases(tally: &mut Tally, simd: Simd) {
    hash_grid(tally, simd);
    multi_distance(tally, simd);
    planes(tally, simd);
    frequency(tally, simd);
    harmonics(tally, simd);
    integrated(tally, simd);
}

fn hash_grid(tally: &mut Tally, simd: Simd) {
    for (log2_table, n_min, n_max) in [(3, 1, 1), (10, 16, 2048), (14, 1, 1 << 20), (8, 1 << 20, 1 << 22)] {
        let grid = HashGrid::new(
            HashGridConfig::default()
                .with_levels(6)
                .with_log2_table(log2_table)
                .with_n_min(n_min)
                .with_growth(Growth::UpTo(n_max)),
        )
        .unwrap();
        let params: Vec<f32> = (0..grid.params_len()).map(|i| (i as f32 * 0.37).sin()).collect();
        let positions = MAGNITUDES.iter().flat_map(|&m| [m, -m]).chain([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
        for x in positions {
            let name = format!("hash grid of 2^{log2_table}, {n_min} to {n_max}, x = {x:e}");
            tally.case(name, "the features of the clamped position, NaN as 0; no gradient past the edge", || {
                let n = 17;
                let at = |x: f32| [vec![x; n], vec![0.3; n], vec![x; n]].concat();
                let clamped = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
                let (mut got, mut want) = (vec![f32::NAN; grid.out_rows() * n], vec![f32::NAN; grid.out_rows() * n]);
                grid.encode(simd, &params, &at(x), &mut got).map_err(|e| e.to_string())?;
                grid.encode(simd, &params, &at(clamped), &mut want).map_err(|e| e.to_string())?;
                finite("features", &got)?;
                ensure(got == want, || "other features than at the clamped position".into())?;
                // A blend of the table stays within it.
                ensure(got.iter().all(|f| f.abs() <= 1.000_001), || "features leave the table's range".into())?;
                let (mut grad, mut x_bar) = (vec![0.0; params.len()], vec![0.0; 3 * n]);
                let bars = vec![1.0; got.len()];
                grid.encode_backward(simd, &at(x), &bars, &mut grad, None).map_err(|e| e.to_string())?;
                grid.encode_backward_x(simd, &params, &at(x), &bars, &mut x_bar).map_err(|e| e.to_string())?;
                finite("table gradient", &grad)?;
                finite("position gradient", &x_bar)?;
                ensure((0.0..=1.0).contains(&x) || x_bar[..n].iter().all(|&g| g == 0.0), || "a pull outside".into())
            });
        }
    }
    for value in [1e-45_f32, 1e-38, 1e30, 1e37] {
        tally.case(format!("hash grid that holds {value:e}"), "the features are what it holds, to 1e-6", || {
            let grid = HashGrid::new(HashGridConfig::default().with_log2_table(8)).unwrap();
            let params = vec![value; grid.params_len()];
            let mut out = vec![f32::NAN; grid.out_rows() * 5];
            grid.encode(simd, &params, &[0.123; 15], &mut out).map_err(|e| e.to_string())?;
            // Eight products of denormals round eight times.
            out.iter().try_for_each(|&f| close("feature", f.into(), value.into(), 1e-6 * f64::from(value) + 6e-45))
        });
    }
}

fn multi_distance(tally: &mut Tally, simd: Simd) {
    for resolution in [[2, 2, 2], [6, 9, 4], [3, 40, 5]] {
        let grid = MultiDistance::new(resolution, 6).unwrap();
        let table: Vec<f32> = (0..grid.params_len()).map(|i| (i as f32 * 0.37).sin()).collect();
        let positions = MAGNITUDES.iter().flat_map(|&m| [m, -m]).chain([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
        for x in positions {
            let name = format!("grid of {resolution:?} at three distances, x = {x:e}");
            tally.case(name, "the features of the clamped position, NaN as 0; no gradient past the edge", || {
                let n = 17;
                let at = |x: f32| [vec![x; n], vec![0.3; n], vec![x; n]].concat();
                let clamped = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
                let (mut got, mut want) = (vec![f32::NAN; grid.out_rows() * n], vec![f32::NAN; grid.out_rows() * n]);
                grid.encode(simd, &table, &at(x), &mut got).map_err(|e| e.to_string())?;
                grid.encode(simd, &table, &at(clamped), &mut want).map_err(|e| e.to_string())?;
                finite("features", &got)?;
                ensure(got == want, || "other features than at the clamped position".into())?;
                ensure(got.iter().all(|f| f.abs() <= 1.000_001), || "features leave the table's range".into())?;
                let (mut bar, mut x_bar) = (vec![0.0; table.len()], vec![0.0; 3 * n]);
                let bars = vec![1.0; got.len()];
                grid.encode_backward(simd, &at(x), &bars, &mut bar).map_err(|e| e.to_string())?;
                grid.encode_backward_x(simd, &table, &at(x), &bars, &mut x_bar).map_err(|e| e.to_string())?;
                finite("table gradient", &bar)?;
                finite("position gradient", &x_bar)?;
                ensure((0.0..=1.0).contains(&x) || x_bar[..n].iter().all(|&g| g == 0.0), || "a pull outside".into())
            });
        }
    }
}

fn planes(tally: &mut Tally, simd: Simd) {
    for (kind, planes) in [
        ("tri-plane, sum", Planes::tri_plane([5, 1, 30], 3, Combine::Sum)),
        ("k-planes", Planes::k_planes([5, 4, 30, 1], 3)),
        ("hex-plane", Planes::hex_plane([5, 4, 30, 2], 3)),
    ] {
        let planes = planes.unwrap();
        let table: Vec<f32> = (0..planes.params_len()).map(|i| (i as f32 * 0.37).sin()).collect();
        let positions = MAGNITUDES.iter().flat_map(|&m| [m, -m]).chain([f32::NAN, f32::INFINITY, f32::NEG_INFINITY]);
        for x in positions {
            let name = format!("{kind}, x = {x:e}");
            tally.case(name, "the features of the clamped position, NaN as -1; no gradient past the edge", || {
                let n = 17;
                let rows = planes.in_rows();
                let at = |x: f32| vec![x; rows * n];
                let clamped = if x.is_nan() { -1.0 } else { x.clamp(-1.0, 1.0) };
                let (mut got, mut want) = (vec![f32::NAN; 3 * n], vec![f32::NAN; 3 * n]);
                planes.encode(simd, &table, &at(x), &mut got).map_err(|e| e.to_string())?;
                planes.encode(simd, &table, &at(clamped), &mut want).map_err(|e| e.to_string())?;
                finite("features", &got)?;
                ensure(got == want, || "other features than at the clamped position".into())?;
                let (mut table_bar, mut x_bar) = (vec![0.0; table.len()], vec![0.0; rows * n]);
                let (at, bars) = (at(x), vec![1.0; 3 * n]);
                planes
                    .encode_backward(simd, &table, &at, &bars, EncodingBars::both(&mut table_bar, &mut x_bar))
                    .map_err(|e| e.to_string())?;
                finite("table gradient", &table_bar)?;
                finite("position gradient", &x_bar)?;
                ensure((-1.0..=1.0).contains(&x) || x_bar.iter().all(|&g| g == 0.0), || "a pull outside".into())
            });
        }
        tally.case(format!("{kind} of zeros"), "features and gradients of the positions are 0", || {
            let zeros = vec![0.0; planes.params_len()];
            let (mut out, mut x_bar) = (vec![f32::NAN; 3], vec![0.0; planes.in_rows()]);
            let x = vec![0.3; planes.in_rows()];
            planes.encode(simd, &zeros, &x, &mut out).map_err(|e| e.to_string())?;
            let bars = EncodingBars::x(&mut x_bar);
            planes.encode_backward(simd, &zeros, &x, &[1.0; 3], bars).map_err(|e| e.to_string())?;
            ensure(out.iter().chain(&x_bar).all(|v| *v == 0.0), || format!("{out:?}, {x_bar:?}"))
        });
    }
}

fn frequency(tally: &mut Tally, simd: Simd) {
    for base in [Base::One, Base::Pi] {
        for octaves in [1, 10, 32] {
            let encoding = Frequency::new(1, octaves, base, Identity::Omit).unwrap();
            for x in MAGNITUDES.iter().flat_map(|&m| [m, -m]) {
                let name = format!("{octaves} octaves, base {base:?}, x = {x:e}");
                let promise = "sine and cosine of the argument; NaN only where 2^k x is not a number any more";
                tally.case(name, promise, || {
                    let n = 17;
                    let mut out = vec![f32::INFINITY; encoding.out_rows() * n];
                    encoding.encode(simd, &[x; 17], None, &mut out).map_err(|e| e.to_string())?;
                    let kappa = if base == Base::One { 1.0 } else { core::f64::consts::PI };
                    let argument = |k: usize| f64::from(x) * kappa * (k as f64).exp2();
                    for k in 0..octaves {
                        let (s, c) = (f64::from(out[2 * k * n + 3]), f64::from(out[(2 * k + 1) * n + 3]));
                        let argument = argument(k);
                        if argument.abs() > 1e38 && s.is_nan() && c.is_nan() {
                            continue;
                        }
                        close("sin^2 + cos^2", s * s + c * c, 1.0, 1e-6)?;
                        // Where an f32 still resolves a period, the value is the exact one.
                        if argument.abs() < 1e9 {
                            close("sine", s, argument.sin(), 2e-7)?;
                            close("cosine", c, argument.cos(), 2e-7)?;
                        }
                    }
                    let mut x_bar = [0.0; 17];
                    let bars = vec![1.0; out.len()];
                    encoding.encode_backward(simd, &[x; 17], None, &bars, &mut x_bar).map_err(|e| e.to_string())?;
                    if argument(octaves - 1).abs() < 1e38 { finite("x_bar", &x_bar) } else { Ok(()) }
                });
            }
        }
    }
    for bad in [f32::NAN, f32::INFINITY] {
        tally.case(format!("frequency of {bad}"), "NaN, not a number that looks right", || {
            let encoding = Frequency::new(1, 4, Base::One, Identity::Omit).unwrap();
            let mut out = vec![0.0; encoding.out_rows()];
            encoding.encode(simd, &[bad], None, &mut out).map_err(|e| e.to_string())?;
            ensure(out.iter().all(|v| v.is_nan()), || format!("{out:?}"))
        });
    }
}

fn harmonics(tally: &mut Tally, simd: Simd) {
    let any = SphericalHarmonics::new(4, Directions::Any).unwrap();
    let unit = {
        let mut out = vec![f32::NAN; 16];
        any.encode(simd, &[0.36, -0.48, 0.8], &mut out).unwrap();
        out
    };
    for length in MAGNITUDES.into_iter().filter(|m| *m > 1e-37) {
        tally.case(
            format!("harmonics of a direction of length {length:e}"),
            "those of the unit direction, 1e-6",
            || {
                let d: Vec<f32> = [0.36_f32, -0.48, 0.8].iter().map(|v| v * length).collect();
                let (mut out, mut d_bar) = (vec![f32::NAN; 16], vec![0.0; 3]);
                any.encode(simd, &d, &mut out).map_err(|e| e.to_string())?;
                for (got, want) in out.iter().zip(&unit) {
                    close("harmonic", (*got).into(), (*want).into(), 1e-6)?;
                }
                any.encode_backward(simd, &d, &[1.0; 16], &mut d_bar).map_err(|e| e.to_string())?;
                ensure(d_bar.iter().all(|g| !g.is_nan()), || format!("gradient {d_bar:?}"))
            },
        );
    }
    for bad in [[0.0; 3], [f32::NAN, 1.0, 0.0], [0.0, f32::INFINITY, 0.0], [f32::INFINITY, f32::NEG_INFINITY, 0.0]] {
        tally.case(format!("harmonics of {bad:?}"), "refused, with the number of the direction", || {
            let d = [1.0, bad[0], 0.0, bad[1], 0.0, bad[2]];
            match any.encode(simd, &d, &mut [0.0; 32]) {
                Err(FieldError::Direction { index: 1 }) => Ok(()),
                other => Err(format!("{other:?}")),
            }
        });
    }
}

fn integrated(tally: &mut Tally, simd: Simd) {
    for octaves in [1, 16, 32] {
        let encoding = Integrated::new(1, octaves).unwrap();
        for mean in MAGNITUDES.into_iter().flat_map(|m| [m, -m]) {
            if !(mean * 2.0_f32.powi(octaves as i32 - 1)).is_finite() {
                continue; // NaN, as it is said
            }
            for var in MAGNITUDES.into_iter().chain([f32::INFINITY]) {
                let name = format!("{octaves} octaves of mean {mean:e}, variance {var:e}");
                tally.case(name, "means of sine and cosine to 1e-6, finite gradients", || {
                    let (mean, var) = ([mean; 17], [var; 17]);
                    let mut out = vec![f32::NAN; 17 * encoding.out_rows()];
                    encoding.encode(simd, &mean, &var, &mut out).map_err(|e| e.to_string())?;
                    for (k, rows) in out.chunks_exact(2 * 17).enumerate() {
                        let f = 2.0_f64.powi(k as i32);
                        let damped = (-0.5 * f * f * f64::from(var[0])).exp();
                        let (sin, cos) = (f * f64::from(mean[0])).sin_cos();
                        for (got, want) in rows.chunks_exact(17).zip([sin, cos]) {
                            got.iter().try_for_each(|&got| close("mean", got.into(), damped * want, 1e-6))?;
                        }
                    }
                    let (mut mean_bar, mut var_bar) = ([0.0; 17], [0.0; 17]);
                    let (bars, grads) = (vec![1.0; out.len()], (Some(&mut mean_bar[..]), Some(&mut var_bar[..])));
                    encoding.encode_backward(simd, &mean, &var, &bars, grads.0, grads.1).map_err(|e| e.to_string())?;
                    finite("mean_bar", &mean_bar)?;
                    finite("var_bar", &var_bar)
                });
            }
        }
    }
}

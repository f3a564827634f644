//! Encodings against the golden vectors of `golden/encodings.json`; tolerances are those of `golden/README.md`.

use std::path::Path;

use field_core::encoding::EncodingBars;
use field_core::encoding::frequency::{Base, Frequency, Identity};
use field_core::encoding::hash_grid::{Addressing, Growth, HashGrid, HashGridConfig, Interpolation, Rule, Touched};
use field_core::encoding::integrated::Integrated;
use field_core::encoding::planes::{Combine, Planes};
use field_core::encoding::spherical_harmonics::{Directions, SphericalHarmonics};
use field_core::encoding::window;
use float_core::Simd;
use render_core::frustum::{Moments, symmetric};
use testkit::golden::{Golden, Kind, Record, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/encodings.json")).unwrap()
}

/// Relative and absolute tolerance of `f32` values.
fn values(record: &Record) -> (f64, f64) {
    if record.kind == Kind::Random { (2e-6, 1e-6) } else { (1e-4, 1e-6) }
}

/// The same for gradients.
fn gradients(record: &Record) -> (f64, f64) {
    if record.kind == Kind::Random { (5e-5, 1e-5) } else { (1e-3, 1e-5) }
}

fn frequency_of(record: &Record) -> Frequency {
    let base = if record.param("with_pi").bool() { Base::Pi } else { Base::One };
    let identity = if record.param("include_input").bool() { Identity::Include } else { Identity::Omit };
    Frequency::new(record.input("x").data.len(), record.param("frequencies").usize(), base, identity).unwrap()
}

fn check_frequency(record: &Record, window: Option<&[f32]>) {
    let encoding = frequency_of(record);
    let x = record.input("x").f32();
    for simd in Simd::available() {
        let mut out = vec![f32::NAN; encoding.out_rows()];
        encoding.encode(simd, &x, window, &mut out).unwrap();
        // Stricter than the README's 2^k * 1e-6: the argument is reduced in f64.
        assert_close(&record.label(), &out, &record.output("encoding").data, 0.0, 1e-6);
        let mut x_bar = vec![0.0; x.len()];
        encoding.encode_backward(simd, &x, window, &record.cotangent("encoding").f32(), &mut x_bar).unwrap();
        let (rtol, atol) = gradients(record);
        assert_close(&record.label(), &x_bar, &record.grad("x").data, rtol, atol);
    }
}

#[test]
fn frequency_matches_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("frequency") {
        check_frequency(record, None);
        count += 1;
    }
    assert_eq!(count, 22);
}

#[test]
fn windowed_frequency_matches_golden() {
    let golden = golden();
    for record in golden.op("windowed_nerfies") {
        let mut w = vec![f32::NAN; record.param("frequencies").usize()];
        window::nerfies(record.param("alpha").f64(), &mut w);
        assert_close(&record.label(), &w, &record.output("window").data, 2e-6, 1e-7);
        check_frequency(record, Some(&w));
    }
    for record in golden.op("windowed_osr") {
        let mut w = vec![f32::NAN; record.param("frequencies").usize()];
        let (step, steps) = (record.param("iteration").usize() as u64, record.param("n_anneal").usize() as u64);
        window::osr(step, steps, record.param("min_freq").usize(), &mut w);
        assert_close(&record.label(), &w, &record.output("window").data, 2e-6, 1e-7);
        check_frequency(record, Some(&w));
    }
    assert_eq!(golden.op("windowed_nerfies").count() + golden.op("windowed_osr").count(), 14);
}

#[test]
fn spherical_harmonics_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("sh_basis") {
        let basis = SphericalHarmonics::new(record.param("tcnn_degree").usize(), Directions::Any).unwrap();
        let d = record.input("direction").f32();
        for simd in Simd::available() {
            let mut out = vec![f32::NAN; basis.out_rows()];
            basis.encode(simd, &d, &mut out).unwrap();
            let (rtol, atol) = values(record);
            assert_close(&record.label(), &out, &record.output("basis").data, rtol, atol);
            let mut d_bar = vec![0.0; 3];
            basis.encode_backward(simd, &d, &record.cotangent("basis").f32(), &mut d_bar).unwrap();
            let (rtol, atol) = gradients(record);
            assert_close(&record.label(), &d_bar, &record.grad("direction").data, rtol, atol);
        }
        count += 1;
    }
    assert_eq!(count, 36);
}

fn grid_of(record: &Record) -> HashGrid {
    HashGrid::new(
        HashGridConfig::default()
            .with_levels(record.param("levels").usize())
            .with_features(record.param("features_per_level").usize())
            .with_log2_table(record.param("log2_table").usize() as u32)
            .with_n_min(record.param("n_min").usize() as u32)
            .with_growth(Growth::Factor(record.param("growth").f64()))
            .with_rule(match record.param("rule").str() {
                "ngp" => Rule::Ngp,
                "paper" => Rule::Paper,
                other => panic!("{}: unknown rule {other}", record.label()),
            })
            .with_interpolation(Interpolation::Linear),
    )
    .unwrap()
}

/// The table that the file describes by a formula; every value is exact in `f32`.
fn table(grid: &HashGrid, salt: usize) -> Vec<f32> {
    let value = |i: usize| {
        let hash = (i as u32).wrapping_add(salt as u32).wrapping_mul(2_654_435_761);
        ((f64::from(hash >> 12)) / 1_048_576.0 - 0.5) as f32
    };
    (0..grid.params_len()).map(value).collect()
}

/// `[n][c]` to `[c][n]`.
fn transposed(x: &[f32], columns: usize) -> Vec<f32> {
    let n = x.len() / columns;
    (0..columns).flat_map(|c| (0..n).map(move |i| x[i * columns + c])).collect()
}

#[test]
fn hash_grid_layout_matches_golden() {
    for record in golden().op("hash_grid") {
        let grid = grid_of(record);
        let label = record.label();
        assert_eq!(grid.entries(), record.param("total_entries").usize(), "{label}");
        for (l, level) in grid.levels().iter().enumerate() {
            assert_eq!(level.resolution as usize, record.output("level_resolution").indices()[l], "{label}");
            assert_eq!(f64::from(level.scale), record.output("level_scale").data[l], "{label}");
            assert_eq!(level.offset, record.output("level_offset").indices()[l], "{label}");
            assert_eq!(level.entries as usize, record.output("level_entries").indices()[l], "{label}");
            let dense = level.addressing == Addressing::Dense;
            assert_eq!(usize::from(dense), record.output("level_dense").indices()[l], "{label}");
        }
    }
}

#[test]
fn hash_grid_corner_entries_match_golden() {
    for record in golden().op("hash_grid") {
        let grid = grid_of(record);
        let levels = grid.levels().len();
        let want = record.output("corner_entries").indices();
        let x = record.input("position").f32();
        for (i, x) in x.chunks(3).enumerate() {
            for (l, level) in grid.levels().iter().enumerate() {
                let cell = [0, 1, 2].map(|a| {
                    let cell = (x[a] * level.scale + level.shift).floor() as u32;
                    if grid.config().rule == Rule::Paper { cell.min(level.resolution - 2) } else { cell }
                });
                let want = &want[(i * levels + l) * 8..][..8];
                for (c, &want) in want.iter().enumerate() {
                    let corner = [0, 1, 2].map(|a| cell[a] + (c as u32 >> a & 1));
                    assert_eq!(level.offset + level.entry(corner) as usize, want, "{}: corner {c}", record.label());
                }
                // What the kernel touches is what the file lists.
                let mut grad = vec![0.0; grid.level_range(l).len()];
                let ones = vec![1.0; grid.config().features];
                grid.encode_level_backward(Simd::best(), l, x, &ones, &mut grad, None).unwrap();
                for (e, g) in grad.chunks(grid.config().features).enumerate() {
                    assert!(g[0] == 0.0 || want.contains(&(level.offset + e)), "{}: entry {e}", record.label());
                }
            }
        }
    }
}

#[test]
fn hash_grid_features_and_gradients_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("hash_grid") {
        count += 1;
        let (grid, label) = (grid_of(record), record.label());
        let params = table(&grid, record.param("table_salt").usize());
        let x = transposed(&record.input("position").f32(), 3);
        let n = x.len() / 3;
        let rows = grid.out_rows();
        let out_bar = transposed(&record.cotangent("features").f32(), rows);
        let (rtol, atol) = values(record);
        let (rtol_gradient, atol_gradient) = gradients(record);
        for simd in Simd::available() {
            let mut out = vec![f32::NAN; rows * n];
            grid.encode(simd, &params, &x, &mut out).unwrap();
            assert_close(&label, &transposed(&out, n), &record.output("features").data, rtol, atol);

            let mut x_bar = vec![0.0; x.len()];
            grid.encode_backward_x(simd, &params, &x, &out_bar, &mut x_bar).unwrap();
            assert_close(&label, &transposed(&x_bar, n), &record.grad("position").data, rtol_gradient, atol_gradient);

            for axis in 0..3 {
                let mut x_dot = vec![0.0; x.len()];
                x_dot[axis * n..(axis + 1) * n].fill(1.0);
                let mut out_dot = vec![f32::NAN; rows * n];
                grid.tangent(simd, &params, &x, &x_dot, &mut out_dot).unwrap();
                let want: Vec<f64> = record.output("jacobian").data.iter().skip(axis).step_by(3).copied().collect();
                assert_close(&label, &transposed(&out_dot, n), &want, rtol_gradient, atol_gradient);
            }

            let features = grid.config().features;
            let mut grad = vec![0.0; params.len()];
            let mut touched = Touched::new(&grid);
            grid.encode_backward(simd, &x, &out_bar, &mut grad, Some(&mut touched)).unwrap();
            let entries = record.grad("table_entries").indices();
            let got: Vec<f32> = entries.iter().flat_map(|e| grad[e * features..(e + 1) * features].to_vec()).collect();
            assert_close(&label, &got, &record.grad("table_values").data, rtol_gradient, atol_gradient);
            let others = (0..grad.len()).filter(|i| grad[*i] != 0.0 && !entries.contains(&(i / features))).count();
            assert_eq!(others, 0, "{label}: gradients outside the touched entries");
            touched.for_each(|range| grad[range].fill(0.0));
            assert!(grad.iter().all(|&g| g == 0.0), "{label}: gradients outside the touched blocks");
        }
    }
    assert_eq!(count, 9);
}

/// The planes of a record, and their shapes' resolution: plane `(a, b)` is `[features][b][a]`.
fn planes_of(record: &Record) -> Planes {
    let features = record.input("plane0").shape[0];
    let vertices = |plane: &str, axis: usize| record.input(plane).shape[axis] as u32;
    let [x, y, z] = [vertices("plane0", 2), vertices("plane0", 1), vertices("plane1", 1)];
    match record.param("combine").str() {
        "hexplane" => Planes::hex_plane([x, y, z, vertices("plane2", 1)], features),
        "product" if record.input("x").shape[1] == 4 => Planes::k_planes([x, y, z, vertices("plane2", 1)], features),
        "product" => Planes::tri_plane([x, y, z], features, Combine::Product),
        "sum" => Planes::tri_plane([x, y, z], features, Combine::Sum),
        other => panic!("{}: unknown rule {other}", record.label()),
    }
    .unwrap()
}

#[test]
fn planes_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in ["triplane", "kplanes", "hexplane"].into_iter().flat_map(|op| golden.op(op)) {
        count += 1;
        let (planes, label) = (planes_of(record), record.label());
        let features = planes.features();
        let pairs: Vec<f64> = planes.pairs().flatten().map(|axis| axis as f64).collect();
        let want: Vec<f64> = record
            .param("pairs")
            .json()
            .as_array()
            .unwrap()
            .iter()
            .flat_map(|pair| pair.as_array().unwrap().iter().map(|axis| axis.as_f64().unwrap()))
            .collect();
        assert_eq!(pairs, want, "{label}");
        // Features innermost: from `[features][vertices]` to `[vertices][features]`.
        let innermost = |tensor: Vec<f32>| transposed(&tensor, tensor.len() / features);
        let table: Vec<f32> =
            (0..planes.pairs().len()).flat_map(|p| innermost(record.input(&format!("plane{p}")).f32())).collect();
        let x = transposed(&record.input("x").f32(), planes.in_rows());
        let n = x.len() / planes.in_rows();
        let out_bar = transposed(&record.cotangent("features").f32(), features);
        let (rtol, atol) = values(record);
        let (rtol_gradient, atol_gradient) = gradients(record);
        for simd in Simd::available() {
            let mut out = vec![f32::NAN; features * n];
            planes.encode(simd, &table, &x, &mut out).unwrap();
            assert_close(&label, &transposed(&out, n), &record.output("features").data, rtol, atol);

            let (mut table_bar, mut x_bar) = (vec![0.0; table.len()], vec![0.0; x.len()]);
            let bars = EncodingBars::both(&mut table_bar, &mut x_bar);
            planes.encode_backward(simd, &table, &x, &out_bar, bars).unwrap();
            assert_close(&label, &transposed(&x_bar, n), &record.grad("x").data, rtol_gradient, atol_gradient);
            for p in 0..planes.pairs().len() {
                let got = transposed(&table_bar[planes.plane_range(p)], features);
                let want = &record.grad(&format!("plane{p}")).data;
                assert_close(&label, &got, want, rtol_gradient, atol_gradient);
            }
        }
    }
    assert_eq!(count, 12);
}

#[test]
fn integrated_matches_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("ipe") {
        assert_eq!(record.param("min_deg").usize(), 0);
        let (mean, var) = (record.input("mean").f32(), record.input("var").f32());
        let (dims, octaves) = (mean.len(), record.param("max_deg").usize());
        let encoding = Integrated::new(dims, octaves).unwrap();
        // The file has all sines before all cosines; here they take turns, octave by octave.
        let place = |r: usize| {
            let (half, r) = (r / (dims * octaves), r % (dims * octaves));
            (2 * (r / dims) + half) * dims + r % dims
        };
        for simd in Simd::available() {
            let mut out = vec![f32::NAN; encoding.out_rows()];
            encoding.encode(simd, &mean, &var, &mut out).unwrap();
            let ordered: Vec<f32> = (0..out.len()).map(|r| out[place(r)]).collect();
            assert_close(&record.label(), &ordered, &record.output("encoding").data, 0.0, 1e-6);
            let mut out_bar = vec![0.0; out.len()];
            for (r, bar) in record.cotangent("encoding").f32().into_iter().enumerate() {
                out_bar[place(r)] = bar;
            }
            let (mut mean_bar, mut var_bar) = (vec![0.0; dims], vec![0.0; dims]);
            encoding.encode_backward(simd, &mean, &var, &out_bar, Some(&mut mean_bar), Some(&mut var_bar)).unwrap();
            let (rtol, atol) = gradients(record);
            assert_close(&record.label(), &mean_bar, &record.grad("mean").data, rtol, atol);
            assert_close(&record.label(), &var_bar, &record.grad("var").data, rtol, atol);
        }
        count += 1;
    }
    assert_eq!(count, 8);
}

#[test]
fn conical_frusta_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("conical_frustum") {
        let label = record.label();
        let vector = |name| <[f64; 3]>::try_from(&record.input(name).data[..]).unwrap();
        let scalar = |name| record.input(name).data[0];
        let (o, d) = (vector("origin"), vector("direction"));
        let m = Moments::conical(scalar("t0"), scalar("t1"), scalar("radius"));
        for (name, got) in [("t_mean", m.mean_t), ("t_var", m.var_t), ("r_var", m.var_r)] {
            assert_close(&format!("{label} {name}"), &[got], &record.output(name).data, 1e-12, 1e-30);
        }
        let (mean, upper) = m.covariance(o, d);
        let cov = symmetric(upper).concat();
        assert_close(&label, &mean, &record.output("mean").data, 1e-12, 0.0);
        assert_close(&label, &cov, &record.output("cov").data, 1e-12, 1e-30);
        assert_close(&label, &m.diagonal(o, d).1, &record.output("cov_diag").data, 1e-12, 1e-30);
        // The same in f32.
        let f = |x: [f64; 3]| x.map(|x| x as f32);
        let m = Moments::conical(scalar("t0") as f32, scalar("t1") as f32, scalar("radius") as f32);
        let (rtol, atol) = values(record);
        assert_close(&label, &m.diagonal(f(o), f(d)).1, &record.output("cov_diag").data, rtol, 0.0);
        assert_close(&label, &m.covariance(f(o), f(d)).0, &record.output("mean").data, rtol, atol);
        count += 1;
    }
    assert_eq!(count, 8);
}

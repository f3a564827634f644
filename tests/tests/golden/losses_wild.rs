//! Losses for uncontrolled photographs against golden vectors: `tests/golden/losses_wild.json`.

use losses::concrete::{BinaryConcrete, NOISE_EPS, noise};
use losses::kernel::Kernel;
use losses::photometric;
use losses::trimmed::{Border, Compare, TrimmedMask};
use losses::uncertainty::{Channels, Likelihood, transient_density, transient_density_backward};
use losses::{sparsity, visibility};
use testkit::golden::{Golden, Kind, Record, assert_close};

fn golden() -> Golden {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/losses_wild.json");
    Golden::read(path.as_ref()).unwrap()
}

/// Tolerances of a value and of a gradient, (relative to the largest entry, absolute).
fn bounds(record: &Record) -> [(f64, f64); 2] {
    if record.kind == Kind::Random { [(2e-6, 1e-6), (5e-5, 1e-5)] } else { [(1e-4, 0.0), (1e-3, 0.0)] }
}

/// Colours of a tensor `[n, 3]`.
fn colours(values: &[f32]) -> Vec<[f32; 3]> {
    values.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}

#[track_caller]
fn near(record: &Record, what: &str, got: f64) {
    let want = record.output(what).scalar();
    let (rtol, atol) = bounds(record)[0];
    assert!((got - want).abs() <= atol + rtol * want.abs(), "{}: {what} is {got}, expected {want}", record.label());
}

/// Every entry to a few roundings of its own size, above what an f32 can hold.
#[track_caller]
fn each(record: &Record, what: &str, got: &[f64], want: &[f64]) {
    assert_eq!(got.len(), want.len());
    for (i, (got, want)) in got.iter().zip(want).enumerate() {
        assert!((got - want).abs() <= 1e-6 * want.abs() + 1e-37, "{} {what}[{i}]: {got}, {want}", record.label());
    }
}

/// The kernel of a record, and how many times its golden twin it is.
fn kernel(record: &Record) -> (Kernel, f64) {
    let c = record.param("c").f32();
    if record.op == "barron" {
        return (Kernel::General { shape: record.param("alpha").f32(), c }, 1.0);
    }
    match record.param("kernel").str() {
        "geman_mcclure" => (Kernel::GemanMcClure { c }, 1.0),
        // z / (z + 1) is half of 2 z' / (z' + 4) at half the scale.
        "geman_mcclure_classic" => (Kernel::GemanMcClure { c: 0.5 * c }, 2.0),
        other => panic!("no kernel `{other}`"),
    }
}

#[test]
fn robust_kernels_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("barron").chain(golden.op("robust_simple")) {
        assert!(record.f32_inputs_exact, "{}", record.label());
        let (kernel, factor) = kernel(record);
        kernel.check().unwrap();
        let x = record.input("x").f32();
        let of = |f: &dyn Fn(f32) -> f32| x.iter().map(|&x| f64::from(f(x)) / factor).collect::<Vec<_>>();
        let [(rtol, atol), (rtol_grad, atol_grad)] = bounds(record);

        let value = of(&|x| kernel.value(x, 0.0));
        assert_close(&record.label(), &value, &record.output("rho").data, rtol, atol);
        each(record, "rho", &value, &record.output("rho").data);

        let derivative = of(&|x| kernel.derivative(x, 0.0));
        let grad: Vec<f64> = derivative.iter().zip(&record.cotangent("rho").data).map(|(d, bar)| d * bar).collect();
        assert_close(&record.label(), &grad, &record.grad("x").data, rtol_grad, atol_grad);

        if record.op == "barron" {
            let weight = of(&|x| kernel.weight(x, 0.0));
            assert_close(&record.label(), &weight, &record.output("irls_weight").data, rtol, atol);
            each(record, "weight", &weight, &record.output("irls_weight").data);
            // Entry by entry against the weight: the gradient itself was made from 1 - exp(..) and lost what is below 1e-16.
            let want: Vec<f64> =
                x.iter().zip(&record.output("irls_weight").data).map(|(&x, w)| f64::from(x) * w).collect();
            each(record, "derivative", &derivative, &want);
        }
        count += 1;
    }
    assert_eq!(count, 29);
}

/// Cut a picture into patches `[patches][side * side]`, or put them together again.
fn patches(picture: &[f32], width: usize, side: usize) -> Vec<f32> {
    let mut out = vec![];
    for rows in picture.chunks_exact(width * side) {
        for x in (0..width).step_by(side) {
            out.extend(rows.chunks_exact(width).flat_map(|row| &row[x..x + side]));
        }
    }
    out
}

#[test]
fn trimmed_masks_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("robustnerf_mask") {
        // The released code: strict everywhere, outliers beyond the edge of a patch.
        let mask = TrimmedMask::default()
            .with_quantile(record.param("quantile").f32())
            .with_diffuse(record.param("diffuse").f32())
            .with_vote(record.param("patch_fraction").f32())
            .with_patch(record.param("outer").usize())
            .with_inner(record.param("inner").usize())
            .with_border(Border::Zero)
            .with_compare(Compare::Below);
        let picture = record.input("residual").f32();
        let residuals = patches(&picture, 64, mask.patch);
        let (mut scratch, mut got) = (vec![], vec![f32::NAN; residuals.len()]);

        // Ours is an order statistic, theirs lies between it and the next.
        let own = mask.threshold(&residuals, &mut scratch);
        let threshold = record.output("threshold").scalar() as f32;
        let next = picture.iter().copied().filter(|&e| e > own).fold(f32::INFINITY, f32::min);
        assert!(own <= threshold && threshold <= next, "{}: {own} {threshold} {next}", record.label());

        let compare = |what: &str, got: &[f32]| {
            let want = patches(&record.output(what).f32(), 64, mask.patch);
            let wrong = got.iter().zip(&want).filter(|(a, b)| a != b).count();
            assert_eq!(wrong, 0, "{}: {wrong} rays of {what}", record.label());
        };
        mask.weights(&residuals, threshold, &mut scratch, &mut got).unwrap();
        compare("mask", &got);
        let loss: f64 = got.iter().zip(&residuals).map(|(w, e)| f64::from(w * e)).sum::<f64>() / 4096.0;
        near(record, "loss", loss);

        // The steps before the vote, by a vote that can't be won, and by a mean that can't be reached.
        let no_vote = mask.with_vote(1.0);
        no_vote.weights(&residuals, threshold, &mut scratch, &mut got).unwrap();
        compare("union", &got);
        let only_trim = no_vote.with_diffuse(1.0);
        only_trim.weights(&residuals, threshold, &mut scratch, &mut got).unwrap();
        compare("inlier", &got);
        count += 1;
    }
    assert_eq!(count, 10);
}

#[test]
fn likelihood_matches_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("nerfw_nll") {
        let (rgb, target) = (colours(&record.input("rgb").f32()), colours(&record.input("target").f32()));
        let (beta, sigma) = (record.input("beta").f32(), record.input("sigma_t").f32());
        let lambda = record.param("lambda_u").f64();
        let samples = record.input("sigma_t").shape[1];
        let offsets: Vec<u32> = (0..=rgb.len()).map(|r| (r * samples) as u32).collect();
        // Far below every beta: the records have no floor.
        let mean = Likelihood::PHOTOGRAPHS.with_beta_min(1e-6);
        let paper = mean.with_channels(Channels::Sum);

        let own = mean.mean(&rgb, &target, &beta, None).unwrap();
        let log_beta = mean.mean(&target, &target, &beta, None).unwrap();
        let density = lambda * transient_density(&offsets, &sigma).unwrap();
        near(record, "data", own - log_beta);
        near(record, "log_beta", 3.0 + log_beta);
        near(record, "sigma", density);
        near(record, "total", 3.0 + own + density);
        near(record, "paper", paper.mean(&rgb, &target, &beta, None).unwrap() + density);

        let bar = |what: &str| record.cotangent(what).scalar();
        let (mut rgb_bar, mut beta_bar) = (vec![[0.0; 3]; rgb.len()], vec![0.0; rgb.len()]);
        let data_bar = bar("data") + bar("total");
        mean.mean_backward(&rgb, &target, &beta, None, data_bar, &mut rgb_bar, &mut beta_bar).unwrap();
        paper.mean_backward(&rgb, &target, &beta, None, bar("paper"), &mut rgb_bar, &mut beta_bar).unwrap();
        // A perfect prediction leaves the logarithm alone.
        let log_bar = bar("log_beta") - bar("data");
        mean.mean_backward(&target, &target, &beta, None, log_bar, &mut rgb_bar, &mut beta_bar).unwrap();
        let mut sigma_bar = vec![0.0; sigma.len()];
        let density_bar = lambda * (bar("sigma") + bar("total") + bar("paper"));
        transient_density_backward(&offsets, density_bar, &mut sigma_bar).unwrap();

        let (rtol, atol) = bounds(record)[1];
        assert_close(&record.label(), rgb_bar.as_flattened(), &record.grad("rgb").data, rtol, atol);
        assert_close(&record.label(), &beta_bar, &record.grad("beta").data, rtol, atol);
        assert_close(&record.label(), &sigma_bar, &record.grad("sigma_t").data, rtol, atol);
        count += 1;
    }
    assert_eq!(count, 5);
}

#[test]
fn occlusion_losses_match_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("hanerf") {
        let [coarse, fine, target] = ["rgb_c", "rgb_f", "target"].map(|name| colours(&record.input(name).f32()));
        let m = record.input("mask").f32();
        let errors = |prediction: &[[f32; 3]]| {
            let mut e2 = vec![0.0; m.len()];
            photometric::per_ray(Kernel::Squared, prediction, &target, &mut e2).unwrap();
            e2
        };
        let [e2_coarse, e2_fine] = [&coarse, &fine].map(|p| errors(p));
        let (size, digit) = (record.param("size_delta").f64(), record.param("digit_delta").f64());
        near(record, "coarse", visibility::masked(&m, &e2_coarse).unwrap());
        near(record, "fine", visibility::masked(&m, &e2_fine).unwrap());
        near(record, "mask_size", size * visibility::size(&m));
        near(record, "mask_digit", digit * visibility::indecision(&m));

        let bar = |what: &str| record.cotangent(what).scalar();
        let mut m_bar = vec![0.0; m.len()];
        let [mut coarse_bar, mut fine_bar] = [0; 2].map(|_| vec![0.0; m.len()]);
        visibility::masked_backward(&m, &e2_coarse, bar("coarse"), None, &mut coarse_bar).unwrap();
        visibility::masked_backward(&m, &e2_fine, bar("fine"), Some(&mut m_bar), &mut fine_bar).unwrap();
        visibility::size_backward(&m, size * bar("mask_size"), &mut m_bar).unwrap();
        visibility::indecision_backward(&m, digit * bar("mask_digit"), &mut m_bar).unwrap();
        let to_colour = |prediction: &[[f32; 3]], e2_bar: &[f32]| {
            let mut out = vec![[0.0; 3]; m.len()];
            photometric::per_ray_backward(Kernel::Squared, prediction, &target, e2_bar, &mut out).unwrap();
            out
        };
        let (rtol, atol) = bounds(record)[1];
        assert_close(&record.label(), &m_bar, &record.grad("mask").data, rtol, atol);
        let got = to_colour(&coarse, &coarse_bar);
        assert_close(&record.label(), got.as_flattened(), &record.grad("rgb_c").data, rtol, atol);
        let got = to_colour(&fine, &fine_bar);
        assert_close(&record.label(), got.as_flattened(), &record.grad("rgb_f").data, rtol, atol);
        count += 1;
    }
    assert_eq!(count, 3);
}

#[test]
fn binary_concrete_matches_golden() {
    let golden = golden();
    let mut count = 0;
    for record in golden.op("binary_concrete") {
        assert_eq!(record.param("eps").f32(), NOISE_EPS);
        let concrete = BinaryConcrete { temperature: record.param("tau").f32() };
        let (x, u) = (record.input("x").f32(), record.input("u").f32());
        // The records start from the odds x, and add eps to them too; a network's output never makes them 0.
        let ln_odds = |x: f32| (x + NOISE_EPS).ln();
        let got: Vec<f32> = x.iter().zip(&u).map(|(&x, &u)| concrete.sample(ln_odds(x), noise(u))).collect();
        // Logarithms of f32 over the temperature: their rounding is multiplied by it.
        let [(rtol, atol), (rtol_grad, atol_grad)] = bounds(record);
        assert_close(&record.label(), &got, &record.output("sample").data, rtol, atol + 1e-6);
        let grad: Vec<f32> = (x.iter().zip(&u))
            .zip(record.cotangent("sample").f32())
            .map(|((&x, &u), bar)| bar * concrete.sample_derivative(ln_odds(x), noise(u)) / (x + NOISE_EPS))
            .collect();
        assert_close(&record.label(), &grad, &record.grad("x").data, rtol_grad, atol_grad);
        count += 1;
    }
    assert_eq!(count, 6);
}

#[test]
fn density_prior_matches_golden() {
    let golden = golden();
    let record = golden.record("cauchy_sparsity", "mixed");
    let sigma = record.input("sigma").f32();
    near(record, "loss", sparsity::density(&sigma));
    let mut sigma_bar = vec![0.0; sigma.len()];
    sparsity::density_backward(&sigma, record.cotangent("loss").scalar(), &mut sigma_bar).unwrap();
    let wide: Vec<f64> = sigma_bar.iter().map(|&b| f64::from(b)).collect();
    each(record, "sigma_bar", &wide, &record.grad("sigma").data);
}

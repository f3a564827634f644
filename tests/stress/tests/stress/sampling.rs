//! Samplers between near planes of 1e-6 and far planes at the end of the numbers, with 1 to 10^6 samples.

use render_core::sample::{
    Spacing, bin_edges, dt_from_edges, invert_cdf, merge_sorted, nerf_sample_pdf, stratified_bins, stratified_nerf,
};
use stress::{MAGNITUDES, Tally, Verdict, ensure, finite};

const COUNTS: [usize; 8] = [1, 2, 3, 64, 1000, 10_000, 100_000, 1_000_000];
/// The largest number below 1.
const LAST_U: f32 = 1.0 - f32::EPSILON / 2.0;

fn sorted_within(what: &str, t: &[f32], near: f32, far: f32) -> Verdict {
    let out = t.iter().position(|t| !(near..=far).contains(t));
    ensure(out.is_none(), || format!("{what}[{out:?}] is {:?}, outside of [{near:e}, {far:e}]", out.map(|i| t[i])))?;
    ensure(t.is_sorted(), || format!("{what} is not sorted"))
}

pub(crate) fn cases(tally: &mut Tally) {
    let spans = [(1e-6, 1.0), (1e-6, 1e6), (1e-6, 3e38), (1e-38, 3e38), (0.0, 1.0), (1.0, 1.0), (0.0, f32::MAX)];
    for (near, far) in spans {
        for spacing in [Spacing::Linear, Spacing::Disparity] {
            if near == 0.0 && spacing == Spacing::Disparity {
                continue; // 1 / 0: refused where configurations are read
            }
            for n in COUNTS {
                let name = format!("{n} samples, {spacing:?}, near {near:e}, far {far:e}");
                tally.case(name, "sorted, inside of [near, far]", || {
                    for u in [0.0, 0.5, LAST_U] {
                        let (u, mut t) = (vec![u; n], vec![f32::NAN; n]);
                        stratified_bins(near, far, spacing, &u, &mut t);
                        sorted_within("t", &t, near, far)?;
                        stratified_nerf(near, far, spacing, &u, &mut t);
                        sorted_within("t", &t, near, far)?;
                    }
                    let (mut edges, mut dt) = (vec![f32::NAN; n + 1], vec![f32::NAN; n]);
                    bin_edges(near, far, spacing, &mut edges);
                    sorted_within("edges", &edges, near, far)?;
                    ensure(edges[0] == near && edges[n] == far, || "the ends are not met".into())?;
                    dt_from_edges(&edges, &mut dt);
                    ensure(dt.iter().all(|&dt| dt >= 0.0 && dt.is_finite()), || "a length is negative".into())
                });
            }
        }
    }
    tally.case("disparity to infinity", "finite samples that increase", || {
        let mut t = [f32::NAN; 64];
        stratified_bins(1e-6, f32::INFINITY, Spacing::Disparity, &[0.5; 64], &mut t);
        finite("t", &t)?;
        sorted_within("t", &t, 1e-6, f32::MAX)
    });
    for weight in MAGNITUDES {
        for (shape, pick) in [("everywhere", usize::MAX), ("in one bin", 5), ("in the last bin", 15)] {
            for (a, b) in [(0.0, 1.0), (1e-6, 1e6), (0.0, 3e38), (1e-40, 1e-39), (2.0, 2.0)] {
                let name = format!("weight {weight:e} {shape}, edges {a:e} to {b:e}");
                tally.case(name, "samples sorted and inside; in the bin with the mass", || {
                    let mut edges = [0.0; 17];
                    bin_edges(a, b, Spacing::Linear, &mut edges);
                    let weights: [f32; 16] =
                        core::array::from_fn(|i| if pick == usize::MAX || pick == i { weight } else { 0.0 });
                    let u: Vec<f32> = (0..=100).map(|i| (i as f32 / 100.0).min(LAST_U)).collect();
                    let (mut cdf, mut t) = ([f64::NAN; 17], vec![f32::NAN; u.len()]);
                    invert_cdf(&edges, &weights, 0.0, &u, &mut cdf, &mut t);
                    sorted_within("t", &t, a, b)?;
                    if pick < 16 && weight > 0.0 {
                        sorted_within("t of the one bin", &t, edges[pick], edges[pick + 1])?;
                    }
                    invert_cdf(&edges, &weights, 1e-5, &u, &mut cdf, &mut t);
                    sorted_within("t", &t, a, b)?;
                    nerf_sample_pdf(&edges, &weights, &u, &mut cdf, &mut t);
                    finite("t", &t)?;
                    ensure(t.iter().all(|t| (a..=b).contains(t)), || "a sample left the bins".into())
                });
            }
        }
    }
    for n in [1, 1000, 1_000_000] {
        tally.case(
            format!("histogram of {n} bins"),
            "sorted and inside; the cumulative mass ends at exactly 1",
            || {
                let mut edges = vec![0.0; n + 1];
                bin_edges(1e-6, 1e6, Spacing::Disparity, &mut edges);
                let weights: Vec<f32> = (0..n).map(|i| if i % 3 == 0 { 0.0 } else { (i % 7) as f32 * 1e-20 }).collect();
                let u: Vec<f32> = (0..1000).map(|i| (i as f32 + 0.5) / 1000.0).collect();
                let (mut cdf, mut t) = (vec![f64::NAN; n + 1], vec![f32::NAN; 1000]);
                invert_cdf(&edges, &weights, 0.0, &u, &mut cdf, &mut t);
                ensure(cdf[n] == 1.0 && cdf.is_sorted(), || format!("cdf ends at {}", cdf[n]))?;
                sorted_within("t", &t, 1e-6, 1e6)?;
                let mut both = vec![f32::NAN; 2000];
                merge_sorted(&t, &t, &mut both);
                sorted_within("merged", &both, 1e-6, 1e6)
            },
        );
    }
}

//! Ray sampling against values made elsewhere.

use render_core::sample::{Spacing, bin_edges, invert_cdf, nerf_sample_pdf, stratified_bins, stratified_nerf};
use std::path::Path;
use testkit::golden::{Golden, Kind, Record, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/sampling.json")).unwrap()
}

/// `(rtol, atol)` for `f32`.
fn tolerance(record: &Record) -> (f64, f64) {
    assert!(record.f32_inputs_exact, "{}", record.label());
    if record.kind == Kind::Random { (2e-6, 1e-6) } else { (1e-4, 0.0) }
}

#[test]
fn inverse_cdf_samples_match() {
    let golden = golden();
    for record in golden.op("invert_cdf") {
        let (rtol, atol) = tolerance(record);
        let (edges, weights, u) = (record.input("t").f32(), record.input("weights").f32(), record.input("u").f32());
        let (mut cdf, mut samples) = (vec![0.0; edges.len()], vec![0.0; u.len()]);
        invert_cdf(&edges, &weights, record.param("pad").f32(), &u, &mut cdf, &mut samples);
        let label = record.label();
        // The pad is not an f32 number, everything else is.
        assert_close(&format!("{label} cdf"), &cdf, &record.output("cdf").data, 1e-8, 1e-13);
        assert_close(&label, &samples, &record.output("samples").data, rtol, atol);
        assert_eq!((cdf[0], cdf[edges.len() - 1]), (0.0, 1.0), "{label}");
    }
}

#[test]
fn nerf_samples_match() {
    let golden = golden();
    for record in golden.op("nerf_sample_pdf") {
        let (rtol, atol) = tolerance(record);
        assert_eq!(record.param("eps").f64(), 1e-5);
        let (edges, weights, u) = (record.input("bins").f32(), record.input("weights").f32(), record.input("u").f32());
        let (mut cdf, mut samples) = (vec![0.0; edges.len()], vec![0.0; u.len()]);
        nerf_sample_pdf(&edges, &weights, &u, &mut cdf, &mut samples);
        assert_close(&record.label(), &samples, &record.output("samples").data, rtol, atol);
    }
}

fn spacing(record: &Record) -> Spacing {
    if record.param("lindisp").bool() { Spacing::Disparity } else { Spacing::Linear }
}

#[test]
fn stratified_samples_match() {
    let golden = golden();
    for record in golden.op("stratified_bins").chain(golden.op("stratified_nerf")) {
        let (rtol, atol) = tolerance(record);
        let (near, far, u) = (record.param("near").f32(), record.param("far").f32(), record.input("u").f32());
        let mut t = vec![0.0; u.len()];
        let label = record.label();
        if record.op == "stratified_bins" {
            stratified_bins(near, far, spacing(record), &u, &mut t);
            let mut edges = vec![0.0; u.len() + 1];
            bin_edges(near, far, spacing(record), &mut edges);
            assert_close(&format!("{label} edges"), &edges, &record.output("edges").data, rtol, atol);
        } else {
            stratified_nerf(near, far, spacing(record), &u, &mut t);
        }
        assert_close(&label, &t, &record.output("t").data, rtol, atol);
    }
}

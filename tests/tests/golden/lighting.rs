//! Lighting against values and gradients made elsewhere, in both precisions.

use render_core::lighting::{
    Kind, Lighting, Sun, Tone, outward_normal, shade, shade_backward, sun_and_sky, sun_and_sky_backward,
};
use std::path::Path;
use testkit::golden::{Golden, Record, assert_close};

fn golden() -> Golden {
    Golden::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/lighting.json")).unwrap()
}

fn three(x: &[f64]) -> [f64; 3] {
    [x[0], x[1], x[2]]
}

fn lighting(record: &Record, kind: Kind) -> Lighting<f64> {
    let mut lighting = Lighting::dark(kind);
    lighting.coefficients.as_flattened_mut().copy_from_slice(&record.input("coeffs").data);
    lighting
}

fn single(l: &Lighting<f64>) -> Lighting<f32> {
    Lighting { kind: l.kind, coefficients: l.coefficients.map(|row| row.map(|x| x as f32)) }
}

/// Irradiance, gradient of the coefficients, gradient of the normal.
type Results = ([f64; 3], Vec<f64>, [f64; 3]);

fn run(record: &Record, kind: Kind, bar: [f64; 3]) -> [Results; 2] {
    let (light, n) = (lighting(record, kind), three(&record.input("normal").data));
    let (mut l_bar, mut n_bar) = ([[0.0; 3]; 9], [0.0; 3]);
    light.irradiance_backward(n, bar, &mut l_bar, &mut n_bar);
    let double = (light.irradiance(n), l_bar.as_flattened().to_vec(), n_bar);
    let (light, n) = (single(&light), n.map(|x| x as f32));
    let (mut l_bar, mut n_bar) = ([[0.0; 3]; 9], [0.0; 3]);
    light.irradiance_backward(n, bar.map(|x| x as f32), &mut l_bar, &mut n_bar);
    let wide = |x: [f32; 3]| x.map(f64::from);
    [double, (wide(light.irradiance(n)), l_bar.as_flattened().iter().map(|&x| x.into()).collect(), wide(n_bar))]
}

#[test]
fn irradiance_and_plain_sums_match() {
    let golden = golden();
    // Six-digit constants of the published forms are off by up to 1e-6 of each of nine terms.
    for (op, kind, output, double) in [
        ("sh_irradiance_exact", Kind::Radiance, "irradiance", (1e-12, 1e-13)),
        ("sh_irradiance_rh", Kind::Radiance, "irradiance", (2e-6, 2e-6)),
        ("sh9_plain_osr", Kind::Irradiance, "radiance", (2e-6, 2e-6)),
    ] {
        for record in golden.op(op) {
            let label = record.label();
            let bar = three(&record.cotangent(output).data);
            for ((e, l_bar, n_bar), (rtol, atol)) in run(record, kind, bar).into_iter().zip([double, (5e-6, 5e-6)]) {
                assert_close(&label, &e, &record.output(output).data, rtol, atol);
                assert_close(&format!("{label} dcoeffs"), &l_bar, &record.grad("coeffs").data, rtol, atol);
                assert_close(&format!("{label} dnormal"), &n_bar, &record.grad("normal").data, rtol, 4.0 * atol);
            }
        }
    }
}

#[test]
fn shaded_colours_match() {
    for record in golden().op("sh9_shade_osr") {
        let label = record.label();
        let (light, n) = (lighting(record, Kind::Irradiance), three(&record.input("normal").data));
        let albedo = three(&record.input("albedo").data);
        let e = light.irradiance(n);
        let bar = three(&record.cotangent("colour").data);
        let (mut albedo_bar, mut shadow_bar, mut e_bar) = ([0.0; 3], 0.0, [0.0; 3]);
        shade_backward(Tone::Gamma, albedo, 1.0, e, bar, &mut albedo_bar, &mut shadow_bar, &mut e_bar);
        let (mut l_bar, mut n_bar) = ([[0.0; 3]; 9], [0.0; 3]);
        light.irradiance_backward(n, e_bar, &mut l_bar, &mut n_bar);
        // Six-digit constants again.
        let check =
            |name: &str, got: &[f64], want: &[f64]| assert_close(&format!("{label} {name}"), got, want, 2e-6, 2e-6);
        check("colour", &shade(Tone::Gamma, albedo, 1.0, e), &record.output("colour").data);
        check("dalbedo", &albedo_bar, &record.grad("albedo").data);
        check("dcoeffs", l_bar.as_flattened(), &record.grad("coeffs").data);
        check("dnormal", &n_bar, &record.grad("normal").data);
        let colour = shade(Tone::Gamma, albedo.map(|x| x as f32), 1.0, single(&light).irradiance(n.map(|x| x as f32)));
        check("colour in f32", &colour.map(f64::from), &record.output("colour").data);
    }
}

#[test]
fn sun_and_sky_match() {
    for record in golden().op("sun_ambient") {
        let label = record.label();
        let input = |name: &str| three(&record.input(name).data);
        let normalise = |x: [f64; 3]| x.map(|c| c / x.iter().map(|x| x * x).sum::<f64>().sqrt());
        let (n, l) = (normalise(input("normal")), normalise(input("sun_dir")));
        let light = lighting(record, Kind::Radiance);
        let sun = Sun {
            irradiance: input("sun_rgb"),
            visibility: record.input("visibility").scalar(),
            cosine: n.iter().zip(l).map(|(a, b)| a * b).sum(),
        };
        let ambient = light.irradiance(n);
        assert_close(&label, &ambient, &record.output("ambient").data, 1e-12, 1e-13);
        assert_close(&label, &[sun.cosine.max(0.0)], &[record.output("cosine").scalar()], 1e-12, 1e-13);
        let colour = sun_and_sky(input("albedo"), ambient, sun);
        assert_close(&label, &colour, &record.output("colour").data, 1e-12, 1e-13);
        let (mut albedo_bar, mut ambient_bar) = ([0.0; 3], [0.0; 3]);
        let mut sun_bar = Sun { irradiance: [0.0; 3], visibility: 0.0, cosine: 0.0 };
        let bar = three(&record.cotangent("colour").data);
        sun_and_sky_backward(input("albedo"), ambient, sun, bar, &mut albedo_bar, &mut ambient_bar, &mut sun_bar);
        assert_close(&label, &albedo_bar, &record.grad("albedo").data, 1e-10, 1e-12);
        assert_close(&label, &sun_bar.irradiance, &record.grad("sun_rgb").data, 1e-10, 1e-12);
        assert_close(&label, &[sun_bar.visibility], &[record.grad("visibility").scalar()], 1e-10, 1e-12);
        // The coefficients see the colour and the ambient light itself.
        for (a, b) in ambient_bar.iter_mut().zip(&record.cotangent("ambient").data) {
            *a += b;
        }
        let (mut l_bar, mut n_bar) = ([[0.0; 3]; 9], [0.0; 3]);
        light.irradiance_backward(n, ambient_bar, &mut l_bar, &mut n_bar);
        assert_close(&label, l_bar.as_flattened(), &record.grad("coeffs").data, 1e-10, 1e-12);
    }
}

#[test]
fn summed_gradients_give_the_outward_normal() {
    for record in golden().op("density_normal") {
        let weights = &record.output("weights").data;
        let inward = |c: usize| -> f64 {
            weights.iter().zip(record.output("density_gradient").data.chunks(3)).map(|(w, g)| w * g[c]).sum()
        };
        let sum = [0, 1, 2].map(inward);
        // The file accumulates what points out of matter.
        assert_close(&record.label(), &sum.map(|x| -x), &record.output("accumulated").data, 1e-12, 1e-13);
        assert_close(&record.label(), &outward_normal(sum), &record.output("normal_sum_then_unit").data, 1e-12, 1e-13);
    }
}

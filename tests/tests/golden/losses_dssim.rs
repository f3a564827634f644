//! The loss of splats' pictures against golden vectors: `tests/golden/losses_dssim.json`.

use float_core::Simd;
use losses::dssim::{Dssim, Pair, Target};
use testkit::golden::{Golden, Kind, assert_close};

/// `[row][column][channel]` to `[channel][row][column]`.
fn planes(interleaved: &[f32]) -> Vec<f32> {
    (0..3).flat_map(|c| interleaved.iter().skip(c).step_by(3).copied()).collect()
}

#[test]
fn dssim_and_its_gradient_match_golden() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/losses_dssim.json");
    let golden = Golden::read(path.as_ref()).unwrap();
    let mut count = 0;
    for record in golden.op("dssim") {
        let x = record.input("pred");
        let [height, width, channels] = x.shape[..] else { panic!("{}: no picture", record.label()) };
        let (x, y) = (planes(&x.f32()), planes(&record.input("gt").f32()));
        let pair = Pair { channels, height, width, x: &x, target: Target::Planes(&y), weights: None };
        let lambda = record.param("lambda").f32();
        // The gradient is of ssim + dssim + loss_3dgs, and golden dssim is half of ours.
        let [of_value, of_gradient] = if record.kind == Kind::Random { [2e-6, 5e-5] } else { [1e-4, 1e-3] };
        for simd in Simd::available() {
            let mut dssim = Dssim::new(simd);
            let mut x_bar = vec![0.0; x.len()];
            dssim.dssim_backward(&pair, -0.5, &mut x_bar).unwrap();
            let loss = dssim.l1_dssim_backward(&pair, lambda, 1.0, &mut x_bar).unwrap();

            let near = |name: &str, got: f64| assert_close(name, &[got], &record.output(name).data, of_value, 1e-6);
            near("ssim", 1.0 - loss.dssim);
            near("dssim", 0.5 * loss.dssim);
            near("loss_3dgs", loss.loss);
            let want = &record.get("grads", "pred").unwrap().data;
            let want = (0..3).flat_map(|c| want.iter().skip(c).step_by(3).copied());
            // Where values are equal, the golden slope of |0| is 1; ours is 0.
            let tie = |i: usize| (1.0 - f64::from(lambda)) / x.len() as f64 * f64::from(u8::from(x[i] == y[i]));
            let want: Vec<f64> = want.enumerate().map(|(i, want)| want - tie(i)).collect();
            assert_close(&record.label(), &x_bar, &want, of_gradient, 1e-5);
            count += 1;
        }
    }
    assert_eq!(count, 5 * Simd::available().count());
}

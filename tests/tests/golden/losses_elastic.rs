//! Elastic energy of deformations against golden vectors: `tests/golden/losses_elastic.json`.

use losses::elastic::{self, SCALE, SMALLEST};
use testkit::golden::{Golden, Record, assert_close};

fn golden() -> Golden {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/losses_elastic.json");
    Golden::read(path.as_ref()).unwrap()
}

/// How well the logarithm of the smallest singular value is known: the entries are exact, the golden value comes from a
/// decomposition that is not better than the largest singular value's last digit.
fn conditioning(record: &Record) -> f64 {
    let sigma = &record.output("singular_values").data;
    let smallest = sigma.iter().copied().fold(f64::INFINITY, f64::min).max(SMALLEST);
    1e-15 * sigma[0] / smallest
}

#[test]
fn energies_and_gradients_match_golden() {
    for record in golden().op("elastic") {
        assert_eq!((record.param("eps").f64(), record.param("c").f64()), (SMALLEST, 0.03));
        let j = &record.input("jacobian").data;
        let matrix = std::array::from_fn(|i| std::array::from_fn(|k| j[3 * i + k]));
        let want = record.output("sq_residual").scalar();
        let rounding = conditioning(record);

        let (energy, gradient) = elastic::energy_gradient_of(&matrix);
        assert_eq!(elastic::energy_of(&matrix), energy, "{}", record.label());
        // Logarithms of singular values to 1e-13: the energy to that times the largest of them.
        let atol = (1e-13 + 10.0 * rounding) * want.sqrt() + 1e-26;
        assert_close(&record.label(), &[energy], &[want], 0.0, atol);
        let want = &record.get("grads_sq_residual", "grads_sq_residual").unwrap().data;
        let rtol = 1e-10 + 100.0 * rounding;
        assert_close(&format!("{} gradient", record.label()), gradient.as_flattened(), want, rtol, 1e-12);

        let single = record.input("jacobian").f32();
        let want = record.output("loss_barron").scalar();
        let mut bar = [0.0; 9];
        let got = elastic::elastic_backward(&single, &[1.0], SCALE, 1.0, &mut bar).unwrap();
        // The scale is an f32: 0.03 to 3e-8.
        assert_close(&format!("{} robust", record.label()), &[got], &[want], 1e-6, 1e-12);
        let want = &record.get("grads_loss_barron", "grads_loss_barron").unwrap().data;
        assert_close(&format!("{} robust gradient", record.label()), &bar, want, 1e-5 + 100.0 * rounding, 1e-10);
        assert_eq!(elastic::elastic(&single, &[1.0], SCALE).unwrap(), got);
    }
}

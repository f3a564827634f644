//! Plain kernels against golden vectors: `tests/golden/losses_simple.json`.

use losses::kernel::Kernel;
use testkit::golden::{Golden, Kind, Record, assert_close};

fn records() -> Vec<Record> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/losses_simple.json");
    Golden::read(path.as_ref()).unwrap().records
}

/// The kernel, and what its golden twin is in units of it: least squares carry a factor 1/2, the squared error does not.
fn kernel(record: &Record) -> (Kernel, f64) {
    let c = record.param("c").f32();
    match record.param("kernel").str() {
        "charbonnier" => (Kernel::Charbonnier { c }, 1.0),
        "huber" => (Kernel::Huber { delta: c }, 1.0),
        "l1" => (Kernel::L1, 1.0),
        "l2" => (Kernel::Squared, 0.5),
        other => panic!("no kernel `{other}`"),
    }
}

#[test]
fn kernels_match_golden() {
    let records = records();
    assert_eq!(records.len(), 8);
    for record in &records {
        assert!(record.f32_inputs_exact, "{}", record.label());
        let (kernel, factor) = kernel(record);
        let x = record.input("x").f32();
        let value: Vec<f64> = x.iter().map(|&x| factor * f64::from(kernel.value(x, 0.0))).collect();
        let (rtol, atol) = if record.kind == Kind::Random { (2e-6, 1e-6) } else { (1e-4, 0.0) };
        assert_close(&record.label(), &value, &record.output("rho").data, rtol, atol);
        // The largest entry of an adversarial record is 1e30: each entry by itself as well, above what f32 can hold.
        for ((&x, &got), &want) in x.iter().zip(&value).zip(&record.output("rho").data) {
            assert!((got - want).abs() <= 2e-6 * want + 1e-37, "{}: rho({x}) = {got}, {want}", record.label());
        }
    }
}

#[test]
fn derivatives_match_golden() {
    for record in &records() {
        let (kernel, factor) = kernel(record);
        let x = record.input("x").f32();
        let cotangent = &record.cotangent("rho").data;
        let mut grad: Vec<f64> =
            x.iter().zip(cotangent).map(|(&x, bar)| bar * factor * f64::from(kernel.derivative(x, 0.0))).collect();
        if kernel == Kernel::L1 {
            // The README says that the derivative at 0 is 0, as here; the records hold the slope to the right, 1. Both are
            // subgradients.
            for (i, _) in x.iter().enumerate().filter(|(_, x)| **x == 0.0) {
                assert_eq!((grad[i], record.grad("x").data[i]), (0.0, cotangent[i]), "{}", record.label());
                grad[i] = cotangent[i];
            }
        }
        let (rtol, atol) = if record.kind == Kind::Random { (5e-5, 1e-5) } else { (1e-3, 0.0) };
        assert_close(&record.label(), &grad, &record.grad("x").data, rtol, atol);
        for ((&x, &got), &want) in x.iter().zip(&grad).zip(&record.grad("x").data) {
            assert!((got - want).abs() <= 1e-5 * want.abs() + 1e-37, "{}: at {x}: {got}, {want}", record.label());
        }
    }
}

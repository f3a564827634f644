//! Distortion and interlevel loss against golden vectors: `tests/golden/losses_rays.json`.

use losses::interlevel::{self, EPS, Levels, Scratch};
use losses::{Edges, RayIntervals, Reduction, distortion};
use testkit::golden::{Golden, Kind, Record, assert_close};

fn records(op: &str) -> Vec<Record> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/golden/losses_rays.json");
    let records: Vec<Record> =
        Golden::read(path.as_ref()).unwrap().records.into_iter().filter(|r| r.op == op).collect();
    assert!(records.len() >= 8, "{op}");
    assert!(records.iter().all(|r| r.f32_inputs_exact));
    records
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| f64::from(x)).collect()
}

#[test]
fn distortion_matches_golden() {
    for record in &records("distortion") {
        let (s, w) = (record.input("t").f32(), record.input("w").f32());
        let offsets = [0, w.len() as u32];
        let intervals = RayIntervals { offsets: &offsets, edges: Edges::Joined(&s) };
        let got = distortion::distortion(intervals, &w, Reduction::Sum).unwrap();
        // Sums are f64 and inputs exact: the bounds of f64 hold for the value.
        assert_close(&record.label(), &[got], &record.output("loss").data, 1e-10, 1e-13);
        let mut w_bar = vec![0.0; w.len()];
        let bar = record.cotangent("loss").data[0];
        distortion::distortion_backward(intervals, &w, Reduction::Sum, bar, &mut w_bar).unwrap();
        assert_close(&record.label(), &wide(&w_bar), &record.grad("w").data, 1e-6, 1e-30);
    }
}

#[test]
fn interlevel_matches_golden() {
    for record in &records("interlevel") {
        assert_eq!(record.param("eps").f64(), EPS);
        let input = |name| record.input(name).f32();
        let (s, w, p_s, p_w) = (input("t"), input("w"), input("t_env"), input("w_env"));
        let (offsets, p_offsets) = ([0, w.len() as u32], [0, p_w.len() as u32]);
        let levels = Levels {
            fine: RayIntervals { offsets: &offsets, edges: Edges::Joined(&s) },
            w: &w,
            proposal: RayIntervals { offsets: &p_offsets, edges: Edges::Joined(&p_s) },
            w_proposal: &p_w,
        };
        let scratch = &mut Scratch::default();
        let (mut bound, mut loss) = (vec![0.0; w.len()], vec![0.0; w.len()]);
        interlevel::bounds(levels, &mut bound, scratch).unwrap();
        interlevel::per_interval(levels, &mut loss, scratch).unwrap();
        let (rtol, atol) = if record.kind == Kind::Random { (2e-6, 1e-6) } else { (1e-4, 1e-12) };
        assert_close(&record.label(), &wide(&bound), &record.output("outer").data, rtol, atol);
        assert_close(&record.label(), &wide(&loss), &record.output("per_bin").data, rtol, atol);
        let mut bar = vec![0.0; p_w.len()];
        interlevel::per_interval_backward(levels, &record.cotangent("per_bin").f32(), &mut bar, scratch).unwrap();
        interlevel::bounds_backward(levels, &record.cotangent("outer").f32(), &mut bar, scratch).unwrap();
        let (rtol, atol) = if record.kind == Kind::Random { (5e-5, 1e-5) } else { (1e-3, 1e-12) };
        assert_close(&record.label(), &wide(&bar), &record.grad("w_env").data, rtol, atol);
    }
}

//! The reader reads exactly, and names what is wrong.

use super::*;

fn file(record: &str) -> String {
    format!(r#"{{"topic": "t", "seed": 1, "format": 1, "records": [{record}]}}"#)
}

fn record(extra: &str) -> String {
    file(&format!(
        r#"{{"op": "f", "name": "n", "kind": "boundary", "params": {{"a": "-inf", "n": 3, "m": 3.0, "on": true, "s": "x", "l": [[1, 2], [3, 4]]}},
         "f32_inputs_exact": false, "inputs": {{"x": {{"shape": [2, 2], "data": [0.1, 1e-320, -2, 3]}}}}{extra}}}"#
    ))
}

#[test]
fn numbers_come_back_exactly() {
    let golden = Golden::parse(&record("")).unwrap();
    let r = golden.record("f", "n");
    assert_eq!(r.input("x").data, [0.1, 1e-320, -2.0, 3.0]);
    assert_eq!(r.input("x").row(1), [-2.0, 3.0]);
    assert_eq!(r.kind, Kind::Boundary);
    assert_eq!(r.param("a").f64(), f64::NEG_INFINITY);
    assert_eq!((r.param("n").usize(), r.param("m").usize(), r.param("on").bool()), (3, 3, true));
    assert_eq!((r.param("s").str(), r.param("l").list()), ("x", vec![1.0, 2.0, 3.0, 4.0]));
    assert!(r.try_param("missing").is_none() && !r.f32_inputs_exact);
}

#[test]
fn scalars_empty_tensors_and_image_bytes() {
    let golden = Golden::parse(&record(
        r#", "outputs": {"s": {"shape": [], "data": [7]}, "e": {"shape": [0, 3], "data": []}, "i": {"shape": [1, 3], "hex": "00fF80"}},
          "one": {"shape": [1], "data": [5]}"#,
    ))
    .unwrap();
    let r = &golden.records[0];
    assert_eq!(r.output("s").scalar(), 7.0);
    assert!(r.output("e").data.is_empty());
    assert_eq!(r.output("i").bytes(), [0, 255, 128]);
    assert_eq!(r.get("one", "one").unwrap().scalar(), 5.0);
    assert_eq!(r.section("outputs").count(), 3);
}

#[test]
fn what_is_wrong_is_named() {
    for (text, want) in [
        (record(r#", "outputs": {"y": {"shape": [3], "data": [1]}}"#), "f/n: `outputs.y`: shape [3] needs 3"),
        (record(r#", "outputs": {"y": {"shape": [1], "hex": "0g"}}"#), "`g` is not a hex digit"),
        (record(r#", "outputs": {"y": {"shape": [1], "data": ["x"]}}"#), "`data[0]` is \"x\""),
        (file(r#"{"op": "f", "name": "n", "kind": "odd"}"#), "`kind` is `odd`"),
        (file("{}"), "record 0: `op` is missing"),
        ("{\"format\": 2}".to_owned(), "`format` is 2"),
        ("{".to_owned(), "EOF"),
    ] {
        let message = Golden::parse(&text).unwrap_err().to_string();
        assert!(message.contains(want), "`{message}` does not say `{want}`");
    }
}

#[test]
#[should_panic(expected = "no `z` among `inputs`, which holds [\"x\"]")]
fn a_missing_tensor_panics_with_what_is_there() {
    let golden = Golden::parse(&record("")).unwrap();
    let _ = golden.records[0].input("z");
}

#[test]
#[should_panic(expected = "no record of `g`")]
fn looping_over_nothing_panics() {
    let _ = Golden::parse(&record("")).unwrap().op("g").count();
}

#[test]
fn close_fails_on_difference_nan_infinity_and_length() {
    let want = [1.0, -100.0, 0.0];
    // The bound counts from the largest entry: 1e-3 * 100 + 0.05.
    assert!(check_close(&[1.14, -100.0, 0.14], &want, 1e-3, 0.05).is_ok());
    let message = check_close(&[1.14, -100.0, 0.16], &want, 1e-3, 0.05).unwrap_err();
    assert!(message.starts_with("[2]: got 1.6e-1, want 0e0"), "{message}");
    assert!(check_close(&[1.0, f64::NAN, 0.0], &want, 1.0, 1.0).is_err());
    assert!(check_close(&[f64::NAN], &[f64::NAN], 1.0, 1.0).is_err());
    assert!(check_close(&[f64::INFINITY, -100.0, 0.0], &want, 1.0, 1.0).is_err());
    assert!(check_close(&[f64::INFINITY], &[f64::INFINITY], 0.0, 0.0).is_ok());
    assert!(check_close(&[f32::INFINITY], &[f64::NEG_INFINITY], 0.0, 0.0).is_err());
    assert!(check_close(&[1.0, -100.0], &want, 1.0, 1.0).is_err());
    assert!(check_close(&[5.0, 1.0], &[f64::INFINITY, 1.0], 0.5, 0.5).is_err());
    assert!(check_close::<f64, f64>(&[], &[], 0.0, 0.0).is_ok());
}

//! Embeddings.

use super::f32s;
use field_core::embedding::Embedding;
use testkit::gradient::{Tolerance, check_pair, cotangent};

#[test]
fn embedding_gathers_and_adds_back_in_order() {
    let embedding = Embedding::new(4, 2);
    let table = [0.0, 1.0, 10.0, 11.0, 20.0, 21.0, 30.0, 31.0];
    let index = [3, 0, 3];
    let mut out = [0.0; 6];
    embedding.encode(&table, &index, &mut out).unwrap();
    assert_eq!(out, [30.0, 0.0, 30.0, 31.0, 1.0, 31.0]);
    let mut grad = [1.0; 8];
    embedding.encode_backward(&index, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &mut grad).unwrap();
    assert_eq!(grad, [3.0, 6.0, 1.0, 1.0, 1.0, 1.0, 5.0, 11.0]);
    let mut mean = [0.0; 2];
    embedding.mean(&table, &mut mean).unwrap();
    assert_eq!(mean, [15.0, 16.0]);
    let error = embedding.encode(&table, &[0, 4], &mut [0.0; 4]).unwrap_err();
    assert_eq!(error.to_string(), "`index[1]` is 4, but there are only 4 entries");
    assert_eq!(Embedding::new(0, 3).encode(&[], &[], &mut []), Ok(()));
}

#[test]
fn embedding_gradient_matches_differences() {
    let embedding = Embedding::new(5, 3);
    let index = [1, 4, 1, 0];
    let table: Vec<f64> = cotangent(15, 8);
    check_pair(
        &table,
        &cotangent(12, 9),
        |table, out| {
            for c in 0..3 {
                (0..4).for_each(|i| out[c * 4 + i] = table[index[i] as usize * 3 + c]);
            }
        },
        |_, out_bar, grad| {
            // The function under test; these cotangents are exact in f32.
            let mut grad32 = f32s(grad);
            embedding.encode_backward(&index, &f32s(out_bar), &mut grad32).unwrap();
            grad.iter_mut().zip(&grad32).for_each(|(g, g32)| *g = f64::from(*g32));
        },
        Tolerance::TWIN,
    )
    .unwrap();
}

//! Any number of threads gives the same bits (with the feature `rayon`).
#![cfg(feature = "rayon")]

use float_core::Simd;
use optim::{Adam, AdamConfig, BLOCK, Ema, clip, touched_len};

const N: usize = 100_003;

fn run(threads: usize) -> (Vec<f32>, Adam, f64, Ema, usize) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let simd = Simd::best();
        let mut params: Vec<f32> = (0..N).map(|i| (i as f32 * 0.37).sin()).collect();
        let mut adam = Adam::new(N, AdamConfig::NGP);
        let mut ema = Ema::new(N, 0.9);
        let (mut norm, mut bad) = (0.0, 0);
        for t in 0..4 {
            let mut grad: Vec<f32> =
                (0..N).map(|i| if i % 5 == t { 0.0 } else { (i as f32 + t as f32).cos() }).collect();
            (grad[77], grad[N - 1]) = (f32::NAN, f32::INFINITY);
            bad += clip::sanitise(simd, &mut grad);
            clip::clip_by_value(simd, 0.9, &mut grad);
            norm += clip::clip_by_global_norm(simd, 3.0, &mut [&mut grad]).norm;
            bad += adam.step(simd, 0.01, &mut params, &grad);
            let mut marks = vec![0_u64; touched_len(N)];
            for b in (0..N.div_ceil(BLOCK)).filter(|b| b % 7 != 0) {
                marks[b / 64] |= 1 << (b % 64);
            }
            bad += adam.step_touched(simd, 0.01, &mut params, &mut grad, &mut marks);
            ema.update(simd, &params);
        }
        (params, adam, norm, ema, bad)
    })
}

#[test]
fn one_two_and_four_threads_give_the_same_bits() {
    let one = run(1);
    assert_eq!(one.4, 8);
    for threads in [2, 4] {
        assert!(run(threads) == one, "{threads} threads");
    }
}

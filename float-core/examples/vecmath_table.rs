//! Time beside error: every function of `vecmath` at every SIMD level of this CPU, as a Markdown table.
//!
//! ```text
//! cargo run --release -p wildfield-float-core --example vecmath_table            every 1009th argument, seconds
//! cargo run --release -p wildfield-float-core --example vecmath_table -- --all   every argument there is, minutes
//! cargo run --release -p wildfield-float-core --example vecmath_table -- --all sin cos   these functions only
//! ```
//! Times are medians over arguments in `[-8, 8]` that lie in the L1 cache; `m32` is the plain version, one by one.

use float_core::Simd;
use float_core::vecmath::{Function, Worst};
use std::hint::black_box;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Arguments of one errand of a thread.
const CHUNK: u64 = 1 << 16;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let step = if arguments.iter().any(|a| a == "--all") { 1 } else { 1009 };
    println!("| function | level | ns a value | of `m32` | max error, ulp | at |");
    println!("| --- | --- | --- | --- | --- | --- |");
    let named = |f: &Function| arguments.iter().any(|a| a == f.name());
    let some = Function::ALL.iter().any(named);
    for function in Function::ALL.into_iter().filter(|f| !some || named(f)) {
        let worst = worst_everywhere(function, step);
        let plain = nanoseconds(|x, y| x.iter().zip(y).for_each(|(x, y)| *y = function.plain(*x)));
        println!("| `{}` | m32 | {plain:.2} | | | |", function.name());
        for (simd, worst) in Simd::available().zip(worst) {
            let time = nanoseconds(|x, y| function.map(simd, x, y));
            let (name, level) = (function.name(), simd.level());
            println!("| `{name}` | {level:?} | {time:.2} | {:.1}x | {:.3} | {:e} |", plain / time, worst.ulp, worst.at);
        }
    }
}

/// Largest error of each level over every `step`th bit pattern, in parallel.
fn worst_everywhere(function: Function, step: u64) -> Vec<Worst> {
    let next = AtomicU64::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let levels: Vec<Simd> = Simd::available().collect();
    let work = || {
        let mut worst = vec![Worst::NONE; levels.len()];
        let (mut x, mut exact) = (Vec::with_capacity(CHUNK as usize), Vec::with_capacity(CHUNK as usize));
        loop {
            let from = next.fetch_add(CHUNK * step, Ordering::Relaxed);
            if from >= 1 << 32 {
                return worst;
            }
            x.clear();
            let to = (from + CHUNK * step).min(1 << 32);
            x.extend((from..to).step_by(step as usize).map(|bits| f32::from_bits(bits as u32)));
            exact.clear();
            exact.extend(x.iter().map(|&x| function.exact(f64::from(x))));
            for (worst, &simd) in worst.iter_mut().zip(&levels) {
                *worst = worst.max(function.worst(simd, &x, &exact));
            }
        }
    };
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        threads.into_iter().fold(vec![Worst::NONE; levels.len()], |all, thread| {
            let part = thread.join().expect("the thread measures to its end");
            all.into_iter().zip(part).map(|(a, b)| a.max(b)).collect()
        })
    })
}

/// Median time of one value.
fn nanoseconds(mut run: impl FnMut(&[f32], &mut [f32])) -> f64 {
    let n = 2048;
    let x: Vec<f32> = (0..n).map(|i| 16.0 * (i * 769 % n) as f32 / n as f32 - 8.0).collect();
    let mut y = vec![0.0; n];
    let mut times: Vec<f64> = (0..31)
        .map(|_| {
            let start = Instant::now();
            for _ in 0..20 {
                run(black_box(&x), black_box(&mut y));
            }
            start.elapsed().as_secs_f64() * 1e9 / (20 * n) as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

//! Wall times: medians of repetitions that take turns.

use rayon::prelude::*;
use std::time::{Duration, Instant};

/// How long and how often things are timed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Effort {
    /// Repetitions of each case.
    pub(crate) repetitions: usize,
    /// Shortest time of a repetition: the work is repeated within it.
    pub(crate) least: Duration,
}

/// Something to time: does its work so many times.
pub(crate) struct Case<'a> {
    work: Box<dyn FnMut(u32) + Send + 'a>,
}

impl<'a> Case<'a> {
    /// `work` runs as it is, on the thread that measures.
    pub(crate) fn new(mut work: impl FnMut() + Send + 'a) -> Self {
        Self { work: Box::new(move |times| (0..times).for_each(|_| work())) }
    }

    /// `work` runs in the pool of `threads` threads and shares itself out. The pool is entered once for all of a
    /// repetition: on a busy machine that alone takes longer than a short call.
    pub(crate) fn pooled(pools: &'a Pools, threads: usize, mut work: impl FnMut() + Send + 'a) -> Self {
        Self { work: Box::new(move |times| pools.run(threads, || (0..times).for_each(|_| work()))) }
    }

    /// `work` runs at once on `threads` threads, on a state of its own each.
    pub(crate) fn parallel<S: Send + 'a>(
        pools: &'a Pools,
        threads: usize,
        state: impl FnMut() -> S,
        work: impl Fn(&mut S) + Send + Sync + 'a,
    ) -> Self {
        let mut states: Vec<S> = std::iter::repeat_with(state).take(threads).collect();
        Self {
            work: Box::new(move |times| {
                let own = |state: &mut S| (0..times).for_each(|_| work(state));
                pools.run(threads, || states.par_iter_mut().with_max_len(1).for_each(own));
            }),
        }
    }
}

/// Median seconds of one call of each case's work. The cases take turns, repetition by repetition: what disturbs the
/// machine disturbs all of them.
pub(crate) fn interleaved(effort: Effort, cases: &mut [Case<'_>]) -> Vec<f64> {
    let timed = |case: &mut Case<'_>, times: u32| {
        let clock = Instant::now();
        (case.work)(times);
        clock.elapsed().as_secs_f64()
    };
    let times: Vec<u32> = cases
        .iter_mut()
        .map(|case| {
            // The first call warms up: pages, caches, threads.
            timed(case, 1);
            let once = timed(case, 1).max(1e-9);
            (effort.least.as_secs_f64() / once).ceil().clamp(1.0, 1e6) as u32
        })
        .collect();
    let mut seconds = vec![Vec::with_capacity(effort.repetitions); cases.len()];
    for _ in 0..effort.repetitions.max(1) {
        for (i, case) in cases.iter_mut().enumerate() {
            seconds[i].push(timed(case, times[i]) / f64::from(times[i]));
        }
    }
    seconds.iter_mut().map(|s| median(s)).collect()
}

/// The middle value; the mean of the two middle ones of an even number.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}

/// Slope of the straight line through the logarithms: 1 where y grows as x. `None` with fewer than two different x.
pub(crate) fn log_slope(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| logs.iter().map(of).sum::<f64>() / n;
    let (mx, my) = (mean(|p| p.0), mean(|p| p.1));
    let spread: f64 = logs.iter().map(|p| (p.0 - mx).powi(2)).sum();
    let together: f64 = logs.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    (spread > 0.0).then(|| together / spread)
}

/// Largest distance of `got` from `want`, as a share of the largest `want`.
pub(crate) fn worst(got: &[f32], want: &[f64]) -> f64 {
    let scale = want.iter().fold(f64::MIN_POSITIVE, |m, w| m.max(w.abs()));
    // A missing or a NaN value must not pass for a small one.
    if got.len() != want.len() || got.iter().any(|x| x.is_nan()) {
        return f64::NAN;
    }
    got.iter().zip(want).map(|(&g, w)| (f64::from(g) - w).abs()).fold(0.0, f64::max) / scale
}

/// Thread pools of 1 to all threads.
pub(crate) struct Pools(Vec<rayon::ThreadPool>);

impl Pools {
    /// Pools up to `threads` threads.
    pub(crate) fn new(threads: usize) -> Result<Self, rayon::ThreadPoolBuildError> {
        (1..=threads.max(1))
            .map(|n| rayon::ThreadPoolBuilder::new().num_threads(n).build())
            .collect::<Result<_, _>>()
            .map(Self)
    }

    /// Threads of the largest pool.
    pub(crate) fn most(&self) -> usize {
        self.0.len()
    }

    /// 1 and the most, or 1 alone.
    pub(crate) fn one_and_most(&self) -> Vec<usize> {
        if self.most() == 1 { vec![1] } else { vec![1, self.most()] }
    }

    /// Run in the pool of so many threads.
    pub(crate) fn run<R: Send>(&self, threads: usize, work: impl FnOnce() -> R + Send) -> R {
        self.0[threads.clamp(1, self.most()) - 1].install(work)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_slopes_and_errors() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&mut []), 0.0);
        let square: Vec<(f64, f64)> = (1..6).map(|x| (f64::from(x), 7.0 * f64::from(x * x))).collect();
        assert!((log_slope(&square).unwrap() - 2.0).abs() < 1e-12);
        assert!(log_slope(&[(1.0, 1.0)]).is_none());
        assert_eq!(worst(&[1.0, 2.5], &[1.0, 2.0]), 0.25);
        assert!(worst(&[f32::NAN], &[1.0]).is_nan() && worst(&[], &[1.0]).is_nan());
    }

    #[test]
    fn every_case_runs_and_more_work_takes_longer() {
        let (mut a, mut b) = (0_u64, 0_u64);
        let effort = Effort { repetitions: 3, least: Duration::from_micros(200) };
        let spin = |n: u64, sum: &mut u64| (0..n).for_each(|i| *sum = std::hint::black_box(*sum ^ i));
        let times = interleaved(effort, &mut [Case::new(|| spin(1_000, &mut a)), Case::new(|| spin(200_000, &mut b))]);
        assert!(times[0] > 0.0 && times[1] > 3.0 * times[0], "{times:?}");
    }

    #[test]
    fn parallel_work_runs_on_each_state() {
        let pools = Pools::new(2).unwrap();
        assert_eq!(pools.one_and_most(), [1, 2]);
        let count = std::sync::atomic::AtomicUsize::new(0);
        let mut case = Case::parallel(
            &pools,
            2,
            || 0_u8,
            |_| {
                count.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            },
        );
        (case.work)(3);
        drop(case);
        assert_eq!(count.into_inner(), 6);
    }
}

//! The table of a hash grid of space and time learns where points were, the same with any number of threads, and goes on from a checkpoint.

use super::*;
use testkit::gradient::{Tolerance, central_difference, compare};

const SETTINGS: TimeHashSettings = TimeHashSettings {
    moving_levels: 3,
    moving_features: 2,
    moving_log2_table: 9,
    moving_n_min: 4,
    moving_n_max: 16,
    moving_times: 2,
    moving_times_max: 0,
};

fn made(settings: TimeHashSettings) -> Box<dyn Features> {
    TimeHashSource::new(settings, [-1.0, -0.5, 0.0, 0.5, 1.0].into()).features(Rng::new(5, 1)).unwrap()
}

fn points(n: usize) -> (Vec<f32>, Vec<f32>) {
    let (mut x, mut times) = (vec![0.0; 3 * n], vec![0.0; n]);
    Rng::new(6, 1).fill_uniform(0, &mut x);
    Rng::new(6, 2).fill_uniform(0, &mut times);
    times.iter_mut().for_each(|t| *t = 2.0 * *t - 1.0);
    (x, times)
}

fn encode(features: &dyn Features, x: &[f32], times: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; features.rows() * times.len()];
    features.encode(Places { x, times }, &mut out, &mut Vec::new());
    out
}

fn bars(rows: usize, n: usize) -> Vec<f32> {
    (0..rows * n).map(|i| 0.1 + (i % 7) as f32).collect()
}

fn step(features: &mut dyn Features, n: usize) -> usize {
    let ((x, times), raw_bar) = (points(n), bars(features.rows(), n));
    let (half, rows) = (n / 2, features.rows());
    // Two chunks of a batch.
    let columns = |all: &[f32], from: usize, len: usize| -> Vec<f32> {
        all.chunks_exact(n.max(1)).flat_map(|row| row[from..from + len].to_vec()).collect()
    };
    let [first, second] = [(0, half), (half, n - half)].map(|(from, len)| {
        (columns(&x, from, len), times[from..from + len].to_vec(), columns(&raw_bar[..rows * n], from, len))
    });
    let parts = [first, second];
    let parts = parts.each_ref().map(|(x, times, raw_bar)| Part { places: Places { x, times }, raw_bar });
    features.step(0.01, &parts)
}

fn state_of(features: &dyn Features) -> TensorMap {
    let mut tensors = Vec::new();
    features.push_state(&Names::new("table", "table"), &mut tensors);
    tensors.into_iter().map(Tensor::into_owned).map(|tensor| (tensor.name.clone(), tensor)).collect()
}

#[test]
fn gradients_are_those_of_differences() {
    let (mut features, n) = (made(SETTINGS), 11);
    features.parameters_mut().iter_mut().enumerate().for_each(|(i, p)| *p = (0.37 * i as f32).sin());
    let ((x, times), bars) = (points(n), bars(features.rows(), n));
    let places = Places { x: &x, times: &times };
    let dot = |out: &[f32]| out.iter().zip(&bars).map(|(a, b)| f64::from(a * b)).sum::<f64>();
    let mut grad = vec![0.0; features.parameters().len()];
    features.scatter(&Part { places, raw_bar: &bars }, &mut grad);
    // Features are linear in the table: differences are exact but for rounding.
    let at: Vec<f64> = features.parameters().iter().map(|p| f64::from(*p)).collect();
    let base = dot(&encode(&*features, &x, &times));
    for (i, grad) in grad.iter().enumerate().step_by(7) {
        features.parameters_mut()[i] = (at[i] + 1.0) as f32;
        let difference = dot(&encode(&*features, &x, &times)) - base;
        features.parameters_mut()[i] = at[i] as f32;
        assert!((difference - f64::from(*grad)).abs() < 1e-3 * (1.0 + difference.abs()), "{i}: {grad}, {difference}");
    }
    let mut x_bar = vec![0.0; 3 * n];
    features.pull_positions(places, &bars, Detail::All, &mut x_bar);
    let wide: Vec<f64> = x.iter().map(|x| f64::from(*x)).collect();
    let want = central_difference(&wide, |x| {
        let x: Vec<f32> = x.iter().map(|x| *x as f32).collect();
        dot(&encode(&*features, &x, &times))
    });
    // Differences of single precision.
    compare("positions", &x_bar, &want, Tolerance::new(0.1, 0.1)).unwrap();
}

#[test]
fn a_step_lowers_what_it_follows_with_the_same_bits_on_any_number_of_threads() {
    let after = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut features = made(SETTINGS);
            assert_eq!((0..3).map(|_| step(&mut *features, 40)).sum::<usize>(), 0);
            features
        })
    };
    let (one, four) = (after(1), after(4));
    assert_eq!(one.parameters(), four.parameters());
    let ((x, times), bars) = (points(40), bars(one.rows(), 40));
    let dot = |features: &dyn Features| encode(features, &x, &times).iter().zip(&bars).map(|(a, b)| a * b).sum::<f32>();
    assert!(dot(&*one) < dot(&*made(SETTINGS)) - 1.0, "{} and {}", dot(&*one), dot(&*made(SETTINGS)));
    // What no point saw never moves.
    let still = one.parameters().iter().zip(made(SETTINGS).parameters()).filter(|(a, b)| a == b).count();
    assert!(still > 100, "{still} of {}", one.parameters().len());

    let mut none = made(SETTINGS);
    assert_eq!(step(&mut *none, 0), 0);
    assert_eq!(none.parameters(), made(SETTINGS).parameters());
}

#[test]
fn a_checkpoint_goes_on_with_the_same_bits() {
    let mut whole = made(SETTINGS);
    step(&mut *whole, 40);
    let (names, state) = (Names::new("table", "table"), state_of(&*whole));
    let mut again = made(SETTINGS).restored(&names, &state, Done::default()).unwrap();
    step(&mut *whole, 40);
    step(&mut *again, 40);
    assert_eq!(whole.parameters(), again.parameters());
    assert!(made(SETTINGS).restored(&names, &TensorMap::new(), Done::default()).is_err());
}

#[test]
fn sizes_that_cannot_be_are_refused() {
    for settings in [
        TimeHashSettings { moving_levels: 0, ..SETTINGS },
        TimeHashSettings { moving_features: 5, ..SETTINGS },
        TimeHashSettings { moving_n_min: 32, ..SETTINGS },
        TimeHashSettings { moving_times: 0, ..SETTINGS },
        TimeHashSettings { moving_times_max: u32::MAX, ..SETTINGS },
    ] {
        let source = TimeHashSource::new(settings, [-1.0, 1.0].into());
        assert!(matches!(source.features(Rng::new(1, 1)), Err(SystemError::Config { .. })), "{settings:?}");
    }
}

#[test]
fn sizes_that_make_no_grid_are_said_with_their_values() {
    let error = TimeHashSettings { moving_features: 3, ..SETTINGS }.grid(&[-1.0, 0.0, 1.0]).unwrap_err().to_string();
    assert!(error.starts_with(&format!("`{SIZES}` = 3, 3, 9, 4, 16, 2, 0: ")), "{error}");
}

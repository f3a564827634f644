//! The network against its definition in `f64`, and what it learns.

use super::*;

const SIZE: [usize; 2] = [11, 7];

fn made(channels: usize) -> (FeatureNetwork, Features, Vec<bool>, Vec<bool>) {
    let rng = Rng::new(5, 2);
    let data = (0..(channels * 12) as u64).map(|i| 2.0 * rng.uniform_at(i) - 1.0).collect();
    let features = Features { channels, width: 4, height: 3, data };
    let pixels = SIZE[0] * SIZE[1];
    let most: Vec<bool> = (0..pixels).map(|i| rng.uniform_at(9000 + i as u64) < 0.7).collect();
    let least = most.iter().enumerate().map(|(i, most)| *most && i % 3 > 0).collect();
    (FeatureNetwork::new(channels, rng), features, least, most)
}

/// The loss by its definition, pixel by pixel, of whole vectors.
fn definition(parts: Parts, params: &[f64], features: &Features, bounds: &Bounds<'_>) -> f64 {
    let mut sum = 0.0;
    for i in 0..SIZE[0] * SIZE[1] {
        let at = [(i % SIZE[0]) as f64 + 0.5, (i / SIZE[0]) as f64 + 0.5];
        let at = [at[0] / SIZE[0] as f64, at[1] / SIZE[1] as f64];
        let mut vector = vec![0.0; features.channels];
        features.sample(at[0], at[1], &mut vector);
        let mut x: Vec<f64> = vector.iter().map(|v| f64::from(*v)).collect();
        for at in at {
            let phase = |k: usize| TAU * (1 << k) as f64 * at;
            x.extend((0..OCTAVES).flat_map(|k| [phase(k).sin(), phase(k).cos()]));
        }
        let unit = |u: usize| {
            let row = &params[parts.row(u)];
            let z = params[parts.biases()][u] + row.iter().zip(&x).map(|(w, x)| w * x).sum::<f64>();
            params[parts.second()][u] * z.max(0.0)
        };
        let m = 1.0 / (1.0 + (-(params[parts.bias()] + (0..UNITS).map(unit).sum::<f64>())).exp());
        if bounds.counts.is_none_or(|counts| counts[i] > 0.0) {
            let [least, most] = [bounds.least[i], bounds.most[i]].map(|inside| f64::from(u8::from(inside)));
            sum += (m - most).max(0.0) + (least - m).max(0.0);
        }
    }
    let largest = |range: Range<usize>| params[range].iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    sum / (SIZE[0] * SIZE[1]) as f64 + f64::from(REGULARISER) * largest(parts.first()) * largest(parts.second())
}

#[test]
fn loss_and_gradient_are_those_of_the_definition() {
    for counts in [None, Some((0..77).map(|i| f32::from(u8::from(i % 5 > 0))).collect::<Vec<f32>>())] {
        let (mut network, features, least, most) = made(5);
        let bounds = Bounds { least: &least, most: &most, counts: counts.as_deref() };
        let judged = network.judge(&features, SIZE);
        let loss = network.learn(&features, &judged, &bounds);
        let params: Vec<f64> = network.params.iter().map(|x| f64::from(*x)).collect();
        let of = |params: &[f64]| definition(network.parts, params, &features, &bounds);
        assert!((loss - of(&params)).abs() < 1e-5, "{loss} {}", of(&params));
        let largest = network.grad.iter().fold(0.0_f32, |a, b| a.max(b.abs()));
        for (i, got) in network.grad.iter().enumerate() {
            let moved = |by: f64| {
                let mut params = params.clone();
                params[i] += by;
                of(&params)
            };
            let want = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((f64::from(*got) - want).abs() < 2e-4 * f64::from(largest), "{i}: {got} {want}");
        }
    }
}

#[test]
fn it_learns_what_features_say() {
    let (mut network, mut features, ..) = made(3);
    // The left half has another vector.
    let half = |i: usize| i % 4 < 2;
    features.data.iter_mut().enumerate().for_each(|(i, x)| *x = if half(i) { 1.0 } else { -1.0 });
    let inside: Vec<bool> = (0..77).map(|i| i % SIZE[0] > 5).collect();
    let bounds = Bounds { least: &inside, most: &inside, counts: None };
    let costs: Vec<f64> = (0..300)
        .map(|_| {
            let judged = network.judge(&features, SIZE);
            let cost = network.learn(&features, &judged, &bounds);
            assert_eq!(network.step(Simd::best(), 1e-2), 0);
            cost
        })
        .collect();
    assert!(costs[299] < 0.5 * costs[0], "{} {}", costs[0], costs[299]);
    let mask = network.judge(&features, SIZE).mask;
    let right = mask.iter().zip(&inside).filter(|(m, inside)| (**m > 0.5) == **inside).count();
    assert!(right >= 70, "{right}");
}

#[test]
fn nothing_and_what_is_far_out_of_range_do_no_harm() {
    let (mut network, mut features, ..) = made(2);
    let judged = network.judge(&features, [0, 4]);
    assert!(judged.mask.is_empty());
    network.learn(&features, &judged, &Bounds { least: &[], most: &[], counts: None });
    assert_eq!(network.step(Simd::best(), 1e-3), 0);
    features.data.fill(3e38);
    let judged = network.judge(&features, [3, 2]);
    network.learn(&features, &judged, &Bounds { least: &[true; 6], most: &[true; 6], counts: None });
    network.step(Simd::best(), 1e-3);
    assert!(network.params.iter().all(|x| x.is_finite()));
}

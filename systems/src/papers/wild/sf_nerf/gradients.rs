//! Gradients of filter, codes and field against central differences of the loss from its definition, in `f64`.

use super::twin::{self, Twin, assert_near, differences, logistic, softplus};
use super::*;
use field_core::rng::Rng;

const VIEWS: usize = 3;
const CODE: usize = 4;

fn tiny() -> (FilterConfig, LayerConfig) {
    let filter = FilterConfig { transient_dims: CODE, filter_octaves: 2, filter_width: 6, ..FilterConfig::HASH_GRID };
    let layer = LayerConfig { filter_temperature: 0.8, filter_smoothness: 0.05, tail: 0.3, ..LayerConfig::HASH_GRID };
    (filter, layer)
}

fn batch(n: usize) -> Batch {
    let uniform = |i: usize| Rng::new(1, 2).uniform_at(i as u64);
    let mut batch =
        Batch::of_rays(&vec![render_core::ray::Ray { o: glam::DVec3::ZERO, d: glam::DVec3::Z }; n], &vec![[0.0; 3]; n]);
    for i in 0..n {
        batch.view[i] = (i % VIEWS) as u32;
        batch.place[i] = [uniform(2 * i), uniform(2 * i + 1)];
        batch.weight[i] = [1.0, 4.0, 0.0, 1.0, 1.0][i % 5];
    }
    batch
}

fn grid(channels: usize) -> Vec<Arc<Features>> {
    let one = |view: usize| Features {
        channels,
        width: 2,
        height: 2,
        data: (0..4 * channels).map(|i| Rng::new(5, 6).normal_at((view * 100 + i) as u64)).collect(),
    };
    (0..VIEWS).map(|view| Arc::new(one(view))).collect()
}

/// The mean loss of a batch from its definition.
fn total(model: &SfNerf, twin: &Twin, codes: &[f64], outcome: &Outcome<'_>) -> f64 {
    let batch = outcome.batch;
    let (kappa, beta_min) = (f64::from(model.loss.concrete.temperature), f64::from(model.loss.likelihood.beta_min));
    let counted = (0..batch.len()).filter(|&i| batch.weight[i] > 0.0);
    let mut sum = [0.0; 2];
    for i in counted.clone() {
        let view = batch.view[i] as usize;
        let place = batch.place[i].map(f64::from);
        let mut features = vec![0.0; model.features.first().map_or(0, |f| f.channels)];
        if let Some(f) = model.features.get(view) {
            f.sample(place[0], place[1], &mut features);
        }
        let features: Vec<f64> = features.into_iter().map(f64::from).collect();
        let (code, noise) = (&codes[CODE * view..][..CODE], f64::from(model.layers[i].noise));
        let raw = twin.raw(place, code, &features, 0).map(|[value, _]| value);
        let (alpha, beta) = (twin::alpha(raw[0], kappa, noise), beta_min + softplus(raw[4]));
        let e2 = (0..3)
            .map(|c| {
                let (field, truth) = (f64::from(outcome.pixels[i].rgb[c]), f64::from(outcome.truth[i][c]));
                (alpha * logistic(raw[1 + c]) + (1.0 - alpha) * field - truth).powi(2)
            })
            .sum::<f64>()
            / 3.0;
        let tail = f64::from(model.loss.likelihood.tail);
        let k2 = if tail > 0.0 { 2.0 * tail * tail * ((1.0 + e2 / (tail * tail)).sqrt() - 1.0) } else { e2 };
        let loss = k2 / (2.0 * beta * beta) + beta.ln() + f64::from(model.loss.lambda_alpha) * alpha;
        sum[0] += f64::from(batch.weight[i] * outcome.share) * loss;
        sum[1] += twin.roughness(place, code, &features, kappa, noise);
    }
    sum[0] + model.lambda_smooth * sum[1] / counted.count() as f64
}

#[test]
fn gradients_of_filter_and_codes_match_central_differences() {
    for channels in [0, 3] {
        let n = 20;
        let features = if channels > 0 { grid(channels) } else { Vec::new() };
        let (filter, layer) = tiny();
        let mut model = SfNerf::new(&filter, &layer, features, VIEWS, 9).unwrap();
        // Biases of 0 leave units that are exactly 0 where all before them are: a kink, of which differences see both sides.
        let Filter { place, features, joined, .. } = &mut model.filter;
        for net in [Some(place), features.as_mut(), Some(joined)].into_iter().flatten() {
            let biases: Vec<usize> = net.mlp.layers().iter().flat_map(|l| l.biases.clone()).collect();
            biases.into_iter().for_each(|at| net.params[at] += 0.4 * Rng::new(7, 8).uniform_at(at as u64) - 0.2);
            net.pack();
        }
        let batch = batch(n);
        let uniform = |i: usize| Rng::new(3, 4).uniform_at(i as u64);
        let rgb = |i: usize| [0, 1, 2].map(|c| uniform(10 * i + c));
        let pixels: Vec<Pixel> = (0..n).map(|i| Pixel { rgb: rgb(i), ..Pixel::default() }).collect();
        let truth: Vec<[f32; 3]> = (0..n).map(|i| rgb(1000 + i)).collect();
        model.predict(&batch, 5);
        let outcome = Outcome {
            step: 5,
            lr: 1e-3,
            simd: Simd::best(),
            batch: &batch,
            share: 1.0 / batch.weight.iter().sum::<f32>(),
            pixels: &pixels,
            truth: &truth,
            appearance_bar: &[],
            transient_bar: &[],
        };
        model.gradients(&outcome);
        let twin = Twin::of(&model.filter);
        let codes: Vec<f64> = model.codes.codes().rows.iter().map(|&c| f64::from(c)).collect();
        for net in [0, 1, 2].into_iter().filter(|&net| !twin.nets[net].is_empty()) {
            let want = differences(twin.nets[net].len(), |i, h| {
                let mut moved = twin.clone();
                moved.nets[net][i] += h;
                total(&model, &moved, &codes, &outcome)
            });
            let Filter { place, features, joined, .. } = &mut model.filter;
            let net_of = [Some(place), features.as_mut(), Some(joined)].into_iter().nth(net).flatten();
            assert_near(&format!("network {net}"), net_of.unwrap().grad_mut(), &want);
        }
        let mut got = vec![0.0; codes.len()];
        for (bar, &view) in model.code_bar.chunks_exact(CODE).zip(&batch.view) {
            got[CODE * view as usize..].iter_mut().zip(bar).for_each(|(sum, bar)| *sum += bar);
        }
        let want = differences(codes.len(), |i, h| {
            let mut moved = codes.clone();
            moved[i] += h;
            total(&model, &twin, &moved, &outcome)
        });
        assert_near("codes", &got, &want);
        // What the field learns from.
        for i in 0..n {
            let (_, bar) = model.loss(i, &pixels[i], truth[i]);
            for c in 0..3 {
                let loss = |by: f32| {
                    let mut moved = pixels[i];
                    moved.rgb[c] += by;
                    f64::from(model.loss(i, &moved, truth[i]).0)
                };
                let want = (loss(2e-3) - loss(-2e-3)) / 4e-3;
                // As far as the digits of the loss go.
                assert!((f64::from(bar.rgb[c]) - want).abs() < 2e-3 * (1.0 + want.abs()), "{bar:?} {want}");
            }
            let (_, coarse) = model.coarse_loss(i, pixels[i].rgb, truth[i]);
            let want = COARSE * (1.0 - model.layers[i].alpha) * 2.0 / 3.0 * (pixels[i].rgb[0] - truth[i][0]);
            assert!((coarse[0] - want).abs() < 1e-6);
        }
    }
}

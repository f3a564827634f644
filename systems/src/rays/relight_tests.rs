//! What renders in another light teach: the colour network what the method says, everything else nothing.

use super::RaySystem;
use super::budget_tests::{biased, randomised_with, table};
use crate::fields::fold_gradients;
use crate::method::{Codes, Method, Pixel, PixelBar, Relit, SecondLight};
use crate::space::SpaceKind;
use engine::data::{Patches, Shape};
use engine::system::System;
use std::sync::{Arc, Mutex};

/// Codes of three photos.
const CODES: [f32; 6] = [0.3, -0.8, 1.1, 0.2, -0.6, 0.9];

/// Colours in a photo's own light and in that of another.
type Shown = Arc<Mutex<[Vec<[f32; 3]>; 2]>>;

/// Says nothing about pixels; what is relit costs the sum of its numbers, each times another factor.
struct Says {
    asks: bool,
    shown: Shown,
}

fn factor(i: usize, c: usize) -> f32 {
    ((7 * i + 3 * c) % 11) as f32 / 5.0 - 1.0
}

fn cost(rgb: &[[f32; 3]]) -> f64 {
    rgb.iter().enumerate().map(|(i, rgb)| (0..3).map(|c| f64::from(rgb[c] * factor(i, c))).sum::<f64>()).sum()
}

impl Method for Says {
    fn name(&self) -> &'static str {
        "says"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        Some(Codes { dims: 2, rows: &CODES })
    }

    fn loss(&self, _: usize, _: &Pixel, _: [f32; 3]) -> (f32, PixelBar) {
        (0.0, PixelBar::default())
    }

    fn second_light(&self, _: u64) -> Option<SecondLight> {
        let patches = Patches { shape: Shape::Lattice, side: 5 };
        self.asks.then(|| SecondLight { patches, views: vec![2, 0] })
    }

    fn judge_second(&mut self, relit: &Relit<'_>) -> Vec<[f32; 3]> {
        assert!(relit.batch.len() == 50 && relit.light.views == [2, 0]);
        assert!(relit.batch.view.chunks(25).all(|views| views.iter().all(|view| *view == views[0])));
        *self.shown.lock().unwrap() = [relit.own.to_vec(), relit.other.to_vec()];
        (0..50).map(|i| [0, 1, 2].map(|c| factor(i, c))).collect()
    }
}

fn field(seed: u64, asks: bool) -> (RaySystem, Shown) {
    let shown = Shown::default();
    let mut config = biased(SpaceKind::Box, 1.0);
    (config.rates.weight_decay, config.terms.distortion) = (0.0, 0.0);
    (randomised_with(config, seed, Some(Box::new(Says { asks, shown: shown.clone() }))), shown)
}

#[test]
fn the_colour_network_learns_what_differences_say() {
    let (mut driver, shown) = field(4, true);
    let (_, data) = table();
    driver.relight(&data, 7).unwrap();
    let [own, other] = shown.lock().unwrap().clone();
    assert!(own.len() == 50 && other.len() == 50 && own != other, "another light looks the same");
    let mut grad = vec![0.0; driver.field.colour_params.len()];
    let parts = driver.work.relighting.chunks().map(|c| &c.colour_grad[..]);
    fold_gradients(driver.field.colour.mlp(), parts, &mut Vec::new(), &mut grad);
    let largest = grad.iter().fold(0.0, |m: f32, g| m.max(g.abs()));
    let h = 2e-3;
    for i in (0..grad.len()).step_by(37) {
        let mut at = |by: f32| {
            let before = driver.field.colour_params[i];
            driver.field.colour_params[i] += by;
            driver.field.pack();
            driver.relight(&data, 7).unwrap();
            driver.field.colour_params[i] = before;
            cost(&shown.lock().unwrap()[1])
        };
        let slope = (at(h) - at(-h)) / f64::from(2.0 * h);
        let off = (slope - f64::from(grad[i])).abs();
        assert!(off < 1e-2 * f64::from(largest), "parameter {i}: {slope}, gradient {} of at most {largest}", grad[i]);
    }
    assert!(largest > 0.1, "nothing is learnt: {largest}");
}

#[test]
fn density_and_what_it_is_computed_from_learn_exactly_nothing() {
    let (mut driver, _) = field(4, true);
    let (_, data) = table();
    let parts = |driver: &RaySystem| {
        let f = &driver.field;
        [f.features.parameters().to_vec(), f.density_params.clone(), f.colour_params.clone()]
    };
    let before = parts(&driver);
    for step in 0..3 {
        assert_eq!(driver.step(&data, step).unwrap().nonfinite, 0);
        for chunk in driver.work.relighting.chunks() {
            let all = [&chunk.density_grad, &chunk.head_grad, &chunk.features_bar, &chunk.appearance_bar];
            assert!(all.iter().all(|bars| bars.iter().all(|b| *b == 0.0)));
        }
    }
    let after = parts(&driver);
    assert!(before[0] == after[0] && before[1] == after[1], "density has learnt");
    assert!(before[2] != after[2], "the colour network has not");
}

#[test]
fn a_method_that_does_not_ask_pays_nothing() {
    let (mut driver, shown) = field(4, false);
    let (_, data) = table();
    let before = driver.field.colour_params.clone();
    driver.step(&data, 0).unwrap();
    assert!(shown.lock().unwrap()[1].is_empty() && driver.work.relighting.chunks().next().is_none());
    assert_eq!(driver.field.colour_params, before);
}

//! What second renders teach: the colour network what the photo model says, everything else nothing.

use super::budget_tests::{biased, randomised_with, table};
use super::driver::RaySystem;
use crate::fields::fold_gradients;
use crate::photo_model::{Codes, PhotoModel, Pixel, PixelBar, RenderedTwice, SecondRender};
use crate::space::SpaceKind;
use engine::data::{Patches, Shape};
use engine::system::System;
use std::sync::{Arc, Mutex};

/// Codes of three photos.
const CODES: [f32; 6] = [0.3, -0.8, 1.1, 0.2, -0.6, 0.9];

/// Colours with a photo's own code and with that of another.
type Rendered = Arc<Mutex<[Vec<[f32; 3]>; 2]>>;

/// Says nothing about pixels; a second render costs the sum of its numbers, each times another factor.
struct Says {
    asks: bool,
    rendered: Rendered,
}

fn factor(i: usize, c: usize) -> f32 {
    ((7 * i + 3 * c) % 11) as f32 / 5.0 - 1.0
}

fn cost(rgb: &[[f32; 3]]) -> f64 {
    rgb.iter().enumerate().map(|(i, rgb)| (0..3).map(|c| f64::from(rgb[c] * factor(i, c))).sum::<f64>()).sum()
}

impl PhotoModel for Says {
    fn name(&self) -> &'static str {
        "says"
    }

    fn appearance(&self) -> Option<Codes<'_>> {
        Some(Codes { dims: 2, rows: &CODES })
    }

    fn loss(&self, _: usize, _: &Pixel, _: [f32; 3]) -> (f32, PixelBar) {
        (0.0, PixelBar::default())
    }

    fn second_render(&self, _: u64) -> Option<SecondRender> {
        let patches = Patches { shape: Shape::Lattice, side: 5 };
        self.asks.then(|| SecondRender { patches, views: vec![2, 0] })
    }

    fn judge_second_render(&mut self, rendered: &RenderedTwice<'_>) -> Vec<[f32; 3]> {
        assert!(rendered.batch.len() == 50 && rendered.request.views == [2, 0]);
        assert!(rendered.batch.view.chunks(25).all(|views| views.iter().all(|view| *view == views[0])));
        *self.rendered.lock().unwrap() = [rendered.own.to_vec(), rendered.other.to_vec()];
        (0..50).map(|i| [0, 1, 2].map(|c| factor(i, c))).collect()
    }
}

fn field(seed: u64, asks: bool) -> (RaySystem, Rendered) {
    let rendered = Rendered::default();
    let mut config = biased(SpaceKind::Box, 1.0);
    (config.rates.weight_decay, config.terms.distortion) = (0.0, 0.0);
    (randomised_with(config, seed, Some(Box::new(Says { asks, rendered: rendered.clone() }))), rendered)
}

#[test]
fn the_colour_network_learns_what_differences_say() {
    let (mut driver, rendered) = field(4, true);
    let (_, data) = table();
    driver.render_twice(&data, 7).unwrap();
    let [own, other] = rendered.lock().unwrap().clone();
    assert!(own.len() == 50 && other.len() == 50 && own != other, "both codes give the same picture");
    let mut grad = vec![0.0; driver.field.colour_params.len()];
    let parts = driver.work.second_renders.chunks().map(|c| &c.colour_grad[..]);
    fold_gradients(driver.field.colour.mlp(), parts, &mut Vec::new(), &mut grad);
    let largest = grad.iter().fold(0.0, |m: f32, g| m.max(g.abs()));
    let h = 2e-3;
    for i in (0..grad.len()).step_by(37) {
        let mut at = |by: f32| {
            let before = driver.field.colour_params[i];
            driver.field.colour_params[i] += by;
            driver.field.pack();
            driver.render_twice(&data, 7).unwrap();
            driver.field.colour_params[i] = before;
            cost(&rendered.lock().unwrap()[1])
        };
        let difference = (at(h) - at(-h)) / f64::from(2.0 * h);
        let off = (difference - f64::from(grad[i])).abs();
        assert!(
            off < 1e-2 * f64::from(largest),
            "parameter {i}: {difference}, gradient {} of at most {largest}",
            grad[i]
        );
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
        for chunk in driver.work.second_renders.chunks() {
            let all = [&chunk.density_grad, &chunk.head_grad, &chunk.features_bar, &chunk.appearance_bar];
            assert!(all.iter().all(|bars| bars.iter().all(|b| *b == 0.0)));
        }
    }
    let after = parts(&driver);
    assert!(before[0] == after[0] && before[1] == after[1], "density has learnt");
    assert!(before[2] != after[2], "the colour network has not");
}

#[test]
fn a_photo_model_that_does_not_ask_pays_nothing() {
    let (mut driver, rendered) = field(4, false);
    let (_, data) = table();
    let before = driver.field.colour_params.clone();
    driver.step(&data, 0).unwrap();
    assert!(rendered.lock().unwrap()[1].is_empty() && driver.work.second_renders.chunks().next().is_none());
    assert_eq!(driver.field.colour_params, before);
}

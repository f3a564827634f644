//! The rates of a deformation, and what it costs to be bent, rise from its first step on.

use super::made::MadeSettings;
use super::tests::{busy, settings};
use super::*;
use engine::system::TensorMap;

#[test]
fn rates_rise_from_the_first_step_on() {
    let all = settings(TimeKind::Codes, Motion::Translation);
    for [began, warmup, done, risen] in [
        [0.0, 0.0, 0.0, 1.0],
        [0.0, 0.1, 0.025, 0.25],
        [0.0, 0.1, 1.0, 1.0],
        [0.5, 0.2, 0.6, 0.5],
        [0.5, 0.0, 0.6, 1.0],
    ] {
        let time = TimeSettings { rate: 0.5, warmup, ..all.time.clone() };
        let [mut saved, mut deform] = [(); 2].map(|()| busy(MadeSettings { time: time.clone(), ..all.clone() }));
        saved.begin(began);
        let state: TensorMap = saved.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
        deform.load_state(&state).unwrap();
        let numbers = |deform: &Deform| [deform.params[0], deform.params[deform.networks], deform.steps.rows[0]];
        let (before, mut grad) = (numbers(&deform), DeformGrad::default());
        grad.begin(&deform);
        (grad.params[0], grad.params[deform.networks], grad.times[0]) = (1.0, 1.0, 1.0);
        assert_eq!(deform.step([&grad].into_iter(), 0.1, done), 0);
        // The first step of Adam is as long as the rate.
        for (was, is) in before.iter().zip(numbers(&deform)) {
            assert!((f64::from(was - is) - 0.05 * risen).abs() < 1e-6, "{began}, {warmup}, {done}: {was} -> {is}");
        }
    }
}

#[test]
fn the_elastic_loss_rises_from_the_first_step_on() {
    let all = settings(TimeKind::Codes, Motion::Translation);
    for [began, elastic_rise, done, risen] in [
        [0.0, 0.0, 0.0, 1.0],
        [0.0, 0.4, 0.0, 0.0],
        [0.0, 0.4, 0.1, 0.25],
        [0.0, 0.4, 0.9, 1.0],
        [0.5, 0.5, 0.75, 0.5],
        [0.5, 0.0, 0.75, 1.0],
    ] {
        let elastic = ElasticSettings { elastic: 2.0, elastic_rise, ..ElasticSettings::NONE };
        let mut deform = busy(all.clone()).with_elastic(elastic).unwrap();
        deform.begin(began);
        let mut grad = DeformGrad::default();
        grad.begin(&deform);
        deform.step([&grad].into_iter(), 0.1, done);
        assert!((f64::from(deform.elastic_factor()) - 2.0 * risen).abs() < 1e-6, "{began}, {elastic_rise}, {done}");
    }
    let wrong = ElasticSettings { elastic_rise: f64::NAN, ..ElasticSettings::NONE };
    assert!(busy(all).with_elastic(wrong).err().unwrap().to_string().contains("elastic_rise"));
}

//! Scores of masks: identities, conventions, averages.

use losses::metrics::{Average, Confusion, EmptyClass, MetricError, segmentation};
use proptest::prelude::*;

fn any_masks() -> impl Strategy<Value = (Vec<u8>, Vec<u8>)> {
    let mask = || prop::collection::vec(prop_oneof![Just(0_u8), Just(1), Just(255)], 60);
    (mask(), mask())
}

fn swap(mask: &[u8]) -> Vec<u8> {
    mask.iter().map(|&m| u8::from(m == 0)).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(256))]

    #[test]
    fn scores_keep_their_identities((p, t) in any_masks()) {
        let counts = Confusion::of(&p, &t).unwrap();
        let all = counts.true_positive + counts.false_positive + counts.false_negative + counts.true_negative;
        prop_assert_eq!(all, 60);
        for empty in [EmptyClass::One, EmptyClass::Zero, EmptyClass::LeftOut] {
            let scores = counts.scores(empty);
            // One follows from the other.
            if let (Some(iou), Some(f1)) = (scores.iou_transient, scores.f1) {
                prop_assert!((iou - f1 / (2.0 - f1)).abs() < 1e-12);
            }
            // Prediction and truth are alike to them.
            prop_assert_eq!(Confusion::of(&t, &p).unwrap().scores(empty), scores);
            // With the classes exchanged, so are the intersections over unions.
            let other = Confusion::of(&swap(&p), &swap(&t)).unwrap().scores(empty);
            prop_assert_eq!((other.iou_static, other.iou_transient, other.miou), (scores.iou_transient, scores.iou_static, scores.miou));
            // Pooling one image changes nothing, and neither does averaging it.
            for average in [Average::PerImage, Average::Pooled] {
                prop_assert_eq!(segmentation(&[counts], average, empty), scores);
            }
            let perfect = Confusion::of(&t, &t).unwrap().scores(EmptyClass::One);
            prop_assert_eq!((perfect.miou, perfect.f1), (Some(1.0), Some(1.0)));
        }
    }

    #[test]
    fn scores_match_counting((p, t) in any_masks()) {
        let scores = Confusion::of(&p, &t).unwrap().scores(EmptyClass::LeftOut);
        let both = p.iter().zip(&t).filter(|(p, t)| **p == 0 && **t == 0).count() as f64;
        let either = p.iter().zip(&t).filter(|(p, t)| **p == 0 || **t == 0).count() as f64;
        prop_assert_eq!(scores.iou_transient, (either > 0.0).then_some(both / either));
    }
}

#[test]
fn empty_classes_count_as_asked() {
    let nothing = Confusion::of(&[1; 4], &[1; 4]).unwrap();
    let scores = |empty| nothing.scores(empty);
    assert_eq!((scores(EmptyClass::One).miou, scores(EmptyClass::One).f1), (Some(1.0), Some(1.0)));
    assert_eq!((scores(EmptyClass::Zero).miou, scores(EmptyClass::Zero).f1), (Some(0.5), Some(0.0)));
    assert_eq!((scores(EmptyClass::LeftOut).miou, scores(EmptyClass::LeftOut).f1), (Some(1.0), None));
    // Nothing there but something found: 0 by the formula, under every convention.
    let imagined = Confusion::of(&[1, 1, 1, 0], &[1; 4]).unwrap();
    for empty in [EmptyClass::One, EmptyClass::Zero, EmptyClass::LeftOut] {
        assert_eq!((imagined.scores(empty).iou_transient, imagined.scores(empty).f1), (Some(0.0), Some(0.0)));
    }
}

#[test]
fn averages_differ() {
    // A small occluder found half, and a photo without one.
    let found = Confusion { true_positive: 10, false_positive: 0, false_negative: 10, true_negative: 80 };
    let calm = Confusion { true_negative: 100, ..Confusion::default() };
    let f1 = |average, empty| segmentation(&[found, calm], average, empty).f1.unwrap();
    let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    near(f1(Average::Pooled, EmptyClass::One), 2.0 / 3.0);
    near(f1(Average::PerImage, EmptyClass::One), (2.0 / 3.0 + 1.0) / 2.0);
    near(f1(Average::PerImage, EmptyClass::Zero), 1.0 / 3.0);
    near(f1(Average::PerImage, EmptyClass::LeftOut), 2.0 / 3.0);
    let none = segmentation(&[], Average::PerImage, EmptyClass::One);
    assert_eq!((none.miou, none.f1), (None, None));
    assert_eq!(segmentation(&[], Average::Pooled, EmptyClass::One), none);
}

#[test]
fn lengths_have_to_agree() {
    let error = Confusion::of(&[0; 3], &[0; 4]);
    assert_eq!(error, Err(MetricError::Shape { what: "predicted mask", want: 4, got: 3 }));
}

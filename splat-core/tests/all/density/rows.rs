use super::{numbers, some};
use splat_core::density::{Fresh, Rows, ViewSpaceGradients};
use splat_core::{ProjectedGaussian, SplatError};

#[test]
fn keep_leaves_order_and_history() {
    let rows = Rows::keep(6, |i| i % 2 == 1).unwrap();
    assert_eq!((rows.before(), rows.len(), rows.from(), rows.fresh()), (6, 3, &[1, 3, 5][..], &[false; 3][..]));
    let x: Vec<f32> = (0..12).map(|i| i as f32).collect();
    for fresh in [Fresh::Copied, Fresh::Is(-1.0)] {
        assert_eq!(rows.apply("x", &x, 2, fresh).unwrap(), [1.0, 3.0, 5.0, 7.0, 9.0, 11.0]);
    }
    assert!(Rows::unchanged(4).unwrap().is_unchanged());
    assert!(!rows.is_unchanged());
}

#[test]
fn changes_one_after_the_other_are_their_join() {
    let g = some(40, 2);
    let keep = Rows::keep(40, |i| i % 3 != 0).unwrap();
    let again = Rows::keep(keep.len(), |i| i % 4 != 2).unwrap();
    let joined = keep.then(&again).unwrap();
    assert_eq!(joined.follow(&g).unwrap(), again.follow(&keep.follow(&g).unwrap()).unwrap());
    for (i, &from) in joined.from().iter().enumerate() {
        assert_eq!(numbers(&joined.follow(&g).unwrap(), i), numbers(&g, from as usize));
    }
    assert_eq!(again.then(&keep), Err(SplatError::Shape { what: "rows", want: again.len(), got: 40 }));
}

#[test]
fn arrays_of_the_wrong_length_are_refused_by_name() {
    let rows = Rows::keep(6, |_| true).unwrap();
    let refused = rows.apply("moments", &[0.0; 11], 2, Fresh::Copied);
    assert_eq!(refused, Err(SplatError::Shape { what: "moments", want: 12, got: 11 }));
    assert!(rows.follow(&some(5, 0)).is_err());
}

#[test]
fn fresh_rows_come_last_and_have_no_history() {
    let rows = Rows::and_fresh(2, 3).unwrap();
    assert_eq!(
        (rows.before(), rows.from(), rows.fresh()),
        (2, &[0, 1, 1, 1, 1][..], &[false, false, true, true, true][..])
    );
    assert_eq!(rows.apply("x", &[5.0, 6.0], 1, Fresh::Is(0.0)).unwrap(), [5.0, 6.0, 0.0, 0.0, 0.0]);
    assert!(Rows::and_fresh(4, 0).unwrap().is_unchanged() && Rows::and_fresh(0, 3).unwrap().is_empty());
    assert!(Rows::and_fresh(usize::MAX, 1).is_err());
}

#[test]
fn no_rows_are_legal() {
    let rows = Rows::unchanged(0).unwrap();
    assert!(rows.is_empty() && rows.is_unchanged());
    assert_eq!(rows.follow(&some(0, 3)).unwrap(), some(0, 3));
    assert!(rows.apply("x", &[], 5, Fresh::Is(0.0)).unwrap().is_empty());
}

fn gaussian(index: u32, half: [f32; 2]) -> ProjectedGaussian {
    ProjectedGaussian { index, half, ..ProjectedGaussian::default() }
}

#[test]
fn view_space_gradient_is_the_average_over_views_that_show_a_gaussian() {
    let mut statistics = ViewSpaceGradients::new(4);
    let seen = [gaussian(0, [3.0, 1.0]), gaussian(2, [1.0, 9.0])];
    // Half of 80 x 60: |(40 * 0.3, 30 * 0.3)| = 15 and |(0, 30)|.
    let bars = [[0.3, 0.3], [0.0, 1.0]];
    statistics.add(&seen, [80, 60], |k| bars[k]).unwrap();
    statistics.add(&seen[1..], [80, 60], |_| [0.0; 2]).unwrap();
    assert_eq!(statistics.mean(), [15.0, 0.0, 15.0, 0.0]);
    assert_eq!(statistics.views(), [1.0, 0.0, 2.0, 0.0]);
    assert_eq!(statistics.radius(), [3.0, 0.0, 9.0, 0.0]);
    let kept = Rows::keep(4, |i| i != 0).unwrap();
    assert_eq!(statistics.follow(&kept).unwrap().mean(), [0.0, 15.0, 0.0]);
}

#[test]
fn view_space_gradients_that_are_not_finite_or_of_no_gaussian_are_refused() {
    let mut statistics = ViewSpaceGradients::new(1);
    for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
        statistics.add(&[gaussian(0, [1.0; 2])], [80, 60], |_| [bad, 0.0]).unwrap();
    }
    assert_eq!(statistics, ViewSpaceGradients::new(1));
    let refused = statistics.add(&[gaussian(1, [1.0; 2])], [80, 60], |_| [1.0; 2]);
    assert_eq!(refused, Err(SplatError::Shape { what: "view_space_gradients", want: 2, got: 1 }));
}

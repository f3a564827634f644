use super::{STREAM, some, ten};
use float_core::rng::Rng;
use splat_core::density::{LOG_SCALE_MIN, LOGIT_MAX, keep_in_range, keep_strongest, without_non_finite};

#[test]
fn one_bad_number_of_any_field_drops_its_gaussian_and_no_other() {
    // More than one chunk.
    for n in [10, 9000] {
        let clean = some(n, 3);
        assert_eq!(without_non_finite(&clean).unwrap(), None);
        for field in 0..6 {
            for (bad, at) in [(f32::NAN, 0), (f32::INFINITY, n - 1), (f32::NEG_INFINITY, n / 2)] {
                let mut g = clean.clone();
                let rows = g.fields()[field].1.len() / n;
                g.fields_mut()[field].1[(rows - 1) * n + at] = bad;
                let left = without_non_finite(&g).unwrap().unwrap();
                let want: Vec<u32> = (0..n as u32).filter(|&i| i != at as u32).collect();
                assert_eq!(left.from(), want, "{bad} in field {field}");
                assert_eq!(without_non_finite(&left.follow(&g).unwrap()).unwrap(), None);
            }
        }
    }
}

#[test]
fn large_numbers_are_finite() {
    let mut g = some(5, 1);
    g.mean.fill(f32::MAX);
    g.rest.fill(f32::MIN);
    g.logit.fill(-0.0);
    g.dc.fill(1e-45);
    assert_eq!(without_non_finite(&g).unwrap(), None);
    assert_eq!(without_non_finite(&some(0, 0)).unwrap(), None);
}

#[test]
fn scales_and_logits_are_held() {
    let mut g = some(3, 0);
    g.log_scale.copy_from_slice(&[-30.0, 0.0, 30.0, -20.0, 1.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 2.99]);
    g.logit.copy_from_slice(&[-100.0, 0.5, 100.0]);
    let mean = g.mean.clone();
    keep_in_range(&mut g, 2.0).unwrap();
    let most = 20.0_f32.ln();
    assert_eq!(g.log_scale[..7], [LOG_SCALE_MIN, 0.0, most, -20.0, 1.0, most, LOG_SCALE_MIN]);
    assert!(g.log_scale[7].is_nan() && g.log_scale[8] == 2.99);
    assert_eq!(g.logit, [-LOGIT_MAX, 0.5, LOGIT_MAX]);
    assert_eq!(g.mean, mean);
    for extent in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(keep_in_range(&mut g, extent).unwrap_err().to_string().contains("`extent`"));
    }
    // A scene smaller than the smallest scale: no range to be in, and no panic.
    keep_in_range(&mut g, 1e-300).unwrap();
}

#[test]
fn the_strongest_stay_in_their_order() {
    let o = [0.5, 0.1, 0.9, 0.2, 0.7, 0.05, 0.3, 0.6, 0.8, 0.4];
    let g = ten(o, [1.0; 10]);
    assert_eq!(keep_strongest(&g, 3, STREAM).unwrap().from(), [2, 4, 8]);
    assert_eq!(keep_strongest(&g, 9, STREAM).unwrap().from(), [0, 1, 2, 3, 4, 6, 7, 8, 9]);
    assert_eq!(keep_strongest(&g, 1, STREAM).unwrap().from(), [2]);
    assert!(keep_strongest(&g, 0, STREAM).unwrap().is_empty());
    for max in [10, 11, usize::MAX] {
        assert!(keep_strongest(&g, max, STREAM).unwrap().is_unchanged());
    }
    let mut bad = g;
    bad.logit[2] = f32::NAN;
    assert_eq!(keep_strongest(&bad, 2, STREAM).unwrap().from(), [4, 8]);
}

#[test]
fn equal_opacities_are_thinned_everywhere_and_the_same_each_time() {
    let mut g = some(10_000, 0);
    g.logit.fill(-2.2);
    g.logit[3] = 0.0;
    g.logit[4] = -0.0;
    let kept = keep_strongest(&g, 1000, STREAM).unwrap();
    assert_eq!(kept.len(), 1000);
    assert!(kept.from().contains(&3) && kept.from().contains(&4));
    for tenth in 0..10 {
        let there = kept.from().iter().filter(|&&i| i / 1000 == tenth).count();
        assert!((50..150).contains(&there), "{there} of tenth {tenth}");
    }
    assert_eq!(kept, keep_strongest(&g, 1000, STREAM).unwrap());
    assert_ne!(kept, keep_strongest(&g, 1000, Rng::new(5, 7)).unwrap());
}

#[test]
fn rows_by_place_are_all_rows_and_neighbours_are_near() {
    use splat_core::density::morton_order;
    let n = 4096;
    let mut cloud = splat_core::Gaussians::new(n, 0).unwrap();
    let rng = float_core::rng::Rng::new(5, 0);
    rng.fill_uniform(0, &mut cloud.mean);
    let rows = morton_order(&cloud).unwrap();
    let mut seen: Vec<u32> = rows.from().to_vec();
    seen.sort_unstable();
    assert!(seen.iter().enumerate().all(|(i, &from)| i == from as usize) && !rows.fresh().contains(&true));
    let step = |cloud: &splat_core::Gaussians| {
        let far = |i: usize| (0..3).map(|a| (cloud.mean[a * n + i] - cloud.mean[a * n + i - 1]).powi(2)).sum::<f32>();
        (1..n).map(|i| far(i).sqrt()).sum::<f32>() / n as f32
    };
    let placed = rows.follow(&cloud).unwrap();
    assert!(step(&placed) < 0.2 * step(&cloud), "{} {}", step(&placed), step(&cloud));
    // Placed already: nothing moves. One place, none, and no place at all: their order.
    assert!(morton_order(&placed).unwrap().is_unchanged());
    assert!(morton_order(&splat_core::Gaussians::new(7, 0).unwrap()).unwrap().is_unchanged());
    assert!(morton_order(&splat_core::Gaussians::new(0, 0).unwrap()).unwrap().is_empty());
    let mut odd = splat_core::Gaussians::new(3, 0).unwrap();
    odd.mean = vec![f32::NAN, 3e38, -3e38, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(morton_order(&odd).unwrap().from(), [2, 1, 0]);
}

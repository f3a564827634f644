use super::*;

const CAMERA: Camera = Camera {
    r: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    t: [0.0; 3],
    f: [20.0, 22.0],
    c: [6.0, 5.0],
    size: [12, 10],
};
const RULES: Rules = Rules { near: 0.1, blur: 0.3, dims: true, alpha_min: 1.0 / 255.0, alpha_max: 0.99, stop: 1e-4 };
const N: usize = 5;

/// Five Gaussians of degree 1 before the camera.
fn parameters() -> Vec<f64> {
    let wave = |k: usize| ((k * k) as f64 * 0.37 + k as f64).sin();
    let row = |k: usize, x: f64| match k {
        0 | 1 => 0.3 * x,
        2 => 2.0 + 0.5 * x,
        3..6 => -2.0 + 0.5 * x,
        6..10 => x + 0.2,
        10 => x,
        _ => 0.4 * x,
    };
    (0..23 * N).map(|k| row(k / N, wave(k))).collect()
}

fn bar(at: [usize; 2]) -> [f64; 5] {
    core::array::from_fn(|k| ((at[0] * 7 + at[1] * 3 + k) as f64).cos())
}

fn loss(ellipses: &[Ellipse]) -> f64 {
    (0..120)
        .map(|i| {
            let at = [i % 12, i / 12];
            pixel(ellipses, at, &RULES).values.iter().zip(bar(at)).map(|(v, b)| v * b).sum::<f64>()
        })
        .sum()
}

#[test]
fn gradients_of_parameters_match_differences_of_pictures() {
    let p = parameters();
    let ellipses = project(&p, N, 1, &CAMERA, &RULES);
    assert_eq!(ellipses.len(), N);
    assert!(draw(&ellipses, CAMERA.size, &RULES).margin() > 1e-5, "no decision falls otherwise within the differences");
    let mut bars = vec![EllipseBar::default(); N];
    for i in 0..120 {
        let at = [i % 12, i / 12];
        pixel_backward(&ellipses, at, &RULES, bar(at), &mut bars);
    }
    let mut compared = 0;
    for (e, bar) in ellipses.iter().zip(&bars) {
        let own: Vec<f64> = (0..23).map(|k| p[k * N + e.index]).collect();
        let got = parameters_bar(&own, 1, &CAMERA, &RULES, bar);
        let scale = got.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for (k, got) in got.iter().enumerate() {
            let moved = |by: f64| {
                let mut p = p.clone();
                p[k * N + e.index] += by;
                loss(&project(&p, N, 1, &CAMERA, &RULES))
            };
            let want = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((got - want).abs() < 1e-6 * scale, "Gaussian {}, number {k}: {got}, differences {want}", e.index);
            compared += 1;
        }
    }
    assert_eq!(compared, 23 * N);
}

#[test]
fn one_gaussian_over_a_pixel_has_its_opacity() {
    // On the axis, through the centre of pixel (6, 5) of a camera whose principal point is there.
    let mut p = vec![0.0; 14];
    (p[2], p[6], p[10]) = (2.0, 1.0, 0.0);
    let camera = Camera { c: [6.5, 5.5], ..CAMERA };
    let got = pixel(&project(&p, 1, 0, &camera, &Rules { dims: false, ..RULES }), [6, 5], &RULES);
    // Grey of opacity one half, two units away.
    for (got, want) in got.values.into_iter().zip([0.25, 0.25, 0.25, 1.0, 0.5]) {
        assert!((got - want).abs() < 1e-12, "{got}, {want}");
    }
    assert_eq!(got.count, 1);
    p[2] = 0.05;
    assert!(project(&p, 1, 0, &camera, &RULES).is_empty(), "nearer than allowed");
}

#[test]
fn nearly_equal_depths_show_in_the_order() {
    let mut p = parameters();
    let before = pixel(&project(&p, N, 1, &CAMERA, &RULES), [6, 5], &RULES);
    assert!(before.count >= 2, "{before:?}");
    for i in 1..N {
        p[2 * N + i] = p[2 * N] + 1e-9 * i as f64;
    }
    let after = pixel(&project(&p, N, 1, &CAMERA, &RULES), [6, 5], &RULES);
    assert!(before.order > 1e-6 && after.order < 1e-8, "{} {}", before.order, after.order);
}

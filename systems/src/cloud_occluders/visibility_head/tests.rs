use super::*;

const SIDE: usize = 16;
const SETTINGS: VisibilitySettings =
    VisibilitySettings { judge_from: 0.0, visibility_weight: 0.15, visibility_left: 1.0 };
const HEAD: HeadSettings = HeadSettings { head_side: SIDE, head_lr: 1e-2 };
const SIZE: [usize; 2] = [20, 12];
const PIXELS: usize = SIZE[0] * SIZE[1];

fn head(horizon: u64) -> VisibilityHead {
    VisibilityHead::new(SETTINGS, HEAD, horizon, 3).unwrap()
}

fn numbers(stream: u64, n: usize) -> Vec<f32> {
    let mut out = vec![0.0; n];
    Rng::new(5, stream).fill_uniform(0, &mut out);
    out
}

/// Parameters that say something else at each place.
fn random(head: &mut VisibilityHead) {
    let n = head.params.values.len();
    let noise = numbers(7, n);
    head.params.values.iter_mut().zip(&noise[..]).for_each(|(p, x)| *p += 0.2 * (x - 0.5));
}

/// The loss of a map before the sigmoid, by its definition, in `f64`.
fn loss(logits: &[f64], beside: &Beside<'_>) -> f64 {
    let side = (logits.len() as f64).sqrt() as usize;
    let map: Vec<f64> = logits.iter().map(|x| 1.0 / (1.0 + (-x).exp())).collect();
    let share = |i: usize, at: f64| (1.0 - (at - i as f64).abs()).max(0.0);
    let (mut sum, mut count) = (0.0, 0.0);
    for i in 0..PIXELS {
        if beside.before.is_some_and(|before| before[i] == 0.0) {
            continue;
        }
        let place =
            |at: usize, n: usize| ((at as f64 + 0.5) * side as f64 / n as f64 - 0.5).clamp(0.0, side as f64 - 1.0);
        let (x, y) = (place(i % SIZE[0], SIZE[0]), place(i / SIZE[0], SIZE[1]));
        let v: f64 = (0..side * side).map(|k| map[k] * share(k % side, x) * share(k / side, y)).sum();
        let error = |c: usize| f64::from(beside.render[c * PIXELS + i] - beside.photo[c * PIXELS + i]).abs();
        let residual = (error(0) + error(1) + error(2)) / 3.0;
        sum += 0.8 * residual * v + 0.15 * (1.0 - v).powi(2);
        count += 1.0;
    }
    sum / count
}

#[test]
fn the_gradient_of_the_map_is_that_of_the_definition() {
    let (render, photo) = (numbers(1, 3 * PIXELS), numbers(2, 3 * PIXELS));
    let mut before = vec![1.0; PIXELS];
    before[..33].fill(0.0);
    for before in [None, Some(&before[..])] {
        let beside = Beside { view: 0, size: SIZE, render: &render, photo: &photo, before };
        let mut head = head(100);
        random(&mut head);
        let seen = head.see(&beside, &mut MapMemory::default()).unwrap();
        let bar = VisibilityHead::map_bar(0.15, &seen, &beside);
        let logits: Vec<f64> = seen.map.iter().map(|v| f64::from(*v)).map(|v| (v / (1.0 - v)).ln()).collect();
        let largest = bar.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
        assert!(largest > 1e-5);
        for (i, got) in bar.iter().enumerate() {
            let at = |h: f64| {
                let mut moved = logits.clone();
                moved[i] += h;
                loss(&moved, &beside)
            };
            let want = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((f64::from(*got) - want).abs() < 1e-3 * f64::from(largest), "{i}: {got} {want}");
        }
        // Along it all parameters together lower the loss as much as it says.
        let (_, gradient) = {
            head.weights(0, &beside).unwrap();
            head.held.take().unwrap()
        };
        let start = head.params.values.clone();
        let square: f64 = gradient.iter().map(|x| f64::from(*x).powi(2)).sum();
        let mut after = |h: f64| {
            let moved = start.iter().zip(&gradient).map(|(p, g)| p + (h * f64::from(*g)) as f32).collect();
            head.params.values = moved;
            let seen = head.see(&beside, &mut MapMemory::default()).unwrap();
            let logits: Vec<f64> = seen.map.iter().map(|v| f64::from(*v)).map(|v| (v / (1.0 - v)).ln()).collect();
            loss(&logits, &beside)
        };
        let h = 1e-3 / square.sqrt();
        let want = (after(h) - after(-h)) / (2.0 * h);
        assert!((want - square).abs() < 0.02 * square, "{want} {square}");
    }
}

/// With the same residual everywhere the network comes to say what costs least: `1 - r / 0.375`.
#[test]
fn what_it_says_in_the_end_is_the_closed_form() {
    for (residual, want) in [(0.0, 1.0), (0.1, 1.0 - 0.1 / 0.375), (0.25, 1.0 / 3.0), (0.6, 0.0)] {
        let render: Vec<f32> = numbers(1, 3 * PIXELS).iter().map(|x| 0.3 * x).collect();
        let photo: Vec<f32> = render.iter().map(|x| x + residual).collect();
        let beside = Beside { view: 0, size: SIZE, render: &render, photo: &photo, before: None };
        // Fast steps would carry the sigmoid to an end, from which its slope does not bring it back.
        let slow = HeadSettings { head_lr: 1e-3, ..HEAD };
        let mut head = VisibilityHead::new(SETTINGS, slow, 10_000, 3).unwrap();
        let first = head.weights(0, &beside).unwrap();
        assert!(first.iter().all(|v| (v - AT_START).abs() < 1e-5), "{}", first[0]);
        for step in 0..1000 {
            head.weights(step, &beside);
            assert_eq!(head.learn(Simd::best()), 0);
        }
        let last = head.weights(1000, &beside).unwrap();
        let worst = last.iter().map(|v| (v - want).abs()).fold(0.0, f32::max);
        assert!(worst < 0.06, "{residual}: off by {worst}");
    }
}

/// A photo with a red square that its render has not, and one that is as its render.
#[test]
fn what_looks_like_things_that_stay_far_from_their_renders_does_not_count() {
    let render: Vec<f32> = numbers(1, 3 * PIXELS).iter().map(|x| 0.4 + 0.2 * x).collect();
    let is_red = |i: usize| (4..10).contains(&(i % SIZE[0])) && (3..9).contains(&(i / SIZE[0] % SIZE[1]));
    let red: Vec<f32> = (0..3 * PIXELS)
        .map(|i| match is_red(i) {
            true if i < PIXELS => 1.0,
            true => 0.0,
            false => render[i],
        })
        .collect();
    let [with, without] =
        [&red, &render].map(|photo| Beside { view: 0, size: SIZE, render: &render, photo, before: None });
    let mut head = head(2_000);
    for step in 0..300 {
        head.weights(step, if step % 2 == 0 { &with } else { &without });
        head.learn(Simd::best());
    }
    let shown = head.static_pixels(&with);
    let wrong = shown.iter().enumerate().filter(|(i, shown)| (**shown == 0.0) != is_red(*i)).count();
    assert!(wrong < PIXELS / 10, "{wrong} of {PIXELS}");
    assert!(head.static_pixels(&without).iter().all(|shown| *shown == 1.0));
}

#[test]
fn before_its_time_it_says_nothing_and_what_is_not_learnt_changes_nothing() {
    let (render, photo) = (numbers(1, 3 * PIXELS), numbers(2, 3 * PIXELS));
    let beside = Beside { view: 0, size: SIZE, render: &render, photo: &photo, before: None };
    let settings = VisibilitySettings { judge_from: 0.5, ..SETTINGS };
    let mut head = VisibilityHead::new(settings, HEAD, 100, 3).unwrap();
    assert!(head.weights(49, &beside).is_none());
    assert_eq!(head.learn(Simd::best()), 0);
    for step in 50..55 {
        head.weights(step, &beside).unwrap();
        head.learn(Simd::best());
    }
    head.weights(90, &beside).unwrap();
    let state: TensorMap = head.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
    let mut other = VisibilityHead::new(settings, HEAD, 100, 3).unwrap();
    other.load(&state).unwrap();
    assert_eq!(other.weights(55, &beside), head.weights(55, &beside));
    head.learn(Simd::best());
    other.learn(Simd::best());
    assert_eq!(other.state(), head.state());
    assert!(other.load(&TensorMap::default()).is_err());
    assert!(head.parameter_count() > 0 && head.bytes() > 0);
}

#[test]
fn photos_without_pixels_and_without_numbers_do_no_harm_and_what_cannot_work_is_refused() {
    let mut head = head(0);
    let nothing = Beside { view: 0, size: [0, 4], render: &[], photo: &[], before: None };
    assert!(head.weights(0, &nothing).is_none() && head.static_pixels(&nothing).is_empty());
    let (nan, one) = (vec![f32::NAN; 3 * PIXELS], vec![1.0; 3 * PIXELS]);
    for (render, photo) in [(&nan, &one), (&one, &nan)] {
        let beside = Beside { view: 0, size: SIZE, render, photo, before: None };
        let said = head.weights(1, &beside).unwrap();
        head.learn(Simd::best());
        assert!(said.iter().all(|v| (0.0..=1.0).contains(v)));
        assert!(head.params.values.iter().all(|x| x.is_finite()));
    }
    let none = vec![0.0; PIXELS];
    let beside = Beside { view: 0, size: SIZE, render: &one, photo: &one, before: Some(&none) };
    assert!(head.weights(2, &beside).is_some());
    let params = head.params.values.clone();
    head.learn(Simd::best());
    assert!(head.params.values.iter().zip(params).all(|(a, b)| (a - b).abs() < 0.02));
    assert!(HEAD.check().is_ok());
    for (bad, name) in [
        (HeadSettings { head_side: 20, ..HEAD }, "head_side"),
        (HeadSettings { head_lr: 0.0, ..HEAD }, "head_lr"),
        (HeadSettings { head_lr: 0.2, ..HEAD }, "head_lr"),
    ] {
        assert!(bad.check().unwrap_err().to_string().contains(name), "{bad:?}");
    }
}

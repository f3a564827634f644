use super::*;
use field_core::rng::Rng;
use render_core::ray_distance::RaySpacing;

/// Two pixels of two rays: rays of two, no, three and one sample; the second pixel counts half.
struct Made {
    t: Vec<f32>,
    dt: Vec<f32>,
    tau: Vec<f32>,
    w: Vec<f32>,
    rgb: Vec<f32>,
    trans_end: Vec<f32>,
    moving: Vec<f32>,
}

const OFFSETS: [u32; 5] = [0, 2, 2, 5, 6];
const WEIGHT: [f32; 2] = [1.0, 0.5];
const N: usize = 6;

impl Made {
    fn new() -> Self {
        let uniform = |stream, n| {
            let mut out = vec![0.0; n];
            Rng::new(7, stream).fill_uniform(0, &mut out);
            out.iter_mut().for_each(|u| *u = 0.05 + 0.3 * *u);
            out
        };
        Self {
            t: vec![1.0, 1.4, 0.9, 1.5, 2.5, 1.1],
            dt: vec![0.2, 0.4, 0.3, 0.5, 0.7, 0.1],
            tau: uniform(1, N),
            w: uniform(2, N),
            rgb: uniform(3, 3 * N),
            trans_end: uniform(4, 4),
            moving: vec![0.3, 0.9, 0.0, 0.5, 0.1, 0.7],
        }
    }

    fn rays<'a>(&'a self, weight: &'a [f32]) -> TileRays<'a> {
        TileRays {
            offsets: &OFFSETS,
            t: &self.t,
            dt: &self.dt,
            lead: 0.5,
            tau: &self.tau,
            w: &self.w,
            rgb: &self.rgb,
            trans_end: &self.trans_end,
            moving: &self.moving,
            per_pixel: 2,
            weight,
            truth: &[[0.1, 0.5, 0.9], [0.3, 0.2, 0.7]],
            view: &[0, 1],
            place: &[[0, 0], [2, 1]],
            share: 0.25,
        }
    }

    fn cost(&self, term: &dyn RayTerm) -> f64 {
        let (mut bars, mut loss) = (RayBars::default(), 0.0);
        bars.begin(4, N);
        term.add(&self.rays(&WEIGHT), &mut bars, &mut loss);
        loss
    }
}

fn terms() -> Vec<Box<dyn RayTerm>> {
    let config = TermConfig { distortion: 0.7, sparsity: 0.4, background_entropy: 0.3, point_colour: 0.2 };
    let mut terms = config.terms(RayDistance::new(RaySpacing::Linear, 0.5, 4.0).unwrap());
    terms.push(Box::new(MovingShare { share: 0.6, entropy: 0.8 }));
    terms
}

/// The gradient of what each term reads, `None` for what it does not.
fn bars_of(made: &Made, term: &dyn RayTerm, weight: &[f32]) -> [Option<Vec<f32>>; 5] {
    let (mut bars, mut loss) = (RayBars::default(), 0.0);
    bars.begin(4, N);
    term.add(&made.rays(weight), &mut bars, &mut loss);
    [&bars.w, &bars.trans_end, &bars.rgb, &bars.sigma, &bars.moving].map(|bar| bar.get().map(<[f32]>::to_vec))
}

#[test]
fn gradients_are_those_of_differences_component_by_component() {
    let made = Made::new();
    let mut seen = [0; 5];
    for term in terms() {
        for (k, bar) in bars_of(&made, term.as_ref(), &WEIGHT).into_iter().enumerate() {
            let Some(bar) = bar else { continue };
            seen[k] += 1;
            for (i, &got) in bar.iter().enumerate() {
                let at = |step: f32| {
                    let mut made = Made::new();
                    match k {
                        0 => made.w[i] += step,
                        1 => made.trans_end[i] += step,
                        2 => made.rgb[i] += step,
                        // The density is tau / dt.
                        3 => made.tau[i] += step * made.dt[i],
                        // What does not move at all stays so: it has no moving part.
                        _ if made.moving[i] == 0.0 => {}
                        _ => made.moving[i] += step,
                    }
                    made.cost(term.as_ref())
                };
                let h = 2e-3;
                let want = 0.25 * (at(h) - at(-h)) / (2.0 * f64::from(h));
                let error = (f64::from(got) - want).abs();
                // Colours of samples have no gradient with respect to weights, as published.
                assert!(error < 1e-4 * want.abs().max(0.1), "gradient {k} at {i}: {got} for {want}");
            }
        }
    }
    assert_eq!(seen, [1; 5]);
}

#[test]
fn pixels_that_do_not_count_have_no_gradient_and_gradients_add_up() {
    let made = Made::new();
    for term in [&BackgroundEntropy { factor: 0.3 } as &dyn RayTerm, &PointColour { factor: 0.2 }] {
        for bar in bars_of(&made, term, &[0.0, 0.0]).into_iter().flatten() {
            assert!(bar.iter().all(|g| *g == 0.0), "{bar:?}");
        }
    }
    let (mut bars, mut loss) = (RayBars::default(), 0.0);
    bars.begin(4, N);
    for term in terms().iter().chain(&terms()) {
        term.add(&made.rays(&WEIGHT), &mut bars, &mut loss);
    }
    let single: Vec<_> = terms().iter().map(|term| bars_of(&made, term.as_ref(), &WEIGHT)).collect();
    let twice = |k: usize| single.iter().find_map(|bars| bars[k].clone()).unwrap();
    for (k, bar) in [&bars.w, &bars.trans_end, &bars.rgb, &bars.sigma, &bars.moving].into_iter().enumerate() {
        for (got, want) in bar.get().unwrap().iter().zip(twice(k)) {
            assert!((got - 2.0 * want).abs() <= 1e-6 * want.abs().max(1e-3), "{k}: {got} and twice {want}");
        }
    }
}

#[test]
fn no_rays_cost_nothing() {
    let none = TileRays {
        offsets: &[0],
        t: &[],
        dt: &[],
        lead: 0.0,
        tau: &[],
        w: &[],
        rgb: &[],
        trans_end: &[],
        moving: &[],
        per_pixel: 1,
        weight: &[],
        truth: &[],
        view: &[],
        place: &[],
        share: 1.0,
    };
    for term in terms() {
        let (mut bars, mut loss) = (RayBars::default(), 0.0);
        bars.begin(0, 0);
        term.add(&none, &mut bars, &mut loss);
        assert_eq!(loss, 0.0);
    }
}

use super::*;
use crate::views::planes::{COLOUR, PlaneLayout};
use field_core::rng::Rng;
use float_core::Simd;

const SIZE: [usize; 2] = [7, 5];
const PIXELS: usize = 35;

/// Planes of a picture, the photo, weights with some 0.
struct Made {
    colour: Vec<f32>,
    depth: Vec<f32>,
    transmittance: Vec<f32>,
    photo: Vec<f32>,
    weights: Vec<f32>,
}

impl Made {
    fn new() -> Self {
        let uniform = |stream, n| {
            let mut out = vec![0.0; n];
            Rng::new(7, stream).fill_uniform(0, &mut out);
            out
        };
        let transmittance: Vec<f32> = uniform(1, PIXELS).iter().map(|u| 0.1 + 0.8 * u).collect();
        let colour = uniform(3, COLOUR * PIXELS);
        // Apart by more than a difference's step: the loss has an edge where they agree.
        let apart = uniform(4, COLOUR * PIXELS).into_iter().enumerate();
        let apart = apart.map(|(i, u)| if i % 2 == 0 { 0.05 + 0.3 * u } else { -0.05 - 0.3 * u });
        Self {
            photo: colour.iter().zip(apart).map(|(c, apart)| c + apart).collect(),
            depth: uniform(2, PIXELS)
                .iter()
                .zip(&transmittance)
                .map(|(u, t)| (1.0 - t) * apart_from_measured(*u))
                .collect(),
            colour,
            weights: (0..PIXELS).map(|i| [1.0, 0.0, 0.5, 2.0][i * 7 % 4]).collect(),
            transmittance,
        }
    }

    /// The cost of a term, and its gradients with respect to colour, depth and transmittance.
    fn run(&self, term: &mut dyn PictureTerm, weights: Option<&[f32]>) -> (f64, [Vec<f32>; 3]) {
        let picture = RenderedPicture {
            size: SIZE,
            colour: &self.colour,
            depth: Some(&self.depth),
            extras: &[],
            plain: None,
            transmittance: &self.transmittance,
        };
        let target = TargetPicture { view: 0, colour: &self.photo, weights };
        let (mut bars, mut loss) = (PlaneBars::default(), 0.0);
        bars.begin(PIXELS, 4, PlaneLayout { depth: true, extras: 0, plain: false });
        term.add(&picture, &target, &mut bars, &mut loss).unwrap();
        (loss, [bars.colour().to_vec(), bars.depth().to_vec(), bars.transmittance().to_vec()])
    }
}

const MEASURED: [f32; 6] = [1.7, 2.2, 0.0, 2.6, f32::NAN, 1.2];

/// A depth in 1..3.1, apart from what was measured by more than a difference's step.
fn apart_from_measured(u: f32) -> f32 {
    let z = 1.0 + 2.0 * u;
    if MEASURED.iter().any(|m| (z - m).abs() < 0.05) { z + 0.1 } else { z }
}

fn depth_term() -> DepthTerm {
    DepthTerm { factor: 0.8, maps: vec![Some(DepthMap { size: [3, 2], z: MEASURED.to_vec() })] }
}

/// What is known of how near things are, but of some pixels.
fn shape_term(factor: f32) -> DepthShapeTerm {
    let values = (0..PIXELS).map(|i| if i % 9 == 0 { f32::NAN } else { (i * 5 % 13) as f32 }).collect();
    DepthShapeTerm::new(factor, vec![Some(Nearness { size: SIZE, values })])
}

fn terms() -> [Box<dyn PictureTerm>; 2] {
    [Box::new(L1Dssim::new(Simd::best(), &L1DssimConfig { dssim: 0.3 })), Box::new(depth_term())]
}

#[test]
fn gradients_are_those_of_differences_plane_by_plane() {
    let made = Made::new();
    for weights in [None, Some(&made.weights[..])] {
        for (k, term) in terms().iter_mut().enumerate() {
            let (_, bars) = made.run(&mut **term, weights);
            let largest = bars.iter().flatten().fold(0.0_f32, |most, g| most.max(g.abs()));
            assert!(largest > 1e-4);
            for (plane, bar) in bars.iter().enumerate() {
                for (i, &got) in bar.iter().enumerate() {
                    let mut along = |step: f32| {
                        let mut made = Made::new();
                        [&mut made.colour, &mut made.depth, &mut made.transmittance][plane][i] += step;
                        made.run(&mut **term, weights).0
                    };
                    let h = 2e-3;
                    let want = (along(h) - along(-h)) / (2.0 * f64::from(h));
                    let error = (f64::from(got) - want).abs();
                    assert!(error < 0.01 * f64::from(largest), "term {k}, plane {plane}, {i}: {got} for {want}");
                }
            }
        }
    }
}

#[test]
fn pixels_of_weight_zero_and_of_unknown_depth_cost_nothing() {
    let made = Made::new();
    let (loss, [_, depth, transmittance]) = made.run(&mut depth_term(), Some(&[0.0; PIXELS]));
    assert!(loss == 0.0 && depth.iter().chain(&transmittance).all(|g| *g == 0.0));
    // Columns 2..5 of the upper rows show the second entry of the map, columns 5.. its third, which is not known.
    let (_, [_, depth, _]) = made.run(&mut depth_term(), None);
    assert!(depth[3] != 0.0 && depth[6] == 0.0 && depth[4 * 7 + 3] == 0.0, "{depth:?}");
    let mut without = DepthTerm { factor: 1.0, maps: vec![None] };
    assert_eq!(made.run(&mut without, None).0, 0.0);
    assert!(without.reads_depth() && !terms()[0].reads_depth());
}

#[test]
fn a_pixel_that_shows_nothing_has_no_depth() {
    let mut made = Made::new();
    made.transmittance.fill(1.0);
    made.depth.fill(0.0);
    let (loss, [_, depth, transmittance]) = made.run(&mut depth_term(), None);
    assert!(loss == 0.0 && depth.iter().chain(&transmittance).all(|g| *g == 0.0));
}

#[test]
fn shares_that_are_none_are_refused() {
    for dssim in [-0.1, 1.1, f32::NAN] {
        let error = L1DssimConfig { dssim }.check().unwrap_err().to_string();
        assert!(error.contains("dssim"), "{error}");
    }
    assert!(L1DssimConfig { dssim: 1.0 }.check().is_ok());
}

/// A wide picture whose pixels all show something.
fn wide_picture(known: &[f32], weights: Option<&[f32]>, depth: &[f32], transmittance: &[f32]) -> (f64, [Vec<f32>; 2]) {
    const WIDE: [usize; 2] = [12, 8];
    let (colour, mut bars, mut loss) = (vec![0.0; 3 * 96], PlaneBars::default(), 0.0);
    let picture =
        RenderedPicture { size: WIDE, colour: &colour, depth: Some(depth), extras: &[], plain: None, transmittance };
    let target = TargetPicture { view: 0, colour: &colour, weights };
    bars.begin(96, 4, PlaneLayout { depth: true, extras: 0, plain: false });
    let mut term = DepthShapeTerm::new(0.05, vec![Some(Nearness { size: WIDE, values: known.to_vec() })]);
    assert!(term.reads_depth() && term.bytes() == 4 * 96);
    term.add(&picture, &target, &mut bars, &mut loss).unwrap();
    (loss, [bars.depth().to_vec(), bars.transmittance().to_vec()])
}

#[test]
fn shapes_of_depth_have_the_gradient_of_differences_and_leave_out_what_does_not_count() {
    let uniform = |stream| {
        let mut out = vec![0.0; 96];
        Rng::new(8, stream).fill_uniform(0, &mut out);
        out
    };
    let transmittance: Vec<f32> = uniform(1).iter().map(|u| 0.4 * u).collect();
    let depth: Vec<f32> = uniform(2).iter().zip(&transmittance).map(|(u, t)| (1.0 - t) * (1.0 + u)).collect();
    let mut known = uniform(3);
    (known[3], known[40]) = (f32::NAN, f32::INFINITY);
    let weights: Vec<f32> = (0..96).map(|i| if i % 11 == 0 { 0.4 } else { 1.0 }).collect();
    let (loss, bars) = wide_picture(&known, Some(&weights), &depth, &transmittance);
    assert!(loss > 0.02 && loss < 0.08, "{loss}");
    let largest = bars.iter().flatten().fold(0.0_f32, |most, g| most.max(g.abs()));
    for (plane, bar) in bars.iter().enumerate() {
        assert!([0, 11, 3, 40].iter().all(|i| bar[*i] == 0.0), "what does not count, and what is not known");
        for (i, got) in bar.iter().enumerate() {
            let along = |step: f32| {
                let mut at = [depth.clone(), transmittance.clone()];
                at[plane][i] += step;
                wide_picture(&known, Some(&weights), &at[0], &at[1]).0
            };
            let want = (along(1e-3) - along(-1e-3)) / 2e-3;
            assert!((f64::from(*got) - want).abs() < 0.01 * f64::from(largest), "plane {plane}, {i}: {got} for {want}");
        }
    }
    // The nearness of the picture itself has its shape.
    let near: Vec<f32> = depth.iter().zip(&transmittance).map(|(d, t)| 3.0 * (1.0 - t) / d - 7.0).collect();
    assert!(wide_picture(&near, None, &depth, &transmittance).0 < 1e-8);
}

#[test]
fn few_pixels_flat_depth_and_nothing_have_no_shape() {
    let made = Made::new();
    let nothing = |(loss, bars): (f64, [Vec<f32>; 3])| loss == 0.0 && bars.iter().flatten().all(|g| *g == 0.0);
    assert!(nothing(made.run(&mut shape_term(1.0), None)), "fewer pixels than have a shape");
    assert!(nothing(made.run(&mut DepthShapeTerm::new(1.0, vec![None]), None)));
    assert!(nothing(made.run(&mut DepthShapeTerm::new(1.0, Vec::new()), None)));
    let (flat, ramp): (Vec<f32>, Vec<f32>) = (vec![0.9; 96], (0..96).map(|i| i as f32).collect());
    for (known, depth, transmittance) in
        [(&flat, &ramp, vec![0.1; 96]), (&ramp, &flat, vec![0.1; 96]), (&ramp, &ramp, vec![1.0; 96])]
    {
        let (loss, bars) = wide_picture(known, None, depth, &transmittance);
        assert!(loss == 0.0 && bars.iter().flatten().all(|g| *g == 0.0));
    }
    assert_eq!(wide_picture(&ramp, Some(&[0.0; 96]), &ramp, &[0.1; 96]).0, 0.0);
}

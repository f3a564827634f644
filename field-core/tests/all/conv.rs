//! Convolutions, pooling and resampling against loops written from their definitions, and their properties.

use crate::conv_twin::Layer;
use field_core::FieldError;
use field_core::conv::{
    Conv2d, Extent, Padding, Size, Workspace, adaptive_mean, adaptive_mean_backward, global_mean, global_mean_backward,
    max_pool, max_pool_backward, max_pool_size, relu, relu_backward, resize, resize_backward,
};
use float_core::Simd;
use proptest::prelude::*;
use testkit::gradient::{PairTolerances, Tolerance, check_f32_pair, check_kinked, check_pair, compare, cotangent};

fn noise(n: usize, seed: u64) -> Vec<f32> {
    cotangent(n, seed).iter().map(|&x| x as f32).collect()
}

fn wide(x: &[f32]) -> Vec<f64> {
    x.iter().map(|&x| x.into()).collect()
}

fn conv(l: Layer) -> Conv2d {
    Conv2d::new(l.inputs, l.outputs, l.kernel, l.stride, l.padding).unwrap()
}

/// Every kind of layer: kernels with and without a centre, strides that skip pixels, both borders, more channels than a vector.
const LAYERS: [Layer; 8] = [
    Layer { inputs: 1, outputs: 1, kernel: 1, stride: 1, padding: Padding::Zero(0) },
    Layer { inputs: 3, outputs: 5, kernel: 7, stride: 1, padding: Padding::Reflect(3) },
    Layer { inputs: 5, outputs: 4, kernel: 4, stride: 2, padding: Padding::Reflect(1) },
    Layer { inputs: 2, outputs: 3, kernel: 3, stride: 1, padding: Padding::Zero(1) },
    Layer { inputs: 2, outputs: 17, kernel: 3, stride: 2, padding: Padding::Zero(2) },
    Layer { inputs: 18, outputs: 2, kernel: 2, stride: 3, padding: Padding::Reflect(2) },
    Layer { inputs: 1, outputs: 2, kernel: 5, stride: 4, padding: Padding::Zero(0) },
    Layer { inputs: 4, outputs: 4, kernel: 2, stride: 5, padding: Padding::Zero(3) },
];

const SIZES: [Size; 4] = [
    Size { images: 1, height: 5, width: 5 },
    Size { images: 2, height: 9, width: 6 },
    Size { images: 1, height: 7, width: 40 },
    Size { images: 3, height: 5, width: 11 },
];

#[test]
fn convolutions_match_the_definition_and_its_gradient_at_every_level() {
    for simd in Simd::available() {
        let mut work = Workspace::default();
        for layer in LAYERS {
            for size in SIZES {
                let conv = conv(layer);
                let to = conv.output_size(size).unwrap();
                assert_eq!(to, layer.output(size));
                assert_eq!(conv.param_count(), layer.params());
                let (params, x) = (noise(layer.params(), 1), noise(size.len(layer.inputs), 2));
                let mut y = vec![f32::NAN; to.len(layer.outputs)];
                conv.forward(simd, &params, &x, size, &mut y, &mut work).unwrap();
                let (params_twin, x_twin) = (wide(&params), wide(&x));
                let want = layer.forward(&params_twin, &x_twin, size);
                let what = format!("{layer:?} {size:?} {:?}", simd.level());
                compare("y", &y, &want, Tolerance::new(2e-6, 0.0)).unwrap_or_else(|e| panic!("{what}: {e}"));

                let y_bar = noise(y.len(), 3);
                // Added to what is there.
                let (mut params_bar, mut x_bar) = (vec![0.5; params.len()], vec![0.25; x.len()]);
                let grads = (&mut params_bar[..], Some(&mut x_bar[..]));
                conv.backward(simd, &params, &x, size, &y_bar, grads.0, grads.1, &mut work).unwrap();
                let (mut want_params, mut want_x) = (vec![0.5; params.len()], vec![0.25; x.len()]);
                layer.backward(&params_twin, &x_twin, size, &wide(&y_bar), &mut want_params, &mut want_x);
                let close = Tolerance::new(4e-6, 0.0);
                compare("params_bar", &params_bar, &want_params, close).unwrap_or_else(|e| panic!("{what}: {e}"));
                compare("x_bar", &x_bar, &want_x, close).unwrap_or_else(|e| panic!("{what}: {e}"));
                // The gradient of the images costs nothing where nobody wants it, and changes nothing.
                let mut alone = vec![0.5; params.len()];
                conv.backward(simd, &params, &x, size, &y_bar, &mut alone, None, &mut work).unwrap();
                assert_eq!(alone, params_bar);
            }
        }
    }
}

#[test]
fn the_gradient_of_the_definition_matches_central_differences() {
    for layer in LAYERS {
        let size = Size { images: 2, height: 6, width: 5 };
        let (params, x) = (cotangent(layer.params(), 1), cotangent(size.len(layer.inputs), 2));
        let y_bar = cotangent(layer.output(size).len(layer.outputs), 3);
        let split = params.len();
        let all = [params, x].concat();
        let forward =
            |all: &[f64], y: &mut [f64]| y.copy_from_slice(&layer.forward(&all[..split], &all[split..], size));
        let backward = |all: &[f64], y_bar: &[f64], all_bar: &mut [f64]| {
            let (params_bar, x_bar) = all_bar.split_at_mut(split);
            layer.backward(&all[..split], &all[split..], size, y_bar, params_bar, x_bar);
        };
        check_pair(&all, &y_bar, forward, backward, Tolerance::new(1e-7, 1e-7))
            .unwrap_or_else(|e| panic!("{layer:?}: {e}"));
    }
}

proptest! {
    #![proptest_config(testkit::property::cases(48))]

    #[test]
    fn any_layer_matches_the_definition(
        (inputs, outputs, kernel, stride) in (1_usize..20, 1_usize..20, 1_usize..6, 1_usize..4),
        pad in 0_usize..4,
        mirror in any::<bool>(),
        (images, height, width) in (0_usize..3, 1_usize..14, 1_usize..80),
    ) {
        let padding = if mirror { Padding::Reflect(pad) } else { Padding::Zero(pad) };
        let layer = Layer { inputs, outputs, kernel, stride, padding };
        let size = Size { images, height, width };
        let conv = conv(layer);
        let small = height.min(width);
        let legal = small + 2 * pad >= kernel && !(mirror && small <= pad);
        prop_assert_eq!(conv.output_size(size).is_ok(), legal);
        prop_assume!(legal);
        let (params, x) = (noise(layer.params(), 1), noise(size.len(inputs), 2));
        let mut y = vec![f32::NAN; layer.output(size).len(outputs)];
        conv.forward(Simd::best(), &params, &x, size, &mut y, &mut Workspace::default()).unwrap();
        compare("y", &y, &layer.forward(&wide(&params), &wide(&x), size), Tolerance::new(2e-6, 0.0)).unwrap();
    }

    #[test]
    fn an_image_does_not_depend_on_its_place_in_the_batch(images in 1_usize..5, which in 0_usize..5) {
        let layer = LAYERS[1];
        let (size, which) = (Size { images, height: 8, width: 9 }, which % images);
        let (params, x) = (noise(layer.params(), 1), noise(size.len(3), 2));
        let mut work = Workspace::default();
        let mut run = |x: &[f32], size: Size| {
            let mut y = vec![0.0; layer.output(size).len(layer.outputs)];
            conv(layer).forward(Simd::best(), &params, x, size, &mut y, &mut work).unwrap();
            y
        };
        let all = run(&x, size);
        let one = run(&x[which * 216..][..216], Size { images: 1, ..size });
        prop_assert_eq!(&all[which * one.len()..][..one.len()], &one[..]);
    }
}

#[test]
fn a_shifted_image_gives_shifted_maps_away_from_the_border() {
    let (height, width, shift) = (12, 60, 4);
    let layer = LAYERS[2];
    let size = Size::one(height, width);
    let params = noise(layer.params(), 1);
    let x = noise(size.len(layer.inputs), 2);
    let shifted: Vec<f32> = (0..x.len()).map(|i| x[i / width * width + (i % width + shift) % width]).collect();
    let to = layer.output(size);
    let run = |x: &[f32]| {
        let mut y = vec![0.0; to.len(layer.outputs)];
        conv(layer).forward(Simd::best(), &params, x, size, &mut y, &mut Workspace::default()).unwrap();
        y
    };
    let (a, b) = (run(&x), run(&shifted));
    for row in 0..layer.outputs * to.height {
        for j in 1..to.width - shift {
            assert_eq!(b[row * to.width + j], a[row * to.width + j + shift / 2], "row {row} column {j}");
        }
    }
}

#[test]
fn a_workspace_serves_layers_of_all_sizes_in_any_order() {
    // Left-overs of a larger layer must not show.
    let mut work = Workspace::default();
    for layer in LAYERS.into_iter().rev().chain(LAYERS) {
        for size in SIZES {
            let (params, x) = (noise(layer.params(), 7), noise(size.len(layer.inputs), 8));
            let mut both = [(); 2].map(|()| vec![0.0; layer.output(size).len(layer.outputs)]);
            let mut grads = [(); 2].map(|()| (vec![0.0; params.len()], vec![0.0; x.len()]));
            let fresh = &mut Workspace::default();
            for ((y, (params_bar, x_bar)), work) in both.iter_mut().zip(&mut grads).zip([&mut work, fresh]) {
                conv(layer).forward(Simd::best(), &params, &x, size, y, work).unwrap();
                conv(layer).backward(Simd::best(), &params, &x, size, y, params_bar, Some(x_bar), work).unwrap();
            }
            assert_eq!(both[0], both[1]);
            assert_eq!(grads[0], grads[1]);
        }
    }
}

#[test]
fn nothing_is_convolved_to_nothing() {
    let layer = LAYERS[1];
    let size = Size { images: 0, height: 8, width: 8 };
    let (params, mut work) = (noise(layer.params(), 1), Workspace::default());
    conv(layer).forward(Simd::best(), &params, &[], size, &mut [], &mut work).unwrap();
    let mut params_bar = vec![1.0; params.len()];
    conv(layer).backward(Simd::best(), &params, &[], size, &[], &mut params_bar, Some(&mut []), &mut work).unwrap();
    assert!(params_bar.iter().all(|&x| x == 1.0));
}

#[test]
fn wrong_shapes_are_refused_by_name() {
    for (what, n) in
        [("inputs", [0, 1, 1, 1]), ("outputs", [1, 0, 1, 1]), ("kernel", [1, 1, 0, 1]), ("stride", [1, 1, 1, 0])]
    {
        let e = Conv2d::new(n[0], n[1], n[2], n[3], Padding::Zero(0)).unwrap_err();
        assert_eq!(e.to_string(), format!("`{what}` is 0, expected at least 1"));
    }
    let layer = LAYERS[1];
    let (conv, size, mut work) = (conv(layer), Size::one(5, 6), Workspace::default());
    let (params, x, mut y) = (noise(layer.params(), 1), noise(90, 2), vec![0.0; 150]);
    let mut run = |params: &[f32], x: &[f32], size, y: &mut [f32]| {
        conv.forward(Simd::best(), params, x, size, y, &mut work).unwrap_err().to_string()
    };
    assert_eq!(run(&params[1..], &x, size, &mut y), "`params` holds 739 values, expected 740");
    assert_eq!(run(&params, &x[1..], size, &mut y), "`x` holds 89 values, expected 90");
    assert_eq!(run(&params, &x, size, &mut y[1..]), "`y` holds 149 values, expected 150");
    let wraps = 1 << (usize::BITS / 2);
    let error = resize(&[1.0], 1, Size::one(1, 1), Extent::new(wraps, wraps), &mut []).unwrap_err();
    assert_eq!(error, FieldError::Shape { what: "y", want: usize::MAX, got: 0 });
    let message = "`height` is 3, expected more pixels than the padding mirrors";
    assert_eq!(run(&params, &x, Size::one(3, 6), &mut y), message);
    let large = Conv2d::new(1, 1, 9, 1, Padding::Zero(1)).unwrap();
    assert_eq!(large.output_size(Size::one(7, 7)), Ok(Size::one(1, 1)));
    assert!(matches!(large.output_size(Size::one(7, 6)), Err(FieldError::Config { what: "width", .. })));
}

#[test]
fn relu_is_gated_by_its_output() {
    let mut x = [-1.0, -0.0, 0.0, 1e-45, 2.0, f32::INFINITY, f32::NEG_INFINITY, f32::MIN];
    relu(&mut x);
    assert_eq!(x, [0.0, 0.0, 0.0, 1e-45, 2.0, f32::INFINITY, 0.0, 0.0]);
    let mut bar = [1.0; 8];
    relu_backward(&x, &mut bar);
    assert_eq!(bar, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0]);
    let x = cotangent(50, 3);
    let forward = |x: &[f64], y: &mut [f64]| y.iter_mut().zip(x).for_each(|(y, x)| *y = x.max(0.0));
    let backward = |x: &[f64], y_bar: &[f64], x_bar: &mut [f64]| {
        let y: Vec<f32> = x.iter().map(|&x| x.max(0.0) as f32).collect();
        let mut bar: Vec<f32> = y_bar.iter().map(|&b| b as f32).collect();
        relu_backward(&y, &mut bar);
        x_bar.iter_mut().zip(&bar).for_each(|(x, &b)| *x += f64::from(b));
    };
    check_kinked(&x, &cotangent(50, 4), forward, backward, Tolerance::TWIN, 0.0).unwrap();
}

/// Cells of adaptive pooling by their definition in real numbers.
fn mean_twin(x: &[f64], size: Size, cells: Extent) -> Vec<f64> {
    let span = |i: usize, n: usize, pixels: usize| {
        let edge = |i: usize| i as f64 * pixels as f64 / n as f64;
        // Exact fractions: no edge lies within 1e-9 of an integer without being one.
        ((edge(i) + 1e-9).floor() as usize, (edge(i + 1) - 1e-9).ceil() as usize)
    };
    let mut y = Vec::new();
    for map in x.chunks(size.pixels()) {
        for i in 0..cells.height {
            for j in 0..cells.width {
                let (y0, y1) = span(i, cells.height, size.height);
                let (x0, x1) = span(j, cells.width, size.width);
                let sum: f64 = (y0..y1).flat_map(|y| (x0..x1).map(move |x| map[y * size.width + x])).sum();
                y.push(sum / ((y1 - y0) * (x1 - x0)) as f64);
            }
        }
    }
    y
}

#[test]
fn pooling_to_a_grid_matches_its_definition_and_gradient() {
    for (size, cells) in [
        (Size { images: 2, height: 6, width: 9 }, Extent::new(1, 1)),
        (Size { images: 1, height: 7, width: 5 }, Extent::new(3, 2)),
        (Size { images: 2, height: 8, width: 8 }, Extent::new(4, 8)),
        // More cells than pixels.
        (Size { images: 1, height: 2, width: 3 }, Extent::new(5, 7)),
    ] {
        let channels = 3;
        let x = noise(size.len(channels), 5);
        let y_bar = noise(size.images * channels * cells.len(), 6);
        let single = (
            |x: &[f32], y: &mut [f32]| adaptive_mean(x, channels, size, cells, y).unwrap(),
            |_: &[f32], y_bar: &[f32], x_bar: &mut [f32]| {
                adaptive_mean_backward(y_bar, channels, size, cells, x_bar).unwrap();
            },
        );
        // It is linear: its matrix is what it does to unit vectors.
        let n = size.len(channels);
        let unit = |i: usize| (0..n).map(|k| f64::from(u8::from(k == i))).collect::<Vec<f64>>();
        let twin = (
            |x: &[f64], y: &mut [f64]| y.copy_from_slice(&mean_twin(x, size, cells)),
            |_: &[f64], y_bar: &[f64], x_bar: &mut [f64]| {
                for (i, x_bar) in x_bar.iter_mut().enumerate() {
                    *x_bar += mean_twin(&unit(i), size, cells).iter().zip(y_bar).map(|(a, b)| a * b).sum::<f64>();
                }
            },
        );
        check_f32_pair(&x, &y_bar, single, twin, PairTolerances::default())
            .unwrap_or_else(|e| panic!("{size:?} {cells:?}: {e}"));
    }
}

#[test]
fn the_global_mean_keeps_constants_and_spreads_its_gradient_evenly() {
    let size = Size { images: 2, height: 300, width: 500 };
    let x: Vec<f32> = (0..size.len(1)).map(|i| if i < size.pixels() { 0.1 } else { 1e30 }).collect();
    let mut y = [0.0; 2];
    global_mean(&x, 1, size, &mut y).unwrap();
    assert_eq!(y, [0.1, 1e30]);
    let mut x_bar = vec![1.0; x.len()];
    global_mean_backward(&[150_000.0, 0.0], 1, size, &mut x_bar).unwrap();
    assert!(x_bar[..size.pixels()].iter().all(|&x| x == 2.0) && x_bar[size.pixels()..].iter().all(|&x| x == 1.0));
    assert!(global_mean(&[], 1, Size::one(0, 3), &mut [0.0]).is_err());
    global_mean(&[], 4, Size { images: 0, ..size }, &mut []).unwrap();
}

#[test]
fn max_pooling_takes_the_largest_of_four_and_sends_the_gradient_there() {
    let size = Size { images: 2, height: 5, width: 7 };
    let channels = 2;
    let x = cotangent(size.len(channels), 8);
    assert_eq!(max_pool_size(size), Size { images: 2, height: 2, width: 3 });
    let y_bar = cotangent(2 * channels * 6, 9);
    let single = |x: &[f64]| x.iter().map(|&x| x as f32).collect::<Vec<f32>>();
    let forward = |x: &[f64], y: &mut [f64]| {
        for (map, y) in x.chunks(35).zip(y.chunks_mut(6)) {
            for (k, y) in y.iter_mut().enumerate() {
                let at = |i: usize, j: usize| map[(2 * (k / 3) + i) * 7 + 2 * (k % 3) + j];
                *y = at(0, 0).max(at(0, 1)).max(at(1, 0).max(at(1, 1)));
            }
        }
    };
    let backward = |x: &[f64], y_bar: &[f64], x_bar: &mut [f64]| {
        let mut bar = vec![0.0; x.len()];
        max_pool_backward(&single(x), channels, size, &single(y_bar), &mut bar).unwrap();
        x_bar.iter_mut().zip(&bar).for_each(|(x, &b)| *x += f64::from(b));
    };
    check_kinked(&x, &y_bar, forward, backward, Tolerance::TWIN, 0.1).unwrap();
    let (mut y, mut want) = (vec![0.0_f32; 24], vec![0.0; 24]);
    max_pool(&single(&x), channels, size, &mut y).unwrap();
    forward(&x, &mut want);
    assert_eq!(wide(&y), want);
    // Equal pixels: the first one.
    let mut x_bar = [0.0; 4];
    max_pool_backward(&[3.0; 4], 1, Size::one(2, 2), &[1.0], &mut x_bar).unwrap();
    assert_eq!(x_bar, [1.0, 0.0, 0.0, 0.0]);
    // One pixel halves to none.
    max_pool(&[1.0], 1, Size::one(1, 1), &mut []).unwrap();
    assert!(max_pool(&[1.0; 4], 1, Size::one(2, 2), &mut [0.0; 2]).is_err());
}

/// Bilinear interpolation as the sum of tents around pixel centres, with the image continued at its edges.
fn resize_twin(x: &[f64], size: Size, to: Extent) -> Vec<f64> {
    let tent = |i: usize, from: usize, to: usize, k: usize| {
        let at = ((i as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, from as f64 - 1.0);
        (1.0 - (at - k as f64).abs()).max(0.0)
    };
    let mut y = Vec::new();
    for map in x.chunks(size.pixels()) {
        for i in 0..to.height {
            for j in 0..to.width {
                let term = |k: usize| {
                    tent(i, size.height, to.height, k / size.width)
                        * tent(j, size.width, to.width, k % size.width)
                        * map[k]
                };
                y.push((0..size.pixels()).map(term).sum());
            }
        }
    }
    y
}

#[test]
fn resizing_matches_its_definition_and_gradient() {
    for (size, to) in [
        (Size { images: 2, height: 4, width: 5 }, Extent::new(8, 10)),
        (Size { images: 1, height: 4, width: 5 }, Extent::new(4, 5)),
        (Size { images: 1, height: 6, width: 7 }, Extent::new(3, 2)),
        (Size { images: 1, height: 1, width: 1 }, Extent::new(3, 4)),
        (Size { images: 1, height: 5, width: 3 }, Extent::new(1, 1)),
        (Size { images: 2, height: 3, width: 4 }, Extent::new(7, 11)),
    ] {
        let channels = 2;
        let (x, y_bar) = (noise(size.len(channels), 5), noise(size.images * channels * to.len(), 6));
        let single = (
            |x: &[f32], y: &mut [f32]| resize(x, channels, size, to, y).unwrap(),
            |_: &[f32], y_bar: &[f32], x_bar: &mut [f32]| resize_backward(y_bar, channels, size, to, x_bar).unwrap(),
        );
        let n = size.len(channels);
        let unit = |i: usize| (0..n).map(|k| f64::from(u8::from(k == i))).collect::<Vec<f64>>();
        let twin = (
            |x: &[f64], y: &mut [f64]| y.copy_from_slice(&resize_twin(x, size, to)),
            |_: &[f64], y_bar: &[f64], x_bar: &mut [f64]| {
                for (i, x_bar) in x_bar.iter_mut().enumerate() {
                    *x_bar += resize_twin(&unit(i), size, to).iter().zip(y_bar).map(|(a, b)| a * b).sum::<f64>();
                }
            },
        );
        check_f32_pair(&x, &y_bar, single, twin, PairTolerances::default())
            .unwrap_or_else(|e| panic!("{size:?} {to:?}: {e}"));
    }
    let same = noise(20, 1);
    let mut y = vec![0.0; 20];
    resize(&same, 1, Size::one(4, 5), Extent::new(4, 5), &mut y).unwrap();
    assert_eq!(y, same, "the same size is the same image");
    assert!(resize(&[], 1, Size::one(0, 5), Extent::new(4, 5), &mut y).is_err());
    assert!(resize(&same, 1, Size::one(4, 5), Extent::new(0, 5), &mut []).is_err());
}

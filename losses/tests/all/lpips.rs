//! LPIPS with made-up weights: the graph against a plain `f64` one, every SIMD level, and what is refused.

use float_core::Simd;
use losses::metrics::{
    Image, MetricError,
    lpips::{LPIPS_MIN_SIDE, Lpips, LpipsError, LpipsTensor},
};
use proptest::prelude::*;
use std::{borrow::Cow, collections::BTreeMap};

type Weights = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Numbers in `[-1, 1)` from a counter.
fn noise(seed: u64, i: usize) -> f32 {
    let mut x = (seed << 32 | i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    x = (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    ((x >> 40) as f32) / (1_u32 << 23) as f32 - 1.0
}

/// Small, odd widths: none a multiple of anything.
fn weights(seed: u64) -> Weights {
    let mut out = Weights::new();
    let mut put = |name: String, shape: &[usize], gain: f32, offset: f32| {
        let seed = seed + out.len() as u64;
        let data = (0..shape.iter().product()).map(|i| offset + gain * noise(seed, i)).collect();
        out.insert(name, (shape.to_vec(), data));
    };
    put("scaling.shift".into(), &[3], 0.1, 0.0);
    put("scaling.scale".into(), &[3], 0.1, 0.45);
    put("features.0.weight".into(), &[7, 3, 3, 3], 0.4, 0.0);
    put("features.0.bias".into(), &[7], 0.1, 0.0);
    let mut channels = 7;
    for (n, squeeze, one, three) in [
        (3, 2, 3, 4),
        (4, 3, 5, 4),
        (6, 4, 6, 5),
        (7, 3, 5, 9),
        (9, 5, 8, 3),
        (10, 4, 7, 6),
        (11, 3, 1, 9),
        (12, 5, 6, 6),
    ] {
        for (part, inputs, outputs, side) in
            [("squeeze", channels, squeeze, 1), ("expand1x1", squeeze, one, 1), ("expand3x3", squeeze, three, 3)]
        {
            let gain = 2.0 / (inputs as f32 * (side * side) as f32).sqrt();
            put(format!("features.{n}.{part}.weight"), &[outputs, inputs, side, side], gain, 0.0);
            put(format!("features.{n}.{part}.bias"), &[outputs], 0.1, 0.05);
        }
        channels = one + three;
    }
    for (i, n) in [7, 9, 14, 11, 13, 10, 12].into_iter().enumerate() {
        put(format!("lin{i}.weight"), &[n], 0.5, 0.5);
    }
    out
}

fn load(weights: &Weights) -> Result<Lpips, LpipsError> {
    Lpips::new(|name| {
        let (shape, data) = weights.get(name)?;
        Some(LpipsTensor { shape: shape.clone(), data: Cow::Borrowed(data) })
    })
}

/// The graph as its description says, one loop a line.
mod naive {
    use super::Weights;

    struct Map {
        c: usize,
        w: usize,
        h: usize,
        data: Vec<f64>,
    }

    impl Map {
        fn at(&self, c: usize, y: usize, x: usize) -> f64 {
            self.data[(c * self.h + y) * self.w + x]
        }
    }

    fn tensor<'a>(weights: &'a Weights, name: &str) -> &'a (Vec<usize>, Vec<f32>) {
        &weights[name]
    }

    fn conv(weights: &Weights, name: &str, x: &Map, stride: usize, pad: usize) -> Map {
        let (shape, weight) = tensor(weights, &format!("{name}.weight"));
        let bias = &tensor(weights, &format!("{name}.bias")).1;
        let [i, side] = [shape[1], shape[2]];
        let (w, h) = ((x.w + 2 * pad - side) / stride + 1, (x.h + 2 * pad - side) / stride + 1);
        let mut data = Vec::new();
        for (o, &bias) in bias.iter().enumerate() {
            for y in 0..h {
                for column in 0..w {
                    let mut sum = f64::from(bias);
                    for c in 0..i {
                        for dy in 0..side {
                            for dx in 0..side {
                                let (sy, sx) = (y * stride + dy, column * stride + dx);
                                if sy >= pad && sx >= pad && sy - pad < x.h && sx - pad < x.w {
                                    let k = ((o * i + c) * side + dy) * side + dx;
                                    sum += f64::from(weight[k]) * x.at(c, sy - pad, sx - pad);
                                }
                            }
                        }
                    }
                    data.push(sum.max(0.0));
                }
            }
        }
        Map { c: bias.len(), w, h, data }
    }

    fn pool(x: &Map) -> Map {
        let size = |n: usize| ((n as f64 - 3.0) / 2.0).ceil() as usize + 1;
        let (w, h) = (size(x.w), size(x.h));
        let mut data = Vec::new();
        for c in 0..x.c {
            for y in 0..h {
                for column in 0..w {
                    let mut max = f64::NEG_INFINITY;
                    for sy in 2 * y..(2 * y + 3).min(x.h) {
                        for sx in 2 * column..(2 * column + 3).min(x.w) {
                            max = max.max(x.at(c, sy, sx));
                        }
                    }
                    data.push(max);
                }
            }
        }
        Map { c: x.c, w, h, data }
    }

    fn fire(weights: &Weights, n: usize, x: &Map) -> Map {
        let squeezed = conv(weights, &format!("features.{n}.squeeze"), x, 1, 0);
        let mut one = conv(weights, &format!("features.{n}.expand1x1"), &squeezed, 1, 0);
        let three = conv(weights, &format!("features.{n}.expand3x3"), &squeezed, 1, 1);
        one.data.extend(three.data);
        Map { c: one.c + three.c, ..one }
    }

    fn taps(weights: &Weights, image: &[f32], w: usize, h: usize) -> Vec<Map> {
        let (shift, scale) = (&tensor(weights, "scaling.shift").1, &tensor(weights, "scaling.scale").1);
        let input =
            |c: usize, i: usize| (2.0 * f64::from(image[3 * i + c]) - 1.0 - f64::from(shift[c])) / f64::from(scale[c]);
        let data = (0..3).flat_map(|c| (0..w * h).map(move |i| (c, i))).map(|(c, i)| input(c, i)).collect();
        let tap0 = conv(weights, "features.0", &Map { c: 3, w, h, data }, 2, 0);
        let tap1 = fire(weights, 4, &fire(weights, 3, &pool(&tap0)));
        let tap2 = fire(weights, 7, &fire(weights, 6, &pool(&tap1)));
        let tap3 = fire(weights, 9, &pool(&tap2));
        let tap4 = fire(weights, 10, &tap3);
        let tap5 = fire(weights, 11, &tap4);
        let tap6 = fire(weights, 12, &tap5);
        vec![tap0, tap1, tap2, tap3, tap4, tap5, tap6]
    }

    pub(crate) fn layers(weights: &Weights, a: &[f32], b: &[f32], w: usize, h: usize) -> Vec<f64> {
        let (a, b) = (taps(weights, a, w, h), taps(weights, b, w, h));
        let layer = |(i, (a, b)): (usize, (&Map, &Map))| {
            let lin = &tensor(weights, &format!("lin{i}.weight")).1;
            let mut total = 0.0;
            for y in 0..a.h {
                for x in 0..a.w {
                    let norm = |m: &Map| (0..m.c).map(|c| m.at(c, y, x).powi(2)).sum::<f64>().sqrt() + 1e-10;
                    let (na, nb) = (norm(a), norm(b));
                    for (c, &lin) in lin.iter().enumerate() {
                        total += f64::from(lin) * (a.at(c, y, x) / na - b.at(c, y, x) / nb).powi(2);
                    }
                }
            }
            total / (a.w * a.h) as f64
        };
        a.iter().zip(&b).enumerate().map(layer).collect()
    }
}

fn picture(seed: u64, w: usize, h: usize) -> Vec<f32> {
    (0..w * h * 3).map(|i| 0.5 + 0.5 * noise(seed, i)).collect()
}

proptest! {
    #![proptest_config(testkit::property::cases(24))]

    #[test]
    fn layers_match_naive_at_every_simd_level(seed in 0_u64..1000, w in LPIPS_MIN_SIDE..70, h in LPIPS_MIN_SIDE..50) {
        let weights = weights(1000 * seed);
        let (a, b) = (picture(seed + 1, w, h), picture(seed + 2, w, h));
        let want = naive::layers(&weights, &a, &b, w, h);
        let (a, b) = (Image::from_f32(w, h, 3, &a).unwrap(), Image::from_f32(w, h, 3, &b).unwrap());
        let net = load(&weights).unwrap();
        for level in Simd::available() {
            let got = net.clone().with_simd(level).layers(&a, &b).unwrap();
            prop_assert_eq!(got.len(), 7);
            for (i, (got, want)) in got.iter().zip(&want).enumerate() {
                // Some 100 f32 operations deep; a pixel whose features are all but zero is normalised to length 1.
                prop_assert!((got - want).abs() <= 2e-6 + 2e-5 * want, "{level:?}, tap {i}: {got}, {want}");
            }
        }
    }
}

#[test]
fn distance_is_zero_for_equal_images_and_symmetric() {
    let net = load(&weights(5)).unwrap();
    let (a, b) = (picture(1, 33, 21), picture(2, 33, 21));
    let (a, b) = (Image::from_f32(33, 21, 3, &a).unwrap(), Image::from_f32(33, 21, 3, &b).unwrap());
    assert_eq!(net.distance(&a, &a), Ok(0.0));
    let there = net.distance(&a, &b).unwrap();
    assert!(there > 0.01);
    assert_eq!(net.distance(&b, &a), Ok(there));
    assert_eq!(net.layers(&a, &b).unwrap().iter().sum::<f64>(), there);
}

#[test]
fn black_images_have_no_features_to_divide_by_and_stay_finite() {
    let mut weights = weights(5);
    for (name, (_, data)) in &mut weights {
        if name.ends_with("bias") {
            data.fill(-1e3);
        }
    }
    let net = load(&weights).unwrap();
    let (black, white) = (vec![0_u8; 24 * 24 * 3], vec![255_u8; 24 * 24 * 3]);
    let (black, white) = (Image::from_u8(24, 24, 3, &black).unwrap(), Image::from_u8(24, 24, 3, &white).unwrap());
    assert_eq!(net.distance(&black, &white), Ok(0.0), "all features are 0");
}

#[test]
fn images_it_is_not_defined_for_are_refused() {
    let net = load(&weights(5)).unwrap();
    let data = vec![0.5_f32; 40 * 40 * 4];
    let sized = |w: usize, h: usize, c: usize| Image::from_f32(w, h, c, &data[..w * h * c]).unwrap();
    let n = LPIPS_MIN_SIDE;
    assert!(net.distance(&sized(n, n, 3), &sized(n, n, 3)).is_ok());
    for (w, h) in [(n - 1, 40), (40, n - 1), (2, 2), (1, 1)] {
        let error = net.distance(&sized(w, h, 3), &sized(w, h, 3)).unwrap_err();
        assert_eq!(error, MetricError::TooSmall { metric: "LPIPS", min_side: n, width: w, height: h });
    }
    assert!(matches!(net.distance(&sized(0, 0, 3), &sized(0, 0, 3)), Err(MetricError::TooSmall { .. })));
    let four = net.distance(&sized(20, 20, 4), &sized(20, 20, 4));
    assert_eq!(four, Err(MetricError::Channels { want: 3, got: 4 }));
    assert!(matches!(net.distance(&sized(20, 20, 3), &sized(20, 21, 3)), Err(MetricError::Mismatch { .. })));

    let mut huge = vec![0.5_f32; 20 * 20 * 3];
    huge[600] = f32::MAX;
    let huge = Image::from_f32(20, 20, 3, &huge).unwrap();
    assert_eq!(net.distance(&huge, &sized(20, 20, 3)), Err(MetricError::Overflow { metric: "LPIPS" }));
}

#[test]
fn every_tensor_is_needed_and_named_when_missing() {
    let all = weights(3);
    for name in all.keys() {
        let mut some = all.clone();
        some.remove(name);
        assert_eq!(load(&some).unwrap_err(), LpipsError::Missing { name: name.clone() });
    }
}

#[test]
fn misshapen_tensors_are_named() {
    let good = weights(3);
    let break_it = |name: &str, shape: &[usize]| {
        let mut bad = good.clone();
        bad.insert(name.into(), (shape.to_vec(), vec![0.5; shape.iter().product()]));
        load(&bad).unwrap_err().to_string()
    };
    assert_eq!(
        break_it("features.0.weight", &[7, 4, 3, 3]),
        "tensor `features.0.weight` has shape [7, 4, 3, 3], expected [any, 3, 3, 3]"
    );
    assert_eq!(
        break_it("features.9.expand3x3.weight", &[3, 5, 3]),
        "tensor `features.9.expand3x3.weight` has shape [3, 5, 3], expected [any, 5, 3, 3]"
    );
    assert_eq!(
        break_it("features.7.squeeze.bias", &[4]),
        "tensor `features.7.squeeze.bias` has shape [4], expected [3]"
    );
    assert_eq!(break_it("lin3.weight", &[12]), "tensor `lin3.weight` has shape [12], expected [11]");
    assert_eq!(
        break_it("features.3.squeeze.weight", &[0, 7, 1, 1]),
        "tensor `features.3.squeeze.weight` has shape [0, 7, 1, 1], expected [any, 7, 1, 1]"
    );
}

#[test]
fn tensors_with_unusable_values_are_named() {
    let mut bad = weights(3);
    bad.get_mut("lin2.weight").unwrap().1[4] = f32::NAN;
    assert!(matches!(load(&bad), Err(LpipsError::Value { name, index: 4, .. }) if name == "lin2.weight"));
    let mut bad = weights(3);
    bad.get_mut("scaling.scale").unwrap().1[1] = 0.0;
    assert_eq!(load(&bad).unwrap_err().to_string(), "tensor `scaling.scale`: value 1 is 0");
    let mut bad = weights(3);
    bad.get_mut("features.0.weight").unwrap().1.pop();
    assert_eq!(load(&bad).unwrap_err().to_string(), "tensor `features.0.weight` holds 188 values, its shape says 189");
}

#[test]
fn channel_weights_may_come_as_a_convolution() {
    let flat = weights(3);
    let mut deep = flat.clone();
    for i in 0..7 {
        let (shape, _) = deep.get_mut(&format!("lin{i}.weight")).unwrap();
        *shape = vec![1, shape[0], 1, 1];
    }
    let (a, b) = (picture(1, 20, 20), picture(2, 20, 20));
    let (a, b) = (Image::from_f32(20, 20, 3, &a).unwrap(), Image::from_f32(20, 20, 3, &b).unwrap());
    assert_eq!(load(&flat).unwrap().layers(&a, &b), load(&deep).unwrap().layers(&a, &b));
}

#[cfg(feature = "rayon")]
#[test]
fn same_bits_with_any_number_of_threads() {
    let net = load(&weights(8)).unwrap();
    let (a, b) = (picture(1, 131, 97), picture(2, 131, 97));
    let (a, b) = (Image::from_f32(131, 97, 3, &a).unwrap(), Image::from_f32(131, 97, 3, &b).unwrap());
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| net.layers(&a, &b).unwrap())
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(4));
}

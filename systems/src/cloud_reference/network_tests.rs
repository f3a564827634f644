//! The network of feature maps against its definition in `f64`.

use super::map_network::{MapMemory, MapNetwork, MapShape};
use field_core::rng::Rng;

const SIDE: usize = 16;
const SHAPE: MapShape = MapShape { side: SIDE, channels: 3, planes: 6, tones: true };

/// Channels of square maps.
#[derive(Clone)]
struct Maps {
    side: usize,
    values: Vec<f64>,
}

impl Maps {
    fn planes(&self) -> usize {
        self.values.len() / (self.side * self.side)
    }

    /// 0 outside.
    fn at(&self, c: usize, y: isize, x: isize) -> f64 {
        let inside = |i: isize| (0..self.side as isize).contains(&i);
        if inside(y) && inside(x) { self.values[(c * self.side + y as usize) * self.side + x as usize] } else { 0.0 }
    }

    fn of(side: usize, channels: usize, value: impl Fn(usize, usize, usize) -> f64) -> Self {
        let places = (0..channels * side * side).map(|i| (i / (side * side), i / side % side, i % side));
        Self { side, values: places.map(|(c, y, x)| value(c, y, x)).collect() }
    }

    fn beside(&self, other: &Self) -> Self {
        Self { side: self.side, values: [&self.values[..], &other.values].concat() }
    }

    fn positive(mut self) -> Self {
        self.values.iter_mut().for_each(|x| *x = x.max(0.0));
        self
    }

    /// Twice as large, linearly between centres.
    fn doubled(&self) -> Self {
        let taps = |i: usize| {
            let x = ((i as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, self.side as f64 - 1.0);
            let low = x.floor();
            [(low as isize, 1.0 - (x - low)), ((low as isize + 1).min(self.side as isize - 1), x - low)]
        };
        Self::of(2 * self.side, self.planes(), |c, y, x| {
            taps(y).iter().flat_map(|(v, a)| taps(x).map(|(h, b)| a * b * self.at(c, *v, h))).sum()
        })
    }

    fn means(&self) -> Self {
        let pixels = self.side * self.side;
        Self::of(self.side, self.planes(), |c, _, _| {
            self.values[c * pixels..][..pixels].iter().sum::<f64>() / pixels as f64
        })
    }

    /// Takes its parameters from the front of `params`.
    fn convolved(&self, params: &mut &[f64], outputs: usize, kernel: usize, stride: usize) -> Self {
        let (inputs, pad) = (self.planes(), isize::from(kernel > 1));
        let (weights, rest) = params.split_at(outputs * inputs * kernel * kernel);
        let (biases, rest) = rest.split_at(outputs);
        *params = rest;
        Self::of(self.side / stride, outputs, |o, y, x| {
            let taps = (0..inputs * kernel * kernel).map(|i| (i / (kernel * kernel), i / kernel % kernel, i % kernel));
            let seen = |c: usize, v: usize, u: usize| {
                self.at(c, (stride * y + v) as isize - pad, (stride * x + u) as isize - pad)
            };
            let sum: f64 =
                taps.map(|(c, v, u)| weights[((o * inputs + c) * kernel + v) * kernel + u] * seen(c, v, u)).sum();
            biases[o] + sum
        })
    }
}

fn twin(shape: MapShape, params: &[f64], pixels: &[f64]) -> Vec<f64> {
    let outputs = shape.planes;
    let mut rest = params;
    let rest = &mut rest;
    let photo = Maps { side: SIDE, values: pixels.to_vec() };
    let mut down = vec![photo.convolved(rest, 8, 3, 1).positive()];
    for channels in [16, 32, 32, 32] {
        down.push(down[down.len() - 1].convolved(rest, channels, 4, 2).positive());
    }
    let deepest = &down[4];
    let mut up = deepest.beside(&deepest.means()).convolved(rest, 32, 1, 1).positive();
    for (channels, beside) in [(32, 3), (24, 2), (16, 1)] {
        up = up.doubled().beside(&down[beside]).convolved(rest, channels, 3, 1).positive();
    }
    let mut maps = up.convolved(rest, outputs, 1, 1);
    let tones: Vec<f64> = photo
        .values
        .chunks_exact(SIDE * SIDE)
        .flat_map(|x| [-50.0, -5.0, 0.0, 5.0, 50.0_f64].map(|tilt| tone(x, tilt)))
        .collect();
    if !shape.tones {
        assert!(rest.is_empty());
        return maps.values;
    }
    for (plane, weights) in maps.values.chunks_exact_mut(SIDE * SIDE / 4).zip(rest.chunks_exact(tones.len())) {
        let sum: f64 = weights.iter().zip(&tones).map(|(w, tone)| w * tone).sum();
        plane.iter_mut().for_each(|x| *x += sum);
    }
    assert_eq!(rest.len(), outputs * tones.len());
    maps.values
}

/// The mean of a channel, tilted towards bright or dark pixels, beside that of colours that are spread evenly.
fn tone(x: &[f64], tilt: f64) -> f64 {
    let weights = || x.iter().map(|x| (tilt * x).exp());
    let mean = weights().zip(x).map(|(w, x)| w * x).sum::<f64>() / weights().sum::<f64>();
    3.0 * (mean - 0.6 * (0.2 * tilt).tanh())
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|x| f64::from(*x)).collect()
}

fn numbers(stream: u64, n: usize) -> Vec<f32> {
    let mut out = vec![0.0; n];
    Rng::new(5, stream).fill_uniform(0, &mut out);
    out.iter_mut().for_each(|x| *x = 2.0 * *x - 1.0);
    out
}

#[test]
fn maps_and_their_gradient_are_those_of_the_definition() {
    check(SHAPE);
    check(MapShape { channels: 5, planes: 2, tones: false, ..SHAPE });
}

fn check(shape: MapShape) {
    let network = MapNetwork::new(shape, "side").unwrap();
    let mut params = network.init(Rng::new(3, 0));
    // Biases as well.
    params.iter_mut().zip(numbers(0, network.param_count())).for_each(|(p, x)| *p += 0.02 * x);
    let pixels = numbers(1, shape.channels * SIDE * SIDE);
    let mut memory = MapMemory::default();
    let maps = network.forward(&params, &pixels, &mut memory).to_vec();
    assert_eq!(maps.len(), network.map_numbers());
    let (wide_params, wide_pixels) = (wide(&params), wide(&pixels));
    for (got, want) in maps.iter().zip(twin(shape, &wide_params, &wide_pixels)) {
        assert!((f64::from(*got) - want).abs() < 2e-5, "{got} {want}");
    }
    let bar = numbers(2, maps.len());
    let got = network.backward(&params, &bar, &mut memory);
    let value = |params: &[f64]| -> f64 {
        twin(shape, params, &wide_pixels).iter().zip(&bar).map(|(x, w)| x * f64::from(*w)).sum()
    };
    let largest = got.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
    assert!(largest > 0.1, "{largest}");
    // Some of every layer, and of the tones, which are the last.
    for at in (0..params.len()).step_by(1511).chain((params.len() - 40..params.len()).step_by(7)) {
        let mut moved = wide_params.clone();
        let h = 1e-6;
        moved[at] += h;
        let above = value(&moved);
        moved[at] -= 2.0 * h;
        let want = (above - value(&moved)) / (2.0 * h);
        let off = (f64::from(got[at]) - want).abs();
        assert!(off < 1e-4 * f64::from(largest), "parameter {at}: {} {want}", got[at]);
    }
    // The same again, with memory that held another photo.
    network.forward(&params, &numbers(4, pixels.len()), &mut memory);
    assert_eq!(network.forward(&params, &pixels, &mut memory), maps);
}

#[test]
fn photos_of_one_colour_have_maps_and_no_side_is_too_small() {
    for side in [16, 48] {
        let network = MapNetwork::new(MapShape { side, ..SHAPE }, "side").unwrap();
        let params = network.init(Rng::new(3, 0));
        for grey in [-1.0, 0.0, 1.0] {
            let mut memory = MapMemory::default();
            let maps = network.forward(&params, &vec![grey; 3 * side * side], &mut memory).to_vec();
            assert_eq!(maps.len(), network.map_numbers());
            assert!(maps.iter().all(|x| x.is_finite()), "{grey}");
        }
        assert!(network.memory_len() > 0);
    }
}

//! Maps of a photo, sampled bilinearly.

use super::reference::CAMERA;

/// Points nearer to the camera than this are behind it; internal units.
const NEAR: f32 = 1e-4;

/// Maps as they are read: `[map][pixel][channel]`.
pub(crate) struct Texels {
    side: usize,
    channels: usize,
    values: Vec<f32>,
}

/// Where a map is read: between four pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Tap {
    /// Pixels: left and right of the upper row, left and right of the lower one.
    pub(crate) at: [u32; 4],
    pub(crate) shares: [f32; 4],
    /// How far right and down of the first.
    part: [f32; 2],
    /// Derivative of the place in pixels along each axis: 0 beyond the outermost centres, where it does not matter.
    slope: [f32; 2],
}

impl Tap {
    /// At a place in pixels, centres at whole numbers; outside the border's value holds.
    fn new(place: [f32; 2], slope: f32, side: usize) -> Self {
        let last = (side - 1) as f32;
        // What is no number becomes 0.
        let held = place.map(|x| x.max(0.0).min(last));
        let first = held.map(|x| x as usize);
        let next = first.map(|x| (x + 1).min(side - 1));
        let part = [held[0] - first[0] as f32, held[1] - first[1] as f32];
        let [right, down] = part;
        let at = [(first[0], first[1]), (next[0], first[1]), (first[0], next[1]), (next[0], next[1])];
        Self {
            at: at.map(|(x, y)| (y * side + x) as u32),
            shares: [(1.0 - right) * (1.0 - down), right * (1.0 - down), (1.0 - right) * down, right * down],
            part,
            slope: place.map(|x| if x > 0.0 && x < last { slope } else { 0.0 }),
        }
    }

    /// At normalised coordinates, -1 and 1 the borders (not the outermost centres).
    pub(crate) fn at_coordinates(coordinates: [f32; 2], side: usize) -> Self {
        let half = 0.5 * side as f32;
        Self::new(coordinates.map(|x| (x + 1.0) * half - 0.5), half, side)
    }

    /// Where a point of the clouds' frame is in the photo of a camera; `None` outside, and behind it.
    pub(crate) fn projected(camera: &[f32; CAMERA], p: [f32; 3], side: usize) -> Option<Self> {
        let row = |k: usize| camera[k] * p[0] + camera[k + 1] * p[1] + camera[k + 2] * p[2] + camera[k + 3];
        let depth = row(8);
        if depth.is_nan() || depth <= NEAR {
            return None;
        }
        let uv = [row(0) / depth, row(4) / depth];
        let is_inside = uv.iter().all(|x| (0.0..=1.0).contains(x));
        is_inside.then(|| Self::new(uv.map(|x| x * side as f32 - 0.5), 0.0, side))
    }
}

impl Texels {
    /// Of maps `[map][channels][side][side]`.
    pub(crate) fn new(maps: &[f32], channels: usize, side: usize) -> Self {
        let pixels = side * side;
        let mut values = vec![0.0; maps.len()];
        let each = maps.chunks_exact(channels * pixels).zip(values.chunks_exact_mut(channels * pixels));
        for (map, out) in each {
            for (c, plane) in map.chunks_exact(pixels).enumerate() {
                out[c..].iter_mut().step_by(channels).zip(plane).for_each(|(to, from)| *to = *from);
            }
        }
        Self { side, channels, values }
    }

    /// Pixels along a side.
    pub(crate) fn side(&self) -> usize {
        self.side
    }

    /// Maps.
    pub(crate) fn maps(&self) -> usize {
        self.values.len() / (self.side * self.side * self.channels)
    }

    /// Numbers of all maps.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// Numbers of a pixel.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    fn texel(&self, map: usize, pixel: u32) -> &[f32] {
        let first = (map * self.side * self.side + pixel as usize) * self.channels;
        &self.values[first..first + self.channels]
    }

    /// Features of a map, channel by channel.
    pub(crate) fn sample(&self, map: usize, tap: &Tap, mut put: impl FnMut(usize, f32)) {
        let [a, b, d, e] = tap.at.map(|pixel| self.texel(map, pixel));
        let [of_a, of_b, of_d, of_e] = tap.shares;
        for (c, (((a, b), d), e)) in a.iter().zip(b).zip(d).zip(e).enumerate() {
            put(c, of_a * a + of_b * b + of_d * d + of_e * e);
        }
    }

    /// Gradient with respect to the coordinates of [`Tap::at_coordinates`], where `bar` gives that with respect to each channel.
    pub(crate) fn coordinates_bar(&self, map: usize, tap: &Tap, bar: impl Fn(usize) -> f32) -> [f32; 2] {
        let corners = tap.at.map(|pixel| self.texel(map, pixel));
        let [right, down] = tap.part;
        let mut sum = [0.0; 2];
        for c in 0..self.channels {
            let [a, b, d, e] = corners.map(|corner| corner[c]);
            sum[0] += bar(c) * ((1.0 - down) * (b - a) + down * (e - d));
            sum[1] += bar(c) * ((1.0 - right) * (d - a) + right * (e - b));
        }
        [sum[0] * tap.slope[0], sum[1] * tap.slope[1]]
    }
}

//! The SqueezeNet 1.1 trunk with its taps, as a list of steps.

use super::{
    conv::{Conv, Features},
    weights::{Lookup, LpipsError},
};
use alloc::{format, string::String, vec, vec::Vec};
use float_core::Simd;

/// One step of the trunk.
#[derive(Clone, Debug)]
pub(super) enum Step {
    /// Convolution and ReLU.
    Conv(Conv),
    /// 3x3 maxima with stride 2.
    Pool,
    /// A Fire module.
    Fire(Fire),
    /// Compare the features here, with these weights of the channels.
    Tap(Vec<f32>),
}

/// Squeeze to few channels, then expand twice, side by side.
#[derive(Clone, Debug)]
pub(super) struct Fire {
    squeeze: Conv,
    expand1x1: Conv,
    expand3x3: Conv,
}

impl Fire {
    fn load(lookup: &mut Lookup<'_, '_>, n: usize, inputs: usize) -> Result<Self, LpipsError> {
        let mut conv = |part: &str, inputs, side, pad| {
            let (weight, bias) = lookup.convolution(&format!("features.{n}.{part}"), inputs, side)?;
            Ok(Conv::new(&weight, &bias, 1, pad))
        };
        let squeeze = conv("squeeze", inputs, 1, 0)?;
        let expand1x1 = conv("expand1x1", squeeze.outputs(), 1, 0)?;
        let expand3x3 = conv("expand3x3", squeeze.outputs(), 3, 1)?;
        Ok(Self { squeeze, expand1x1, expand3x3 })
    }

    fn outputs(&self) -> usize {
        self.expand1x1.outputs() + self.expand3x3.outputs()
    }

    pub(super) fn run(&self, simd: Simd, x: &Features) -> Features {
        let squeezed = self.squeeze.run(simd, x);
        let pixels = x.width * x.height;
        let mut data = vec![0.0; self.outputs() * pixels];
        let (one, three) = data.split_at_mut(self.expand1x1.outputs() * pixels);
        self.expand1x1.run_into(simd, &squeezed, one);
        self.expand3x3.run_into(simd, &squeezed, three);
        Features { channels: self.outputs(), width: x.width, height: x.height, data }
    }
}

/// Shift and scale of the input, and the steps.
pub(super) type Network = ([f32; 3], [f32; 3], Vec<Step>);

pub(super) fn load(lookup: &mut Lookup<'_, '_>) -> Result<Network, LpipsError> {
    let three = |v: Vec<f32>| [v[0], v[1], v[2]];
    let shift = three(lookup.channels("scaling.shift", 3)?);
    let scale = three(lookup.channels("scaling.scale", 3)?);
    if let Some(index) = scale.iter().position(|&s| s == 0.0) {
        return Err(LpipsError::Value { name: String::from("scaling.scale"), index, value: 0.0 });
    }

    let mut steps = Vec::new();
    let (weight, bias) = lookup.convolution("features.0", 3, 3)?;
    let conv = Conv::new(&weight, &bias, 2, 0);
    let mut channels = conv.outputs();
    steps.push(Step::Conv(conv));
    let mut taps = 0;
    let mut tap = |lookup: &mut Lookup<'_, '_>, channels| {
        let lin = lookup.channels(&format!("lin{taps}.weight"), channels)?;
        taps += 1;
        Ok(Step::Tap(lin))
    };
    steps.push(tap(lookup, channels)?);
    // Fire modules by their place in torchvision's `features`; pools stand at 2, 5 and 8.
    for (fires, pooled) in
        [(&[3, 4][..], true), (&[6, 7], true), (&[9], true), (&[10], false), (&[11], false), (&[12], false)]
    {
        if pooled {
            steps.push(Step::Pool);
        }
        for &n in fires {
            let fire = Fire::load(lookup, n, channels)?;
            channels = fire.outputs();
            steps.push(Step::Fire(fire));
        }
        steps.push(tap(lookup, channels)?);
    }
    Ok((shift, scale, steps))
}

/// 3x3 maxima with stride 2, no padding; windows at the far edge are cut off (sizes rounded up). Sides of at least 2.
pub(super) fn pool(x: &Features) -> Features {
    // ceil((n - 3) / 2) + 1
    let (width, height) = (x.width / 2, x.height / 2);
    let mut data = vec![0.0; x.channels * width * height];
    let mut column_max = vec![0.0_f32; x.width];
    for (plane, out) in x.data.chunks_exact(x.width * x.height).zip(data.chunks_exact_mut(width * height)) {
        for (y, out) in out.chunks_exact_mut(width).enumerate() {
            let rows = &plane[2 * y * x.width..(2 * y + 3).min(x.height) * x.width];
            column_max.copy_from_slice(&rows[..x.width]);
            for row in rows[x.width..].chunks_exact(x.width) {
                for (m, &v) in column_max.iter_mut().zip(row) {
                    *m = m.max(v);
                }
            }
            for (i, out) in out.iter_mut().enumerate() {
                let pair = column_max[2 * i].max(column_max[2 * i + 1]);
                *out = column_max.get(2 * i + 2).map_or(pair, |&v| pair.max(v));
            }
        }
    }
    Features { channels: x.channels, width, height, data }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pool_cuts_windows_at_the_far_edge() {
        let data = (0..16).map(|i| i as f32).collect();
        let out = pool(&Features { channels: 1, width: 4, height: 4, data });
        assert_eq!((out.width, out.height), (2, 2));
        assert_eq!(out.data, [10.0, 11.0, 14.0, 15.0]);
        let row = pool(&Features { channels: 2, width: 5, height: 2, data: (0..20).map(|i| -(i as f32)).collect() });
        assert_eq!((row.width, row.height), (2, 1));
        assert_eq!(row.data, [0.0, -2.0, -10.0, -12.0]);
    }
}

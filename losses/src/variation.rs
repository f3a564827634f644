//! Variation: neighbours in time or on a lattice should not differ.
//!
//! In time, over displacements or scene flow `[rows][n]` of `n` samples, a kernel of each number, summed:
//!
//! | function | of | source |
//! | --- | --- | --- |
//! | [`magnitude`] | `a` | NSFF, DynamicNeRF ("slow", flow magnitude): L1 |
//! | [`difference`] | `a - b`: displacements at two times | D-NeRF's code: squared, times 1e-4 |
//! | [`acceleration`] | `a + b`: flow to the next and to the previous frame | "smooth": squared (NSFF half of it), or L1 (RoDynRF) |
//!
//! On a lattice ([`total_variation`]): for each axis the **mean** over all pairs of neighbours, and these summed. Squared it is the
//! plane regulariser of K-planes and HexPlane, with Huber of width 1 the one of DVGO and TiNeuVox (up to the factor in
//! front).
//!
//! The kernel must be one of the difference of two numbers, that is, any but the log-squared. Sums are `f64` in index
//! order. Values are not scanned: NaN in gives NaN out.
//!
//! Source: Li et al., "Neural scene flow fields", 2021, eq. 9-10; Gao et al., "Dynamic view synthesis from dynamic monocular
//! video", 2021, eq. 8-11; Pumarola et al., "D-NeRF", 2021, released code; Fridovich-Keil et al., "K-planes", 2023, eq. 3;
//! Fang et al., "Fast dynamic radiance fields with time-aware neural voxels", 2022.

use crate::{LossError, error::same, kernel::Kernel};

/// `sum kernel(a)`; 0 for nothing.
///
/// # Errors
/// [`LossError::Parameter`] for an unusable kernel.
pub fn magnitude(a: &[f32], kernel: Kernel) -> Result<f64, LossError> {
    check(kernel)?;
    Ok(a.iter().map(|&a| f64::from(kernel.value(a, 0.0))).sum())
}

/// Backward twin of [`magnitude`]: adds into `a_bar`.
///
/// # Errors
/// As [`magnitude`], [`LossError::Shape`] where lengths disagree.
pub fn magnitude_backward(a: &[f32], kernel: Kernel, loss_bar: f64, a_bar: &mut [f32]) -> Result<(), LossError> {
    check(kernel)?;
    same("a_bar", a.len(), a_bar.len())?;
    for (a_bar, &a) in a_bar.iter_mut().zip(a) {
        *a_bar += derivative(kernel, a, 0.0, loss_bar);
    }
    Ok(())
}

/// `sum kernel(a - b)`; 0 for nothing.
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for an unusable kernel.
pub fn difference(a: &[f32], b: &[f32], kernel: Kernel) -> Result<f64, LossError> {
    pair(a, b, kernel)?;
    Ok(a.iter().zip(b).map(|(&a, &b)| f64::from(kernel.value(a, b))).sum())
}

/// Backward twin of [`difference`]: adds into `a_bar` and `b_bar`.
///
/// # Errors
/// As [`difference`].
pub fn difference_backward(
    a: &[f32],
    b: &[f32],
    kernel: Kernel,
    loss_bar: f64,
    a_bar: &mut [f32],
    b_bar: &mut [f32],
) -> Result<(), LossError> {
    pair(a, b, kernel)?;
    same("a_bar", a.len(), a_bar.len())?;
    same("b_bar", a.len(), b_bar.len())?;
    for (((&a, &b), a_bar), b_bar) in a.iter().zip(b).zip(a_bar).zip(b_bar) {
        let bar = derivative(kernel, a, b, loss_bar);
        *a_bar += bar;
        *b_bar -= bar;
    }
    Ok(())
}

/// `sum kernel(a + b)`; 0 for nothing, and where `b = -a`: motion without acceleration.
///
/// # Errors
/// As [`difference`].
pub fn acceleration(a: &[f32], b: &[f32], kernel: Kernel) -> Result<f64, LossError> {
    pair(a, b, kernel)?;
    Ok(a.iter().zip(b).map(|(&a, &b)| f64::from(kernel.value(a, -b))).sum())
}

/// Backward twin of [`acceleration`]: adds into `a_bar` and `b_bar`, the same to both.
///
/// # Errors
/// As [`difference`].
pub fn acceleration_backward(
    a: &[f32],
    b: &[f32],
    kernel: Kernel,
    loss_bar: f64,
    a_bar: &mut [f32],
    b_bar: &mut [f32],
) -> Result<(), LossError> {
    pair(a, b, kernel)?;
    same("a_bar", a.len(), a_bar.len())?;
    same("b_bar", a.len(), b_bar.len())?;
    for (((&a, &b), a_bar), b_bar) in a.iter().zip(b).zip(a_bar).zip(b_bar) {
        let bar = derivative(kernel, a, -b, loss_bar);
        *a_bar += bar;
        *b_bar += bar;
    }
    Ok(())
}

/// Total variation of a lattice: for each of `axes` the mean over its pairs of neighbours of `kernel(difference)`, summed
/// over the axes. An axis of fewer than two vertices costs nothing.
///
/// # Shapes and units
/// * `x` row-major of shape `dims`, any number of dimensions: a plane `[c, h, w]` varies along axes `[1, 2]`, one with
///   features together `[h, w, c]` along `[0, 1]`, voxels `[z, y, x, c]` along `[0, 1, 2]`
///
/// # Errors
/// [`LossError::Shape`] unless `x` has that shape and every axis exists, [`LossError::Parameter`] for an unusable kernel.
pub fn total_variation(x: &[f32], dims: &[usize], axes: &[usize], kernel: Kernel) -> Result<f64, LossError> {
    check_lattice(x, dims, axes, kernel)?;
    let mut total = 0.0;
    for axis in axes.iter().filter_map(|&axis| Axis::new(dims, axis)) {
        let mut sum = 0.0;
        axis.for_each_run(|low, high| {
            for (&a, &b) in x[high].iter().zip(&x[low]) {
                sum += f64::from(kernel.value(a, b));
            }
        });
        total += sum / axis.pairs as f64;
    }
    Ok(total)
}

/// Backward twin of [`total_variation`]: adds into `x_bar`, shaped as `x`.
///
/// # Errors
/// As [`total_variation`].
pub fn total_variation_backward(
    x: &[f32],
    dims: &[usize],
    axes: &[usize],
    kernel: Kernel,
    loss_bar: f64,
    x_bar: &mut [f32],
) -> Result<(), LossError> {
    check_lattice(x, dims, axes, kernel)?;
    same("x_bar", x.len(), x_bar.len())?;
    for axis in axes.iter().filter_map(|&axis| Axis::new(dims, axis)) {
        let bar = loss_bar / axis.pairs as f64;
        axis.for_each_run(|low, high| {
            for (low, high) in low.zip(high) {
                let bar = derivative(kernel, x[high], x[low], bar);
                x_bar[high] += bar;
                x_bar[low] -= bar;
            }
        });
    }
    Ok(())
}

/// Where the neighbours along one axis lie.
struct Axis {
    /// Blocks before the axis, vertices along it, numbers from one vertex to the next.
    outer: usize,
    len: usize,
    stride: usize,
    pairs: usize,
}

impl Axis {
    /// `None` where there is no pair.
    fn new(dims: &[usize], axis: usize) -> Option<Self> {
        let (outer, stride) = (dims[..axis].iter().product(), dims[axis + 1..].iter().product());
        let len = dims[axis];
        let pairs = outer * stride * len.saturating_sub(1);
        (pairs > 0).then_some(Self { outer, len, stride, pairs })
    }

    /// Runs of numbers and of their neighbours, in index order.
    fn for_each_run(&self, mut f: impl FnMut(core::ops::Range<usize>, core::ops::Range<usize>)) {
        let run = self.stride * (self.len - 1);
        for block in 0..self.outer {
            let start = block * self.stride * self.len;
            f(start..start + run, start + self.stride..start + self.stride + run);
        }
    }
}

fn derivative(kernel: Kernel, a: f32, b: f32, bar: f64) -> f32 {
    (bar * f64::from(kernel.derivative(a, b))) as f32
}

fn pair(a: &[f32], b: &[f32], kernel: Kernel) -> Result<(), LossError> {
    check(kernel)?;
    same("b", a.len(), b.len())
}

/// Refuses kernels that are not of the difference of two numbers, and unusable ones.
pub(crate) fn check(kernel: Kernel) -> Result<(), LossError> {
    if let Kernel::LogSquared { eps } = kernel {
        let what = "`eps` of a kernel that is not one of the difference";
        return Err(LossError::Parameter { what, value: eps, range: "any kernel but the log-squared" });
    }
    kernel.check()
}

fn check_lattice(x: &[f32], dims: &[usize], axes: &[usize], kernel: Kernel) -> Result<(), LossError> {
    check(kernel)?;
    // More than can be counted is more than `x` has.
    let want = dims.iter().try_fold(1_usize, |n, &dim| n.checked_mul(dim)).unwrap_or(usize::MAX);
    same("x", want, x.len())?;
    // The first axis that is not there tells how many dimensions it wants.
    axes.iter()
        .find(|&&axis| axis >= dims.len())
        .map_or(Ok(()), |&axis| same("dims", axis.saturating_add(1), dims.len()))
}

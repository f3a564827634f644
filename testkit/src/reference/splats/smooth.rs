//! The 3D filter of Mip-Splatting, from its definition.

/// Convolve `n` Gaussians, of parameters as [`project`](super::project()) takes them, with round ones of these standard deviations: opacity
/// times volume stays.
///
/// # Source
/// Yu et al., "Mip-Splatting: alias-free 3D Gaussian splatting", 2024, equation 9.
///
/// # Panics
/// For fewer parameters or filters than Gaussians.
pub fn smooth(p: &mut [f64], n: usize, filters: &[f64]) {
    for i in 0..n {
        let mut kept = 1.0;
        for axis in 0..3 {
            let x = &mut p[(3 + axis) * n + i];
            let wider = x.exp().hypot(filters[i]);
            kept *= x.exp() / wider;
            *x = wider.ln();
        }
        let logit = &mut p[10 * n + i];
        let opacity = kept / (1.0 + (-*logit).exp());
        *logit = (opacity / (1.0 - opacity)).ln();
    }
}

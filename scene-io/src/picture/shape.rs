//! Shapes of images.

use crate::Size;

/// Whether two image sizes differ by one scale only, up to the rounding of each side to whole pixels.
pub(crate) fn same_shape(a: Size, b: Size) -> bool {
    let sides = |size: Size| (f64::from(size.width), f64::from(size.height));
    let ((aw, ah), (bw, bh)) = (sides(a), sides(b));
    if [aw, ah, bw, bh].iter().any(|x| *x < 1.0) {
        return false;
    }
    let (small, large) = if aw.max(ah) <= bw.max(bh) { ((aw, ah), (bw, bh)) } else { ((bw, bh), (aw, ah)) };
    let scale = small.0.max(small.1) / large.0.max(large.1);
    (large.0 * scale - small.0).abs() <= 1.0 && (large.1 * scale - small.1).abs() <= 1.0
}

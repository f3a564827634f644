//! How sharp a picture is, to choose among frames that show nearly the same.

use image::{DynamicImage, GrayImage};

/// Longest side at which sharpness is measured, pixels: noise and compression count less, motion blur still shows.
const SIDE: u32 = 480;

/// Mean squared Laplacian of the brightness, in squared levels of 255, at a longest side of at most 480 pixels.
///
/// Comparable between frames of one video only: it depends on what is seen.
pub(crate) fn sharpness(picture: &DynamicImage) -> f64 {
    let grey = if picture.width().max(picture.height()) > SIDE {
        picture.thumbnail(SIDE, SIDE).into_luma8()
    } else {
        picture.to_luma8()
    };
    laplacian_energy(&grey)
}

/// The mean over inner pixels of `(4 p - left - right - above - below)^2`; 0 where there are none.
fn laplacian_energy(grey: &GrayImage) -> f64 {
    let (width, height) = (grey.width() as usize, grey.height() as usize);
    if width < 3 || height < 3 {
        return 0.0;
    }
    let rows: Vec<&[u8]> = grey.as_raw().chunks_exact(width).collect();
    let mut sum = 0_i64;
    for three in rows.windows(3) {
        for x in 1..width - 1 {
            let at = |row: usize, x: usize| i64::from(three[row][x]);
            let l = 4 * at(1, x) - at(1, x - 1) - at(1, x + 1) - at(0, x) - at(2, x);
            sum += l * l;
        }
    }
    sum as f64 / ((width - 2) * (height - 2)) as f64
}

/// The sharpest of each of `windows` stretches of equal length; all where there are not more. Indices, ascending.
pub(crate) fn sharpest_of_windows(sharpness: &[f64], windows: usize) -> Vec<usize> {
    let n = sharpness.len();
    if n <= windows {
        return (0..n).collect();
    }
    let edge = |w: usize| w * n / windows;
    let best = |w: usize| (edge(w)..edge(w + 1)).max_by(|a, b| sharpness[*a].total_cmp(&sharpness[*b]).then(b.cmp(a)));
    (0..windows).filter_map(best).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Luma, RgbImage};

    fn checks() -> GrayImage {
        GrayImage::from_fn(64, 48, |x, y| Luma([if (x / 4 + y / 4) % 2 == 0 { 40 } else { 200 }]))
    }

    #[test]
    fn blur_lowers_sharpness() {
        let sharp = DynamicImage::from(checks());
        let energies: Vec<f64> = [0.0, 1.0, 2.0, 4.0]
            .map(|sigma| if sigma > 0.0 { sharpness(&sharp.blur(sigma)) } else { sharpness(&sharp) })
            .to_vec();
        assert!(energies.windows(2).all(|pair| pair[1] < 0.7 * pair[0]), "{energies:?}");
    }

    #[test]
    fn flat_and_tiny_pictures_have_none() {
        assert_eq!(sharpness(&RgbImage::from_pixel(50, 50, image::Rgb([9, 9, 9])).into()), 0.0);
        assert_eq!(sharpness(&RgbImage::new(2, 50).into()), 0.0);
        // One bright pixel: (4^2 + 4 * 1) * 100^2 over 9 inner pixels.
        let mut dot = GrayImage::new(5, 5);
        dot.put_pixel(2, 2, Luma([100]));
        assert!((laplacian_energy(&dot) - 200_000.0 / 9.0).abs() < 1e-9);
    }

    #[test]
    fn each_window_gives_its_sharpest() {
        assert_eq!(sharpest_of_windows(&[1.0, 5.0, 2.0, 9.0, 9.0, 3.0], 3), [1, 3, 4]);
        assert_eq!(sharpest_of_windows(&[1.0, 2.0], 5), [0, 1]);
        assert!(sharpest_of_windows(&[], 5).is_empty());
        assert_eq!(sharpest_of_windows(&[3.0, f64::NAN, 1.0, 1.0], 1).len(), 1);
    }
}

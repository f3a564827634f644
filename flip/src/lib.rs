//! FLIP: the difference a person sees when two pictures alternate in place, bound to its reference implementation.
//!
//! * `mean_flip`: the mean over all pixels, 0 for equal pictures.
//! * `FlipError`: a pair of images that FLIP is not defined for.
//!
//! # Features
//! * `reference`: the reference implementation, which needs a C++ compiler to build. Without it this crate is empty, so that
//!   others can depend on it and leave the choice to their users.
//!
//! ```
//! # #[cfg(feature = "reference")]
//! # fn main() -> Result<(), flip::FlipError> {
//! // Two grey pictures of 32 x 32 pixels.
//! let (reference, test) = (vec![128; 32 * 32 * 3], vec![160; 32 * 32 * 3]);
//! let difference = flip::mean_flip(32, 32, &reference, &test)?;
//! assert!(0.0 < difference && difference < 1.0);
//! # Ok(())
//! # }
//! # #[cfg(not(feature = "reference"))]
//! # fn main() {}
//! ```

#![cfg(feature = "reference")]
#![forbid(unsafe_code)]

use nv_flip::{DEFAULT_PIXELS_PER_DEGREE, FlipImageRgb8};

/// A pair of images that FLIP is not defined for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FlipError {
    /// An image does not hold `width * height * 3` bytes.
    #[error("the {which} image holds {got} bytes, {want} make an RGB image of its size")]
    Shape {
        /// `reference` or `test`.
        which: &'static str,
        /// Bytes it should hold.
        want: usize,
        /// Bytes it holds.
        got: usize,
    },
    /// An image without pixels, or with more than FLIP counts.
    #[error("FLIP needs images of 1 to {} pixels, these are {width}x{height}", MAX_PIXELS)]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// The library counts bytes of an RGB image in 32 bits, signed in places.
const MAX_PIXELS: u64 = i32::MAX as u64 / 3;

/// Mean FLIP of two RGB images (8 bit sRGB, rows top to bottom, interleaved): 0 for equal ones, at most 1.
///
/// Viewing conditions are the library's default, 67 pixels a degree: 0.7 m from a 0.7 m wide screen of 3840 pixels.
///
/// # Errors
/// [`FlipError`] where the bytes are not two images of this size.
///
/// # Source
/// Andersson et al., "FLIP: a difference evaluator for alternating images", 2020.
pub fn mean_flip(width: u32, height: u32, reference: &[u8], test: &[u8]) -> Result<f64, FlipError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MAX_PIXELS {
        return Err(FlipError::Size { width, height });
    }
    let want = pixels as usize * 3;
    let image = |which, data: &[u8]| {
        if data.len() != want {
            return Err(FlipError::Shape { which, want, got: data.len() });
        }
        Ok(FlipImageRgb8::with_data(width, height, data))
    };
    let map = nv_flip::flip(image("reference", reference)?, image("test", test)?, DEFAULT_PIXELS_PER_DEGREE).to_vec();
    Ok(map.iter().map(|&x| f64::from(x)).sum::<f64>() / map.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(w: usize, h: usize, shift: usize) -> Vec<u8> {
        (0..w * h * 3).map(|i| ((i / 3 % w + shift) * 37 + i / (3 * w) * 11 + i % 3 * 50) as u8).collect()
    }

    #[test]
    fn equal_images_differ_by_nothing() {
        let a = picture(40, 30, 0);
        assert_eq!(mean_flip(40, 30, &a, &a), Ok(0.0));
    }

    #[test]
    fn larger_differences_are_seen_more() {
        let a = vec![128_u8; 32 * 32 * 3];
        let flip = |v: u8| mean_flip(32, 32, &a, &vec![v; 32 * 32 * 3]).unwrap();
        let (faint, plain, gross) = (flip(132), flip(160), flip(255));
        assert!(0.0 < faint && faint < plain && plain < gross && gross <= 1.0, "{faint} {plain} {gross}");
        let moved = mean_flip(40, 30, &picture(40, 30, 0), &picture(40, 30, 3)).unwrap();
        assert!((0.0..=1.0).contains(&moved) && moved > 0.1, "{moved}");
    }

    #[test]
    fn black_against_white_is_the_largest_difference() {
        // The library's own documentation: the error lies in [0, 1], and these two are its end.
        let flip = mean_flip(16, 16, &[0; 768], &[255; 768]).unwrap();
        assert!((0.9..=1.0).contains(&flip), "{flip}");
    }

    #[test]
    fn sizes_are_checked() {
        assert_eq!(mean_flip(0, 5, &[], &[]), Err(FlipError::Size { width: 0, height: 5 }));
        assert!(matches!(mean_flip(u32::MAX, u32::MAX, &[], &[]), Err(FlipError::Size { .. })));
        let error = mean_flip(2, 2, &[0; 12], &[0; 11]).unwrap_err();
        assert_eq!(error.to_string(), "the test image holds 11 bytes, 12 make an RGB image of its size");
        assert!(mean_flip(1, 1, &[1, 2, 3], &[3, 2, 1]).unwrap() > 0.0, "a single pixel is an image");
    }
}

//! Rotations of SPZ: three components of a unit quaternion, the fourth from its length.
//!
//! Version 3: a `u32`, top two bits which of x, y, z, w is largest, then the other three in that order, 10 bits each: sign
//! and `round(abs(c) sqrt(2) 511)`. Version 2: x, y, z as `127.5 c + 127.5`, w not negative.

use std::f64::consts::FRAC_1_SQRT_2;

/// Steps from 0 to `1 / sqrt(2)`, beyond which only the largest component can be.
const STEPS: f64 = 511.0;

/// Version 3 of a unit quaternion.
pub(super) fn pack(wxyz: [f64; 4]) -> [u8; 4] {
    let [w, x, y, z] = wxyz;
    let q = [x, y, z, w];
    let largest = (1..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
    let mut word = largest as u32;
    for (_, c) in q.iter().enumerate().filter(|(i, _)| *i != largest) {
        // `-q` is the same rotation: the largest is taken as positive.
        let c = c * q[largest].signum();
        let negative = c < 0.0;
        let magnitude = (c.abs() / FRAC_1_SQRT_2 * STEPS).round().min(STEPS) as u32;
        word = word << 10 | u32::from(negative) << 9 | magnitude;
    }
    word.to_le_bytes()
}

/// Version 3.
pub(super) fn unpack(bytes: [u8; 4]) -> [f64; 4] {
    let word = u32::from_le_bytes(bytes);
    let largest = (word >> 30) as usize;
    let mut q = [0.0; 4];
    let mut shift = 30;
    let mut sum = 0.0;
    for (_, c) in q.iter_mut().enumerate().filter(|(i, _)| *i != largest) {
        shift -= 10;
        let bits = word >> shift;
        let magnitude = f64::from(bits & 511) / STEPS * FRAC_1_SQRT_2;
        *c = if bits & 512 == 0 { magnitude } else { -magnitude };
        sum += magnitude * magnitude;
    }
    q[largest] = (1.0_f64 - sum).max(0.0).sqrt();
    unit(q)
}

/// Version 2.
pub(super) fn unpack_bytes(bytes: [u8; 3]) -> [f64; 4] {
    let [x, y, z] = bytes.map(|b| f64::from(b) / 127.5 - 1.0);
    unit([x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()])
}

/// `wxyz` with length 1: bytes that nobody wrote may say more than the length allows.
fn unit(xyzw: [f64; 4]) -> [f64; 4] {
    let [x, y, z, w] = xyzw;
    // At least one: the fourth component makes up for what the others lack.
    let norm = xyzw.iter().map(|c| c * c).sum::<f64>().sqrt();
    [w, x, y, z].map(|c| c / norm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn words_written_by_hand_are_read() {
        // w is largest; y negative at full magnitude, x and z zero.
        let word = 3_u32 << 30 | (512 | 511) << 10;
        let q = unpack(word.to_le_bytes());
        let want = [FRAC_1_SQRT_2, 0.0, -FRAC_1_SQRT_2, 0.0];
        assert!(q.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-12), "{q:?}");
        assert_eq!(pack([0.0, -1.0, 0.0, 0.0]), [0; 4]);
        assert_eq!(pack([-0.6, 0.0, 0.0, 0.8]), (2_u32 << 30 | 512 | 434).to_le_bytes());
    }

    proptest! {
        #![proptest_config(testkit::property::cases(256))]

        #[test]
        fn rotations_keep_half_a_step(q in prop::array::uniform4(-1.0..1.0_f64)) {
            let norm = q.iter().map(|c| c * c).sum::<f64>().sqrt();
            prop_assume!(norm > 1e-3);
            let q = q.map(|c| c / norm);
            let got = unpack(pack(q));
            let largest = (0..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
            for i in (0..4).filter(|i| *i != largest) {
                let want = q[i] * q[largest].signum();
                prop_assert!((got[i] - want).abs() <= 0.5 * FRAC_1_SQRT_2 / STEPS + 1e-12);
            }
        }

        #[test]
        fn any_bytes_are_a_rotation(word: u32, bytes: [u8; 3]) {
            for q in [unpack(word.to_le_bytes()), unpack_bytes(bytes)] {
                prop_assert!((q.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-12, "{q:?}");
            }
        }
    }
}

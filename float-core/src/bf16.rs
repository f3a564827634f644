//! A token for products of bf16 pairs.

use crate::Simd;
#[cfg(target_arch = "x86_64")]
use crate::SimdLevel;

/// Proof that this CPU has AVX512_BF16 (`vdpbf16ps`, `vcvtneps2bf16`) besides what [`SimdLevel::Avx512`](crate::SimdLevel)
/// promises. Cannot be forged: functions with `target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx512bf16")`
/// are safe to call where one is at hand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bf16(());

impl Bf16 {
    /// The token, if `simd` is the AVX-512 level and the CPU has the instructions. At lower levels `None`: a caller that asks
    /// for a lower level gets it in all its parts.
    #[inline]
    #[must_use]
    pub fn of(simd: Simd) -> Option<Self> {
        #[cfg(all(feature = "std", target_arch = "x86_64"))]
        let has = std::is_x86_feature_detected!("avx512bf16");
        #[cfg(all(not(feature = "std"), target_arch = "x86_64"))]
        let has = cfg!(target_feature = "avx512bf16");
        #[cfg(target_arch = "x86_64")]
        return (has && simd.level() == SimdLevel::Avx512).then_some(Self(()));
        #[cfg(not(target_arch = "x86_64"))]
        {
            let _ = simd;
            None
        }
    }
}

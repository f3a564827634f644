//! The features of one entry in registers.
//!
//! Left to itself the compiler turns the loops over sixteen samples into hardware gathers, which most CPUs take apart
//! into more work than one plain load for each entry. So on x86-64 an entry is a (baseline) SSE register.

/// `F` features that are loaded, weighted and stored together. Multiply and add round separately, lane by lane: every
/// implementation gives the same bits.
pub(crate) trait Features<const F: usize> {
    /// What holds them.
    type Reg: Copy;
    /// All 0.
    fn zero() -> Self::Reg;
    /// From separate numbers.
    fn pack(e: [f32; F]) -> Self::Reg;
    /// The features at `p`.
    ///
    /// # Safety
    /// `p` must be valid for reading `F` numbers; no alignment is needed.
    unsafe fn load(p: *const f32) -> Self::Reg;
    /// Write to `p`.
    ///
    /// # Safety
    /// `p` must be valid for writing `F` numbers; no alignment is needed.
    unsafe fn store(reg: Self::Reg, p: *mut f32);
    /// `a + w * b`.
    fn add_scaled(a: Self::Reg, w: f32, b: Self::Reg) -> Self::Reg;
    /// As separate numbers.
    fn unpack(reg: Self::Reg) -> [f32; F];
}

/// Picks the implementation.
pub(crate) struct Packed;

macro_rules! plain {
    ($($f:literal)+) => {$(
        impl Features<$f> for Packed {
            type Reg = [f32; $f];
            #[inline(always)]
            fn zero() -> Self::Reg {
                [0.0; $f]
            }
            #[inline(always)]
            fn pack(e: [f32; $f]) -> Self::Reg {
                e
            }
            #[inline(always)]
            unsafe fn load(p: *const f32) -> Self::Reg {
                // SAFETY: the caller vouches for `F` readable numbers; an array of f32 is aligned as f32.
                unsafe { p.cast::<[f32; $f]>().read_unaligned() }
            }
            #[inline(always)]
            unsafe fn store(reg: Self::Reg, p: *mut f32) {
                // SAFETY: the caller vouches for `F` writable numbers.
                unsafe { p.cast::<[f32; $f]>().write_unaligned(reg) }
            }
            #[inline(always)]
            fn add_scaled(a: Self::Reg, w: f32, b: Self::Reg) -> Self::Reg {
                core::array::from_fn(|f| a[f] + w * b[f])
            }
            #[inline(always)]
            fn unpack(reg: Self::Reg) -> [f32; $f] {
                reg
            }
        }
    )+};
}

plain! { 1 }
#[cfg(not(target_arch = "x86_64"))]
plain! { 2 4 6 8 }

#[cfg(target_arch = "x86_64")]
mod sse {
    use super::{Features, Packed};
    use core::arch::x86_64::*;

    // SAFETY (the arithmetic below): SSE2 is part of x86-64.

    #[inline(always)]
    fn zero() -> __m128 {
        // SAFETY: see the head of this module.
        unsafe { _mm_setzero_ps() }
    }

    #[inline(always)]
    fn pack(a: f32, b: f32, c: f32, d: f32) -> __m128 {
        // SAFETY: see the head of this module.
        unsafe { _mm_setr_ps(a, b, c, d) }
    }

    #[inline(always)]
    fn add_scaled(a: __m128, w: f32, b: __m128) -> __m128 {
        // SAFETY: see the head of this module.
        unsafe { _mm_add_ps(a, _mm_mul_ps(_mm_set1_ps(w), b)) }
    }

    /// The two numbers at `p` in the lower half, 0 above.
    ///
    /// # Safety
    /// `p` must be valid for reading two numbers; no alignment is needed.
    #[inline(always)]
    unsafe fn load_two(p: *const f32) -> __m128 {
        // SAFETY: eight bytes that the caller vouches for. Unlike `_mm_load_sd`, whose pointer to an f64 must be aligned as
        // such, this reads bytes.
        unsafe { _mm_castsi128_ps(_mm_loadu_si64(p.cast())) }
    }

    /// Write the lower two numbers to `p`.
    ///
    /// # Safety
    /// `p` must be valid for writing two numbers; no alignment is needed.
    #[inline(always)]
    unsafe fn store_two(reg: __m128, p: *mut f32) {
        // SAFETY: eight bytes that the caller vouches for; as in `load_two`, they are written as bytes.
        unsafe { _mm_storeu_si64(p.cast(), _mm_castps_si128(reg)) }
    }

    macro_rules! unpack {
        ($f:literal, $reg:expr) => {{
            let mut out = [0.0; $f];
            // SAFETY: `out` holds `F` numbers.
            unsafe { <Packed as Features<$f>>::store($reg, out.as_mut_ptr()) };
            out
        }};
    }

    impl Features<2> for Packed {
        type Reg = __m128;
        #[inline(always)]
        fn zero() -> __m128 {
            zero()
        }
        #[inline(always)]
        fn pack(e: [f32; 2]) -> __m128 {
            pack(e[0], e[1], 0.0, 0.0)
        }
        #[inline(always)]
        unsafe fn load(p: *const f32) -> __m128 {
            // SAFETY: as for `load_two`.
            unsafe { load_two(p) }
        }
        #[inline(always)]
        unsafe fn store(reg: __m128, p: *mut f32) {
            // SAFETY: as for `store_two`.
            unsafe { store_two(reg, p) }
        }
        #[inline(always)]
        fn add_scaled(a: __m128, w: f32, b: __m128) -> __m128 {
            add_scaled(a, w, b)
        }
        #[inline(always)]
        fn unpack(reg: __m128) -> [f32; 2] {
            unpack!(2, reg)
        }
    }

    impl Features<4> for Packed {
        type Reg = __m128;
        #[inline(always)]
        fn zero() -> __m128 {
            zero()
        }
        #[inline(always)]
        fn pack(e: [f32; 4]) -> __m128 {
            pack(e[0], e[1], e[2], e[3])
        }
        #[inline(always)]
        unsafe fn load(p: *const f32) -> __m128 {
            // SAFETY: four numbers that the caller vouches for, unaligned load.
            unsafe { _mm_loadu_ps(p) }
        }
        #[inline(always)]
        unsafe fn store(reg: __m128, p: *mut f32) {
            // SAFETY: four numbers that the caller vouches for, unaligned store.
            unsafe { _mm_storeu_ps(p, reg) }
        }
        #[inline(always)]
        fn add_scaled(a: __m128, w: f32, b: __m128) -> __m128 {
            add_scaled(a, w, b)
        }
        #[inline(always)]
        fn unpack(reg: __m128) -> [f32; 4] {
            unpack!(4, reg)
        }
    }

    impl Features<6> for Packed {
        type Reg = [__m128; 2];
        #[inline(always)]
        fn zero() -> [__m128; 2] {
            [zero(); 2]
        }
        #[inline(always)]
        fn pack(e: [f32; 6]) -> [__m128; 2] {
            [pack(e[0], e[1], e[2], e[3]), pack(e[4], e[5], 0.0, 0.0)]
        }
        #[inline(always)]
        unsafe fn load(p: *const f32) -> [__m128; 2] {
            // SAFETY: four numbers and two more that the caller vouches for; neither load needs alignment.
            unsafe { [_mm_loadu_ps(p), load_two(p.add(4))] }
        }
        #[inline(always)]
        unsafe fn store(reg: [__m128; 2], p: *mut f32) {
            // SAFETY: four numbers and two more that the caller vouches for; neither store needs alignment.
            unsafe {
                _mm_storeu_ps(p, reg[0]);
                store_two(reg[1], p.add(4));
            }
        }
        #[inline(always)]
        fn add_scaled(a: [__m128; 2], w: f32, b: [__m128; 2]) -> [__m128; 2] {
            [add_scaled(a[0], w, b[0]), add_scaled(a[1], w, b[1])]
        }
        #[inline(always)]
        fn unpack(reg: [__m128; 2]) -> [f32; 6] {
            unpack!(6, reg)
        }
    }

    impl Features<8> for Packed {
        type Reg = [__m128; 2];
        #[inline(always)]
        fn zero() -> [__m128; 2] {
            [zero(); 2]
        }
        #[inline(always)]
        fn pack(e: [f32; 8]) -> [__m128; 2] {
            [pack(e[0], e[1], e[2], e[3]), pack(e[4], e[5], e[6], e[7])]
        }
        #[inline(always)]
        unsafe fn load(p: *const f32) -> [__m128; 2] {
            // SAFETY: eight numbers that the caller vouches for, unaligned loads.
            unsafe { [_mm_loadu_ps(p), _mm_loadu_ps(p.add(4))] }
        }
        #[inline(always)]
        unsafe fn store(reg: [__m128; 2], p: *mut f32) {
            // SAFETY: eight numbers that the caller vouches for, unaligned stores.
            unsafe {
                _mm_storeu_ps(p, reg[0]);
                _mm_storeu_ps(p.add(4), reg[1]);
            }
        }
        #[inline(always)]
        fn add_scaled(a: [__m128; 2], w: f32, b: [__m128; 2]) -> [__m128; 2] {
            [add_scaled(a[0], w, b[0]), add_scaled(a[1], w, b[1])]
        }
        #[inline(always)]
        fn unpack(reg: [__m128; 2]) -> [f32; 8] {
            unpack!(8, reg)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Features, Packed};

    #[repr(align(16))]
    struct Aligned([f32; 12]);

    fn check<const F: usize>()
    where
        Packed: Features<F>,
    {
        let a: [f32; F] = core::array::from_fn(|f| 0.1 + f as f32);
        let b: [f32; F] = core::array::from_fn(|f| 0.7 * f as f32 - 1.0);
        // Every place that an f32 may have: 4, 8 and 12 bytes past a multiple of 16. A load or store that needs more than
        // that is undefined at most of them, though the CPU may not mind: Miri sees it, and `clippy.toml` refuses the
        // functions of `core::arch` that do so.
        for at in 1..4 {
            let mut aligned = Aligned([9.0; 12]);
            let memory = &mut aligned.0;
            memory[at..at + F].copy_from_slice(&b);
            // SAFETY: `F <= 8` numbers follow `at <= 3`, of twelve.
            let got = unsafe {
                let b = Packed::load(memory.as_ptr().add(at));
                let sum = Packed::add_scaled(Packed::add_scaled(Packed::zero(), 1.0, Packed::pack(a)), 0.3, b);
                Packed::store(sum, memory.as_mut_ptr().add(at));
                Packed::unpack(sum)
            };
            for f in 0..F {
                assert_eq!(got[f], a[f] + 0.3 * b[f]);
                assert_eq!(memory[at + f], got[f]);
            }
            assert_eq!((memory[at - 1], memory[at + F]), (9.0, 9.0), "stores leave the neighbours alone");
        }
    }

    /// What a NaN carries survives being loaded and stored: nothing is quieted on the way.
    fn check_bits<const F: usize>()
    where
        Packed: Features<F>,
    {
        let odd =
            [0x7fa0_1234, 0xffc0_0001, 0x0000_0001, 0x8000_0000, 0x7f80_0000, 0xff80_0001, 0x7f7f_ffff, 0x3f80_0000];
        let from: [f32; 8] = odd.map(f32::from_bits);
        let mut to = [0.0; 8];
        // SAFETY: both hold `F <= 8` numbers.
        unsafe { Packed::store(Packed::load(from.as_ptr()), to.as_mut_ptr()) };
        assert_eq!(to.map(f32::to_bits)[..F], odd[..F]);
    }

    #[test]
    fn packed_features_do_what_plain_numbers_do() {
        check::<1>();
        check::<2>();
        check::<4>();
        check::<6>();
        check::<8>();
    }

    #[test]
    fn packed_features_keep_every_bit() {
        check_bits::<1>();
        check_bits::<2>();
        check_bits::<4>();
        check_bits::<6>();
        check_bits::<8>();
    }
}

//! Unrolled construction of small arrays of SIMD vectors.

/// `[e(0), e(1), ..]`: each element in place.
///
/// `core::array::from_fn` does not serve here: a closure is compiled without the `target_feature` of the function around it, so each
/// vector operation becomes a call, and projection was several times slower.
macro_rules! each {
    (2, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1) };
    (3, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2) };
    (4, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2 3) };
    (5, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2 3 4) };
    (7, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2 3 4 5 6) };
    (@ $k:ident, $e:expr, $($n:literal)+) => { [$({ let $k = $n; $e }),+] };
}

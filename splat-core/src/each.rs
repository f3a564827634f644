//! Small arrays of vectors, written out.

/// `[e(0), e(1), ..]`: each element in place.
///
/// A closure is a function of its own, which does not know of the SIMD level around it: handed to `core::array::from_fn` it calls
/// every vector operation where it should be one, and projection took several times as long.
macro_rules! each {
    (2, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1) };
    (3, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2) };
    (4, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2 3) };
    (5, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2 3 4) };
    (7, |$k:ident| $e:expr) => { each!(@ $k, $e, 0 1 2 3 4 5 6) };
    (@ $k:ident, $e:expr, $($n:literal)+) => { [$({ let $k = $n; $e }),+] };
}

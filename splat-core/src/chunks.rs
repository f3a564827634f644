//! Loops over independent pieces: on threads with the feature `rayon`, in order without it. The results are the same bits.

/// `work(k, &mut pieces[k])` for all pieces.
#[cfg(feature = "rayon")]
pub(crate) fn for_each<T: Send>(pieces: &mut [T], work: impl Fn(usize, &mut T) + Send + Sync) {
    use rayon::prelude::*;
    pieces.par_iter_mut().enumerate().for_each(|(k, piece)| work(k, piece));
}

/// `work(k, &mut pieces[k])` for all pieces.
#[cfg(not(feature = "rayon"))]
pub(crate) fn for_each<T>(pieces: &mut [T], work: impl Fn(usize, &mut T)) {
    pieces.iter_mut().enumerate().for_each(|(k, piece)| work(k, piece));
}

/// Runs two independent closures, on two threads where possible.
#[cfg(feature = "rayon")]
pub(crate) fn both<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Runs two independent closures, on two threads where possible.
#[cfg(not(feature = "rayon"))]
pub(crate) fn both<A, B>(a: impl FnOnce() -> A, b: impl FnOnce() -> B) -> (A, B) {
    (a(), b())
}

//! Which picture a step is of.

use field_core::rng::Rng;

/// The picture of a step: each of `pictures` once, in an order of its own, before any comes again.
pub(super) fn turn(rng: Rng, step: u64, pictures: usize) -> usize {
    let n = pictures as u64;
    let rng = rng.substream(step / n);
    let mut order: Vec<u32> = (0..pictures as u32).collect();
    for i in (1..pictures).rev() {
        order.swap(i, rng.below_at(i as u64, i as u32 + 1) as usize);
    }
    order[(step % n) as usize] as usize
}

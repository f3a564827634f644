//! Pixels that hang together.

use super::extent::Extent;
use crate::LossError;
use alloc::vec::Vec;

/// Take the set of `waiting` pixels that hangs together with `seed` (8 neighbours) out of them and into `component`, the seed
/// first; none where the seed does not wait or lies outside.
///
/// # Shapes and units
/// * `waiting` `[height][width]`; `component` indices into it, written
///
/// # Errors
/// [`LossError::Shape`] where `waiting` is not as large as the image.
pub fn take_component(
    extent: Extent,
    seed: usize,
    waiting: &mut [bool],
    component: &mut Vec<u32>,
) -> Result<(), LossError> {
    extent.check("waiting", waiting.len())?;
    component.clear();
    if waiting.get_mut(seed).is_some_and(core::mem::take) {
        component.push(seed as u32);
    }
    // The list is queue and result at once.
    let mut next = 0;
    while let Some(&i) = component.get(next) {
        next += 1;
        let (y, x) = (i as usize / extent.width, i as usize % extent.width);
        for y in y.saturating_sub(1)..(y + 2).min(extent.height) {
            for x in x.saturating_sub(1)..(x + 2).min(extent.width) {
                let j = y * extent.width + x;
                if core::mem::take(&mut waiting[j]) {
                    component.push(j as u32);
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use alloc::vec;

    #[test]
    fn corners_join_and_what_is_taken_waits_no_more() {
        let extent = Extent { width: 4, height: 3 };
        // # . . #
        // . # . .
        // . . . #
        let mut waiting = vec![false; 12];
        [0, 3, 5, 11].into_iter().for_each(|i: usize| waiting[i] = true);
        let mut component = vec![7];
        take_component(extent, 5, &mut waiting, &mut component).unwrap();
        assert_eq!(component, [5, 0]);
        take_component(extent, 0, &mut waiting, &mut component).unwrap();
        assert!(component.is_empty(), "taken");
        // The end of a row is not a neighbour of the beginning of the next.
        take_component(extent, 3, &mut waiting, &mut component).unwrap();
        assert_eq!(component, [3]);
        take_component(extent, 12, &mut waiting, &mut component).unwrap();
        assert!(component.is_empty(), "outside");
        assert_eq!(waiting.iter().filter(|w| **w).count(), 1);
        assert!(matches!(
            take_component(extent, 0, &mut [true], &mut component),
            Err(LossError::Shape { want: 12, got: 1, .. })
        ));
        take_component(Extent { width: 0, height: 0 }, 0, &mut [], &mut component).unwrap();
        assert!(component.is_empty());
    }
}

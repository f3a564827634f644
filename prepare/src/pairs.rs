//! Which frames of a long video are compared besides neighbours: without these pairs, a path that comes back to where it began
//! does not close.

/// Frames up to which all pairs are compared.
pub(crate) const ALL_PAIRS: usize = 100;
/// Frames, spread over the video, of which all pairs are compared.
const SPREAD: usize = 40;
/// Frames after each that it is compared with, where pairs are chosen here: COLMAP's sequential matcher chooses by itself.
#[cfg(feature = "sfm")]
const NEIGHBOURS: usize = 10;

/// All pairs of about 40 frames at equal distances; indices, the smaller first, ascending.
pub(crate) fn loop_closures(frames: usize) -> Vec<(usize, usize)> {
    let count = SPREAD.min(frames);
    let spread: Vec<usize> = (0..count).map(|i| i * frames / count.max(1)).collect();
    let pairs = spread.iter().enumerate().flat_map(|(i, a)| spread[i + 1..].iter().map(move |b| (*a, *b)));
    pairs.collect()
}

/// Neighbours up to 10 frames on, those 16, 32 … 512 frames on, and [`loop_closures`].
#[cfg(feature = "sfm")]
pub(crate) fn of_video(frames: usize) -> Vec<(usize, usize)> {
    let far = (4..10).map(|power| 1_usize << power);
    let steps: Vec<usize> = (1..=NEIGHBOURS).chain(far).collect();
    let near = (0..frames).flat_map(|a| steps.iter().map(move |step| (a, a + step)));
    let mut pairs: Vec<(usize, usize)> = near.filter(|(_, b)| *b < frames).chain(loop_closures(frames)).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closures_join_the_ends_and_are_few() {
        let pairs = loop_closures(300);
        assert_eq!(pairs.len(), 40 * 39 / 2);
        assert!(pairs.iter().all(|(a, b)| a < b && *b < 300));
        assert!(pairs.iter().any(|(a, b)| *a < 10 && *b > 285));
        assert_eq!(loop_closures(2), [(0, 1)]);
        assert!(loop_closures(0).is_empty());
    }

    #[cfg(feature = "sfm")]
    #[test]
    fn pairs_of_a_video_hold_all_neighbours() {
        let pairs = of_video(150);
        assert!((0..149).all(|a| pairs.contains(&(a, a + 1))));
        assert!(pairs.len() < 150 * 149 / 4, "{}", pairs.len());
    }
}

//! Segments as a segmenter without mistakes would draw them: each piece of the occluders is one, the rest is cut into squares.
//!
//! Squares as large as the things of the place stand for its own segments: a segment is called an occluder as a whole, so
//! large ones keep what lies in an occluder's shadow, small ones lose it.

use crate::error::BenchError;
use image::{ImageBuffer, Luma};
use losses::heuristics::{Extent, take_component};
use scene_io::{Scene, Split};
use std::path::Path;

/// Write a label map for each training photo whose occluders are known, and let the photo name it.
pub(super) fn write(scene: &mut Scene, square: usize, folder: &Path) -> Result<(), BenchError> {
    for (i, frame) in scene.frames.iter_mut().enumerate().filter(|(_, f)| f.split == Split::Train) {
        let Some(truth) = frame.read_transient().map_err(BenchError::part)? else { continue };
        let (width, height) = (truth.width(), truth.height());
        let occluders: Vec<bool> = truth.iter().collect();
        let extent = Extent { width: width as usize, height: height as usize };
        let labels = outlines(extent, &occluders, square)?;
        let path = folder.join(format!("{i}.segs.png"));
        let map = ImageBuffer::<Luma<u16>, _>::from_raw(width, height, labels)
            .ok_or_else(|| BenchError::Part(format!("segments of `{}` do not fill it", frame.name)))?;
        map.save(&path).map_err(BenchError::part)?;
        frame.priors.segments = Some(path);
    }
    Ok(())
}

/// Labels of squares, and above them labels of the pieces of `occluders` that hang together.
fn outlines(extent: Extent, occluders: &[bool], side: usize) -> Result<Vec<u16>, BenchError> {
    let width = extent.width;
    let across = width.div_ceil(side);
    let square = |i: usize| (i / width / side * across + i % width / side) as u16 + 1;
    let mut labels: Vec<u16> = (0..occluders.len()).map(square).collect();
    let mut next = labels.iter().max().map_or(1, |most| most + 1);
    let (mut left, mut piece) = (occluders.to_vec(), Vec::new());
    for seed in 0..left.len() {
        take_component(extent, seed, &mut left, &mut piece).map_err(BenchError::part)?;
        piece.iter().for_each(|&i| labels[i as usize] = next);
        next = next.saturating_add(u16::from(!piece.is_empty()));
    }
    Ok(labels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_have_labels_of_their_own_above_the_squares() {
        // Two squares side by side; a diagonal line across both, and one pixel apart from it.
        let (width, height) = (20, 4);
        let mut occluders = vec![false; width * height];
        for (x, y) in [(14, 0), (15, 1), (16, 2), (19, 3)] {
            occluders[y * width + x] = true;
        }
        let labels = outlines(Extent { width, height }, &occluders, 16).unwrap();
        assert_eq!((labels[0], labels[17]), (1, 2));
        assert_eq!((labels[14], labels[width + 15], labels[2 * width + 16]), (3, 3, 3));
        assert_eq!(labels[3 * width + 19], 4);
        assert_eq!(labels.iter().filter(|l| **l > 2).count(), 4);
        assert!(outlines(Extent { width: 4, height: 0 }, &[], 16).unwrap().is_empty());
    }
}

//! Segments as a segmenter without mistakes would draw them: each piece of the strangers is one, the rest is cut into squares.
//!
//! Squares as large as the things of the place stand for its own segments: a segment is called a stranger as a whole, so
//! large ones keep what lies in a stranger's shadow, small ones lose it.

use crate::error::BenchError;
use image::{ImageBuffer, Luma};
use scene_io::{Scene, Split};
use std::path::Path;

/// Write a label map for each training photo whose strangers are known, and let the photo name it.
pub(super) fn write(scene: &mut Scene, square: usize, folder: &Path) -> Result<(), BenchError> {
    for (i, frame) in scene.frames.iter_mut().enumerate().filter(|(_, f)| f.split == Split::Train) {
        let Some(truth) = frame.read_transient().map_err(BenchError::part)? else { continue };
        let (width, height) = (truth.width(), truth.height());
        let strangers: Vec<bool> = truth.iter().collect();
        let labels = outlines(&strangers, width as usize, square);
        let path = folder.join(format!("{i}.segs.png"));
        let map = ImageBuffer::<Luma<u16>, _>::from_raw(width, height, labels)
            .ok_or_else(|| BenchError::Part(format!("segments of `{}` do not fill it", frame.name)))?;
        map.save(&path).map_err(BenchError::part)?;
        frame.priors.segments = Some(path);
    }
    Ok(())
}

/// Labels of squares, and above them labels of the pieces of `strangers` that hang together.
fn outlines(strangers: &[bool], width: usize, side: usize) -> Vec<u16> {
    let across = width.div_ceil(side);
    let square = |i: usize| (i / width / side * across + i % width / side) as u16 + 1;
    let mut labels: Vec<u16> = (0..strangers.len()).map(square).collect();
    let mut next = labels.iter().max().map_or(1, |most| most + 1);
    let mut left = strangers.to_vec();
    for seed in 0..left.len() {
        let mut waiting = Vec::new();
        if std::mem::take(&mut left[seed]) {
            waiting.push(seed);
        }
        let is_piece = !waiting.is_empty();
        while let Some(i) = waiting.pop() {
            labels[i] = next;
            let (x, y) = (i % width, i / width);
            for y in y.saturating_sub(1)..(y + 2).min(left.len() / width) {
                for x in x.saturating_sub(1)..(x + 2).min(width) {
                    if std::mem::take(&mut left[y * width + x]) {
                        waiting.push(y * width + x);
                    }
                }
            }
        }
        next = next.saturating_add(u16::from(is_piece));
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_have_labels_of_their_own_above_the_squares() {
        // Two squares side by side; a diagonal line across both, and one pixel apart from it.
        let (width, height) = (20, 4);
        let mut strangers = vec![false; width * height];
        for (x, y) in [(14, 0), (15, 1), (16, 2), (19, 3)] {
            strangers[y * width + x] = true;
        }
        let labels = outlines(&strangers, width, 16);
        assert_eq!((labels[0], labels[17]), (1, 2));
        assert_eq!((labels[14], labels[width + 15], labels[2 * width + 16]), (3, 3, 3));
        assert_eq!(labels[3 * width + 19], 4);
        assert_eq!(labels.iter().filter(|l| **l > 2).count(), 4);
        assert!(outlines(&[], 4, 16).is_empty());
    }
}

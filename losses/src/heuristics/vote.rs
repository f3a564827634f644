//! Segments vote: static as a whole, or not at all.

use super::component::take_component;
use super::extent::Extent;
use crate::LossError;
use alloc::vec::Vec;

/// How a photo is cut into segments.
#[derive(Clone, Copy, Debug)]
pub enum Segments<'a> {
    /// No segments: every pixel for itself.
    Pixels,
    /// `[height][width]` label of each pixel; 0 is unassigned.
    Labels(&'a [u16]),
    /// A mask for each segment; they may overlap and leave pixels unassigned.
    Stack(&'a [&'a [u8]]),
}

/// Memory of [`vote`], kept from image to image.
#[derive(Clone, Debug, Default)]
pub struct VoteScratch {
    /// Pixels and static pixels of each label.
    counts: Vec<[u32; 2]>,
    /// Pixels that still wait for a segment.
    waiting: Vec<bool>,
    /// Pixels of one component.
    component: Vec<u32>,
}

/// Keep the segments of which at least the share `share` is static, whole; drop the others, whole.
///
/// Unassigned pixels are segments too: one for each set that hangs together (8 neighbours). Where segments overlap, one that is
/// kept is enough. Empty segments have no say.
///
/// # Shapes and units
/// * `mask` in; `share` `(0, 1]`, usually 0.5; `out` mask, written
///
/// # Errors
/// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for a share outside its range.
pub fn vote(
    extent: Extent,
    segments: Segments<'_>,
    mask: &[u8],
    share: f32,
    scratch: &mut VoteScratch,
    out: &mut [u8],
) -> Result<(), LossError> {
    extent.check("mask", mask.len())?;
    extent.check("out", out.len())?;
    if !(share > 0.0 && share <= 1.0) {
        let (what, range) = ("share of a segment", "above 0, at most 1");
        return Err(LossError::Parameter { what, value: share, range });
    }
    match segments {
        Segments::Pixels => out.iter_mut().zip(mask).for_each(|(out, &m)| *out = u8::from(m != 0)),
        Segments::Labels(labels) => {
            extent.check("labels", labels.len())?;
            by_label(labels, mask, share, scratch, out);
            components(extent, mask, share, scratch, out)?;
        }
        Segments::Stack(stack) => {
            for segment in stack {
                extent.check("segment", segment.len())?;
            }
            by_segment(stack, mask, share, scratch, out);
            components(extent, mask, share, scratch, out)?;
        }
    }
    Ok(())
}

/// Pixels without a label wait.
fn by_label(labels: &[u16], mask: &[u8], share: f32, scratch: &mut VoteScratch, out: &mut [u8]) {
    let counts = &mut scratch.counts;
    counts.clear();
    counts.resize(labels.iter().max().map_or(0, |&l| usize::from(l) + 1), [0; 2]);
    for (&label, &m) in labels.iter().zip(mask) {
        let count = &mut counts[usize::from(label)];
        count[0] += 1;
        count[1] += u32::from(m != 0);
    }
    scratch.waiting.clear();
    scratch.waiting.extend(labels.iter().map(|&label| label == 0));
    for (out, &label) in out.iter_mut().zip(labels) {
        *out = u8::from(label != 0 && wins(counts[usize::from(label)], share));
    }
}

/// Pixels of no segment wait.
fn by_segment(stack: &[&[u8]], mask: &[u8], share: f32, scratch: &mut VoteScratch, out: &mut [u8]) {
    out.fill(0);
    scratch.waiting.clear();
    scratch.waiting.resize(mask.len(), true);
    for segment in stack {
        let mut count = [0; 2];
        for (i, _) in segment.iter().enumerate().filter(|(_, s)| **s != 0) {
            count[0] += 1;
            count[1] += u32::from(mask[i] != 0);
            scratch.waiting[i] = false;
        }
        if wins(count, share) {
            out.iter_mut().zip(*segment).filter(|(_, s)| **s != 0).for_each(|(out, _)| *out = 1);
        }
    }
}

/// Each set of waiting pixels that hangs together votes.
fn components(
    extent: Extent,
    mask: &[u8],
    share: f32,
    scratch: &mut VoteScratch,
    out: &mut [u8],
) -> Result<(), LossError> {
    let VoteScratch { waiting, component, .. } = scratch;
    for seed in 0..waiting.len() {
        take_component(extent, seed, waiting, component)?;
        let kept = component.iter().map(|&i| u32::from(mask[i as usize] != 0)).sum();
        let value = u8::from(wins([component.len() as u32, kept], share));
        component.iter().for_each(|&i| out[i as usize] = value);
    }
    Ok(())
}

/// Whether the static share reaches the threshold; not for an empty segment.
fn wins([all, kept]: [u32; 2], share: f32) -> bool {
    // Divided and rounded as the threshold was: 3 of 5 reach 0.6.
    all > 0 && (f64::from(kept) / f64::from(all)) as f32 >= share
}

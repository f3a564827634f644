//! How well a mask of what moves was found: intersection over union of both classes, F1 of what moves.
//!
//! Masks are bytes, any value but 0 = **static**, as everywhere. The transient class is the one that counts as positive.

use super::MetricError;

/// Pixels by what they are and what they were taken for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Confusion {
    /// Transient, taken for transient.
    pub true_positive: u64,
    /// Static, taken for transient.
    pub false_positive: u64,
    /// Transient, taken for static.
    pub false_negative: u64,
    /// Static, taken for static.
    pub true_negative: u64,
}

/// What a class scores of which neither mask has a pixel. (Where one mask has some, the score is 0 by its formula.)
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum EmptyClass {
    /// 1: both say that there is nothing.
    #[default]
    One,
    /// 0.
    Zero,
    /// Nothing: it stays out of all means.
    LeftOut,
}

/// How scores of several images become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Average {
    /// The mean of the images' scores: every image counts alike.
    #[default]
    PerImage,
    /// The score of all images' pixels together: every pixel counts alike.
    Pooled,
}

/// Scores of masks, each in `[0, 1]`, or none where all of it was [left out](EmptyClass::LeftOut).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SegmentationScores {
    /// Intersection over union of what is static.
    pub iou_static: Option<f64>,
    /// Intersection over union of what is transient.
    pub iou_transient: Option<f64>,
    /// Mean of the two.
    pub miou: Option<f64>,
    /// `2 TP / (2 TP + FP + FN)` of what is transient.
    pub f1: Option<f64>,
}

impl Confusion {
    /// Compare a predicted mask with the true one.
    ///
    /// # Errors
    /// [`MetricError::Shape`] where lengths disagree.
    pub fn of(prediction: &[u8], truth: &[u8]) -> Result<Self, MetricError> {
        if prediction.len() != truth.len() {
            return Err(MetricError::Shape { what: "predicted mask", want: truth.len(), got: prediction.len() });
        }
        let mut out = Self::default();
        for (&p, &t) in prediction.iter().zip(truth) {
            match (p == 0, t == 0) {
                (true, true) => out.true_positive += 1,
                (true, false) => out.false_positive += 1,
                (false, true) => out.false_negative += 1,
                (false, false) => out.true_negative += 1,
            }
        }
        Ok(out)
    }

    /// Both, as if of one image.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            true_positive: self.true_positive + other.true_positive,
            false_positive: self.false_positive + other.false_positive,
            false_negative: self.false_negative + other.false_negative,
            true_negative: self.true_negative + other.true_negative,
        }
    }

    /// The scores of one image.
    #[must_use]
    pub fn scores(&self, empty: EmptyClass) -> SegmentationScores {
        let wrong = self.false_positive + self.false_negative;
        let iou_static = ratio(self.true_negative, self.true_negative + wrong, empty);
        let iou_transient = ratio(self.true_positive, self.true_positive + wrong, empty);
        SegmentationScores {
            iou_static,
            iou_transient,
            miou: mean([iou_static, iou_transient].into_iter()),
            f1: ratio(2 * self.true_positive, 2 * self.true_positive + wrong, empty),
        }
    }
}

/// The scores of several images; all none for no images.
///
/// Published tables of masks don't say how they average, and differ by several points with it: state both choices.
#[must_use]
pub fn segmentation(images: &[Confusion], average: Average, empty: EmptyClass) -> SegmentationScores {
    if images.is_empty() {
        return SegmentationScores { iou_static: None, iou_transient: None, miou: None, f1: None };
    }
    match average {
        Average::Pooled => images.iter().fold(Confusion::default(), |a, b| a.plus(*b)).scores(empty),
        Average::PerImage => {
            let of = |score: fn(SegmentationScores) -> Option<f64>| {
                mean(images.iter().map(|image| score(image.scores(empty))))
            };
            SegmentationScores {
                iou_static: of(|s| s.iou_static),
                iou_transient: of(|s| s.iou_transient),
                miou: of(|s| s.miou),
                f1: of(|s| s.f1),
            }
        }
    }
}

fn ratio(part: u64, of: u64, empty: EmptyClass) -> Option<f64> {
    match empty {
        _ if of > 0 => Some(part as f64 / of as f64),
        EmptyClass::One => Some(1.0),
        EmptyClass::Zero => Some(0.0),
        EmptyClass::LeftOut => None,
    }
}

/// Mean of those there are.
fn mean(scores: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let (total, count) = scores.flatten().fold((0.0, 0_u32), |(total, count), s| (total + s, count + 1));
    (count > 0).then(|| total / f64::from(count))
}

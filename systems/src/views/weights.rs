//! How much each pixel of a photo counts.

use scene_io::Image;

/// The photo of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepPhoto<'a> {
    /// Index of its view in the dataset.
    pub(crate) view: usize,
    /// At the size of the step, on the plane of its camera without a lens.
    pub(crate) image: &'a Image,
}

/// Weights of the pixels of a photo: 1 each until a part says otherwise.
#[derive(Clone, Debug, Default)]
pub(crate) struct Weights {
    values: Vec<f32>,
}

impl Weights {
    /// 1 each.
    pub(crate) fn begin(&mut self) {
        self.values.clear();
    }

    /// Take these for all pixels.
    pub(crate) fn set(&mut self, values: Vec<f32>) {
        self.values = values;
    }

    /// Multiply the weight of pixel `i` of `pixels` by `factor(i)`.
    pub(crate) fn multiply(&mut self, pixels: usize, factor: impl Fn(usize) -> f32) {
        if self.values.is_empty() {
            self.values.extend((0..pixels).map(factor));
        } else {
            self.values.iter_mut().enumerate().for_each(|(i, weight)| *weight *= factor(i));
        }
    }

    /// `[rows][columns]`; `None` where all pixels count alike.
    pub(crate) fn get(&self) -> Option<&[f32]> {
        (!self.values.is_empty()).then_some(&self.values[..])
    }

    /// Whether no pixel counts.
    pub(crate) fn are_zero(&self) -> bool {
        self.get().is_some_and(|weights| weights.iter().all(|w| *w == 0.0))
    }
}

/// A part that weighs pixels.
pub(crate) trait PixelWeight: Send + Sync {
    /// Multiply the weights of a photo's pixels.
    fn weigh(&self, photo: &StepPhoto<'_>, weights: &mut Weights);
}

/// The mask of the photo itself: 0 for what it leaves out.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct MaskWeight;

impl PixelWeight for MaskWeight {
    fn weigh(&self, photo: &StepPhoto<'_>, weights: &mut Weights) {
        if let Some(mask) = &photo.image.mask {
            weights.multiply(mask.len(), |i| if mask[i] >= 128 { 1.0 } else { 0.0 });
        }
    }
}

/// A weight of each pixel of some views: certainty, or what is not an occluder.
#[derive(Clone, Debug, Default)]
pub(crate) struct PlaneWeight {
    /// Of each view of the dataset; `None`: 1 each.
    pub(crate) planes: Vec<Option<WeightPlane>>,
}

/// Weights of a view's pixels.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct WeightPlane {
    /// Columns and rows; any, of the whole picture.
    pub(crate) size: [usize; 2],
    /// `[rows][columns]`, 0 or more.
    pub(crate) weights: Vec<f32>,
}

impl PixelWeight for PlaneWeight {
    fn weigh(&self, photo: &StepPhoto<'_>, weights: &mut Weights) {
        let Some(Some(plane)) = self.planes.get(photo.view) else { return };
        let size = [photo.image.width as usize, photo.image.height as usize];
        weights.multiply(size[0] * size[1], |i| {
            let at = nearest([i % size[0], i / size[0]], size, plane.size);
            plane.weights.get(at).copied().unwrap_or(0.0)
        });
    }
}

/// Row-major index of the entry of a plane of `of` entries at the centre of pixel `at` of a picture of `size`, both columns and rows.
pub(crate) fn nearest(at: [usize; 2], size: [usize; 2], of: [usize; 2]) -> usize {
    let [column, row] = [0, 1].map(|k| (2 * at[k] + 1) * of[k] / (2 * size[k].max(1)));
    row * of[0] + column
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_the_product_of_what_the_parts_say() {
        let mask = Some(vec![255, 0, 255, 255, 128, 127]);
        let image = Image { width: 3, height: 2, channels: 3, data: vec![0; 18], mask };
        let plane = WeightPlane { size: [1, 2], weights: vec![0.5, 3.0] };
        let parts: [&dyn PixelWeight; 2] = [&MaskWeight, &PlaneWeight { planes: vec![None, Some(plane)] }];
        let weights = |view, parts: &[&dyn PixelWeight]| {
            let mut weights = Weights::default();
            weights.begin();
            parts.iter().for_each(|part| part.weigh(&StepPhoto { view, image: &image }, &mut weights));
            weights
        };
        assert_eq!(weights(0, &parts).get().unwrap(), [1.0, 0.0, 1.0, 1.0, 1.0, 0.0]);
        assert_eq!(weights(1, &parts).get().unwrap(), [0.5, 0.0, 0.5, 3.0, 3.0, 0.0]);
        assert_eq!(weights(1, &parts[1..]).get().unwrap(), [0.5, 0.5, 0.5, 3.0, 3.0, 3.0]);
        assert!(weights(0, &parts[1..]).get().is_none() && weights(7, &[]).get().is_none());
        assert!(!weights(0, &parts).are_zero() && !weights(0, &[]).are_zero());
    }

    #[test]
    fn a_photo_whose_mask_leaves_nothing_does_not_count() {
        let image = Image { width: 1, height: 1, channels: 3, data: vec![0; 3], mask: Some(vec![0]) };
        let mut weights = Weights::default();
        MaskWeight.weigh(&StepPhoto { view: 0, image: &image }, &mut weights);
        assert!(weights.are_zero());
    }

    #[test]
    fn the_nearest_entry_is_the_one_at_the_centre_of_the_pixel() {
        let row: Vec<usize> = (0..7).map(|x| nearest([x, 0], [7, 1], [3, 2])).collect();
        assert_eq!(row, [3, 3, 4, 4, 4, 5, 5]);
        let down: Vec<usize> = (0..4).map(|y| nearest([1, y], [2, 4], [4, 2])).collect();
        assert_eq!(down, [3, 3, 7, 7]);
    }
}

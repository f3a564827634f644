//! Rendered depth is held to the shape of depth that another program estimated.

use super::{PictureTerm, TargetPicture};
use crate::views::planes::{PlaneBars, RenderedPicture};
use crate::views::weights::nearest;
use losses::LossError;
use losses::depth::pearson::pearson_backward;

/// How near is what a photo shows, up to a factor above 0 and a shift: larger is nearer.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Nearness {
    /// Columns and rows; any, of the whole picture.
    pub(crate) size: [usize; 2],
    /// `[rows][columns]`; not finite where nothing is known.
    pub(crate) values: Vec<f32>,
}

/// `factor * (1 - r)` with `r` the correlation of `(1 - T) / D` and what is known of a photo: `D` the composited depth, `T` the
/// transmittance. Over pixels that count ([`Self::COUNTS`]), that show something and of which something is known; nothing for fewer than
/// [`Self::FEWEST`].
///
/// # Source
/// Xu et al., "Wild-GS", 2024, depth regularisation, which prints `r` as the loss.
#[derive(Clone, Debug)]
pub(crate) struct DepthShapeTerm {
    factor: f32,
    /// Of each view of the dataset; `None` where there is none.
    maps: Vec<Option<Nearness>>,
    // Of the pixels that count: which they are, how near they are drawn, and estimated.
    at: Vec<usize>,
    drawn: Vec<f32>,
    known: Vec<f32>,
}

impl DepthShapeTerm {
    /// A pixel counts from this weight on.
    const COUNTS: f32 = 0.5;
    /// A pixel shows something from this opacity on.
    const SHOWS: f32 = 0.5;
    /// Fewer pixels have no shape.
    const FEWEST: usize = 64;

    pub(crate) fn new(factor: f32, maps: Vec<Option<Nearness>>) -> Self {
        Self { factor, maps, at: Vec::new(), drawn: Vec::new(), known: Vec::new() }
    }
}

impl PictureTerm for DepthShapeTerm {
    fn add(
        &mut self,
        picture: &RenderedPicture<'_>,
        target: &TargetPicture<'_>,
        bars: &mut PlaneBars,
        loss: &mut f64,
    ) -> Result<(), LossError> {
        let Self { factor, maps, at, drawn, known } = self;
        let (Some(depth), Some(Some(map))) = (picture.depth, maps.get(target.view)) else { return Ok(()) };
        let width = picture.size[0].max(1);
        at.clear();
        drawn.clear();
        known.clear();
        for (i, depth) in depth.iter().enumerate() {
            let opacity = 1.0 - picture.transmittance[i];
            let counts = target.weights.is_none_or(|weights| weights[i] > Self::COUNTS);
            if !counts || opacity < Self::SHOWS || *depth <= 0.0 {
                continue;
            }
            let Some(near) = map.values.get(nearest([i % width, i / width], picture.size, map.size)) else { continue };
            if near.is_finite() {
                at.push(i);
                drawn.push(opacity / depth);
                known.push(*near);
            }
        }
        let mut drawn_bar = vec![0.0; drawn.len()];
        let share = f64::from(*factor);
        *loss += share * pearson_backward(drawn, known, Self::FEWEST, share, &mut drawn_bar)?;
        let depth_bar = bars.depth();
        for ((i, near), bar) in at.iter().zip(&*drawn).zip(&drawn_bar) {
            depth_bar[*i] -= bar * near / depth[*i];
        }
        let transmittance_bar = bars.transmittance();
        for (i, bar) in at.iter().zip(&drawn_bar) {
            transmittance_bar[*i] -= bar / depth[*i];
        }
        Ok(())
    }

    fn reads_depth(&self) -> bool {
        true
    }

    fn bytes(&self) -> usize {
        self.maps.iter().flatten().map(|map| size_of_val(&map.values[..])).sum()
    }
}

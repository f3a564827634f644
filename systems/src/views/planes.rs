//! The planes of a rendered picture, and the gradients of a loss with respect to them.

use rayon::prelude::*;

/// Channels of a colour: the first features.
pub(crate) const COLOUR: usize = 3;
/// Pixels that one task takes.
pub(crate) const PIXELS: usize = 1 << 13;

/// Add what is behind a picture to three planes of its colours.
pub(crate) fn add_background(colour: &mut [f32], transmittance: &[f32], background: [f32; 3]) {
    for (plane, back) in colour.chunks_exact_mut(transmittance.len().max(1)).zip(background) {
        plane.par_chunks_mut(PIXELS).zip(transmittance.par_chunks(PIXELS)).for_each(|(plane, transmittance)| {
            plane.iter_mut().zip(transmittance).for_each(|(c, t)| *c += t * back);
        });
    }
}

/// What is composited besides colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PlaneLayout {
    /// Depth `z`: one plane after the colours.
    pub(crate) depth: bool,
    /// Planes of [extra rows](super::cloud::CloudParameters::extra), after depth.
    pub(crate) extras: usize,
    /// Colours before the appearance: three planes after the extra rows.
    pub(crate) plain: bool,
}

impl PlaneLayout {
    /// Number of features of a Gaussian.
    pub(crate) fn features(self) -> usize {
        self.first_plain() + if self.plain { COLOUR } else { 0 }
    }

    /// The feature that is the depth.
    pub(crate) fn depth_feature(self) -> Option<usize> {
        self.depth.then_some(COLOUR)
    }

    /// The feature that is the first extra row.
    pub(crate) fn first_extra(self) -> usize {
        COLOUR + usize::from(self.depth)
    }

    /// The first feature of the colours before the appearance.
    pub(crate) fn first_plain(self) -> usize {
        self.first_extra() + self.extras
    }

    /// The first features of the colours that the background is seen behind.
    pub(crate) fn over_background(self) -> impl Iterator<Item = usize> {
        [0].into_iter().chain(self.plain.then_some(self.first_plain()))
    }
}

/// A rendered picture: planes `[rows][columns]`, row by row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RenderedPicture<'a> {
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    /// `[3][pixels]`, over the background of the step.
    pub(crate) colour: &'a [f32],
    /// `[pixels]`, depths `z` of the Gaussians, composited as colours are, over nothing; internal units. Where a term asks.
    pub(crate) depth: Option<&'a [f32]>,
    /// `[extras][pixels]`, composited over nothing.
    pub(crate) extras: &'a [f32],
    /// `[3][pixels]`, colours before the appearance, over the background of the step. Where a term asks.
    pub(crate) plain: Option<&'a [f32]>,
    /// `[pixels]`, transmittance: the share of the background that is seen.
    pub(crate) transmittance: &'a [f32],
}

/// A kind of plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Colour,
    Depth,
    Extras,
    Plain,
    Transmittance,
}

/// Gradients of a loss with respect to the planes of a picture, in one piece `[features + 1][pixels]`. Those of a kind are zero as soon
/// as the first term asks for them, and cost nothing before.
#[derive(Clone, Debug, Default)]
pub(crate) struct PlaneBars {
    buffer: Vec<f32>,
    pixels: usize,
    /// Features of the picture, those that nothing reads included.
    features: usize,
    layout: PlaneLayout,
    used: [bool; 5],
}

impl PlaneBars {
    /// No gradient yet, for a picture of `features` planes and transmittance.
    pub(crate) fn begin(&mut self, pixels: usize, features: usize, layout: PlaneLayout) {
        (self.pixels, self.features, self.layout, self.used) = (pixels, features, layout, [false; 5]);
        self.buffer.resize((features + 1) * pixels, 0.0);
    }

    /// `[3][pixels]`, with respect to the colours over the background; to be added to.
    pub(crate) fn colour(&mut self) -> &mut [f32] {
        self.plane(Kind::Colour)
    }

    /// `[pixels]`, with respect to the depth; empty where depth is not drawn.
    pub(crate) fn depth(&mut self) -> &mut [f32] {
        self.plane(Kind::Depth)
    }

    /// `[extras][pixels]`.
    pub(crate) fn extras(&mut self) -> &mut [f32] {
        self.plane(Kind::Extras)
    }

    /// `[3][pixels]`, with respect to the colours before the appearance, over the background; empty where these are not drawn.
    pub(crate) fn plain(&mut self) -> &mut [f32] {
        self.plane(Kind::Plain)
    }

    /// `[pixels]`, with respect to the transmittance itself: what the background adds follows from the colours.
    pub(crate) fn transmittance(&mut self) -> &mut [f32] {
        self.plane(Kind::Transmittance)
    }

    /// Where a kind of plane lies.
    fn range(&self, kind: Kind) -> std::ops::Range<usize> {
        let (first, count) = match kind {
            Kind::Colour => (0, COLOUR),
            Kind::Depth => (COLOUR, usize::from(self.layout.depth)),
            Kind::Extras => (self.layout.first_extra(), self.layout.extras),
            Kind::Plain => (self.layout.first_plain(), if self.layout.plain { COLOUR } else { 0 }),
            Kind::Transmittance => (self.features, 1),
        };
        first * self.pixels..(first + count) * self.pixels
    }

    fn plane(&mut self, kind: Kind) -> &mut [f32] {
        let range = self.range(kind);
        let plane = &mut self.buffer[range];
        if !self.used[kind as usize] {
            self.used[kind as usize] = true;
            plane.fill(0.0);
        }
        plane
    }

    /// The gradient with respect to features and transmittance as they are composited: a background `b` was added to the colours as
    /// `transmittance * b`.
    pub(crate) fn composited(&mut self, background: [f32; 3]) -> &[f32] {
        let has_own = self.used[Kind::Transmittance as usize];
        for kind in [Kind::Colour, Kind::Depth, Kind::Extras, Kind::Plain] {
            self.plane(kind);
        }
        // Features that nothing reads.
        let rest = self.layout.features() * self.pixels..self.features * self.pixels;
        self.buffer[rest].fill(0.0);
        let n = self.pixels;
        let (features, transmittance) = self.buffer.split_at_mut(self.features * n);
        for (k, first) in self.layout.over_background().enumerate() {
            let [r, g, b] = [0, 1, 2].map(|c| &features[(first + c) * n..][..n]);
            let adds = has_own || k > 0;
            transmittance.par_iter_mut().with_min_len(PIXELS).enumerate().for_each(|(i, bar)| {
                let behind = r[i] * background[0] + g[i] * background[1] + b[i] * background[2];
                *bar = if adds { *bar + behind } else { behind };
            });
        }
        &self.buffer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradients_begin_at_zero_whatever_was_there_and_the_background_s_is_added() {
        let layout = PlaneLayout { depth: true, extras: 2, plain: false };
        assert_eq!((layout.features(), layout.depth_feature(), layout.first_extra()), (6, Some(3), 4));
        let mut bars = PlaneBars::default();
        bars.begin(2, 8, layout);
        bars.buffer.fill(f32::NAN);
        bars.begin(2, 8, layout);
        assert!(bars.composited([1.0; 3]).iter().all(|g| *g == 0.0), "no term, no gradient");
        bars.buffer.fill(f32::NAN);
        bars.begin(2, 8, layout);
        bars.colour().copy_from_slice(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        bars.depth()[1] += 7.0;
        bars.extras()[3] += 8.0;
        bars.transmittance()[0] += 0.5;
        let all = bars.composited([0.1, 0.2, 0.3]);
        assert_eq!(all[..6], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(all[6..16], [0.0, 7.0, 0.0, 0.0, 0.0, 8.0, 0.0, 0.0, 0.0, 0.0]);
        assert!((all[16] - 2.7).abs() < 1e-6 && (all[17] - 2.8).abs() < 1e-6, "{:?}", &all[16..]);
    }

    #[test]
    fn planes_that_are_not_drawn_have_no_gradient() {
        let mut bars = PlaneBars::default();
        bars.begin(4, 3, PlaneLayout::default());
        assert!(bars.depth().is_empty() && bars.extras().is_empty());
        assert_eq!(bars.composited([0.0; 3]).len(), 16);
    }
}

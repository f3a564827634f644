//! Rays in internal coordinates.

/// A ray in internal coordinates, clipped to where there may be something.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InternalRay {
    /// Origin.
    pub o: [f32; 3],
    /// Unit direction.
    pub d: [f32; 3],
    /// Where sampling begins and ends; nothing to sample where `end <= start`.
    pub start: f32,
    /// See `start`.
    pub end: f32,
    /// Unit direction in the scene's frame, for the colour.
    pub view: [f32; 3],
    /// Radius of the pixel's cone at distance 1; in NDC that of its cylinder.
    pub radius: f32,
}

impl InternalRay {
    /// The point at distance `t`.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, t: f32) -> [f32; 3] {
        [self.o[0] + t * self.d[0], self.o[1] + t * self.d[1], self.o[2] + t * self.d[2]]
    }
}

//! What finding points may cost, and what counts.

/// What finding points may cost, and what counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Longest side of the photos when points are searched, pixels.
    pub longest_side: u32,
    /// Photos used, spread evenly over all.
    pub photos: usize,
    /// Corners of a photo, at most, and of all together: these are shared out evenly.
    pub corners: usize,
    /// See [`Options::corners`].
    pub corners_in_all: usize,
    /// Photos each photo is matched with.
    pub neighbours: usize,
    /// Widest parallax that a point must have, radians: less says little about depth.
    pub least_angle: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            longest_side: 640,
            photos: 300,
            corners: 1500,
            corners_in_all: 150_000,
            neighbours: 8,
            least_angle: 1.5_f64.to_radians(),
        }
    }
}

//! Gaussians on a picture: ellipses.

/// A pinhole camera: world-to-camera rotation and translation, focal lengths and principal point in pixels.
#[derive(Clone, Copy, Debug)]
pub struct Camera {
    /// Row by row.
    pub r: [[f64; 3]; 3],
    /// `x_camera = r x + t`.
    pub t: [f64; 3],
    /// Focal lengths.
    pub f: [f64; 2],
    /// Principal point.
    pub c: [f64; 2],
    /// Columns and rows.
    pub size: [usize; 2],
}

/// Constants.
#[derive(Clone, Copy, Debug)]
pub struct Rules {
    /// Gaussians at this depth or nearer are left out.
    pub near: f64,
    /// Added to both variances, pixels squared.
    pub blur: f64,
    /// Whether opacity falls with the area that blur gains.
    pub dims: bool,
    /// Contributions of a smaller opacity are left out.
    pub alpha_min: f64,
    /// Upper bound of the opacity of a contribution.
    pub alpha_max: f64,
    /// A pixel ends before the contribution that would bring its transmittance to this or below.
    pub stop: f64,
}

/// One Gaussian on the picture.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse {
    /// Which Gaussian.
    pub index: usize,
    /// Centre, pixels.
    pub uv: [f64; 2],
    /// `[[a, b], [b, c]]` with blur as `a, b, c`,
    pub cov: [f64; 3],
    /// and its inverse.
    pub conic: [f64; 3],
    /// Opacity, reduced by blur where that is on.
    pub opacity: f64,
    /// Squared radius within which it contributes, standard deviations.
    pub q_max: f64,
    /// Depth.
    pub z: f64,
    /// Colour as this camera sees it.
    pub rgb: [f64; 3],
}

impl Ellipse {
    /// What an `f32` rasteriser was given, exactly: no difference is left but that of compositing.
    #[must_use]
    pub fn rounded(index: usize, uv: [f32; 2], conic: [f32; 3], [opacity, q_max, z]: [f32; 3], rgb: [f32; 3]) -> Self {
        let conic = conic.map(f64::from);
        let det = conic[0] * conic[2] - conic[1] * conic[1];
        Self {
            index,
            uv: uv.map(f64::from),
            cov: [conic[2] / det, -conic[1] / det, conic[0] / det],
            conic,
            opacity: opacity.into(),
            q_max: q_max.into(),
            z: z.into(),
            rgb: rgb.map(f64::from),
        }
    }
}

/// Nearest first, ties by index.
pub fn front_to_back(ellipses: &mut [Ellipse]) {
    ellipses.sort_by(|a, b| a.z.total_cmp(&b.z).then(a.index.cmp(&b.index)));
}

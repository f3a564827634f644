//! What the photos' alpha rules out: a ball before transparent pixels is empty.

use engine::data::Dataset;
use engine::system::SystemError;
use glam::DVec3;
use render_core::camera::Prepared;

/// Whether a scene moves: what one photo sees through may be full in the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Moves {
    No,
    Yes,
}

/// What a view says about a ball.
pub(super) enum Seen {
    /// All of it lies before transparent pixels: nothing is there.
    Background,
    /// Part of it is seen.
    Something,
    /// It is not in the picture.
    Outside,
}

/// A camera and the pixels of its image that are not fully transparent, summed up.
pub(super) struct Silhouette {
    camera: Prepared,
    size: [i64; 2],
    focal: f64,
    axis: DVec3,
    centre: DVec3,
    /// `[height + 1][width + 1]` pixels with alpha before and above; empty without alpha.
    sums: Vec<u32>,
}

impl Silhouette {
    pub(super) fn new(data: &Dataset, i: usize, scene: Moves) -> Result<Self, SystemError> {
        let image = data.image(i)?;
        let (w, h) = (image.width as usize, image.height as usize);
        let mut sums = Vec::new();
        if image.channels == 4 && scene == Moves::No {
            sums.resize((w + 1) * (h + 1), 0);
            for y in 0..h {
                let mut row = 0;
                for x in 0..w {
                    row += u32::from(image.data[4 * (y * w + x) + 3] > 0);
                    sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
                }
            }
        }
        let camera = data.view(i).camera;
        Ok(Self {
            camera: camera.prepare(),
            size: [w as i64, h as i64],
            focal: camera.fx.max(camera.fy),
            axis: camera.optical_axis(),
            centre: camera.pose.c,
            sums,
        })
    }

    pub(super) fn has_alpha(&self) -> bool {
        !self.sums.is_empty()
    }

    /// A ball of radius `reach` about `x`.
    pub(super) fn judge(&self, x: DVec3, reach: f64) -> Seen {
        let depth = (x - self.centre).dot(self.axis);
        if depth < -reach {
            return Seen::Outside;
        }
        if depth <= 2.0 * reach {
            // So near that the ball fills the view.
            return Seen::Something;
        }
        let Some(p) = self.camera.project(x) else { return Seen::Outside };
        // A pixel more for interpolation and rounding; 1.5 for what perspective and lens add off the axis.
        let radius = 1.5 * reach * self.focal / (depth - reach) + 1.0;
        let range = |c: f64, size: i64| {
            let (low, high) = ((c - radius).floor(), (c + radius).ceil());
            (low.max(0.0) as i64, (high.min(size as f64)) as i64, low < 0.0 || high > size as f64)
        };
        let (x0, x1, cut_x) = range(p.x, self.size[0]);
        let (y0, y1, cut_y) = range(p.y, self.size[1]);
        if x0 >= x1 || y0 >= y1 {
            return Seen::Outside;
        }
        if !self.has_alpha() || cut_x || cut_y {
            return Seen::Something;
        }
        let at = |x: i64, y: i64| u64::from(self.sums[(y * (self.size[0] + 1) + x) as usize]);
        if at(x1, y1) + at(x0, y0) == at(x0, y1) + at(x1, y0) { Seen::Background } else { Seen::Something }
    }
}

//! What came out: photos placed, points, and how well they agree.

use render_core::camera::Camera;
use scene_io::colmap::Model;

/// Share of the photos below which a result is warned of.
pub const ENOUGH: f64 = 0.8;
/// Mean reprojection error, pixels, above which a result is warned of.
const LARGE_ERROR: f64 = 2.0;

/// A finished preparation.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// What found the cameras, with its version.
    pub tool: String,
    /// Photos that were given to it.
    pub photos: usize,
    /// Photos that have a camera.
    pub placed: usize,
    /// Names of those that have none, in order.
    pub missing: Vec<String>,
    /// Points of the model.
    pub points: usize,
    /// Mean distance between where a point is seen and where the model puts it, pixels; `None` without points.
    pub error: Option<f64>,
    /// Focal lengths of the cameras with image sizes: one line for each.
    pub cameras: Vec<String>,
}

impl Summary {
    pub(crate) fn of(model: &Model, names: &[&str], tool: String) -> Self {
        let has = |name: &str| model.images.iter().any(|i| i.name == name);
        let missing: Vec<String> = names.iter().filter(|n| !has(n)).map(|n| n.to_string()).collect();
        let cameras = model.cameras.values().map(|c| {
            let focal =
                if (c.fx - c.fy).abs() < 1e-9 { format!("{:.1}", c.fx) } else { format!("{:.1}, {:.1}", c.fx, c.fy) };
            format!("{}x{}: focal length {focal} pixels", c.width, c.height)
        });
        Self {
            tool,
            photos: names.len(),
            placed: names.len() - missing.len(),
            missing,
            points: model.points.len(),
            error: reprojection_error(model),
            cameras: cameras.collect(),
        }
    }

    /// What to be warned of, in one line each.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        let share = self.placed as f64 / self.photos.max(1) as f64;
        if share < ENOUGH {
            warnings.push(format!(
                "ONLY {} OF {} PHOTOS WERE PLACED: what the others show will be missing or wrong. Take more photos with more overlap \
                 (each thing in at least three), without blur; or try another program (`--with`)",
                self.placed, self.photos
            ));
        }
        if let Some(error) = self.error.filter(|e| *e > LARGE_ERROR) {
            warnings.push(format!(
                "points and photos disagree by {error:.1} pixels on average (below 1 is usual): things that move, mirrors, or a \
                 lens that was zoomed between photos"
            ));
        }
        warnings
    }
}

/// Mean over all observations of points, pixels; `None` where there are none.
fn reprojection_error(model: &Model) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_u64);
    for image in &model.images {
        let Some(c) = model.cameras.get(&image.camera_id) else { continue };
        let camera = Camera {
            width: c.width,
            height: c.height,
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
            lens: c.lens,
            pose: image.pose,
        };
        let camera = camera.prepare();
        for (id, [x, y]) in image.point_ids.iter().zip(&image.pixels) {
            let projected = model.points.get(id).and_then(|point| camera.project(point.xyz));
            if let Some(p) = projected {
                sum += (p.x - f64::from(*x)).hypot(p.y - f64::from(*y));
                count += 1;
            }
        }
    }
    (count > 0).then(|| sum / count as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(placed: usize, error: f64) -> Summary {
        Summary {
            tool: "colmap 3.8".into(),
            photos: 10,
            placed,
            missing: Vec::new(),
            points: 1,
            error: Some(error),
            cameras: Vec::new(),
        }
    }

    #[test]
    fn few_photos_and_large_errors_are_warned_of() {
        assert!(summary(8, 0.7).warnings().is_empty());
        assert!(summary(7, 0.7).warnings()[0].contains("7 OF 10"));
        assert!(summary(10, 3.0).warnings()[0].contains("3.0 pixels"));
    }
}

//! Pictures of a field from training cameras: small enough that all together are no more rays than asked for.

use crate::views::refine::FittedPicture;
use engine::data::Dataset;
use engine::render::render;
use engine::system::{LayerRequest, Layers, Query, System};
use render_core::camera::{Camera, Lens};

/// Cameras at most: more say little that is new.
const MOST: usize = 48;
/// A side of a picture is at least this long, pixels.
const LEAST_SIDE: u32 = 12;
/// One camera in this many is kept aside to measure by; with fewer cameras none is.
const ASIDE: usize = 8;

/// A picture of the field.
pub(super) struct Picture {
    /// A pinhole camera of the scene's frame.
    pub(super) camera: Camera,
    pub(super) layers: Layers,
    /// Kept for measuring: neither seeds nor the fit use it.
    pub(super) is_aside: bool,
}

impl Picture {
    /// What the fit takes.
    pub(super) fn fitted(&self) -> FittedPicture {
        let n = self.layers.rgb.len();
        let mut rgb = vec![0.0; 3 * n];
        for (i, colour) in self.layers.rgb.iter().enumerate() {
            for c in 0..3 {
                rgb[c * n + i] = colour[c];
            }
        }
        FittedPicture { camera: self.camera, rgb }
    }
}

/// Pictures from training cameras, evenly chosen, about `rays` pixels in all. `None` as soon as `go_on` says no.
pub(super) fn pictures(
    system: &dyn System,
    data: &Dataset,
    query: &Query,
    rays: usize,
    go_on: &dyn Fn() -> bool,
) -> Option<Vec<Picture>> {
    let all: Vec<&Camera> = data.views().iter().filter(|v| v.level == 0).map(|v| &v.camera).collect();
    let count = all.len().min(MOST);
    let query = Query { layers: LayerRequest::default(), ..query.clone() };
    let mut left = rays as f64;
    let mut out = Vec::with_capacity(count);
    for k in 0..count {
        if !go_on() {
            return None;
        }
        let camera = small(all[k * all.len() / count], left / (count - k) as f64);
        let layers = render(system, &camera, &query).layers;
        if query.halt.raised() {
            return None;
        }
        left -= f64::from(camera.width) * f64::from(camera.height);
        out.push(Picture { camera, layers, is_aside: count >= ASIDE && k % ASIDE == ASIDE / 2 });
    }
    Some(out)
}

/// A camera of about `pixels` pixels without a lens, no larger than it was.
fn small(camera: &Camera, pixels: f64) -> Camera {
    let own = f64::from(camera.width) * f64::from(camera.height);
    let share = (pixels.max(1.0) / own).sqrt().min(1.0);
    let side = |n: u32| ((f64::from(n) * share).round() as u32).max(LEAST_SIDE.min(n)).max(1);
    Camera { lens: Lens::PINHOLE, ..camera.resized(side(camera.width), side(camera.height)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use render_core::camera::Pose;

    #[test]
    fn small_cameras_see_the_same_with_as_many_pixels_as_asked_for() {
        let camera = Camera::pinhole(400, 200, 300.0, 300.0, 200.0, 100.0, Pose::IDENTITY);
        let of = |pixels| small(&camera, pixels);
        assert_eq!((of(20_000.0).width, of(20_000.0).height), (200, 100));
        assert_eq!(of(1e9), camera);
        assert_eq!((of(0.0).width, of(0.0).height), (12, 12));
        let half = of(20_000.0);
        let corner = |c: &Camera| c.ray(glam::DVec2::ZERO).unwrap().d;
        assert!((corner(&half) - corner(&camera)).length() < 1e-9);
    }
}

//! What files say of how near is what photos show: disparities of a network that sees one photo, or measured depths.

use crate::views::{Nearness, source};
use engine::data::{Dataset, View};
use glam::DVec2;
use rayon::prelude::*;
use render_core::camera::Camera;
use scene_io::SceneError;

/// Longest side that is kept, pixels: shapes of whole pictures are compared.
const LONGEST: u32 = 256;

/// Whether any photo has such a file.
pub(super) fn has_depths(data: &Dataset) -> bool {
    data.views().iter().any(|view| view.source.priors.motion.disparity.is_some() || view.source.depth.is_some())
}

/// Of each photo, as training sees it; `None` where it has no file. Disparity where there is one, else one over measured depth.
///
/// # Errors
/// Names the file that cannot be read.
pub(super) fn read_depths(data: &Dataset) -> Result<Vec<Option<Nearness>>, SceneError> {
    data.views().par_iter().map(nearness).collect()
}

fn nearness(view: &View) -> Result<Option<Nearness>, SceneError> {
    let Camera { width, height, .. } = view.camera;
    let halved = width.max(height).div_ceil(LONGEST).max(1);
    let [width, height] = [width, height].map(|n| n.div_ceil(halved));
    let values: Vec<f32> = if let Some(disparity) = view.source.read_disparity()? {
        let small = disparity.resized(width, height);
        small.values.iter().zip(small.known.iter()).map(|(x, known)| if known { *x } else { f32::NAN }).collect()
    } else if let Some(depth) = view.source.read_depth()? {
        depth.resized(width, height).z.iter().map(|z| if *z > 0.0 { 1.0 / z } else { f32::NAN }).collect()
    } else {
        return Ok(None);
    };
    let found = Nearness { size: [width as usize, height as usize], values };
    Ok(Some(if view.camera.lens.is_pinhole() { found } else { on_plane(&found, &view.camera) }))
}

/// The same on the plane of a camera without a lens; not known where the photo shows nothing.
fn on_plane(found: &Nearness, camera: &Camera) -> Nearness {
    let seen = camera.prepare();
    let size = DVec2::new(camera.width.into(), camera.height.into());
    let [width, height] = found.size;
    let cells = DVec2::new(width as f64, height as f64);
    let at = |i: usize| {
        let cell = DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let at = source(&seen, camera, cell / cells * size)? / size * cells;
        let is_inside = at.x >= 0.0 && at.y >= 0.0 && at.x < cells.x && at.y < cells.y;
        is_inside.then(|| found.values[at.y as usize * width + at.x as usize])
    };
    let values = (0..found.values.len()).map(|i| at(i).unwrap_or(f32::NAN)).collect();
    Nearness { size: found.size, values }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made;
    use render_core::camera::Lens;
    use scene_io::{DepthMap, DepthSource, Frame};

    fn frames(lens: Lens) -> Vec<Frame> {
        let mut frames = made::frames(3, |_, x, _| [x as u8; 4]);
        for frame in &mut frames {
            frame.camera.lens = lens;
            let side = made::SIDE;
            // Nearer from column to column; the first row is not known.
            let z = (0..side * side).map(|i| if i < side { 0.0 } else { 1.0 / (1.0 + (i % side) as f32) }).collect();
            frame.depth = Some(DepthSource::memory(DepthMap::new(side, side, z).unwrap()));
        }
        frames
    }

    #[test]
    fn measured_depths_are_one_over_and_holes_stay_holes() {
        let mut all = frames(Lens::PINHOLE);
        let last = all.len() - 1;
        all[last].depth = None;
        let (_, data) = made::scene(all, Vec::new());
        assert!(has_depths(&data));
        let read = read_depths(&data).unwrap();
        let side = made::SIDE as usize;
        let first = read[0].as_ref().unwrap();
        assert_eq!(first.size, [side; 2]);
        assert!(first.values[..side].iter().all(|x| x.is_nan()));
        for (i, x) in first.values.iter().enumerate().skip(side) {
            assert!((x - 1.0 - (i % side) as f32).abs() < 1e-3, "{i}: {x}");
        }
        assert!(read[last].is_none());
        let (_, none) = made::scene(made::frames(3, |_, _, _| [9; 4]), Vec::new());
        assert!(!has_depths(&none) && read_depths(&none).unwrap().iter().all(Option::is_none));
    }

    #[test]
    fn depths_of_a_lens_are_put_on_its_plane() {
        let of = |lens: Lens| {
            let (_, data) = made::scene(frames(lens), Vec::new());
            read_depths(&data).unwrap()[0].clone().unwrap()
        };
        let (flat, bent) = (of(Lens::PINHOLE), of(Lens::opencv5([-0.3, 0.0, 0.0, 0.0, 0.0])));
        assert_eq!(flat.size, bent.size);
        let row = flat.size[0] * (flat.size[1] / 2);
        // A lens like a barrel shows what is at the edge of the plane further in.
        assert!(bent.values[row] >= flat.values[row] && bent.values[row + 1].is_finite());
    }
}

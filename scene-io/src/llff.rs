//! LLFF: `poses_bounds.npy`, one row an image in the order of the sorted image names.
//!
//! A row is a 3x5 matrix (rotation with columns down, right, backwards; camera centre; height, width and focal length of
//! the full-size image) and the near and far z depth of what is seen. The images may be any `images_N` folder. A
//! `sparse/0/points3D` file beside it lies in the same world frame and gives start points.

use crate::assemble::{DialectSplits, Intrinsics, RawFrame, Reading};
use crate::files::images_in;
use crate::options::LoadOptions;
use crate::pose::{Axes, pose_from};
use crate::{ErrorKind, LayoutHint, Point, Problem, SceneError, Split, colmap, images_folder, npy};
use glam::{DMat3, DVec3};
use render_core::camera::Lens;
use std::path::Path;

/// Cameras turned further than this from their mean direction do not face forward: NDC degenerates.
const FACING_COSINE: f64 = 0.5;

pub(crate) fn read(file: &Path, options: &LoadOptions) -> Result<Reading, SceneError> {
    let root = file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Every(8);
    let array = npy::read(file)?;
    let &[rows, 17] = array.shape.as_slice() else {
        let problem = Problem::new(file, "is no list of poses and bounds", "it should have the shape (images, 17)");
        return Err(SceneError::new(ErrorKind::Format, problem.field("shape").value(format!("{:?}", array.shape))));
    };
    let folder = images_folder::find(root, options, &[])?;
    let images = images_in(&folder)?;
    if images.len() != rows {
        let what = format!("holds {rows} poses, and {} holds {} images", folder.display(), images.len());
        let remedy = "keep exactly the images the poses were computed for";
        return Err(SceneError::new(ErrorKind::Layout, Problem::new(file, what, remedy)));
    }
    for (i, (image, row)) in images.into_iter().zip(array.data.chunks_exact(17)).enumerate() {
        let name = image.file_name().unwrap_or_default().to_string_lossy().into_owned();
        match frame(file, i, &name, &image, row) {
            Ok(raw) => reading.frames.push(raw),
            Err(problem) => reading.problems.push(problem),
        }
    }
    reading.layout = layout(&reading.frames);
    reading.images_folder = Some(folder);
    start_points(root, &mut reading);
    Ok(reading)
}

fn frame(file: &Path, i: usize, name: &str, image: &Path, row: &[f64]) -> Result<RawFrame, Problem> {
    let entry = |column: usize, what: &str, remedy: &str| {
        Problem::new(file, what, remedy).frame(name).field(format!("[{i}, {column}]")).value(row[column])
    };
    let column = |j: usize| DVec3::new(row[j], row[5 + j], row[10 + j]);
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    let (pose, mended) = pose_from(Axes::Llff, rotation, column(3)).map_err(|bad| {
        let field = bad.entry.map_or(format!("[{i}, :]"), |(r, c)| format!("[{i}, {}]", 5 * r + c));
        Problem::new(file, bad.what, bad.remedy).frame(name).field(field).value(bad.value)
    })?;
    let size = |column: usize| {
        let side = row[column];
        let fits = side >= 1.0 && side <= f64::from(u32::MAX) && side.fract() == 0.0;
        fits.then_some(side as u32).ok_or_else(|| entry(column, "is no image size", "write the poses again"))
    };
    let (height, width) = (size(4)?, size(9)?);
    let focal = row[14];
    if !(focal > 0.0 && focal.is_finite()) {
        return Err(entry(14, "the focal length must be above 0", "write the poses again"));
    }
    let (near, far) = (row[15], row[16]);
    for (column, depth) in [(15, near), (16, far)] {
        if !depth.is_finite() {
            return Err(entry(column, "is not a finite depth", "write the bounds again"));
        }
    }
    Ok(RawFrame {
        name: name.to_owned(),
        image: image.to_path_buf(),
        listed: (file.to_path_buf(), format!("[{i}, :]")),
        size: Some((width, height)),
        intrinsics: Intrinsics::Pixels { fx: focal, fy: focal, cx: None, cy: None },
        lens: Lens::PINHOLE,
        pose,
        mended,
        split: Split::Train,
        time: None,
        mask: None,
        depth: None,
        transient: None,
        moving: None,
        tracks: Vec::new(),
        // Bounds that say nothing (some writers fill in 0) are left out.
        z_bounds: (near > 0.0 && far > near).then_some([near, far]),
        sharpness: None,
    })
}

/// Forward facing if all cameras look within 60 degrees of their mean direction.
fn layout(frames: &[RawFrame]) -> LayoutHint {
    let axes: Vec<DVec3> = frames.iter().map(|f| f.pose.r.z_axis).collect();
    let mean = axes.iter().copied().sum::<DVec3>().normalize_or_zero();
    if !axes.is_empty() && axes.iter().all(|a| a.dot(mean) > FACING_COSINE) {
        LayoutHint::ForwardFacing
    } else {
        LayoutHint::Unknown
    }
}

/// Points of a COLMAP model beside the poses. They are an extra: a broken file is told, not refused.
fn start_points(root: &Path, reading: &mut Reading) {
    let file = ["sparse/0/points3D.bin", "sparse/0/points3D.txt", "sparse/points3D.bin", "sparse/points3D.txt"]
        .into_iter()
        .map(|name| root.join(name))
        .find(|path| path.is_file());
    let Some(file) = file else { return };
    match colmap::read_points(&file) {
        Ok(points) => {
            let mut points: Vec<(u64, Point)> = points.into_iter().collect();
            points.sort_by_key(|(id, _)| *id);
            reading.points = points.into_iter().map(|(_, p)| p).collect();
            reading.notes.push(format!("{} start points from {}", reading.points.len(), file.display()));
        }
        Err(error) => reading.problems.push(error.into_problem().warning()),
    }
}

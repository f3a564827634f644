//! LLFF: `poses_bounds.npy`, one row an image in the order of the sorted image names. And what others make of such rows.
//!
//! A row is a 3x5 matrix (rotation with columns down, right, backwards; camera centre; height, width and focal length of
//! the full-size image) and the near and far z depth of what is seen. The images may be any `images_N` folder. A
//! `sparse/0/points3D` file beside it lies in the same world frame and gives start points.

use crate::files::images_in;
use crate::options::LoadOptions;
use crate::pose::{Axes, pose_from};
use crate::reading::{DialectSplits, Intrinsics, Need, RawFrame, Reading};
use crate::{ErrorKind, LayoutHint, Point, Problem, SceneError, Size, Split, colmap, images_folder, npy};
use glam::{DMat3, DVec3};
use render_core::camera::Lens;
use std::path::{Path, PathBuf};

/// Cameras turned further than this from their mean direction do not face forward: NDC degenerates.
const FACING_COSINE: f64 = 0.5;

pub(crate) fn read(file: &Path, options: &LoadOptions, need: Need) -> Result<Reading, SceneError> {
    let root = file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Every(8);
    let rows = rows(file)?;
    let (folder, images) = images_of(file, rows.len(), root, options, need)?;
    for (i, (image, values)) in images.iter().zip(&rows).enumerate() {
        let field = |at: usize| format!("[{i}, {at}]");
        match (Row { file, image, whole: format!("[{i}, :]"), field: &field, values, axes: Axes::Llff }).frame() {
            Ok(raw) => reading.frames.push(raw),
            Err(problem) => reading.problems.push(problem),
        }
    }
    reading.layout = layout(&reading.frames);
    reading.images_folder = Some(folder);
    start_points(root, &mut reading);
    Ok(reading)
}

/// The rows of `poses_bounds.npy`.
pub(crate) fn rows(file: &Path) -> Result<Vec<[f64; 17]>, SceneError> {
    let array = npy::read(file)?;
    let &[_, 17] = array.shape.as_slice() else {
        let problem = Problem::new(file, "is not a list of poses and bounds", "it should have the shape (images, 17)");
        return Err(SceneError::new(ErrorKind::Format, problem.field("shape").value(format!("{:?}", array.shape))));
    };
    Ok(array.data.as_chunks().0.to_vec())
}

/// The images' folder and the images of it, one for each of `n` poses of `file`. Where none are needed and none are there:
/// names made of numbers.
pub(crate) fn images_of(
    file: &Path,
    n: usize,
    root: &Path,
    options: &LoadOptions,
    need: Need,
) -> Result<(PathBuf, Vec<PathBuf>), SceneError> {
    let folder = match images_folder::find(root, options, &[]) {
        Err(_) if need == Need::Cameras => {
            let folder = root.join("images");
            let images = (0..n).map(|i| folder.join(format!("{i:06}.png"))).collect();
            return Ok((folder, images));
        }
        found => found?,
    };
    let images = images_in(&folder)?;
    if images.len() != n {
        let what = format!("holds {n} poses, and {} holds {} images", folder.display(), images.len());
        let remedy = "keep exactly the images the poses were computed for";
        return Err(SceneError::new(ErrorKind::Layout, Problem::new(file, what, remedy)));
    }
    Ok((folder, images))
}

/// A 3x5 matrix (rotation, centre; height, width and focal length) and two depths, as LLFF writes them in a row.
pub(crate) struct Row<'a> {
    pub(crate) file: &'a Path,
    pub(crate) image: &'a Path,
    /// The way to the row, for messages.
    pub(crate) whole: String,
    /// The way to a value of it.
    pub(crate) field: &'a dyn Fn(usize) -> String,
    pub(crate) values: &'a [f64; 17],
    /// What the columns of the rotation are.
    pub(crate) axes: Axes,
}

impl Row<'_> {
    pub(crate) fn frame(self) -> Result<RawFrame, Problem> {
        let name = self.image.file_name().unwrap_or_default().to_string_lossy().into_owned();
        frame(&self, &name)
    }
}

fn frame(&Row { file, image, ref whole, field, values: row, axes }: &Row<'_>, name: &str) -> Result<RawFrame, Problem> {
    let entry = |column: usize, what: &str, remedy: &str| {
        Problem::new(file, what, remedy).frame(name).field(field(column)).value(row[column])
    };
    let column = |j: usize| DVec3::new(row[j], row[5 + j], row[10 + j]);
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    let (pose, mended) = pose_from(axes, rotation, column(3)).map_err(|bad| {
        let field = bad.entry.map_or(whole.clone(), |(r, c)| field(5 * r + c));
        Problem::new(file, bad.what, bad.remedy).frame(name).field(field).value(bad.value)
    })?;
    let size = |column: usize| {
        let side = row[column];
        let fits = side >= 1.0 && side <= f64::from(u32::MAX) && side.fract() == 0.0;
        fits.then_some(side as u32).ok_or_else(|| entry(column, "is not an image size", "write the poses again"))
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
        listed: (file.to_path_buf(), whole.clone()),
        size: Some(Size::new(width, height)),
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
        covisible: None,
        flow: None,
        ids: None,
        tracks: Vec::new(),
        // Bounds that say nothing (some writers fill in 0) are left out.
        z_bounds: (near > 0.0 && far > near).then_some([near, far]),
        sharpness: None,
    })
}

/// Forward facing if all cameras look within 60 degrees of their mean direction.
pub(crate) fn layout(frames: &[RawFrame]) -> LayoutHint {
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

//! NR-NeRF: `precomputed.json` beside the images of a video, in the order of their names.
//!
//! `poses` are 3x5 as LLFF's rows, `bds` near and far depths, but what LLFF's loader does was done already: columns of the
//! rotation are (right, up, backwards), the cameras are recentred and the scene is scaled. The depths of single frames
//! scatter widely, so all get the 5th percentile of the near and the 95th of the far ones. Images are in time order.
//! `i_test` (an index or a list of them) is held out. `render_poses` is the authors' camera path and is not used.

use crate::json::Document;
use crate::llff::{Row, images_of, layout};
use crate::options::LoadOptions;
use crate::pose::Axes;
use crate::reading::{DialectSplits, Need, Reading};
use crate::{ErrorKind, Problem, SceneError, Split, time};
use std::path::Path;

/// Share of the frames' depths that may lie outside the range taken.
const STRAY: f64 = 0.05;

pub(crate) fn read(file: &Path, options: &LoadOptions, need: Need) -> Result<Reading, SceneError> {
    let format = |p: Problem| SceneError::new(ErrorKind::Format, p);
    let root = file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Explicit;
    let document = Document::read(file)?;
    let top = document.top().map_err(format)?;
    let missing = |key: &str| format(Problem::new(file, "is missing", "run NR-NeRF's preprocessing again").field(key));
    let poses = top.blocks("poses", 3, 5).map_err(format)?.ok_or_else(|| missing("poses"))?;
    let bounds = top.blocks("bds", 1, 2).map_err(format)?.ok_or_else(|| missing("bds"))?;
    if bounds.len() != poses.len() {
        let problem = Problem::new(file, format!("holds {} depth ranges for {} poses", bounds.len(), poses.len()), "");
        return Err(format(problem.field("bds")));
    }
    let (folder, images) = images_of(file, poses.len(), root, options, need)?;
    for (i, ((image, pose), depths)) in images.iter().zip(&poses).zip(&bounds).enumerate() {
        let field = |at: usize| match at {
            0..15 => format!("poses[{i}][{}][{}]", at / 5, at % 5),
            _ => format!("bds[{i}][{}]", at - 15),
        };
        let values = std::array::from_fn(|at| if at < 15 { pose[at] } else { depths[at - 15] });
        let row = Row { file, image, whole: format!("poses[{i}]"), field: &field, values: &values, axes: Axes::Gl };
        match row.frame() {
            Ok(mut raw) => {
                raw.time = Some(time::by_order(i, poses.len()));
                reading.frames.push(raw);
            }
            Err(problem) => reading.problems.push(problem),
        }
    }
    held_out(&top, poses.len(), &images, &mut reading).map_err(format)?;
    reading.notes.push(format!("times by the order of the {} images' names, 0 to 1", poses.len()));
    depth_range(&mut reading);
    reading.layout = layout(&reading.frames);
    reading.images_folder = Some(folder);
    Ok(reading)
}

/// `i_test`: a frame's index, or several.
fn held_out(
    top: &crate::json::Object<'_>,
    n: usize,
    images: &[std::path::PathBuf],
    reading: &mut Reading,
) -> Result<(), Problem> {
    let list = match top.get("i_test") {
        Some(value) if value.is_array() => top.indices("i_test")?.unwrap_or_default(),
        _ => top.index("i_test")?.map(|i| i as usize).into_iter().collect(),
    };
    for index in list {
        let Some(image) = images.get(index) else {
            return Err(top.problem("i_test", format!("there are only {n} frames"), "write an index below that"));
        };
        for frame in reading.frames.iter_mut().filter(|f| f.image == *image) {
            frame.split = Split::Test;
        }
    }
    Ok(())
}

/// One depth range for all frames, without the stray ends.
fn depth_range(reading: &mut Reading) {
    let mut near: Vec<f64> = reading.frames.iter().filter_map(|f| f.z_bounds.map(|b| b[0])).collect();
    let mut far: Vec<f64> = reading.frames.iter().filter_map(|f| f.z_bounds.map(|b| b[1])).collect();
    near.sort_by(f64::total_cmp);
    far.sort_by(f64::total_cmp);
    let skip = (STRAY * near.len() as f64) as usize;
    if let (Some(&low), Some(&high)) = (near.get(skip), far.iter().rev().nth(skip)) {
        let all = [near[0], far[far.len() - 1]];
        if high > low {
            reading.frames.iter_mut().for_each(|f| f.z_bounds = Some([low, high]));
            reading.notes.push(format!(
                "depths of single frames scatter ({:.3} to {:.3}): {low:.3} to {high:.3} is taken for all",
                all[0], all[1]
            ));
        }
    }
}

//! A COLMAP model with its images as a scene.

use super::model::{Model, ModelFiles, ModelImage};
use crate::listing::listing;
use crate::options::LoadOptions;
use crate::pose::Mended;
use crate::priors::TrackPoint;
use crate::reading::{DialectSplits, Intrinsics, RawFrame, Reading};
use crate::{ErrorKind, Place, Point, Problem, SceneError, Size, Split, images_folder};
use glam::{DMat3, DQuat, DVec3};
use render_core::camera::Pose;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A camera-to-world pose from COLMAP's world-to-camera quaternion (w first) and translation.
pub(super) fn pose_of(
    path: &Path,
    place: Place,
    name: &str,
    [w, x, y, z]: [f64; 4],
    t: [f64; 3],
    notes: &mut Vec<String>,
) -> Result<Pose, Problem> {
    let remedy = "remove the image from the model, or register it again";
    let problem = |field: &str, value: String, what: &str| {
        Problem::new(path, what, remedy).at(place).frame(name).field(field).value(value)
    };
    let q = DQuat::from_xyzw(x, y, z, w);
    let length = q.length();
    if !q.is_finite() || !length.is_finite() {
        return Err(problem("QW QX QY QZ", format!("{w} {x} {y} {z}"), "is not finite"));
    }
    if length < 1e-6 {
        return Err(problem(
            "QW QX QY QZ",
            format!("{w} {x} {y} {z}"),
            "is not a rotation (singular): its length is 0",
        ));
    }
    let t = DVec3::from(t);
    if !t.is_finite() {
        return Err(problem("TX TY TZ", format!("{} {} {}", t.x, t.y, t.z), "is not finite"));
    }
    if (length - 1.0).abs() > 1e-3 {
        notes.push(format!("{name}: quaternion of length {length:.6} was normalised"));
    }
    let r = DMat3::from_quat(q * (1.0 / length)).transpose();
    Ok(Pose { r, c: -(r * t) })
}

/// Folders below `path` that hold a model, the one with most images first.
pub(crate) fn find_models(path: &Path) -> Vec<ModelFiles> {
    if let Some(files) = ModelFiles::find(path) {
        return vec![files];
    }
    let mut found = Vec::new();
    for sparse in ["dense/sparse", "sparse", "colmap/sparse"] {
        let sparse = path.join(sparse);
        found.extend(ModelFiles::find(&sparse));
        found.extend(subfolders(&sparse).iter().filter_map(|folder| ModelFiles::find(folder)));
    }
    if found.is_empty() {
        // `path` may be the `sparse` folder itself.
        found.extend(subfolders(path).iter().filter_map(|folder| ModelFiles::find(folder)));
    }
    found.sort_by_cached_key(|files| std::cmp::Reverse(image_count(files)));
    found
}

fn subfolders(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut folders: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.is_dir()).collect();
    folders.sort();
    folders
}

/// How many images a model says it has: for choosing one, so a wrong answer does no harm.
fn image_count(files: &ModelFiles) -> u64 {
    use std::io::Read;
    if files.images.extension().is_some_and(|e| e == "txt") {
        let text = std::fs::read_to_string(&files.images).unwrap_or_default();
        return text.lines().filter(|l| !l.starts_with('#')).count() as u64 / 2;
    }
    let mut count = [0; 8];
    match std::fs::File::open(&files.images).and_then(|mut f| f.read_exact(&mut count)) {
        Ok(()) => u64::from_le_bytes(count),
        Err(_) => 0,
    }
}

/// The folder of the dataset a model folder belongs to: above `sparse/0`, `sparse` or `colmap/sparse/0`.
pub(crate) fn dataset_root(model: &Path) -> PathBuf {
    let named = |p: &Path, name: &str| p.file_name().is_some_and(|n| n == name);
    let mut root = model;
    if root.file_name().and_then(|n| n.to_str()).is_some_and(|n| n.bytes().all(|b| b.is_ascii_digit()))
        && let Some(parent) = root.parent()
    {
        root = parent;
    }
    for name in ["sparse", "colmap"] {
        if named(root, name)
            && let Some(parent) = root.parent()
        {
            root = parent;
        }
    }
    root.to_path_buf()
}

/// Reads the first of some models (see [`find_models`]) as a scene.
pub(crate) fn read(root: &Path, models: &[ModelFiles], options: &LoadOptions) -> Result<Reading, SceneError> {
    let Some(files) = models.first() else {
        let problem = Problem::new(root, "holds no COLMAP model", "expected sparse/0 with cameras and images");
        return Err(SceneError::new(ErrorKind::Layout, problem));
    };
    let model = Model::read_files(files)?;
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Every(8);
    reading.notes.push(format!(
        "model {}: {} cameras, {} images, {} points",
        files.folder.display(),
        model.cameras.len(),
        model.images.len(),
        model.points.len()
    ));
    if models.len() > 1 {
        let others: Vec<String> = models[1..].iter().map(|m| m.folder.display().to_string()).collect();
        reading.notes.push(format!("models with fewer images, not used: {}", others.join(", ")));
    }
    if model.notes.len() > 3 {
        reading.notes.push(format!("{} and {} more like it", model.notes[0], model.notes.len() - 1));
    } else {
        reading.notes.extend(model.notes.iter().cloned());
    }
    reading.problems.extend(model.problems.iter().cloned());
    let names: Vec<&str> = model.images.iter().map(|i| i.name.as_str()).collect();
    // Phototourism keeps undistorted photos beside their model, in `dense/images`.
    let beside = dataset_root(&files.folder);
    let folder = match images_folder::find(&beside, options, &names) {
        Err(_) if beside != root => images_folder::find(root, options, &names)?,
        found => found?,
    };
    let tracks = Tracks::of(&model);
    for image in &model.images {
        let listed = (files.images.clone(), format!("image {}", image.id));
        let problem =
            |what: &str, remedy: &str| Problem::new(&files.images, what, remedy).frame(&image.name).field(&listed.1);
        let Some(camera) = model.cameras.get(&image.camera_id) else {
            let what = format!("its camera {} is not in {}", image.camera_id, files.cameras.display());
            reading.problems.push(problem(&what, "export the whole model anew with COLMAP"));
            continue;
        };
        let Some(path) = crate::files::inside(&folder, &image.name) else {
            reading.problems.push(problem("the name leads out of the images' folder", "rename the image in the model"));
            continue;
        };
        reading.frames.push(RawFrame {
            name: image.name.clone(),
            image: path,
            listed,
            size: Some(Size::new(camera.width, camera.height)),
            intrinsics: Intrinsics::Pixels { fx: camera.fx, fy: camera.fy, cx: Some(camera.cx), cy: Some(camera.cy) },
            lens: camera.lens,
            pose: image.pose,
            mended: Mended::Nothing,
            split: Split::Train,
            time: None,
            mask: None,
            depth: None,
            transient: None,
            moving: None,
            covisible: None,
            flow: None,
            ids: None,
            tracks: tracks.seen_in(image),
            z_bounds: z_bounds(&model, image.pose, &image.point_ids),
            sharpness: None,
        });
    }
    let few: Vec<&str> = reading.frames.iter().filter(|f| f.z_bounds.is_none()).map(|f| f.name.as_str()).collect();
    if !few.is_empty() && !model.points.is_empty() {
        reading
            .notes
            .push(format!("fewer than {FEWEST_POINTS} points seen, so depth range unknown: {}", listing(&few)));
    }
    reading.images_folder = Some(folder);
    let mut points: Vec<(u64, Point)> = model.points.into_iter().collect();
    points.sort_by_key(|(id, _)| *id);
    reading.points = points.into_iter().map(|(_, point)| point).collect();
    Ok(reading)
}

/// In how many images each point is seen, and where it stands in [`crate::Scene::points`].
struct Tracks(HashMap<u64, (u32, u32)>);

impl Tracks {
    fn of(model: &Model) -> Self {
        let mut ids: Vec<u64> = model.points.keys().copied().collect();
        ids.sort_unstable();
        let mut tracks: HashMap<u64, (u32, u32)> = (0_u32..).zip(ids).map(|(at, id)| (id, (0, at))).collect();
        let mut seen = Vec::new();
        for image in &model.images {
            // An image may see a point twice; it counts once.
            seen.clone_from(&image.point_ids);
            seen.sort_unstable();
            seen.dedup();
            for id in &seen {
                if let Some((length, _)) = tracks.get_mut(id) {
                    *length += 1;
                }
            }
        }
        Self(tracks)
    }

    fn seen_in(&self, image: &ModelImage) -> Vec<TrackPoint> {
        let features =
            image.point_ids.iter().zip(&image.pixels).filter(|(_, pixel)| pixel.iter().all(|x| x.is_finite()));
        features
            .filter_map(|(id, pixel)| self.0.get(id).map(|(length, point)| (pixel, *length, *point)))
            .map(|(pixel, length, point)| TrackPoint { pixel: *pixel, length, point })
            .collect()
    }
}

/// Images with fewer points before the camera get no depth range.
const FEWEST_POINTS: usize = 10;

/// The 0.1 and 99.9 percentiles of the z depth of an image's own points: what LLFF writes as bounds.
fn z_bounds(model: &Model, pose: Pose, ids: &[u64]) -> Option<[f64; 2]> {
    let points = ids.iter().filter_map(|id| model.points.get(id));
    let mut depths: Vec<f64> = points.map(|p| pose.to_camera(p.xyz).z).filter(|z| *z > 0.0).collect();
    if depths.len() < FEWEST_POINTS {
        return None;
    }
    depths.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let x = share * (depths.len() - 1) as f64;
        let (i, f) = (x.floor(), x.fract());
        let (low, high) = (depths[i as usize], depths[(i as usize + 1).min(depths.len() - 1)]);
        low + (high - low) * f
    };
    Some([at(0.001), at(0.999)])
}

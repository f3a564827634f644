//! Folders of Nerfies, HyperNeRF and DyCheck.
//!
//! | file | holds |
//! | --- | --- |
//! | `dataset.json` | `ids`, `train_ids`, `val_ids` |
//! | `metadata.json` | id to `time_id` or `warp_id` (the time step), `appearance_id`, `camera_id` |
//! | `camera/ID.json` | OpenCV camera; `orientation` is world-to-camera |
//! | `scene.json` | `center`, `scale`, `near`, `far`: the authors' own frame is `(x - center) * scale` |
//! | `points.npy` | points of the background, which stands still |
//! | `rgb/Kx/ID.png` | photos, `K` times smaller than the cameras say |
//! | `depth/Kx/ID.npy` | depth along the optical axis, 0 = not known (DyCheck) |
//! | `covisible/Kx/val/ID.png` | pixels of a test photo that training photos show, too (DyCheck) |
//! | `splits/train.json`, `splits/val.json` | DyCheck's lists, which come before those of `dataset.json` |
//! | `extra.json` | `bbox`: the box of points and cameras, in the authors' frame (DyCheck) |
//!
//! **The world is that of the cameras**: `center` and `scale` are not applied. `near` and `far` are distances along rays in
//! the authors' frame; they become the frames' depth range ([`crate::Frame::z_bounds`]) in world units, `near` times the
//! cosine at the corner of the picture so that nothing seen lies before it. What the datasets call validation is what their
//! papers measure, so it is [`Split::Test`] here. Transparent pixels of photos are pixels not to be used
//! ([`AlphaMeaning::Used`]), not holes in the scene. Depth is in metres; maps whose median is above 50 are taken for
//! millimetres.

mod camera;
mod ids;

use crate::depth::{DepthPlace, DepthSource};
use crate::json::Document;
use crate::limits::is_point;
use crate::options::LoadOptions;
use crate::reading::{DialectSplits, MaskFolder, Need, RawFrame, Reading};
use crate::{AlphaMeaning, Bounds, ErrorKind, FrameIds, Point, Problem, SceneError, Size, Split, files, npy};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::Camera;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

pub(crate) fn read(file: &Path, options: &LoadOptions, need: Need) -> Result<Reading, SceneError> {
    let root = file.parent().unwrap_or(Path::new(""));
    let mut reading = Reading::new(root);
    reading.splits = DialectSplits::Explicit;
    reading.mask_folder = MaskFolder::Unknown;
    reading.alpha = AlphaMeaning::Used;
    let ids = ids::metadata(&Document::read(&root.join("metadata.json"))?)?;
    let dataset = Document::read(file)?;
    let ids::Lists { frames, notes, problems } = ids::lists(root, &dataset, &ids)?;
    reading.notes.extend(notes);
    reading.problems.extend(problems);
    let read: Vec<Result<RawFrame, Problem>> =
        frames.par_iter().map(|(id, split)| frame(root, file, id, *split, &ids)).collect();
    for frame in read {
        match frame {
            Ok(raw) => reading.frames.push(raw),
            Err(problem) => reading.problems.push(problem),
        }
    }
    let sizes = || reading.frames.iter().filter_map(|f| f.size).map(Size::longest_side);
    let folder = match folder(root, options, sizes().max().unwrap_or(0)) {
        Some(folder) => folder,
        None if need == Need::Cameras => root.join("rgb").join("1x"),
        None => return Err(no_photos(root, &reading)),
    };
    place(&folder, &mut reading);
    if need == Need::Images {
        depth_unit(&mut reading)?;
    }
    match authors_frame(root) {
        Ok(Some(authors)) => extents(root, &authors, &mut reading),
        Ok(None) => reading.notes.push("no scene.json: depth range and box are not known".into()),
        Err(error) => reading.problems.push(error.into_problem()),
    }
    points(root, &mut reading)?;
    reading.images_folder = Some(folder);
    Ok(reading)
}

fn frame(
    root: &Path,
    file: &Path,
    id: &str,
    split: Split,
    ids: &HashMap<String, FrameIds>,
) -> Result<RawFrame, Problem> {
    let listed = |what: &str, remedy: &str| Problem::new(file, what, remedy).frame(id).field("ids").value(id);
    // Ids become parts of file names, with a folder before them.
    let path =
        files::inside(root, &format!("camera/{id}.json")).filter(|_| !id.contains(['/', '\\']) && !id.is_empty());
    let path = path.ok_or_else(|| listed("is not the name of a frame", "rename the frame"))?;
    let known = ids.get(id).ok_or_else(|| {
        Problem::new(root.join("metadata.json"), "the frame is not in it", "write its warp_id and appearance_id")
            .frame(id)
    })?;
    let document = Document::read(&path).map_err(|e| e.in_frame(id).into_problem())?;
    let camera = document.top().and_then(|top| camera::camera(&top)).map_err(|p| p.frame(id))?;
    Ok(RawFrame {
        name: id.to_owned(),
        image: PathBuf::from(id),
        listed: (file.to_path_buf(), "ids".into()),
        size: Some(camera.size),
        intrinsics: camera.intrinsics,
        lens: camera.lens,
        pose: camera.pose,
        mended: camera.mended,
        split,
        time: Some(f64::from(known.time)),
        mask: None,
        depth: None,
        transient: None,
        moving: None,
        covisible: None,
        flow: None,
        ids: Some(*known),
        tracks: Vec::new(),
        z_bounds: None,
        sharpness: None,
    })
}

/// Folders `rgb/1x`, `rgb/2x`, … and their factors, largest pictures first.
fn scales(folder: &Path) -> Vec<(u32, PathBuf)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut found: Vec<(u32, PathBuf)> = entries
        .filter_map(|entry| entry.ok().map(|e| e.path()))
        .filter(|path| path.is_dir())
        .filter_map(|path| {
            let factor = path.file_name()?.to_str()?.strip_suffix('x')?.parse().ok()?;
            (factor > 0).then_some((factor, path))
        })
        .collect();
    found.sort();
    found
}

/// The photos' folder: the one the caller names, else the smallest `rgb/Kx` that has the longest side wanted.
fn folder(root: &Path, options: &LoadOptions, side: u32) -> Option<PathBuf> {
    if let Some(folder) = &options.images {
        return Some(folder.clone());
    }
    let scales = scales(&root.join("rgb"));
    let wanted = options.longest_side.unwrap_or(u32::MAX);
    let fits = scales.iter().rev().find(|(factor, _)| side.div_ceil(*factor) >= wanted);
    fits.or(scales.first()).map(|(_, folder)| folder.clone())
}

fn no_photos(root: &Path, reading: &Reading) -> SceneError {
    let count = |split| reading.frames.iter().filter(|f| f.split == split).count();
    let what = format!(
        "holds no folder of images: looked for rgb/1x, rgb/2x, … beside {} cameras ({} to train, {} to test)",
        reading.frames.len(),
        count(Split::Train),
        count(Split::Test)
    );
    SceneError::new(ErrorKind::Layout, Problem::new(root, what, "add the photos, or name their folder"))
}

/// Names the files of every frame: photos, depth maps, covisible pixels.
fn place(folder: &Path, reading: &mut Reading) {
    let root = reading.root.clone();
    let scale = folder.file_name().unwrap_or_default();
    let beside = |kind: &str| {
        let same = root.join(kind).join(scale);
        if same.is_dir() { Some(same) } else { scales(&root.join(kind)).into_iter().next().map(|(_, folder)| folder) }
    };
    let depth = beside("depth");
    // DyCheck's names of what is measured, of its own scenes and of Nerfies' and HyperNeRF's.
    let covisible = beside("covisible").and_then(|folder| {
        ["val", "val_common", "val_mono", "val_intl"].into_iter().map(|s| folder.join(s)).find(|f| f.is_dir())
    });
    let mut maps = 0;
    for frame in &mut reading.frames {
        frame.image = folder.join(format!("{}.png", frame.name));
        let file = |folder: &Option<PathBuf>, extensions: &[&str]| {
            let folder = folder.as_ref()?;
            extensions.iter().map(|e| folder.join(format!("{}.{e}", frame.name))).find(|f| f.is_file())
        };
        let map = file(&depth, &["npy", "png", "exr"]);
        maps += usize::from(map.is_some());
        let covisible = file(&covisible, &["png"]).filter(|_| frame.split == Split::Test);
        frame.depth = map.map(DepthSource::file);
        frame.covisible = covisible;
    }
    let train = reading.frames.iter().filter(|f| f.split == Split::Train);
    let without = train.clone().filter(|f| f.depth.is_none()).count();
    if maps > 0 && without > 0 {
        let what = format!("{without} of {} training frames have no depth map", train.count());
        reading.problems.push(Problem::new(root.join("depth"), what, "their depth counts as not known").warning());
    }
}

/// Metres or millimetres, by the median of the first map that knows any depth.
fn depth_unit(reading: &mut Reading) -> Result<(), SceneError> {
    const MOST_METRES: f64 = 50.0;
    let mut millimetres = false;
    for frame in &reading.frames {
        let Some(DepthSource { place: DepthPlace::File(path), .. }) = &frame.depth else { continue };
        let map = crate::depth::read_file(path).map_err(|e| e.in_frame(&frame.name))?;
        let mut known: Vec<f64> = map.z.iter().map(|z| f64::from(*z)).filter(|z| z.is_finite() && *z > 0.0).collect();
        if known.is_empty() {
            continue;
        }
        known.sort_by(f64::total_cmp);
        let median = known[known.len() / 2];
        millimetres = median > MOST_METRES;
        let unit = if millimetres { "millimetres" } else { "metres" };
        reading.notes.push(format!("depth maps are taken to be in {unit}: their median is {median:.3}"));
        break;
    }
    if millimetres {
        reading.frames.iter_mut().filter_map(|f| f.depth.as_mut()).for_each(|d| d.unit = 1e-3);
    }
    Ok(())
}

/// `scene.json`: the frame the authors work in.
struct AuthorsFrame {
    center: DVec3,
    scale: f64,
    range: Option<[f64; 2]>,
}

fn authors_frame(root: &Path) -> Result<Option<AuthorsFrame>, SceneError> {
    let file = root.join("scene.json");
    if !file.is_file() {
        return Ok(None);
    }
    let document = Document::read(&file)?;
    let read = || {
        let top = document.top()?;
        let center = DVec3::from(top.triple("center")?.unwrap_or_default());
        let scale = top.number("scale")?.unwrap_or(1.0);
        if scale <= 0.0 {
            return Err(top.problem("scale", "must be above 0", "correct it, or remove scene.json"));
        }
        let range = top.number("near")?.zip(top.number("far")?);
        if let Some((near, far)) = range.filter(|(near, far)| !(*near >= 0.0 && far > near)) {
            let problem = Problem::new(&file, "must be at least 0 and below far", "correct near and far");
            return Err(problem.field("near").value(format!("{near} (far = {far})")));
        }
        Ok(AuthorsFrame { center, scale, range: range.map(|(near, far)| [near / scale, far / scale]) })
    };
    read().map(Some).map_err(|p| SceneError::new(ErrorKind::Value, p))
}

/// Depth ranges from `near` and `far`, the box from `extra.json`, both in world units.
fn extents(root: &Path, authors: &AuthorsFrame, reading: &mut Reading) {
    let AuthorsFrame { center, scale, range } = authors;
    reading
        .notes
        .push(format!("scene.json: the authors' frame is (x - {center}) * {scale}; the world of the cameras is kept"));
    if let Some([near, far]) = *range {
        for frame in &mut reading.frames {
            frame.z_bounds = Some([near * corner_cosine(frame), far]).filter(|[near, _]| *near > 0.0);
        }
    }
    let file = root.join("extra.json");
    if !file.is_file() {
        return;
    }
    // An extra: a broken one is told, not refused.
    let corners = Document::read(&file).map_err(SceneError::into_problem).and_then(|d| d.top()?.blocks("bbox", 1, 3));
    match corners {
        Ok(Some(corners)) if corners.len() == 2 => {
            let world = |corner: &[f64]| DVec3::from_slice(corner) / *scale + *center;
            let (a, b) = (world(&corners[0]), world(&corners[1]));
            if is_point(a) && is_point(b) {
                reading.bounds = Some(Bounds { min: a.min(b), max: a.max(b) });
            } else {
                let problem = Problem::new(&file, "lies outside of any scene", "correct it, or `scale` of scene.json");
                reading.problems.push(problem.field("bbox").value(format!("{corners:?}")).warning());
            }
        }
        Ok(None) => {}
        Ok(Some(_)) => {
            let problem = Problem::new(&file, "is not a box", "write its two corners").field("bbox");
            reading.problems.push(problem.warning());
        }
        Err(problem) => reading.problems.push(problem.warning()),
    }
}

/// Smallest cosine between the optical axis and the rays through the corners of the picture; 0 where a lens has none there.
fn corner_cosine(frame: &RawFrame) -> f64 {
    let Some(Size { width, height }) = frame.size else { return 0.0 };
    let camera: Camera = frame.intrinsics.camera(width, height, frame.lens, frame.pose);
    let camera = camera.prepare();
    let (w, h) = (f64::from(width), f64::from(height));
    let corners = [DVec2::ZERO, DVec2::new(w, 0.0), DVec2::new(0.0, h), DVec2::new(w, h)];
    corners.into_iter().map(|c| camera.direction(c).map_or(0.0, |d| d.z.max(0.0))).fold(1.0, f64::min)
}

/// `points.npy`, without colours: grey.
fn points(root: &Path, reading: &mut Reading) -> Result<(), SceneError> {
    let file = root.join("points.npy");
    if !file.is_file() {
        return Ok(());
    }
    let array = npy::read(&file)?;
    let &[_, 3] = array.shape.as_slice() else {
        let problem = Problem::new(&file, "is not a list of points", "it should have the shape (points, 3)");
        return Err(SceneError::new(ErrorKind::Format, problem.field("shape").value(format!("{:?}", array.shape))));
    };
    let (rows, _) = array.data.as_chunks::<3>();
    let points = rows.iter().map(|row| DVec3::from_array(*row)).filter(|p| is_point(*p));
    reading.points = points.map(|xyz| Point { xyz, rgb: [128; 3] }).collect();
    reading.notes.push(format!("{} points of the background, which stands still", reading.points.len()));
    let lost = rows.len() - reading.points.len();
    if lost > 0 {
        let problem =
            Problem::new(&file, format!("{lost} points are not finite, or out of range"), "they are left out");
        reading.problems.push(problem.warning());
    }
    Ok(())
}

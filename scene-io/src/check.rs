//! Everything there is to say about a dataset, before training on it.

mod motion;

pub use motion::MotionSummary;

use crate::capture::{self, Thumb};
use crate::frame_files::refuse_blank_masks;
use crate::listing::listing;
use crate::load::load_all;
use crate::reading::Need;
use crate::splits::numbers;
use crate::{
    Dialect, ErrorKind, Frame, ImageStore, LayoutHint, LoadOptions, Problem, Scene, Severity, Size, Split,
    StoreOptions, time,
};
use rayon::prelude::*;
use render_core::camera::Lens;
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

/// How closely [`check`] looks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Depth {
    /// Image headers only: fast, but a truncated image is not noticed.
    Headers,
    /// Every image, mask, depth map and prior is decoded.
    #[default]
    Pixels,
}

/// What a dataset holds and what is wrong with it.
#[derive(Clone, Debug)]
pub struct Report {
    /// The scene as far as it could be read; `None` where it could not at all.
    pub scene: Option<Scene>,
    /// Frames of each split.
    pub splits: Vec<(Split, usize)>,
    /// Image sizes with the number of frames that have them.
    pub sizes: Vec<(Size, usize)>,
    /// Names of lens models with the number of frames that have them.
    pub lenses: Vec<(&'static str, usize)>,
    /// Smallest and largest focal length, pixels.
    pub focal: Option<(f64, f64)>,
    /// Bytes of all images once decoded at their native size.
    pub image_bytes: u64,
    /// Mean share of the training photos' pixels that ignore masks leave; `None` without masks, or where they were not opened.
    pub masks_leave: Option<f64>,
    /// What the depth maps hold; `None` where there are none, or they were not opened.
    pub depth: Option<DepthSummary>,
    /// What priors of motion hold; `None` where there are none, or they were not opened.
    pub motion: Option<MotionSummary>,
    /// What is wrong with the files, errors first.
    pub problems: Vec<Problem>,
    /// Why the result must be poor although the files are whole: warnings on the photos and where they were taken.
    pub capture: Vec<Problem>,
    /// What was skipped, matched or assumed.
    pub notes: Vec<String>,
}

/// What the depth maps of a dataset hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthSummary {
    /// Maps that could be read.
    pub maps: usize,
    /// Mean share of their pixels whose depth is not known.
    pub holes: f64,
    /// Smallest and largest depth, world units; `None` where nothing is known.
    pub range: Option<[f32; 2]>,
}

/// Reads a dataset and lists all its problems; never fails.
///
/// Where the files are whole but for their images, the report is on the cameras.
#[must_use]
pub fn check(path: &Path, options: &LoadOptions, depth: Depth) -> Report {
    match load_all(path, options, Need::Images) {
        Ok((scene, problems)) => Report::new(scene, problems, depth),
        Err(error) => {
            let cameras = match error.kind() {
                ErrorKind::Layout => load_all(path, options, Need::Cameras).ok(),
                _ => None,
            };
            let mut problems = vec![error.into_problem()];
            let scene = cameras.map(|(scene, more)| {
                problems.extend(more);
                scene
            });
            let report = Report {
                scene: None,
                splits: Vec::new(),
                sizes: Vec::new(),
                lenses: Vec::new(),
                focal: None,
                image_bytes: 0,
                masks_leave: None,
                depth: None,
                motion: None,
                problems,
                capture: Vec::new(),
                notes: Vec::new(),
            };
            match scene {
                Some(scene) => report.with_cameras(scene),
                None => report,
            }
        }
    }
}

impl Report {
    /// A report on a scene, from whatever source, and problems met while reading it.
    ///
    /// # Panics
    /// If a picture in memory has no pixels, or holds less than its size says.
    #[must_use]
    pub fn new(scene: Scene, mut problems: Vec<Problem>, depth: Depth) -> Self {
        problems.extend(geometry(&scene));
        let (mut image_bytes, mut masks_leave, mut summary, mut moves) = (0, None, None, None);
        let mut capture = Vec::new();
        match ImageStore::new(&scene.frames, StoreOptions { budget_bytes: 0, ..StoreOptions::default() }) {
            Ok(store) => {
                image_bytes = store.estimate_bytes();
                if depth == Depth::Pixels {
                    let mut thumbs = Vec::with_capacity(store.len());
                    let thumb = |i| store.with_image(i, Thumb::work_bytes(store.camera(i).width), Thumb::of);
                    let decoded: Vec<Result<Thumb, _>> = (0..store.len()).into_par_iter().map(thumb).collect();
                    for photo in decoded {
                        match photo {
                            Ok(thumb) => thumbs.push(Some(thumb)),
                            Err(error) => {
                                problems.push(error.into_problem());
                                thumbs.push(None);
                            }
                        }
                    }
                    capture = capture::find_problems(&scene, &thumbs);
                    problems.extend(priors(&scene));
                    let (priors_of_motion, more) = motion::motion(&scene);
                    moves = priors_of_motion;
                    problems.extend(more);
                    match refuse_blank_masks(&scene.frames) {
                        Ok(share) => masks_leave = share,
                        Err(error) => problems.push(error.into_problem()),
                    }
                    let (maps, more) = depth_maps(&scene);
                    summary = maps;
                    problems.extend(more);
                }
            }
            Err(error) => problems.push(error.into_problem()),
        }
        if depth == Depth::Headers {
            capture = capture::without_pictures(&scene);
        }
        // Stable: within a severity, problems stay in the order of the files.
        problems.sort_by_key(|p| std::cmp::Reverse(p.severity));
        let report = Self {
            scene: None,
            splits: Vec::new(),
            sizes: Vec::new(),
            lenses: Vec::new(),
            focal: None,
            image_bytes,
            masks_leave,
            depth: summary,
            motion: moves,
            problems,
            capture,
            notes: Vec::new(),
        };
        report.with_cameras(scene)
    }

    /// The report with what a scene's cameras and notes say.
    fn with_cameras(self, scene: Scene) -> Self {
        let (mut sizes, mut lenses) = (BTreeMap::new(), BTreeMap::new());
        let mut focal: Option<(f64, f64)> = None;
        for Frame { camera, .. } in &scene.frames {
            *sizes.entry((camera.width, camera.height)).or_insert(0) += 1;
            *lenses.entry(lens_name(&camera.lens)).or_insert(0) += 1;
            let (low, high) = focal.unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
            focal = Some((low.min(camera.fx).min(camera.fy), high.max(camera.fx).max(camera.fy)));
        }
        Self {
            splits: Split::ALL.into_iter().map(|split| (split, scene.count(split))).collect(),
            sizes: sizes.into_iter().map(|(size, n)| (Size::from(size), n)).collect(),
            lenses: lenses.into_iter().collect(),
            focal,
            notes: scene.notes.clone(),
            scene: Some(scene),
            ..self
        }
    }

    /// Whether nothing stands against training.
    #[must_use]
    pub fn can_train(&self) -> bool {
        self.scene.is_some() && self.problems.iter().all(|p| p.severity < Severity::Error)
    }
}

fn lens_name(lens: &Lens) -> &'static str {
    match lens {
        Lens::Perspective { .. } if lens.is_pinhole() => "pinhole",
        Lens::Perspective { .. } => "perspective with distortion",
        Lens::Fisheye { .. } => "fisheye",
        Lens::Fov { .. } => "field-of-view",
        Lens::ThinPrismFisheye { .. } => "thin-prism fisheye",
    }
}

/// What looks wrong about the cameras as a set.
fn geometry(scene: &Scene) -> Vec<Problem> {
    let mut problems = Vec::new();
    let train: Vec<&Frame> = scene.frames.iter().filter(|f| f.split == Split::Train).collect();
    let warn = |what: String, remedy: &str| Problem::new(&scene.root, what, remedy).warning();
    if scene.frames.len() == 1 {
        problems.push(warn("holds a single image, which shows no parallax".into(), "add views from other places"));
    }
    if let [first, rest @ ..] = train.as_slice()
        && !rest.is_empty()
    {
        let c = first.camera.pose.c;
        let apart = rest.iter().map(|f| f.camera.pose.c.distance(c)).fold(0.0, f64::max);
        // Relative to the distance from the origin, which rounding is relative to.
        if apart <= 1e-9 * c.length().max(1.0) {
            let known = train.iter().filter(|f| f.depth.is_some()).count();
            let what =
                format!("all {} training cameras stand at the same place: no parallax, so no depth", train.len());
            // A stereo endoscope stands still by design, and its depth maps know what parallax would tell.
            if known < train.len() {
                problems.push(warn(what, "photograph from different places, or check the poses, or add depth maps"));
            }
        }
    }
    let odd: Vec<&str> = scene
        .frames
        .iter()
        .filter(|f| {
            let side = f64::from(f.camera.width.max(f.camera.height));
            // 0.1 and 20 image sides: 157 and 2.9 degrees of view.
            !(0.1 * side..=20.0 * side).contains(&f.camera.fx) || !(0.05..=20.0).contains(&(f.camera.fx / f.camera.fy))
        })
        .map(|f| f.name.as_str())
        .collect();
    if !odd.is_empty() {
        let what = format!("unusual focal lengths for the image size in {}", listing(&odd));
        problems.push(warn(what, "check fl_x, fl_y or the camera file"));
    }
    problems
}

/// What is wrong with files that belong to the photos, each read once.
fn priors(scene: &Scene) -> Vec<Problem> {
    let read = |frame: &Frame| {
        [
            frame.read_segments().err(),
            frame.read_prompted().err(),
            frame.read_features().err(),
            frame.read_transient().err(),
            frame.read_moving().err(),
            frame.read_covisible().err(),
            frame.read_flow().err(),
        ]
    };
    let errors: Vec<_> = scene.frames.par_iter().flat_map_iter(read).flatten().collect();
    errors.into_iter().map(|e| e.into_problem()).collect()
}

/// What the depth maps hold, each read once, and what is wrong with them.
fn depth_maps(scene: &Scene) -> (Option<DepthSummary>, Vec<Problem>) {
    struct Map {
        holes: f64,
        range: Option<[f32; 2]>,
    }
    let read = |frame: &Frame| match frame.read_depth() {
        Ok(map) => map.map(|map| Ok(Map { holes: map.holes() as f64 / map.z.len().max(1) as f64, range: map.range() })),
        Err(error) => Some(Err(error.into_problem())),
    };
    let maps: Vec<Option<Result<Map, Problem>>> = scene.frames.par_iter().map(read).collect();
    let (mut problems, mut summary) = (Vec::new(), DepthSummary { maps: 0, holes: 0.0, range: None });
    let (mut flat, mut empty) = (Vec::new(), Vec::new());
    for (frame, map) in scene.frames.iter().zip(maps) {
        match map {
            None => {}
            Some(Err(problem)) => problems.push(problem),
            Some(Ok(map)) => {
                summary.maps += 1;
                summary.holes += map.holes;
                match map.range {
                    None => empty.push(frame.name.as_str()),
                    Some([low, high]) => {
                        if low == high {
                            flat.push(frame.name.as_str());
                        }
                        let [least, most] = summary.range.unwrap_or([low, high]);
                        summary.range = Some([least.min(low), most.max(high)]);
                    }
                }
            }
        }
    }
    for (names, what, remedy) in [
        (flat, "the depth is the same everywhere", "check the depth maps: a wall straight ahead is rare"),
        (empty, "no depth is known anywhere", "remove these depth maps, or make them anew"),
    ] {
        if !names.is_empty() {
            problems.push(Problem::new(&scene.root, format!("{what} in {}", listing(&names)), remedy).warning());
        }
    }
    if summary.maps == 0 {
        return (None, problems);
    }
    summary.holes /= summary.maps as f64;
    (Some(summary), problems)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(scene) = &self.scene {
            writeln!(f, "{} ({}): {}", scene.name, scene.dialect, numbers(&scene.frames))?;
            let sizes: Vec<String> = self.sizes.iter().map(|(size, n)| format!("{n} of {size}")).collect();
            let texts: Vec<&str> = sizes.iter().map(String::as_str).collect();
            writeln!(f, "images: {}; {:.1} MB decoded", listing(&texts), self.image_bytes as f64 / 1e6)?;
            let lenses: Vec<String> = self.lenses.iter().map(|(name, n)| format!("{n} {name}")).collect();
            let focal = self.focal.map_or(String::new(), |(low, high)| {
                if high - low < 0.05 {
                    format!(", focal length {low:.1} px")
                } else {
                    format!(", focal lengths {low:.1} to {high:.1} px")
                }
            });
            writeln!(f, "cameras: {}{focal}", lenses.join(", "))?;
            let layout = match scene.layout {
                LayoutHint::Object { near, far } => format!("an object, {near} to {far} from the cameras"),
                LayoutHint::ForwardFacing => "forward facing".into(),
                LayoutHint::Unbounded => "unbounded".into(),
                LayoutHint::Unknown => "not said".into(),
            };
            let points = scene.points.len();
            let masks = scene.frames.iter().filter(|f| f.mask.is_some()).count();
            let depths = scene.frames.iter().filter(|f| f.depth.is_some()).count();
            writeln!(f, "layout: {layout}; priors: {points} points, {masks} masks, {depths} depth maps")?;
            match time::summary(&scene.frames) {
                None => writeln!(f, "times: none")?,
                Some((count, distinct, [first, last])) => {
                    writeln!(f, "times: {count} frames, {distinct} distinct, {first} to {last}")?;
                }
            }
            if let Some(share) = self.masks_leave {
                writeln!(f, "masks: {:.1} % of the training photos' pixels are used", 100.0 * share)?;
            }
            if let Some(depth) = &self.depth {
                let range = match depth.range {
                    Some([low, high]) => format!("{low} to {high} world units"),
                    None => "nothing known".into(),
                };
                let holes = 100.0 * depth.holes;
                writeln!(f, "depth: {} maps, {range}, {holes:.1} % of the pixels not known", depth.maps)?;
            }
            for found in self.motion.iter().flat_map(MotionSummary::lines) {
                writeln!(f, "{found}")?;
            }
            let count = |has: &dyn Fn(&Frame) -> bool| scene.frames.iter().filter(|f| has(f)).count();
            let truth = [
                (count(&|f| f.truth.transient.is_some()), "what does not belong"),
                (count(&|f| f.truth.moving.is_some()), "what moves"),
                (count(&|f| f.truth.covisible.is_some()), "what training frames show, too"),
            ];
            let truth: Vec<String> =
                truth.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} masks of {what}")).collect();
            if !truth.is_empty() {
                writeln!(f, "truth: {}", truth.join(", "))?;
            }
            if scene.dialect != Dialect::Synthetic && self.splits.iter().any(|(s, n)| *s == Split::Test && *n > 0) {
                let names = scene.held_out_names();
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                writeln!(f, "held out: {}", listing(&names))?;
            }
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        for problem in self.problems.iter().chain(&self.capture) {
            let severity = match problem.severity {
                Severity::Warning => "warning",
                Severity::Error => "error",
            };
            writeln!(f, "{severity}: {problem}")?;
        }
        if self.can_train() { write!(f, "can be trained") } else { write!(f, "cannot be trained") }
    }
}

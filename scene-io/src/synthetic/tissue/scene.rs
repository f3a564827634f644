//! The pictures of an operation: what is trained on, and what was truly behind the tool.

use super::snapshot::Tissue;
use super::stereo::Stereo;
use super::tool::TissueTool;
use crate::bit_mask::BitMask;
use crate::priors::{SceneFlow, TruthMask};
use crate::{Bounds, DepthMap, DepthSource, Dialect, Frame, Image, ImageSource, LayoutHint, Scene, Split, Truth};
use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use render_core::camera::{Camera, Pose};
use std::path::PathBuf;
use std::sync::Arc;

/// Focal length over width of EndoNeRF's endoscope: 569.468 at 640.
const FOCAL: f64 = 569.468_200_41 / 640.0;

/// Size, number and seed of the pictures of [`tissue`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TissueOptions {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Moments: `i / (frames - 1)`, a single one at time 0. Each gives a training picture with the tool and a test picture
    /// without.
    pub frames: usize,
    /// Varies tissue, motion and the tool's way.
    pub seed: u64,
    /// Rays of a pixel along each side: the square of it in all.
    pub rays: u32,
    /// What the tool does.
    pub tool: TissueTool,
    /// Masks are this much larger than the tool, pixels on all sides: as those of a careful segmentation.
    pub margin: u32,
    /// How depth of training pictures is measured.
    pub stereo: Stereo,
}

impl Default for TissueOptions {
    /// 48 moments of 128 x 96 pixels, 2 x 2 rays each, masks a pixel larger than the tool.
    fn default() -> Self {
        Self {
            width: 128,
            height: 96,
            frames: 48,
            seed: 0,
            rays: 2,
            tool: TissueTool::Sweeping,
            margin: 1,
            stereo: Stereo::default(),
        }
    }
}

/// What is known of one time.
#[derive(Clone, Debug)]
pub struct TissueTruth {
    /// When.
    pub time: f64,
    /// What the camera sees.
    pub picture: Image,
    /// What it would see without the tool.
    pub without_tool: Image,
    /// Pixels of which any ray met the tool.
    pub tool: BitMask,
    /// The mask that is handed out: the tool and a margin.
    pub mask: BitMask,
    /// Exact z depth of what is seen at the pixel centres, mm.
    pub seen_depth: DepthMap,
    /// Exact z depth of the tissue, mm.
    pub tissue_depth: DepthMap,
    /// What the stereo matcher makes of it.
    pub stereo_depth: DepthMap,
    /// Pixels under the mask whose tissue is in sight in another picture, outside its mask: what can be recovered.
    pub recoverable: BitMask,
    /// Exact scene flow of the tissue to the next picture's time, of the last picture to the time before; `None` of a single one.
    pub scene_flow: Option<Arc<SceneFlow>>,
}

/// The camera of all pictures: at the origin, looking along -z, y up.
#[must_use]
pub fn tissue_camera(options: &TissueOptions) -> Camera {
    let (w, h) = (f64::from(options.width), f64::from(options.height));
    let focal = FOCAL * w;
    let pose = Pose { r: DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)), c: DVec3::ZERO };
    Camera::pinhole(options.width, options.height, focal, focal, 0.5 * w, 0.5 * h, pose)
}

/// Everything about every photo's time, in their order. The same options give the same bits.
///
/// # Panics
/// If `rays` or a side is 0.
#[must_use]
pub fn tissue_truth(options: &TissueOptions) -> Vec<TissueTruth> {
    let (w, h) = (options.width, options.height);
    assert!(w > 0 && h > 0, "tissue: pictures of {w} x {h} pixels");
    let camera = tissue_camera(options);
    let tissue = Tissue::new(options.seed, options.tool);
    let last = options.frames.saturating_sub(1).max(1) as f64;
    let moments: Vec<_> = (0..options.frames).map(|i| (i as f64 / last, tissue.at(i as f64 / last))).collect();
    let prepared = camera.prepare();
    let centre = |column: u32, row: u32| DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5);
    let index = |column: u32, row: u32| row as usize * w as usize + column as usize;
    let mut truths: Vec<(TissueTruth, Vec<Option<DVec2>>)> = moments
        .par_iter()
        .enumerate()
        .map(|(number, (time, snapshot))| {
            let (picture, without_tool, tool) = snapshot.render(&camera, options.rays);
            let rays: Vec<_> = (0..h).flat_map(|row| (0..w).map(move |column| (column, row))).collect();
            // A pinhole has a ray for every pixel.
            let rays: Vec<_> = rays.iter().filter_map(|(column, row)| prepared.ray(centre(*column, *row))).collect();
            let map = |z: Vec<f32>| DepthMap { width: w, height: h, z };
            let hits: Vec<_> = rays.iter().map(|ray| snapshot.trace_tissue(ray)).collect();
            let seen: Vec<_> = rays.iter().zip(&hits).map(|(ray, hit)| snapshot.before(ray, *hit)).collect();
            let mask = grown(&tool, options.margin);
            let beside = if number + 1 < moments.len() { Some(number + 1) } else { number.checked_sub(1) };
            let truth = TissueTruth {
                time: *time,
                picture,
                without_tool,
                mask,
                tool,
                seen_depth: map(seen.iter().map(|hit| hit.z as f32).collect()),
                tissue_depth: map(hits.iter().map(|hit| hit.z as f32).collect()),
                stereo_depth: snapshot.match_hits(&seen, &camera, &options.stereo, options.seed, number),
                recoverable: BitMask::new(w, h),
                scene_flow: beside.map(|k| Arc::new(moments[k].1.followed(&hits, moments[k].0))),
            };
            (truth, hits.iter().map(|hit| hit.material).collect())
        })
        .collect();
    let in_sight = |number: usize, q: DVec2| {
        // Nearest moments first: they most likely show it.
        (1..truths.len()).any(|away| {
            let others = [number.checked_sub(away), Some(number + away)];
            others.into_iter().flatten().filter(|other| *other < truths.len()).any(|other| {
                let pixel = moments[other].1.find(q, &camera);
                pixel.is_some_and(|p| !truths[other].0.mask.get(p.x as u32, p.y as u32))
            })
        })
    };
    let recoverable: Vec<BitMask> = truths
        .par_iter()
        .enumerate()
        .map(|(number, (truth, materials))| {
            BitMask::from_fn(w, h, |column, row| {
                let q = materials[index(column, row)];
                truth.mask.get(column, row) && q.is_some_and(|q| in_sight(number, q))
            })
        })
        .collect();
    for ((truth, _), recoverable) in truths.iter_mut().zip(recoverable) {
        truth.recoverable = recoverable;
    }
    truths.into_iter().map(|(truth, _)| truth).collect()
}

/// A mask and what is at most `margin` pixels beside it, along rows and columns.
fn grown(mask: &BitMask, margin: u32) -> BitMask {
    let (w, h) = (mask.width(), mask.height());
    BitMask::from_fn(w, h, |column, row| {
        let rows = row.saturating_sub(margin)..=(row + margin).min(h - 1);
        let columns = || column.saturating_sub(margin)..=(column + margin).min(w - 1);
        rows.into_iter().any(|r| columns().any(|c| mask.get(c, r)))
    })
}

/// Pictures of the tissue with a tool in front, as training frames: ignore mask, stereo depth and the true tool
/// ([`Truth::transient`]); the same moments without the tool and with exact depth and scene flow as test frames, whose
/// [`Truth::transient`] is what was hidden and can be recovered. More says [`tissue_truth`].
///
/// # Panics
/// As [`tissue_truth`].
#[must_use]
pub fn tissue(options: &TissueOptions) -> Scene {
    let camera = tissue_camera(options);
    let (mut train, mut test) = (Vec::new(), Vec::new());
    for (i, truth) in tissue_truth(options).into_iter().enumerate() {
        let z_bounds = z_range([&truth.seen_depth, &truth.tissue_depth]);
        let mut picture = truth.picture;
        if options.tool != TissueTool::Absent {
            let places = (0..options.height).flat_map(|row| (0..options.width).map(move |column| (column, row)));
            picture.mask = Some(places.map(|(c, r)| if truth.mask.get(c, r) { 0 } else { 255 }).collect());
        }
        let frame = |split: Split, image: Image, depth: DepthMap, transient: BitMask| Frame {
            split,
            time: Some(truth.time),
            depth: Some(DepthSource::memory(depth)),
            z_bounds: Some(z_bounds),
            truth: Truth { transient: Some(TruthMask::Memory(Arc::new(transient))), ..Truth::default() },
            ..Frame::new(format!("{}/{i:06}", split.name()), ImageSource::Memory(Arc::new(image)), camera)
        };
        train.push(frame(Split::Train, picture, truth.stereo_depth, truth.tool));
        let mut held_out = frame(Split::Test, truth.without_tool, truth.tissue_depth, truth.recoverable);
        held_out.truth.scene_flow = truth.scene_flow;
        test.push(held_out);
    }
    train.append(&mut test);
    Scene {
        name: "tissue".to_owned(),
        root: PathBuf::new(),
        dialect: Dialect::Synthetic,
        frames: train,
        points: Vec::new(),
        layout: LayoutHint::Unknown,
        bounds: Some(bounds(&camera)),
        notes: Vec::new(),
    }
}

/// Smallest and largest depth of some maps, mm.
pub(super) fn z_range(maps: [&DepthMap; 2]) -> [f64; 2] {
    maps.iter().flat_map(|map| &map.z).fold([f64::INFINITY, 0.0], |[low, high], z| {
        let z = f64::from(*z);
        [low.min(z), high.max(z)]
    })
}

/// What the camera sees of the tissue at all times.
fn bounds(camera: &Camera) -> Bounds {
    let [near, far] = super::sheet::RANGE;
    let side = |pixels: u32, focal: f64| 0.5 * f64::from(pixels) / focal * far;
    let (x, y) = (side(camera.width, camera.fx), side(camera.height, camera.fy));
    Bounds { min: DVec3::new(-x, -y, -far), max: DVec3::new(x, y, -near) }
}

//! Poses by the crate `openmvg-sfm`, within this program: no other program is needed.

use crate::error::PrepareError;
use crate::pairs::{ALL_PAIRS, of_video};
use crate::sparse_text::{SparseCamera, SparseImage, SparseModel, SparsePoint};
use crate::stage::{State, hash};
use crate::task::Task;
use crate::tool::Log;
use crate::watch::{Event, Meter, Watch};
use glam::{DMat3, DVec3};
use image::RgbImage;
use openmvg_core::{RadialDistortion, TangentialDistortion};
use openmvg_sfm::model::{ImageMeta, IntrinsicPrior};
use openmvg_sfm::progress::{SfmProgressSink, SfmProgressStage};
use openmvg_sfm::unstable::{SfmConfig, SfmWorkspaceBuilder};
use openmvg_sfm::{
    Camera, Dataset, Frontend, Incremental, IntrinsicId, Reconstruction, Runner, SfmEngine, SfmError, ViewId, ViewPair,
    checkpoint,
};
use render_core::camera::Pose;
use scene_io::Size;
use std::collections::HashMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// Name and version.
pub(crate) const NAME: &str = "openmvg-sfm 0.1.0";

/// Writes a model of as many photos as can be placed.
///
/// # Errors
/// [`PrepareError`] where the crate finds nothing, or files cannot be written.
pub(crate) fn reconstruct(task: &Task<'_>, log: &mut Log, watch: &mut dyn Watch) -> Result<(), PrepareError> {
    const STAGE: &str = "poses";
    let inputs = hash([task.inputs.as_str(), NAME]);
    if matches!(task.stages.state(STAGE, &inputs), State::Done(_)) && scene_io::colmap::Model::read(&task.model).is_ok()
    {
        watch.event(Event::Note("poses: done before"));
        return Ok(());
    }
    task.stages.begin(STAGE, &inputs)?;
    log.line(&format!("$ {NAME}"));
    let result = with_progress(watch, |sink| solve(task, &inputs, sink));
    let reconstruction = result.map_err(|error| {
        log.line(&format!("{error}"));
        failed(&error)
    })?;
    let model = model(task, &reconstruction)?;
    model.write(&task.model)?;
    task.stages.finish(STAGE, &inputs, serde_json::Value::Null)
}

fn failed(error: &SfmError) -> PrepareError {
    match error {
        SfmError::Canceled => PrepareError::Stopped,
        other => PrepareError::NoCameras {
            what: format!("{NAME} could not place the photos: {other}"),
            remedy: "photos of one place need to overlap: take more of them, or try `--with colmap`".into(),
        },
    }
}

/// The images, cameras and pairs of the task to a reconstruction.
fn solve(task: &Task<'_>, inputs: &str, sink: &dyn SfmProgressSink) -> Result<Reconstruction, SfmError> {
    let mut group_of = HashMap::new();
    for (i, group) in task.groups.iter().enumerate() {
        group_of.extend(group.names.iter().map(|name| (name.as_str(), i)));
    }
    let of = |name: &str| group_of.get(name).copied().unwrap_or(0);
    let metas = task.names.iter().map(|name| {
        let Size { width, height } = task.groups.get(of(name)).map_or(Size::new(0, 0), |g| g.size);
        ImageMeta::path(task.images.join(name), width, height)
    });
    let metas: Vec<ImageMeta> = metas.collect();
    let cameras = task.groups.iter().map(|g| {
        // Its pixel centres lie on whole numbers.
        let centre = |side: u32| f64::from(side) / 2.0 - 0.5;
        let focal = g.first_focal();
        radial_camera(focal, centre(g.size.width), centre(g.size.height))
    });
    let cameras = cameras.collect::<Result<Vec<Camera>, SfmError>>()?;
    let priors = task.groups.iter().map(|g| match g.focal {
        Some(_) => IntrinsicPrior::Trusted,
        None => IntrinsicPrior::Guess,
    });
    let priors: Vec<IntrinsicPrior> = priors.collect();
    let assignment: Vec<IntrinsicId> = task.names.iter().map(|name| IntrinsicId::new(of(name))).collect();
    let frontend = Frontend::default();
    if task.in_order && task.names.len() > ALL_PAIRS {
        let pairs = of_video(task.names.len()).into_iter().map(|(a, b)| ViewPair::new(ViewId::new(a), ViewId::new(b)));
        let mut workspace = SfmWorkspaceBuilder::new()
            .root_seed(Dataset::DEFAULT_SEED)
            .image_meta(metas)
            .camera_models(cameras)
            .intrinsic_priors(priors)
            .view_intrinsics(assignment)
            .imported_pairs(pairs)
            .build()?;
        frontend.stage_with(&mut workspace, None, None, sink)?;
        let runner = Runner::for_config(SfmConfig::for_engine(SfmEngine::Incremental));
        let (workspace, _) = runner.progress(sink).run_workspace(workspace)?;
        return Ok(Reconstruction::from_workspace(workspace, SfmEngine::Incremental, false));
    }
    // Features and matches take nearly all of the time: they are kept.
    let saved = task.stages.folder.join(format!("graph-{}.omvgrs", &inputs[..16]));
    let graph = match checkpoint::read_view_graph(&saved) {
        Ok(graph) => graph,
        Err(_) => {
            let dataset = Dataset::builder()
                .image_meta(metas)
                .camera_models(cameras)
                .intrinsic_priors(priors)
                .view_intrinsics(assignment)
                .build()?;
            let (graph, _) = frontend.build_with_report(&dataset, sink)?;
            checkpoint::write_view_graph(&graph, &saved)?;
            graph
        }
    };
    let output = Incremental::default().runner().progress(sink).run_prepared_owned(graph)?;
    Ok(output.reconstruction().clone())
}

/// A camera of one focal length and one distortion coefficient, 0 to begin with.
fn radial_camera(focal: f64, cx: f64, cy: f64) -> Result<Camera, SfmError> {
    Ok(Camera::try_brown_conrady(focal, focal, cx, cy, RadialDistortion::K1(0.0), TangentialDistortion::None)?)
}

/// A reconstruction in COLMAP's terms, with the colours that the photos show.
fn model(task: &Task<'_>, found: &Reconstruction) -> Result<SparseModel, PrepareError> {
    let mut model = SparseModel::default();
    for (camera, group) in found.camera_models().iter().zip(task.groups) {
        model.cameras.push(sparse_camera(camera, group.size)?);
    }
    let mut image_at = vec![None; task.names.len()];
    for (i, (view, name)) in found.views().iter().zip(&task.names).enumerate() {
        let pose = found.pose(view.id).map(|record| &record.pose);
        let Some(pose) = pose else { continue };
        let (r, c) = (pose.rotation_matrix(), pose.center());
        // Rows of the world-to-camera rotation are columns of the way back.
        let row = |i: usize| DVec3::new(r[(i, 0)], r[(i, 1)], r[(i, 2)]);
        let pose = Pose { r: DMat3::from_cols(row(0), row(1), row(2)), c: DVec3::new(c.x, c.y, c.z) };
        image_at[i] = Some(model.images.len());
        let camera = view.intrinsic_id.index();
        model.images.push(SparseImage { name: (*name).into(), camera, pose, seen: Vec::new() });
    }
    // Landmarks that were rejected keep their numbers; points are numbered without them.
    let mut point_at: HashMap<usize, usize> = HashMap::new();
    for landmark in found.landmarks().iter_active() {
        point_at.insert(landmark.id.index(), model.points.len());
        let p = landmark.point;
        let error = landmark.reprojection_error.value();
        model.points.push(SparsePoint { xyz: DVec3::new(p.x, p.y, p.z), rgb: [0; 3], error, track: Vec::new() });
    }
    for seen in found.observations() {
        let image = image_at.get(seen.view.index()).copied().flatten();
        let (Some(image), Some(point)) = (image, point_at.get(&seen.landmark.index()).copied()) else { continue };
        let place = model.images[image].seen.len();
        model.points[point].track.push((image, place));
        model.images[image].seen.push(([seen.pixel.x + 0.5, seen.pixel.y + 0.5], point));
    }
    colour(task, &mut model)?;
    model.points.retain(|p| p.track.len() > 1);
    model.renumber();
    Ok(model)
}

/// Gives each point the mean colour of the pixels it is seen at. One photo is in memory at a time.
fn colour(task: &Task<'_>, model: &mut SparseModel) -> Result<(), PrepareError> {
    let mut sums = vec![([0_u64; 3], 0_u64); model.points.len()];
    for image in &model.images {
        let picture: RgbImage = scene_io::with_photo(&task.images.join(&image.name), 1, |p| p.into_rgb8())?;
        let at = |x: f64, side: u32| x.clamp(0.0, f64::from(side.saturating_sub(1))) as u32;
        for ([x, y], point) in &image.seen {
            let pixel = picture.get_pixel(at(*x, picture.width()), at(*y, picture.height()));
            let (sum, count) = &mut sums[*point];
            for (sum, value) in sum.iter_mut().zip(pixel.0) {
                *sum += u64::from(value);
            }
            *count += 1;
        }
    }
    for (point, (sum, count)) in model.points.iter_mut().zip(sums) {
        point.rgb = sum.map(|s| (s / count.max(1)) as u8);
    }
    Ok(())
}

fn sparse_camera(camera: &Camera, size: Size) -> Result<SparseCamera, PrepareError> {
    let Camera::BrownConrady(lens) = camera else {
        let what = format!("{NAME} gave a camera of another kind than it was given");
        return Err(PrepareError::NoCameras { what, remedy: "try `--with colmap`".into() });
    };
    let radial = lens.radial_distortion();
    Ok(SparseCamera {
        size,
        focal: [lens.focal_x(), lens.focal_y()],
        centre: [lens.principal_x() + 0.5, lens.principal_y() + 0.5],
        k: [radial.k1(), radial.k2()],
    })
}

/// Runs `work` on a thread of its own and passes its progress on to the watcher, which stays here.
fn with_progress<T: Send>(
    watch: &mut dyn Watch,
    work: impl FnOnce(&dyn SfmProgressSink) -> Result<T, SfmError> + Send,
) -> Result<T, SfmError> {
    let (sender, told) = mpsc::channel();
    let sink = Sink { stop: AtomicBool::new(false), sender: Mutex::new(sender) };
    std::thread::scope(|scope| {
        let handle = scope.spawn(|| {
            let result = work(&sink);
            sink.tell(Told::End);
            result
        });
        let (mut meter, mut done) = (Meter::new("work", 1), 0);
        loop {
            if watch.stop_asked() {
                sink.stop.store(true, Ordering::Relaxed);
            }
            match told.recv_timeout(LOOK_EVERY) {
                Ok(Told::Begin(stage, total)) => {
                    (meter, done) = (Meter::new(words(stage), total.max(1)), 0);
                }
                Ok(Told::Advance(n)) => {
                    done += n;
                    meter.reach(done, watch);
                }
                Err(RecvTimeoutError::Timeout) if !handle.is_finished() => {}
                // A panic ends the thread without a word.
                Ok(Told::End) | Err(_) => break,
            }
        }
        let panicked = |_| Err(SfmError::InvariantViolation("it panicked: please report this with the photos".into()));
        handle.join().unwrap_or_else(panicked)
    })
}

/// How often the wish to stop is checked.
const LOOK_EVERY: Duration = Duration::from_millis(200);

enum Told {
    Begin(SfmProgressStage, usize),
    Advance(usize),
    End,
}

struct Sink {
    stop: AtomicBool,
    sender: Mutex<mpsc::Sender<Told>>,
}

impl Sink {
    fn tell(&self, what: Told) {
        if let Ok(sender) = self.sender.lock() {
            // The receiver is gone: nothing to tell.
            let _ = sender.send(what);
        }
    }
}

impl SfmProgressSink for Sink {
    fn begin(&self, stage: SfmProgressStage, total: usize) {
        self.tell(Told::Begin(stage, total));
    }

    fn advance(&self, _: SfmProgressStage, completed: usize) {
        self.tell(Told::Advance(completed));
    }

    fn is_canceled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

fn words(stage: SfmProgressStage) -> &'static str {
    match stage {
        SfmProgressStage::FeatureExtraction => "find features",
        SfmProgressStage::MatcherPreparation => "prepare matching",
        SfmProgressStage::Matching => "match photos",
        SfmProgressStage::Verification => "verify matches",
        SfmProgressStage::RadialCalibration => "estimate distortion",
        SfmProgressStage::TrackBuilding => "join matches",
        SfmProgressStage::InitialPair => "find the first pair",
        SfmProgressStage::Registration => "place photos",
        SfmProgressStage::BundleAdjustment => "refine everything",
        _ => "work",
    }
}

//! A run at one of its checkpoints, as something to look at.

use super::cropped::Cropped;
use super::fast::{Fast, Source, Tell};
use super::protocol::{AppearanceMix, Layer};
use super::scene::{Description, Photo, Scene3d};
use engine::checkpoint::Checkpoint;
use engine::crop::Crop;
use engine::data::Dataset;
use engine::options::{RunConfig, RunOptions};
use engine::picture::over_background;
use engine::render::{Rendered, render};
use engine::run::Run;
use engine::system::{Appearance, FlowSource, Layers, Query, System, SystemError};
use glam::DVec3;
use image::RgbImage;
use render_core::camera::{Camera, Pose};
use render_core::rig::{focus_point, mean_centre, mean_pose, mean_up, rms_distance};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Seconds that a band of a picture should take: so long may a new camera wait for an old one.
const BAND: f64 = 0.04;

/// A run: what stays the same from checkpoint to checkpoint, and the system at one of them.
pub(crate) struct RunScene {
    common: Arc<Common>,
    system: Arc<dyn System>,
    step: u64,
    fast: Arc<Fast>,
}

/// What all checkpoints of a run share.
struct Common {
    title: String,
    folder: PathBuf,
    config: RunConfig,
    scene: scene_io::Scene,
    train: Arc<Dataset>,
    held_out: Dataset,
    /// Layers of photos that the system has an opinion on.
    judgements: Vec<Layer>,
    tell: Arc<Tell>,
}

impl RunScene {
    pub(crate) fn new(run: Run<'_>, tell: Arc<Tell>) -> Self {
        let Run { folder, config, scene, train, held_out, system, step, .. } = run;
        // Asked once: the answer is the method's, whatever the photo.
        let judges = |layer: &Layer| matches!(judgement(system.as_ref(), &train, 0, *layer), Ok(Some(_)));
        let there = !train.is_empty();
        let judgements = [Layer::Mask, Layer::Uncertainty].into_iter().filter(|layer| there && judges(layer)).collect();
        let title = title(&folder);
        let train = Arc::new(train);
        let common = Arc::new(Common { title, folder, config, scene, train, held_out, judgements, tell });
        Self::with(common, Arc::from(system), step, None)
    }

    fn with(common: Arc<Common>, system: Arc<dyn System>, step: u64, before: Option<&Fast>) -> Self {
        let source = Source {
            folder: common.folder.clone(),
            step,
            system: system.clone(),
            data: common.train.clone(),
            background: common.config.background.colour(),
            moves: common.train.time_steps() > 1,
        };
        let fast = Fast::start(source, before, common.tell.clone());
        Self { common, system, step, fast }
    }

    /// Whether `checkpoint` is of this run, not of another that has taken its folder.
    pub(crate) fn is_of(&self, checkpoint: &Checkpoint) -> bool {
        self.common.config == checkpoint.meta.config
    }

    /// The same run at another checkpoint; nothing of the dataset is read again.
    ///
    /// # Errors
    /// As the system's `load_state`.
    pub(crate) fn at(&self, checkpoint: &Checkpoint) -> Result<Self, SystemError> {
        let Common { config, scene, train, .. } = self.common.as_ref();
        let options = RunOptions {
            seed: config.seed,
            background: Some(config.background),
            error_budget: Some(config.error_budget),
            stop: None,
            set: config.settings.clone(),
        };
        // A fresh one: the one that is being looked at goes on drawing meanwhile.
        let (mut system, _) = systems::registry::build(&config.system, scene, train, &options)?;
        system.load_state(&checkpoint.state)?;
        Ok(Self::with(self.common.clone(), Arc::from(system), checkpoint.meta.step, Some(self.fast.as_ref())))
    }

    fn code(&self, view: Option<usize>) -> Option<Vec<f32>> {
        let known = view.filter(|view| *view < self.common.train.len());
        self.system.appearance_code(&known.map_or(Appearance::Mean, Appearance::View))
    }
}

/// What the system makes of a photo that it was trained on: 0 black to 1 white. `None` where it has no opinion.
fn judgement(system: &dyn System, data: &Dataset, view: usize, layer: Layer) -> Result<Option<Vec<f32>>, SystemError> {
    match layer {
        Layer::Mask => system.visibility(data, view),
        // From a whole colour unit on, white.
        Layer::Uncertainty => system.uncertainty(data, view),
        _ => Ok(None),
    }
}

/// The last two folders of a path say which run it is.
pub(crate) fn title(folder: &Path) -> String {
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    folder.file_name().map_or_else(|| folder.display().to_string(), |name| name.to_string_lossy().into_owned())
}

impl Scene3d for RunScene {
    fn describe(&self) -> Description {
        let Common { title, folder, config, scene, train, held_out, judgements, .. } = self.common.as_ref();
        let photos = |data: &Dataset, held_out| -> Vec<Photo> {
            let full = data.views().iter().filter(|v| v.level == 0);
            full.map(|v| Photo::new(&v.name, &v.camera, v.time, held_out)).collect()
        };
        let trained = photos(train, false);
        let appearances = match self.system.appearance_code(&Appearance::Mean) {
            Some(_) => trained.iter().map(|photo| photo.name.clone()).collect(),
            None => Vec::new(),
        };
        let moves = train.time_steps() > 1;
        let layers = [
            (Layer::Colour, true),
            (Layer::Depth, true),
            (Layer::Normals, true),
            (Layer::Opacity, true),
            (Layer::Canonical, moves),
            (Layer::Flow, self.flow_system().is_some()),
            (Layer::Background, self.system.knows_behind()),
            (Layer::Photo, true),
        ];
        let poses: Vec<Pose> = train.views().iter().map(|v| v.camera.pose).collect();
        let around = around(&poses, self.system.bounds());
        Description {
            title: title.clone(),
            subtitle: format!("{} · {}", config.system, scene.name),
            step: self.step,
            photos: trained.into_iter().chain(photos(held_out, true)).collect(),
            pivot: around.pivot.to_array(),
            pivot_is_guess: around.is_guess,
            up: mean_up(&poses).unwrap_or(DVec3::Z).to_array(),
            radius: around.radius,
            moves,
            appearances,
            layers: layers
                .into_iter()
                .filter_map(|(layer, there)| there.then_some(layer))
                .chain(judgements.iter().copied())
                .map(Layer::name)
                .collect(),
            background: self.background(),
            longest_side: train.longest_side().unwrap_or(800),
            // One that cannot be read is said by `export`, which would obey it.
            crop: Crop::of(folder).ok().flatten().unwrap_or_default(),
        }
    }

    fn step(&self) -> u64 {
        self.step
    }

    fn background(&self) -> [f32; 3] {
        self.common.config.background.colour()
    }

    fn cloud(&self, query: &Query) -> Option<Arc<Cropped>> {
        self.fast.cloud(query)
    }

    fn is_quick(&self) -> bool {
        self.fast.is_its_own()
    }

    fn fast_message(&self) -> String {
        self.fast.message()
    }

    fn place(&self) -> &Path {
        &self.common.folder
    }

    fn draw(&self, camera: &Camera, query: &Query, go_on: &mut dyn FnMut(&Layers) -> bool) -> Option<Rendered> {
        if !go_on(&Layers::default()) {
            return None;
        }
        // Gaussians are drawn all at once, and a part of a picture is not the same as that part of the whole.
        match self.system.render_view(camera, query) {
            Some(layers) => Some(Rendered { width: camera.width, height: camera.height, layers }),
            None => in_bands(self.system.as_ref(), camera, query, go_on),
        }
    }

    fn appearance(&self, mix: &AppearanceMix) -> Appearance {
        let known = |view: Option<usize>| view.filter(|view| *view < self.common.train.len());
        match (known(mix.from), known(mix.to), mix.blend) {
            (from, _, 0.0) => from.map_or(Appearance::Mean, Appearance::View),
            (_, to, 1.0) => to.map_or(Appearance::Mean, Appearance::View),
            (from, to, blend) => match (self.code(from), self.code(to)) {
                (Some(a), Some(b)) => {
                    Appearance::Code(a.iter().zip(b).map(|(a, b)| a * (1.0 - blend) + b * blend).collect())
                }
                _ => Appearance::Mean,
            },
        }
    }

    fn photo(&self, photo: usize, layer: Layer) -> Result<RgbImage, String> {
        let Common { train, held_out, config, .. } = self.common.as_ref();
        let trained: Vec<usize> = (0..train.len()).filter(|&i| train.view(i).level == 0).collect();
        let (data, view) = match (trained.get(photo), photo.checked_sub(trained.len())) {
            (Some(&view), _) => (train.as_ref(), view),
            (None, Some(view)) if view < held_out.len() => (held_out, view),
            _ => return Err(format!("`photo` = {photo}: there are {}", trained.len() + held_out.len())),
        };
        let image = |e: &dyn std::fmt::Display| format!("photo `{}`: {e}", data.view(view).name);
        if layer == Layer::Photo {
            return Ok(over_background(&*data.image(view).map_err(|e| image(&e))?, config.background.colour()));
        }
        if view >= train.len() || photo >= trained.len() {
            let name = layer.name();
            return Err(format!("layer `{name}` is of photos that were trained on; this one is held out"));
        }
        let judged = judgement(self.system.as_ref(), train, view, layer).map_err(|e| image(&e))?;
        let judged = judged.ok_or_else(|| format!("`{}` has no layer `{}`", self.system.name(), layer.name()))?;
        let camera = &train.view(view).camera;
        let bytes = judged.iter().flat_map(|&x| [losses::metrics::quantise_value(x); 3]).collect();
        RgbImage::from_raw(camera.width, camera.height, bytes)
            .ok_or_else(|| image(&format_args!("its {} has another size", layer.name())))
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        self.system.bounds()
    }

    fn flow_system(&self) -> Option<&dyn System> {
        let system = self.system.as_ref();
        let moves = self.common.train.time_steps() > 1;
        (moves && system.flow_source() != FlowSource::Nothing).then_some(system)
    }
}

/// Rows of a picture together, as many as take [`BAND`] seconds; between them `go_on` is asked.
fn in_bands(
    system: &dyn System,
    camera: &Camera,
    query: &Query,
    go_on: &mut dyn FnMut(&Layers) -> bool,
) -> Option<Rendered> {
    let (width, height) = (camera.width, camera.height);
    let mut layers = Layers::with_room(width as usize * height as usize, query);
    let (mut row, mut rows) = (0, (1024 / width.max(1)).clamp(1, height));
    while row < height {
        if !go_on(&layers) {
            return None;
        }
        let band = Camera { height: rows, cy: camera.cy - f64::from(row), ..*camera };
        let clock = Instant::now();
        layers.extend(render(system, &band, query).layers);
        let seconds = clock.elapsed().as_secs_f64().max(1e-6);
        row += rows;
        // At most four times as many at once: empty sky is quick, and what is below it may not be.
        let wanted = (f64::from(rows) * (BAND / seconds).min(4.0)) as u32;
        rows = wanted.max(1).min(height - row);
    }
    Some(Rendered { width, height, layers })
}

/// What to turn around.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Around {
    pivot: DVec3,
    radius: f64,
    is_guess: bool,
}

/// The point that cameras look at, where they look at one; else a point before them.
fn around(poses: &[Pose], bounds: [[f64; 3]; 2]) -> Around {
    let [min, max] = bounds.map(DVec3::from_array);
    let size = (max - min).length();
    let size = if size.is_finite() && size > 0.0 { size } else { 2.0 };
    let before = |p: DVec3| {
        let in_front = poses.iter().filter(|pose| (p - pose.c).dot(pose.r.z_axis) > 0.0).count();
        in_front * 2 > poses.len()
    };
    if let Some(pivot) = focus_point(poses).filter(|&p| before(p)) {
        let radius = rms_distance(poses, pivot);
        if radius > 0.0 && radius <= size * 10.0 {
            return Around { pivot, radius, is_guess: false };
        }
    }
    let middle = (min + max) * 0.5;
    let eye = mean_pose(poses).or_else(|| poses.first().copied());
    let (Some(eye), Some(centre)) = (eye, mean_centre(poses)) else {
        return Around { pivot: if middle.is_finite() { middle } else { DVec3::ZERO }, radius: size, is_guess: true };
    };
    // Half the scene's size before the cameras, or where its middle is.
    let depth = (middle - centre).dot(eye.r.z_axis);
    let radius = if depth.is_finite() && depth > 0.05 * size { depth.min(size) } else { size * 0.5 };
    Around { pivot: centre + eye.r.z_axis * radius, radius, is_guess: true }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOX: [[f64; 3]; 2] = [[-1.0; 3], [1.0; 3]];

    fn ring(n: usize) -> Vec<Pose> {
        let eye = |i: usize| {
            let angle = i as f64 * std::f64::consts::TAU / n as f64;
            DVec3::new(4.0 * angle.cos(), 4.0 * angle.sin(), 1.0)
        };
        (0..n).map(|i| Pose::look_at(eye(i), DVec3::new(0.5, 0.0, 0.0), DVec3::Z).unwrap()).collect()
    }

    #[test]
    fn cameras_around_a_thing_turn_around_it() {
        let found = around(&ring(8), BOX);
        assert!((found.pivot - DVec3::new(0.5, 0.0, 0.0)).length() < 1e-9 && !found.is_guess);
        assert!((found.radius - 4.15).abs() < 0.1, "{}", found.radius);
    }

    #[test]
    fn one_camera_and_none_and_parallel_ones_get_a_point_before_them() {
        let one = Pose::look_at(DVec3::new(0.0, 0.0, 3.0), DVec3::ZERO, DVec3::Y).unwrap();
        for poses in [vec![one], vec![one; 3], vec![one, Pose { c: one.c + DVec3::X, ..one }]] {
            let found = around(&poses, BOX);
            assert!(found.is_guess && found.radius > 0.0);
            assert!((found.pivot - one.c).dot(one.r.z_axis) > 1.0, "{poses:?}: {found:?}");
        }
        let nobody = around(&[], BOX);
        assert_eq!((nobody.pivot, nobody.is_guess), (DVec3::ZERO, true));
        let endless = around(&[one], [[f64::NEG_INFINITY; 3], [f64::INFINITY; 3]]);
        assert!(endless.pivot.is_finite() && endless.radius > 0.0);
    }
}

//! What the lists share: tiny scenes and systems, and what a training promises.

use engine::data::Dataset;
use engine::options::{Background, RunOptions};
use engine::system::{Query, System, SystemError, TensorData};
use scene_io::synthetic::{TabletopOptions, tabletop};
use scene_io::{Image, ImageSource, ImageStore, Scene, Split, StoreOptions};
use std::sync::Arc;
use stress::Verdict;

/// Settings of a system that learns a few pixels in milliseconds.
pub(crate) const TINY_NGP: [&str; 9] = [
    "levels=4",
    "log2_table=8",
    "n_max=64",
    "width=16",
    "geometry=4",
    "colour_layers=1",
    "occupancy=16",
    "batch_samples=512",
    "batch_rays=64",
];
pub(crate) const TINY_NERF: [&str; 5] = ["width=16", "depth=2", "coarse=8", "fine=8", "batch_rays=16"];

pub(crate) fn tiny_scene(views: usize, angle: f64) -> Scene {
    tabletop(&TabletopOptions { width: 16, height: 16, train: views, test: 0, rays: 1, angle, ..Default::default() })
}

pub(crate) fn dataset(scene: &Scene) -> Dataset {
    let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
    Dataset::new(scene, store, scene.split(Split::Train).collect()).unwrap()
}

/// Build a system with settings written as on the command line; later ones win.
pub(crate) fn build(name: &str, scene: &Scene, data: &Dataset, set: &[&str]) -> Result<Box<dyn System>, SystemError> {
    build_before(Some(Background::White), name, scene, data, set)
}

/// The same before another background; `None`: what the plan finds.
pub(crate) fn build_before(
    background: Option<Background>,
    name: &str,
    scene: &Scene,
    data: &Dataset,
    set: &[&str],
) -> Result<Box<dyn System>, SystemError> {
    let tiny: &[&str] = if name == "ngp" { &TINY_NGP } else { &TINY_NERF };
    let set = tiny.iter().chain(set).map(|s| engine::options::parse_set(s).unwrap()).collect();
    let options = RunOptions { seed: 1, background, error_budget: None, stop: None, set };
    Ok(systems::registry::build(name, scene, data, &options)?.0)
}

pub(crate) const QUERY: Query = Query {
    background: [1.0; 3],
    layers: engine::system::LayerRequest {
        normals: engine::system::Normals::Compute,
        canonical: engine::system::Canonical::Compute,
        median: engine::system::Median::Compute,
        behind: engine::system::Behind::Compute,
    },
    error_budget: 0.0,
    appearance: engine::system::Appearance::Mean,
    time: 0.0,
    halt: engine::halt::Halt::NEVER,
};

/// Every number that the next step depends on is finite.
pub(crate) fn state_is_finite(system: &dyn System) -> Result<(), String> {
    for tensor in system.state() {
        if let TensorData::F32(data) = &tensor.data {
            stress::finite(&tensor.name, data)?;
        }
    }
    Ok(())
}

/// How a training ended.
#[derive(PartialEq)]
pub(crate) enum End {
    Trained,
    /// The guard stopped it with its one error: nothing is drawn from what is left.
    Guarded,
}

/// `steps` of training; the guard's error is as good an end. What the next step depends on is `sound` all the time: never
/// not, even for one step.
pub(crate) fn guarded(
    system: &mut dyn System,
    data: &Dataset,
    steps: u64,
    sound: fn(&dyn System) -> Verdict,
) -> Result<End, String> {
    for step in 0..steps {
        match system.step(data, step) {
            Ok(stats) => stress::ensure(stats.nonfinite > 0 || stats.loss.is_finite(), || {
                format!("step {step}: loss {} without a non-finite gradient", stats.loss)
            })?,
            Err(e @ SystemError::NonFinite { .. }) => {
                says(&e, &["learning rate"])?;
                sound(system)?;
                return Ok(End::Guarded);
            }
            Err(e) => return Err(format!("step {step}: {e}")),
        }
        sound(system).map_err(|e| format!("step {step}: {e}"))?;
    }
    Ok(End::Trained)
}

/// Every loss and every gradient of a few steps is finite.
pub(crate) fn learns(system: &mut dyn System, data: &Dataset, steps: u64) -> Verdict {
    for step in 0..steps {
        let stats = system.step(data, step).map_err(|e| format!("step {step}: {e}"))?;
        stress::ensure(stats.loss.is_finite() && stats.mse.is_finite() && stats.nonfinite == 0, || {
            format!("step {step}: loss {}, {} gradients are not finite", stats.loss, stats.nonfinite)
        })?;
    }
    Ok(())
}

/// One line with all of these words.
pub(crate) fn says(e: &SystemError, words: &[&str]) -> Verdict {
    let said = e.to_string();
    let missing = words.iter().find(|w| !said.to_lowercase().contains(&w.to_lowercase()));
    stress::ensure(missing.is_none() && !said.contains('\n'), || format!("does not say {missing:?}: {said}"))
}

/// Put `make(photo, its picture)` in place of each picture.
pub(crate) fn pictures(mut scene: Scene, make: impl Fn(usize, &Image) -> Image) -> Scene {
    for (k, frame) in scene.frames.iter_mut().enumerate() {
        if let ImageSource::Memory(image) = &frame.image {
            frame.image = ImageSource::Memory(Arc::new(make(k, image)));
        }
    }
    scene
}

/// Mean PSNR of the training views, and that no rendered number is NaN.
pub(crate) fn train_psnr(system: &dyn System, data: &Dataset) -> Result<f64, String> {
    let (mut sum, mut n) = (0.0, 0);
    for i in 0..data.len() {
        let camera = data.view(i).camera;
        let rays: Vec<_> = data.view(i).rays(0..camera.height).map(|r| r.ok_or("no ray")).collect::<Result<_, _>>()?;
        let layers = system.render(&rays, &QUERY);
        stress::finite("rgb", layers.rgb.as_flattened())?;
        stress::finite("opacity", &layers.opacity)?;
        stress::finite("normal", layers.normal.as_flattened())?;
        for (what, depth) in [("depth", &layers.depth), ("median depth", &layers.median_depth)] {
            // Infinite where nothing was hit, by contract.
            stress::ensure(depth.iter().all(|d| *d >= 0.0), || format!("a {what} is negative or NaN"))?;
        }
        let no_nan = layers.canonical.as_flattened().iter().all(|x| !x.is_nan());
        stress::ensure(no_nan && layers.canonical.len() == rays.len(), || "a canonical point is NaN".into())?;
        let image = data.image(i).map_err(|e| e.to_string())?;
        for (k, rgb) in layers.rgb.iter().enumerate() {
            let (x, y) = (k as u32 % camera.width, k as u32 / camera.width);
            let pixel = image.pixel(x, y);
            let alpha = if pixel.len() == 4 { f64::from(pixel[3]) / 255.0 } else { 1.0 };
            for c in 0..3 {
                let want = f64::from(pixel[c]) / 255.0 * alpha + 1.0 - alpha;
                sum += (f64::from(rgb[c].clamp(0.0, 1.0)) - want).powi(2);
                n += 1;
            }
        }
    }
    Ok(-10.0 * (sum / f64::from(n)).log10())
}

//! Methods for photos from the wild at the edge of their settings, of what photos can be, and of learning rates.

mod learning_rates;
mod scenes;
mod settings;

pub(crate) use learning_rates::cases as learning_rates;
pub(crate) use scenes::cases as scenes;
pub(crate) use settings::cases as settings;

use crate::common::{QUERY, TINY_NERF, TINY_NGP, learns};
use engine::data::Dataset;
use engine::options::{Background, RunOptions, parse_set};
use engine::render::render;
use engine::system::{Appearance, Query, System, SystemError, TensorData};
use scene_io::Scene;
use stress::{Verdict, ensure, finite};

/// The systems that do something about photos, on fields.
const METHODS: [&str; 9] =
    ["robust-nerf", "nerf-w", "nerf-a", "nerf-u", "ha-nerf", "ha-nerf-a", "ha-nerf-t", "sf-nerf", "hugs"];
/// Those that are clouds: with an appearance for each photo, and with one for all.
const CLOUDS: [&str; 4] = ["wild-gaussians", "gs-w", "wild-gs", "spotless"];
/// A cloud with few Gaussians, that come and go.
const TINY_CLOUD: [&str; 6] =
    ["start=random", "start_count=200", "max_splats=400", "densify_from=1", "densify_every=2", "horizon=6"];

/// Settings with which the parts of a system are small, and have judged their photos twice after five steps.
fn small(name: &str, set: &[&str]) -> Vec<&'static str> {
    let chosen = |key: &str| set.iter().rev().find_map(|s| s.strip_prefix(key)?.strip_prefix('='));
    let appearance = chosen("appearance").unwrap_or(match name {
        "nerf-w" | "nerf-a" | "sf-nerf" | "wild-gaussians" => "codes",
        "gs-w" => "maps",
        "wild-gs" => "triplane",
        "ha-nerf" | "ha-nerf-a" => "encoder",
        _ => "none",
    });
    let mut small = match appearance {
        "codes" => vec!["appearance_dims=3"],
        "maps" => vec!["encoder_side=16", "map_channels=2", "tone_width=4"],
        "triplane" => vec!["encoder_side=16", "plane_side=16", "plane_channels=2", "tone_width=4"],
        "encoder" => vec![
            "appearance_dims=3",
            "view_every=1",
            "encoder_channels=[4,4]",
            "encoder_side=16",
            "encoder_photos=2",
            "lattice=16",
        ],
        _ => Vec::new(),
    };
    let of_occluders: &[&str] = match name {
        "robust-nerf" => &["judge_first=2"],
        // Its masks are those of errors.
        "spotless" => &[],
        _ if CLOUDS.contains(&name) => match chosen("occluders") {
            None => &["judge_first=2"],
            Some("residual" | "visibility" | "visibility_head") => &["judge_from=0.2"],
            Some(_) => &[],
        },
        "hugs" => &["warmup_steps=2", "superpixels=9"],
        "nerf-w" | "nerf-u" => &["transient_dims=4"],
        "ha-nerf" | "ha-nerf-t" => &["visibility_width=8", "visibility_depth=1", "visibility_dims=4"],
        "sf-nerf" => &["transient_dims=4", "filter_width=8", "filter_octaves=3"],
        _ => &[],
    };
    small.extend(of_occluders);
    small
}

const STEPS: u64 = 5;

/// Build a system with settings written as on the command line, `field=mlp` among them; later ones win.
fn build(name: &str, scene: &Scene, data: &Dataset, set: &[&str]) -> Result<Box<dyn System>, SystemError> {
    let field: &[&str] = match name {
        _ if CLOUDS.contains(&name) => &TINY_CLOUD,
        _ if set.contains(&"field=mlp") => &TINY_NERF,
        _ => &TINY_NGP,
    };
    let small = small(name, set);
    let set = small.iter().chain(field).chain(set).map(|s| parse_set(s).unwrap()).collect();
    let options = RunOptions { seed: 1, background: Some(Background::White), error_budget: None, stop: None, set };
    Ok(systems::registry::build(name, scene, data, &options)?.0)
}

/// It learns for a few steps: every loss and every gradient is finite, and so is all that it says afterwards.
fn trains(system: &mut dyn System, data: &Dataset, steps: u64) -> Verdict {
    learns(system, data, steps)?;
    is_sound(system, data)
}

/// What a checkpoint holds, what it renders with the code of each photo, and its masks of them are numbers.
fn is_sound(system: &dyn System, data: &Dataset) -> Verdict {
    state_is_sound(system)?;
    let looks = |view: usize, appearance| {
        let layers = render(system, &data.view(view).camera, &Query { appearance, ..QUERY }).layers;
        finite("rgb", layers.rgb.as_flattened()).and(finite("opacity", &layers.opacity))
    };
    for view in 0..data.len() {
        looks(view, if view == 0 { Appearance::Mean } else { Appearance::View(view) })?;
        if let Some(mask) = system.visibility(data, view).map_err(|e| e.to_string())? {
            ensure(mask.iter().all(|&v| v == 0.0 || v == 1.0), || format!("a mask of view {view} is neither 0 nor 1"))?;
        }
        let photo = data.image(view).map_err(|e| e.to_string())?;
        if let Some(code) = system.encode_appearance(&photo) {
            finite("code", &code)?;
        }
    }
    Ok(())
}

fn state_is_sound(system: &dyn System) -> Verdict {
    for tensor in system.state() {
        match &tensor.data {
            // Infinite: nothing was judged yet, so nothing is an outlier.
            TensorData::F32(data) if tensor.name == "robust.threshold" => {
                ensure(data.iter().all(|t| *t >= 0.0), || format!("the threshold is {data:?}"))?;
            }
            TensorData::F32(data) => finite(&tensor.name, data)?,
            TensorData::U64(_) => {}
        }
    }
    Ok(())
}

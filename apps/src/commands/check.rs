//! `check`: what a dataset holds and what is wrong with it.

use super::prepare::advice_for;
use crate::app::App;
use crate::cli::Check;
use crate::session::{Done, Failure, data_options, scene_spec};
use crate::show::line;
use engine::run::{MaskMeaning, mask_meaning};
use scene_io::{Depth, Frame, Scene, Split};
use std::path::Path;
use systems::registry::Family;

pub(crate) fn run(app: &App, args: &Check) -> Result<Done, Failure> {
    let depth = if args.quick { Depth::Headers } else { Depth::Pixels };
    let mut report = engine::source::check(&scene_spec(&args.scene), &data_options(&args.data), depth)?;
    line(report.to_string().trim_end());
    // As this app reads it.
    if let Some(scene) = report.scene.as_mut().filter(|_| app.family == Family::Moving)
        && scene.time_by_order()
        && let Some(note) = scene.notes.last()
    {
        line(note);
    }
    if let Some(found) = report.scene.as_ref().and_then(beside_the_photos) {
        line(found);
    }
    // As `train` takes them.
    if let Some(scene) = &report.scene {
        match mask_meaning(scene, report.masks_leave, args.data.mask_white.as_deref())? {
            MaskMeaning::AsRead => {}
            MaskMeaning::Sparse(found) | MaskMeaning::Object(found) => line(format_args!("warning: {found}")),
        }
    }
    if report.scene.is_none()
        && scene_io::lacks_cameras(Path::new(&args.scene), &data_options(&args.data).load_options()?)
        && let Some(advice) = advice_for(app, Path::new(&args.scene))
    {
        line(advice);
    }
    Ok(if report.can_train() { Done::Finished } else { Done::Refused })
}

/// What other programs made of the training photos, and what is known to score against; `None` where there is nothing.
fn beside_the_photos(scene: &Scene) -> Option<String> {
    type Has = fn(&Frame) -> bool;
    let photos: Vec<&Frame> = scene.split(Split::Train).map(|i| &scene.frames[i]).collect();
    let kinds: [(&str, Has); 10] = [
        ("segments", |f| f.priors.segments.is_some()),
        ("segments around points", |f| f.priors.prompted.is_some()),
        ("features", |f| f.priors.features.is_some()),
        ("flow to the next photo", |f| f.priors.motion.forward.is_some()),
        ("flow to the photo before", |f| f.priors.motion.backward.is_some()),
        ("disparity", |f| f.priors.motion.disparity.is_some()),
        ("masks of what moves", |f| f.priors.motion.mask.is_some()),
        ("point tracks", |f| !f.tracks.is_empty()),
        ("ignore masks", |f| f.mask.is_some()),
        ("true masks of occluders (for scores only)", |f| f.truth.transient.is_some()),
    ];
    let found: Vec<String> = kinds
        .iter()
        .map(|(name, has)| (name, photos.iter().filter(|f| has(f)).count()))
        .filter(|(_, n)| *n > 0)
        .map(|(name, n)| format!("{name} of {n}"))
        .collect();
    let of = photos.len();
    (!found.is_empty()).then(|| format!("beside {of} training photos: {}", found.join(", ")))
}

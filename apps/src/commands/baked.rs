//! The cloud of Gaussians that `export --splats` writes: that of a splat run, or a field baked into one.

use crate::session::Failure;
use crate::show::{Show, line};
use engine::output::Disk;
use engine::progress::{Event, Observer};
use engine::run::Run;
use engine::system::{Appearance, Query, Splats};
use systems::bake::{BakeOptions, bake, load, store};

/// The cloud of a run, at the time and in the appearance of a query; `None` where a stop was asked for. A baked one of a scene that
/// stands still, in the mean appearance, is kept in the run folder, where the viewer finds it.
pub(super) fn splats(run: &Run<'_>, query: &Query, show: &mut Show) -> Result<Option<Splats>, Failure> {
    if let Some(splats) = run.system.splats(query) {
        return Ok(Some(splats));
    }
    let is_kept = run.train.time_steps() <= 1 && query.appearance == Appearance::Mean;
    let kept = if is_kept { load(&run.folder, run.step) } else { None };
    let baked = match kept {
        Some(baked) => baked,
        None => {
            show.event(Event::Note("baking the field into Gaussians"));
            let made = bake(run.system.as_ref(), &run.train, query, &BakeOptions::DEFAULT, &|| !show.stop_asked())?;
            let Some(baked) = made else { return Ok(None) };
            if is_kept && let Err(e) = store(&Disk, &run.folder, run.step, &baked) {
                // Only the next export and the viewer would have been faster.
                crate::show::note(&format!("the baked cloud is not kept: {e}"));
            }
            baked
        }
    };
    show.finish();
    if let Some(psnr) = baked.psnr {
        let n = baked.splats.gaussians.len();
        line(format_args!("{n} Gaussians baked from `{}`: {psnr:.1} dB against its own pictures", run.system.name()));
    }
    Ok(Some(baked.splats))
}

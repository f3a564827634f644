//! `train`: a scene to a run folder.

use super::{Done, Failure, Session, data_options, scene_spec, settings};
use crate::cli::Train;
use crate::interrupt;
use crate::show::line;
use std::path::Path;
use std::time::Duration;
use systems::eval::Evaluation;
use systems::options::{DataOptions, Request};
use systems::run::Run;
use systems::train::{Reason, Schedule, Stop};

/// Training time where neither steps nor seconds are given: most scenes have settled.
const DEFAULT_SECONDS: f64 = 300.0;

pub(crate) fn run(session: &Session, args: Train) -> Result<Done, Failure> {
    let stop = match (args.steps, args.seconds) {
        (Some(steps), _) => Stop::Steps(steps),
        (None, Some(seconds)) => Stop::Seconds(seconds),
        (None, None) => Stop::Seconds(DEFAULT_SECONDS),
    };
    let request = Request {
        scene: args.scene.as_deref().map(scene_spec),
        system: args.system,
        seed: args.seed,
        background: args.background.map(Into::into),
        error_budget: args.error_budget,
        eval_appearance: args.eval_appearance,
        data: DataOptions { scales: args.scales, ..data_options(&args.data) },
        set: settings(args.set, args.field, args.max_splats),
        purpose: args.purpose.unwrap_or_default(),
        stop: Some(stop),
    };
    let schedule = Schedule {
        eval_at: args.eval_at,
        eval_every: args.eval_every,
        checkpoint_every: Duration::from_secs_f64(args.checkpoint_minutes * 60.0),
        ..Schedule::new(stop)
    };
    train(session, &args.out, &request, &schedule, args.resume)
}

/// Train into `folder`, new or resumed, and say what came out.
pub(super) fn train(
    session: &Session,
    folder: &Path,
    request: &Request,
    schedule: &Schedule,
    resume: bool,
) -> Result<Done, Failure> {
    let lpips = session.lpips()?;
    let interrupt = interrupt::flag()?;
    let mut show = session.show();
    let mut run = match resume {
        true => Run::open(folder, request, session.parts(), &mut show)?,
        false => Run::create(folder, request, session.parts(), &mut show)?,
    };
    introduce(&run, schedule);
    let (ended, evaluation) = run.train(schedule, lpips.as_ref(), &mut show, &interrupt)?;
    show.finish();
    let Run { folder, .. } = &run;
    if ended.reason == Reason::Interrupted {
        line(format_args!(
            "stopped at step {}; continue with: {} train --resume --out {}",
            ended.step,
            session.app.name,
            folder.display()
        ));
        return Ok(Done::Interrupted);
    }
    line(format_args!("trained {} steps in {:.1} s", ended.step, ended.seconds));
    conclude(evaluation.as_ref(), folder);
    Ok(Done::Finished)
}

/// What will be done, before it is done.
fn introduce(run: &Run<'_>, schedule: &Schedule) {
    let sizes = run.train.views().first().map(|v| (v.camera.width, v.camera.height));
    let sizes = sizes.map_or_else(String::new, |(w, h)| format!(", {w}x{h}"));
    let scales = run.config.data.scales.unwrap_or(1);
    let sizes = if scales > 1 { format!("{sizes}, at {scales} scales") } else { sizes };
    let views = run.train.len() / scales as usize;
    line(format_args!("{} ({}): {views} training views{sizes}", run.scene.name, run.scene.dialect));
    for note in &run.scene.notes {
        line(format_args!("  {note}"));
    }
    let names: Vec<&str> = run.held_out.views().iter().map(|v| v.name.as_str()).collect();
    match names.len() {
        0 => line("held out: none, so nothing will be measured (`--holdout every:8` holds every 8th view out)"),
        n => line(format_args!("held out ({n}, see heldout.txt): {}", listing(&names))),
    }
    line(format_args!("{}: {} parameters", run.system.name(), run.system.parameter_count()));
    for decision in &run.plan {
        line(format_args!("  {decision}"));
    }
    line(run.memory_line());
    if run.step > 0 {
        line(format_args!("resumed at step {}, {:.1} s of training", run.step, run.seconds));
    }
    match schedule.stop {
        Stop::Steps(n) => line(format_args!("training to step {n}")),
        Stop::Seconds(s) => line(format_args!("training for {s} s")),
    }
}

/// The scores, and where everything lies.
pub(super) fn conclude(evaluation: Option<&Evaluation>, folder: &Path) {
    if let Some(evaluation) = evaluation {
        line(evaluation.table().trim_end());
        for note in &evaluation.notes {
            line(format_args!("note: {note}"));
        }
    }
    line(format_args!("report: {}", folder.join(systems::report::FILE).display()));
}

/// The first few names.
fn listing(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let more = names.len().saturating_sub(SHOWN);
    let shown = names[..names.len() - more].join(", ");
    if more > 0 { format!("{shown}, and {more} more") } else { shown }
}

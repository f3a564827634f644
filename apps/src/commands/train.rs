//! `train`: a scene to a run folder.

use crate::cli::Train;
use crate::session::{Done, Failure, Session, data_options, scene_spec, settings};
use crate::show::{Show, line};
use engine::RunError;
use engine::eval::{Evaluation, Measured};
use engine::options::{DataOptions, Request};
use engine::run::{Run, planned_schedule};
use engine::train::{Reason, Schedule, Stop};
use scene_io::Size;
use std::path::Path;
use std::time::Duration;

/// Training time where neither steps nor seconds are given: most scenes have settled.
const DEFAULT_SECONDS: f64 = 300.0;

pub(crate) fn run(session: &Session, args: Train) -> Result<Done, Failure> {
    let wished = Wished {
        steps: args.steps,
        seconds: args.seconds,
        eval_at: args.eval_at,
        eval_every: args.eval_every,
        checkpoint_minutes: args.checkpoint_minutes,
        disk_wait: args.disk_wait,
    };
    let stop = wished.stop().unwrap_or(Stop::Seconds(DEFAULT_SECONDS));
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
        speed: (!args.resume && matches!(stop, Stop::Seconds(_))).then(systems::plan::machine_speed),
        stop: Some(stop),
        rehearsal: true,
        lpips: session.measures_lpips(),
    };
    let mut show = session.show();
    let (mut run, own) = if args.resume {
        let run = Run::open_to_write(&args.out, &request, session.parts(), &mut show)?;
        (run, planned_schedule(&args.out))
    } else {
        (Run::create(&args.out, &request, session.parts(), &mut show)?, None)
    };
    let schedule = wished.schedule(own);
    if args.resume && run.is_finished(schedule.stop) {
        show.finish();
        already_finished(session, &run, schedule.stop);
        next_steps(session, &run.folder);
        return Ok(Done::Finished);
    }
    if args.resume {
        run.fit_memory(&request, &mut show)?;
    }
    let done = train(session, &mut run, &schedule, &mut show)?;
    if done == Done::Finished {
        next_steps(session, &run.folder);
    }
    Ok(done)
}

/// What the command line says about when things happen.
#[derive(Default)]
struct Wished {
    steps: Option<u64>,
    seconds: Option<f64>,
    eval_at: Vec<f64>,
    eval_every: Option<u64>,
    checkpoint_minutes: Option<f64>,
    disk_wait: Option<f64>,
}

impl Wished {
    /// When to stop, where that is said.
    fn stop(&self) -> Option<Stop> {
        self.steps.map(Stop::Steps).or(self.seconds.map(Stop::Seconds))
    }

    /// With what is not said as in the run's own schedule, where it has one.
    fn schedule(self, own: Option<Schedule>) -> Schedule {
        let own = own.unwrap_or_else(|| Schedule::new(Stop::Seconds(DEFAULT_SECONDS)));
        let stop = self.stop().unwrap_or(own.stop);
        // A time too long for a clock never comes.
        let minutes = |m: f64| Duration::try_from_secs_f64(m * 60.0).unwrap_or(Duration::MAX);
        Schedule {
            stop,
            eval_at: if self.eval_at.is_empty() { own.eval_at } else { self.eval_at },
            eval_every: self.eval_every.or(own.eval_every),
            checkpoint_every: self.checkpoint_minutes.map_or(own.checkpoint_every, minutes),
            disk_wait: self
                .disk_wait
                .map_or(own.disk_wait, |s| Duration::try_from_secs_f64(s).unwrap_or(Duration::MAX)),
            ..own
        }
    }
}

/// Train a run, new or resumed, and say what came out.
pub(super) fn train(
    session: &Session,
    run: &mut Run<'_>,
    schedule: &Schedule,
    show: &mut Show,
) -> Result<Done, Failure> {
    let lpips = session.lpips()?;
    introduce(run, schedule);
    let interrupt = show.listen()?;
    let (ended, evaluation) = run.train(schedule, lpips.as_ref(), show, &interrupt)?;
    show.finish();
    let unwritten = evaluation.as_ref().map(|evaluation| evaluation.unwritten.clone()).unwrap_or_default();
    if ended.reason == Reason::Interrupted {
        if let Some(evaluation) = &evaluation {
            line(evaluation.table().trim_end());
        }
        if !unwritten.is_empty() {
            return Err(RunError::Unwritten { folder: run.folder.clone(), problems: unwritten }.into());
        }
        line(format_args!("stopped at step {}; {}", ended.step, go_on(session, run)));
        return Ok(Done::Interrupted);
    }
    line(format_args!("trained {} steps in {:.1} s", ended.step, ended.seconds));
    // Scores are said before anything else may fail.
    let concluded = if unwritten.is_empty() { run.conclude(&interrupt) } else { Ok(Reason::Finished) };
    show.finish();
    conclude(evaluation.as_ref(), &run.folder);
    if !unwritten.is_empty() {
        return Err(RunError::Unwritten { folder: run.folder.clone(), problems: unwritten }.into());
    }
    if concluded? == Reason::Interrupted {
        line(format_args!("stopped before the report was whole; {}", go_on(session, run)));
        return Ok(Done::Interrupted);
    }
    Ok(Done::Finished)
}

/// What to type to go on with a run that was stopped.
fn go_on(session: &Session, run: &Run<'_>) -> String {
    format!("continue with: {}", resume_command(session, &run.folder, None))
}

/// What will be done, before it is done.
fn introduce(run: &Run<'_>, schedule: &Schedule) {
    let sizes = run.train.views().first().map(|v| Size::from(&v.camera));
    let sizes = sizes.map_or_else(String::new, |size| format!(", {size}"));
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
        n if Measured::of(&run.held_out) == Measured::Validation => {
            line(format_args!("validation views, measured ({n}, see validation.txt): {}", listing(&names)));
        }
        n => line(format_args!("held out ({n}, see heldout.txt): {}", listing(&names))),
    }
    line(format_args!("{}: {} parameters", run.system.name(), run.system.parameter_count()));
    for decision in &run.plan {
        line(format_args!("  {decision}"));
    }
    line(run.expected_memory());
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
    line(format_args!("report: {}", folder.join(engine::folder::REPORT).display()));
}

/// Why a finished run was left as it is, and how to go on with it.
fn already_finished(session: &Session, run: &Run<'_>, stop: Stop) {
    let (stopped, further) = match stop {
        Stop::Steps(n) => (format!("{n} steps"), ["--steps".into(), n.max(run.step).saturating_mul(2).to_string()]),
        Stop::Seconds(s) => {
            (format!("{s} s of training"), ["--seconds".into(), format!("{:.0}", 2.0 * s.max(run.seconds).ceil())])
        }
    };
    line(format_args!(
        "{} is finished: it was to stop after {stopped} and has done {} steps in {:.1} s; nothing was changed",
        run.folder.display(),
        run.step,
        run.seconds
    ));
    line(format_args!("to train it further: {}", resume_command(session, &run.folder, Some(further))));
}

/// What goes on with a run, to its own stop or to another one.
fn resume_command(session: &Session, folder: &Path, stop: Option<[String; 2]>) -> String {
    let mut words = vec!["train".into(), "--resume".into(), "--out".into(), folder.display().to_string()];
    words.extend(stop.into_iter().flatten());
    session.command_line(words, true)
}

/// The last line of a training: what can be done with it.
pub(super) fn next_steps(session: &Session, folder: &Path) {
    let run = folder.display().to_string();
    let pictures = folder.join("pictures").display().to_string();
    let view = session.command_line(vec!["view".into(), run.clone()], false);
    let render = session.command_line(vec!["render".into(), run, "--out".into(), pictures], false);
    line(format_args!("next: `{view}` to look at it in a browser, `{render}` for pictures along a path"));
}

/// The first few names.
fn listing(names: &[&str]) -> String {
    const SHOWN: usize = 8;
    let more = names.len().saturating_sub(SHOWN);
    let shown = names[..names.len() - more].join(", ");
    if more > 0 { format!("{shown}, and {more} more") } else { shown }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_resumed_run_keeps_its_schedule_but_for_what_is_said() {
        let own = Schedule {
            eval_at: vec![5.0],
            eval_every: Some(7),
            checkpoint_every: Duration::from_secs(30),
            ..Schedule::new(Stop::Steps(900))
        };
        assert_eq!(Wished::default().schedule(Some(own.clone())), own);
        let wished = Wished { seconds: Some(600.0), eval_at: vec![400.0], ..Wished::default() };
        let want = Schedule { stop: Stop::Seconds(600.0), eval_at: vec![400.0], ..own };
        assert_eq!(wished.schedule(Some(want.clone())), want);
    }

    #[test]
    fn a_new_run_has_the_defaults_and_no_number_of_minutes_is_too_large() {
        assert_eq!(Wished::default().schedule(None), Schedule::new(Stop::Seconds(DEFAULT_SECONDS)));
        let wished = Wished { checkpoint_minutes: Some(1e300), ..Wished::default() };
        assert_eq!(wished.schedule(None).checkpoint_every, Duration::MAX);
    }
}

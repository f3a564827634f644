//! `eval`: the held-out views of the newest checkpoint, or those of a dataset with the Gaussians of a file.

use super::eval_file;
use super::train::conclude;
use crate::cli::Eval;
use crate::session::{Done, Failure, Session};
use crate::show::line;
use engine::RunError;
use engine::progress::{Event, Observer};

pub(crate) fn run(session: &Session, args: &Eval) -> Result<Done, Failure> {
    if eval_file::is_meant(args)? {
        return eval_file::run(session, args);
    }
    let lpips = session.lpips()?;
    let mut show = session.show();
    let mut run = match session.open_to_write(&args.run, &mut show) {
        // Scores can be read without a file.
        Err(ref error @ RunError::Write { ref source, .. }) => {
            show.event(Event::Warning(&format!("{error} ({source}): scores are printed but not saved")));
            session.open(&args.run, &mut show)?
        }
        run => run?,
    };
    run.measure_in(args.eval_appearance.clone());
    run.render_within(args.error_budget);
    show.listen()?;
    if let Some(scales) = args.scales {
        let table = run.evaluate_scales(scales, &mut show)?;
        show.finish();
        line(table.table().trim_end());
        if !table.unwritten.is_empty() {
            return Err(RunError::Unwritten { folder: args.run.clone(), problems: table.unwritten }.into());
        }
        let done = table.scales.len();
        if done < scales as usize {
            line(format_args!("stopped after {done} of {scales} scales: nothing was written but pictures"));
            return Ok(Done::Interrupted);
        }
        return Ok(Done::Finished);
    }
    let evaluation = run.evaluate(lpips.as_ref(), &mut show)?;
    show.finish();
    conclude(Some(&evaluation), &args.run);
    if !evaluation.unwritten.is_empty() {
        return Err(RunError::Unwritten { folder: args.run.clone(), problems: evaluation.unwritten }.into());
    }
    if evaluation.stopped {
        line(match evaluation.written {
            true => "stopped before the report was whole: the scores are in the run, and `eval` again makes the rest",
            false => {
                "the scores in the run are those of the last evaluation that was finished; `eval` again goes on from here"
            }
        });
        return Ok(Done::Interrupted);
    }
    Ok(Done::Finished)
}

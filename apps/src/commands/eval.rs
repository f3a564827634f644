//! `eval`: the held-out views of the newest checkpoint.

use super::{Done, Failure, Session, train::conclude};
use crate::cli::Eval;
use crate::show::line;

pub(crate) fn run(session: &Session, args: &Eval) -> Result<Done, Failure> {
    let lpips = session.lpips()?;
    let mut show = session.show();
    let mut run = session.open_to_write(&args.run, &mut show)?;
    run.measure_in(args.eval_appearance.clone());
    run.render_within(args.error_budget);
    show.listen()?;
    if let Some(scales) = args.scales {
        let table = run.evaluate_scales(scales, &mut show)?;
        show.finish();
        line(table.table().trim_end());
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
    if evaluation.left > 0 {
        line("the scores in the run are those of the last evaluation that was finished");
        return Ok(Done::Interrupted);
    }
    Ok(Done::Finished)
}

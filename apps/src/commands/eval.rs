//! `eval`: the held-out views of the newest checkpoint.

use super::{Done, Failure, Session, train::conclude};
use crate::cli::Eval;
use crate::show::line;

pub(crate) fn run(session: &Session, args: &Eval) -> Result<Done, Failure> {
    let lpips = session.lpips()?;
    let mut show = session.show();
    let mut run = session.open(&args.run, &mut show)?;
    run.measure_in(args.eval_appearance.clone());
    run.render_within(args.error_budget);
    if let Some(scales) = args.scales {
        let table = run.evaluate_scales(scales, &mut show)?;
        show.finish();
        line(table.table().trim_end());
        return Ok(Done::Finished);
    }
    let evaluation = run.evaluate(lpips.as_ref(), &mut show)?;
    show.finish();
    conclude(Some(&evaluation), &args.run);
    Ok(Done::Finished)
}

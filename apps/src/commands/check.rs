//! `check`: what a dataset holds and what is wrong with it.

use super::{Done, Failure, data_options, scene_spec};
use crate::cli::Check;
use crate::show::line;
use scene_io::Depth;

pub(crate) fn run(args: &Check) -> Result<Done, Failure> {
    let depth = if args.quick { Depth::Headers } else { Depth::Pixels };
    let report = systems::source::check(&scene_spec(&args.scene), &data_options(&args.data), depth)?;
    line(report.to_string().trim_end());
    Ok(if report.can_train() { Done::Finished } else { Done::Refused })
}

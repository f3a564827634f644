//! `masks`: which pixels of the training photos show the place itself.

use crate::cli::Masks;
use crate::session::{Done, Failure, Session};
use crate::show::line;
use engine::eval::masks::{FILE, MaskOptions, SIDE_BY_SIDE};
use engine::folder::MASKS;
use engine::progress::Observer;

pub(crate) fn run(session: &Session, args: &Masks) -> Result<Done, Failure> {
    let mut show = session.show();
    // Masks beside the run only read it.
    let run = match &args.out {
        Some(_) => session.open(&args.run, &mut show)?,
        None => session.open_to_write(&args.run, &mut show)?,
    };
    let folder = args.out.clone().unwrap_or_else(|| run.folder.join(MASKS));
    show.listen()?;
    let options = MaskOptions { every: args.every, empty: args.empty_class.into() };
    let table = run.write_masks(&folder, options, &mut show)?;
    show.finish();
    let stopped = show.stop_asked();
    line(table.table().trim_end());
    line(format_args!(
        "masks in {} (white = static), beside their photos in {}, scores in {}",
        folder.display(),
        folder.join(SIDE_BY_SIDE).display(),
        folder.join(FILE).display()
    ));
    Ok(if stopped { Done::Interrupted } else { Done::Finished })
}

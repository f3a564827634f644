//! `masks`: which pixels of the training photos show the place itself.

use super::{Done, Failure, Session};
use crate::cli::Masks;
use crate::show::line;
use systems::eval::masks;
use systems::eval::masks::{FILE, MaskOptions, SIDE_BY_SIDE};

pub(crate) fn run(session: &Session, args: &Masks) -> Result<Done, Failure> {
    let mut show = session.show();
    let run = session.open(&args.run, &mut show)?;
    let folder = args.out.clone().unwrap_or_else(|| run.folder.join(masks::FOLDER));
    let options = MaskOptions { every: args.every, empty: args.empty_class.into() };
    let table = run.write_masks(&folder, options, &mut show)?;
    show.finish();
    line(table.table().trim_end());
    line(format_args!(
        "masks in {} (white = static), beside their photos in {}, scores in {}",
        folder.display(),
        folder.join(SIDE_BY_SIDE).display(),
        folder.join(FILE).display()
    ));
    Ok(Done::Finished)
}

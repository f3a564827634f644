//! `eval FILE --scene SCENE`: the held-out views of a dataset, with Gaussians of any program.

use crate::cli::{BackgroundWord, Eval};
use crate::session::{Done, Failure, Session, data_options, scene_spec};
use crate::show::line;
use engine::RunError;
use engine::options::{Background, DataOptions};
use engine::progress::Observer;
use engine::render::plain_query;
use engine::run::HeldOutViews;
use engine::system::Query;

/// Error of a pixel from skipped work where nothing is said: that of the evaluations of runs.
const BUDGET: f32 = 1.0 / 2048.0;

/// Whether a file of Gaussians is to be measured, and not a run.
///
/// # Errors
/// [`RunError::Option`] for words that the other of the two has.
pub(super) fn is_meant(args: &Eval) -> Result<bool, RunError> {
    let what = args.run.display();
    if args.run.is_file() {
        return match (&args.scene, args.scales, &args.eval_appearance) {
            (None, ..) => Err(RunError::Option(format!(
                "`{what}` is a file, which does not say what it is measured against: give the dataset with `--scene SCENE`"
            ))),
            (_, Some(_), _) => Err(RunError::Option(format!(
                "`--scales`: `{what}` is a file of Gaussians; only runs are measured at several scales: leave the option out"
            ))),
            (.., Some(appearance)) => Err(RunError::Option(format!(
                "`--eval-appearance {appearance}`: a file of Gaussians has one appearance: leave the option out"
            ))),
            (Some(_), None, None) => Ok(true),
        };
    }
    if let Some(scene) = &args.scene
        && !args.run.exists()
    {
        return Err(RunError::Option(format!(
            "`{what}`: there is no such file of Gaussians; check the path: its pictures are compared with the photos of `{scene}`"
        )));
    }
    match given(args) {
        Some(word) => Err(RunError::Option(format!(
            "`{word}`: is for a file of Gaussians, and `{what}` is none; a run is measured on the views that it held out: leave \
             the option out"
        ))),
        None => Ok(false),
    }
}

/// The first word that only files have.
fn given(args: &Eval) -> Option<&'static str> {
    let data = data_options(&args.data);
    let words = [
        ("--scene", args.scene.is_some()),
        ("--out", args.out.is_some()),
        ("--background", args.background.is_some()),
        ("--holdout", data.holdout.is_some()),
        ("--validation", data.validation.is_some()),
        ("--longest-side", data.longest_side.is_some()),
    ];
    let named = words.into_iter().find(|(_, given)| *given).map(|(word, _)| word);
    named.or((data != DataOptions::default()).then_some("how the dataset is read"))
}

pub(super) fn run(session: &Session, args: &Eval) -> Result<Done, Failure> {
    let lpips = session.lpips()?;
    let mut show = session.show();
    let spec = scene_spec(args.scene.as_deref().unwrap_or_default());
    let photos = HeldOutViews::open(&spec, &data_options(&args.data), session.parts(), &mut show)?;
    let cloud = super::cloud_file::open(&args.run)?.photographed_by(&photos.training_cameras());
    show.listen()?;
    let background = args.background.map_or(Background::White, BackgroundWord::into);
    let budget = args.error_budget.unwrap_or(BUDGET);
    let query = Query { halt: show.halt(), ..plain_query(background.colour(), budget) };
    let evaluation = photos.evaluate(&cloud, &query, lpips.as_ref(), args.out.as_deref(), &mut show)?;
    show.finish();
    line(evaluation.table().trim_end());
    for note in &evaluation.notes {
        line(format_args!("note: {note}"));
    }
    if let Some(folder) = &args.out {
        if !evaluation.unwritten.is_empty() {
            return Err(RunError::Unwritten { folder: folder.clone(), problems: evaluation.unwritten }.into());
        }
        if !evaluation.stopped {
            line(format_args!("scores and pictures: {}", folder.display()));
        }
    }
    Ok(if evaluation.stopped { Done::Interrupted } else { Done::Finished })
}

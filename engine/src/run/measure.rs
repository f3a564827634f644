//! The held-out views, measured and written down.

use super::kept::{MeasuredViews, PICTURES};
use crate::data::Dataset;
use crate::error::RunError;
use crate::eval::{Evaluation, KnownView, Terms, ViewScore, evaluate_from, skips};
use crate::folder::{EVAL, EVAL_CSV, Place, RENDERS};
use crate::names::stem;
use crate::output::{make_folder, note_unwritten, write_file};
use crate::picture::{depth, depth_range, error_map, write_png};
use crate::progress::{Meter, Observer, Reached};
use crate::system::System;
use std::cell::RefCell;
use std::ops::ControlFlow;

/// All metrics of all held-out views, with their pictures, on disk. Where the observer asks to stop, the pictures alone, and the
/// scores of these views for the next time. Scores come back even where a file cannot be written.
pub(super) fn measure_and_write(
    place: Place<'_>,
    system: &dyn System,
    data: &Dataset,
    terms: &Terms<'_>,
    at: Reached,
    observer: &mut dyn Observer,
) -> Result<Evaluation, RunError> {
    let Place { storage, folder, home } = place;
    let renders = folder.join(RENDERS);
    let mut unwritten = Vec::new();
    note_unwritten(home.guard(|| make_folder(&renders)), &mut unwritten)?;
    let stems: Vec<String> =
        data.views().iter().enumerate().map(|(i, v)| format!("{i:03}_{}", stem(&v.name))).collect();
    let kept = RefCell::new(MeasuredViews::of(folder, at.step, terms));
    let known = |index: usize| kept.borrow().view(index, &renders, &stems[index]);
    let mut meter = Meter::new("held-out view", data.len());
    let mut evaluation = evaluate_from(system, data, terms, at, &known, |seen| {
        let stem = &stems[seen.index];
        let [depth_image, error] =
            [depth(seen.rendered, depth_range(&[seen.rendered])), error_map(seen.picture, seen.truth)];
        let pictures = PICTURES.into_iter().zip([seen.picture, seen.truth, &error, &depth_image]);
        let written = pictures.into_iter().try_for_each(|(ending, picture)| {
            let path = renders.join(format!("{stem}{ending}.png"));
            home.guard(|| {
                write_png(storage, &path, picture).or_else(|_| {
                    // The folder may have gone.
                    make_folder(&renders)?;
                    write_png(storage, &path, picture)
                })
            })
        });
        let known = || KnownView {
            score: ViewScore { files: Some(stem.clone()), ..seen.score.clone() },
            notes: seen.notes.to_vec(),
        };
        let written = written.and_then(|()| kept.borrow_mut().keep(storage, seen.index, known()));
        note_unwritten(written, &mut unwritten)?;
        meter.reach(seen.index + 1, observer);
        Ok(if observer.stop_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
    })?;
    for (score, stem) in evaluation.views.iter_mut().zip(stems) {
        score.files = Some(stem);
    }
    if evaluation.left == 0 {
        evaluation.skips = skips::measure(system, data, terms.query);
        evaluation.stopped = terms.query.halt.raised();
    }
    if !evaluation.stopped {
        let scores = [(EVAL, evaluation.json()), (EVAL_CSV, evaluation.csv())];
        for (name, text) in scores {
            let before = unwritten.len();
            let written = home.guard(|| write_file(storage, &folder.join(name), text.as_bytes()));
            note_unwritten(written, &mut unwritten)?;
            evaluation.written |= name == EVAL && unwritten.len() == before;
        }
    }
    evaluation.unwritten = unwritten;
    Ok(evaluation)
}

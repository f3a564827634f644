//! One system on one set of photos: trained, and measured in each appearance.

use super::protocols::{Entry, Group, Kind, Photos, Segments};
use super::segments;
use crate::bench::{Bench, Extent, say};
use crate::error::BenchError;
use crate::sections::scene::{Job, Trained, dataset, train};
use engine::RunError;
use engine::eval::masks::MaskOptions;
use engine::eval::{EvalAppearance, Evaluation, Scored};
use engine::options::{DataOptions, Request};
use engine::run::Load;
use engine::source::{PERTURBED, SYNTHETIC};
use engine::system::Appearance;
use engine::train::{Schedule, Stop};
use losses::metrics::EmptyClass;
use scene_io::synthetic::{PlazaOptions, plaza};
use scene_io::{Scene, Split};
use std::path::Path;

/// Pixels whose masks are compared with the truth, roughly: photos are left out evenly where there are more.
const MASK_PIXELS: f64 = 3e6;

/// What came out.
pub(super) struct Measured {
    pub(super) views: String,
    /// A measurement for each appearance of the photos.
    pub(super) scores: Vec<Score>,
    /// Mean over photos of mIoU and of F1 of occluders, where the truth is known.
    pub(super) masks: [Option<f64>; 2],
    pub(super) ms_per_step: f64,
}

/// Means over the held-out views in one appearance.
pub(super) struct Score {
    pub(super) scored: Scored,
    pub(super) psnr: Option<f64>,
    pub(super) psnr_object: Option<f64>,
    pub(super) ssim: Option<f64>,
}

impl From<Evaluation> for Score {
    fn from(e: Evaluation) -> Self {
        Self { scored: e.protocol.scored, psnr: e.psnr, psnr_object: e.psnr_object, ssim: e.ssim }
    }
}

/// The request that a protocol makes; `None` where its dataset is not there: said loudly.
pub(super) fn request(
    bench: &Bench,
    group: &Group,
    photos: &Photos,
    entry: &Entry,
    folder: &Path,
) -> Result<Option<Request>, BenchError> {
    let data = DataOptions {
        longest_side: group.longest_side,
        holdout: group.holdout.word(folder)?,
        validation: bench.validation.clone(),
        mask_white: group.mask_white.map(Into::into),
        train_split: photos.split.map(Into::into),
        ..DataOptions::default()
    };
    let mut request = if group.path.starts_with(SYNTHETIC) {
        Request { scene: Some(group.path.into()), data, ..Request::default() }
    } else {
        let Some(subject) = dataset(bench, group.name, group.path, data) else { return Ok(None) };
        subject.request
    };
    if let (Kind::Perturbed(what), Some(scene)) = (photos.kind, &mut request.scene) {
        *scene = format!("{PERTURBED}{what}:{scene}");
    }
    request.system = Some(entry.system.into());
    request.set = entry.set.parse().map_err(BenchError::part)?;
    Ok(Some(request))
}

/// Train for `steps`, measure the held-out views in each of `appearances`, and the masks of all training photos.
pub(super) fn measure(
    bench: &Bench,
    name: &str,
    segments: Segments,
    request: &Request,
    steps: u64,
    appearances: &[&str],
) -> Result<Measured, BenchError> {
    let outlines = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    let load = |spec: &str, data: &DataOptions| {
        let mut scene = load(bench, spec, data)?;
        if let Segments::True(square) = segments {
            segments::write(&mut scene, square, outlines.path()).map_err(|e| RunError::Option(e.line()))?;
        }
        Ok(scene)
    };
    let load: &Load<'_> = &load;
    let appearances: Vec<EvalAppearance> =
        appearances.iter().map(|l| l.parse().map_err(BenchError::Part)).collect::<Result<_, _>>()?;
    let schedule = Schedule::new(Stop::Steps(steps));
    let job = Job { name, request, load, build: &systems::registry::build, schedule, lpips: None };
    let mut known = appearances;
    let mut trained = train(job, |run| {
        // A system that knows one appearance has no photo's: its whole views are in the only one.
        if run.system.appearance_code(&Appearance::Mean).is_none() {
            known.iter_mut().filter(|l| matches!(l, EvalAppearance::Image(_))).for_each(|l| *l = EvalAppearance::Mean);
        }
        run.measure_in(known.first().cloned());
    })?;
    let mut scores: Vec<Score> = trained.evaluation.take().into_iter().map(Score::from).collect();
    let (views, ms_per_step) = (trained.views(), trained.ms_per_step());
    let Trained { mut run, mut watch, folder, .. } = trained;
    for appearance in known.into_iter().skip(1) {
        run.measure_in(Some(appearance));
        scores.push(run.evaluate(None, &mut watch)?.into());
    }
    let has_truth = run.scene.frames.iter().any(|f| f.split == Split::Train && f.truth.transient.is_some());
    let finds_occluders = || Ok::<_, RunError>(run.system.visibility(&run.train, 0)?.is_some());
    let masks = match has_truth && finds_occluders()? {
        true => {
            let every = (run.train.pixel_count() as f64 / MASK_PIXELS).ceil().max(1.0) as usize;
            let options = MaskOptions { every, empty: EmptyClass::default() };
            let table = run.write_masks(&folder.path().join("masks"), options, &mut watch)?;
            if table.with_truth > 0 { [table.per_image.miou, table.per_image.f1] } else { [None; 2] }
        }
        false => [None; 2],
    };
    say(&format!("        {name}: {ms_per_step:.1} ms a step"));
    Ok(Measured { views, scores, masks, ms_per_step })
}

/// Files and embedded scenes as everywhere; in quick runs the embedded scene is small.
fn load(bench: &Bench, spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    if bench.extent == Extent::Quick && spec == format!("{SYNTHETIC}plaza") {
        let photos = data.load_options()?.train_photos;
        return Ok(plaza(&PlazaOptions {
            width: 48,
            height: 36,
            train: 8,
            test: 2,
            photos,
            ..PlazaOptions::default()
        }));
    }
    engine::source::load(spec, data)
}

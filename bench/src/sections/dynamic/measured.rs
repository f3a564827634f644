//! One system on one moving scene: trained, and measured.

use super::empty::psnr_behind;
use super::entry::Entry;
use super::film::{PRIORS, small_orbit};
use super::protocols::Group;
use crate::bench::{Bench, Extent, say};
use crate::error::BenchError;
use crate::sections::scene::{Job, Point, dataset, train};
use engine::RunError;
use engine::eval::MotionScore;
use engine::eval::lpips_file::{load_lpips, lpips_path};
use engine::options::{DataOptions, Request};
use engine::source::{SYNTHETIC, as_asked};
use engine::train::{Schedule, Stop};
use losses::metrics::Lpips;
use scene_io::synthetic::{MouthOptions, OrbitMotion, OrbitOptions, TissueOptions, mouth, orbit, tissue};
use scene_io::{Scene, Split};
use std::path::Path;

/// Training seconds after which the held-out views are measured.
pub(super) const EVAL_AT: [f64; 6] = [10.0, 30.0, 60.0, 120.0, 300.0, 600.0];
/// The share of a training after which they are measured besides: what is ten times as fast has it all by then.
const EARLY: f64 = 0.1;
/// Steps between measurements where steps are given: so many in all.
const POINTS: u64 = 10;

/// Held-out views of systems whose pictures take minutes.
const VIEWS_OF_SLOW: usize = 2;

/// What came out.
#[derive(Clone, Debug, Default)]
pub(super) struct Measured {
    pub(super) name: &'static str,
    pub(super) system: &'static str,
    /// Settings of the row, TOML.
    pub(super) set: &'static str,
    pub(super) views: String,
    pub(super) steps: u64,
    pub(super) seconds: f64,
    /// Means over the held-out views at the end.
    pub(super) psnr: Option<f64>,
    pub(super) ssim: Option<f64>,
    pub(super) lpips: Option<f64>,
    pub(super) motion: MotionScore,
    /// Of what is behind what moves, where that is known.
    pub(super) behind: Option<f64>,
    /// Mean over the training.
    pub(super) rays_per_s: Option<f64>,
    pub(super) curve: Vec<Point>,
}

/// The request for an entry; `None` where the dataset is not there: said loudly.
pub(super) fn request(
    bench: &Bench,
    group: &Group,
    entry: &Entry,
    folder: &Path,
) -> Result<Option<Request>, BenchError> {
    let holdout = group.holdout.word(folder)?;
    let data = match group.film {
        Some(film) => DataOptions { holdout, priors: Some(folder.join(PRIORS)), ..film.data(bench) },
        None => DataOptions { holdout, validation: bench.validation.clone(), ..DataOptions::default() },
    };
    let request = if group.path.starts_with(SYNTHETIC) {
        Request { scene: Some(group.path.into()), data, ..Request::default() }
    } else {
        let Some(subject) = dataset(bench, group.name, group.path, data) else { return Ok(None) };
        subject.request
    };
    let parse = |set: &str| set.parse::<toml::Table>().map_err(BenchError::part);
    let mut set = parse(entry.set)?;
    if bench.extent == Extent::Quick {
        set.extend(parse(entry.quick)?);
    }
    Ok(Some(Request { system: Some(entry.system.into()), set, ..request }))
}

/// Train until `stop`, the held-out views measured on the way, and measure everything at the end.
pub(super) fn measure(
    bench: &Bench,
    group: &Group,
    entry: &Entry,
    request: &Request,
    stop: Stop,
    lpips: Option<&Lpips>,
) -> Result<Measured, BenchError> {
    let load = |spec: &str, data: &DataOptions| -> Result<Scene, RunError> {
        let mut scene = load(bench, group, spec, data)?;
        if !entry.masks {
            scene.frames.iter_mut().for_each(|frame| frame.priors.motion.mask = None);
        }
        if entry.slow {
            let mut held_out = 0;
            scene.frames.retain(|frame| {
                held_out += usize::from(frame.split == Split::Test);
                frame.split != Split::Test || held_out <= VIEWS_OF_SLOW
            });
        }
        Ok(scene)
    };
    let name = format!("{}, {}", group.name, entry.name);
    let job = Job {
        name: &name,
        request,
        load: &load,
        build: &systems::registry::build,
        schedule: schedule(stop, bench.at_end || entry.slow),
        lpips,
    };
    let trained = train(job, |_| {})?;
    let (views, ended) = (trained.views(), trained.ended);
    say(&format!("        {name}: {:.1} ms a step", trained.ms_per_step()));
    let behind = match empty_stage(bench, group, &request.data)? {
        Some(empty) => psnr_behind(&trained.run, &empty)?,
        None => None,
    };
    let mut out = Measured {
        behind,
        name: entry.name,
        system: entry.system,
        set: entry.set,
        views,
        steps: ended.step,
        seconds: ended.seconds,
        rays_per_s: trained.watch.rays_per_s(),
        curve: trained.watch.curve,
        ..Measured::default()
    };
    if let Some(e) = trained.evaluation {
        (out.psnr, out.ssim, out.lpips, out.motion) = (e.psnr, e.ssim, e.lpips, e.motion);
    }
    Ok(out)
}

/// The stage of a page without what moves, filmed alike; `None` for a scene that is not known without.
fn empty_stage(bench: &Bench, group: &Group, data: &DataOptions) -> Result<Option<Scene>, BenchError> {
    if group.film.is_some() || group.path.strip_prefix(SYNTHETIC) != Some("orbit") {
        return Ok(None);
    }
    let options = if bench.extent == Extent::Quick { small_orbit() } else { OrbitOptions::default() };
    let empty = orbit(&OrbitOptions { motion: OrbitMotion::Gone, ..options });
    as_asked(empty, data).map(Some).map_err(BenchError::part)
}

/// When the held-out views are measured; `at_end`: only then.
fn schedule(stop: Stop, at_end: bool) -> Schedule {
    let schedule = Schedule::new(stop);
    match stop {
        _ if at_end => schedule,
        Stop::Seconds(seconds) => {
            Schedule { eval_at: EVAL_AT.into_iter().chain([EARLY * seconds]).collect(), ..schedule }
        }
        Stop::Steps(steps) => Schedule { eval_every: Some(steps.div_ceil(POINTS)), ..schedule },
    }
}

/// Weights of LPIPS: those that the variable names, or those beside the datasets; none: said.
pub(super) fn weights(bench: &Bench) -> Result<Option<Lpips>, BenchError> {
    let beside = || Some(bench.data.as_ref()?.join("../weights/lpips_squeeze.safetensors")).filter(|p| p.is_file());
    let Some(path) = lpips_path(None).or_else(beside) else {
        say("        no LPIPS: WILDFIELD_LPIPS names no weights, and none lie beside the datasets");
        return Ok(None);
    };
    load_lpips(&path).map(Some).map_err(BenchError::part)
}

/// Films as they are filmed, files and embedded scenes as everywhere; in quick runs what is drawn is small.
fn load(bench: &Bench, group: &Group, spec: &str, data: &DataOptions) -> Result<Scene, RunError> {
    if let Some(film) = group.film {
        return film.load(bench.extent, data);
    }
    if bench.extent == Extent::Quick {
        match spec.strip_prefix(SYNTHETIC) {
            Some("orbit") => return Ok(orbit(&small_orbit())),
            Some("mouth") => {
                return Ok(mouth(&MouthOptions {
                    width: 32,
                    height: 32,
                    train: 12,
                    val: 2,
                    test: 2,
                    rays: 1,
                    ..MouthOptions::default()
                }));
            }
            Some("tissue") => {
                return Ok(tissue(&TissueOptions {
                    width: 32,
                    height: 24,
                    frames: 8,
                    rays: 1,
                    ..TissueOptions::default()
                }));
            }
            _ => {}
        }
    }
    engine::source::load_in_order(spec, data)
}

#[cfg(test)]
mod tests {
    use super::super::protocols::{MOUTH, ORBIT, TISSUE};
    use super::*;
    use crate::cli::Cli;
    use clap::Parser;

    #[test]
    fn embedded_scenes_are_small_in_quick_runs() {
        let bench = Bench::new(&Cli::parse_from(["nerf-bench", "--quick", "--threads", "1"])).unwrap();
        for group in [ORBIT, MOUTH, TISSUE] {
            let scene = load(&bench, &group, group.path, &DataOptions::default()).unwrap();
            assert_eq!((scene.name.as_str(), scene.frames[0].camera.width), (group.name, 32));
            assert!(scene.count(scene_io::Split::Test) > 0 && scene.frames.len() < 20, "{}", group.name);
        }
    }

    #[test]
    fn held_out_views_are_measured_after_a_tenth_too() {
        let by_time = schedule(Stop::Seconds(200.0), false);
        assert!(by_time.eval_at.contains(&20.0) && by_time.eval_at.contains(&600.0) && by_time.eval_every.is_none());
        assert_eq!(schedule(Stop::Steps(2000), false).eval_every, Some(200));
        assert_eq!(schedule(Stop::Steps(1), false).eval_every, Some(1));
        let at_end = schedule(Stop::Seconds(200.0), true);
        assert!(at_end.eval_at.is_empty() && at_end.eval_every.is_none());
    }
}

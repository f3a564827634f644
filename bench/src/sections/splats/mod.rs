//! Gaussian splatting: what its kernels cost and how exact they are, PSNR over time, what an error budget buys.

mod budget;
mod errors;
mod ground;
mod kernels;
mod quality;
mod stage;
mod targets;

use super::scene::embedded;
use super::training::not_run;
use crate::bench::{Bench, Extent, Keep, QUICK};
use crate::error::BenchError;
use crate::goals::Goal;
use crate::page::{Item, Section};
use budget::Budgets;
use kernels::Kernels;
use quality::Quality;

/// Settings of quick runs: fewer Gaussians.
const SMALL: &str = "start_count = 1500\nmax_splats = 3000";

/// What `--protocol` may name: the kernels alone, and trainings.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    std::iter::once(KERNELS).chain(quality::names())
}

/// The name of the measurement of kernels among the protocols.
const KERNELS: &str = "splat-kernels";

/// What the parts found so far.
struct Found {
    kernels: Kernels,
    quality: Quality,
    budgets: Budgets,
    goals: Vec<Goal>,
    missing: Vec<&'static str>,
    extent: Extent,
}

pub(crate) fn run(bench: &Bench, keep: &Keep<'_>) -> Result<Section, BenchError> {
    let mut found = Found {
        kernels: Kernels::new(),
        quality: Quality::new(),
        budgets: Budgets::new(),
        goals: Vec::new(),
        missing: Vec::new(),
        extent: bench.extent,
    };
    let folder = tempfile::tempdir().map_err(BenchError::file(&std::env::temp_dir()))?;
    if bench.extent == Extent::Quick {
        let scene = embedded().with_system("tabletop".into(), "splat", SMALL)?;
        kernels::run(bench, &scene, &mut found.kernels, &mut found.goals)?;
        quality::quick(bench, &mut found)?;
        return Ok(found.section());
    }
    if bench.wants(KERNELS) {
        match quality::fox(bench, folder.path())? {
            Some(subject) => kernels::run(bench, &subject, &mut found.kernels, &mut found.goals)?,
            None => found.missing.push(KERNELS),
        }
        keep(&found.section())?;
    }
    quality::run(bench, folder.path(), &mut found, &|found| keep(&found.section()))?;
    Ok(found.section())
}

impl Found {
    fn section(&self) -> Section {
        let mut items = self.kernels.items();
        items.extend(self.quality.items());
        items.extend(self.budgets.items());
        items.extend(not_run(&self.missing));
        if self.extent == Extent::Quick {
            items.push(Item::Text(QUICK.into()));
        }
        Section {
            title: "Gaussian splats",
            intro: "3D Gaussian splatting on the CPU. Times are means over ten of the scene's cameras, medians of repetitions in \
                    which sizes, clouds and numbers of threads take turns. Errors are against a plain `f64` rasteriser, every \
                    pixel of which looks at every Gaussian. PSNR curves are one run each.",
            items,
            goals: self.goals.clone(),
        }
    }
}

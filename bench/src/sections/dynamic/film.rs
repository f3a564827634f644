//! The embedded stage filmed for a page: with validation views of its own, and priors of its training photos in files.

use crate::bench::{Bench, Extent};
use crate::error::BenchError;
use engine::RunError;
use engine::options::DataOptions;
use engine::source::as_asked;
use prepare::{PriorsRequest, Sequence, Silent};
use scene_io::Scene;
use scene_io::synthetic::{Drawn, Orbit, OrbitCamera, OrbitOptions, orbit};
use std::path::Path;

/// The word of `--validation` for the film's own validation views.
const OWN_VIEWS: &str = "dataset";
/// Folder of the priors in that of a page.
pub(super) const PRIORS: &str = "priors";

/// How the stage is filmed, and where its priors come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Film {
    pub(super) camera: OrbitCamera,
    pub(super) priors: PriorsFrom,
}

/// Where optical flow, disparities and motion masks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PriorsFrom {
    /// They are what is known of the stage: all that priors can be good for.
    Stage,
    /// They are made of the photos, as anyone can; there are no disparities.
    Photos,
}

/// The stage in quick runs.
pub(in crate::sections) fn small_orbit() -> OrbitOptions {
    OrbitOptions { width: 32, height: 32, train: 12, test: 2, rays: 1, ..OrbitOptions::default() }
}

impl Film {
    /// In quick runs it is small.
    fn options(self, extent: Extent) -> OrbitOptions {
        let camera = self.camera;
        match extent {
            Extent::Full if camera == OrbitCamera::Walking => OrbitOptions::walk(),
            Extent::Full => OrbitOptions { val: 8, camera, ..OrbitOptions::default() },
            Extent::Quick => OrbitOptions { val: 2, camera, ..small_orbit() },
        }
    }

    /// How its photos are read: its validation views are measured where no others are asked for.
    pub(super) fn data(self, bench: &Bench) -> DataOptions {
        let validation = bench.validation.clone().unwrap_or_else(|| OWN_VIEWS.into());
        DataOptions { validation: Some(validation), ..DataOptions::default() }
    }

    /// The film, read as `data` says.
    pub(super) fn load(self, extent: Extent, data: &DataOptions) -> Result<Scene, RunError> {
        as_asked(orbit(&self.options(extent)), data)
    }

    /// Write the priors of the training photos into [`PRIORS`] in `folder`, with the function behind `nerf-dynamic priors`. Returns
    /// what the page says of them.
    pub(super) fn write_priors(self, bench: &Bench, folder: &Path) -> Result<String, BenchError> {
        let scene = self.load(bench.extent, &self.data(bench))?;
        let OrbitOptions { seed, motion, .. } = self.options(bench.extent);
        let stage = Drawn::Orbit(Orbit::new(seed, motion));
        let exact = (self.priors == PriorsFrom::Stage).then_some(&stage);
        let sequence = Sequence::Scene(&scene);
        let request = PriorsRequest { sequence, exact, out: folder.join(PRIORS), frames: None, longest_side: None };
        let made = prepare::priors(&request, &mut Silent).map_err(BenchError::part)?;
        let camera = match self.camera {
            OrbitCamera::Jumping => "a camera that jumps from photo to photo",
            OrbitCamera::Walking => "a camera that walks half way round",
            OrbitCamera::Frozen => "a camera that stands still",
        };
        let source = match self.priors {
            PriorsFrom::Stage => "exact (`nerf-dynamic priors --exact`), with disparities",
            PriorsFrom::Photos => "made of the photos (`nerf-dynamic priors`), without disparities",
        };
        Ok(format!(
            "The stage is filmed for this page by {camera}. Where nothing else is asked for, **validation views** of its own are \
             measured, and no test view is looked at. Optical flow and motion masks of the {} training photos are {source}: the flow \
             of {:.1} % of the pixels is known, and {:.1} % of those that were judged move. Each row's schedules end where its \
             training does.",
            made.photos,
            100.0 * made.seen,
            100.0 * made.moving
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Cli;
    use clap::Parser;
    use scene_io::{Frame, Split};

    #[test]
    fn priors_of_either_kind_are_written_and_read_with_the_film() {
        let bench = Bench::new(&Cli::parse_from(["nerf-bench", "--quick", "--threads", "1"])).unwrap();
        for (priors, words, disparities) in
            [(PriorsFrom::Stage, "are exact", 12), (PriorsFrom::Photos, "are made of the photos", 0)]
        {
            let film = Film { camera: OrbitCamera::Walking, priors };
            let folder = tempfile::tempdir().unwrap();
            let said = film.write_priors(&bench, folder.path()).unwrap();
            assert!(said.contains(words) && said.contains("walks") && said.contains("12 training photos"), "{said}");
            let data = DataOptions { priors: Some(folder.path().join(PRIORS)), ..film.data(&bench) };
            let scene = film.load(bench.extent, &data).unwrap();
            let count = |has: fn(&Frame) -> bool| scene.split(Split::Train).filter(|i| has(&scene.frames[*i])).count();
            assert_eq!([Split::Train, Split::Val].map(|split| scene.count(split)), [12, 2]);
            assert_eq!(count(|frame| frame.priors.motion.forward.is_some()), 11);
            assert_eq!(count(|frame| frame.priors.motion.backward.is_some()), 11);
            assert_eq!(count(|frame| frame.priors.motion.mask.is_some()), 12);
            assert_eq!(count(|frame| frame.priors.motion.disparity.is_some()), disparities);
            let mut measured = scene.split(Split::Val).map(|i| &scene.frames[i]);
            assert!(measured.all(|frame| frame.truth.scene_flow.is_some()), "where points go is scored");
        }
    }
}

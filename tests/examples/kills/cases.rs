//! What is trained: systems of all apps, as small as they come.

use crate::program::Apps;
use scene_io::synthetic::{OrbitOptions, TabletopOptions, tabletop, write_blender, write_orbit};
use std::path::{Path, PathBuf};

/// A system with its settings.
#[derive(Clone, Copy)]
pub(crate) struct Case {
    pub(crate) app: &'static str,
    pub(crate) system: &'static str,
    set: &'static [&'static str],
    pub(crate) steps: u64,
}

const GRID: &[&str] = &["log2_table=10", "batch_samples=2048", "occupancy=16", "levels=4"];
const NETWORK: &[&str] = &["width=16", "depth=2", "coarse=8", "fine=8", "batch_rays=32"];
const MIP_360: &[&str] = &[
    "width=16",
    "depth=2",
    "proposal_width=16",
    "proposal_depth=2",
    "bottleneck=16",
    "view_width=16",
    "samples=8",
    "proposal_samples=8",
    "batch_rays=32",
];
const WARPED: &[&str] =
    &["log2_table=10", "batch_samples=1024", "occupancy=16", "levels=4", "warp_width=16", "warp_depth=2"];
const SPLATS: &[&str] = &["max_splats=400"];

/// All of them.
pub(crate) const CASES: [Case; 11] = [
    Case { app: "nerf-static", system: "ngp", set: GRID, steps: 60 },
    Case { app: "nerf-static", system: "splat", set: SPLATS, steps: 60 },
    Case { app: "nerf-static", system: "nerf", set: NETWORK, steps: 25 },
    Case { app: "nerf-static", system: "mip-nerf", set: NETWORK, steps: 25 },
    Case { app: "nerf-static", system: "mip-nerf-360", set: MIP_360, steps: 25 },
    Case { app: "nerf-wild", system: "plain", set: GRID, steps: 40 },
    Case { app: "nerf-wild", system: "robust-nerf", set: GRID, steps: 30 },
    Case { app: "nerf-wild", system: "nerf-w", set: GRID, steps: 30 },
    Case { app: "nerf-wild", system: "ha-nerf", set: GRID, steps: 20 },
    Case { app: "nerf-dynamic", system: "d-nerf", set: WARPED, steps: 30 },
    Case { app: "nerf-dynamic", system: "t-nerf", set: GRID, steps: 30 },
];

/// Frames of a rendering.
const FRAMES: &str = "5";

/// Scenes on the disk, and runs that nothing disturbed.
pub(crate) struct Ground {
    pub(crate) apps: Apps,
    folder: PathBuf,
}

impl Ground {
    /// Write the scenes into `folder`.
    pub(crate) fn new(folder: &Path) -> Result<Self, String> {
        let size = TabletopOptions { width: 24, height: 24, train: 6, test: 5, rays: 1, ..TabletopOptions::default() };
        write_blender(&tabletop(&size), &folder.join("still")).map_err(|e| e.to_string())?;
        let size = OrbitOptions { width: 20, height: 20, train: 6, test: 4, rays: 1, ..OrbitOptions::default() };
        write_orbit(&size, &folder.join("moving")).map_err(|e| e.to_string())?;
        Ok(Self { apps: Apps::in_folder(folder)?, folder: folder.into() })
    }

    /// Words of the training of a case into `run`.
    pub(crate) fn train(&self, case: &Case, run: &Path, threads: &str, more: &[&str]) -> Vec<String> {
        let scene = self.folder.join(if case.app == "nerf-dynamic" { "moving" } else { "still" });
        let mut words = owned(&["train", text(&scene), "--out", text(run), "--system", case.system]);
        words.extend(owned(&["--steps", &case.steps.to_string(), "--threads", threads, "--progress", "off"]));
        words.extend(case.set.iter().flat_map(|set| owned(&["--set", set])));
        words.extend(owned(more));
        words
    }

    /// Words of a rendering of `run` into `out`.
    pub(crate) fn render(run: &Path, out: &Path, threads: &str) -> Vec<String> {
        owned(&[
            "render",
            text(run),
            "--frames",
            FRAMES,
            "--out",
            text(out),
            "--layers",
            "colour,depth",
            "--video",
            "off",
            "--threads",
            threads,
            "--progress",
            "off",
        ])
    }

    /// The run of a case that nothing disturbed, and its rendering: made once.
    pub(crate) fn undisturbed(&self, case: &Case) -> Result<(PathBuf, PathBuf), String> {
        let run = self.folder.join(format!("undisturbed-{}", case.system));
        let pictures = self.folder.join(format!("pictures-{}", case.system));
        if !pictures.exists() {
            for words in [self.train(case, &run, "2", &[]), Self::render(&run, &pictures, "2")] {
                let answer = self.apps.run(case.app, &words)?;
                if answer.code != Some(0) {
                    return Err(format!("undisturbed `{}` ended with {:?}: {}", answer.words, answer.code, answer.err));
                }
            }
        }
        Ok((run, pictures))
    }
}

pub(crate) fn owned(words: &[&str]) -> Vec<String> {
    words.iter().map(ToString::to_string).collect()
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("temporary folders have plain names")
}

//! Scene flow without each of its parts: `nsff` and `dynamic-nerf`, whole, and with one loss or one prior taken out a row.

use super::entry::Entry;

const NSFF: Entry = Entry::new("nsff");
const DYNAMIC_NERF: Entry = Entry::new("dynamic-nerf");

/// What knows no time, what has no scene flow, and the two systems without their parts.
pub(super) const ABLATIONS: &[Entry] = &[
    Entry::new("ngp"),
    Entry::new("d-nerf"),
    // A moving part without scene flow: motion masks say where it is, as in the two systems below; it reads neither flow nor disparities.
    Entry::new("t-nerf").named("t-nerf, before a still part").set("background = 'static'\nby_error = true"),
    NSFF,
    NSFF.without("nsff, no renders of the moving part alone, here or in frames beside", "flow_renders = 0.0"),
    NSFF.without("nsff, not seen two frames on", "flow_chain_from = 1.0"),
    NSFF.without("nsff, errors of renders count everywhere", "flow_by_share = false"),
    NSFF.without("nsff, being hidden costs nothing", "flow_hidden = 0.0"),
    NSFF.without("nsff, no cycle loss", "flow_cycle = 0.0"),
    NSFF.without("nsff, scene flow not kept small", "flow_small = 0.0"),
    NSFF.without("nsff, scene flow not smooth along rays", "flow_spatial = 0.0"),
    NSFF.without("nsff, paths not steady", "flow_steady = 0.0"),
    NSFF.without("nsff, rays not led by errors", "by_error = false"),
    NSFF.without("nsff, no optical flow", "flow_optical = 0.0"),
    NSFF.without("nsff, no disparities", "flow_disparity = 0.0"),
    NSFF.without("nsff, no motion masks", "").blind(),
    NSFF.without("nsff, no priors at all", "flow_optical = 0.0\nflow_disparity = 0.0").blind(),
    DYNAMIC_NERF,
    DYNAMIC_NERF
        .without("dynamic-nerf, no renders of the moving part alone, here or in frames beside", "flow_renders = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, not seen two frames on", "flow_chain_from = 1.0"),
    DYNAMIC_NERF.without("dynamic-nerf, no cycle loss", "flow_cycle = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, scene flow not kept small", "flow_small = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, scene flow not smooth along rays", "flow_spatial = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, paths not steady", "flow_steady = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, weights along rays not gathered", "flow_entropy = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, depths of both parts free where nothing moves", "flow_order = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, gate free where nothing moves", "flow_still = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, moving part's share not held to masks", "flow_mask = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, still part not held", "still_freezes = false"),
    DYNAMIC_NERF.without("dynamic-nerf, rays not led by errors", "by_error = false"),
    DYNAMIC_NERF.without("dynamic-nerf, no optical flow", "flow_optical = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, no disparities", "flow_disparity = 0.0"),
    DYNAMIC_NERF.without("dynamic-nerf, no motion masks", "").blind(),
    DYNAMIC_NERF.without("dynamic-nerf, no priors at all", "flow_optical = 0.0\nflow_disparity = 0.0").blind(),
];

#[cfg(test)]
mod tests {
    use super::super::film::PRIORS;
    use super::super::protocols::ORBIT_EXACT;
    use crate::bench::Bench;
    use crate::cli::Cli;
    use clap::Parser;
    use engine::data::Dataset;
    use engine::options::{DataOptions, RunOptions};
    use engine::train::Stop;
    use scene_io::{ImageStore, Split, StoreOptions};
    use std::sync::Arc;

    #[test]
    fn each_row_takes_out_what_its_system_has() {
        let bench = Bench::new(&Cli::parse_from(["nerf-bench", "--quick", "--threads", "1"])).unwrap();
        let (film, folder) = (ORBIT_EXACT.film.unwrap(), tempfile::tempdir().unwrap());
        film.write_priors(&bench, folder.path()).unwrap();
        let data = DataOptions { priors: Some(folder.path().join(PRIORS)), ..film.data(&bench) };
        let scene = film.load(bench.extent, &data).unwrap();
        let store = Arc::new(ImageStore::new(&scene.frames, StoreOptions::default()).unwrap());
        let train = Dataset::new(&scene, store, scene.split(Split::Train).collect()).unwrap();
        let small: toml::Table = "log2_table = 12".parse().unwrap();
        let mut plans: Vec<(&str, toml::Table)> = Vec::new();
        for entry in ORBIT_EXACT.entries {
            assert!(entry.name.starts_with(entry.system), "{}", entry.name);
            let own: toml::Table = entry.set.parse().unwrap();
            assert!(entry.without.is_none() || !own.is_empty() || !entry.masks, "{} takes nothing out", entry.name);
            let set = small.clone().into_iter().chain(own.clone()).collect();
            let stop = Some(Stop::Steps(10));
            let run = RunOptions { seed: 0, background: None, error_budget: None, stop, set };
            let built = systems::registry::build(entry.system, &scene, &train, &run);
            let (_, plan) = built.unwrap_or_else(|e| panic!("{}: {e}", entry.name));
            if let Some((_, whole)) = plans.iter().find(|(name, _)| entry.without == Some(*name)) {
                for key in own.keys() {
                    assert_ne!(plan.config[key], whole[key], "{}: `{key}` is so anyway", entry.name);
                }
            }
            plans.push((entry.name, plan.config));
        }
    }
}

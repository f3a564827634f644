//! The memory that a training of splats says it needs, and what its process takes.
#![cfg(target_os = "linux")]

use crate::tools::{dataset, nerf, text};
use scene_io::synthetic::{TabletopOptions, tabletop, write_blender};
use serde_json::Value;
use std::fs;
use std::path::Path;
use systems::memory::human;

/// Expected and resident peak bytes of a run, the process its own: at its end.
fn taken(scene: &Path, run: &Path, words: &[&str]) -> [u64; 2] {
    let fixed = ["train", text(scene), "--out", text(run), "--system", "splat", "--progress", "off"];
    let answer = nerf(&[&fixed, words].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    let summary: Value = serde_json::from_slice(&fs::read(run.join("summary.json")).unwrap()).unwrap();
    let bytes = |name: &str| summary["memory"][name].as_u64().unwrap();
    let expected = bytes("images") + bytes("system");
    assert!(answer.out.contains(&format!("memory: {} expected", human(expected))), "{}", answer.out);
    [expected, bytes("peak")]
}

/// Take no more than is expected, besides what `least`, a run of next to nothing, takes; and not much less.
fn as_expected(what: &str, [expected, peak]: [u64; 2], least: u64, slack: u64) {
    let more = peak.saturating_sub(least);
    println!("{what}: {} expected, {} taken", human(expected), human(more));
    assert!(more <= expected, "{what}: {} expected, {} taken", human(expected), human(more));
    assert!(expected < slack * more, "{what}: {} expected for {}", human(expected), human(more));
}

/// Every Gaussian that is pulled at all grows two.
const GROWS: [&str; 6] = ["--set", "densify_from=2", "--set", "densify_every=3", "--set", "densify_gradient=1e-20"];

#[test]
fn a_training_takes_no_more_memory_than_it_says() {
    let (folder, scene) = dataset();
    let run = |name: &str| folder.path().join(name);
    let [_, least] = taken(&scene, &run("least"), &["--steps", "1", "--max-splats", "10"]);
    println!("least: {}", human(least));
    for (density, steps) in [("density=adc", "12"), ("density=mcmc", "30")] {
        let many = ["--max-splats", "60000", "--set", "start_count=45000", "--set", density, "--steps", steps];
        let found = taken(&scene, &run(density), &[&many[..], &GROWS].concat());
        // All that are allowed: that is what was estimated.
        let full = fs::read_to_string(run(density).join("summary.json")).unwrap();
        assert!(full.contains(&format!("\"parameters\": {}", 60_000 * 59)), "{density}: {full}");
        as_expected(density, found, least, 3);
    }
}

#[test]
fn large_pictures_take_no_more_memory_than_they_say() {
    let (folder, scene) = dataset();
    let run = |name: &str| folder.path().join(name);
    let few = ["--steps", "3", "--max-splats", "10"];
    let [_, least] = taken(&scene, &run("least"), &few);
    let large = run("large");
    let options = TabletopOptions { width: 600, height: 450, train: 3, test: 1, rays: 1, ..TabletopOptions::default() };
    write_blender(&tabletop(&options), &large).unwrap();
    as_expected("600x450", taken(&large, &run("run"), &few), least, 4);
}

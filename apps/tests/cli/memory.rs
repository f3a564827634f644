//! The memory that a training says it needs, and what its process takes: of every system, and under a limit.
#![cfg(target_os = "linux")]

use crate::tools::{dataset, error_line, nerf, prepared, text};
use engine::memory::human;
use scene_io::synthetic::{OrbitOptions, TabletopOptions, tabletop, write_blender, write_orbit};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

/// What was printed before the start, and the most that the process held until it ended, bytes.
struct Taken {
    printed: u64,
    peak: u64,
    out: String,
}

/// Train with `program` in a process of its own, looking at what it holds until it ends.
fn taken(program: &str, scene: &str, run: &Path, words: &[&str]) -> Taken {
    let mut child = std::process::Command::new(prepared(program).get_program())
        .args(["train", scene, "--out", text(run), "--progress", "off", "--threads", "2"])
        .args(words)
        .env_remove("WILDFIELD_LPIPS")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let held = fs::read_to_string(&status).ok().and_then(|text| high_water(&text));
        // It only rises, and is gone with the process.
        peak = peak.max(held.unwrap_or(0));
        std::thread::sleep(Duration::from_millis(2));
    }
    let output = child.wait_with_output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{program} {words:?}: {err}");
    let summary: Value = serde_json::from_slice(&fs::read(run.join("summary.json")).unwrap()).unwrap();
    let printed = summary["memory"]["expected"].as_u64().unwrap();
    assert!(out.contains(&format!("memory: {} at most", human(printed))), "{out}");
    Taken { printed, peak, out: out.into_owned() }
}

fn high_water(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// The most is printed, and not much more than that.
fn holds(what: &str, taken: &Taken) {
    let Taken { printed, peak, .. } = *taken;
    println!("{what}: {} printed, {} taken", human(printed), human(peak));
    assert!(peak <= printed, "{what}: {} printed, {} taken", human(printed), human(peak));
    assert!(2 * printed <= 3 * peak, "{what}: {} printed for {}", human(printed), human(peak));
}

const TEN: [&str; 2] = ["--steps", "10"];

/// A few steps of each system on a scene: what it prints holds.
fn each_holds(program: &str, scene: &str, systems: &[&str], words: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    for system in systems {
        let all = [&["--system", system], words].concat();
        holds(system, &taken(program, scene, &folder.path().join(system), &all));
    }
}

#[test]
fn static_systems_take_no_more_memory_than_they_say() {
    let (folder, scene) = dataset();
    each_holds("nerf-static", text(&scene), &["ngp", "k-planes"], &TEN);
    // Networks as published train a few rays a step and render one small view here: the test is about memory.
    let small = folder.path().join("small");
    let options = TabletopOptions { width: 16, height: 16, train: 4, test: 1, rays: 1, ..TabletopOptions::default() };
    write_blender(&tabletop(&options), &small).unwrap();
    let few = ["--set", "batch_rays=32", "--steps", "3"];
    each_holds("nerf-static", text(&small), &["nerf", "mip-nerf", "mip-nerf-360"], &few);
}

#[test]
fn wild_systems_take_no_more_memory_than_they_say() {
    let (_folder, scene) = dataset();
    let systems =
        ["plain", "robust-nerf", "nerf-a", "nerf-u", "nerf-w", "ha-nerf", "ha-nerf-a", "ha-nerf-t", "sf-nerf", "hugs"];
    each_holds("nerf-wild", text(&scene), &systems, &TEN);
    // As many Gaussians at once as there may be: with fewer most of what is held is the program's own, which the margin is not about.
    let full =
        [&TEN[..], &["--set", "start=random", "--set", "start_count=20000", "--set", "max_splats=20000"]].concat();
    let judged = [&full[..], &["--set", "judge_first=4"]].concat();
    each_holds("nerf-wild", text(&scene), &["wild-gaussians", "gs-w", "wild-gs"], &judged);
    each_holds("nerf-wild", text(&scene), &["degauss"], &full);
    // What its density control needs is said, too, so it has to have its turn.
    each_holds("nerf-wild", text(&scene), &["spotless"], &[&full[..], &GROWS].concat());
}

#[test]
fn moving_systems_take_no_more_memory_than_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("scene");
    let options = OrbitOptions { width: 32, height: 32, train: 8, test: 1, rays: 1, ..OrbitOptions::default() };
    write_orbit(&options, &scene).unwrap();
    let systems = ["t-nerf", "d-nerf", "nerfies", "k-planes", "two-parts", "ngp"];
    each_holds("nerf-dynamic", text(&scene), &systems, &TEN);
    // The search for codes takes most of a short run, and its memory is measured with `nerfies` above.
    let one_light = [&TEN[..], &["--set", "appearance=none"]].concat();
    each_holds("nerf-dynamic", text(&scene), &["hypernerf"], &one_light);
    // Published networks: a few rays a step on small pictures.
    let networks = ["--set", "field=mlp", "--set", "batch_rays=32", "--steps", "3", "--longest-side", "16"];
    each_holds("nerf-dynamic", text(&scene), &["d-nerf"], &networks);
    // Of a scene whose depth was measured: it is held to that.
    let small = [&TEN[..], &["--longest-side", "32"]].concat();
    each_holds("nerf-dynamic", "synthetic:tissue", &["endo-nerf"], &small);
    // Its voxels come to their full number within the few steps.
    let grown = [&TEN[..], &["--set", "voxels_every=0.2"]].concat();
    each_holds("nerf-dynamic", text(&scene), &["tineuvox"], &grown);
}

/// Every Gaussian with a gradient at all grows two, where gradients say so.
const GROWS: [&str; 4] = ["--set", "densify_from=2", "--set", "densify_every=3"];
const BY_GRADIENT: [&str; 2] = ["--set", "densify_gradient=1e-20"];

#[test]
fn as_many_gaussians_as_are_allowed_take_no_more_memory_than_said() {
    let (folder, scene) = dataset();
    for (density, steps, more) in [("density=adc", "12", &BY_GRADIENT[..]), ("density=mcmc", "30", &[])] {
        let many = ["--max-splats", "60000", "--set", "start_count=45000", "--set", density, "--steps", steps];
        let words = [&["--system", "splat"], &many[..], &GROWS, more].concat();
        let run = folder.path().join(density);
        let found = taken("nerf-static", text(&scene), &run, &words);
        // All that are allowed: that is what was estimated.
        let full = fs::read_to_string(run.join("summary.json")).unwrap();
        assert!(full.contains(&format!("\"parameters\": {}", 60_000 * 59)), "{density}: {full}");
        holds(density, &found);
    }
}

#[test]
fn large_pictures_take_no_more_memory_than_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("large");
    let options = TabletopOptions { width: 600, height: 450, train: 3, test: 1, rays: 1, ..TabletopOptions::default() };
    write_blender(&tabletop(&options), &large).unwrap();
    let few = ["--system", "splat", "--steps", "3", "--max-splats", "10"];
    holds("600x450", &taken("nerf-static", text(&large), &folder.path().join("run"), &few));
}

#[test]
fn a_limit_plans_smaller_and_is_kept() {
    let (folder, scene) = dataset();
    let run = |name: &str| folder.path().join(name);
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    for system in ["ngp", "splat"] {
        let words = ["--system", system, "--steps", "10"];
        let free = taken("nerf-static", text(&scene), &run(&format!("{system}-free")), &words);
        let limit = mib(free.printed) * 9 / 10;
        let limit_text = limit.to_string();
        let limited = [&words[..], &["--memory", &limit_text]].concat();
        let found = taken("nerf-static", text(&scene), &run(&format!("{system}-limited")), &limited);
        println!("{system}: {} under a limit of {limit} MiB", human(found.peak));
        assert!(found.peak <= limit << 20, "{system}: {} under {limit} MiB", human(found.peak));
        assert!(found.printed <= limit << 20 && found.printed < free.printed);
        assert!(found.out.contains("less memory than planned for"), "{}", found.out);
        // What was planned for the limit goes on under it; where nothing is left to do, nothing is looked at.
        let again = run(&format!("{system}-limited"));
        let words = ["train", "--resume", "--out", text(&again), "--memory", &limit_text];
        for (more, said) in [(&["--steps", "12"][..], "resumed at step 10"), (&[][..], "is finished")] {
            let answer = nerf(&[&words[..], more].concat());
            assert!(answer.code == 0 && answer.out.contains(said), "{more:?}: {} {}", answer.out, answer.err);
        }
    }
    // What nothing can be made of is refused before anything is trained.
    let refused = run("refused");
    let words =
        ["train", text(&scene), "--out", text(&refused), "--set", "log2_table=22", "--steps", "5", "--memory", "100"];
    let answer = nerf(&words);
    assert_eq!(answer.code, 1, "{}", answer.err);
    assert!(error_line(&answer).contains("--memory"), "{}", answer.err);
    assert!(!refused.join("checkpoint").exists());
}

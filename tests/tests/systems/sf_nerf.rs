//! SF-NeRF as a system: the same bits on any number of threads and after a pause, with features beside the photos and
//! without, filters of other runs, and what is said of what does not fit.

use engine::checkpoint;
use engine::data::Dataset;
use engine::options::{Background, DataOptions, Plan, RunConfig, RunOptions, parse_set};
use engine::output::Disk;
use engine::progress::Reached;
use engine::system::{System, SystemError, TensorMap};
use scene_io::{Features, Scene};
use std::ops::Range;
use std::path::{Path, PathBuf};
use tests::{assert_same_bits, state_after, state_of, table_data, write_features};

const SMALL: [&str; 3] = ["levels=4", "log2_table=12", "batch_samples=4096"];

fn build(scene: &Scene, train: &Dataset, set: &[&str]) -> Result<Box<dyn System>, SystemError> {
    planned("sf-nerf", scene, train, set).map(|(system, _)| system)
}

fn planned(name: &str, scene: &Scene, train: &Dataset, set: &[&str]) -> Result<(Box<dyn System>, Plan), SystemError> {
    let narrow = (name == "sf-nerf").then_some("filter_width=16");
    let set = SMALL.iter().copied().chain(narrow).chain(set.iter().copied()).map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
    systems::registry::build(name, scene, train, &run)
}

/// Give every training photo features of `channels(photo)` channels in `folder`.
fn with_features(scene: &mut Scene, train: &Dataset, folder: &Path, channels: impl Fn(usize) -> usize) -> Vec<PathBuf> {
    let mut paths = Vec::new();
    for (i, view) in train.views().iter().enumerate() {
        let path = folder.join(format!("{i}.features.npy"));
        write_features(&path, [channels(i), 2, 3], |k| ((k + i) % 7) as f32 - 3.0);
        scene.frames[view.frame].priors.features = Some(path.clone());
        paths.push(path);
    }
    paths
}

fn run(scene: &Scene, train: &Dataset, set: &[&str], steps: Range<u64>, state: Option<&TensorMap>) -> TensorMap {
    state_after(build(scene, train, set).unwrap(), train, steps, state)
}

#[test]
fn bits_do_not_depend_on_threads_or_pauses() {
    let (mut scene, train, _) = table_data(24);
    let without = run(&scene, &train, &[], 0..6, None);
    assert_same_bits(|steps, state| run(&scene, &train, &[], steps, state));
    assert_same_bits(|steps, state| run(&scene, &train, &["appearance=none"], steps, state));
    let folder = tempfile::tempdir().unwrap();
    with_features(&mut scene, &train, folder.path(), |_| 5);
    assert_same_bits(|steps, state| run(&scene, &train, &[], steps, state));
    // What features say reaches the filter; without them the branch is not there.
    let with = run(&scene, &train, &[], 0..6, None);
    assert!(with.contains_key("filter.features.network") && !without.contains_key("filter.features.network"));
    assert!(run(&scene, &train, &["filter_features=none"], 0..6, None) == without);
    // Training moves every part.
    let before = state_of(build(&scene, &train, &[]).unwrap().as_ref());
    for part in ["filter.place.network", "filter.features.network", "filter.joined.network", "filter.codes"] {
        assert!(before[part] != with[part], "{part}");
    }
    // A state without the branch is none of a filter with it.
    let error = build(&scene, &train, &[]).unwrap().load_state(&without).unwrap_err();
    assert!(error.to_string().contains("filter.features.network"), "{error}");
}

#[test]
fn features_that_do_not_fit_are_named() {
    let (mut scene, train, _) = table_data(16);
    let folder = tempfile::tempdir().unwrap();
    let refused = |scene: &Scene| build(scene, &train, &[]).map(|_| ()).unwrap_err().to_string();

    with_features(&mut scene, &train, folder.path(), |i| if i == 3 { 4 } else { 5 });
    let error = refused(&scene);
    assert!(error.contains("3.features.npy: holds 4 channels") && error.contains("0.features.npy 5"), "{error}");

    let paths = with_features(&mut scene, &train, folder.path(), |_| 5);
    write_features(&paths[2], [5, 2, 3], |i| if i == 8 { f32::NAN } else { 0.0 });
    let error = refused(&scene);
    assert!(error.contains("2.features.npy") && error.contains("not finite"), "{error}");

    with_features(&mut scene, &train, folder.path(), |_| 5);
    let frame = train.view(4).frame;
    scene.frames[frame].priors.features = None;
    let error = refused(&scene);
    assert!(
        error.contains(&format!("`{}`", scene.frames[frame].name)) && error.contains("filter_features=none"),
        "{error}"
    );
    assert!(build(&scene, &train, &["filter_features=none"]).is_ok());

    // Photos that are not trained on need none.
    with_features(&mut scene, &train, folder.path(), |_| 5);
    assert!(build(&scene, &train, &[]).is_ok());
}

/// Six steps of training, and a run folder with a checkpoint of them.
fn saved(name: &str, scene: &Scene, train: &Dataset, set: &[&str], folder: &Path) -> TensorMap {
    let (mut system, plan) = planned(name, scene, train, set).unwrap();
    for step in 0..6 {
        system.step(train, step).unwrap();
    }
    let config = RunConfig {
        scene: "table".into(),
        system: name.into(),
        seed: 3,
        background: Background::White,
        error_budget: 0.0,
        eval_appearance: None,
        data: DataOptions::default(),
        settings: plan.config,
    };
    checkpoint::save(&Disk, folder, system.as_ref(), Reached { step: 6, seconds: 1.0 }, &config, "sha256:").unwrap();
    state_of(system.as_ref())
}

const NETWORKS: [&str; 3] = ["filter.place.network", "filter.features.network", "filter.joined.network"];

#[test]
fn a_filter_of_another_run_is_what_training_begins_with() {
    let (mut scene, train, _) = table_data(24);
    let folder = tempfile::tempdir().unwrap();
    with_features(&mut scene, &train, folder.path(), |_| 5);
    let many = saved("sf-nerf", &scene, &train, &[], folder.path());
    let from = format!("filter_from={:?}", folder.path().display().to_string());
    let (system, plan) = planned("sf-nerf", &scene, &train, &[&from]).unwrap();
    let (begun, scratch) = (state_of(system.as_ref()), state_of(build(&scene, &train, &[]).unwrap().as_ref()));
    // The networks are those of the other run, all else is new: codes, moments, the field.
    for (name, tensor) in &begun {
        let of = if NETWORKS.contains(&name.as_str()) { &many } else { &scratch };
        assert!(tensor == &of[name], "{name}");
    }
    assert!(NETWORKS.iter().all(|name| begun[*name] != scratch[*name]));
    let line = |plan: &Plan| plan.lines.iter().find(|line| line.starts_with("filter:")).unwrap().clone();
    assert!(line(&plan).contains("step-00000006.safetensors") && line(&plan).contains("features"), "{:?}", plan.lines);
    let (_, without) = planned("sf-nerf", &scene, &train, &[]).unwrap();
    assert!(line(&without).contains("from scratch") && line(&without).contains("filter_from"), "{:?}", without.lines);

    // The branch of the features stays, unless set otherwise; the rest learns.
    for (freeze, stays) in [("features", true), ("nothing", false)] {
        let after = run(&scene, &train, &[&from, &format!("filter_freeze={freeze}")], 0..6, None);
        for name in NETWORKS {
            assert_eq!(after[name] == many[name], stays && name == NETWORKS[1], "{freeze}: {name}");
        }
    }
    assert_same_bits(|steps, state| run(&scene, &train, &[&from], steps, state));
    // From the array file itself it is the same.
    let file = format!("filter_from={:?}", checkpoint::folder(folder.path()).join("step-00000006.safetensors"));
    assert!(run(&scene, &train, &[&file], 0..6, None) == run(&scene, &train, &[&from], 0..6, None));

    // A run that goes on needs the file no more; one that begins again does, and the same one.
    let hash = plan.config["filter_sha256"].as_str().unwrap();
    assert_eq!(hash.len(), 64);
    let again = [&from[..], &format!("filter_sha256={hash:?}")];
    let half = run(&scene, &train, &again, 0..3, None);
    let step = |set: &[&str]| build(&scene, &train, set).unwrap().step(&train, 0).unwrap_err().to_string();
    let error = step(&[&from, "filter_sha256=\"0123\""]);
    assert!(error.contains("another filter"), "{error}");
    std::fs::remove_dir_all(checkpoint::folder(folder.path())).unwrap();
    assert!(run(&scene, &train, &again, 3..6, Some(&half)) == run(&scene, &train, &again, 3..6, Some(&half)));
    let error = step(&again);
    assert!(error.contains("filter_from") && error.contains("no checkpoint"), "{error}");
}

#[test]
fn filters_that_do_not_fit_are_named() {
    let (mut scene, train, _) = table_data(16);
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let refused = |scene: &Scene, from: &Path, set: &[&str]| {
        let from = format!("filter_from={:?}", from.display().to_string());
        let error = build(scene, &train, &[&[&from[..]], set].concat()).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains("filter_from") && !error.contains('\n'), "{error}");
        error
    };
    saved("sf-nerf", &scene, &train, &["filter_width=8"], &path("narrow"));
    saved("nerf-u", &scene, &train, &[], &path("other"));
    std::fs::create_dir(path("empty")).unwrap();
    std::fs::write(path("text.safetensors"), "hello").unwrap();

    let error = refused(&scene, &path("narrow"), &[]);
    for part in ["step-00000006.safetensors", "filter.place.network", "[1", "`filter_width` is 8 there and 16 here"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let file = checkpoint::folder(&path("narrow")).join("step-00000006.safetensors");
    assert!(refused(&scene, &file, &[]).contains("have to agree"));
    let error = refused(&scene, &path("other"), &[]);
    assert!(error.contains("filter.place.network") && error.contains("is not a checkpoint of `sf-nerf`"), "{error}");
    assert!(refused(&scene, &path("empty"), &[]).contains("there is no checkpoint in it"));
    assert!(refused(&scene, &path("nowhere"), &[]).contains("cannot be read"));
    assert!(refused(&scene, &path("text.safetensors"), &[]).contains("array file"));
    // Features on one side only.
    saved("sf-nerf", &scene, &train, &[], &path("without"));
    with_features(&mut scene, &train, folder.path(), |_| 5);
    assert!(refused(&scene, &path("without"), &[]).contains("trained without features"));
    saved("sf-nerf", &scene, &train, &[], &path("with"));
    assert!(refused(&scene, &path("with"), &["filter_features=none"]).contains("filter.joined.network"));
}

#[test]
fn density_that_costs_is_less() {
    let (scene, train, _) = table_data(16);
    let small = ["field=mlp", "width=32", "coarse=8", "fine=8", "filter_width=16", "batch_rays=32", "lr=5e-3"];
    let grid = [&SMALL[..], &["filter_width=16"]].concat();
    for (field, steps) in [(&grid[..], 30), (&small, 20)] {
        let build = |sparsity: &str| {
            let set = field.iter().chain([&sparsity]).map(|s| parse_set(s).unwrap()).collect();
            let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, stop: None, set };
            systems::registry::build("sf-nerf", &scene, &train, &run).unwrap().0
        };
        // What one step more costs with the prior and without, of the same state: the prior.
        let prior = |state: &TensorMap| {
            let [with, without] = ["sparsity=10", "sparsity=0"].map(|sparsity| {
                let mut system = build(sparsity);
                system.load_state(state).unwrap();
                system.step(&train, steps).unwrap().loss
            });
            with - without
        };
        let [free, dear] = ["sparsity=0", "sparsity=10"].map(|s| prior(&state_after(build(s), &train, 0..steps, None)));
        assert!(0.0 < free && dear < 0.8 * free, "{field:?}: {dear} {free}");
    }
}

#[test]
fn settings_that_cannot_work_are_refused() {
    let (scene, train, _) = table_data(16);
    for (set, line) in [
        ("filter_octaves=0", "`filter_octaves` = 0: `octaves` is 0, expected 1 to 32, or 0 with the input itself"),
        ("filter_octaves=33", "`filter_octaves` = 33: `octaves` is 33, expected 1 to 32, or 0 with the input itself"),
        ("filter_width=0", "`filter_width` = 0: must be in 1..=512"),
        ("filter_temperature=0", "`filter_temperature` = 0: must be positive and finite"),
        ("filter_lr=-1", "`filter_lr` = -1: must be above 0 and at most 1000"),
        ("filter_opacity=-1", "`filter_opacity` = -1: must be in 0..=1000"),
        ("filter_smoothness=nan", "`filter_smoothness` = NaN: must be in 0..=1000"),
        ("beta_min=0", "`beta_min` = 0: must be in 0.000001..=1000"),
        ("transient_lr=0", "`transient_lr` = 0: must be above 0 and at most 1000"),
        ("sparsity=-1", "`sparsity` = -1: must be in 0..=10"),
        ("tail=-1", "`tail` = -1: must be in 0..=1000"),
    ] {
        let error = build(&scene, &train, &[set]).map(|_| ()).unwrap_err().to_string();
        assert_eq!(error, line, "{set}");
    }
    for (set, line) in [
        ("filter_features=some", "`set` = filter_features = \"some\": must be one of files, none"),
        ("filter_freeze=all", "`set` = filter_freeze = \"all\": must be one of features, nothing"),
    ] {
        let error = build(&scene, &train, &[set]).map(|_| ()).unwrap_err().to_string();
        assert_eq!(error, line, "{set}");
    }
    // Of a transient head, which the filter takes the place of.
    let error = build(&scene, &train, &["head_bias=nan"]).map(|_| ()).unwrap_err().to_string();
    assert!(error.starts_with("`set` = head_bias: there is no such setting; there are appearance, "), "{error}");
}

#[test]
fn constant_features_stay_constant() {
    for (height, width) in [(1, 1), (2, 5), (7, 3)] {
        let features = Features {
            channels: 2,
            width,
            height,
            data: [vec![0.3; height * width], vec![-7.1; height * width]].concat(),
        };
        for size in [(1, 1), (4, 3), (50, 31)] {
            let resized = features.resized(size.0, size.1);
            let (first, second) = resized.data.split_at(size.0 * size.1);
            assert!(first.iter().all(|&x| x == 0.3) && second.iter().all(|&x| x == -7.1));
        }
    }
}

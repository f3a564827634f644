//! SF-NeRF as a system: the same bits on any number of threads and after a pause, with features beside the photos and
//! without, and what is said of features that do not fit.

use scene_io::{Features, Scene};
use std::ops::Range;
use std::path::{Path, PathBuf};
use systems::data::Dataset;
use systems::options::{Background, RunOptions, parse_set};
use systems::system::{System, SystemError, TensorMap};
use tests::{assert_same_bits, state_after, state_of, table_data};

const SMALL: [&str; 4] = ["levels=4", "log2_table=12", "filter_width=16", "batch_samples=4096"];

fn build(scene: &Scene, train: &Dataset, set: &[&str]) -> Result<Box<dyn System>, SystemError> {
    let set = SMALL.iter().chain(set).map(|s| parse_set(s).unwrap()).collect();
    let run = RunOptions { seed: 3, background: Some(Background::White), error_budget: None, set };
    systems::wild::build("sf-nerf", scene, train, &run).map(|(system, _)| system)
}

/// A feature file of `f32`.
fn write_features(path: &Path, [channels, height, width]: [usize; 3], value: impl Fn(usize) -> f32) {
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({channels}, {height}, {width}), }}\n");
    let mut bytes = b"\x93NUMPY\x01\0".to_vec();
    bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend((0..channels * height * width).flat_map(|i| value(i).to_le_bytes()));
    std::fs::write(path, bytes).unwrap();
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

#[test]
fn settings_that_cannot_work_are_refused() {
    let (scene, train, _) = table_data(16);
    for (set, field) in [
        ("filter_octaves=0", "filter_octaves"),
        ("filter_octaves=33", "filter_octaves"),
        ("filter_width=0", "filter_width"),
        ("filter_temperature=0", "filter_temperature"),
        ("filter_lr=-1", "filter_lr"),
        ("filter_opacity=-1", "filter_opacity"),
        ("filter_smoothness=nan", "filter_smoothness"),
        ("beta_min=0", "beta_min"),
        ("filter_features=some", "filter_features"),
    ] {
        let error = build(&scene, &train, &[set]).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(field), "{set}: {error}");
    }
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

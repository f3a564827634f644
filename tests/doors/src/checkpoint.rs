//! Checkpoints, with checksums that hold: what is behind them is meant.
//!
//! The first byte of an input says what follows the second: `0` the JSON file, `1` changes to numbers of the arrays, each
//! of eleven bytes (which array, where in it as two bytes, its eight or first four bytes), `2` the array file as it is.
//! The second byte says how far it goes: from `0` reading alone, the run opened, a step trained, in turn.

use crate::folder::Folder;
use crate::{Try, path, sound};
use engine::checkpoint::{load_newest, sha256};
use engine::data::Dataset;
use engine::options::{DataOptions, Request, RunOptions};
use engine::progress::Silent;
use engine::run::{DefaultSystem, Run, disk_parts};
use engine::train::{Schedule, Stop};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use systems::registry;

const META: &str = "checkpoint/step-00000002.json";
const ARRAYS: &str = "checkpoint/step-00000002.safetensors";

/// What a valid run left.
struct Made {
    meta: Value,
    arrays: Vec<u8>,
    /// Where the values of each array lie in the file.
    places: Vec<std::ops::Range<usize>>,
}

pub(crate) fn open() -> Try {
    let (scene, _) = path::scene();
    let made = make(&scene);
    let mut folder = Folder::new(vec![(META.into(), None), (ARRAYS.into(), None)]);
    Box::new(move |bytes| {
        let [which, how, content @ ..] = bytes else { return };
        let how = how.wrapping_sub(b'0') % 3;
        let arrays = match which {
            b'0' => made.arrays.clone(),
            b'1' => changed(&made, content),
            _ => content.to_vec(),
        };
        let meta = match which {
            b'0' => content.to_vec(),
            _ => made.meta.to_string().into_bytes(),
        };
        // Both files are new each time: neither is restored.
        let (meta, same) = with_checksum(meta, &arrays, &made);
        folder.replace(b'0', &meta);
        fs::write(folder.path().join(ARRAYS), &arrays).expect("a file");
        try_run(folder.path(), &scene, if same { how } else { 0 });
    })
}

/// The JSON file, read alone and with a step after it; changes to the first arrays; an array file of nothing.
pub(crate) fn seeds() -> Vec<(String, Vec<u8>)> {
    let made = make(&path::scene().0);
    let meta = made.meta.to_string();
    let mut empty = 2_u64.to_le_bytes().to_vec();
    empty.extend(b"{}");
    let change = |how: u8, value: u64| {
        let each = (0..made.places.len()).flat_map(|i| [&[i as u8, 0, 1][..], &value.to_le_bytes()].concat());
        [b'1', how].into_iter().chain(each).collect::<Vec<u8>>()
    };
    vec![
        ("meta".into(), [b"00", meta.as_bytes()].concat()),
        ("meta_step".into(), [b"02", meta.as_bytes()].concat()),
        ("arrays_zero".into(), change(b'2', 0)),
        ("arrays_nan".into(), change(b'2', u64::from(f32::NAN.to_bits()))),
        ("arrays_huge".into(), change(b'1', u64::MAX >> 1)),
        ("array_file".into(), [b"20", &empty[..]].concat()),
    ]
}

fn try_run(folder: &Path, scene: &scene_io::Scene, how: u8) {
    match load_newest(folder) {
        Err(error) => return sound::refused(&error.to_string(), "step-00000002"),
        Ok(checkpoint) => {
            assert_eq!(checkpoint.meta.step, 2);
            for (name, tensor) in &checkpoint.state {
                let values = match &tensor.data {
                    engine::system::TensorData::F32(x) => x.len(),
                    engine::system::TensorData::U64(x) => x.len(),
                };
                assert_eq!(values, tensor.shape.iter().product::<usize>(), "{name}");
            }
        }
    }
    if how == 0 {
        return;
    }
    let load = |_: &str, _: &DataOptions| Ok(scene.clone());
    let parts = disk_parts(&load, &build, DefaultSystem::Named("ngp"));
    match Run::open(folder, &Request::default(), parts, &mut Silent) {
        Err(error) => sound::one_line(&error.to_string()),
        Ok(mut run) if how == 2 => {
            let step = run.system.step(&run.train, run.step);
            if let Err(error) = step {
                sound::one_line(&error.to_string());
            }
        }
        Ok(_) => {}
    }
}

fn build(
    name: &str,
    scene: &scene_io::Scene,
    data: &Dataset,
    options: &RunOptions,
) -> Result<(Box<dyn engine::system::System>, engine::options::Plan), engine::system::SystemError> {
    registry::build(name, scene, data, options)
}

/// The JSON text with size and checksum of the arrays; whether its configuration is the valid one. Another one may ask for
/// any amount of memory, which is not what is looked for here.
fn with_checksum(meta: Vec<u8>, arrays: &[u8], made: &Made) -> (Vec<u8>, bool) {
    let Ok(mut value) = serde_json::from_slice::<Value>(&meta) else { return (meta, true) };
    let same = ["config", "dataset"].iter().all(|key| value.get(key) == made.meta.get(key));
    if let Some(tensors) = value.get_mut("tensors").and_then(Value::as_object_mut) {
        tensors.insert("bytes".into(), arrays.len().into());
        tensors.insert("sha256".into(), sha256(arrays).into());
    }
    (value.to_string().into_bytes(), same)
}

fn changed(made: &Made, changes: &[u8]) -> Vec<u8> {
    let mut arrays = made.arrays.clone();
    for change in changes.as_chunks::<11>().0 {
        let [which, high, low, value @ ..] = change;
        let place = made.places[usize::from(*which) % made.places.len()].clone();
        let at = place.start + 4 * (usize::from(*high) << 8 | usize::from(*low)) % place.len().max(1);
        let end = (at + 8).min(place.end);
        arrays[at..end].copy_from_slice(&value[..end - at]);
    }
    arrays
}

/// A run of two steps, as small as it can be.
fn make(scene: &scene_io::Scene) -> Made {
    let folder = Folder::new(Vec::new());
    let load = |_: &str, _: &DataOptions| Ok(scene.clone());
    let set: toml::Table = toml::toml! {
        log2_table = 8
        levels = 2
        occupancy = 16
        batch_rays = 16
        batch_samples = 256
        width = 16
    };
    let request = Request { scene: Some("two".into()), system: Some("ngp".into()), set, ..Request::default() };
    let mut run =
        Run::create(folder.path(), &request, disk_parts(&load, &build, DefaultSystem::Named("ngp")), &mut Silent)
            .unwrap_or_else(|error| panic!("a small run: {error}"));
    run.train(&Schedule::new(Stop::Steps(2)), None, &mut Silent, &AtomicBool::new(false))
        .unwrap_or_else(|error| panic!("two steps: {error}"));
    let arrays = fs::read(folder.path().join(ARRAYS)).expect("an array file");
    let meta = fs::read(folder.path().join(META)).expect("a JSON file");
    let length = usize::try_from(u64::from_le_bytes(arrays[..8].try_into().expect("8 bytes"))).expect("small");
    let header: Value = serde_json::from_slice(&arrays[8..8 + length]).expect("a header");
    let ends = header.as_object().into_iter().flatten().filter_map(|(_, array)| array.get("data_offsets"));
    let place = |ends: &Value| {
        let end = |i: usize| 8 + length + ends[i].as_u64().unwrap_or(0) as usize;
        end(0)..end(1)
    };
    let places = ends.map(place).filter(|place| !place.is_empty()).collect();
    Made { meta: serde_json::from_slice(&meta).expect("a JSON file"), arrays, places }
}

//! Checkpoints whose numbers were changed and whose checksums were made to fit: a line that says what is wrong, or a run that works;
//! never a panic, never more memory than a run of this size needs.

use engine::RunError;
use engine::checkpoint::sha256;
use engine::memory::resident_bytes;
use engine::options::{DataOptions, Request, parse_set};
use engine::output::Disk;
use engine::progress::Silent;
use engine::run::{Build, DefaultSystem, Parts, Run};
use engine::train::{Schedule, Stop};
use scene_io::Scene;
use scene_io::synthetic::{OrbitOptions, TabletopOptions, orbit, tabletop};
use serde_json::{Value, json};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// A run of all these may hold so much more than it did, bytes.
const MOST_MORE: u64 = 1 << 30;
const STEPS: u64 = 2;

const GRID: &[&str] = &["levels=4", "log2_table=8", "occupancy=16", "batch_samples=256", "batch_rays=32"];
/// With a code for each photo.
const CODES: &[&str] =
    &["levels=4", "log2_table=8", "occupancy=16", "batch_samples=256", "batch_rays=32", "appearance=codes"];
const VOXELS: &[&str] = &["voxels=12", "occupancy=16", "batch_samples=256", "batch_rays=32"];
const PLANES: &[&str] = &["plane_vertices=6", "occupancy=16", "batch_samples=256", "batch_rays=32"];
const NETWORK: &[&str] = &["width=16", "depth=2", "coarse=4", "fine=4", "batch_rays=16"];
const MIP_360: &[&str] = &["width=16", "depth=2", "proposal_width=16", "proposal_depth=2", "batch_rays=16"];

/// One system with a folder that it was trained into.
struct Forge<'a> {
    name: &'a str,
    scene: Scene,
    build: &'a Build<'a>,
    folder: tempfile::TempDir,
    problems: Vec<String>,
    tried: usize,
}

impl<'a> Forge<'a> {
    fn new(name: &'a str, scene: Scene, build: &'a Build<'a>, set: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let forge = Self { name, scene, build, folder, problems: Vec::new(), tried: 0 };
        let request = Request {
            scene: Some("small".into()),
            system: Some(name.into()),
            set: set.iter().map(|s| parse_set(s).unwrap()).collect(),
            ..Request::default()
        };
        forge.with_parts(|parts| {
            let mut run = Run::create(forge.run(), &request, parts, &mut Silent).unwrap();
            run.train(&forge.schedule(STEPS), None, &mut Silent, &Default::default()).unwrap();
        });
        forge
    }

    fn run(&self) -> &Path {
        self.folder.path()
    }

    fn schedule(&self, steps: u64) -> Schedule {
        Schedule { disk_wait: std::time::Duration::ZERO, ..Schedule::new(Stop::Steps(steps)) }
    }

    fn with_parts<R>(&self, work: impl FnOnce(Parts<'_>) -> R) -> R {
        let load = |_: &str, _: &DataOptions| -> Result<Scene, RunError> { Ok(self.scene.clone()) };
        work(Parts { load: &load, build: self.build, storage: &Disk, default_system: DefaultSystem::Named(self.name) })
    }

    fn file(&self, ending: &str) -> PathBuf {
        self.run().join(format!("checkpoint/step-{STEPS:08}.{ending}"))
    }

    /// Open the run, do one more step, wherever it was, and render a view.
    fn go_on(&self) -> Result<(), RunError> {
        self.with_parts(|parts| -> Result<(), RunError> {
            let mut run = Run::open(self.run(), &Request::default(), parts, &mut Silent)?;
            let data = engine::data::Dataset::new(&run.scene, store(&run.scene), train_views(&run.scene))?;
            let step = run.step;
            run.system.step(&data, step)?;
            let view = data.view(0);
            let query = run.query();
            let _ = engine::render::render(run.system.as_ref(), &view.camera, &query);
            Ok(())
        })
    }

    /// What is not forged works: otherwise every forgery might be refused for the same wrong reason.
    fn control(&mut self, what: &str) {
        if let Err(error) = self.go_on() {
            self.problems.push(format!("{}: {what}: {error}", self.name));
        }
    }

    /// A forged checkpoint.
    fn try_it(&mut self, what: &str) {
        self.tried += 1;
        let outcome = catch_unwind(AssertUnwindSafe(|| self.go_on()));
        match outcome {
            Err(_) => self.problems.push(format!("{}: {what}: a panic", self.name)),
            Ok(Err(error)) if error.to_string().lines().count() != 1 => {
                self.problems.push(format!("{}: {what}: more than one line: {error}", self.name));
            }
            Ok(_) => {}
        }
    }

    /// Each number of the JSON file, replaced.
    fn numbers(&mut self) {
        let path = self.file("json");
        let bytes = fs::read(&path).unwrap();
        let whole: Value = serde_json::from_slice(&bytes).unwrap();
        let mut places = Vec::new();
        leaves(&whole, &mut String::new(), &mut places);
        let extremes = [
            json!(0),
            json!(-1),
            json!(u64::MAX),
            json!(i64::MIN),
            json!(1_u64 << 40),
            json!(1e300),
            json!(-1e300),
            json!(1e-300),
            json!("x"),
            json!(null),
        ];
        for place in places {
            for extreme in &extremes {
                let mut forged = whole.clone();
                *forged.pointer_mut(&place).unwrap() = extreme.clone();
                fs::write(&path, forged.to_string()).unwrap();
                self.try_it(&format!("{place} = {extreme}"));
            }
        }
        fs::write(&path, bytes).unwrap();
    }

    /// Some entries, the shape and the type of each array, replaced.
    fn arrays(&mut self) {
        let path = self.file("safetensors");
        let bytes = fs::read(&path).unwrap();
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
        let body = &bytes[8 + length..];
        for (name, entry) in header.as_object().unwrap() {
            let Some(offsets) = entry["data_offsets"].as_array() else { continue };
            let [start, end] = [0, 1].map(|i| offsets[i].as_u64().unwrap() as usize);
            for shape in [json!([0]), json!([u64::MAX]), json!([1_u64 << 62, 4]), json!([-1]), json!([]), json!("x")] {
                let mut forged = header.clone();
                forged[name]["shape"] = shape.clone();
                self.put(&forged, body);
                self.try_it(&format!("{name}: shape {shape}"));
            }
            for offsets in [json!([0, u64::MAX]), json!([u64::MAX, 0]), json!([end, start]), json!([0, 0])] {
                let mut forged = header.clone();
                forged[name]["data_offsets"] = offsets.clone();
                self.put(&forged, body);
                self.try_it(&format!("{name}: offsets {offsets}"));
            }
            let mut forged = header.clone();
            forged[name]["dtype"] = json!("F64");
            self.put(&forged, body);
            self.try_it(&format!("{name}: dtype F64"));
            let floats = [f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX, 0.0].map(|x| x.to_le_bytes().to_vec());
            let counts = [0, 1, u64::MAX, u64::MAX >> 1, 1 << 53, 1 << 32].map(|x: u64| x.to_le_bytes().to_vec());
            let extremes = if entry["dtype"] == "F32" { &floats[..] } else { &counts[..] };
            let width = extremes[0].len();
            let entries = (end - start) / width;
            let some = (0..entries.min(2)).chain((entries > 2).then(|| entries - 1));
            for i in some {
                for extreme in extremes {
                    let mut forged = body.to_vec();
                    forged[start + i * width..][..width].copy_from_slice(extreme);
                    self.put(&header, &forged);
                    self.try_it(&format!("{name}[{i}] = bytes {extreme:?}"));
                }
            }
        }
        self.put(&header, body);
        self.control("put back as it was");
    }

    /// Write an array file, and make its checksum fit.
    fn put(&self, header: &Value, body: &[u8]) {
        let header = header.to_string();
        let bytes = [&(header.len() as u64).to_le_bytes(), header.as_bytes(), body].concat();
        let path = self.file("json");
        let mut meta: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        meta["tensors"]["bytes"] = bytes.len().into();
        meta["tensors"]["sha256"] = sha256(&bytes).into();
        fs::write(self.file("safetensors"), bytes).unwrap();
        fs::write(&path, meta.to_string()).unwrap();
    }
}

fn store(scene: &Scene) -> std::sync::Arc<scene_io::ImageStore> {
    std::sync::Arc::new(scene_io::ImageStore::new(&scene.frames, scene_io::StoreOptions::default()).unwrap())
}

fn train_views(scene: &Scene) -> Vec<usize> {
    scene.split(scene_io::Split::Train).collect()
}

/// Paths of all numbers of a JSON value.
fn leaves(value: &Value, path: &mut String, out: &mut Vec<String>) {
    let length = path.len();
    let mut below = |path: &mut String, key: &str, value: &Value| {
        path.push('/');
        path.push_str(&key.replace('~', "~0").replace('/', "~1"));
        leaves(value, path, out);
        path.truncate(length);
    };
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| below(path, key, value)),
        Value::Array(list) => list.iter().enumerate().for_each(|(i, value)| below(path, &i.to_string(), value)),
        Value::Number(_) => out.push(path.clone()),
        _ => {}
    }
}

fn still() -> Scene {
    table(12)
}

/// The encoder of photos needs 16 pixels on each side.
fn photos() -> Scene {
    table(16)
}

fn table(pixels: u32) -> Scene {
    tabletop(&TabletopOptions {
        width: pixels,
        height: pixels,
        train: 4,
        test: 0,
        rays: 1,
        ..TabletopOptions::default()
    })
}

fn moving() -> Scene {
    orbit(&OrbitOptions { width: 12, height: 12, train: 4, test: 0, rays: 1, ..OrbitOptions::default() })
}

fn check(systems: &[(&str, &[&str])], scene: fn() -> Scene, build: &Build<'_>, json: bool) {
    let before = resident_bytes().map_or(0, |r| r.peak);
    let (mut problems, mut tried) = (Vec::new(), 0);
    for (name, set) in systems {
        let mut forge = Forge::new(name, scene(), build, set);
        forge.control("as it was written");
        // Panics of what is tried are counted; those of the test itself are to be seen.
        std::panic::set_hook(Box::new(|_| {}));
        if json {
            forge.numbers();
        }
        forge.arrays();
        let _ = std::panic::take_hook();
        tried += forge.tried;
        problems.append(&mut forge.problems);
    }
    let more = resident_bytes().map_or(0, |r| r.peak).saturating_sub(before);
    println!("{tried} forged checkpoints, {} problems, {} MB more", problems.len(), more / 1_000_000);
    assert!(problems.is_empty(), "{} of {tried}:\n{}", problems.len(), problems.join("\n"));
    assert!(more < MOST_MORE, "{more} bytes more than before");
}

#[test]
fn forged_checkpoints_of_still_scenes() {
    let systems = [("ngp", GRID), ("splat", &["max_splats=60"]), ("nerf", NETWORK)];
    check(&systems, still, &systems::registry::build, true);
    check(&[("mip-nerf", NETWORK), ("mip-nerf-360", MIP_360)], still, &systems::registry::build, false);
}

#[test]
fn forged_checkpoints_of_photos() {
    let names = ["robust-nerf", "nerf-w", "ha-nerf", "sf-nerf", "hugs"];
    check(&names.map(|name| (name, GRID)), photos, &systems::registry::build, false);
    check(
        &[
            ("wild-gaussians", &["max_splats=60"]),
            ("spotless", &["max_splats=60"]),
            ("gs-w", &["max_splats=60", "encoder_side=16"]),
            ("wild-gs", &["max_splats=60", "encoder_side=16", "plane_side=16"]),
        ],
        photos,
        &systems::registry::build,
        false,
    );
}

// Two tests, as each takes one core.
#[test]
fn forged_checkpoints_of_moving_scenes() {
    let names = ["ngp", "t-nerf", "d-nerf"];
    check(&names.map(|name| (name, GRID)), moving, &systems::registry::build, false);
}

#[test]
fn forged_checkpoints_of_moving_scenes_of_more_networks() {
    let systems = [("nerfies", CODES), ("hypernerf", CODES), ("tineuvox", VOXELS), ("k-planes", PLANES)];
    check(&systems, moving, &systems::registry::build, false);
}

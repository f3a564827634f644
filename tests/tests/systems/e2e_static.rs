//! `ngp` from scene to result, through the loop that `nerf-static` uses: on the embedded scene, whose truth is exact, and
//! on real data.

use engine::RunError;
use engine::eval::Evaluation;
use engine::options::{DataOptions, Request, parse_set};
use engine::output::Disk;
use engine::progress::Silent;
use engine::run::{DefaultSystem, Parts, Run};
use engine::surface::mesh;
use engine::train::{Schedule, Stop};
use glam::DVec2;
use scene_io::synthetic::{Tabletop, TabletopOptions, tabletop};
use scene_io::{Scene, Split};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

const SIZE: u32 = 48;

fn small_tabletop() -> Scene {
    tabletop(&TabletopOptions { width: SIZE, height: SIZE, train: 30, test: 3, rays: 2, ..TabletopOptions::default() })
}

/// Small enough for a test, large enough to be right.
fn request(scene: &str) -> Request {
    let set = ["log2_table=14", "batch_samples=8192", "occupancy=32"].map(|s| parse_set(s).unwrap());
    Request { scene: Some(scene.into()), set: set.into_iter().collect(), ..Request::default() }
}

/// Train a new run in `folder`, then look at it.
fn trained<R>(
    folder: &Path,
    request: &Request,
    steps: u64,
    load: &dyn Fn(&str, &DataOptions) -> Result<Scene, RunError>,
    look: impl FnOnce(&Run<'_>, Option<Evaluation>) -> R,
) -> R {
    let parts =
        Parts { load, build: &systems::registry::build, storage: &Disk, default_system: DefaultSystem::Named("ngp") };
    let mut run = Run::create(folder, request, parts, &mut Silent).unwrap();
    let (_, evaluation) =
        run.train(&Schedule::new(Stop::Steps(steps)), None, &mut Silent, &AtomicBool::new(false)).unwrap();
    look(&run, evaluation)
}

#[test]
fn tabletop_is_recovered_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let load = |_: &str, _: &DataOptions| Ok(small_tabletop());
    trained(folder.path(), &request("tabletop"), 200, &load, |run, evaluation| {
        let psnr = evaluation.unwrap().psnr.unwrap();
        println!("tabletop: {psnr:.2} dB");
        assert!(psnr > 27.0, "held-out PSNR {psnr:.2} dB");

        // Depth against the exact one: a mirrored axis or a wrong scale would be off by tens of per cent, half a pixel of
        // shift would show at the edges.
        let truth = Tabletop::new(TabletopOptions::default().seed);
        let mut errors = Vec::new();
        for view in run.held_out.views() {
            let rendered = engine::render::render(run.system.as_ref(), &view.camera, &run.query());
            for (i, t) in rendered.layers.median_depth.iter().enumerate() {
                let pixel = DVec2::new((i as u32 % SIZE) as f64 + 0.5, (i as u32 / SIZE) as f64 + 0.5);
                if let Some(hit) = truth.trace(&view.camera.ray(pixel).unwrap()) {
                    errors.push((f64::from(*t) - hit.t).abs() / hit.t);
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        let (middle, most) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
        assert!(middle < 0.02 && most < 0.15, "relative depth error: median {middle:.4}, 90th percentile {most:.4}");

        // Exported in the input's frame and scale: the table top is a square of side 2 at z = 0. Its underside says nothing:
        // all cameras stand above it, and what lies behind an opaque surface is not learnt.
        let mesh = mesh(run.system.as_ref(), &run.system.bounds(), 15.0, 48, 0.0, &mut Silent).unwrap();
        let sorted = |mut values: Vec<f64>| {
            values.sort_by(f64::total_cmp);
            values
        };
        let at = |values: &[f64], share: f64| values[((values.len() - 1) as f64 * share) as usize];
        let extent = [0, 1, 2].map(|axis| sorted(mesh.vertices.iter().map(|v| v[axis]).collect()));
        for (axis, share, edge) in [(0, 0.01, -1.0), (0, 0.99, 1.0), (1, 0.01, -1.0), (1, 0.99, 1.0), (2, 0.99, 0.72)] {
            let got = at(&extent[axis], share);
            assert!((got - edge).abs() < 0.2, "axis {axis}: {got:.3} for {edge}");
        }
        let up = mesh.vertices.iter().zip(&mesh.normals).filter(|(_, n)| n[2] > 0.8);
        let up = sorted(up.map(|(v, _)| v[2]).collect());
        let (low, top, high) = (at(&up, 0.25), at(&up, 0.5), at(&up, 0.75));
        println!("table top: {top:.3}, quartiles {low:.3} and {high:.3}");
        assert!(top.abs() < 0.05, "the table top lies at {top:.3}");
    });
}

/// The same with samples where proposals put them.
fn proposing() -> Request {
    let set = ["sampler=proposal", "proposal_samples=[32, 24]", "final_samples=16"].map(|s| parse_set(s).unwrap());
    let mut request = request("tabletop");
    // Proposals have no occupancy grid.
    request.set.remove("occupancy");
    request.set.extend(set);
    request
}

#[test]
fn tabletop_is_recovered_where_proposals_look() {
    let folder = tempfile::tempdir().unwrap();
    let load = |_: &str, _: &DataOptions| Ok(small_tabletop());
    trained(folder.path(), &proposing(), 150, &load, |_, evaluation| {
        let psnr = evaluation.unwrap().psnr.unwrap();
        println!("tabletop by proposals: {psnr:.2} dB");
        // An empty picture has 13 dB; 24.4 dB were seen.
        assert!(psnr > 23.0, "held-out PSNR {psnr:.2} dB");
    });
}

#[test]
fn ngp_gives_the_same_bits_with_1_2_and_4_threads() {
    same_bits_with_any_threads(&request("tabletop"));
}

#[test]
fn ngp_with_proposals_gives_the_same_bits_with_1_2_and_4_threads() {
    same_bits_with_any_threads(&proposing());
}

fn same_bits_with_any_threads(request: &Request) {
    let arrays = |threads: usize| {
        let folder = tempfile::tempdir().unwrap();
        let load = |_: &str, _: &DataOptions| Ok(small_tabletop());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trained(folder.path(), request, 40, &load, |_, _| ()));
        std::fs::read(folder.path().join("checkpoint/step-00000040.safetensors")).unwrap()
    };
    let one = arrays(1);
    assert!(one == arrays(2), "2 threads");
    assert!(one == arrays(4), "4 threads");
}

#[test]
fn a_resumed_ngp_run_ends_with_the_same_bits() {
    same_bits_after_resuming(&request("tabletop"));
}

#[test]
fn a_resumed_ngp_run_with_proposals_ends_with_the_same_bits() {
    same_bits_after_resuming(&proposing());
}

fn same_bits_after_resuming(request: &Request) {
    let load = |_: &str, _: &DataOptions| Ok(small_tabletop());
    let (whole, halves) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    trained(whole.path(), request, 50, &load, |_, _| ());
    trained(halves.path(), request, 23, &load, |_, _| ());
    let parts = Parts {
        load: &load,
        build: &systems::registry::build,
        storage: &Disk,
        default_system: DefaultSystem::Named("ngp"),
    };
    let mut run = Run::open(halves.path(), &Request::default(), parts, &mut Silent).unwrap();
    run.train(&Schedule::new(Stop::Steps(50)), None, &mut Silent, &AtomicBool::new(false)).unwrap();
    let arrays = |folder: &Path| std::fs::read(folder.join("checkpoint/step-00000050.safetensors")).unwrap();
    assert!(arrays(whole.path()) == arrays(halves.path()));
}

/// A dataset of the shared collection; says loudly when it is not there.
fn real_data(name: &str) -> Option<PathBuf> {
    testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), name, "e2e_static")
}

/// Train on real photographs at a small size; the held-out PSNR must pass `least`.
fn real(name: &str, data: DataOptions, views: [usize; 2], least: f64) {
    let Some(path) = real_data(name) else { return };
    let folder = tempfile::tempdir().unwrap();
    let request = Request { data, ..request(path.to_str().unwrap()) };
    trained(folder.path(), &request, 80, &engine::source::load, |run, evaluation| {
        assert_eq!([run.scene.count(Split::Train), run.held_out.len()], views);
        let psnr = evaluation.unwrap().psnr.unwrap();
        println!("{name}: {psnr:.2} dB");
        assert!(psnr > least, "{name}: held-out PSNR {psnr:.2} dB");
    });
}

#[test]
fn lego_is_learnt_from_its_files() {
    let data = DataOptions { longest_side: Some(50), ..DataOptions::default() };
    real("nerf_synthetic/lego", data, [100, 25], 20.0);
}

#[test]
fn fox_is_learnt_from_its_photographs() {
    let data = DataOptions { longest_side: Some(60), holdout: Some("every:8".into()), ..DataOptions::default() };
    real("benchmarks/fox135", data, [43, 7], 16.5);
}

#[test]
fn fern_is_learnt_from_its_photographs() {
    let data = DataOptions { longest_side: Some(60), holdout: Some("every:8".into()), ..DataOptions::default() };
    real("nerf_llff_data/fern", data, [17, 3], 19.0);
}

//! Trainings of `splat`: the same bits however they are cut and on any number of threads, and through lenses that bend light.

use engine::data::Dataset;
use engine::render::plain_query;
use engine::system::{TensorData, TensorMap};
use render_core::camera::Lens;
use scene_io::synthetic::{Tabletop, TabletopOptions, tabletop};
use scene_io::{Image, ImageSource, LoadOptions, Scene, Split, load};
use std::ops::Range;
use std::sync::Arc;
use tests::{psnr, state_after, system, table_data, views};

/// Changes at every tenth step from 20 on.
const BUSY: [&str; 6] =
    ["start_count=300", "max_splats=4000", "sh_every=12", "densify_from=15", "densify_every=10", "coarse=1"];
/// The density controls, with settings of theirs alone: opacity resets at every 25th step.
const DENSITIES: [&[&str]; 3] = [
    &["density=split", "densify_gradient=2e-5", "opacity_decay=0.8"],
    &["density=adc", "densify_gradient=2e-5", "reset_every=25"],
    &["density=mcmc"],
];
const STEPS: u64 = 60;
/// Between two changes, right after one, right before one, and after fading.
const CUTS: [u64; 4] = [33, 40, 39, 50];

/// All numbers of a state, as bits.
fn bits(state: &TensorMap) -> Vec<(&str, Vec<u64>)> {
    let of = |data: &TensorData<'_>| match data {
        TensorData::F32(x) => x.iter().map(|x| u64::from(x.to_bits())).collect(),
        TensorData::U64(x) => x.to_vec(),
    };
    state.iter().map(|(name, tensor)| (name.as_str(), of(&tensor.data))).collect()
}

fn logits(state: &TensorMap) -> &[f32] {
    let TensorData::F32(x) = &state["splats.logit"].data else { panic!("opacities are floats") };
    x
}

fn on<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a few threads").install(work)
}

#[test]
fn a_training_cut_in_two_makes_the_same_bits_across_density_control() {
    for control in DENSITIES {
        let density = control[0];
        let (scene, train, _) = table_data(20);
        let set = [&BUSY[..], control, &["coarse_steps=20"]].concat();
        let run = |threads, steps: Range<u64>, state: Option<&TensorMap>| {
            on(threads, || state_after(system("splat", &scene, &train, &set).0, &train, steps, state))
        };
        let whole = run(2, 0..STEPS, None);
        let mut counts = Vec::new();
        for cut in CUTS {
            let half = run(2, 0..cut, None);
            counts.push(logits(&half).len());
            let rest = run(2, cut..STEPS, Some(&half));
            assert!(bits(&rest) == bits(&whole), "{density}: cut at {cut}");
        }
        let end = logits(&whole).len();
        println!("{density}: {counts:?} Gaussians at {CUTS:?}, {end} at {STEPS}");
        // Changes came before and after each cut.
        assert!(counts.iter().all(|n| *n != 300 && *n != end), "{density}: {counts:?}, {end} at the end");
        if density == "density=adc" {
            // Nothing is more opaque than fading leaves it, right after step 50.
            let faded = run(2, 0..50, None);
            assert!(logits(&faded).iter().all(|l| *l <= -4.59), "faded");
            assert!(logits(&whole).iter().any(|l| *l > -4.59), "and has learnt since");
        }
    }
}

#[test]
fn a_training_makes_the_same_bits_on_any_number_of_threads() {
    for control in DENSITIES {
        let density = control[0];
        // Pictures of several tiles, and more Gaussians than one task takes.
        let (scene, train, _) = table_data(40);
        let set = [&BUSY[2..], control, &["start_count=1500", "max_splats=9000", "coarse_steps=10"]].concat();
        let run = |threads| on(threads, || state_after(system("splat", &scene, &train, &set).0, &train, 0..45, None));
        let one = run(1);
        assert!(logits(&one).len() != 1500, "{density}: {}", logits(&one).len());
        for threads in [2, 5] {
            assert!(bits(&run(threads)) == bits(&one), "{density}: {threads} threads");
        }
    }
}

#[test]
fn gradients_without_their_signs_make_more_gaussians_at_the_same_threshold_and_move_none() {
    let (scene, train, _) = table_data(20);
    let run = |absolute: &str, steps| {
        let set = [&BUSY[..], &["density=adc", "densify_gradient=1e-3", "coarse_steps=20", absolute]].concat();
        state_after(system("splat", &scene, &train, &set).0, &train, 0..steps, None)
    };
    let [plain, absolute] =
        ["densify_absolute=false", "densify_absolute=true"].map(|absolute| [run(absolute, 15), run(absolute, 21)]);
    assert!(logits(&plain[0]) == logits(&absolute[0]), "before the first change");
    let [few, many] = [&plain[1], &absolute[1]].map(|state| logits(state).len());
    println!("{few} and {many} of 300 Gaussians");
    assert!(many > few, "{few} and {many}");
}

const LENS: Lens = Lens::Perspective { k: [0.5, 0.1, 0.0, 0.0, 0.0, 0.0], p: [4e-3, -2e-3] };
const SIZE: u32 = 48;

/// The table top as cameras with a lens see it, four rays a pixel: what is not hit is transparent.
fn table_through(lens: Lens) -> Scene {
    let options =
        TabletopOptions { width: SIZE, height: SIZE, train: 20, test: 3, rays: 1, ..TabletopOptions::default() };
    let mut scene = tabletop(&options);
    let table = Tabletop::new(options.seed);
    for frame in &mut scene.frames {
        frame.camera.lens = lens;
        let camera = frame.camera.prepare();
        let pixel = |i: u32| {
            let mut sum = [0.0; 4];
            for (dx, dy) in [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)] {
                let at = (f64::from(i % SIZE) + dx, f64::from(i / SIZE) + dy);
                if let Some(hit) = camera.ray(at.into()).and_then(|ray| table.trace(&ray)) {
                    let [r, g, b] = hit.rgb.to_array();
                    sum = [sum[0] + r, sum[1] + g, sum[2] + b, sum[3] + 1.0];
                }
            }
            let colour = |c: usize| (255.0 * sum[c] / sum[3].max(1.0)).round() as u8;
            [colour(0), colour(1), colour(2), (63.75 * sum[3]).round() as u8]
        };
        let data = (0..SIZE * SIZE).flat_map(pixel).collect();
        frame.image = ImageSource::Memory(Arc::new(Image::rgba(SIZE, SIZE, data).expect("as many as there are")));
    }
    scene
}

#[test]
fn splats_learn_through_a_lens_that_bends_light() {
    let set = ["start_count=1500", "max_splats=3000", "densify_from=100", "densify_every=50"];
    let learn = |scene: &Scene| {
        let (train, test) = views(scene, 1);
        let (mut splat, plan) = system("splat", scene, &train, &set);
        let before = psnr(splat.as_ref(), &test);
        for step in 0..250 {
            splat.step(&train, step).expect("a step of training");
        }
        (before, psnr(splat.as_ref(), &test), splat, plan)
    };
    let scene = table_through(LENS);
    let (before, after, splat, plan) = learn(&scene);
    assert!(plan.lines.iter().any(|l| l.contains("20 photos are drawn onto a plane")), "{:?}", plan.lines);
    // The lens matters: pictures without it are another scene's.
    let mut straight = scene;
    straight.frames.iter_mut().for_each(|f| f.camera.lens = Lens::PINHOLE);
    let wrong = psnr(splat.as_ref(), &views(&straight, 1).1);
    let (_, pinhole, ..) = learn(&table_through(Lens::PINHOLE));
    println!(
        "through the lens: {before:.2} dB before, {after:.2} dB after 250 steps; {wrong:.2} dB drawn without it; \
         {pinhole:.2} dB of a scene without"
    );
    assert!(after > before + 2.0 && after > wrong + 2.0, "{before} to {after} dB, {wrong} dB without the lens");
    assert!(after > pinhole - 2.0, "{after} dB through a lens, {pinhole} dB without");
}

#[test]
fn splats_learn_the_fox_through_its_lens() {
    let Some(dir) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), "instant_ngp/fox", "splat_training")
    else {
        return;
    };
    let scene = load(&dir, &LoadOptions::default()).unwrap_or_else(|e| panic!("fox: {e}"));
    assert!(scene.frames.iter().all(|f| !f.camera.lens.is_pinhole()), "OPENCV distortion");
    // A few photos at a twentieth of their size.
    let frames: Vec<usize> = (0..scene.frames.len()).step_by(2).collect();
    let store = scene_io::StoreOptions::default().with_longest_side(96);
    let store = Arc::new(scene_io::ImageStore::new(&scene.frames, store).unwrap());
    let of = |split: Split| {
        let held = |k: &usize| (k % 8 == 4) == (split == Split::Test);
        let chosen = frames.iter().enumerate().filter(|(k, _)| held(k)).map(|(_, &i)| i).collect();
        Dataset::new(&scene, store.clone(), chosen).unwrap()
    };
    let (train, test) = (of(Split::Train), of(Split::Test));
    let set = ["start_count=3000", "max_splats=6000", "densify_from=100", "densify_every=50"];
    let (mut splat, _) = system("splat", &scene, &train, &set);
    let before = psnr(splat.as_ref(), &test);
    for step in 0..300 {
        splat.step(&train, step).expect("a step of training");
    }
    let after = psnr(splat.as_ref(), &test);
    println!("fox: {before:.2} dB before, {after:.2} dB after 300 steps; {} photos", train.len());
    assert!(after > before + 2.5 && after > 14.0, "{before} to {after} dB");
}

#[test]
fn photos_that_masks_leave_nothing_of_are_counted_and_teach_nothing() {
    let (mut scene, ..) = table_data(20);
    let masked: Vec<usize> = scene.split(Split::Train).step_by(2).collect();
    for &frame in &masked {
        let ImageSource::Memory(image) = &scene.frames[frame].image else { panic!("drawn in memory") };
        let mask = Some(vec![0; (image.width * image.height) as usize]);
        scene.frames[frame].image = ImageSource::Memory(Arc::new(Image { mask, ..Image::clone(image) }));
    }
    let (train, _) = views(&scene, 1);
    let (mut splat, _) = system("splat", &scene, &train, &["start_count=200", "densify_from=1000000"]);
    let mut still = 0;
    for step in 0..train.len() as u64 {
        let before = numbers_of(splat.as_ref());
        splat.step(&train, step).expect("a step of training");
        still += u64::from(before == numbers_of(splat.as_ref()));
    }
    let rows = splat.skips();
    let row = rows.iter().find(|r| r.what.contains("leave nothing")).expect("a row of its own");
    assert_eq!((row.skipped, row.total), (masked.len() as u64, train.len() as u64));
    assert_eq!(still, masked.len() as u64, "the cloud stays as it is");
}

/// The numbers of the cloud alone.
fn numbers_of(splat: &dyn engine::system::System) -> Vec<u32> {
    let cloud = splat.splats(&plain_query([0.0; 3], 0.0)).expect("a cloud").gaussians;
    cloud.fields().iter().flat_map(|(_, x)| x.iter().map(|x| x.to_bits())).collect()
}

#[test]
fn photos_at_several_scales_are_photos_of_their_own() {
    let (scene, ..) = table_data(20);
    let (train, test) = views(&scene, 2);
    for set in [&["start_count=300"][..], &["start_count=300", "coarse=1", "coarse_steps=20"]] {
        let (mut splat, _) = system("splat", &scene, &train, set);
        let before = psnr(splat.as_ref(), &test);
        for step in 0..160 {
            splat.step(&train, step).expect("a step of training");
        }
        let after = psnr(splat.as_ref(), &test);
        println!("{set:?}: {before:.2} dB before, {after:.2} dB after 160 steps");
        assert!(after > before + 1.0, "{before} to {after} dB");
    }
}

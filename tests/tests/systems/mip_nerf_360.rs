//! `mip-nerf-360`: published shapes, and a small one that learns, resumes and does not mind threads.

use tests::{assert_same_bits, psnr, state_after, system, table_data, try_system};

const NAME: &str = "mip-nerf-360";

/// Small enough for a test. The gradient of so few rays is noisier than that of 16384, so its norm may be larger; and the
/// table, most of whose picture is background, wants the squared error.
const SMALL: [&str; 15] = [
    "octaves=6",
    "width=48",
    "depth=3",
    "bottleneck=24",
    "view_width=24",
    "proposal_width=16",
    "proposal_depth=2",
    "proposal_samples=24",
    "samples=16",
    "batch_rays=64",
    "steps=1000",
    "lr_warmup=20",
    "lr=5e-3",
    "clip=0.1",
    "charbonnier=1.0",
];

#[test]
fn shapes_are_the_published_ones() {
    let (scene, train, _) = table_data(8);
    let (system, plan) = try_system(NAME, &scene, &train, &["space=\"contracted\""]).unwrap();
    let rows = 21 * 12 * 2;
    let proposal = (rows * 256 + 256) + 3 * (256 * 256 + 256) + 257;
    let trunk = (rows * 1024 + 1024) + 6 * (1024 * 1024 + 1024) + ((1024 + rows) * 1024 + 1024);
    let heads = 1025 + (1024 * 256 + 256) + ((256 + 27) * 128 + 128) + (128 * 3 + 3);
    assert_eq!(system.parameter_count(), proposal + trunk + heads);
    let setting = |name: &str| plan.config[name].to_string();
    for (name, value) in
        [("proposals", "2"), ("proposal_samples", "64"), ("samples", "32"), ("octaves", "12"), ("last", "\"opaque\"")]
    {
        assert_eq!(setting(name), value, "{name}");
    }
}

fn learns(space: &str, steps: u64, least: f64) {
    let (scene, train, test) = table_data(32);
    let mut system = system(NAME, &scene, &train, &[&SMALL[..], &[space]].concat()).0;
    let before = psnr(system.as_ref(), &test);
    let (mut losses, mut errors) = (Vec::new(), Vec::new());
    for step in 0..steps {
        let stats = system.step(&train, step).unwrap();
        assert!(stats.nonfinite == 0, "step {step}: {stats:?}");
        losses.push(stats.loss);
        errors.push(stats.mse);
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let (first, last) = (mean(&errors[..20]), mean(&errors[errors.len() - 20..]));
    assert!(mean(&losses[..20]) > mean(&losses[losses.len() - 20..]));
    let after = psnr(system.as_ref(), &test);
    println!("{space}: error {first:.4}, then {last:.4}; {before:.2} dB, after {steps} steps {after:.2} dB");
    assert!(last < 0.3 * first, "error {first:.4}, then {last:.4}");
    // A picture that is all background, which the loss may fall into, has 12.7 dB.
    assert!(after > before + 5.0 && after > least, "{before:.2} dB, then {after:.2} dB");
}

#[test]
fn a_small_one_learns_the_table_in_its_box() {
    learns("space=\"box\"", 120, 17.0);
}

#[test]
fn a_small_one_learns_the_table_in_contracted_space_with_distortion() {
    learns("space=\"contracted\"", 250, 15.0);
}

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let (scene, train, _) = table_data(16);
    let set = [&SMALL[..], &["space=\"contracted\""]].concat();
    assert_same_bits(|steps, state| state_after(system(NAME, &scene, &train, &set).0, &train, steps, state));
}

#[test]
fn settings_that_cannot_work_are_named() {
    let (scene, train, _) = table_data(8);
    for (set, field) in [
        ("space=\"ndc\"", "space"),
        ("samples=1", "samples"),
        ("far=0.01", "far"),
        ("clip=-1.0", "clip"),
        ("octaves=0", "octaves"),
    ] {
        let error = try_system(NAME, &scene, &train, &["space=\"contracted\"", set]).err().unwrap().to_string();
        assert!(error.contains(field), "{set}: {error}");
    }
}

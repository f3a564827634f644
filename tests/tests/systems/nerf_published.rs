//! `nerf`: the published shapes and parameter counts, and a small one that learns, resumes and does not mind threads.

use engine::system::TensorMap;
use tests::{assert_same_bits, psnr, state_after, system, table_data};

const SMALL: [&str; 8] =
    ["width=32", "depth=4", "coarse=24", "fine=24", "batch_rays=96", "lr=3e-3", "position_octaves=6", "lr_decay=2000"];

#[test]
fn shapes_and_parameter_counts_are_the_published_ones() {
    let (scene, train, _) = table_data(8);
    let (nerf, plan) = system("nerf", &scene, &train, &[]);
    // 8 layers of 256 with the skip into the sixth, density head, bottleneck, colour over 256 + 27 inputs; twice.
    let trunk = (63 * 256 + 256) + 6 * (256 * 256 + 256) + ((256 + 63) * 256 + 256);
    let heads = 257 + (256 * 256 + 256) + ((256 + 27) * 128 + 128) + (128 * 3 + 3);
    assert_eq!(trunk + heads, 595_844);
    assert_eq!(nerf.parameter_count(), 2 * 595_844);
    let setting = |name: &str| plan.config[name].to_string();
    let published = [("coarse", "64"), ("fine", "128"), ("position_octaves", "10"), ("direction_octaves", "4")];
    for (name, value) in published {
        assert_eq!(setting(name), value, "{name}");
    }
}

#[test]
fn a_small_nerf_learns_the_table() {
    let (scene, train, test) = table_data(32);
    let (mut nerf, _) = system("nerf", &scene, &train, &SMALL);
    let before = psnr(nerf.as_ref(), &test);
    for step in 0..400 {
        nerf.step(&train, step).unwrap();
    }
    let after = psnr(nerf.as_ref(), &test);
    println!("nerf on the table: {before:.2} dB, after 400 steps {after:.2} dB");
    assert!(after > before + 5.0 && after > 19.0, "{before:.2} dB, then {after:.2} dB");
}

#[test]
fn nerf_gives_the_same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let (scene, train, _) = table_data(16);
    assert_same_bits(|steps, state| state_after(system("nerf", &scene, &train, &SMALL).0, &train, steps, state));
}

#[test]
fn a_state_of_another_shape_is_refused_by_name() {
    let (scene, train, _) = table_data(8);
    let (mut nerf, _) = system("nerf", &scene, &train, &SMALL);
    let error = nerf.load_state(&TensorMap::new()).unwrap_err().to_string();
    assert!(error.contains("networks") && error.contains("missing"), "{error}");
}

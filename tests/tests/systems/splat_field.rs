//! Clouds that begin where a field sees surfaces: the same bits with any number of threads and after a resume in any stage, and
//! better pictures than from random places.

use engine::render::plain_query;
use engine::system::TensorMap;
use std::ops::Range;
use tests::{assert_same_bits, psnr, state_after, state_of, system, table, views};

/// Steps 0 to 5 are of the field, Gaussians come after steps 4, 8, ... of the cloud.
const SMALL: [&str; 13] = [
    "start=\"field\"",
    "refill=0.5",
    "field_steps=6",
    "start_count=200",
    "max_splats=1000",
    "densify_from=3",
    "densify_every=4",
    "densify_until=13",
    "densify_gradient=1e-6",
    "horizon=40",
    "coarse=1",
    "coarse_steps=5",
    "photo_points=off",
];

#[test]
fn same_bits_with_1_2_and_4_threads_and_after_a_resume() {
    let scene = table(24);
    // Two steps of the field, and the first change of the cloud after four of its own.
    let set = SMALL.map(|set| if set.starts_with("field_steps") { "field_steps=2" } else { set });
    assert_same_bits(|steps, state| {
        let (train, _) = views(&scene, 1);
        state_after(system("splat", &scene, &train, &set).0, &train, steps, state)
    });
}

#[test]
fn a_checkpoint_of_any_stage_goes_on_to_the_same_end() {
    let scene = table(24);
    let run = |steps: Range<u64>, state: Option<&TensorMap>| {
        let (train, _) = views(&scene, 1);
        state_after(system("splat", &scene, &train, &SMALL).0, &train, steps, state)
    };
    let whole = run(0..24, None);
    // In the field, right before and after the seeds, between refills, after the last.
    for at in [2, 6, 7, 12, 20] {
        assert!(run(at..24, Some(&run(0..at, None))) == whole, "resumed at {at}");
    }
    let has_field = |state: &TensorMap| state.contains_key("field.density");
    assert!(has_field(&run(0..12, None)) && !has_field(&whole), "the field goes when nothing is asked of it any more");
}

#[test]
fn the_field_finds_what_random_places_do_not() {
    let scene = table(48);
    let (train, test) = views(&scene, 1);
    let trained = |set: &[&str], steps: u64| {
        let mut system = system("splat", &scene, &train, set).0;
        (0..steps).for_each(|step| assert!(system.step(&train, step).expect("a step").loss.is_finite()));
        system
    };
    let common = ["start_count=2000", "max_splats=2000", "horizon=150", "coarse=0"];
    // A hundred steps bring colours and no new places. After them the cloud is shown instead of the field.
    let random = psnr(&*trained(&[&common[..], &["start=\"random\""]].concat(), 100), &test);
    let field = trained(&[&common[..], &["start=\"field\"", "field_steps=150", "refill=0.0"]].concat(), 250);
    let seeds = field.splats(&plain_query([0.0; 3], 0.0)).map_or(0, |s| s.gaussians.len());
    let with_field = psnr(&*field, &test);
    println!("random {random:.2} dB, field {with_field:.2} dB with {seeds} Gaussians");
    assert!(seeds == 2000 && with_field > random + 0.2, "{with_field} {random} {seeds}");
    assert!(!state_of(&*field).contains_key("field.density"));
}

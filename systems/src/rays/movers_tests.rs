//! A part of the field for what moves: it is found, it is for what moves alone, and nothing of it is there where nothing moves.

use super::budget_tests::{query, random_rays, randomised, small};
use super::gradient_tests::{known, planes, with_moving_part, with_scene_flow};
use super::moving_tests::{TIME_STEPS, filmed, stage_in, views};
use super::residuals::Compared;
use super::scene_flow::Film;
use super::{MovingConfig, MovingSettings, RayConfig, RaySystem};
use crate::fields::MovingCells;
use crate::papers::dynamic::nsff;
use crate::space::{Space, SpaceKind};
use crate::warps::made::MadeSettings;
use crate::warps::{Motion, TimeKind, Times, WarpSettings};
use engine::data::{Batch, Dataset};
use engine::options::Background;
use engine::system::{Query, System, TensorMap};
use glam::DVec3;
use image::{GrayImage, Luma};
use tempfile::TempDir;

/// A small field with a part for what moves in the second half of the schedule.
fn config() -> RayConfig {
    let mut config = small(SpaceKind::Box);
    let settings = MovingSettings { moving_from: 0.5, moving_share: 1e-3, moving_entropy: 1e-3 };
    config.moving = Some(MovingConfig::new(config.features.clone(), settings));
    (config.batch.batch_rays, config.batch.batch_samples) = (1024, 1 << 14);
    config
}

/// A system that looks for what moves after `from` steps.
fn watching(from: u64, data: &Dataset) -> RaySystem {
    watching_by(config(), from, data)
}

fn watching_by(config: RayConfig, from: u64, data: &Dataset) -> RaySystem {
    let made = MadeSettings::of_time(TimeKind::Time, 3, 1);
    let warp = WarpSettings { motion: Motion::Translation, octaves: 2, ..made.warp.clone() };
    let deform = MadeSettings { warp, ..made }.deform(Times::of(data), 1);
    let space = Space::boxed(DVec3::new(0.0, 0.0, 0.3), 1.2, 0.05);
    let mut driver = RaySystem::new(config, space, Background::White, 1, "d-nerf", None, Some(deform)).unwrap();
    driver.follow_schedule(2 * from);
    driver.watch(data);
    driver
}

fn state(driver: &RaySystem) -> TensorMap {
    driver.state().into_iter().map(|t| (t.name.clone(), t.into_owned())).collect()
}

/// The film of [`filmed`] with a file of a motion mask for each view that has one. Of flow and disparity there is no more than a name:
/// who reads them fails.
fn masked(mask: impl Fn(usize) -> Option<GrayImage>) -> (TempDir, Dataset) {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = stage_in(32, TIME_STEPS);
    for (view, frame) in scene.frames.iter_mut().enumerate() {
        let motion = &mut frame.priors.motion;
        motion.forward = Some(folder.path().join("nowhere.flo"));
        motion.disparity = Some(folder.path().join("nowhere.npy"));
        motion.mask = mask(view).map(|mask| {
            let path = folder.path().join(format!("moves_{view}.png"));
            mask.save(&path).unwrap();
            path
        });
    }
    let data = views(&scene);
    (folder, data)
}

/// A mask of which a column is as grey as that.
fn grey(of_column: impl Fn(u32) -> u8) -> GrayImage {
    GrayImage::from_fn(32, 32, |x, _| Luma([of_column(x)]))
}

#[test]
fn what_moves_is_found_and_the_rest_stands_still() {
    let data = filmed(32);
    let mut driver = watching(120, &data);
    for step in 0..121 {
        driver.step(&data, step).unwrap();
        assert_eq!(driver.field.moving.is_some(), step >= 120, "step {step}");
    }
    let found = driver.movers.as_ref().unwrap().found.unwrap();
    println!("{found:?}");
    assert!((0.01..0.6).contains(&found.tiles), "{found:?}");
    assert!((0.001..0.5).contains(&found.cells), "{found:?}");
    for step in 121..160 {
        let stats = driver.step(&data, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "step {step}: {stats:?}");
    }
    // Far from all that moves points stay where they are.
    let corner = [[-1.1, -1.1, -0.8]];
    let mut there = [[0.0; 3]];
    driver.canonical(&corner, 0.7, &mut there);
    assert_eq!(there, corner);
}

#[test]
fn where_no_cell_moves_the_picture_is_that_of_the_still_part_bit_for_bit() {
    let still = small(SpaceKind::Box);
    let mut moving = randomised(with_moving_part(still.clone(), still.features.clone()), 4);
    let still = randomised(still, 4);
    let (rays, query) = (random_rays(3), query([1.0; 3], 0.0));
    assert_ne!(moving.render(&rays, &query).rgb, still.render(&rays, &query).rgb, "it moves everywhere");
    moving.field.moving.as_mut().unwrap().cells = MovingCells::none();
    assert_eq!(moving.render(&rays, &query).rgb, still.render(&rays, &query).rgb);
}

#[test]
fn masks_say_what_moves_where_all_photos_have_one_and_the_still_part_learns_from_the_rest() {
    let data = filmed(32);
    let mut config = config();
    let flow = with_scene_flow(&data, nsff::flow, true).moving.unwrap().flow.unwrap();
    config.moving = config.moving.map(|moving| moving.with_flow(flow));
    let mut driver = watching_by(config, 60, &data);
    driver.set_film(Film::with(&data, known(&data)));
    driver.draw(&data, 0, 1).unwrap();
    let batch = &driver.work.inputs.batch;
    let counted: Vec<u16> = (0..batch.len()).filter(|&i| batch.weight[i] > 0.0).map(|i| batch.pixel[i][0]).collect();
    assert!(counted.len() > 50 && counted.iter().all(|&x| x >= 16), "{counted:?}");
    driver.begin_movers(&data, 60).unwrap();
    let found = driver.movers.as_ref().unwrap().found.unwrap();
    assert!((0.45..0.55).contains(&found.tiles) && driver.field.moving.is_some(), "{found:?}");
    // With a deformation, too, scene flow is learnt.
    for step in 60..66 {
        let stats = driver.step(&data, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "step {step}: {stats:?}");
    }
}

/// What the photos of a driver show in their left fifth is by far not what its field shows there.
fn errs_at_the_left(driver: &mut RaySystem, data: &Dataset) {
    let residuals = driver.movers.as_mut().unwrap().residuals.as_mut().unwrap();
    for step in 0..20 {
        let mut batch = Batch::default();
        data.draw_among(5, step, 1 << 12, None, &mut batch).unwrap();
        let off = |[x, _]: &[u16; 2]| if *x < 7 { 0.6 } else { 0.1 };
        let compared = batch.pixel.iter().map(|at| Compared { shown: [off(at); 3], truth: [0.1; 3] });
        residuals.learn(1000 + step, &batch, compared);
    }
}

#[test]
fn a_moving_part_begins_as_the_picture_is() {
    let data = filmed(32);
    // Features of the same shape take over the numbers of the still part, others begin on top of it.
    let mut on_top = config();
    on_top.moving.as_mut().unwrap().features = planes(&data, "hybrid").features;
    for config in [config(), on_top] {
        let mut driver = watching_by(config, 60, &data);
        for step in 0..60 {
            driver.step(&data, step).unwrap();
        }
        errs_at_the_left(&mut driver, &data);
        let rays: Vec<_> = data.view(3).rays(0..16).flatten().collect();
        let before = driver.render(&rays, &query([1.0; 3], 0.0)).rgb;
        driver.begin_movers(&data, 60).unwrap();
        assert!(driver.field.moving.is_some());
        let after = driver.render(&rays, &query([1.0; 3], 0.0)).rgb;
        let pairs = before.as_flattened().iter().zip(after.as_flattened());
        let off = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < 2e-2, "the picture changes by {off}");
    }
}

/// A system that looks for what moves after 40, 80 and 120 steps, and gives back what is idle after 160 and 200.
fn reviewing(data: &Dataset) -> RaySystem {
    let mut config = config();
    config.moving.as_mut().unwrap().settings.moving_from = 0.1;
    // Enough pixels of each tile by the first look: as many as two views have, in a step.
    let rays = 2 * data.pixel_count() as usize / data.len();
    (config.batch.batch_rays, config.batch.batch_samples) = (rays, 16 * rays);
    watching_by(config, 200, data)
}

#[test]
fn cells_of_which_nothing_came_are_given_back_and_next_to_nothing_of_the_picture_with_them() {
    let data = filmed(32);
    let mut driver = reviewing(&data);
    for step in 0..160 {
        driver.step(&data, step).unwrap();
    }
    let pictures = |driver: &RaySystem| -> Vec<f32> {
        let of = |view: usize| {
            let rays: Vec<_> = data.view(view).rays(0..32).flatten().collect();
            let query = Query { time: data.view(view).time, ..query([1.0; 3], 0.0) };
            driver.render(&rays, &query).rgb.into_flattened()
        };
        [1, 8, 15].into_iter().flat_map(of).collect()
    };
    let (before, cells) = (pictures(&driver), driver.field.moving.as_ref().unwrap().cells.clone());
    driver.give_back_idle(0.4);
    let part = driver.field.moving.as_ref().expect("the things of orbit do move");
    let share = part.cells.count() as f64 / cells.count() as f64;
    assert!((0.01..0.9).contains(&share) && part.reviews == 1, "{share} of the cells are kept");
    assert_eq!(part.cells.and(&cells), part.cells, "none are new");
    let off = before.iter().zip(pictures(&driver)).map(|(a, b)| f64::from((a - b).powi(2))).sum::<f64>();
    let off = (off / before.len() as f64).sqrt();
    println!("{share} of the cells are kept, the picture changes by {off}");
    assert!(off < 0.01, "the picture changes by {off}");
    // Not before the next time.
    driver.give_back_idle(0.45);
    assert_eq!(driver.field.moving.as_ref().unwrap().reviews, 1);
}

#[test]
fn a_resumed_run_gives_back_the_same_cells() {
    let data = filmed(16);
    let mut whole = reviewing(&data);
    let (mut saved, mut cells) = (Vec::new(), Vec::new());
    for step in 0..205 {
        // Before the third look, between it and the first review, between the reviews.
        if [115, 150, 190].contains(&step) {
            saved.push((step, state(&whole)));
        }
        whole.step(&data, step).unwrap();
        cells.push(whole.field.moving.as_ref().map(|part| part.cells.count()));
    }
    assert!(cells.iter().any(|cells| cells.is_some_and(|count| count > 0)), "nothing moves: {cells:?}");
    assert!(cells[150] > cells[170], "some are given back: {cells:?}");
    for (from, tensors) in saved {
        let mut resumed = reviewing(&data);
        resumed.load_state(&tensors).unwrap();
        for step in from..205 {
            resumed.step(&data, step).unwrap();
        }
        assert!(state(&resumed) == state(&whole), "resumed at step {from}");
    }
}

#[test]
fn a_part_of_which_nothing_came_is_left_out_in_the_end() {
    let data = filmed(16);
    let mut driver = reviewing(&data);
    for step in 0..125 {
        driver.step(&data, step).unwrap();
    }
    driver.move_everywhere();
    // None of its cells is left.
    let part = driver.field.moving.as_mut().unwrap();
    part.reviews = 1;
    part.cells = MovingCells::none();
    driver.give_back_idle(0.51);
    assert!(driver.field.moving.is_none() && !driver.is_looking());
    assert!(driver.movers.as_mut().unwrap().news().unwrap().contains("nothing moves"));
    for step in 125..130 {
        assert_eq!(driver.step(&data, step).unwrap().nonfinite, 0);
    }
}

#[test]
fn a_resumed_run_looks_for_what_moves_as_if_it_had_not_stopped() {
    let data = filmed(16);
    let mut whole = watching(20, &data);
    let mut saved = Vec::new();
    for step in 0..26 {
        if [7, 15, 20, 23].contains(&step) {
            saved.push((step, state(&whole)));
        }
        whole.step(&data, step).unwrap();
    }
    for (from, tensors) in saved {
        let mut resumed = watching(20, &data);
        resumed.load_state(&tensors).unwrap();
        for step in from..26 {
            resumed.step(&data, step).unwrap();
        }
        assert!(state(&resumed) == state(&whole), "resumed at step {from}");
    }
}

#[test]
fn masks_alone_say_what_moves_and_where_without_scene_flow() {
    // The left quarter of the first photo, and nothing in all others.
    let (_folder, data) = masked(|view| Some(grey(|x| if view == 0 && x < 8 { 255 } else { 0 })));
    let mut driver = watching(60, &data);
    assert_eq!(driver.follow_film(&data).unwrap(), ["movers: as the motion masks of all photos say"]);
    driver.rays = 1024;
    driver.draw(&data, 0, 1).unwrap();
    let batch = &driver.work.inputs.batch;
    let moves = |i: usize| batch.view[i] == 0 && batch.pixel[i][0] < 8;
    assert!((0..batch.len()).any(moves), "no pixel that moves is drawn");
    assert!((0..batch.len()).all(|i| (batch.weight[i] == 0.0) == moves(i)), "others are left out");
    driver.begin_movers(&data, 60).unwrap();
    let found = driver.movers.as_ref().unwrap().found.unwrap();
    assert!((found.tiles - 16.0 / (64.0 * 20.0)).abs() < 1e-9, "{found:?}");
    driver.draw(&data, 60, 1).unwrap();
    assert!(driver.work.inputs.batch.weight.iter().all(|w| *w > 0.0), "what moves counts once it has a part");

    // Seen by that view, as the masks of the others take nothing away, and for two cells around.
    let (camera, map) = (data.view(0).camera.prepare(), driver.space.map());
    let cells = &driver.field.moving.as_ref().unwrap().cells;
    let mut blocks = [0; 2];
    for block in (0..MovingCells::BLOCKS).step_by(17) {
        let (u, mut x) = (MovingCells::middle_of_block(block), [0.0; 3]);
        map.world(&u, &mut x);
        let pixel = camera.project(DVec3::from(x.map(f64::from))).unwrap();
        if (0.0..8.0).contains(&pixel.x) && (0.0..32.0).contains(&pixel.y) {
            assert!(cells.holds(u), "nothing moves at {pixel}");
            blocks[0] += 1;
        } else if pixel.x > 12.0 {
            assert!(!cells.holds(u), "something moves at {pixel}");
            blocks[1] += 1;
        }
    }
    assert!(blocks.iter().all(|n| *n > 100), "{blocks:?}");
    for step in 60..66 {
        let stats = driver.step(&data, step).unwrap();
        assert!(stats.loss.is_finite() && stats.nonfinite == 0, "step {step}: {stats:?}");
    }
    assert!(driver.movers.as_mut().unwrap().news().unwrap().contains("something moves"));
}

#[test]
fn where_a_photo_has_no_mask_all_is_as_without_masks() {
    let after = |mask: &dyn Fn(usize) -> Option<GrayImage>, said: &[&str]| {
        let (_folder, data) = masked(mask);
        let mut driver = watching(20, &data);
        assert_eq!(driver.follow_film(&data).unwrap(), said);
        for step in 0..24 {
            driver.step(&data, step).unwrap();
        }
        state(&driver)
    };
    let without = after(&|_| None, &[]);
    let said =
        "movers: 19 of 20 photos have a motion mask, so they are found by what a still field leaves of the photos";
    let with = after(&|view| (view != 7).then(|| grey(|_| 255)), &[said]);
    assert!(with == without && without.contains_key("residuals.looks"));
}

#[test]
fn where_masks_say_that_nothing_moves_the_moving_part_is_left_out() {
    let (_folder, data) = masked(|_| Some(grey(|_| 0)));
    let mut driver = watching(6, &data);
    assert_eq!(driver.follow_film(&data).unwrap(), ["movers: none, as the motion masks of all photos say"]);
    for step in 0..10 {
        assert_eq!(driver.is_looking(), step <= 6, "step {step}");
        assert_eq!(driver.step(&data, step).unwrap().nonfinite, 0);
    }
    assert!(driver.field.moving.is_none());
    assert!(driver.movers.as_mut().unwrap().news().unwrap().contains("nothing moves"));
}

#[test]
fn a_mask_of_another_shape_than_its_photo_is_refused_by_file() {
    let (_folder, data) = masked(|view| Some(if view == 3 { GrayImage::new(32, 16) } else { grey(|_| 0) }));
    let error = watching(6, &data).follow_film(&data).unwrap_err().to_string();
    for said in ["moves_3.png", "the motion mask is 32x16 and its photo 32x32"] {
        assert!(error.contains(said), "{error}");
    }
}

#[test]
fn a_resumed_run_reads_its_masks_again() {
    let (_folder, data) = masked(|_| Some(grey(|x| if x < 12 { 255 } else { 0 })));
    let begun = || {
        let mut driver = watching(20, &data);
        driver.follow_film(&data).unwrap();
        driver
    };
    let (mut whole, mut saved) = (begun(), Vec::new());
    for step in 0..26 {
        // Before what moves has a part, right before that, and after.
        if [7, 20, 23].contains(&step) {
            saved.push((step, state(&whole)));
        }
        whole.step(&data, step).unwrap();
    }
    assert!(whole.field.moving.is_some());
    for (from, tensors) in saved {
        let mut resumed = begun();
        resumed.load_state(&tensors).unwrap();
        for step in from..26 {
            resumed.step(&data, step).unwrap();
        }
        assert!(state(&resumed) == state(&whole), "resumed at step {from}");
    }
}

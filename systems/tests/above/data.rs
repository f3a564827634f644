//! Batches: which pixels they hold, and that they are the same whoever computes them.

use crate::common::{sky_scene, train_split};
use systems::data::{Batch, Dataset};

const ROOM: u64 = 1 << 30;

fn draw(data: &Dataset, seed: u64, step: u64, n: usize) -> Batch {
    let mut batch = Batch::default();
    data.draw(seed, step, n, &mut batch).unwrap();
    batch
}

fn places(batch: &Batch) -> Vec<(u32, [u16; 2])> {
    batch.view.iter().copied().zip(batch.pixel.iter().copied()).collect()
}

#[test]
fn a_drawn_pixel_is_the_image_s_pixel_and_its_camera_s_ray() {
    let scene = sky_scene(8, 24, false);
    for budget in [ROOM, 3 * 24 * 24 * 2] {
        let data = train_split(&scene, budget);
        let batch = draw(&data, 1, 5, 3000);
        for i in 0..batch.len() {
            let view = data.view(batch.view[i] as usize);
            let [x, y] = batch.pixel[i].map(u32::from);
            let image = data.image(batch.view[i] as usize).unwrap();
            let want = image.pixel(x, y).iter().map(|&c| f32::from(c) / 255.0).collect::<Vec<_>>();
            assert_eq!(batch.rgb[i].as_slice(), want);
            let ray = scene.frames[view.frame].camera.ray(glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).unwrap();
            assert!((batch.rays[i].d - ray.d).length() < 1e-12 && batch.rays[i].o == ray.o);
            assert_eq!((batch.alpha[i], batch.weight[i]), (1.0, 1.0));
        }
    }
}

#[test]
fn draws_are_uniform_over_all_pixels_of_all_views() {
    let data = train_split(&sky_scene(4, 10, false), ROOM);
    let batch = draw(&data, 3, 0, 60_000);
    let mut counts = vec![0_u32; 3 * 100];
    for (v, [x, y]) in places(&batch) {
        counts[v as usize * 100 + usize::from(y) * 10 + usize::from(x)] += 1;
    }
    // Chi squared with 299 degrees of freedom: mean 299, standard deviation 24.5.
    let chi2: f64 = counts.iter().map(|&c| (f64::from(c) - 200.0).powi(2) / 200.0).sum();
    assert!((299.0 - 5.0 * 24.5..299.0 + 5.0 * 24.5).contains(&chi2), "chi squared {chi2}");
}

#[test]
fn a_batch_is_a_function_of_seed_and_step_for_any_threads() {
    for budget in [ROOM, 3 * 16 * 16 * 2] {
        let scene = sky_scene(9, 16, false);
        let run = |threads: usize, seed, step| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| draw(&train_split(&scene, budget), seed, step, 5000))
        };
        let one = run(1, 7, 100);
        for threads in [2, 4] {
            let many = run(threads, 7, 100);
            assert_eq!(places(&one), places(&many));
            assert_eq!(one.rays, many.rays);
        }
        assert_ne!(places(&one), places(&run(1, 8, 100)), "the seed matters");
        assert_ne!(places(&one), places(&run(1, 7, 101)), "the step matters");
    }
}

#[test]
fn a_window_that_does_not_hold_all_views_moves_over_all_of_them() {
    let scene = sky_scene(12, 8, false);
    let data = train_split(&scene, 8 * 8 * 3 * 2);
    let mut batch = Batch::default();
    let mut seen = vec![0; data.len()];
    for step in 0..16 * 9 {
        data.draw(0, step, 64, &mut batch).unwrap();
        let mut views: Vec<u32> = batch.view.clone();
        views.sort_unstable();
        views.dedup();
        assert!(views.len() <= 2, "two views fit, {} were used", views.len());
        views.iter().for_each(|&v| seen[v as usize] += 1);
    }
    assert!(seen.iter().all(|&n| n > 0), "{seen:?}");

    // A batch carried from step to step is the one a fresh process draws.
    let fresh = draw(&data, 0, 16 * 9 - 1, 64);
    assert_eq!(places(&fresh), places(&batch));
}

#[test]
fn ignored_pixels_are_drawn_only_with_weight_zero_and_hardly_ever() {
    let data = train_split(&sky_scene(8, 16, true), ROOM);
    let batch = draw(&data, 0, 0, 4000);
    let mut ignored = 0;
    for i in 0..batch.len() {
        let left = batch.pixel[i][0] < 8;
        assert_eq!(batch.weight[i], if left { 0.0 } else { 1.0 });
        ignored += u32::from(left);
    }
    // Eight draws each fall on the ignored half with probability 1/2: 4000 / 256 = 16 expected.
    assert!(ignored < 50, "{ignored} of 4000 rays wasted");
}

#[test]
fn an_empty_dataset_gives_an_empty_batch() {
    let mut scene = sky_scene(4, 8, false);
    scene.frames.clear();
    let data = train_split(&scene, ROOM);
    assert!(data.is_empty() && draw(&data, 0, 0, 100).is_empty());
    let full = train_split(&sky_scene(4, 8, false), ROOM);
    assert!(draw(&full, 0, 0, 0).is_empty());
}

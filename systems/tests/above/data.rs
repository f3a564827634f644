//! Batches: which pixels they hold, and that they are the same whoever computes them.

use crate::common::{sky_scene, train_split};
use engine::data::{Batch, Dataset, DrawnFrom};
use render_core::camera::Camera;
use scene_io::{ImageStore, Split, StoreOptions};
use std::sync::Arc;

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
fn the_middle_of_photos_is_drawn_from_evenly_and_nothing_else() {
    let scene = sky_scene(8, 24, false);
    // In memory, and from a window of views.
    for budget in [ROOM, 3 * 24 * 24 * 2] {
        let data = train_split(&scene, budget);
        let views = [0, 2];
        for from in [Some(&views[..]), None].map(|views| DrawnFrom { views, middle: Some(0.5) }) {
            let mut batch = Batch::default();
            data.draw_from(1, 5, 8000, from, &mut batch).unwrap();
            let mut counts = [[0_u32; 24]; 24];
            for (_, [x, y]) in places(&batch) {
                counts[usize::from(y)][usize::from(x)] += 1;
            }
            for (i, count) in counts.iter().flatten().enumerate() {
                let inside = |at: usize| (6..18).contains(&at);
                let drawn = inside(i % 24) && inside(i / 24);
                // 8000 draws over 144 pixels: 55 each.
                assert!(if drawn { (15..120).contains(count) } else { *count == 0 }, "pixel {i}: {count}");
            }
            if budget == ROOM && from.views.is_some() {
                assert!(batch.view.iter().all(|view| views.contains(view)));
            }
        }
    }
    let tiny = DrawnFrom { views: None, middle: Some(0.0) };
    let mut batch = Batch::default();
    train_split(&scene, ROOM).draw_from(1, 5, 100, tiny, &mut batch).unwrap();
    assert!(places(&batch).iter().all(|(_, pixel)| *pixel == [11, 11]), "one pixel at least");
    let mut all = Batch::default();
    train_split(&scene, ROOM).draw_from(1, 5, 100, DrawnFrom::ALL, &mut all).unwrap();
    assert_eq!(places(&all), places(&draw(&train_split(&scene, ROOM), 1, 5, 100)));
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

#[test]
fn smaller_scales_hold_the_means_of_the_pixels_and_weigh_as_much_as_their_area() {
    let scene = sky_scene(4, 20, false);
    let frames: Vec<usize> = scene.split(Split::Train).collect();
    for budget in [ROOM, 20 * 20 * 3 * 2] {
        let store =
            Arc::new(ImageStore::new(&scene.frames, StoreOptions::default().with_budget_bytes(budget)).unwrap());
        let data = Dataset::with_levels(&scene, store, frames.clone(), 0..4).unwrap();
        assert_eq!(data.len(), 12);
        // 20, 10, 5, and 2: a fifth pixel is shared.
        assert_eq!(data.pixel_count(), 3 * (400 + 100 + 25 + 4));
        for v in 0..data.len() {
            let view = data.view(v);
            assert_eq!(view.level as usize, v / 3);
            let image = data.image(v).unwrap();
            assert_eq!((image.width, image.height), (view.camera.width, view.camera.height));
            let fine = data.image(v % 3).unwrap();
            if (1..3).contains(&view.level) {
                let side = 1 << view.level;
                for (x, y) in [(0, 0), (3, 1), (4, 4)] {
                    let mut sum = 0;
                    for (u, w) in (0..side * side).map(|k| (side * x + k % side, side * y + k / side)) {
                        sum += u32::from(fine.pixel(u, w)[0]);
                    }
                    let mean = f64::from(sum) / f64::from(side * side);
                    assert!((f64::from(image.pixel(x, y)[0]) - mean).abs() <= 0.5, "{mean} at {x} {y}");
                }
            }
            // The same field of view.
            let full = &data.view(v % 3).camera;
            let corner = |c: &Camera| c.ray(glam::DVec2::new(f64::from(c.width), 0.0)).unwrap().d;
            assert!((corner(full) - corner(&view.camera)).length() < 1e-12);
        }
        let batch = draw(&data, 1, 5, 20_000);
        let mut drawn = [0.0; 4];
        for i in 0..batch.len() {
            let view = data.view(batch.view[i] as usize);
            assert_eq!(batch.weight[i], [1.0, 4.0, 16.0, 64.0][view.level as usize]);
            drawn[view.level as usize] += batch.weight[i] / 20_000.0;
        }
        if budget == ROOM {
            // Each level counts as much as its area: all the same, but for the pixels lost at the edge.
            for (level, pixels) in [400.0_f32, 100.0, 25.0, 4.0].into_iter().enumerate() {
                let want = pixels / 529.0 * 4.0_f32.powi(level as i32);
                assert!((drawn[level] / want - 1.0).abs() < 0.3, "{drawn:?}");
            }
        }
        let half = data.at_level(1);
        assert_eq!((half.len(), half.view(0).camera.width, half.view(0).level), (3, 10, 1));
        assert_eq!(half.image(2).unwrap().data, data.image(5).unwrap().data);
    }
}

#[test]
fn cone_radii_are_those_of_the_prepared_camera() {
    let scene = sky_scene(4, 12, false);
    let data = train_split(&scene, ROOM);
    let view = data.view(1);
    for (x, y) in [(0, 0), (5, 7), (11, 11)] {
        let at = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let want = view.camera.prepare().cone_radius(at).unwrap();
        assert!((view.cone_radius(x, y).unwrap() - want).abs() < 1e-12 * want);
    }
    // Half as many pixels: twice the radius at the same place of the image plane, but for the place inside the pixel.
    let half = data.at_level(1);
    let ratio = half.view(1).cone_radius(3, 3).unwrap() / view.cone_radius(6, 6).unwrap();
    assert!((ratio - 2.0).abs() < 0.1, "{ratio}");
}

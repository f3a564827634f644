//! Photos with an appearance of their own and occluders in them: how views are rendered and scored, and masks. Driven by a system
//! that knows the sky and has one code, three offsets of colour, for each photo.

mod sky;

use crate::common::Watch;
use engine::RunError;
use engine::appearance::{AppearancePath, FrameAppearances};
use engine::camera_path::{PathKind, cameras};

use engine::eval::masks::{MaskOptions, MaskTable};
use engine::eval::{EvalAppearance, Protocol, Scored};

use engine::options::Request;

use engine::run::Run;
use engine::system::Appearance;

use image::RgbImage;
use render_core::camera::Camera;

use scene_io::{Image, ImageSource, Scene, Split};
use sky::{HEIGHT, WIDTH, offset, paint, photo, request, scene, scores, trained, with_parts};
use std::fs;
use std::path::Path;
use std::sync::Arc;

#[test]
fn an_appearance_fitted_on_the_left_half_explains_the_right_half() {
    let e = scores(&scene(WIDTH), "many", None);
    assert_eq!((&e.protocol.appearance, e.protocol.scored), (&Some(EvalAppearance::Fit), Scored::RightHalf));
    assert!(e.psnr.unwrap() > 45.0, "nothing but rounding is left: {:?}", e.psnr);
    let mean = scores(&scene(WIDTH), "many", Some("mean"));
    assert!(mean.psnr.unwrap() < 30.0, "{:?}", mean.psnr);
    assert_eq!(mean.protocol.scored, Scored::Whole);
    assert!(e.table().contains("protocol: appearance fitted on the left half"), "{}", e.table());
}

#[test]
fn pixels_of_the_right_half_cannot_reach_the_appearance() {
    let render = |scene: &Scene| {
        let folder = tempfile::tempdir().unwrap();
        let psnr = trained(folder.path(), scene, &request("many", None), |_, e| e.views[0].psnr).unwrap();
        (fs::read(folder.path().join("renders/000_photos_p2.png")).unwrap(), psnr)
    };
    let (plain, psnr) = render(&scene(WIDTH));
    // 15 columns: the left half ends before column 7.
    let mut painted = scene(WIDTH);
    paint(&mut painted, 2, 7..WIDTH, [9, 200, 30]);
    let (same, worse) = render(&painted);
    assert!(plain == same, "the same bits");
    assert!(worse.unwrap() < psnr.unwrap() - 10.0, "and the right half is what is scored: {worse:?} {psnr:?}");
    let mut painted = scene(WIDTH);
    paint(&mut painted, 2, 6..7, [9, 200, 30]);
    assert!(plain != render(&painted).0, "the last column of the left half is seen");
}

#[test]
fn a_view_scores_the_same_in_whatever_company() {
    let both = scores(&scene(WIDTH), "many", None);
    let mut alone = scene(WIDTH);
    alone.frames[2].split = Split::Unused;
    let alone = scores(&alone, "many", None);
    assert_eq!(both.views[1].name, alone.views[0].name);
    assert_eq!((both.views[1].psnr, both.views[1].ssim), (alone.views[0].psnr, alone.views[0].ssim));
}

#[test]
fn systems_with_one_appearance_score_right_halves_where_that_is_asked_for() {
    let plain = scores(&scene(WIDTH), "one", None);
    assert_eq!(plain.protocol, Protocol::default());
    assert!(!plain.table().contains("protocol"));
    let half = scores(&scene(WIDTH), "one", Some("fit"));
    assert_eq!((half.protocol.scored, half.protocol.fit_steps), (Scored::RightHalf, None));
    let mut painted = scene(WIDTH);
    paint(&mut painted, 2, 0..7, [0, 0, 0]);
    assert_eq!(scores(&painted, "one", Some("fit")).psnr, half.psnr, "the left half does not count");
    assert_ne!(scores(&painted, "one", None).psnr, plain.psnr);
}

#[test]
fn views_of_one_column_have_no_halves() {
    let folder = tempfile::tempdir().unwrap();
    let mut narrow = scene(WIDTH);
    let pose = narrow.frames[5].camera.pose;
    let camera = Camera::pinhole(1, 4, 14.0, 14.0, 0.5, 2.0, pose);
    narrow.frames[5].image = ImageSource::Memory(Arc::new(photo(&camera, [0.0; 3])));
    narrow.frames[5].camera = camera;
    let error = trained(folder.path(), &narrow, &request("many", None), |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("photos/p5.png") && error.contains("1 pixel wide"), "{error}");
    assert!(!folder.path().join("checkpoint").exists(), "found before training");
    trained(folder.path(), &narrow, &request("many", Some("mean")), |_, _| ()).unwrap();
    // Two columns have two halves.
    assert!(scores(&scene(2), "many", None).psnr.unwrap() > 40.0);
}

#[test]
fn appearances_of_photos_and_encoders_are_taken_at_their_word() {
    // Frame 5 has the appearance of no training photo; frame 2 nearly that of frame 0 in the first channel alone.
    let of = |word: &str| scores(&scene(WIDTH), "many", Some(word));
    let image = of("image:p4");
    assert_eq!(image.protocol.appearance, Some(EvalAppearance::Image("p4".into())));
    assert_ne!(image.psnr, of("image:p0").psnr);
    assert_eq!(image.psnr, of("image:photos/p4.png").psnr);
    let (left, whole) = (of("encode:left"), of("encode:whole"));
    assert_eq!((left.protocol.scored, whole.protocol.scored), (Scored::RightHalf, Scored::RightHalf));
    let painted = |word: &str| {
        let mut painted = scene(WIDTH);
        paint(&mut painted, 2, 7..WIDTH, [255, 255, 255]);
        let folder = tempfile::tempdir().unwrap();
        trained(folder.path(), &painted, &request("many", Some(word)), |_, _| ()).unwrap();
        let bits = |folder: &Path| fs::read(folder.join("renders/000_photos_p2.png")).unwrap();
        let plain = tempfile::tempdir().unwrap();
        trained(plain.path(), &scene(WIDTH), &request("many", Some(word)), |_, _| ()).unwrap();
        bits(folder.path()) == bits(plain.path())
    };
    assert!(painted("encode:left"), "the encoder saw the left half alone");
    assert!(!painted("encode:whole"), "the scored half leaks");
}

#[test]
fn appearances_that_a_system_has_not_are_refused_before_training() {
    for (system, word, part) in [
        ("one", "image:p4", "one appearance only"),
        ("one", "encode:left", "no encoder"),
        ("one", "nearest", "one appearance only"),
        ("many", "nearest", "the photos have no times"),
        ("many", "image:p9", "no such photo"),
        ("many", "image:p2", "no such photo"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let error = trained(folder.path(), &scene(WIDTH), &request(system, Some(word)), |_, _| ()).unwrap_err();
        assert!(error.to_string().contains(part), "{system} {word}: {error}");
        assert!(!folder.path().join("checkpoint").exists());
    }
}

#[test]
fn the_protocol_is_written_down_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    trained(folder.path(), &scene(WIDTH), &request("many", Some("image:p0")), |_, _| ()).unwrap();
    let config = fs::read_to_string(folder.path().join("config.toml")).unwrap();
    assert!(config.contains(r#"eval_appearance = "image:p0""#), "{config}");
    let eval = || -> serde_json::Value {
        serde_json::from_slice(&fs::read(folder.path().join("eval.json")).unwrap()).unwrap()
    };
    let first = eval();
    assert_eq!(first["protocol"], serde_json::json!({ "appearance": "image:p0", "scored": "whole" }));
    with_parts(&scene(WIDTH), |parts| {
        let mut run = Run::open(folder.path(), &Request::default(), parts, &mut Watch::default()).unwrap();
        run.evaluate(None, &mut Watch::default()).unwrap();
        assert_eq!(eval()["psnr"], first["psnr"]);
        run.measure_in(Some(EvalAppearance::Fit));
        run.evaluate(None, &mut Watch::default()).unwrap();
        assert_eq!(eval()["protocol"]["scored"], "right-half");
        assert_eq!(eval()["protocol"]["fit_steps"], 300);
        run.measure_in(None);
        run.evaluate(None, &mut Watch::default()).unwrap();
        assert_eq!(eval()["protocol"], first["protocol"]);
        let request = request("many", Some("fit"));
        let error = Run::open(folder.path(), &request, parts, &mut Watch::default()).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("`--eval-appearance image:p0`"), "{error}");
    });
}

#[test]
fn a_view_without_a_used_pixel_on_its_left_is_noted_and_rendered_in_the_mean_appearance() {
    let mut masked = scene(WIDTH);
    let ImageSource::Memory(image) = &masked.frames[2].image else { panic!("in memory") };
    let mut image = Image::clone(image);
    image.mask = Some((0..WIDTH * HEIGHT).map(|k| if k % WIDTH < 7 { 0 } else { 255 }).collect());
    masked.frames[2].image = ImageSource::Memory(Arc::new(image));
    let e = scores(&masked, "many", None);
    assert!(e.notes.iter().any(|n| n.starts_with("photos/p2.png: no pixel of its left half")), "{:?}", e.notes);
    assert!(e.views[0].psnr.unwrap() < 30.0 && e.views[1].psnr.unwrap() > 45.0);
}

#[test]
fn masks_are_written_scored_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(WIDTH);
    trained(folder.path(), &scene, &request("many", None), |run, _| {
        let out = folder.path().join("elsewhere");
        let options = MaskOptions { every: 1, empty: Default::default() };
        let table = run.write_masks(&out, options, &mut Watch::default()).unwrap();
        assert_eq!(MaskTable::read(&out).unwrap().unwrap(), table);
        assert_eq!((table.views.len(), table.training_views, table.with_truth), (4, 4, 1));
        // 18 pixels found of 24, none wrongly; 156 others of 15 x 12 are static in both.
        let scores = table.views[1].scores;
        let want = [18.0 / 24.0, 156.0 / 162.0, 36.0 / 42.0];
        for (got, want) in [scores.iou_transient, scores.iou_static, scores.f1].into_iter().zip(want) {
            assert!((got.unwrap() - want).abs() < 1e-12, "{scores:?}");
        }
        assert_eq!((table.per_image.f1, table.pooled.f1), (scores.f1, scores.f1));
        assert!(table.views[0].scores.f1.is_none() && table.views[0].static_share == 1.0);
        let mask = image::open(out.join("photos_p1.png")).unwrap().into_luma8();
        assert_eq!(mask.dimensions(), (WIDTH, HEIGHT));
        assert_eq!([mask.get_pixel(2, 3).0, mask.get_pixel(5, 3).0, mask.get_pixel(2, 2).0], [[0], [255], [255]]);
        let side: RgbImage = image::open(out.join("side_by_side/photos_p1.png")).unwrap().into_rgb8();
        assert_eq!(side.width(), 3 * WIDTH + 8, "photo, mask, truth");
        let some = run.write_masks(&out, MaskOptions { every: 3, ..options }, &mut Watch::default()).unwrap();
        let names: Vec<&str> = some.views.iter().map(|v| v.name.as_str()).collect();
        assert_eq!(names, ["photos/p0.png", "photos/p4.png"]);
        assert!(some.table().contains("2 of 4 training photos, no truth"), "{}", some.table());
    })
    .unwrap();
    let report = fs::read_to_string(folder.path().join("report.html")).unwrap();
    for part in
        ["<h2>Appearance</h2>", "in the appearance of photos/p0.png", "<h2>Masks</h2>", "F1 0.857", "right half"]
    {
        assert!(report.contains(part), "{part} is missing");
    }
    let plain = tempfile::tempdir().unwrap();
    trained(plain.path(), &scene, &request("one", None), |run, _| {
        let options = MaskOptions { every: 1, empty: Default::default() };
        let error = run.write_masks(&plain.path().join("m"), options, &mut Watch::default()).unwrap_err().to_string();
        assert!(error.contains("`one` finds no masks"), "{error}");
    })
    .unwrap();
    let report = fs::read_to_string(plain.path().join("report.html")).unwrap();
    assert!(!report.contains("<h2>Masks</h2>") && !report.contains("<h2>Appearance</h2>"));
    assert!(!plain.path().join("masks").exists() && !plain.path().join("m").exists());
}

#[test]
fn pictures_are_rendered_in_the_appearance_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let scene = scene(WIDTH);
    trained(&file("run"), &scene, &request("many", None), |run, _| {
        let appearance =
            |word: &str, camera: Option<&str>| run.appearance_along(&word.parse::<AppearancePath>().unwrap(), camera);
        let code = |word: &str, camera: Option<&str>| -> Result<Vec<f32>, RunError> {
            Ok(run.system.appearance_code(&appearance(word, camera)?.at(0, 1)).unwrap())
        };
        let near = |code: &[f32], want: [f32; 3]| code.iter().zip(want).all(|(a, b)| (a - b).abs() < 3e-3);
        assert!(near(&code("image:p4", None).unwrap(), offset(4)));
        // A held-out photo by its name, and photos from files.
        assert!(near(&code("fit:p5", None).unwrap(), offset(5)));
        let camera = scene.frames[2].camera;
        let own = [0.05, -0.1, 0.1];
        let picture = photo(&camera, own);
        let save = |name: &str| {
            RgbImage::from_raw(picture.width, picture.height, picture.data.clone()).unwrap().save(file(name)).unwrap();
            format!("fit:{}", file(name).display())
        };
        let word = save("mine.png");
        assert!(near(&code(&word, Some("p2")).unwrap(), own));
        assert!(!near(&code(&word, Some("p5")).unwrap(), own), "another camera sees another sky");
        let error = code(&word, None).unwrap_err().to_string();
        assert!(error.contains("--fit-camera NAME") && error.contains("mine.json"), "{error}");
        // OpenGL axes: x right, y up, z backward.
        let m = camera.pose.r;
        let row = |k: usize| [m.x_axis[k], -m.y_axis[k], -m.z_axis[k], camera.pose.c[k]];
        let json = serde_json::json!({
            "w": WIDTH, "h": HEIGHT, "fl_x": 14.0, "cx": f64::from(WIDTH) / 2.0, "cy": f64::from(HEIGHT) / 2.0,
            "frames": [{ "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]] }],
        });
        fs::write(file("mine.json"), json.to_string()).unwrap();
        assert!(near(&code(&word, None).unwrap(), own));
        assert!(code(&save("p5.png"), None).unwrap_err().to_string().contains("--fit-camera photos/p5.png"));
        RgbImage::new(9, 40).save(file("tall.png")).unwrap();
        let tall = format!("fit:{}", file("tall.png").display());
        assert!(code(&tall, Some("p2")).unwrap_err().to_string().contains("9x40"));
        fs::write(file("noise.png"), b"noise").unwrap();
        let noise = format!("fit:{}", file("noise.png").display());
        assert!(code(&noise, Some("p2")).unwrap_err().to_string().contains("noise.png"));
        assert!(code("fit:/nowhere.png", None).unwrap_err().to_string().contains("no such file"));
        assert!(code("image:p5", None).unwrap_err().to_string().contains("no such photo"));

        let between = appearance("image:p0..fit:p5", None).unwrap();
        let at = |i: usize| run.system.appearance_code(&between.at(i, 3)).unwrap();
        assert!(near(&at(0), offset(0)) && near(&at(2), offset(5)));
        assert!(near(&at(1), [0, 1, 2].map(|c| (offset(0)[c] + offset(5)[c]) / 2.0)));

        let held = cameras(&PathKind::Hold("p5".into()), &run.scene, &run.train, Some(3)).unwrap();
        assert_eq!((held.len(), held[0], held[2]), (3, scene.frames[5].camera, scene.frames[5].camera));
        let error = cameras(&PathKind::Hold("p9".into()), &run.scene, &run.train, None).unwrap_err().to_string();
        assert!(error.contains("`--path hold:p9`"), "{error}");
    })
    .unwrap();
    trained(&file("plain"), &scene, &request("one", None), |run, _| {
        let appearance = |word: &str| run.appearance_along(&word.parse::<AppearancePath>().unwrap(), None);
        assert_eq!(appearance("mean").unwrap(), FrameAppearances::Still(Appearance::Mean));
        for word in ["image:p0", "fit:p5", "mean..image:p0"] {
            assert!(appearance(word).unwrap_err().to_string().contains("one appearance only"), "{word}");
        }
    })
    .unwrap();
}

//! Photos with a light of their own and passers-by in them: how views are lit and scored, and masks. Driven by a system
//! that knows the sky and has one code, three offsets of colour, for each photo.

use crate::common::Watch;
use engine::RunError;
use engine::appearance::{AppearancePath, FrameAppearances};
use engine::camera_path::{PathKind, cameras};
use engine::data::Dataset;
use engine::eval::masks::{MaskOptions, MaskTable};
use engine::eval::{EvalAppearance, Evaluation, Protocol, Scored};
use engine::halt::Halt;
use engine::options::{Background, DataOptions, Plan, Request, RunOptions};
use engine::output::Disk;
use engine::run::{DefaultSystem, Parts, Run};
use engine::system::{
    Appearance, Fit, Layers, Query, SkipRow, StepStats, System, SystemError, Tensor, TensorMap, f32_tensor, take_f32,
};
use engine::train::{Schedule, Stop};
use glam::{DVec2, DVec3};
use image::RgbImage;
use render_core::camera::Camera;
use render_core::pose::Pose;
use render_core::ray::Ray;
use scene_io::{BitMask, Dialect, Frame, Image, ImageSource, LayoutHint, Scene, Split, TruthMask};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

const STRANGER: [u8; 3] = [255, 0, 255];

/// The sky in the light of each photo. With `lights` off it knows one only, and no strangers.
struct Lit {
    lights: bool,
    codes: Vec<f32>,
}

fn sky(d: DVec3) -> [f32; 3] {
    d.to_array().map(|c| (c * 0.25 + 0.5) as f32)
}

impl Lit {
    fn build(
        name: &str,
        _: &Scene,
        data: &Dataset,
        options: &RunOptions,
    ) -> Result<(Box<dyn System>, Plan), SystemError> {
        let background = options.background.unwrap_or(Background::Black);
        let plan = Plan { lines: Vec::new(), background, error_budget: 0.0, config: toml::Table::new() };
        Ok((Box::new(Self { lights: name == "lit", codes: vec![0.0; 3 * data.len()] }), plan))
    }
}

impl System for Lit {
    fn name(&self) -> &'static str {
        if self.lights { "lit" } else { "unlit" }
    }

    /// One step learns all codes.
    fn step(&mut self, data: &Dataset, _: u64) -> Result<StepStats, SystemError> {
        for view in 0..data.len() {
            let (rays, rgb) = pixels(data, view, &*data.image(view)?);
            let fit =
                Fit { rays: &rays, rgb: &rgb, background: [0.0; 3], steps: 1, lr: 1.0, seed: 0, halt: &Halt::NEVER };
            if let Some(code) = self.fit_appearance(&fit) {
                self.codes[3 * view..][..3].copy_from_slice(&code);
            }
        }
        Ok(StepStats::default())
    }

    fn render(&self, rays: &[Ray], query: &Query) -> Layers {
        let n = rays.len();
        let code = self.appearance_code(&query.appearance).unwrap_or_else(|| vec![0.0; 3]);
        Layers {
            rgb: rays.iter().map(|r| [0, 1, 2].map(|c| sky(r.d)[c] + code[c])).collect(),
            opacity: vec![1.0; n],
            depth: vec![10.0; n],
            median_depth: vec![10.0; n],
            normal: Vec::new(),
            canonical: Vec::new(),
        }
    }

    fn appearance_code(&self, appearance: &Appearance) -> Option<Vec<f32>> {
        let views = (self.codes.len() / 3) as f32;
        self.lights.then(|| match appearance {
            Appearance::Mean => (0..3).map(|c| self.codes.iter().skip(c).step_by(3).sum::<f32>() / views).collect(),
            Appearance::View(view) => self.codes[3 * view..][..3].to_vec(),
            Appearance::Code(code) => code.to_vec(),
        })
    }

    fn fit_appearance(&self, fit: &Fit<'_>) -> Option<Vec<f32>> {
        assert!(!fit.rays.is_empty() && fit.rays.len() == fit.rgb.len() && fit.steps > 0 && fit.lr > 0.0);
        // The mean of the differences is the least-squares solution; strangers pull at it.
        let mean = |c: usize| fit.rays.iter().zip(fit.rgb).map(|(r, rgb)| rgb[c] - sky(r.d)[c]).sum::<f32>();
        self.lights.then(|| (0..3).map(|c| mean(c) / fit.rays.len() as f32).collect())
    }

    fn encode_appearance(&self, photo: &Image) -> Option<Vec<f32>> {
        let pixels = f64::from(photo.width * photo.height);
        let mean = |c: usize| photo.data.chunks_exact(3).map(|p| f64::from(p[c])).sum::<f64>() / pixels;
        self.lights.then(|| (0..3).map(|c| (mean(c) / 255.0) as f32 - 0.5).collect())
    }

    fn visibility(&self, data: &Dataset, view: usize) -> Result<Option<Vec<f32>>, SystemError> {
        let photo = data.image(view)?;
        let is_static = |p: &[u8]| if p == STRANGER { 0.2 } else { 0.9 };
        Ok(self.lights.then(|| photo.data.chunks_exact(3).map(is_static).collect()))
    }

    fn density(&self, _: &[[f64; 3]], _: f64, out: &mut [f32]) {
        out.fill(0.0);
    }

    fn colour(&self, _: &[[f64; 3]], _: &[[f32; 3]], _: f64, out: &mut [[f32; 3]]) {
        out.fill([0.0; 3]);
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        [[-1.0; 3], [1.0; 3]]
    }

    fn state(&self) -> Vec<Tensor<'_>> {
        vec![f32_tensor("codes", &self.codes)]
    }

    fn load_state(&mut self, state: &TensorMap) -> Result<(), SystemError> {
        self.codes = take_f32(state, "codes", self.codes.len())?;
        Ok(())
    }

    fn parameter_count(&self) -> usize {
        self.codes.len()
    }

    fn memory_bytes(&self) -> usize {
        self.codes.len() * 4
    }

    fn skips(&self) -> Vec<SkipRow> {
        Vec::new()
    }

    fn timings(&self) -> Vec<(&'static str, f64)> {
        Vec::new()
    }
}

fn pixels(data: &Dataset, view: usize, photo: &Image) -> (Vec<Ray>, Vec<[f32; 3]>) {
    let all = (0..photo.height).flat_map(|y| (0..photo.width).map(move |x| (x, y)));
    all.filter_map(|(x, y)| {
        let rgb = photo.pixel(x, y);
        Some((data.ray(view, x, y)?, [0, 1, 2].map(|c| f32::from(rgb[c]) / 255.0)))
    })
    .unzip()
}

const WIDTH: u32 = 15;
const HEIGHT: u32 = 12;

/// Offset of photo `i`: far apart, and far from the mean.
fn offset(i: usize) -> [f32; 3] {
    [0.1 * (i % 3) as f32 - 0.1, 0.08 * (i % 2) as f32, -0.05 * i as f32 / 5.0]
}

/// The picture of a camera in an offset light.
fn photo(camera: &Camera, offset: [f32; 3]) -> Image {
    let mut data = Vec::new();
    for y in 0..camera.height {
        for x in 0..camera.width {
            let d = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).unwrap().d;
            data.extend([0, 1, 2].map(|c| ((sky(d)[c] + offset[c]) * 255.0).round() as u8));
        }
    }
    Image::rgb(camera.width, camera.height, data).unwrap()
}

/// Six photos of the sky; the third and the sixth are held out. A stranger stands in the second.
fn scene(width: u32) -> Scene {
    let frames = (0..6).map(|i| {
        let angle = i as f64 * 0.4;
        let pose = Pose::look_at(DVec3::ZERO, DVec3::new(angle.cos(), angle.sin(), 0.1), DVec3::Z).unwrap();
        let (cx, cy) = (f64::from(width) / 2.0, f64::from(HEIGHT) / 2.0);
        let camera = Camera::pinhole(width, HEIGHT, 14.0, 14.0, cx, cy, pose);
        let mut image = photo(&camera, offset(i));
        let mut frame = Frame::new(format!("photos/p{i}.png"), ImageSource::File("none".into()), camera);
        if i == 1 {
            // The truth is one column wider than what the system will find.
            for y in 3..9 {
                for x in 2..5 {
                    image.data[3 * (y * width as usize + x)..][..3].copy_from_slice(&STRANGER);
                }
            }
            let truth = BitMask::from_fn(width, HEIGHT, |x, y| (3..9).contains(&y) && (2..6).contains(&x));
            frame.truth.transient = Some(TruthMask::Memory(Arc::new(truth)));
        }
        frame.image = ImageSource::Memory(Arc::new(image));
        frame.split = if i % 3 == 2 { Split::Test } else { Split::Train };
        frame
    });
    Scene {
        name: "sky".into(),
        root: ".".into(),
        dialect: Dialect::Synthetic,
        frames: frames.collect(),
        points: Vec::new(),
        layout: LayoutHint::Unbounded,
        bounds: None,
        notes: Vec::new(),
    }
}

/// Paint columns of a frame's photo.
fn paint(scene: &mut Scene, frame: usize, columns: std::ops::Range<u32>, rgb: [u8; 3]) {
    let ImageSource::Memory(image) = &scene.frames[frame].image else { panic!("in memory") };
    let mut image = Image::clone(image);
    for y in 0..image.height {
        for x in columns.clone() {
            image.data[3 * (y * image.width + x) as usize..][..3].copy_from_slice(&rgb);
        }
    }
    scene.frames[frame].image = ImageSource::Memory(Arc::new(image));
}

fn with_parts<R>(scene: &Scene, work: impl FnOnce(Parts<'_>) -> R) -> R {
    let load = |_: &str, _: &DataOptions| -> Result<Scene, RunError> { Ok(scene.clone()) };
    work(Parts { load: &load, build: &Lit::build, storage: &Disk, default_system: DefaultSystem::Named("lit") })
}

fn request(system: &str, light: Option<&str>) -> Request {
    Request {
        scene: Some("sky".into()),
        system: Some(system.into()),
        eval_appearance: light.map(|l| l.parse().unwrap()),
        ..Request::default()
    }
}

/// Train a run of one step, which knows every training photo's light; hand it and its scores to `look`.
fn trained<R>(
    folder: &Path,
    scene: &Scene,
    request: &Request,
    look: impl FnOnce(&mut Run<'_>, Evaluation) -> R,
) -> Result<R, RunError> {
    with_parts(scene, |parts| {
        let mut run = Run::create(folder, request, parts, &mut Watch::default())?;
        let schedule = Schedule::new(Stop::Steps(1));
        let evaluation = run.train(&schedule, None, &mut Watch::default(), &AtomicBool::new(false))?.1;
        Ok(look(&mut run, evaluation.unwrap()))
    })
}

fn scores(scene: &Scene, system: &str, light: Option<&str>) -> Evaluation {
    let folder = tempfile::tempdir().unwrap();
    trained(folder.path(), scene, &request(system, light), |_, e| e).unwrap()
}

#[test]
fn a_light_fitted_on_the_left_half_explains_the_right_half() {
    let e = scores(&scene(WIDTH), "lit", None);
    assert_eq!((&e.protocol.appearance, e.protocol.scored), (&Some(EvalAppearance::Fit), Scored::RightHalf));
    assert!(e.psnr.unwrap() > 45.0, "nothing but rounding is left: {:?}", e.psnr);
    let mean = scores(&scene(WIDTH), "lit", Some("mean"));
    assert!(mean.psnr.unwrap() < 30.0, "{:?}", mean.psnr);
    assert_eq!(mean.protocol.scored, Scored::Whole);
    assert!(e.table().contains("protocol: appearance fitted on the left half"), "{}", e.table());
}

#[test]
fn pixels_of_the_right_half_cannot_reach_the_light() {
    let render = |scene: &Scene| {
        let folder = tempfile::tempdir().unwrap();
        let psnr = trained(folder.path(), scene, &request("lit", None), |_, e| e.views[0].psnr).unwrap();
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
    let both = scores(&scene(WIDTH), "lit", None);
    let mut alone = scene(WIDTH);
    alone.frames[2].split = Split::Unused;
    let alone = scores(&alone, "lit", None);
    assert_eq!(both.views[1].name, alone.views[0].name);
    assert_eq!((both.views[1].psnr, both.views[1].ssim), (alone.views[0].psnr, alone.views[0].ssim));
}

#[test]
fn systems_with_one_light_score_right_halves_where_that_is_asked_for() {
    let plain = scores(&scene(WIDTH), "unlit", None);
    assert_eq!(plain.protocol, Protocol::default());
    assert!(!plain.table().contains("protocol"));
    let half = scores(&scene(WIDTH), "unlit", Some("fit"));
    assert_eq!((half.protocol.scored, half.protocol.fit_steps), (Scored::RightHalf, None));
    let mut painted = scene(WIDTH);
    paint(&mut painted, 2, 0..7, [0, 0, 0]);
    assert_eq!(scores(&painted, "unlit", Some("fit")).psnr, half.psnr, "the left half does not count");
    assert_ne!(scores(&painted, "unlit", None).psnr, plain.psnr);
}

#[test]
fn views_of_one_column_have_no_halves() {
    let folder = tempfile::tempdir().unwrap();
    let mut narrow = scene(WIDTH);
    let pose = narrow.frames[5].camera.pose;
    let camera = Camera::pinhole(1, 4, 14.0, 14.0, 0.5, 2.0, pose);
    narrow.frames[5].image = ImageSource::Memory(Arc::new(photo(&camera, [0.0; 3])));
    narrow.frames[5].camera = camera;
    let error = trained(folder.path(), &narrow, &request("lit", None), |_, _| ()).unwrap_err().to_string();
    assert!(error.contains("photos/p5.png") && error.contains("1 pixel wide"), "{error}");
    assert!(!folder.path().join("checkpoint").exists(), "found before training");
    trained(folder.path(), &narrow, &request("lit", Some("mean")), |_, _| ()).unwrap();
    // Two columns have two halves.
    assert!(scores(&scene(2), "lit", None).psnr.unwrap() > 40.0);
}

#[test]
fn lights_of_photos_and_encoders_are_taken_at_their_word() {
    // Frame 5 has the light of no training photo; frame 2 nearly that of frame 0 in the first channel alone.
    let of = |light: &str| scores(&scene(WIDTH), "lit", Some(light));
    let image = of("image:p4");
    assert_eq!(image.protocol.appearance, Some(EvalAppearance::Image("p4".into())));
    assert_ne!(image.psnr, of("image:p0").psnr);
    assert_eq!(image.psnr, of("image:photos/p4.png").psnr);
    let (left, whole) = (of("encode:left"), of("encode:whole"));
    assert_eq!((left.protocol.scored, whole.protocol.scored), (Scored::RightHalf, Scored::RightHalf));
    let painted = |light: &str| {
        let mut painted = scene(WIDTH);
        paint(&mut painted, 2, 7..WIDTH, [255, 255, 255]);
        let folder = tempfile::tempdir().unwrap();
        trained(folder.path(), &painted, &request("lit", Some(light)), |_, _| ()).unwrap();
        let bits = |folder: &Path| fs::read(folder.join("renders/000_photos_p2.png")).unwrap();
        let plain = tempfile::tempdir().unwrap();
        trained(plain.path(), &scene(WIDTH), &request("lit", Some(light)), |_, _| ()).unwrap();
        bits(folder.path()) == bits(plain.path())
    };
    assert!(painted("encode:left"), "the encoder saw the left half alone");
    assert!(!painted("encode:whole"), "the scored half leaks");
}

#[test]
fn lights_that_a_system_has_not_are_refused_before_training() {
    for (system, light, part) in [
        ("unlit", "image:p4", "one appearance only"),
        ("unlit", "encode:left", "no encoder"),
        ("lit", "image:p9", "no such photo"),
        ("lit", "image:p2", "no such photo"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let error = trained(folder.path(), &scene(WIDTH), &request(system, Some(light)), |_, _| ()).unwrap_err();
        assert!(error.to_string().contains(part), "{system} {light}: {error}");
        assert!(!folder.path().join("checkpoint").exists());
    }
}

#[test]
fn the_protocol_is_written_down_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    trained(folder.path(), &scene(WIDTH), &request("lit", Some("image:p0")), |_, _| ()).unwrap();
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
        let request = request("lit", Some("fit"));
        let error = Run::open(folder.path(), &request, parts, &mut Watch::default()).map(|_| ()).unwrap_err();
        assert!(error.to_string().contains("`--eval-appearance image:p0`"), "{error}");
    });
}

#[test]
fn a_view_without_a_used_pixel_on_its_left_is_noted_and_rendered_in_the_mean_light() {
    let mut masked = scene(WIDTH);
    let ImageSource::Memory(image) = &masked.frames[2].image else { panic!("in memory") };
    let mut image = Image::clone(image);
    image.mask = Some((0..WIDTH * HEIGHT).map(|k| if k % WIDTH < 7 { 0 } else { 255 }).collect());
    masked.frames[2].image = ImageSource::Memory(Arc::new(image));
    let e = scores(&masked, "lit", None);
    assert!(e.notes.iter().any(|n| n.starts_with("photos/p2.png: no pixel of its left half")), "{:?}", e.notes);
    assert!(e.views[0].psnr.unwrap() < 30.0 && e.views[1].psnr.unwrap() > 45.0);
}

#[test]
fn masks_are_written_scored_and_shown() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(WIDTH);
    trained(folder.path(), &scene, &request("lit", None), |run, _| {
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
    trained(plain.path(), &scene, &request("unlit", None), |run, _| {
        let options = MaskOptions { every: 1, empty: Default::default() };
        let error = run.write_masks(&plain.path().join("m"), options, &mut Watch::default()).unwrap_err().to_string();
        assert!(error.contains("`unlit` finds no masks"), "{error}");
    })
    .unwrap();
    let report = fs::read_to_string(plain.path().join("report.html")).unwrap();
    assert!(!report.contains("<h2>Masks</h2>") && !report.contains("<h2>Appearance</h2>"));
    assert!(!plain.path().join("masks").exists() && !plain.path().join("m").exists());
}

#[test]
fn pictures_are_rendered_in_the_light_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str| folder.path().join(name);
    let scene = scene(WIDTH);
    trained(&file("run"), &scene, &request("lit", None), |run, _| {
        let light =
            |word: &str, camera: Option<&str>| run.appearance_along(&word.parse::<AppearancePath>().unwrap(), camera);
        let code = |word: &str, camera: Option<&str>| -> Result<Vec<f32>, RunError> {
            Ok(run.system.appearance_code(&light(word, camera)?.at(0, 1)).unwrap())
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

        let between = light("image:p0..fit:p5", None).unwrap();
        let at = |i: usize| run.system.appearance_code(&between.at(i, 3)).unwrap();
        assert!(near(&at(0), offset(0)) && near(&at(2), offset(5)));
        assert!(near(&at(1), [0, 1, 2].map(|c| (offset(0)[c] + offset(5)[c]) / 2.0)));

        let held = cameras(&PathKind::Hold("p5".into()), &run.scene, &run.train, Some(3)).unwrap();
        assert_eq!((held.len(), held[0], held[2]), (3, scene.frames[5].camera, scene.frames[5].camera));
        let error = cameras(&PathKind::Hold("p9".into()), &run.scene, &run.train, None).unwrap_err().to_string();
        assert!(error.contains("`--path hold:p9`"), "{error}");
    })
    .unwrap();
    trained(&file("plain"), &scene, &request("unlit", None), |run, _| {
        let light = |word: &str| run.appearance_along(&word.parse::<AppearancePath>().unwrap(), None);
        assert_eq!(light("mean").unwrap(), FrameAppearances::Still(Appearance::Mean));
        for word in ["image:p0", "fit:p5", "mean..image:p0"] {
            assert!(light(word).unwrap_err().to_string().contains("one appearance only"), "{word}");
        }
    })
    .unwrap();
}

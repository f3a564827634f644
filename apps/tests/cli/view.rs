//! `view`: the page, its pictures, and who gets them.

use crate::tools::{SMALL, dataset, error_line, nerf, nerf_dynamic, nerf_wild, text};
use crate::viewing::Viewer;
use scene_io::synthetic::{OrbitOptions, write_orbit};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A run of `steps` steps.
pub(crate) fn trained(steps: &str) -> (TempDir, PathBuf) {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let train = ["train", text(&scene), "--out", text(&run), "--steps", steps, "--progress", "off"];
    let answer = nerf(&[&train[..], &SMALL].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    (folder, run)
}

/// A file of 40 Gaussians.
pub(crate) fn write_cloud(file: &Path) {
    let mut cloud = splat_core::Gaussians::new(40, 0).unwrap();
    for i in 0..40 {
        for k in 0..3 {
            cloud.mean[k * 40 + i] = ((i * (k + 3) * 7) % 13) as f32 / 13.0;
            cloud.log_scale[k * 40 + i] = -2.5;
        }
        cloud.logit[i] = 3.0;
    }
    scene_io::write_splats(file, &cloud, &scene_io::SplatOptions::default()).unwrap();
}

#[test]
fn what_cannot_be_looked_at_is_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes.txt");
    fs::write(&file, "no run").unwrap();
    for (what, part) in
        [(Path::new("/nowhere"), "is not there"), (folder.path(), "not a run folder"), (&file, "neither PLY nor SPZ")]
    {
        let answer = nerf(&["view", text(what)]);
        assert_eq!(answer.code, 1, "{}", answer.out);
        assert!(error_line(&answer).contains(part), "{}", answer.err);
    }
    let (_folder, run) = trained("1");
    let answer = nerf(&["view", text(&run), "--host", "no.such.name.invalid"]);
    assert!(answer.code == 1 && error_line(&answer).contains("no.such.name.invalid"), "{}", answer.err);
}

#[test]
fn only_the_page_itself_is_served_and_only_to_its_own_name() {
    let (_folder, run) = trained("1");
    let mut viewer = Viewer::start("nerf-static", &run);
    let host = format!("Host: {}\r\n", viewer.address);
    let page = viewer.http("GET /", &host);
    assert!(page.starts_with("HTTP/1.1 200") && page.contains("<!doctype html>"), "{page}");
    let policy = page.lines().find(|line| line.starts_with("content-security-policy:")).unwrap();
    assert!(policy.contains("default-src 'none'") && !policy.contains("unsafe"), "{policy}");
    for path in ["/config.toml", "/../config.toml", "/etc/passwd", "/live/x", "/%2e%2e/config.toml"] {
        assert!(viewer.http(&format!("GET {path}"), &host).starts_with("HTTP/1.1 404"), "{path}");
    }
    assert!(viewer.http("POST /", &host).starts_with("HTTP/1.1 405"));
    let port = viewer.address.rsplit_once(':').unwrap().1;
    for headers in [
        format!("Host: evil.example:{port}\r\n"),
        format!("{host}Host: evil.example\r\n"),
        format!("{host}Origin: http://evil.example\r\n"),
        format!("{host}Origin: null\r\n"),
    ] {
        for path in ["/", "/live", "/nothing"] {
            let answer = viewer.http(&format!("GET {path}"), &headers);
            assert!(!answer.starts_with("HTTP/1.1 2") && !answer.contains("<!doctype"), "{headers}{answer}");
            assert!(answer.starts_with("HTTP/1.1 403") || answer.starts_with("HTTP/1.1 400"), "{headers}{answer}");
        }
    }
    for origin in ["http://evil.example", "null", "https://127.0.0.1"] {
        let refused = viewer.try_connect(Some(origin)).err().unwrap();
        assert!(refused.contains("403"), "{origin}: {refused}");
    }
    assert!(viewer.try_connect(None).is_ok(), "programs that are not browsers have no origin");
    assert_eq!(viewer.interrupt(), Some(0));
}

#[test]
fn pictures_follow_the_camera_and_the_layer() {
    let (_folder, run) = trained("20");
    let viewer = Viewer::start("nerf-static", &run);
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    assert_eq!((&scene["step"], &scene["moves"], &scene["appearances"]), (&json!(20), &json!(false), &json!([])));
    let photos = scene["photos"].as_array().unwrap();
    assert_eq!(photos.iter().filter(|photo| photo["held_out"] == false).count(), 6);
    assert_eq!(photos.len(), 8);

    let id = live.ask(&photos[0], json!({}));
    let first = live.best(id);
    assert_eq!((first.pixels.dimensions(), first.step), ((60, 60), 20));
    assert_eq!(&first.file[1..4], b"PNG");
    let id = live.ask(&photos[3], json!({}));
    assert_ne!(live.best(id).file, first.file, "another camera sees something else");
    let id = live.ask(&photos[0], json!({}));
    assert_eq!(live.best(id).file, first.file, "the same camera sees the same");

    // A large picture comes in steps, the first in JPEG.
    let id = live.ask(&photos[0], json!({ "width": 300, "height": 200, "limit": 240, "layer": "normals" }));
    let quick = live.see();
    assert!(quick.id == id && quick.quality == 0 && quick.file[..2] == [0xff, 0xd8]);
    assert_eq!(live.best(id).pixels.dimensions(), (240, 160));

    for layer in scene["layers"].as_array().unwrap() {
        let id = live.ask(&photos[0], json!({ "layer": layer, "photo": 0 }));
        let other = live.best(id);
        assert_eq!(other.file == first.file, layer == "colour", "{layer}");
    }
    let id = live.ask(&photos[0], json!({ "background": [1.0, 0.0, 0.0] }));
    assert_ne!(live.best(id).file, first.file);

    // The point in the middle of the picture is before the camera, and on the line it looks along.
    let camera = &photos[0];
    live.say(
        json!({ "type": "pick", "id": 7, "width": 60, "height": 60, "position": camera["position"],
                "wxyz": camera["wxyz"], "fov": 0.5, "at": [0.5, 0.5] })
        .to_string(),
    );
    let word = live.hear("picked");
    assert_eq!(word["id"], 7);
    let point: Vec<f64> = word["point"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let eye: Vec<f64> = camera["position"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let distance = point.iter().zip(&eye).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    assert!(distance > 0.1 && distance < 20.0, "{point:?}");
}

#[test]
fn nonsense_gets_an_answer_and_the_server_lives() {
    let (_folder, run) = trained("1");
    let viewer = Viewer::start("nerf-static", &run);
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    for nonsense in
        ["", "{", "null", r#"{"type": "draw"}"#, r#"{"type": "read", "path": "/etc/passwd"}"#, "\u{0}\u{fffd}"]
    {
        live.say(nonsense);
        assert!(live.hear("error")["message"].as_str().unwrap().contains("not understood"), "{nonsense}");
    }
    live.say_bytes(vec![0xff; 100]);
    live.hear("error");
    let camera = &scene["photos"][0];
    for (wrong, part) in [
        (json!({ "width": 0 }), "`width`"),
        (json!({ "position": [1e300, 0, 0] }), "`position`"),
        (json!({ "wxyz": [0, 0, 0, 0] }), "wxyz"),
        (json!({ "layer": "photo" }), "`photo` is missing"),
        (json!({ "layer": "photo", "photo": 99 }), "`photo` = 99: there are 8"),
        (json!({ "layer": "mask", "photo": 0 }), "has no layer `mask`"),
        (json!({ "layer": "flow" }), "has no layer `flow`"),
        (json!({ "layer": "uncertainty", "photo": 0 }), "has no layer `uncertainty`"),
        (json!({ "layer": "mask", "photo": 7 }), "held out"),
    ] {
        live.ask(camera, wrong);
        let word = live.hear("error");
        assert!(word["message"].as_str().unwrap().contains(part), "{word}");
    }
    // Odd, and possible: cameras inside of things, far away, of one pixel, in an appearance that is not there.
    for odd in [
        json!({ "position": [0.0, 0.0, 0.0] }),
        json!({ "position": [1e8, -1e8, 1e8] }),
        json!({ "width": 1, "height": 1 }),
        json!({ "appearance": { "from": 99, "to": 3, "blend": 0.5 }, "time": 1.0 }),
    ] {
        let id = live.ask(camera, odd);
        live.best(id);
    }
    let mut other = viewer.connect();
    other.say("x".repeat(100_000));
    assert!(other.hear("error")["message"].as_str().unwrap().contains("refused"));
    drop(other);
    let id = live.ask(camera, json!({}));
    live.best(id);
    viewer.connect().hear("scene");
}

#[test]
fn a_training_is_followed_from_its_first_checkpoint_on() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    fs::create_dir(&run).unwrap();
    let viewer = Viewer::start("nerf-static", &run);
    let mut live = viewer.connect();
    assert!(live.hear("waiting")["message"].as_str().unwrap().contains("no checkpoint yet"));
    // Half-written files of a training that has begun are not an error.
    fs::create_dir(run.join("checkpoint")).unwrap();
    fs::write(run.join("checkpoint/step-00000002.safetensors"), [0; 100]).unwrap();
    fs::write(run.join("metrics.csv"), "step,seco").unwrap();

    let train = |steps: &str, more: &[&str]| {
        let words = ["train", "--out", text(&run), "--steps", steps, "--progress", "off"];
        let answer = nerf(&[&words[..], more].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
    };
    train("4", &[&[text(&scene)], &SMALL[..]].concat());
    let first = live.hear("scene");
    assert_eq!(first["step"], 4);
    let camera = first["photos"][0].clone();
    let id = live.ask(&camera, json!({}));
    let before = live.best(id);
    assert_eq!(before.step, 4);

    train("12", &["--resume"]);
    assert_eq!(live.hear("scene")["step"], 12);
    // Nobody asked again: the picture that was wanted last comes by itself.
    let after = live.best(id);
    assert!(after.step == 12 && after.file != before.file);
    while live.training["runs"] != json!(false) || live.training["step"] != 12 {
        live.hear("training");
    }
    assert_eq!(live.training["of"], 12);
    assert!(live.training["rows"].as_array().is_some_and(|rows| !rows.is_empty()));

    // A checkpoint that is broken is passed over for the one before.
    fs::write(run.join("checkpoint/step-00000099.json"), "{").unwrap();
    let id = live.ask(&camera, json!({ "limit": 30 }));
    assert_eq!(live.best(id).step, 12);
}

#[test]
fn a_scene_that_moves_is_seen_at_any_time() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, run) = (folder.path().join("scene"), folder.path().join("run"));
    let options = OrbitOptions { width: 24, height: 24, train: 8, test: 2, rays: 1, ..OrbitOptions::default() };
    write_orbit(&options, &scene).unwrap();
    let train = |run: &Path, more: &[&str]| {
        let words = ["train", text(&scene), "--out", text(run), "--progress", "off", "--set", "warp_width=16"];
        let answer = nerf_dynamic(&[&words[..], &SMALL, more].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
    };
    train(&run, &["--set", "warp_depth=2", "--steps", "30"]);
    let viewer = Viewer::start("nerf-dynamic", &run);
    let mut live = viewer.connect();
    let shown = live.hear("scene");
    let has = |scene: &Value, layer: &str| scene["layers"].as_array().unwrap().contains(&json!(layer));
    assert!(shown["moves"] == true && has(&shown, "canonical") && has(&shown, "flow"), "{shown}");
    let at = |live: &mut crate::viewing::Live, more: Value| {
        let id = live.ask(&shown["photos"][0], more);
        live.best(id).file
    };
    let start = at(&mut live, json!({ "time": 0.0 }));
    assert_ne!(start, at(&mut live, json!({ "time": 1.0 })));
    assert_eq!(start, at(&mut live, json!({ "time": 0.0 })));
    assert_ne!(start, at(&mut live, json!({ "time": 0.0, "layer": "canonical" })));
    // Also of the last time, after which there is none.
    for time in [0.0, 1.0] {
        assert_ne!(start, at(&mut live, json!({ "time": time, "layer": "flow" })));
    }

    // Who moves no point has no flow to show.
    let still = folder.path().join("still");
    train(&still, &["--system", "t-nerf", "--steps", "2"]);
    let viewer = Viewer::start("nerf-dynamic", &still);
    let mut live = viewer.connect();
    let shown = live.hear("scene");
    assert!(shown["moves"] == true && has(&shown, "canonical") && !has(&shown, "flow"), "{shown}");
    live.ask(&shown["photos"][0], json!({ "layer": "flow" }));
    let word = live.hear("error");
    assert!(word["message"].as_str().unwrap().contains("has no layer `flow`"), "{word}");
}

#[test]
fn photos_of_many_appearances_are_blended_and_masks_shown() {
    let (folder, scene) = dataset();
    let run = |system: &str, more: &[&str]| {
        let run = folder.path().join(system);
        let words =
            ["train", text(&scene), "--out", text(&run), "--system", system, "--steps", "3", "--progress", "off"];
        let answer = nerf_wild(&[&words[..], &SMALL, more].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        run
    };
    let viewer = Viewer::start("nerf-wild", &run("nerf-a", &[]));
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    assert_eq!(scene["appearances"].as_array().unwrap().len(), 6);
    assert!(!scene["layers"].as_array().unwrap().contains(&json!("mask")));
    let mut lit = |appearance: Value| {
        let id = live.ask(&scene["photos"][0], json!({ "appearance": appearance }));
        live.best(id).file
    };
    let (a, b) = (lit(json!({ "from": 0 })), lit(json!({ "from": 5 })));
    let between = |blend: f64| json!({ "from": 0, "to": 5, "blend": blend });
    assert_eq!((lit(between(0.0)), lit(between(1.0))), (a.clone(), b.clone()));
    let half = lit(between(0.5));
    assert!(a != b && half != a && half != b);

    let viewer = Viewer::start("nerf-wild", &run("robust-nerf", &["--set", "judge_first=2"]));
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    assert!(scene["layers"].as_array().unwrap().contains(&json!("mask")), "{}", scene["layers"]);
    let id = live.ask(&scene["photos"][1], json!({ "layer": "mask", "photo": 1 }));
    let mask = live.best(id).pixels;
    let is_grey = |picture: &image::RgbImage| picture.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]);
    assert!(mask.dimensions() == (24, 24) && is_grey(&mask));
    assert!(!scene["layers"].as_array().unwrap().contains(&json!("uncertainty")));

    let viewer = Viewer::start("nerf-wild", &run("nerf-w", &[]));
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    assert!(scene["layers"].as_array().unwrap().contains(&json!("uncertainty")), "{}", scene["layers"]);
    let id = live.ask(&scene["photos"][1], json!({ "layer": "uncertainty", "photo": 1 }));
    let uncertainty = live.best(id).pixels;
    assert!(uncertainty.dimensions() == (24, 24) && is_grey(&uncertainty));
    assert!(uncertainty.pixels().all(|p| p.0[0] > 0), "no pixel is certain");
}

/// Wait until the cloud that stands for a field is there; what a page that opens now is told of it.
fn baked(viewer: &Viewer) -> Value {
    let mut live = viewer.connect();
    loop {
        let word = live.hear("fast");
        assert_ne!(word["state"], "failed", "{word}");
        if word["state"] == "ready" {
            return word;
        }
    }
}

#[test]
fn a_field_is_baked_for_pictures_while_the_camera_moves() {
    let (folder, run) = trained("60");
    let viewer = Viewer::start("nerf-static", &run);
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    let photo = &scene["photos"][0];
    // The first wish is for the field: it starts the bake.
    let id = live.ask(photo, json!({}));
    let field = live.best(id);
    let word = baked(&viewer);
    assert!(word["count"].as_u64().unwrap() > 50 && word["psnr"].as_f64().unwrap() > 15.0, "{word}");
    assert!(run.join("baked.safetensors").exists());
    // Now the cloud draws first, and the field has the last word: the same as before.
    let id = live.ask(photo, json!({ "width": 120, "height": 120, "limit": 120 }));
    let quick = live.see();
    assert!(quick.id == id && quick.drawer == 1 && quick.quality == 0);
    assert_eq!(live.best(id).drawer, 0);
    let id = live.ask(photo, json!({}));
    assert_eq!(live.best(id).file, field.file);
    // Cropped it is the cloud alone, sharp at once; what is outside is gone.
    let crop = json!({ "box": [[90.0, 90.0, 90.0], [91.0, 91.0, 91.0]] });
    let id = live.ask(photo, json!({ "crop": crop, "background": [1.0, 0.0, 0.0] }));
    let empty = live.best(id);
    assert_eq!(empty.drawer, 1);
    assert!(empty.pixels.pixels().all(|p| p.0 == [255, 0, 0]), "everything is cropped away");
    for layer in ["depth", "normals", "opacity"] {
        let id = live.ask(photo, json!({ "layer": layer }));
        assert_eq!(live.best(id).drawer, 0, "{layer}");
    }

    // The next viewer, and export, find it.
    let file = run.join("baked.safetensors");
    let written = fs::metadata(&file).unwrap().modified().unwrap();
    drop(viewer);
    let out = folder.path().join("out.ply");
    let answer = nerf(&["export", text(&run), "--splats", text(&out)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let count = format!("{} Gaussians baked from `ngp`", word["count"]);
    assert!(answer.out.contains(&count), "{count}: {}", answer.out);
    assert_eq!(fs::metadata(&file).unwrap().modified().unwrap(), written);
    assert_eq!(scene_io::read_splats(&out).unwrap().cloud.len() as u64, word["count"].as_u64().unwrap());
}

#[test]
fn a_crop_is_saved_beside_the_run_and_export_obeys_it() {
    let (folder, run) = trained("60");
    let viewer = Viewer::start("nerf-static", &run);
    let mut live = viewer.connect();
    assert_eq!(live.hear("scene")["crop"]["box"], Value::Null);
    for (wrong, part) in [
        (json!({ "faint": 7 }), "`faint` = 7"),
        (json!({ "box": [[0, 0, 0], [1, 1, 0]] }), "`box`: z"),
        (json!({ "file": "/tmp/x" }), "not understood"),
    ] {
        live.say(json!({ "type": "save", "crop": wrong }).to_string());
        let word = live.hear("error");
        assert!(word["message"].as_str().unwrap().contains(part), "{word}");
    }
    assert!(!run.join("crop.json").exists());
    let crop = json!({ "box": [[-0.4, -0.4, -2.0], [0.4, 0.4, 2.0]], "faint": 0.1, "up": [0.0, 0.0, 1.0] });
    live.say(json!({ "type": "save", "crop": crop }).to_string());
    assert_eq!(live.hear("saved")["file"], "crop.json");
    assert_eq!(viewer.connect().hear("scene")["crop"]["box"], crop["box"]);
    drop(viewer);

    let splats = |more: &[&str]| {
        let out = folder.path().join("out.ply");
        let answer = nerf(&[&["export", text(&run), "--splats", text(&out)], more].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        (scene_io::read_splats(&out).unwrap().cloud, answer.out)
    };
    let (cropped, said) = splats(&[]);
    assert!(said.contains("crop.json") && said.contains("--no-crop"), "{said}");
    let n = cropped.len();
    assert!(cropped.mean[..2 * n].iter().all(|x| x.abs() <= 0.4001));
    let (all, said) = splats(&["--no-crop"]);
    assert!(all.len() > n && !said.contains("crop.json"), "{} {n}", all.len());
    let (boxed, _) = splats(&["--box=-0.1,-0.1,-2,0.1,0.1,2"]);
    assert!(boxed.mean[..2 * boxed.len()].iter().all(|x| x.abs() <= 0.1001) && boxed.len() < all.len());
    let points = folder.path().join("points.ply");
    let answer = nerf(&["export", text(&run), "--points", text(&points), "--count", "2000"]);
    assert!(answer.code == 0 && answer.out.contains("box: (-0.4000, -0.4000"), "{}{}", answer.out, answer.err);

    fs::write(run.join("crop.json"), r#"{"box": 3}"#).unwrap();
    let answer = nerf(&["export", text(&run), "--points", text(&points)]);
    assert!(answer.code == 1 && error_line(&answer).contains("crop.json"), "{}", answer.err);
}

#[test]
fn a_file_of_gaussians_is_cropped_and_its_crop_lies_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cloud.ply");
    write_cloud(&file);
    let viewer = Viewer::start("nerf-static", &file);
    let mut live = viewer.connect();
    let scene = live.hear("scene");
    let word = live.hear("fast");
    assert!(word["state"] == "own" && word["hints"]["count"] == 40, "{word}");
    let photo = &scene["photos"][0];
    let id = live.ask(photo, json!({}));
    let whole = live.best(id);
    let id = live.ask(photo, json!({ "crop": { "faint": 0.99 } }));
    let none = live.best(id);
    assert!(whole.pixels.pixels().any(|p| p.0 != [0; 3]) && none.pixels.pixels().all(|p| p.0 == [0; 3]));
    live.say(json!({ "type": "save", "crop": { "alone": 0.5 } }).to_string());
    assert_eq!(live.hear("saved")["file"], "cloud.ply.crop.json");
    assert!(folder.path().join("cloud.ply.crop.json").exists());
}

//! `--system splat` and files of Gaussians, from training to pictures.

use crate::tools::{Answer, arrays, dataset, error_line, nerf, text};
use scene_io::export::Ply;
use scene_io::{SplatFile, read_splats};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Settings that make a training short; files are looked at on black.
const SMALL: [&str; 8] =
    ["--system", "splat", "--background", "black", "--max-splats", "400", "--set", "start_count=200"];
/// Density control after a few steps.
const BUSY: [&str; 4] = ["--set", "densify_from=10", "--set", "densify_every=10"];
/// The density controls, with settings of theirs alone.
const ADC: [&str; 4] = ["--set", "density=adc", "--set", "densify_gradient=1e-7"];
const MCMC: [&str; 2] = ["--set", "density=mcmc"];

fn train(scene: &Path, run: &Path, steps: &str, more: &[&[&str]]) -> Answer {
    let words = ["train", text(scene), "--out", text(run), "--steps", steps, "--progress", "off"];
    nerf(&[&words, more.concat().as_slice()].concat())
}

/// A short training.
fn trained() -> (TempDir, PathBuf) {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let answer = train(&scene, &run, "60", &[&SMALL, &BUSY, &ADC]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    (folder, run)
}

fn psnr(run: &Path) -> f64 {
    let json: Value = serde_json::from_slice(&fs::read(run.join("eval.json")).unwrap()).unwrap();
    json["psnr"].as_f64().unwrap()
}

/// A PLY of what a run has learnt.
fn exported(run: &Path, name: &str) -> (PathBuf, SplatFile) {
    let path = run.join(name);
    let answer = nerf(&["export", text(run), "--splats", text(&path)]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let file = read_splats(&path).unwrap();
    assert!(answer.out.contains(&format!("{} Gaussians in ", file.cloud.len())), "{}", answer.out);
    (path, file)
}

fn all_finite(file: &SplatFile) {
    for (field, numbers) in file.cloud.fields() {
        assert!(numbers.iter().all(|x| x.is_finite()), "{}", field.name());
    }
}

#[test]
fn splats_learn_the_table_top() {
    let folder = tempfile::tempdir().unwrap();
    let at = |steps: &str| {
        let run = folder.path().join(steps);
        let words = ["--longest-side", "40", "--set", "start_count=2000", "--max-splats", "4000"];
        let busy = ["--system", "splat", "--set", "densify_from=100", "--set", "densify_every=50"];
        let answer = train(Path::new("synthetic:tabletop"), &run, steps, &[&words, &busy]);
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(
            answer.out.contains("60 training views, 40x40") && answer.out.contains("held out (10"),
            "{}",
            answer.out
        );
        assert!(answer.out.contains("2000 Gaussians at random"), "{}", answer.out);
        assert!(run.join("report.html").exists() && run.join("renders").exists());
        run
    };
    let start = psnr(&at("1"));
    let run = at("300");
    let learnt = psnr(&run);
    println!("held out: {start:.2} dB after one step, {learnt:.2} dB after 300");
    assert!(start < 24.0 && learnt > 27.0, "{start} dB after one step, {learnt} dB after 300");

    let answer = nerf(&["eval", text(&run)]);
    assert!(answer.code == 0 && answer.out.contains("mean"), "{}{}", answer.out, answer.err);
    assert_eq!(psnr(&run), learnt, "`eval` measures the same");
    let report = fs::read_to_string(run.join("report.html")).unwrap();
    assert!(report.contains("Gaussians that no pixel sees") && report.contains("max_splats = 4000"));
}

#[test]
fn a_run_of_splats_is_rendered_and_exported() {
    let (folder, run) = trained();
    let path = |name: &str| folder.path().join(name);
    let frames = path("frames");
    let render = ["render", text(&run), "--path", "orbit", "--frames", "3", "--out", text(&frames)];
    let answer = nerf(&[&render[..], &["--layers", "colour,depth,opacity,normals"]].concat());
    assert_eq!(answer.code, 0, "{}", answer.err);
    for layer in ["colour", "depth", "opacity", "normals"] {
        let picture = image::open(frames.join(format!("{layer}_0002.png"))).unwrap().into_rgb8();
        assert_eq!(picture.dimensions(), (24, 24));
        assert!(picture.as_raw().iter().any(|&x| x != picture.as_raw()[0]), "{layer} shows something");
    }

    let (_, ply) = exported(&run, "x.ply");
    let n = ply.cloud.len();
    assert!((1..=400).contains(&n) && n != 200, "{n}: density control ran");
    all_finite(&ply);
    for name in ["x.splat", "x.spz"] {
        let (_, other) = exported(&run, name);
        assert_eq!(other.cloud.len(), n, "{name}");
        all_finite(&other);
    }
    let points = path("points.ply");
    let answer = nerf(&["export", text(&run), "--points", text(&points), "--count", "100"]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(Ply::read(&points).unwrap().element("vertex").unwrap().count <= 100);

    let mesh = path("mesh.ply");
    let density = ["export", text(&run), "--mesh", text(&mesh), "--method", "density"];
    let answer = nerf(&density);
    assert!(answer.code == 1 && error_line(&answer).contains("Gaussians have no density"), "{}", answer.err);
    assert!(error_line(&answer).contains("`--method tsdf`") && !mesh.exists(), "{}", answer.err);
    let unknown = path("x.obj");
    let answer = nerf(&["export", text(&run), "--splats", text(&unknown)]);
    assert!(answer.code == 1 && error_line(&answer).contains("x.obj") && !unknown.exists(), "{}", answer.err);
}

/// Gaussians on a ball of radius 1, small and opaque, as a `.splat` file.
fn ball(path: &Path) {
    let n = 2000;
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let mut bytes = Vec::new();
    for i in 0..n {
        let z = 1.0 - 2.0 * (f64::from(i) + 0.5) / f64::from(n);
        let (r, turn) = ((1.0 - z * z).sqrt(), golden * f64::from(i));
        let x = [r * turn.cos(), r * turn.sin(), z];
        x.iter().for_each(|x| bytes.extend((*x as f32).to_le_bytes()));
        (0..3).for_each(|_| bytes.extend(0.06_f32.to_le_bytes()));
        bytes.extend(x.map(|x| (127.0 + 120.0 * x) as u8));
        bytes.extend([250, 255, 128, 128, 128]);
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn a_file_of_gaussians_becomes_a_mesh_and_points() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    ball(&path("ball.splat"));
    for name in ["m.ply", "m.obj", "m.glb"] {
        let words =
            ["export", text(&path("ball.splat")), "--mesh", text(&path(name)), "--triangles", "900"].map(String::from);
        let answer = nerf(&[&words.each_ref().map(String::as_str)[..], &["--resolution", "40"]].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(answer.out.contains("box: (-1.") && answer.out.contains("triangles"), "{}", answer.out);
        assert_eq!(answer.out.contains("glTF has y up"), name == "m.glb", "{}", answer.out);
    }
    let mesh = Ply::read(&path("m.ply")).unwrap();
    let faces = mesh.element("face").unwrap().count;
    assert!((600..=900).contains(&faces), "{faces}");
    let vertex = mesh.element("vertex").unwrap();
    let [x, y, z] = ["x", "y", "z"].map(|axis| vertex.scalars(axis).unwrap());
    for i in 0..vertex.count {
        let r = (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
        assert!((r - 1.0).abs() < 0.12, "{r}");
    }
    let obj = fs::read_to_string(path("m.obj")).unwrap();
    assert_eq!(obj.lines().filter(|l| l.starts_with("f ")).count(), faces);
    assert_eq!(&fs::read(path("m.glb")).unwrap()[..4], b"glTF");

    let ply = path("ball.splat");
    let half = ["export", text(&ply), "--points", text(&path("p.ply")), "--box", "0,-2,-2,2,2,2"].map(String::from);
    let answer = nerf(&half.each_ref().map(String::as_str));
    assert_eq!(answer.code, 0, "{}", answer.err);
    assert!(answer.out.contains("box: (0.0000, -2.0000"), "{}", answer.out);
    let points = Ply::read(&path("p.ply")).unwrap();
    let vertex = points.element("vertex").unwrap();
    assert!(vertex.column("nx").is_some() && vertex.column("red").is_some());
    let x = vertex.scalars("x").unwrap();
    assert!(x.len() > 100 && x.iter().all(|&x| x >= 0.0));

    // Another format of the same, and what needs photos.
    let answer = nerf(&["export", text(&ply), "--splats", text(&path("ball.spz"))]);
    assert!(answer.code == 0 && read_splats(&path("ball.spz")).unwrap().cloud.len() == 2000, "{}", answer.err);
    for words in [["--frames", "f"], ["--cameras", "c.json"]] {
        let answer = nerf(&[&["export", text(&ply)][..], &words].concat());
        assert!(answer.code == 1 && error_line(&answer).contains("has no photos"), "{}", answer.err);
    }
    let answer = nerf(&["export", text(&ply), "--mesh", text(&path("m.stl"))]);
    assert!(answer.code == 1 && error_line(&answer).contains(".ply, .obj or .glb"), "{}", answer.err);
    let empty = ["--box", "50,50,50,51,51,51"];
    let answer = nerf(&[&["export", text(&ply), "--mesh", text(&path("e.ply"))][..], &empty].concat());
    assert!(answer.code == 1 && error_line(&answer).contains("`--box`"), "{}", answer.err);
}

/// Largest and mean difference of two pictures, of 255.
fn apart(a: &Path, b: &Path) -> (u8, f64) {
    let [a, b] = [a, b].map(|path| image::open(path).unwrap().into_rgb8());
    assert_eq!(a.dimensions(), b.dimensions());
    let differences: Vec<u8> = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| a.abs_diff(*b)).collect();
    let mean = differences.iter().map(|&d| f64::from(d)).sum::<f64>() / differences.len() as f64;
    (differences.into_iter().max().unwrap(), mean)
}

#[test]
fn a_file_looks_like_the_run_it_was_exported_from() {
    let (folder, run) = trained();
    let path = |name: &str| folder.path().join(name);
    let cameras = path("cameras.json");
    assert_eq!(nerf(&["export", text(&run), "--cameras", text(&cameras)]).code, 0);
    let drawn = |what: &Path, out: &str| {
        let out = path(out);
        let words = ["render", text(what), "--path", text(&cameras), "--error-budget", "0", "--out", text(&out)];
        let answer = nerf(&[&words[..], &["--layers", "colour,depth,opacity,normals"]].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        out
    };
    let own = drawn(&run, "own");
    let colour = image::open(own.join("colour_0000.png")).unwrap().into_rgb8();
    let bright = colour.as_raw().iter().filter(|&&x| x > 40).count();
    assert!(bright > 100, "{bright} of 1728: there is something to compare");
    // Rounding to `f32` of the scene's frame; rounding to bytes.
    for (name, most, mean) in [("x.ply", 2, 0.05), ("x.spz", 40, 1.5)] {
        let (file, _) = exported(&run, name);
        let other = drawn(&file, &format!("{name}.frames"));
        // A camera in front, one across, and a held-out one.
        for picture in ["colour_0000.png", "colour_0003.png", "colour_0007.png", "opacity_0003.png"] {
            let found = apart(&own.join(picture), &other.join(picture));
            println!("{name}, {picture}: {found:?}");
            assert!(found.0 <= most && found.1 <= mean, "{name}, {picture}: {found:?}");
        }
    }
    let (file, _) = exported(&run, "x.ply");
    let frames = path("orbit");
    let answer = nerf(&[
        "render",
        text(&file),
        "--path",
        "orbit",
        "--frames",
        "2",
        "--longest-side",
        "32",
        "--out",
        text(&frames),
    ]);
    assert_eq!(answer.code, 0, "{}", answer.err);
    let picture = image::open(frames.join("colour_0001.png")).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (32, 18));
    assert!(picture.as_raw().iter().any(|&x| x > 40), "the orbit looks at it");
    for path in ["spiral", "hold:r_0"] {
        let answer = nerf(&["render", text(&file), "--path", path, "--out", text(&frames)]);
        assert!(answer.code == 1 && error_line(&answer).contains("no photos"), "{}", answer.err);
    }
}

#[test]
fn files_that_hold_no_gaussians_are_one_clear_line() {
    let (folder, run) = trained();
    let path = |name: &str| folder.path().join(name);
    let points = path("points.ply");
    assert_eq!(nerf(&["export", text(&run), "--points", text(&points)]).code, 0);
    let (ply, _) = exported(&run, "x.ply");
    let (spz, _) = exported(&run, "x.spz");
    let (splat, _) = exported(&run, "x.splat");
    let half = |from: &Path| {
        let bytes = fs::read(from).unwrap();
        bytes[..bytes.len() / 2 + 1].to_vec()
    };
    let renamed = |from: &str, to: &str| {
        let bytes = fs::read(&ply).unwrap();
        let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("the header names it");
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    let header = [b"NGSP".as_slice(), &9_u32.to_le_bytes(), &0_u32.to_le_bytes(), &[0, 8, 0, 0]].concat();
    // A gzip member of one block that is stored, not packed.
    let stored = [&[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255, 1, 16, 0, 239, 255], header.as_slice()].concat();
    for (name, bytes, part) in [
        ("points.ply", fs::read(&points).unwrap(), "points.ply"),
        ("half.ply", half(&ply), "cut off"),
        ("half.spz", half(&spz), "cut off"),
        ("half.splat", half(&splat), "not a multiple of 32"),
        ("header.ply", b"ply\nformat binary_little_endian 1.0\n".to_vec(), "header.ply"),
        ("foreign.ply", renamed("float opacity", "float roughly"), "opacity"),
        ("words.ply", renamed("element vertex", "element wortex"), "wortex"),
        ("packed.spz", stored, "version 9"),
        ("bare.spz", header, "version 9"),
        ("empty.ply", Vec::new(), "empty.ply"),
        ("noise.spz", vec![7; 1000], "noise.spz"),
        ("photo.jpg", vec![0xff, 0xd8, 0xff], "photo.jpg"),
    ] {
        let file = path(name);
        fs::write(&file, bytes).unwrap();
        let frames = path("frames");
        let answer = nerf(&["render", text(&file), "--path", "orbit", "--frames", "1", "--out", text(&frames)]);
        assert_eq!(answer.code, 1, "{name}: {}{}", answer.out, answer.err);
        let line = error_line(&answer);
        println!("{line}");
        assert!(line.contains(name) && line.contains(part), "{name}: `{part}` is not in: {line}");
        assert!(!frames.exists(), "{name}: nothing was drawn");
    }
}

#[test]
fn max_splats_holds_from_the_first_step_to_the_last() {
    for control in [&ADC[..], &MCMC] {
        let density = control[1];
        let (folder, scene) = dataset();
        let limited = ["--system", "splat", "--max-splats", "50", "--set", "start_count=2000"];
        for steps in ["1", "60"] {
            let run = folder.path().join(steps);
            let answer = train(&scene, &run, steps, &[&limited, &BUSY, control]);
            assert_eq!(answer.code, 0, "{}", answer.err);
            assert!(answer.out.contains("start: 50 Gaussians at random"), "{}", answer.out);
            assert!(answer.out.contains("at most 50 Gaussians"), "{}", answer.out);
            let n = exported(&run, "x.ply").1.cloud.len();
            // Those at the start; later no more, though some may have gone.
            assert!(if steps == "1" { n == 50 } else { (25..=50).contains(&n) }, "{density}, {steps} steps: {n}");
        }
    }
    // Room for more is used.
    for control in [&ADC[..], &MCMC] {
        let density = control[1];
        let (folder, scene) = dataset();
        let run = folder.path().join("run");
        let roomy = ["--system", "splat", "--max-splats", "90", "--set", "start_count=50"];
        assert_eq!(train(&scene, &run, "200", &[&roomy, &BUSY, control]).code, 0);
        let n = exported(&run, "x.ply").1.cloud.len();
        assert!((51..=90).contains(&n), "{density}: {n}");
    }
}

#[test]
fn a_resumed_run_of_splats_makes_the_same_bits() {
    let (folder, scene) = dataset();
    for control in [&ADC[..], &MCMC] {
        let density = control[1];
        let [whole, halves] = ["whole", "halves"].map(|name| folder.path().join(format!("{name} {density}")));
        let resets: &[&str] = if control.len() > 2 { &["--set", "reset_every=15"] } else { &[] };
        let settings = ["--system", "splat", "--set", "start_count=200", "--max-splats", "2000"];
        let words = [&settings[..], control, resets, &BUSY].concat();
        assert_eq!(train(&scene, &whole, "40", &[&words]).code, 0);
        assert_eq!(train(&scene, &halves, "21", &[&words]).code, 0);
        let half = exported(&halves, "half.ply").1.cloud.len();
        let answer = nerf(&["train", "--resume", "--out", text(&halves), "--steps", "40", "--progress", "off"]);
        assert!(answer.code == 0 && answer.out.contains("resumed at step 21"), "{}{}", answer.out, answer.err);
        let end = exported(&halves, "end.ply").1.cloud.len();
        assert!(half != 200 && end != half, "{density}: {half} Gaussians halfway, {end} at the end");
        assert!(arrays(&whole, 40) == arrays(&halves, 40), "{density}: the same bits");
    }
}

#[test]
fn max_splats_must_be_a_number_that_works() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    for (word, code) in [("0", 2), ("-3", 2), ("many", 2), ("99999999999", 2)] {
        let answer = train(&scene, &run, "1", &[&["--system", "splat", &format!("--max-splats={word}")]]);
        assert_eq!(answer.code, code, "{word}: {}", answer.err);
        assert!(answer.err.contains("--max-splats"), "{word}: {}", answer.err);
    }
    for setting in ["max_splats=0", "max_splats=50000001", "densify_every=0", "sh_degree=4", "start=\"anywhere\""] {
        let answer = train(&scene, &run, "1", &[&["--system", "splat", "--set", setting]]);
        assert_eq!(answer.code, 1, "{setting}: {}", answer.err);
        let name = setting.split('=').next().unwrap();
        assert!(error_line(&answer).contains(name), "{setting}: {}", answer.err);
    }
    assert!(!run.join("checkpoint").exists());
    // Other systems have no such setting.
    let answer = train(&scene, &run, "1", &[&["--system", "ngp", "--max-splats", "10"]]);
    assert!(answer.code == 1 && error_line(&answer).contains("max_splats"), "{}", answer.err);
}

/// Somebody else's cloud, of a room; nothing is known of the cameras it was trained with.
#[test]
fn a_trained_cloud_is_drawn_upright() {
    let path = "gaussian_ply/trained_iteration_7000/point_cloud/iteration_7000/point_cloud.ply";
    let Some(file) = testkit::golden::data_or_skip(env!("CARGO_MANIFEST_DIR"), path, "splats") else { return };
    let folder = tempfile::tempdir().unwrap();
    let drawn = |path: &str, words: &[&str]| {
        let out = folder.path().join("frames");
        let fixed = ["render", text(&file), "--path", path, "--longest-side", "240", "--out", text(&out)];
        let answer = nerf(&[&fixed, words].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        assert!(answer.out.contains("9080 Gaussians"), "{}", answer.out);
        move |i: usize| image::open(out.join(format!("colour_{i:04}.png"))).unwrap().into_rgb8()
    };
    let frame = drawn("orbit", &["--frames", "3"]);
    for i in 0..3 {
        let picture = frame(i);
        assert_eq!(picture.dimensions(), (240, 135));
        let lit = picture.pixels().filter(|p| p.0.iter().any(|&c| c > 40)).count();
        assert!(lit > 240 * 135 / 2, "frame {i}: {lit} pixels show something");
        let colours: std::collections::HashSet<_> = picture.pixels().map(|p| p.0.map(|c| c / 16)).collect();
        assert!(colours.len() > 50, "frame {i}: {} colours", colours.len());
    }
    // From within, level: structure from motion has y down and starts at a photo that looks along z.
    let cameras = folder.path().join("cameras.json");
    let level = "[[1,0,0,0],[0,-1,0,0],[0,0,-1,0],[0,0,0,1]]";
    let text = format!(r#"{{"camera_angle_x":1.1,"w":480,"h":360,"frames":[{{"transform_matrix":{level}}}]}}"#);
    fs::write(&cameras, text).unwrap();
    let picture = drawn(cameras.to_str().unwrap(), &[])(0);
    assert_eq!(picture.dimensions(), (240, 180));
    let mut lamps: Vec<(u32, u32)> =
        picture.enumerate_pixels().map(|(_, y, p)| (p.0.iter().map(|&c| u32::from(c)).sum(), y)).collect();
    lamps.sort_unstable_by(|a, b| b.cmp(a));
    lamps.truncate(100);
    let low = lamps.iter().filter(|(_, y)| *y > 60).count();
    assert_eq!(low, 0, "the lamps are on the ceiling");
}

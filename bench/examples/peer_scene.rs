//! A dataset as a folder that other programs read, too: `transforms.json` of nerfstudio and pictures as they are trained on.
//!
//! ```text
//! cargo run --release -p bench --example peer_scene -- SCENE OUT [--holdout WHICH] [--longest-side PX] [--behind black]
//! ```
//!
//! Pictures are PNG files at the size that they are trained at, those with alpha on white or black. They are cut where the principal point is not in
//! the middle, by whole pixels: there are programs that take the middle for it. No pixel changes, and lenses stay as they are.
//! Held-out frames stand in `test_filenames`.

use clap::Parser;
use engine::options::{Background, DataOptions};
use engine::picture::over_background;
use image::RgbImage;
use render_core::camera::Camera;
use scene_io::export::write_transforms;
use scene_io::{Frame, ImageSource, ImageStore, Split, StoreOptions};
use serde_json::{Value, json};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Parser)]
#[command(about = "A dataset as a folder that other programs read, too: nerfstudio's transforms.json and PNG pictures")]
struct Args {
    /// Dataset folder or file
    scene: String,
    /// Folder that is written
    out: PathBuf,
    /// Frames held out, as in `train --holdout` (default: the dataset's own)
    #[arg(long)]
    holdout: Option<String>,
    /// Longest side of the pictures, pixels
    #[arg(long)]
    longest_side: Option<u32>,
    /// What is behind pictures with alpha: `white` or `black`
    #[arg(long, default_value = "white", value_parser = ["white", "black"])]
    behind: String,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<String, Box<dyn Error>> {
    let data = DataOptions { holdout: args.holdout.clone(), longest_side: args.longest_side, ..DataOptions::default() };
    let scene = engine::source::load(&args.scene, &data)?;
    let store = ImageStore::new(&scene.frames, StoreOptions::default().with_longest_side(args.longest_side))?;
    let behind = if args.behind == "black" { Background::Black } else { Background::White }.colour();
    let measured = if scene.split(Split::Test).next().is_some() { Split::Test } else { Split::Val };
    let pictures = args.out.join("images");
    std::fs::create_dir_all(&pictures).map_err(|e| format!("cannot write `{}`: {e}", pictures.display()))?;
    let mut frames = Vec::new();
    for (i, frame) in
        scene.frames.iter().enumerate().filter(|(_, frame)| [Split::Train, measured].contains(&frame.split))
    {
        let (picture, camera) = centred(&over_background(store.get(i)?.as_ref(), behind), store.camera(i));
        let path = pictures.join(file_name(i, &frame.name));
        picture.save(&path).map_err(|e| format!("cannot write `{}`: {e}", path.display()))?;
        let mut written = Frame::new(frame.name.clone(), ImageSource::File(path), camera);
        written.split = frame.split;
        frames.push(written);
    }
    let file = args.out.join("transforms.json");
    write_transforms(&file, &frames)?;
    name_splits(&file, &frames)?;
    let count = |split| frames.iter().filter(|frame| frame.split == split).count();
    let size = frames.first().map_or_else(String::new, |f| format!(", {}x{}", f.camera.width, f.camera.height));
    Ok(format!("{}: {} training frames, {} held out{size}", args.out.display(), count(Split::Train), count(measured)))
}

/// Whole columns and rows cut off, so that the principal point is in the middle but for half a pixel.
fn centred(picture: &RgbImage, camera: &Camera) -> (RgbImage, Camera) {
    // How many more there are before the principal point than behind it.
    let more = |c: f64, n: u32| (2.0 * c - f64::from(n)).round().clamp(-f64::from(n / 2), f64::from(n / 2));
    let [x, y] = [more(camera.cx, camera.width), more(camera.cy, camera.height)];
    let [left, top] = [x, y].map(|n| n.max(0.0));
    let (width, height) = (camera.width - x.abs() as u32, camera.height - y.abs() as u32);
    let cut = image::imageops::crop_imm(picture, left as u32, top as u32, width, height).to_image();
    (cut, Camera { width, height, cx: camera.cx - left, cy: camera.cy - top, ..*camera })
}

/// A file name that no other frame has.
fn file_name(i: usize, name: &str) -> String {
    let stem = Path::new(name).with_extension("");
    let stem: String =
        stem.to_string_lossy().chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    format!("{i:04}_{}.png", stem.trim_matches('_'))
}

/// Write into the file which frames are trained on and which are held out, and the camera model of all: readers want one.
fn name_splits(file: &Path, frames: &[Frame]) -> Result<(), Box<dyn Error>> {
    let mut top: Value = serde_json::from_slice(&std::fs::read(file)?)?;
    let model = top["frames"][0]["camera_model"].clone();
    let paths: Vec<Value> =
        top["frames"].as_array().into_iter().flatten().map(|frame| frame["file_path"].clone()).collect();
    let named = |trained: bool| -> Vec<&Value> {
        let wanted = |frame: &Frame| (frame.split == Split::Train) == trained;
        paths.iter().zip(frames).filter(|(_, frame)| wanted(frame)).map(|(path, _)| path).collect()
    };
    let (train, test) = (json!(named(true)), json!(named(false)));
    top["camera_model"] = model;
    top["train_filenames"] = train;
    top["test_filenames"] = test;
    std::fs::write(file, format!("{top:#}\n")).map_err(|e| format!("cannot write `{}`: {e}", file.display()))?;
    Ok(())
}

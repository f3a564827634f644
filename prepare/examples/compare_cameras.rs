//! How far the cameras of one dataset are from those of another, after alignment: `compare_cameras TRUTH FOUND`. Photos are
//! told by the last part of their names; where `FOUND` was made from a video (frames `00001.jpg` and so on), `--in-order` takes
//! them in the order of names instead.

use render_core::camera::Pose;
use scene_io::{LoadOptions, MissingImages, load};
use std::path::Path;
use std::process::ExitCode;

fn main() -> ExitCode {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let in_order = words.iter().any(|w| w == "--in-order");
    words.retain(|w| w != "--in-order");
    let [truth, found] = &words[..] else {
        eprintln!("usage: compare_cameras TRUTH FOUND [--in-order]");
        return ExitCode::from(2);
    };
    match (cameras(truth), cameras(found)) {
        (Ok(mut truth), Ok(found)) => {
            if in_order {
                for (i, (name, _)) in truth.iter_mut().enumerate() {
                    *name = format!("{:05}", i + 1);
                }
            }
            match prepare::compare(&truth, &found) {
                Some(c) => {
                    println!("{} of {} photos compared", c.common, truth.len());
                    println!("rotation: mean {:.3}, largest {:.3} degrees", c.rotation_mean, c.rotation_max);
                    println!(
                        "centres: mean {:.3} %, largest {:.3} % of their mean distance from the middle",
                        100.0 * c.centre_mean,
                        100.0 * c.centre_max
                    );
                    ExitCode::SUCCESS
                }
                None => {
                    eprintln!("error: the two have no cameras in common that could be aligned");
                    ExitCode::FAILURE
                }
            }
        }
        (Err(error), _) | (_, Err(error)) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Stems of the photos' names with their poses, sorted by name.
fn cameras(path: &str) -> Result<Vec<(String, Pose)>, scene_io::SceneError> {
    let options = LoadOptions::default().with_missing_images(MissingImages::Skip);
    let scene = load(Path::new(path), &options)?;
    let stem = |name: &str| Path::new(name).file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned());
    let mut cameras: Vec<(String, Pose)> = scene.frames.iter().map(|f| (stem(&f.name), f.camera.pose)).collect();
    cameras.sort_by(|a, b| a.0.cmp(&b.0));
    Ok(cameras)
}

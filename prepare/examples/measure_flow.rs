//! How long flow between two pictures takes, and how far it is from one that is known: `measure_flow FIRST SECOND [FLOW.flo]`.

use prepare::flow::flow_both_ways;
use render_core::camera::{Camera, Pose};
use scene_io::{Flow, Frame, Image, ImageSource, SceneError, decode_photo};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Instant;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let ([first, second], known) = match &words[..] {
        [first, second] => ([first, second], None),
        [first, second, known] => ([first, second], Some(known)),
        _ => {
            eprintln!("usage: measure_flow FIRST SECOND [FLOW.flo]");
            return ExitCode::from(2);
        }
    };
    match measure(Path::new(first), Path::new(second), known.map(Path::new)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(first: &Path, second: &Path, known: Option<&Path>) -> Result<(), SceneError> {
    let (first, second) = (picture(first)?, picture(second)?);
    if first.size() != second.size() {
        eprintln!("the pictures are {} and {}: flow needs two of one size", first.size(), second.size());
        return Ok(());
    }
    let since = Instant::now();
    let [forward, _] = flow_both_ways(&first, &second);
    let pixels = first.size().pixels() as f64;
    println!(
        "{} both ways in {:.2} s; {:.1} % can be relied on",
        first.size(),
        since.elapsed().as_secs_f64(),
        100.0 * forward.seen.count() as f64 / pixels
    );
    if let Some(known) = known {
        let (width, height) = (first.width, first.height);
        let focal = f64::from(width);
        let (cx, cy) = (0.5 * focal, 0.5 * f64::from(height));
        let camera = Camera::pinhole(width, height, focal, focal, cx, cy, Pose::IDENTITY);
        let mut frame = Frame::new("first", ImageSource::Memory(Arc::new(first)), camera);
        frame.priors.motion.forward = Some(known.to_path_buf());
        if let Some(known) = frame.read_flow_prior()?.forward {
            compare(&forward, &known.resized(width, height));
        }
    }
    Ok(())
}

fn picture(path: &Path) -> Result<Image, SceneError> {
    let picture = decode_photo(path)?.into_rgb8();
    let (width, height) = picture.dimensions();
    Ok(Image { width, height, channels: 3, data: picture.into_raw(), mask: None })
}

/// End-point errors where both are known.
fn compare(flow: &Flow, known: &Flow) {
    let both = flow.seen.iter().zip(known.seen.iter()).map(|(a, b)| a && b);
    let pairs = flow.vectors.iter().zip(&known.vectors).zip(both).filter(|(_, is_known)| *is_known);
    let mut errors: Vec<f32> = pairs.map(|((a, b), _)| (a[0] - b[0]).hypot(a[1] - b[1])).collect();
    errors.sort_by(f32::total_cmp);
    let Some(last) = errors.len().checked_sub(1) else {
        println!("no pixel is known in both");
        return;
    };
    let share = |part: f64| errors[(part * last as f64).round() as usize];
    let mean = errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64;
    println!(
        "distance from the known flow, pixels: median {:.3}, mean {mean:.3}, 90 % below {:.3}, 99 % below {:.3}",
        share(0.5),
        share(0.9),
        share(0.99)
    );
}

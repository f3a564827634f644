//! Writes a drawn scene with its truth: `cargo run --release -p wildfield-scene-io --example draw -- orbit FOLDER`.

use scene_io::synthetic::{
    MouthOptions, OrbitOptions, TissueDepth, TissueOptions, write_mouth, write_orbit, write_tissue,
};
use std::process::ExitCode;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [name, folder] = arguments.as_slice() else {
        eprintln!("usage: draw orbit|mouth|tissue FOLDER");
        return ExitCode::from(2);
    };
    let written = match name.as_str() {
        "orbit" => write_orbit(&OrbitOptions { val: 6, ..OrbitOptions::default() }, folder.as_ref()),
        "mouth" => write_mouth(&MouthOptions::default(), folder.as_ref()),
        "tissue" => write_tissue(&TissueOptions::default(), TissueDepth::Npy, folder.as_ref()),
        other => {
            eprintln!("there is no drawn scene `{other}`: write `orbit`, `mouth` or `tissue`");
            return ExitCode::from(2);
        }
    };
    match written {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

//! What must hold of anything that is read from files.
//!
//! A [`Door`] is a place where bytes of unknown origin come in. It opens to a function that takes any bytes and panics
//! where something does not hold: a reader that panics, an error that is not one line or does not name its file, numbers
//! that are not finite, cameras that cannot see, lengths that disagree. The fuzz targets call these functions with bytes
//! that nobody wrote; `tests/replay.rs` calls them with the corpus of the fuzzers, so that what was mended stays mended.
//!
//! Most doors are folders: there the first byte of the input says which file of a small valid folder is replaced by what
//! follows the second byte, and the second byte how the folder is read; see [`folder`]. Both are printable in the corpus:
//! they are counted from `0`.

mod checkpoint;
mod config;
mod dialects;
mod folder;
mod mutate;
mod path;
mod run_files;
mod scenes;
mod seeds;
mod sound;
mod splats;
mod viewer;

pub use mutate::mutate;

/// Takes bytes and panics where something does not hold.
pub type Try = Box<dyn FnMut(&[u8])>;

/// A place where files come in.
pub struct Door {
    /// Of the fuzz target and the folder of its corpus.
    pub name: &'static str,
    /// Makes what the bytes are read with: a folder that goes when the function goes.
    pub open: fn() -> Try,
    /// Inputs that are valid, each with a name for its file: where a corpus starts.
    pub seeds: fn() -> Vec<(String, Vec<u8>)>,
}

/// A door to a folder of a dataset.
macro_rules! dataset {
    ($name:literal, $scene:path) => {
        Door { name: $name, open: || dialects::open($scene), seeds: || seeds::of_scene($scene) }
    };
}

/// All doors, by name.
pub const DOORS: [Door; 20] = [
    Door { name: "camera_path", open: path::open, seeds: seeds::camera_path },
    Door { name: "checkpoint", open: checkpoint::open, seeds: checkpoint::seeds },
    Door { name: "config", open: config::open, seeds: seeds::config },
    dataset!("dialect_blender", scenes::blender),
    dataset!("dialect_colmap_binary", scenes::colmap_binary),
    dataset!("dialect_colmap_text", scenes::colmap_text),
    dataset!("dialect_endonerf", scenes::endonerf),
    dataset!("dialect_hdr_hexplane", scenes::hdr_hexplane),
    dataset!("dialect_instant_ngp", scenes::instant_ngp),
    dataset!("dialect_llff", scenes::llff),
    dataset!("dialect_nerfies", scenes::nerfies),
    dataset!("dialect_nerfstudio", scenes::nerfstudio),
    dataset!("dialect_nr_nerf", scenes::nr_nerf),
    dataset!("maps", scenes::maps),
    dataset!("priors", scenes::priors),
    Door { name: "run_files", open: run_files::open, seeds: seeds::run_files },
    Door { name: "splat_ply", open: || Box::new(|bytes| drop(splats::read("fuzz.ply", bytes))), seeds: Vec::new },
    Door { name: "splat_splat", open: || Box::new(splats::records), seeds: Vec::new },
    Door { name: "splat_spz", open: || Box::new(splats::gzip), seeds: Vec::new },
    Door { name: "viewer", open: viewer::open, seeds: seeds::viewer },
];

/// The door of a name.
///
/// # Panics
/// Where there is none.
#[must_use]
pub fn open(name: &str) -> Try {
    let door = DOORS.iter().find(|door| door.name == name).unwrap_or_else(|| panic!("there is no door `{name}`"));
    (door.open)()
}

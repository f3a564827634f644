//! What must hold of anything that is read from files.
//!
//! A [`Door`] is a place where bytes of unknown origin come in. It opens to a function that takes any bytes and panics
//! where something does not hold: a reader that panics, an error that is not one line or does not name its file, numbers
//! that are not finite, cameras that cannot see, lengths that disagree. The fuzz targets call these functions with bytes
//! that nobody wrote; `tests/replay.rs` calls them with the corpus of the fuzzers, so that what was mended stays mended.
//!
//! Most doors are folders: there the first byte of the input says which file of a small valid folder is replaced by what
//! follows the second byte, and the second byte how the folder is read; see `folder.rs`. Both are printable in the corpus:
//! they are counted from `0`.

mod checkpoint;
mod config;
mod dialects;
mod folder;
mod mutate;
mod path;
mod photos;
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

/// Opens doors, one function each: a fuzz target holds the code of its own door and no other.
pub mod open {
    use crate::{Try, checkpoint, config, dialects, path, photos, run_files, scenes, splats, viewer};

    macro_rules! doors {
        ($($name:ident: $open:expr;)*) => {
            $(
                #[doc = concat!("The door `", stringify!($name), "`.")]
                #[must_use]
                pub fn $name() -> Try {
                    $open
                }
            )*
        };
    }

    doors! {
        camera_path: path::open();
        checkpoint: checkpoint::open();
        config: config::open();
        dialect_blender: dialects::open(scenes::blender);
        dialect_colmap_binary: dialects::open(scenes::colmap_binary);
        dialect_colmap_text: dialects::open(scenes::colmap_text);
        dialect_endonerf: dialects::open(scenes::endonerf);
        dialect_hdr_hexplane: dialects::open(scenes::hdr_hexplane);
        dialect_instant_ngp: dialects::open(scenes::instant_ngp);
        dialect_llff: dialects::open(scenes::llff);
        dialect_nerfies: dialects::open(scenes::nerfies);
        dialect_nerfstudio: dialects::open(scenes::nerfstudio);
        dialect_nr_nerf: dialects::open(scenes::nr_nerf);
        maps: dialects::open(scenes::maps);
        photo: photos::open();
        priors: dialects::open(scenes::priors);
        run_files: run_files::open();
        splat_ply: Box::new(|bytes| drop(splats::read("fuzz.ply", bytes)));
        splat_splat: Box::new(splats::records);
        splat_spz: Box::new(splats::gzip);
        viewer: viewer::open();
    }
}

macro_rules! door {
    ($name:ident, $seeds:expr) => {
        Door { name: stringify!($name), open: open::$name, seeds: $seeds }
    };
}

/// All doors, by name.
pub const DOORS: [Door; 21] = [
    door!(camera_path, seeds::camera_path),
    door!(checkpoint, checkpoint::seeds),
    door!(config, seeds::config),
    door!(dialect_blender, || seeds::of_scene(scenes::blender)),
    door!(dialect_colmap_binary, || seeds::of_scene(scenes::colmap_binary)),
    door!(dialect_colmap_text, || seeds::of_scene(scenes::colmap_text)),
    door!(dialect_endonerf, || seeds::of_scene(scenes::endonerf)),
    door!(dialect_hdr_hexplane, || seeds::of_scene(scenes::hdr_hexplane)),
    door!(dialect_instant_ngp, || seeds::of_scene(scenes::instant_ngp)),
    door!(dialect_llff, || seeds::of_scene(scenes::llff)),
    door!(dialect_nerfies, || seeds::of_scene(scenes::nerfies)),
    door!(dialect_nerfstudio, || seeds::of_scene(scenes::nerfstudio)),
    door!(dialect_nr_nerf, || seeds::of_scene(scenes::nr_nerf)),
    door!(maps, || seeds::of_scene(scenes::maps)),
    door!(photo, photos::seeds),
    door!(priors, || seeds::of_scene(scenes::priors)),
    door!(run_files, seeds::run_files),
    door!(splat_ply, Vec::new),
    door!(splat_splat, Vec::new),
    door!(splat_spz, Vec::new),
    door!(viewer, seeds::viewer),
];

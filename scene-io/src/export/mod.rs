//! Points, meshes and cameras to files that other programs read.
//!
//! Everything is written in the frame and unit of the scene that was read. Files appear whole or not at all: they are
//! written under a temporary name, synced and renamed.
//!
//! * [`write_points`], [`write_mesh`]: PLY, binary little-endian; [`Ply`] reads such files back
//! * [`marching_cubes`]: a [`Mesh`] from any density
//! * [`write_transforms`], [`write_colmap`]: cameras

mod atomic;
mod cameras;
mod cells;
mod marching_cubes;
mod mesh;
mod ply;
mod ply_reader;

pub use atomic::write_atomically;
pub use cameras::{write_colmap, write_transforms};
pub use marching_cubes::{MeshGrid, marching_cubes};
pub use mesh::Mesh;
pub use ply::{PointCloud, write_mesh, write_points};
pub use ply_reader::{Column, Element, Ply};

//! Points, meshes and cameras to files that other programs read.
//!
//! Everything is written in the frame and unit of the scene that was read. Files appear whole or not at all: they are
//! written under a temporary name, synced and renamed.
//!
//! * [`write_points`]: PLY, binary little-endian; [`write_mesh`]: PLY, OBJ or GLB, by the name; [`Ply`] reads PLY back
//! * [`marching_cubes`]: a [`Mesh`] from any density
//! * [`write_transforms`], [`write_colmap`]: cameras

mod atomic;
mod cameras;
mod cells;
mod glb;
mod marching_cubes;
mod mesh;
mod mesh_file;
mod obj;
mod ply;
mod ply_reader;

pub use atomic::write_atomically;
pub use cameras::{write_colmap, write_transforms};
pub use cells::{EDGES as CELL_EDGES, patterns as cell_patterns};
pub use marching_cubes::{MeshGrid, marching_cubes};
pub use mesh::Mesh;
pub use mesh_file::{MeshFormat, write_mesh};
pub use ply::{PointCloud, write_points};
pub use ply_reader::{Column, Element, Ply};

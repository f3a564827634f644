//! Scenes made of formulas: exact truth for tests, data for a demo that needs no files.
//!
//! Rays are intersected with the shapes in closed form (or, for the torus and bent things, with roots refined to the last
//! bits), in `f64`. So depth and normals are exact, and the only approximation in the pictures is the number of rays for each
//! pixel.
//!
//! ```
//! use scene_io::synthetic::{Tabletop, TabletopOptions, tabletop};
//!
//! let options = TabletopOptions { width: 32, height: 24, train: 4, test: 2, ..TabletopOptions::default() };
//! let scene = tabletop(&options);
//! assert_eq!(scene.frames.len(), 6);
//!
//! // Truth for any camera: distance along the ray and outward normal where it hits.
//! let camera = &scene.frames[0].camera;
//! let hit = Tabletop::new(options.seed).trace(&camera.ray((16.5, 12.5).into()).unwrap()).unwrap();
//! assert!(hit.t > 2.0 && hit.t < 6.0 && (hit.normal.length() - 1.0).abs() < 1e-12);
//! ```

mod blender;
mod drawn;
mod files;
mod mouth;
mod orbit;
mod plaza;
mod polynomial;
mod shape;
mod snapshot;
mod surface;
mod tabletop;
mod tissue;

pub use blender::write_blender;
pub use drawn::Drawn;
pub use mouth::{Mouth, MouthOptions, mouth, mouth_views, write_mouth};
pub use orbit::{Orbit, OrbitCamera, OrbitMotion, OrbitOptions, orbit, orbit_views, write_orbit};
pub use plaza::{Light, PasserBy, Photo, PhotoTruth, Plaza, PlazaHit, PlazaOptions, plaza, plaza_photos};
pub use shape::{Placed, Shape};
pub use snapshot::{FlowMap, Form, Placement, Sight, Snapshot, SnapshotHit, SnapshotTruth, SnapshotView, Warp};
pub use surface::{Paint, Surface};
pub use tabletop::{Hit, Tabletop, TabletopOptions, ViewTruth, tabletop};
pub use tissue::{
    Stereo, StereoOcclusion, Tissue, TissueDepth, TissueHit, TissueOptions, TissueSnapshot, TissueTool, TissueTruth,
    tissue, tissue_camera, tissue_truth, write_tissue,
};

//! A ray to a pixel: cameras, rays, sampling, quadrature, occupancy, contraction, lighting, on the CPU.
//!
//! **Cameras**
//!
//! * [`camera`]: lens models, projection, rays, their derivatives, gradients of pose and intrinsics
//! * [`pose`]: camera poses, their file conventions and repair
//! * [`ray`]: a ray, the positions of samples on it, gradients back to it
//! * [`rig`]: what a set of cameras has in common: mean pose, up, focus point
//! * [`path`]: camera paths for rendering
//!
//! **Space**
//!
//! * [`bounds`]: boxes, rays through them, the extent of a scene
//! * [`contract`]: all of space into a ball or cube (mip-NeRF 360)
//! * [`ndc`]: normalised device coordinates of forward-facing scenes (NeRF)
//! * [`space_map`]: world to the coordinates of a field, for positions and rays, and back
//! * [`coverage`]: which points of a scene photos have seen
//!
//! **Sampling**
//!
//! * [`sample`]: stratified samples, and samples drawn from weights
//! * [`ray_distance`]: normalised distance along a ray
//! * [`histogram`]: histograms of weights, blurred and resampled (mip-NeRF)
//! * [`proposal`]: dilated and annealed proposals (mip-NeRF 360)
//! * [`occupancy`]: the occupancy grid and the march through it (Instant-NGP)
//! * [`frustum`]: conical frusta as Gaussians (mip-NeRF)
//! * [`importance`]: which pixels to cast rays through where tools hide parts of frames (EndoNeRF)
//!
//! **Compositing**
//!
//! * [`quadrature`]: volume rendering: weights, colours, depths, and the same for a static and a transient part together;
//!   [`Compositor`](quadrature::Compositor) for the usual case
//! * [`budget`]: work that may be left out, and a bound on the error of that
//! * [`induced_flow`]: where a neighbouring camera sees what a ray sees here (NSFF, DynamicNeRF)
//! * [`lighting`]: spherical-harmonic lighting and shading (NeRF-OSR)
//! * [`bilateral`]: depth smoothed, with its edges kept
//!
//! **Basics**
//!
//! * [`error`]: why an input was refused
//! * [`real`]: the two float types, for functions in both precisions
//! * [`symmetric`]: eigenvectors of small symmetric matrices
//!
//! Functions come in pairs: `f(inputs, out)` and `f_backward(inputs, out_bar, inputs_bar)`, which adds to gradients unless its
//! documentation says that it writes them. Poses are camera-to-world with CV axes (x right, y down, z forward), pixel centres
//! lie at `+ 0.5`, directions of rays are of unit length, angles in radians. Letters: `t` distance, `s` the same in `[0, 1]`,
//! `sigma` density, `tau = sigma * dt` optical depth, `w` weights, `trans` transmittance, `x_bar` the gradient of the loss with
//! respect to `x`.
//!
//! # Features
//! * `std` (default): float functions of the standard library.
//! * `libm`: those of `libm` instead, for `no_std` with `alloc`. One of the two is needed.
//! * `rayon`: tables of rays and gradients of cameras over threads, with the same bits for any number of them.
//!
//! ```
//! use render_core::camera::{Camera, Pose};
//! use render_core::quadrature::{Compositor, PixelsBar, RaySamples};
//! use render_core::sample::{Spacing, dt_from_points, stratified_bins};
//! use render_core::{Simd, glam::DVec2};
//! // The ray of a pixel, four samples on it, and red fog of density 0.5 along it.
//! let camera = Camera::pinhole(640, 480, 500.0, 500.0, 320.0, 240.0, Pose::IDENTITY);
//! let ray = camera.ray(DVec2::new(320.0, 240.0)).expect("a pinhole has a ray for every pixel");
//! let (mut t, mut dt) = ([0.0; 4], [0.0; 4]);
//! stratified_bins(1.0, 3.0, Spacing::Linear, &[0.0; 4], &mut t);
//! dt_from_points(&t, 3.0, &mut dt);
//! let (tau, rgb) = (dt.map(|dt| 0.5 * dt), [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
//! let mut compositor = Compositor::new(Simd::best());
//! let pixels = compositor.render(RaySamples { offsets: &[0, 4], t: &t, tau: &tau, rgb: &rgb });
//! assert!(ray.d.z == 1.0 && (pixels.rgb()[0] - (1.0 - (-1.0_f32).exp())).abs() < 1e-6);
//! assert!(pixels.backward(PixelsBar::of_rgb(&[1.0, 0.0, 0.0])).tau()[3] > 0.0);
//! ```
#![no_std]
#![forbid(unsafe_code)]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

#[cfg(not(any(feature = "std", feature = "libm")))]
compile_error!("render-core needs a float backend: enable `std` or `libm`");

pub mod bilateral;
pub mod bounds;
pub mod budget;
pub mod camera;
pub mod contract;
pub mod coverage;
pub mod error;
pub mod frustum;
pub mod histogram;
pub mod importance;
pub mod induced_flow;
pub mod lighting;
pub mod ndc;
pub mod occupancy;
pub mod path;
pub mod pose;
pub mod proposal;
pub mod quadrature;
pub mod ray;
pub mod ray_distance;
pub mod real;
pub mod rig;
pub mod sample;
pub mod space_map;
pub mod symmetric;

pub use float_core;
pub use float_core::Simd;
pub use glam;

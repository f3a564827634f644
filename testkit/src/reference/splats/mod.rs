//! 3D Gaussian splatting from its definitions: every pixel evaluates every Gaussian.
//!
//! [`project`](fn@project): raw parameters to ellipses. [`pixel`]: ellipses to a pixel, with how far its decisions were from falling
//! otherwise; [`smooth`](fn@smooth): the 3D filter before that. [`pixel_backward`]: the chain rule back; [`parameters_bar`]: from ellipses to raw parameters, by differences.
//!
//! # Shapes
//! Parameters are rows `[component][n]`: position 3, logarithm of size 3, rotation `wxyz` 4, logit of opacity 1, colour 3, and
//! `3 ((degree + 1)^2 - 1)` coefficients above it, three channels each.
//!
//! # Source
//! Kerbl et al., "3D Gaussian splatting for real-time radiance field rendering", 2023; Zwicker et al., "EWA splatting", 2002.

mod composite;
mod ellipse;
mod project;
mod smooth;
#[cfg(test)]
mod tests;

pub use composite::{EllipseBar, Picture, Pixel, draw, pixel, pixel_backward};
pub use ellipse::{Camera, Ellipse, Rules, front_to_back};
pub use project::{parameters_bar, project, project_one};
pub use smooth::smooth;

//! Systems for photographs from the wild: strangers in the picture, changing light.
//!
//! Each file is a [`Method`](crate::method::Method) that reads like its paper: what it adds to a radiance field, and its loss. All of them train
//! the fast field (`--field ngp`) or the published networks (`--field mlp`).
//!
//! | name | light of a photo | strangers |
//! | --- | --- | --- |
//! | `plain` | - | - |
//! | `nerf-a`, `nerf-u`, `nerf-w` | free codes, -, free codes | -, transient field, transient field |
//! | `ha-nerf-a`, `ha-nerf-t`, `ha-nerf` | encoder, -, encoder | -, visibility map, visibility map |
//! | `sf-nerf` | free codes | filter network in image space |
//! | `robust-nerf` | - | robust loss, and masks found again and again |
//! | `hugs` | - | masks found after a short training |
//! | `auto` | what the photos need | what the photos need |
//!
//! Light (`--set appearance=none|codes|encoder`) and strangers
//! (`--set occluders=none|robust|transient|visibility|filter|masks`) may be combined freely; a name is a pair of them.

mod chain;
mod check;
mod codes;
mod config;
mod consistency;
mod cover;
mod encoder;
mod expected;
mod filter;
mod glance;
mod guard;
mod ha_nerf;
mod hugs;
mod known;
mod light;
mod likelihood;
mod look;
mod nerf_w;
mod net;
mod photo_features;
mod photo_judge;
mod plan;
mod pretrained;
mod rates;
mod robust_nerf;
mod sf_nerf;
mod slopes;
mod static_maps;
mod thumbnail;
#[cfg(test)]
mod twin;
mod visibility;

pub use config::{AppearanceKind, FeatureKind, FieldKind, Freeze, KernelKind, OccluderKind, SegmentKind, WildConfig};
pub use known::{CLAIMS, SYSTEMS};
pub use plan::build;

use crate::method::PixelBar;
use engine::data::Dataset;
use losses::kernel::Kernel;

/// The squared error of a pixel, mean over channels, times `weight`, and its derivative.
fn squared(rgb: [f32; 3], truth: [f32; 3], weight: f32) -> (f32, PixelBar) {
    let e = [0, 1, 2].map(|c| rgb[c] - truth[c]);
    let loss = e.iter().map(|e| e * e).sum::<f32>() / 3.0;
    (weight * loss, PixelBar::colour(e.map(|e| weight * 2.0 * e / 3.0)))
}

/// `|C - Y|`.
fn residual(rgb: [f32; 3], truth: [f32; 3]) -> f32 {
    (0..3).map(|c| (rgb[c] - truth[c]).powi(2)).sum::<f32>().sqrt()
}

/// What the residual of a pixel costs, times `weight`, and its derivative. A third of the kernel, as the squared error is a mean
/// over channels.
fn robust(kernel: Kernel, rgb: [f32; 3], truth: [f32; 3], weight: f32) -> (f32, PixelBar) {
    if kernel == Kernel::Squared {
        return squared(rgb, truth, weight);
    }
    let e = residual(rgb, truth);
    // The derivative of kernel(|C - Y|) is its weight times the error.
    let w = weight * kernel.weight(e, 0.0) / 3.0;
    (weight * kernel.value(e, 0.0) / 3.0, PixelBar::colour([0, 1, 2].map(|c| w * (rgb[c] - truth[c]))))
}

/// Rays of a survey of all training photos, roughly: a second or two.
const SURVEY_RAYS: u64 = 300_000;

/// Whether `step` is `first`, twice as many, four times as many, and so on.
fn is_doubled(step: u64, first: u64) -> bool {
    step.is_multiple_of(first) && (step / first).is_power_of_two()
}

/// Pixels of a photo along a side of what a survey compares.
fn survey_stride(data: &Dataset) -> u32 {
    (data.pixel_count() as f64 / SURVEY_RAYS as f64).sqrt().ceil().max(1.0) as u32
}

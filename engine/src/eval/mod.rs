//! How good the held-out views are.
//!
//! Renders are clipped to `[0, 1]` and rounded to 8 bit; the truth is the 8-bit image at training resolution,
//! composited on the run's background. PSNR is over all three channels; SSIM is the reference variant (11x11 Gaussian
//! window, per channel, no border). Pixels that a mask ignores count in neither. Means are over views.
//!
//! Photos from the wild have an appearance of their own each: see [`protocol`](Protocol) for which one a view is rendered in, and
//! why right halves alone are scored then. Views are measured one after the other and none depends on another: a view's
//! scores are the same bits in whatever company and with however many threads. One kind compares two views, where the truth
//! is known ([`correspondence`]): a view has it only beside the other one.

pub mod correspondence;
mod evaluate;
mod fog;
mod half;
pub mod lpips_file;
mod masked;
pub mod masks;
mod measure;
mod motion;
mod protocol;
pub mod scales;
mod scene_flow;
mod score;
pub mod skips;
mod table;
mod view;

pub use crate::options::{EvalAppearance, Part};
pub(crate) use evaluate::need_halves;
pub use evaluate::{evaluate, evaluate_from};
pub use fog::{fog, opacity_before};
pub(crate) use half::pixels;
pub use motion::MotionScore;
pub use protocol::{FIT_LR, FIT_STEPS, Protocol, Scored};
pub(crate) use protocol::{need_codes, view_of};
pub use score::{Evaluation, KnownView, Measured, Measures, ViewScore};
pub use view::{Terms, ViewResult};

//! Systems of Gaussians: the driver over the pictures of photos, whatever a system is made of.
//!
//! | part | file |
//! | --- | --- |
//! | the frame that clouds are trained in, and where they begin | [`cloud_frame`], [`start`], `visual_hull` |
//! | parameters of a cloud, extra rows among them, and all that follows them | `cloud`, `place_codes`, `sample_places`, `optimiser`, `density_control`, `free_space` |
//! | nothing is drawn smaller than what photos show | `smoothing` |
//! | photos without distortion, how much their pixels count, how far away is what they show | `photo`, `undistortion`, `weights`, `photo_depth` |
//! | what a picture costs | `terms` |
//! | appearance of photos, and time; where points go | `hooks`, `flow` |
//! | the appearance of other photos; a cloud in one appearance | `appearance_fit`, `appearance_bake` |
//! | what photos show besides the scene; Gaussians that none of them needs | `surveys`, `uses` |
//! | where a training is in its schedule | the room `schedule` |
//! | pictures: drawn for a step, and rendered | `drawing`, `planes`, `pass`, `render` |
//!
//! A step (`driver.rs`, `pass.rs`):
//!
//! 1. a photo, each once before any comes again; how much its pixels count;
//! 2. the clouds at its time; projected together, coloured in its appearance, composited;
//! 3. the terms of the loss, and their gradients with respect to the planes of the picture;
//! 4. those taken back to the parameters of each cloud, of appearance and motion; a step of each one's optimiser;
//! 5. density control: what the gradients that it was given say of where Gaussians are missing.
//!
//! What is published under a name is in [`crate::papers::gaussians`]; clouds to look at are in [`crate::splats`].

mod appearance_bake;
mod appearance_fit;
mod camera_gradient;
#[cfg(test)]
mod camera_gradient_tests;
mod cloud;
pub mod cloud_frame;
mod cloud_parameters;
mod config;
mod density_config;
mod density_control;
mod drawing;
mod driver;
mod flow;
mod free_space;
mod front;
#[cfg(test)]
mod gradient_tests;
mod hooks;
mod layered;
mod memory;
mod optimiser;
pub(crate) mod outside;
mod pass;
mod photo;
mod photo_depth;
mod place_codes;
#[cfg_attr(not(test), allow(dead_code, reason = "parts that no published system is made of yet"))]
mod planes;
pub(crate) mod refine;
mod refusal;
mod render;
mod sample_places;
mod skipped;
pub(crate) mod sky;
mod smoothing;
pub mod start;
mod surveys;
mod system;
mod terms;
#[cfg(test)]
mod tests;
mod turn;
mod undistortion;
mod uses;
mod visual_hull;
#[cfg_attr(not(test), allow(dead_code, reason = "parts that no published system is made of yet"))]
mod weights;

pub(crate) use cloud::{CloudTraining, TrainedCloud};
pub(crate) use cloud_parameters::CloudParameters;
pub(crate) use config::{
    CloudConfig, CloudRates, ExtraRows, MOST, PictureConfig, Problem, RowStart, WideningKind, first_of, not_negative,
    positive, unless,
};
pub(crate) use density_config::{
    AdcConfig, DensityConfig, DensityKind, DensityRules, McmcConfig, PlannedDensity, SplitConfig,
};
pub(crate) use drawing::{DrawnCloud, SeenGaussians, VisibleCloud};
pub(crate) use driver::{PhotoTimes, ViewParts, Views};
pub(crate) use front::{CloudLayers, Front, FrontSeen, ViewLayers};
pub(crate) use hooks::{
    Beside, CloudMotion, ColourAppearance, ColourBars, Learns, RenderJudge, SeenDepth, SeenPhoto, SurveyJudge,
};
pub(crate) use pass::{LossParts, Outcome, Pass, PassError, PicturePass, StepCamera, ViewSpaceGradient, squared_error};
pub(crate) use place_codes::PlaceCodes;
pub(crate) use planes::{PlaneLayout, RenderedPicture};
pub(crate) use refusal::refused;
pub(crate) use render::{CloudRenderer, RAY_RADIUS, RenderBuffers, one_pixel};
pub(crate) use sample_places::SamplePlaces;
pub(crate) use terms::{DepthShapeTerm, L1Dssim, L1DssimConfig, Nearness, PictureTerm, Structure, TargetPicture};
pub(crate) use undistortion::source;
pub(crate) use uses::UsePruning;
pub(crate) use visual_hull::VisualHull;
pub(crate) use weights::{MaskWeight, StepPhoto, Weights, nearest};

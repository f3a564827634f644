//! What is reconstructed, and where.

use crate::cameras::Group;
use crate::stage::Stages;
use crate::tool::Toolbox;
use std::path::PathBuf;

/// Pictures to find poses of.
pub(crate) struct Task<'a> {
    pub(crate) tools: &'a Toolbox,
    pub(crate) stages: &'a Stages,
    /// Folder of the pictures.
    pub(crate) images: PathBuf,
    /// Where the model goes.
    pub(crate) model: PathBuf,
    pub(crate) groups: &'a [Group],
    /// Names in order.
    pub(crate) names: Vec<&'a str>,
    /// Whether the order is that of a video.
    pub(crate) in_order: bool,
    /// Threads of the programs; `None`: all.
    pub(crate) threads: Option<usize>,
    /// Hash of the pictures and their cameras.
    pub(crate) inputs: String,
}

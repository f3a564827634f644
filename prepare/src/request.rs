//! What is to be prepared, and how.

use crate::cameras::UnknownCameras;
use crate::posers::Poser;
use crate::tool::Toolbox;
use std::path::PathBuf;

/// Photos or a video, and how they are to become a scene with cameras.
#[derive(Clone, Debug)]
pub struct Request {
    /// A video, or a folder of photos.
    pub input: PathBuf,
    /// Folder of the scene.
    pub out: PathBuf,
    /// Frames wanted of a video.
    pub frames: usize,
    /// Longest side of the pictures, pixels; `None`: as they are.
    pub longest_side: Option<u32>,
    /// What finds the poses; `None`: the first that is there.
    pub with: Option<Poser>,
    /// What to make of photos that do not say which camera took them.
    pub unknown_cameras: UnknownCameras,
    /// Threads of the programs; `None`: all.
    pub threads: Option<usize>,
    /// Where programs are searched for.
    pub tools: Toolbox,
}

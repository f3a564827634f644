//! Photos in the order of time, with cameras and without.

use super::film::Film;
use scene_io::{Frame, Scene};
use std::path::Path;

/// Photos whose priors are made.
#[derive(Clone, Copy, Debug)]
pub enum Sequence<'a> {
    /// The training photos of a scene: what moves is told by their cameras.
    Scene(&'a Scene),
    /// The photos of a film: what moves is told by the flow alone.
    Film(&'a Film),
}

impl<'a> Sequence<'a> {
    /// The folder that photos' names are relative to.
    #[must_use]
    pub fn root(self) -> &'a Path {
        match self {
            Self::Scene(scene) => &scene.root,
            Self::Film(film) => film.root(),
        }
    }

    pub(super) fn frames(self) -> &'a [Frame] {
        match self {
            Self::Scene(scene) => &scene.frames,
            Self::Film(film) => film.frames(),
        }
    }

    pub(super) fn has_cameras(self) -> bool {
        matches!(self, Self::Scene(_))
    }
}

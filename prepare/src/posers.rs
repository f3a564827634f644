//! What finds the poses: the first that is there, or the one that is asked for.

use crate::colmap::{Colmap, Mapper};
use crate::error::PrepareError;
use crate::task::Task;
use crate::tool::{Log, Toolbox, install};
use crate::watch::Watch;

/// A way to find poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Poser {
    /// The crate `openmvg-sfm`, where this program was built with it.
    Sfm,
    /// The program `colmap`.
    Colmap,
    /// COLMAP's features and matches with the global mapper of `glomap`, or the one that newer versions of COLMAP have.
    Glomap,
}

/// A way that is there.
pub(crate) enum Chosen {
    #[cfg(feature = "sfm")]
    Sfm,
    Colmap(Colmap, Mapper),
}

const PURPOSE: &str = "finding out where photos were taken";
#[cfg(not(feature = "sfm"))]
const SFM_BUILD: &str = "build with `cargo install --locked --ignore-rust-version --path apps --features sfm`";
const PAGE: &str = "https://colmap.github.io/install.html";

impl Chosen {
    /// The wanted one, or the first of `sfm`, `colmap` that is there.
    ///
    /// # Errors
    /// [`PrepareError::Missing`] with what to type.
    pub(crate) fn find(tools: &Toolbox, wanted: Option<Poser>) -> Result<Self, PrepareError> {
        let colmap = || Colmap::find(tools);
        let missing = |program, remedy| PrepareError::Missing { purpose: PURPOSE, program, remedy };
        match wanted {
            #[cfg(feature = "sfm")]
            None | Some(Poser::Sfm) => Ok(Self::Sfm),
            #[cfg(not(feature = "sfm"))]
            Some(Poser::Sfm) => {
                Err(missing("the crate openmvg-sfm", format!("this program was built without it: {SFM_BUILD}")))
            }
            #[cfg(not(feature = "sfm"))]
            None => colmap().map(|c| Self::Colmap(c, Mapper::Incremental)).ok_or_else(|| {
                let remedy = format!("{} (or {SFM_BUILD})", install(tools, "colmap", "colmap", PAGE));
                missing("colmap", remedy)
            }),
            Some(Poser::Colmap) => colmap()
                .map(|c| Self::Colmap(c, Mapper::Incremental))
                .ok_or_else(|| missing("colmap", install(tools, "colmap", "colmap", PAGE))),
            Some(Poser::Glomap) => {
                let colmap = colmap().ok_or_else(|| {
                    let why = "glomap places photos whose features COLMAP has matched";
                    missing("colmap", format!("{why}: {}", install(tools, "colmap", "colmap", PAGE)))
                })?;
                let mapper = colmap.global(tools).ok_or_else(|| {
                    let remedy = format!(
                        "install it (https://github.com/colmap/glomap), or a COLMAP newer than {}",
                        colmap.version
                    );
                    missing("glomap", remedy)
                })?;
                Ok(Self::Colmap(colmap, mapper))
            }
        }
    }

    /// Name and version.
    pub(crate) fn name(&self) -> String {
        match self {
            #[cfg(feature = "sfm")]
            Self::Sfm => crate::sfm::NAME.into(),
            Self::Colmap(colmap, Mapper::Incremental) => format!("colmap {}", colmap.version),
            Self::Colmap(colmap, Mapper::Global) => format!("colmap {}, global mapper", colmap.version),
            Self::Colmap(colmap, Mapper::Glomap(_)) => format!("colmap {} and glomap", colmap.version),
        }
    }

    pub(crate) fn reconstruct(
        &self,
        task: &Task<'_>,
        log: &mut Log,
        watch: &mut dyn Watch,
    ) -> Result<(), PrepareError> {
        match self {
            #[cfg(feature = "sfm")]
            Self::Sfm => crate::sfm::reconstruct(task, log, watch),
            Self::Colmap(colmap, mapper) => colmap.reconstruct(task, mapper, log, watch),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_program_one_line_says_what_to_type() {
        let empty = tempfile::tempdir().unwrap();
        let tools = Toolbox::of_folders(&[empty.path()]);
        for wanted in [Some(Poser::Colmap), Some(Poser::Glomap)] {
            let Err(error) = Chosen::find(&tools, wanted) else { panic!("{wanted:?}") };
            let line = error.to_string();
            assert!(line.contains("colmap") && line.contains("install") && !line.contains('\n'), "{line}");
        }
        #[cfg(not(feature = "sfm"))]
        for wanted in [None, Some(Poser::Sfm)] {
            let Err(error) = Chosen::find(&tools, wanted) else { panic!("{wanted:?}") };
            assert!(error.to_string().contains("--features sfm"), "{error}");
        }
    }
}

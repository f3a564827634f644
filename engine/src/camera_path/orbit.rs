//! The arc about what the cameras look at that they cover.

use super::rig::Rig;
use super::stretch::{Coverage, Frames, Track, seen_part};
use crate::error::RunError;
use render_core::camera::Camera;
use render_core::path::{Arc, Ends};

/// The arc, as far as the cameras' places say.
pub(super) fn arc(rig: &Rig) -> Option<Arc> {
    Arc::fit(&rig.poses, rig.focus?, rig.up?)
}

/// Frames of the arc, and a line about it; `None` where the cameras have none.
pub(super) fn orbit(
    rig: &Rig,
    frames: Frames,
    coverage: Option<Coverage<'_>>,
) -> Result<Option<(Vec<Camera>, String)>, RunError> {
    let Some(arc) = arc(rig) else { return Ok(None) };
    let whole = (arc.to - arc.from).to_degrees();
    let arc = match coverage {
        Some(coverage) => {
            let kept = seen_part(arc.clone(), |pose| rig.camera(pose), coverage)?;
            if kept.passed { kept.track } else { arc }
        }
        None => arc,
    };
    let degrees = (arc.to - arc.from).to_degrees();
    let line = match arc.ends {
        Ends::Closed => "once around what the photos look at".into(),
        Ends::Open if degrees < whole - 1.0 => {
            format!(
                "{degrees:.0} of the {whole:.0} degrees that the photos cover, to and fro: the part that two photos saw"
            )
        }
        Ends::Open => format!("the {degrees:.0} degrees that the photos cover, to and fro"),
    };
    let cameras: Vec<Camera> = arc.frames(frames).into_iter().map(|pose| rig.camera(pose)).collect();
    Ok((cameras.len() == frames.0).then_some((cameras, line)))
}

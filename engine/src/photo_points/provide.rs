//! Points for a run whose dataset has none: made once, kept in the run's folder, and from then on as good as the dataset's own.
//!
//! `--set photo_points=off` leaves them away. What was decided is among the run's settings under that name; a run that has no such
//! setting was begun without.

use super::{Found, Options, Sighting, photo_points};
use crate::data::Dataset;
use crate::error::RunError;
use crate::folder::PHOTO_POINTS;
use crate::output::{Storage, write_file};
use crate::progress::{Event, Observer};
use crate::system::SystemError;
use glam::DVec3;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensors, serialize};
use scene_io::{Dialect, Point, Scene, TrackPoint};
use std::path::Path;
use std::time::Instant;

/// Name of the setting, and its words.
pub const SETTING: &str = "photo_points";
const AUTO: &str = "auto";
const OFF: &str = "off";

/// Take the setting out of `set`: `None` where it is not there.
///
/// # Errors
/// [`SystemError::Config`] for any word but `auto` and `off`.
pub(crate) fn take(set: &mut toml::Table) -> Result<Option<bool>, SystemError> {
    let Some(value) = set.remove(SETTING) else { return Ok(None) };
    match value.as_str() {
        Some(AUTO) => Ok(Some(true)),
        Some(OFF) => Ok(Some(false)),
        _ => {
            let problem = format!("write `{AUTO}` or `{OFF}`");
            Err(SystemError::Config { field: SETTING, value: value.to_string(), problem })
        }
    }
}

/// The word for a decision.
pub(crate) fn word(wanted: bool) -> toml::Value {
    toml::Value::String(if wanted { AUTO } else { OFF }.into())
}

/// Whether photos of this kind of scene may be asked for points: photos of one still place, without points of its own. A drawn
/// scene has exact truth, and an object on nothing is found by its outline.
pub(crate) fn may_help(scene: &Scene, train: &Dataset) -> bool {
    let drawn = matches!(scene.dialect, Dialect::Synthetic | Dialect::Blender);
    scene.points.is_empty()
        && !drawn
        && train.time_steps() <= 1
        && train.views().iter().filter(|v| v.level == 0).count() > 1
}

/// The views that points are given to.
pub(crate) struct Sets<'a> {
    /// Views trained on.
    pub(crate) train: &'a mut Dataset,
    /// Views held out.
    pub(crate) held_out: &'a mut Dataset,
}

/// Points for a new run, written into its folder: in `scene`, its training frames and `train`, and those that `held_out` should see.
pub(crate) fn make(
    folder: &Path,
    storage: &dyn Storage,
    scene: &mut Scene,
    Sets { train, held_out }: Sets<'_>,
    observer: &mut dyn Observer,
) -> Result<(), RunError> {
    let begun = Instant::now();
    let found = photo_points(train, &Options::default())?;
    write_file(storage, &folder.join(PHOTO_POINTS), &encode(&found))?;
    let photos = found.tracks.iter().filter(|tracks| !tracks.is_empty()).count();
    let seconds = begun.elapsed().as_secs_f64();
    let line = match found.points.len() {
        0 => format!("points: none that the photos agree on ({seconds:.1} s); the dataset has none"),
        n => format!("points: {n} from {photos} photos ({seconds:.1} s); the dataset has none"),
    };
    observer.event(Event::Note(&line));
    give(found, scene, train);
    held_out.take_visible_points(scene);
    Ok(())
}

/// The points of a run that was begun: those in its folder, or made again where they cannot be read: the same.
pub(crate) fn again(folder: &Path, scene: &mut Scene, Sets { train, held_out }: Sets<'_>) -> Result<(), RunError> {
    let kept = std::fs::read(folder.join(PHOTO_POINTS)).ok().and_then(|bytes| decode(&bytes, train.len()));
    let found = match kept {
        Some(found) => found,
        None => photo_points(train, &Options::default())?,
    };
    give(found, scene, train);
    held_out.take_visible_points(scene);
    Ok(())
}

/// Make `found` the scene's own.
fn give(found: Found, scene: &mut Scene, train: &mut Dataset) {
    let mut length = vec![0_u32; found.points.len()];
    found.tracks.iter().flatten().for_each(|s| length[s.point as usize] += 1);
    for (view, tracks) in train.views().iter().zip(&found.tracks).filter(|(v, _)| v.level == 0) {
        let frame = &mut scene.frames[view.frame];
        // Tracks are at the photo's own size.
        let scale = [
            f64::from(frame.camera.width) / f64::from(view.camera.width),
            f64::from(frame.camera.height) / f64::from(view.camera.height),
        ];
        let track = |s: &Sighting| TrackPoint {
            pixel: [0, 1].map(|a| (f64::from(s.pixel[a]) * scale[a]) as f32),
            length: length[s.point as usize],
            point: s.point,
        };
        frame.tracks = tracks.iter().map(track).collect();
    }
    scene.points = found.points;
    train.take_points(scene);
}

/// `xyz [n, 3]`, `rgb [n, 3]`; `views [v]` how many points each view shows, and these: `point [s]`, `pixel [s, 2]`.
fn encode(found: &Found) -> Vec<u8> {
    let xyz: Vec<u8> = found.points.iter().flat_map(|p| p.xyz.to_array()).flat_map(f64::to_le_bytes).collect();
    let rgb: Vec<u8> = found.points.iter().flat_map(|p| p.rgb).collect();
    let views: Vec<u8> = found.tracks.iter().flat_map(|t| (t.len() as u32).to_le_bytes()).collect();
    let all = || found.tracks.iter().flatten();
    let point: Vec<u8> = all().flat_map(|s| s.point.to_le_bytes()).collect();
    let pixel: Vec<u8> = all().flat_map(|s| s.pixel).flat_map(f32::to_le_bytes).collect();
    let (n, sightings) = (found.points.len(), all().count());
    let arrays = [
        ("xyz", Dtype::F64, vec![n, 3], &xyz),
        ("rgb", Dtype::U8, vec![n, 3], &rgb),
        ("views", Dtype::U32, vec![found.tracks.len()], &views),
        ("point", Dtype::U32, vec![sightings], &point),
        ("pixel", Dtype::F32, vec![sightings, 2], &pixel),
    ];
    let views = arrays.map(|(name, dtype, shape, bytes)| {
        (name, TensorView::new(dtype, shape, bytes).expect("lengths are those of the shapes"))
    });
    serialize(views, None).expect("five arrays with names")
}

/// What was written; `None` where the bytes are anything else, or those of other views.
fn decode(bytes: &[u8], views: usize) -> Option<Found> {
    let file = SafeTensors::deserialize(bytes).ok()?;
    let array = |name: &str, dtype: Dtype| file.tensor(name).ok().filter(|t| t.dtype() == dtype).map(|t| t.data());
    let u32s = |bytes: &[u8]| -> Vec<u32> {
        bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    };
    let xyz: Vec<f64> = array("xyz", Dtype::F64)?
        .chunks_exact(8)
        .map(|b| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]))
        .collect();
    let rgb = array("rgb", Dtype::U8)?;
    let counts = u32s(array("views", Dtype::U32)?);
    let point = u32s(array("point", Dtype::U32)?);
    let pixel: Vec<f32> = u32s(array("pixel", Dtype::F32)?).into_iter().map(f32::from_bits).collect();
    let n = xyz.len() / 3;
    let whole = xyz.len() == 3 * n && rgb.len() == 3 * n && pixel.len() == 2 * point.len() && counts.len() == views;
    let total: u64 = counts.iter().map(|c| u64::from(*c)).sum();
    if !whole
        || total != point.len() as u64
        || point.iter().any(|p| *p as usize >= n)
        || xyz.iter().any(|v| !v.is_finite())
    {
        return None;
    }
    let points = xyz.chunks_exact(3).zip(rgb.chunks_exact(3));
    let points = points.map(|(x, c)| Point { xyz: DVec3::new(x[0], x[1], x[2]), rgb: [c[0], c[1], c[2]] }).collect();
    let mut sightings =
        point.iter().zip(pixel.chunks_exact(2)).map(|(p, x)| Sighting { point: *p, pixel: [x[0], x[1]] });
    let tracks = counts.iter().map(|c| sightings.by_ref().take(*c as usize).collect()).collect();
    Some(Found { points, tracks })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found() -> Found {
        let point = |x: f64| Point { xyz: DVec3::new(x, 1.0 / 3.0, -7e9), rgb: [1, 2, x as u8] };
        let sighting = |point, x| Sighting { point, pixel: [x, 0.5] };
        Found {
            points: vec![point(0.0), point(1.0)],
            tracks: vec![vec![sighting(0, 3.5), sighting(1, 7.25)], Vec::new(), vec![sighting(1, 0.1)]],
        }
    }

    #[test]
    fn points_are_read_as_they_were_written() {
        assert_eq!(decode(&encode(&found()), 3), Some(found()));
        let none = Found { points: Vec::new(), tracks: vec![Vec::new(); 4] };
        assert_eq!(decode(&encode(&none), 4), Some(none));
    }

    #[test]
    fn what_is_cut_short_or_of_other_views_is_nothing() {
        let bytes = encode(&found());
        assert_eq!(decode(&bytes, 4), None);
        for end in 0..bytes.len() {
            assert_eq!(decode(&bytes[..end], 3), None, "{end} bytes");
        }
        let mut wild = found();
        wild.tracks[0][0].point = 9;
        assert_eq!(decode(&encode(&wild), 3), None);
    }

    #[test]
    fn the_setting_is_a_word() {
        let read = |value: toml::Value| take(&mut toml::Table::from_iter([(SETTING.to_string(), value)]));
        assert_eq!(take(&mut toml::Table::new()).unwrap(), None);
        assert_eq!(read(word(true)).unwrap(), Some(true));
        assert_eq!(read(word(false)).unwrap(), Some(false));
        let error = read(toml::Value::Boolean(true)).unwrap_err().to_string();
        assert!(error.contains("photo_points") && error.contains("`auto` or `off`"), "{error}");
    }
}

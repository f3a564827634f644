//! `cameras.bin`, `images.bin`, `points3D.bin`: little-endian, counts as u64. Counts are held against the file's size
//! before anything is allocated.

use super::lens;
use super::model::{Model, ModelImage};
use super::scene::pose_of;
use crate::limits::is_point;
use crate::{ErrorKind, Place, Point, Problem, SceneError, files};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;

/// Bytes of a file and how far they were read.
struct Reader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], SceneError> {
        let end = self.at.checked_add(n).filter(|end| *end <= self.bytes.len());
        let Some(end) = end else {
            let what = format!("is cut off: it has {} bytes and more are needed", self.bytes.len());
            return Err(self.error(what));
        };
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SceneError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N)?);
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, SceneError> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, SceneError> {
        self.array().map(u64::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, SceneError> {
        self.array().map(f64::from_le_bytes)
    }

    fn f64s<const N: usize>(&mut self) -> Result<[f64; N], SceneError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// A count of records of at least `size` bytes each.
    fn count(&mut self, what: &str, size: usize) -> Result<usize, SceneError> {
        let start = self.at;
        let count = self.u64()?;
        let left = self.bytes.len() - self.at;
        if count > (left / size) as u64 {
            self.at = start;
            return Err(self.error(format!("lists {count} {what}, and {left} bytes hold no more than {}", left / size)));
        }
        Ok(count as usize)
    }

    /// Text up to a zero byte.
    fn text(&mut self) -> Result<String, SceneError> {
        let rest = &self.bytes[self.at..];
        let Some(length) = rest.iter().position(|b| *b == 0) else {
            return Err(self.error("a name has no end".into()));
        };
        let text = std::str::from_utf8(&rest[..length]).map_err(|_| self.error("a name is not UTF-8".into()))?;
        self.at += length + 1;
        Ok(text.to_owned())
    }

    fn error(&self, what: String) -> SceneError {
        let remedy = "copy the model again, or export it anew with COLMAP";
        SceneError::new(ErrorKind::Format, Problem::new(self.path, what, remedy).at(Place::Byte(self.at as u64)))
    }

    /// Bytes after the last record are told, not refused.
    fn finish(&self, notes: &mut Vec<String>) {
        let left = self.bytes.len() - self.at;
        if left > 0 {
            notes.push(format!("{}: {left} bytes after the last record", self.path.display()));
        }
    }
}

pub(super) fn cameras(path: &Path, model: &mut Model) -> Result<(), SceneError> {
    let bytes = files::read_bytes(path)?;
    let mut reader = Reader { path, bytes: &bytes, at: 0 };
    for _ in 0..reader.count("cameras", 24)? {
        let place = Place::Byte(reader.at as u64);
        let id = reader.u32()?;
        let number = reader.u32()? as i32;
        let (width, height) = (reader.u64()?, reader.u64()?);
        let Some((name, count)) = lens::by_number(number) else {
            let problem = Problem::new(path, "unknown camera model", lens::supported()).at(place);
            let value = format!("{number} ({})", lens::newer(number));
            let problem = problem.field(format!("camera {id}: model_id")).value(value);
            return Err(SceneError::new(ErrorKind::Value, problem));
        };
        let params = (0..count).map(|_| reader.f64()).collect::<Result<Vec<_>, _>>()?;
        let camera = lens::camera(path, name, width, height, &params).map_err(|p| {
            let field = format!("camera {id}: {}", p.field.as_deref().unwrap_or_default());
            SceneError::new(ErrorKind::Value, p.at(place).field(field))
        })?;
        if model.cameras.insert(id, camera).is_some() {
            return Err(reader.error(format!("camera {id} is listed twice")));
        }
    }
    reader.finish(&mut model.notes);
    Ok(())
}

pub(super) fn images(path: &Path, model: &mut Model) -> Result<(), SceneError> {
    let bytes = files::read_bytes(path)?;
    let mut reader = Reader { path, bytes: &bytes, at: 0 };
    for _ in 0..reader.count("images", 73)? {
        let place = Place::Byte(reader.at as u64);
        let id = reader.u32()?;
        let q = reader.f64s::<4>()?;
        let t = reader.f64s::<3>()?;
        let camera_id = reader.u32()?;
        let name = reader.text()?;
        let points = reader.count("image points", 24)?;
        let (mut point_ids, mut pixels) = (Vec::new(), Vec::new());
        for _ in 0..points {
            let pixel = reader.f64s::<2>()?;
            let id = reader.u64()?;
            if id != u64::MAX {
                point_ids.push(id);
                pixels.push(pixel.map(|x| x as f32));
            }
        }
        match pose_of(path, place, &name, q, t, &mut model.notes) {
            Ok(pose) => model.images.push(ModelImage { id, name, camera_id, pose, point_ids, pixels }),
            Err(problem) => model.problems.push(problem),
        }
    }
    reader.finish(&mut model.notes);
    Ok(())
}

pub(super) fn points(path: &Path) -> Result<HashMap<u64, Point>, SceneError> {
    let bytes = files::read_bytes(path)?;
    let mut reader = Reader { path, bytes: &bytes, at: 0 };
    let count = reader.count("points", 51)?;
    let mut points = HashMap::with_capacity(count);
    for _ in 0..count {
        let start = reader.at;
        let id = reader.u64()?;
        let xyz = DVec3::from(reader.f64s::<3>()?);
        let rgb = reader.array::<3>()?;
        reader.f64()?;
        let track = reader.count("track entries", 8)?;
        reader.take(8 * track)?;
        if !is_point(xyz) {
            reader.at = start;
            return Err(reader.error(format!("point {id} at {xyz} is not finite, or out of range")));
        }
        points.insert(id, Point { xyz, rgb });
    }
    Ok(points)
}

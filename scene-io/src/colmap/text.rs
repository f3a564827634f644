//! `cameras.txt`, `images.txt`, `points3D.txt`: words between blanks, lines starting with `#` are comments.

use super::lens;
use super::model::{Model, ModelImage};
use super::scene::pose_of;
use crate::limits::is_point;
use crate::{ErrorKind, Place, Point, Problem, SceneError, files};
use glam::DVec3;
use std::collections::HashMap;
use std::path::Path;
use std::str::FromStr;

/// Words of one line.
struct Line<'a> {
    path: &'a Path,
    number: usize,
    rest: &'a str,
}

impl<'a> Line<'a> {
    fn word(&mut self, field: &str) -> Result<&'a str, SceneError> {
        self.rest = self.rest.trim_start();
        if self.rest.is_empty() {
            return Err(self.error(field, None, "is missing: the line is too short"));
        }
        let (word, rest) = self.rest.split_once(char::is_whitespace).unwrap_or((self.rest, ""));
        self.rest = rest;
        Ok(word)
    }

    fn parse<T: FromStr>(&mut self, field: &str) -> Result<T, SceneError> {
        let word = self.word(field)?;
        word.parse().map_err(|_| self.error(field, Some(word), "is not a number"))
    }

    fn numbers<const N: usize>(&mut self, fields: [&str; N]) -> Result<[f64; N], SceneError> {
        let mut values = [0.0; N];
        for (value, field) in values.iter_mut().zip(fields) {
            *value = self.parse(field)?;
        }
        Ok(values)
    }

    fn error(&self, field: &str, value: Option<&str>, what: &str) -> SceneError {
        let remedy = "correct the line, or export the model anew with COLMAP";
        let mut problem = Problem::new(self.path, what, remedy).at(Place::Line(self.number)).field(field);
        if let Some(value) = value {
            problem = problem.value(value);
        }
        SceneError::new(ErrorKind::Format, problem)
    }
}

/// Lines that are not comments, numbered from 1.
fn lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = Line<'a>> {
    let numbered = text.lines().enumerate().filter(|(_, l)| !l.trim_start().starts_with('#'));
    numbered.map(move |(i, rest)| Line { path, number: i + 1, rest })
}

pub(super) fn cameras(path: &Path, model: &mut Model) -> Result<(), SceneError> {
    let text = files::read_text(path)?;
    for mut line in lines(path, &text).filter(|l| !l.rest.trim().is_empty()) {
        let place = Place::Line(line.number);
        let id: u32 = line.parse("CAMERA_ID")?;
        let name = line.word("MODEL")?;
        if lens::by_name(name).is_none() {
            let problem = Problem::new(path, "unknown camera model", lens::supported()).at(place);
            return Err(SceneError::new(ErrorKind::Value, problem.field(format!("camera {id}: MODEL")).value(name)));
        }
        let (width, height) = (line.parse("WIDTH")?, line.parse("HEIGHT")?);
        let mut params = Vec::new();
        while !line.rest.trim().is_empty() {
            params.push(line.parse("PARAMS")?);
        }
        let camera = lens::camera(path, name, width, height, &params).map_err(|p| {
            let field = format!("camera {id}: {}", p.field.as_deref().unwrap_or_default());
            SceneError::new(ErrorKind::Value, p.at(place).field(field))
        })?;
        if model.cameras.insert(id, camera).is_some() {
            return Err(line.error("CAMERA_ID", Some(&id.to_string()), "is listed twice"));
        }
    }
    Ok(())
}

pub(super) fn images(path: &Path, model: &mut Model) -> Result<(), SceneError> {
    let text = files::read_text(path)?;
    let mut lines = lines(path, &text);
    while let Some(mut line) = lines.next() {
        if line.rest.trim().is_empty() {
            // Blank lines between images, or at the end; an image's own second line is taken below.
            continue;
        }
        let place = Place::Line(line.number);
        let id = line.parse("IMAGE_ID")?;
        let q = line.numbers(["QW", "QX", "QY", "QZ"])?;
        let t = line.numbers(["TX", "TY", "TZ"])?;
        let camera_id = line.parse("CAMERA_ID")?;
        let name = line.rest.trim();
        if name.is_empty() {
            return Err(line.error("NAME", None, "is missing: the line is too short"));
        }
        // The second line may be empty, and at the end of the file it may not be there at all.
        let (point_ids, pixels) = lines.next().map_or(Ok(Default::default()), image_points)?;
        match pose_of(path, place, name, q, t, &mut model.notes) {
            Ok(pose) => model.images.push(ModelImage { id, name: name.to_owned(), camera_id, pose, point_ids, pixels }),
            Err(problem) => model.problems.push(problem),
        }
    }
    Ok(())
}

/// Ids of points and where they are seen.
fn image_points(mut line: Line<'_>) -> Result<(Vec<u64>, Vec<[f32; 2]>), SceneError> {
    let (mut ids, mut pixels) = (Vec::new(), Vec::new());
    while !line.rest.trim().is_empty() {
        let pixel = line.numbers(["X", "Y"])?;
        let id: i64 = line.parse("POINT3D_ID")?;
        // -1 is not a point.
        if let Ok(id) = u64::try_from(id) {
            ids.push(id);
            pixels.push(pixel.map(|x| x as f32));
        }
    }
    Ok((ids, pixels))
}

pub(super) fn points(path: &Path) -> Result<HashMap<u64, Point>, SceneError> {
    let text = files::read_text(path)?;
    let mut points = HashMap::new();
    for mut line in lines(path, &text).filter(|l| !l.rest.trim().is_empty()) {
        let id: u64 = line.parse("POINT3D_ID")?;
        let xyz = DVec3::from(line.numbers(["X", "Y", "Z"])?);
        let rgb = [line.parse("R")?, line.parse("G")?, line.parse("B")?];
        if !is_point(xyz) {
            return Err(line.error("X Y Z", Some(&xyz.to_string()), "is not finite, or out of range"));
        }
        points.insert(id, Point { xyz, rgb });
    }
    Ok(points)
}

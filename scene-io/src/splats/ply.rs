//! The PLY of 3DGS: one element `vertex`, raw parameters as `float`, found by name.

use super::file::{SplatFile, count};
use super::rows::{Filling, Row};
use crate::ply::Vertices;
use crate::{Place, SceneError};
use splat_core::{Gaussians, MAX_DEGREE, Widening, rest_len};
use std::io::{self, Write};
use std::path::Path;

const REMEDY: &str = "save it as an uncompressed PLY of 3D Gaussian splatting";
/// Always 0 in files of 3DGS: there for viewers of points.
const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
const MEAN: [&str; 3] = ["x", "y", "z"];
const DC: [&str; 3] = ["f_dc_0", "f_dc_1", "f_dc_2"];
const OPACITY: &str = "opacity";
const SCALE: [&str; 3] = ["scale_0", "scale_1", "scale_2"];
const ROT: [&str; 4] = ["rot_0", "rot_1", "rot_2", "rot_3"];
/// Comments that say what the splats were trained with: Brush's, which is the one written, and Postshot's.
const WIDENINGS: [(&str, Widening); 4] = [
    ("SplatRenderMode: mip", Widening::Dims),
    ("SplatRenderMode: default", Widening::Keeps),
    ("antialiased 1", Widening::Dims),
    ("antialiased 0", Widening::Keeps),
];
/// Named in notes; more are counted.
const NAMED: usize = 4;

/// Where in a vertex the parameters are.
struct Columns {
    mean: [usize; 3],
    log_scale: [usize; 3],
    wxyz: [usize; 4],
    logit: usize,
    dc: [usize; 3],
    /// In the order of [`Row::rest`].
    rest: Vec<usize>,
    degree: usize,
}

/// Any of the encodings of PLY, properties in any order and of any type.
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<SplatFile, SceneError> {
    let vertices = Vertices::read_header(path, bytes, REMEDY)?;
    let mut notes = Vec::new();
    let columns = Columns::find(&vertices, &mut notes)?;
    vertices.check_length()?;
    let mut filling = Filling::new(path, vertices.count, columns.degree, bytes.len())?;
    vertices.rows(|values, _| {
        let value = |i: usize| values[i] as f32;
        let mut row = Row {
            mean: columns.mean.map(value),
            log_scale: columns.log_scale.map(value),
            wxyz: columns.wxyz.map(value),
            logit: value(columns.logit),
            dc: columns.dc.map(value),
            ..Row::EMPTY
        };
        for (x, &i) in row.rest.iter_mut().zip(&columns.rest) {
            *x = value(i);
        }
        filling.push(row);
        Ok(())
    })?;
    let said = |comment: &String| WIDENINGS.iter().find(|(word, _)| word == comment).map(|(_, widening)| *widening);
    let widening = vertices.comments.iter().find_map(said);
    Ok(SplatFile { cloud: filling.finish(&mut notes), widening, notes })
}

impl Columns {
    fn find(vertices: &Vertices, notes: &mut Vec<String>) -> Result<Self, SceneError> {
        let wrong = |what: &str| vertices.wrong(Place::File, what);
        let names: Vec<&str> = vertices.properties.iter().map(|(name, _)| name.as_str()).collect();
        let own = [&MEAN[..], &DC, &[OPACITY], &SCALE, &ROT].concat();
        let splats = own[3..].iter().any(|name| names.contains(name));
        let mut found = Vec::new();
        for name in &own {
            match vertices.column(name) {
                Some(i) => found.push(i),
                None if splats => return Err(wrong(&format!("the vertices lack `{name}`"))),
                None if vertices.others.iter().any(|e| e == "face") => {
                    return Err(wrong(&format!("holds a mesh, not splats: the vertices lack `{}`", DC[0])));
                }
                None if names.iter().any(|n| n.starts_with("packed_")) => {
                    return Err(wrong("holds splats in a compressed form that is not read"));
                }
                None if name != &MEAN[0] => {
                    return Err(wrong(&format!("holds points, not splats: the vertices lack `{name}`")));
                }
                None => return Err(wrong("holds no splats: the vertices lack `x`")),
            }
        }
        let [x, y, z, r, g, b, logit, s0, s1, s2, q0, q1, q2, q3] = found[..] else {
            return Err(wrong("the vertices lack properties of splats"));
        };
        let (rest, degree) = Self::find_rest(vertices, &names, notes)?;
        let is_rest = |name: &str| rest_number(name).is_some();
        let known = |name: &&str| own.contains(name) || NORMALS.contains(name) || is_rest(name);
        for (i, name) in names.iter().enumerate() {
            if known(name) && names[..i].contains(name) {
                return Err(wrong(&format!("the vertices have two properties `{name}`")));
            }
        }
        let extra: Vec<&str> = names.iter().copied().filter(|name| !known(name)).collect();
        if !extra.is_empty() {
            let what = count(extra.len(), "property", "properties");
            let more = if extra.len() > NAMED { ", …" } else { "" };
            let some = extra.iter().take(NAMED).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
            notes.push(format!("ignored {what} of no splat: {some}{more}"));
        }
        Ok(Self {
            mean: [x, y, z],
            log_scale: [s0, s1, s2],
            wxyz: [q0, q1, q2, q3],
            logit,
            dc: [r, g, b],
            rest,
            degree,
        })
    }

    /// Columns of `f_rest_*` and the degree. They are stored channel by channel: `f_rest_(channel K + k - 1)`.
    fn find_rest(
        vertices: &Vertices,
        names: &[&str],
        notes: &mut Vec<String>,
    ) -> Result<(Vec<usize>, usize), SceneError> {
        let listed = names.iter().filter(|name| rest_number(name).is_some()).count();
        let Some(degree) = (0..=MAX_DEGREE + 1).find(|d| 3 * rest_len(*d) == listed) else {
            let what = format!("{listed} properties `f_rest_*` are of no degree: 0, 9, 24, 45 and 72 are");
            return Err(vertices.wrong(Place::File, &what));
        };
        let per_channel = rest_len(degree);
        if degree > MAX_DEGREE {
            notes.push(format!(
                "colours above degree {MAX_DEGREE} left out: {per_channel} coefficients a channel listed"
            ));
        }
        let degree = degree.min(MAX_DEGREE);
        let mut rest = Vec::with_capacity(3 * rest_len(degree));
        for k in 0..rest_len(degree) {
            for channel in 0..3 {
                let name = format!("f_rest_{}", channel * per_channel + k);
                let column = vertices.column(&name);
                let lack =
                    || vertices.wrong(Place::File, &format!("of {listed} `f_rest_*` the vertices lack `{name}`"));
                rest.push(column.ok_or_else(lack)?);
            }
        }
        Ok((rest, degree))
    }
}

/// `7` of `f_rest_7`.
fn rest_number(name: &str) -> Option<usize> {
    name.strip_prefix("f_rest_")?.parse().ok()
}

/// Binary little-endian, the properties of 3DGS in its order, normals 0. Only antialiased splats are said to be something.
pub(super) fn write(cloud: &Gaussians, widening: Widening, out: &mut dyn Write) -> io::Result<()> {
    let (n, per_channel) = (cloud.len(), rest_len(cloud.degree()));
    write!(out, "ply\nformat binary_little_endian 1.0\n")?;
    if widening == Widening::Dims {
        writeln!(out, "comment {}", WIDENINGS[0].0)?;
    }
    writeln!(out, "element vertex {n}")?;
    let rest = (0..3 * per_channel).map(|i| format!("f_rest_{i}"));
    let names = [&MEAN[..], &NORMALS, &DC].concat().into_iter().map(str::to_owned).chain(rest);
    for name in names.chain([&[OPACITY][..], &SCALE, &ROT].concat().into_iter().map(str::to_owned)) {
        writeln!(out, "property float {name}")?;
    }
    out.write_all(b"end_header\n")?;
    let mut bytes = Vec::new();
    for i in 0..n {
        let row = Row::of(cloud, i);
        bytes.clear();
        let mut put = |x: f32| bytes.extend(x.to_le_bytes());
        row.mean.into_iter().chain([0.0; 3]).chain(row.dc).for_each(&mut put);
        for channel in 0..3 {
            (0..per_channel).for_each(|k| put(row.rest[3 * k + channel]));
        }
        [row.logit].into_iter().chain(row.log_scale).chain(row.wxyz).for_each(&mut put);
        out.write_all(&bytes)?;
    }
    Ok(())
}

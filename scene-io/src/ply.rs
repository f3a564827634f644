//! Vertices of PLY files: ASCII and both binary forms, any properties. Coloured points are read here, splats in
//! [`crate::splats`].

use crate::decode_memory::DecodeMemory;
use crate::limits::is_point;
use crate::{ErrorKind, Place, Point, Problem, SceneError, files};
use glam::DVec3;
use std::path::Path;

const REMEDY: &str = "export the points again as PLY with x, y, z and red, green, blue";

/// How values are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// Type of a property, by either of its names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    pub(crate) fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The value of the first [`Scalar::size`] bytes.
    pub(crate) fn decode(self, bytes: &[u8], encoding: Encoding) -> f64 {
        let mut le = [0; 8];
        let n = self.size();
        le[..n].copy_from_slice(&bytes[..n]);
        if encoding == Encoding::Big {
            le[..n].reverse();
        }
        let [a, b, c, d, ..] = le;
        match self {
            Self::I8 => f64::from(a as i8),
            Self::U8 => f64::from(a),
            Self::I16 => f64::from(i16::from_le_bytes([a, b])),
            Self::U16 => f64::from(u16::from_le_bytes([a, b])),
            Self::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Self::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Self::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Self::F64 => f64::from_le_bytes(le),
        }
    }
}

/// The vertices of a PLY file: what each holds, and where they lie.
#[derive(Debug)]
pub(crate) struct Vertices<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    remedy: &'static str,
    encoding: Encoding,
    /// How many are listed. Not trusted: see [`Vertices::check_length`].
    pub(crate) count: usize,
    /// In file order.
    pub(crate) properties: Vec<(String, Scalar)>,
    /// Names of the elements behind the vertices.
    pub(crate) others: Vec<String>,
    /// Its comments, words a blank apart.
    pub(crate) comments: Vec<String>,
    /// Lines of the header, for line numbers of ASCII bodies.
    lines: usize,
    /// Where the body starts.
    body: usize,
}

/// Reads the vertices of a PLY file; without colours they are grey.
///
/// # Errors
/// Names the line or byte where the file is not such a PLY, is cut off, or holds a coordinate that is not finite.
pub(crate) fn read_points(path: &Path) -> Result<Vec<Point>, SceneError> {
    let bytes = files::read_bytes(path)?;
    let vertices = Vertices::read_header(path, &bytes, REMEDY)?;
    let find = |names: [&str; 2]| names.iter().find_map(|name| vertices.column(name));
    let position = [vertices.column("x"), vertices.column("y"), vertices.column("z")];
    let [Some(x), Some(y), Some(z)] = position else {
        return Err(vertices.wrong(Place::File, "the vertices lack x, y or z"));
    };
    let colour = [find(["red", "r"]), find(["green", "g"]), find(["blue", "b"])];
    vertices.check_length()?;
    let _held = DecodeMemory::of_process().reserve(
        path,
        &format!("its {} points", vertices.count),
        (vertices.count as u64).saturating_mul(size_of::<Point>() as u64),
    )?;
    let mut points = Vec::with_capacity(vertices.count);
    vertices.rows(|values, place| {
        let xyz = DVec3::new(values[x], values[y], values[z]);
        if !is_point(xyz) {
            return Err(vertices.wrong(place, &format!("the point {xyz} is not finite, or out of range")));
        }
        let rgb = match colour {
            [Some(r), Some(g), Some(b)] => [r, g, b].map(|i| {
                // Floating-point colours are in [0, 1], whole ones in [0, 255].
                let float = matches!(vertices.properties[i].1, Scalar::F32 | Scalar::F64);
                (values[i] * if float { 255.0 } else { 1.0 } + 0.5) as u8
            }),
            _ => [128; 3],
        };
        points.push(Point { xyz, rgb });
        Ok(())
    })?;
    Ok(points)
}

impl<'a> Vertices<'a> {
    /// The header of a file; `remedy` is what its errors advise.
    pub(crate) fn read_header(path: &'a Path, bytes: &'a [u8], remedy: &'static str) -> Result<Self, SceneError> {
        let mut header = Self {
            path,
            bytes,
            remedy,
            encoding: Encoding::Ascii,
            count: 0,
            properties: Vec::new(),
            others: Vec::new(),
            comments: Vec::new(),
            lines: 0,
            body: 0,
        };
        let (mut in_vertex, mut seen_vertex, mut known) = (false, false, false);
        loop {
            let rest = &bytes[header.body..];
            let Some(end) = rest.iter().position(|b| *b == b'\n') else {
                return Err(header.wrong(Place::File, "is not a PLY file: its header does not end"));
            };
            header.body += end + 1;
            header.lines += 1;
            let line = String::from_utf8_lossy(&rest[..end]);
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            let place = Place::Line(header.lines);
            match words.as_slice() {
                ["ply"] if header.lines == 1 => {}
                _ if header.lines == 1 => return Err(header.wrong(place, "is not a PLY file")),
                ["format", encoding, _] => {
                    known = true;
                    header.encoding = match *encoding {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::Little,
                        "binary_big_endian" => Encoding::Big,
                        other => return Err(header.wrong(place, &format!("`{other}` is not a PLY format"))),
                    };
                }
                ["element", "vertex", count] => {
                    (in_vertex, seen_vertex) = (true, true);
                    let count = count.parse();
                    header.count = count.map_err(|_| header.wrong(place, "the number of vertices is not a number"))?;
                }
                ["element", name, _] => {
                    if !seen_vertex {
                        let what = format!("element `{name}` stands before the vertices");
                        return Err(header.wrong(place, &what));
                    }
                    in_vertex = false;
                    header.others.push((*name).to_owned());
                }
                ["property", "list", ..] if in_vertex => {
                    return Err(header.wrong(place, "lists in vertices are not read"));
                }
                ["property", kind, name] if in_vertex => {
                    let scalar = Scalar::parse(kind);
                    let scalar = scalar.ok_or_else(|| header.wrong(place, &format!("`{kind}` is not a type")))?;
                    header.properties.push(((*name).to_owned(), scalar));
                }
                ["end_header"] if known && seen_vertex => return Ok(header),
                ["end_header"] => return Err(header.wrong(place, "the header lacks the format or the vertices")),
                ["comment", words @ ..] => header.comments.push(words.join(" ")),
                _ => {} // obj_info, properties of other elements
            }
        }
    }

    /// Where in a row the property of that name is.
    pub(crate) fn column(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|(n, _)| n == name)
    }

    /// Can the body hold as many rows as the header lists? Ask before memory is taken for them.
    pub(crate) fn check_length(&self) -> Result<(), SceneError> {
        let body = self.bytes.len() - self.body;
        let stride = self.stride();
        // A value of text takes a digit and what parts it from the next; the last line may lack its end.
        let least = if self.encoding == Encoding::Ascii { (2 * self.properties.len()).max(1) } else { stride };
        let room = if self.encoding == Encoding::Ascii { body + 1 } else { body };
        if least == 0 || room / least < self.count {
            let what = format!("is cut off: {} points listed, {body} bytes of {least} each", self.count);
            return Err(self.wrong(Place::File, &what));
        }
        Ok(())
    }

    /// Calls `each` with the values of every row and its place.
    pub(crate) fn rows(&self, each: impl FnMut(&[f64], Place) -> Result<(), SceneError>) -> Result<(), SceneError> {
        self.check_length()?;
        match self.encoding {
            Encoding::Ascii => self.ascii(each),
            _ => self.binary(each),
        }
    }

    fn ascii(&self, mut each: impl FnMut(&[f64], Place) -> Result<(), SceneError>) -> Result<(), SceneError> {
        let text = String::from_utf8_lossy(&self.bytes[self.body..]);
        let mut lines = text.lines().enumerate();
        let mut values = Vec::new();
        for row in 0..self.count {
            let Some((i, line)) = lines.next() else {
                return Err(self.wrong(Place::File, &format!("is cut off: {row} of {} points", self.count)));
            };
            let place = Place::Line(self.lines + i + 1);
            values.clear();
            for word in line.split_ascii_whitespace() {
                match word.parse::<f64>() {
                    Ok(value) => values.push(value),
                    Err(_) => return Err(self.wrong(place, &format!("`{word}` is not a number"))),
                }
            }
            if values.len() < self.properties.len() {
                let what = format!("{} values where {} are listed", values.len(), self.properties.len());
                return Err(self.wrong(place, &what));
            }
            each(&values, place)?;
        }
        Ok(())
    }

    fn binary(&self, mut each: impl FnMut(&[f64], Place) -> Result<(), SceneError>) -> Result<(), SceneError> {
        let stride = self.stride();
        let mut values = vec![0.0; self.properties.len()];
        for (i, record) in self.bytes[self.body..].chunks_exact(stride).take(self.count).enumerate() {
            let mut at = 0;
            for (value, (_, scalar)) in values.iter_mut().zip(&self.properties) {
                *value = scalar.decode(&record[at..], self.encoding);
                at += scalar.size();
            }
            each(&values, Place::Byte((self.body + i * stride) as u64))?;
        }
        Ok(())
    }

    /// Bytes of a row, where they are not text.
    fn stride(&self) -> usize {
        self.properties.iter().map(|(_, s)| s.size()).sum()
    }

    /// An error about this file.
    pub(crate) fn wrong(&self, place: Place, what: &str) -> SceneError {
        SceneError::new(ErrorKind::Format, Problem::new(self.path, what, self.remedy).at(place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(bytes: &[u8]) -> Result<Vec<Point>, SceneError> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        read_points(file.path())
    }

    const HEADER: &str = "ply\r\nformat FORMAT 1.0\ncomment c\nelement vertex 2\nproperty float x\nproperty double y\n\
                          property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
                          element face 0\nproperty list uchar int vertex_indices\nend_header\n";

    #[test]
    fn the_three_encodings_agree() {
        let want = [
            Point { xyz: DVec3::new(1.0, 2.5, -3.0), rgb: [1, 2, 255] },
            Point { xyz: DVec3::new(0.5, 0.1, 4.0), rgb: [9, 8, 7] },
        ];
        let ascii = HEADER.replace("FORMAT", "ascii") + "1 2.5 -3 1 2 255\n0.5 0.1 4 9 8 7\n";
        assert_eq!(read(ascii.as_bytes()).unwrap(), want);
        let mut little = HEADER.replace("FORMAT", "binary_little_endian").into_bytes();
        let mut big = HEADER.replace("FORMAT", "binary_big_endian").into_bytes();
        for p in want {
            little.extend((p.xyz.x as f32).to_le_bytes());
            little.extend(p.xyz.y.to_le_bytes());
            little.extend((p.xyz.z as f32).to_le_bytes());
            little.extend(p.rgb);
            big.extend((p.xyz.x as f32).to_be_bytes());
            big.extend(p.xyz.y.to_be_bytes());
            big.extend((p.xyz.z as f32).to_be_bytes());
            big.extend(p.rgb);
        }
        assert_eq!(read(&little).unwrap(), want);
        assert_eq!(read(&big).unwrap(), want);
        for length in 0..little.len() {
            assert!(read(&little[..length]).is_err(), "cut to {length} of {} bytes", little.len());
        }
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]
        #[test]
        fn forged_counts_do_not_allocate(count: u64) {
            let text = HEADER.replace("FORMAT", "binary_little_endian").replace("vertex 2", &format!("vertex {count}"));
            prop_assert_eq!(read(text.as_bytes()).is_ok(), count == 0);
        }
    }
}

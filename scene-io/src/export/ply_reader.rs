//! Reading back what the writers of this module write: any elements and properties, by name.

use crate::ply::{Encoding, Scalar};
use crate::{ErrorKind, Place, Problem, SceneError};
use std::path::Path;

/// A PLY file.
#[derive(Clone, Debug, PartialEq)]
pub struct Ply {
    /// In file order.
    pub elements: Vec<Element>,
}

/// A table of a PLY file: `vertex`, `face`.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// What the rows are.
    pub name: String,
    /// How many rows.
    pub count: usize,
    /// By name, in file order.
    pub columns: Vec<(String, Column)>,
}

/// A property of all rows. Values of every type fit into `f64` exactly.
#[derive(Clone, Debug, PartialEq)]
pub enum Column {
    /// One number in each row.
    Scalars(Vec<f64>),
    /// A list in each row.
    List(Vec<Vec<f64>>),
}

impl Ply {
    /// Read a binary little-endian file.
    ///
    /// # Errors
    /// Names the file and the line or byte where it is not such a PLY or is cut off.
    pub fn read(path: &Path) -> Result<Self, SceneError> {
        let bytes = std::fs::read(path).map_err(|e| SceneError::io(path, "read the file", e))?;
        Self::parse(&bytes).map_err(|(place, what)| {
            let problem = Problem::new(path, what, "this reader takes what this program exports").at(place);
            SceneError::new(ErrorKind::Format, problem)
        })
    }

    /// The table of that name.
    #[must_use]
    pub fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }

    fn parse(bytes: &[u8]) -> Result<Self, (Place, String)> {
        let mut at = 0;
        let mut declared = header(bytes, &mut at)?;
        let end = |at: usize| (Place::Byte(at as u64), "the file is cut off".to_owned());
        for (element, kinds) in &mut declared {
            for row in 0..element.count {
                for ((_, column), kind) in element.columns.iter_mut().zip(&*kinds) {
                    match (column, kind.length) {
                        (Column::Scalars(values), _) => {
                            values.push(take(kind.value, bytes, &mut at).ok_or_else(|| end(at))?)
                        }
                        (Column::List(lists), Some(length)) => {
                            let n = take(length, bytes, &mut at).ok_or_else(|| end(at))?;
                            // Not trusted for allocation: values are taken while there are bytes.
                            let list = (0..n as usize).map(|_| take(kind.value, bytes, &mut at)).collect::<Option<_>>();
                            lists.push(list.ok_or_else(|| end(at))?);
                        }
                        (Column::List(_), None) => unreachable!("lists are declared with a length"),
                    }
                }
                if element.columns.is_empty() && row == 0 {
                    break; // Nothing to read, however many rows are claimed.
                }
            }
        }
        Ok(Self { elements: declared.into_iter().map(|(element, _)| element).collect() })
    }
}

impl Element {
    /// The property of that name.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|(n, _)| n == name).map(|(_, column)| column)
    }

    /// The numbers of that property; `None` if there is none or it holds lists.
    #[must_use]
    pub fn scalars(&self, name: &str) -> Option<&[f64]> {
        match self.column(name)? {
            Column::Scalars(values) => Some(values),
            Column::List(_) => None,
        }
    }
}

/// How a property lies in a row.
struct Kind {
    /// Of the length, for lists.
    length: Option<Scalar>,
    value: Scalar,
}

fn take(number: Scalar, bytes: &[u8], at: &mut usize) -> Option<f64> {
    let value = number.decode(bytes.get(*at..)?.get(..number.size())?, Encoding::Little);
    *at += number.size();
    Some(value)
}

/// An element without its rows, and how they lie.
type Declared = (Element, Vec<Kind>);

fn header(bytes: &[u8], at: &mut usize) -> Result<Vec<Declared>, (Place, String)> {
    let mut elements: Vec<Declared> = Vec::new();
    for number in 1.. {
        let place = Place::Line(number);
        let rest = &bytes[*at..];
        let Some(length) = rest.iter().position(|b| *b == b'\n') else {
            return Err((place, "the header does not end".to_owned()));
        };
        *at += length + 1;
        let line = String::from_utf8_lossy(&rest[..length]);
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        let not_understood = || (place, format!("`{}` is not understood", line.trim_end()));
        match words[..] {
            ["ply"] if number == 1 => {}
            _ if number == 1 => return Err((place, "this is not a PLY file".to_owned())),
            ["format", "binary_little_endian", "1.0"] | ["comment", ..] | ["obj_info", ..] => {}
            ["element", name, count] => {
                let count = count.parse().map_err(|_| not_understood())?;
                elements.push((Element { name: name.to_owned(), count, columns: Vec::new() }, Vec::new()));
            }
            ["property", ref kind @ .., name] => {
                let (element, kinds) = elements.last_mut().ok_or_else(not_understood)?;
                let (column, kind) = match *kind {
                    [value] => {
                        (Column::Scalars(Vec::new()), Scalar::parse(value).map(|value| Kind { length: None, value }))
                    }
                    ["list", length, value] => (
                        Column::List(Vec::new()),
                        Scalar::parse(length)
                            .zip(Scalar::parse(value))
                            .map(|(length, value)| Kind { length: Some(length), value }),
                    ),
                    _ => return Err(not_understood()),
                };
                kinds.push(kind.ok_or_else(not_understood)?);
                element.columns.push((name.to_owned(), column));
            }
            ["end_header"] => return Ok(elements),
            _ => return Err(not_understood()),
        }
    }
    unreachable!("the header of a finite file ends or is an error")
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str = "ply\nformat binary_little_endian 1.0\ncomment hello\nelement vertex 2\nproperty short a\nproperty double b\n\
                          element face 1\nproperty list uchar uint i\nend_header\n";

    fn file() -> Vec<u8> {
        let mut bytes = HEADER.as_bytes().to_vec();
        for (a, b) in [(-3_i16, 0.1_f64), (7, -2e300)] {
            bytes.extend(a.to_le_bytes());
            bytes.extend(b.to_le_bytes());
        }
        bytes.push(2);
        bytes.extend(5_u32.to_le_bytes());
        bytes.extend(u32::MAX.to_le_bytes());
        bytes
    }

    #[test]
    fn columns_are_found_by_name() {
        let ply = Ply::parse(&file()).unwrap();
        assert_eq!(ply.element("vertex").unwrap().scalars("a"), Some(&[-3.0, 7.0][..]));
        assert_eq!(ply.element("vertex").unwrap().scalars("b"), Some(&[0.1, -2e300][..]));
        assert_eq!(ply.element("face").unwrap().column("i"), Some(&Column::List(vec![vec![5.0, f64::from(u32::MAX)]])));
        assert!(ply.element("edge").is_none() && ply.element("face").unwrap().scalars("i").is_none());
    }

    #[test]
    fn every_cut_is_an_error() {
        let bytes = file();
        for length in 0..bytes.len() {
            assert!(Ply::parse(&bytes[..length]).is_err(), "cut to {length} of {}", bytes.len());
        }
    }

    #[test]
    fn forged_counts_do_not_allocate_or_hang() {
        for forged in
            [HEADER.replace("vertex 2", "vertex 18446744073709551615"), HEADER.replace("face 1", "face 9999999999")]
        {
            assert!(Ply::parse(forged.as_bytes()).is_err());
        }
        let empty = "ply\nformat binary_little_endian 1.0\nelement void 18446744073709551615\nend_header\n";
        assert!(Ply::parse(empty.as_bytes()).is_ok());
    }

    #[test]
    fn lines_that_are_not_understood_are_named() {
        for (from, to, line) in
            [("short a", "quark a", 5), ("binary_little_endian", "ascii", 2), ("list uchar", "set uchar", 8)]
        {
            let (place, what) = Ply::parse(HEADER.replace(from, to).as_bytes()).unwrap_err();
            assert_eq!(place, Place::Line(line), "{what}");
        }
        assert!(Ply::parse(b"png\n").unwrap_err().1.contains("not a PLY"));
    }
}

//! NumPy `.npy` arrays of numbers, read as `f64`.
//!
//! Own code, because sizes must be held against the file before anything is allocated and errors must name the byte;
//! only plain little- or big-endian numbers are read, no objects.

use crate::decode_memory::{DecodeMemory, Reserved};
use crate::{ErrorKind, Place, Problem, SceneError, files};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

/// An array in C order.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Array {
    /// Dimensions, slowest first.
    pub(crate) shape: Vec<usize>,
    /// Values in C order.
    pub(crate) data: Vec<f64>,
}

/// Longest header that is read, bytes; that of a plain array is a line.
const HEADER: usize = 1 << 20;
/// Characters of a header that an error quotes.
const QUOTED: usize = 120;
/// Most dimensions of an array.
const DIMENSIONS: usize = 8;
/// Bytes of values read at one time; a multiple of all their sizes.
const CHUNK: usize = 1 << 16;

/// Reads an array of any of `f2 f4 f8 i1 i2 i4 i8 u1 u2 u4 u8 b1`, in C or Fortran order.
pub(crate) fn read(path: &Path) -> Result<Array, SceneError> {
    with(path, 0, Ok)
}

/// Reads an array and makes something of it, of `each` bytes a value, within [`crate::DecodeMemory`].
pub(crate) fn with<T>(
    path: &Path,
    each: u64,
    work: impl FnOnce(Array) -> Result<T, SceneError>,
) -> Result<T, SceneError> {
    files::refuse_folder(path)?;
    let reading = |e| SceneError::io(path, "read the file", e);
    let file = File::open(path).map_err(reading)?;
    let length = file.metadata().map_err(reading)?.len();
    let (array, _held) = parse(path, BufReader::new(file), length, each)?;
    work(array)
}

/// [`with`] of an array that lies in memory: a member of an archive, whose name `path` ends in.
pub(crate) fn with_bytes<T>(
    path: &Path,
    bytes: &[u8],
    each: u64,
    work: impl FnOnce(Array) -> Result<T, SceneError>,
) -> Result<T, SceneError> {
    let (array, _held) = parse(path, bytes, bytes.len() as u64, each)?;
    work(array)
}

/// An array in `length` bytes, with its memory and `each` bytes a value more reserved.
fn parse(path: &Path, mut reader: impl Read, length: u64, each: u64) -> Result<(Array, Reserved<'static>), SceneError> {
    let wrong = |at: usize, what: String| {
        let remedy = "write the file again with numpy.save";
        SceneError::new(ErrorKind::Format, Problem::new(path, what, remedy).at(Place::Byte(at as u64)))
    };
    let reading = |e| SceneError::io(path, "read the file", e);
    let mut bytes = Vec::new();
    reader.by_ref().take(12).read_to_end(&mut bytes).map_err(reading)?;
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err(wrong(0, format!("is not a .npy file ({length} bytes)")));
    }
    let (start, header): (usize, usize) = match (bytes.get(6), bytes.get(8..10), bytes.get(8..12)) {
        (Some(1), Some(&[a, b]), _) => (10, usize::from(u16::from_le_bytes([a, b]))),
        (Some(2 | 3), _, Some(&[a, b, c, d])) => (12, u32::from_le_bytes([a, b, c, d]) as usize),
        (Some(version @ 4..), ..) => return Err(wrong(6, format!("version {version} of the format is not known"))),
        _ => return Err(wrong(bytes.len(), "is cut off in its header".into())),
    };
    let end = start.saturating_add(header);
    if end as u64 > length {
        return Err(wrong(start, format!("is cut off in its header of {header} bytes")));
    }
    if header > HEADER {
        return Err(wrong(start, format!("has a header of {header} bytes, and those of arrays of numbers are short")));
    }
    reader.by_ref().take(end.saturating_sub(bytes.len()) as u64).read_to_end(&mut bytes).map_err(reading)?;
    let Some(header) = bytes.get(start..end) else {
        return Err(wrong(start, format!("is cut off in its header of {header} bytes")));
    };
    let header = String::from_utf8_lossy(header);
    let field = |key: &str| {
        let at = header.find(&format!("'{key}'"))? + key.len() + 2;
        Some(header[at..].trim_start().strip_prefix(':')?.trim_start())
    };
    let bad_header = || {
        let some: String = header.trim().chars().take(QUOTED).collect();
        wrong(start, format!("its header cannot be read: {some}"))
    };
    let descr = field("descr").and_then(|f| f.strip_prefix('\'')?.split('\'').next()).ok_or_else(bad_header)?;
    let fortran = match field("fortran_order").ok_or_else(bad_header)? {
        f if f.starts_with("True") => true,
        f if f.starts_with("False") => false,
        _ => return Err(bad_header()),
    };
    let shape = field("shape").and_then(|f| f.strip_prefix('(')?.split(')').next()).ok_or_else(bad_header)?;
    let shape = shape
        .split(',')
        .map(str::trim)
        .filter(|d| !d.is_empty())
        .map(|d| d.parse::<usize>().map_err(|_| bad_header()))
        .collect::<Result<Vec<_>, _>>()?;
    if shape.len() > DIMENSIONS {
        let what = format!("has {} dimensions, and at most {DIMENSIONS} are read", shape.len());
        return Err(wrong(start, what));
    }
    let (big, kind) = match descr.split_at_checked(1) {
        Some(("<" | "|" | "=", kind)) => (false, kind),
        Some((">", kind)) => (true, kind),
        _ => return Err(bad_header()),
    };
    let size = match kind {
        "u1" | "i1" | "b1" => 1,
        "u2" | "i2" | "f2" => 2,
        "u4" | "i4" | "f4" => 4,
        "u8" | "i8" | "f8" => 8,
        _ => {
            let some: String = descr.chars().take(QUOTED).collect();
            return Err(wrong(start, format!("holds values of type `{some}`, and only numbers are read")));
        }
    };
    let body = length - end as u64;
    let count = shape.iter().try_fold(1_usize, |n, d| n.checked_mul(*d));
    let Some(count) = count.filter(|n| n.checked_mul(size).is_some_and(|b| b as u64 <= body)) else {
        let what = format!("is cut off: shape {shape:?} of `{descr}` and {body} bytes of values");
        return Err(wrong(end, what));
    };
    let held = DecodeMemory::of_process().reserve(
        path,
        &format!("its {count} numbers"),
        (8 * (1 + u64::from(fortran)) + each).saturating_mul(count as u64) + 2 * CHUNK as u64,
    )?;
    let mut values = Vec::with_capacity(count);
    // Headers of less than 2 bytes have failed: no value was read with them.
    let mut chunk = vec![0; CHUNK.min(count * size)];
    while values.len() < count {
        let n = chunk.len().min((count - values.len()) * size);
        reader.read_exact(&mut chunk[..n]).map_err(reading)?;
        values.extend(chunk[..n].chunks_exact(size).map(|v| number(kind, big, v)));
    }
    let data = if fortran { to_c_order(&shape, &values) } else { values };
    Ok((Array { shape, data }, held))
}

fn number(kind: &str, big: bool, bytes: &[u8]) -> f64 {
    let mut le = [0; 8];
    le[..bytes.len()].copy_from_slice(bytes);
    if big {
        le[..bytes.len()].reverse();
    }
    let [a, b, c, d, ..] = le;
    match kind {
        "u1" => f64::from(a),
        "i1" => f64::from(a as i8),
        "b1" => f64::from(u8::from(a != 0)),
        "u2" => f64::from(u16::from_le_bytes([a, b])),
        "i2" => f64::from(i16::from_le_bytes([a, b])),
        "f2" => half(u16::from_le_bytes([a, b])),
        "u4" => f64::from(u32::from_le_bytes([a, b, c, d])),
        "i4" => f64::from(i32::from_le_bytes([a, b, c, d])),
        "f4" => f64::from(f32::from_le_bytes([a, b, c, d])),
        "u8" => u64::from_le_bytes(le) as f64,
        "i8" => i64::from_le_bytes(le) as f64,
        _ => f64::from_le_bytes(le),
    }
}

/// IEEE 754 binary16.
fn half(bits: u16) -> f64 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff));
    sign * match exponent {
        0 => fraction * 2_f64.powi(-24),
        31 if fraction == 0.0 => f64::INFINITY,
        31 => f64::NAN,
        e => (1024.0 + fraction) * 2_f64.powi(e - 25),
    }
}

fn to_c_order(shape: &[usize], fortran: &[f64]) -> Vec<f64> {
    let mut index = vec![0; shape.len()];
    let mut out = Vec::with_capacity(fortran.len());
    for _ in 0..fortran.len() {
        // Position in Fortran order: the first index runs fastest.
        let at = index.iter().zip(shape).rev().fold(0, |at, (i, n)| at * n + i);
        out.push(fortran[at]);
        for (i, n) in index.iter_mut().zip(shape).rev() {
            *i += 1;
            if *i < *n {
                break;
            }
            *i = 0;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use npyz::{AutoSerialize, Order, WriterBuilder};
    use proptest::prelude::*;

    fn written<T: AutoSerialize + npyz::Serialize + Copy>(shape: &[u64], order: Order, data: &[T]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let options = npyz::WriteOptions::new().default_dtype().shape(shape).order(order).writer(&mut bytes);
        let mut writer = options.begin_nd().unwrap();
        writer.extend(data.iter().copied()).unwrap();
        writer.finish().unwrap();
        bytes
    }

    fn file(bytes: &[u8]) -> Result<Array, SceneError> {
        parse(Path::new("a.npy"), bytes, bytes.len() as u64, 0).map(|(array, _)| array)
    }

    #[test]
    fn arrays_of_another_writer_are_read() {
        let data = [1.5_f64, -2.0, 3.0, 4.0, 5.0, 1e-300];
        let array = file(&written(&[2, 3], Order::C, &data)).unwrap();
        assert_eq!((array.shape.as_slice(), array.data.as_slice()), (&[2, 3][..], &data[..]));
        let fortran = file(&written(&[2, 3], Order::Fortran, &data)).unwrap();
        assert_eq!(fortran.data, [1.5, 3.0, 5.0, -2.0, 4.0, 1e-300]);
        assert_eq!(file(&written(&[2], Order::C, &[7_i32, -8])).unwrap().data, [7.0, -8.0]);
        assert_eq!(file(&written(&[2], Order::C, &[0.1_f32, 2.0])).unwrap().data, [f64::from(0.1_f32), 2.0]);
        assert_eq!(file(&written::<u8>(&[0, 4], Order::C, &[])).unwrap().data, [] as [f64; 0]);
    }

    #[test]
    fn half_floats_have_their_known_values() {
        for (bits, want) in [(0x3c00, 1.0), (0xc000, -2.0), (0x7bff, 65504.0), (1, 5.960_464_477_539_063e-8)] {
            assert_eq!(half(bits), want);
        }
        assert!(half(0x7c01).is_nan() && half(0xfc00) == f64::NEG_INFINITY);
    }

    proptest! {
        #![proptest_config(testkit::property::cases(128))]

        #[test]
        fn corrupted_files_never_panic(cut in 0_usize..200, at in 0_usize..200, byte: u8) {
            let mut bytes = written(&[3, 4], Order::C, &[0.5_f64; 12]);
            if let Some(b) = bytes.get_mut(at) { *b = byte; }
            bytes.truncate(cut.max(1));
            let _ = file(&bytes);
        }

        #[test]
        fn cut_files_are_refused(cut in 0_usize..224) {
            let bytes = written(&[3, 4], Order::C, &[0.5_f64; 12]);
            prop_assume!(cut < bytes.len());
            prop_assert!(file(&bytes[..cut]).is_err());
        }

        #[test]
        fn forged_shapes_do_not_allocate(a: u64, b: u64) {
            let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({a}, {b}), }}");
            let mut bytes = b"\x93NUMPY\x01\0".to_vec();
            bytes.extend((text.len() as u16).to_le_bytes());
            bytes.extend(text.as_bytes());
            prop_assert_eq!(file(&bytes).is_ok(), a == 0 || b == 0);
        }
    }
}

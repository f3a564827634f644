//! Flow in files of other programs: `.flo`, `.npz`, `.npy`.
//!
//! | file | holds | not known |
//! | --- | --- | --- |
//! | `.flo` (Middlebury) | tag `202021.25`, columns, rows, then row by row `f32` x and y; little-endian | NaN, or larger than [`UNKNOWN`] |
//! | `.npz` (NSFF, DynamicNeRF, RoDynRF) | `flow` `[rows][columns][2]`, and perhaps `mask` `[rows][columns]` | `mask` below one half, or as above |
//! | `.npy` | `[rows][columns][2]` | as above |
//!
//! Vectors are x to the right, y down, in pixels of the file's own size. What is not known has the vector 0 in memory.

use crate::bit_mask::BitMask;
use crate::decode_memory::DecodeMemory;
use crate::export::write_atomically;
use crate::npz::Archive;
use crate::picture::same_shape;
use crate::priors::Flow;
use crate::{ErrorKind, Place, Problem, SceneError, Size, files, npy};
use std::path::Path;

/// Tag of a `.flo` file: `202021.25` as `f32`, which reads `PIEH`.
const TAG: [u8; 4] = *b"PIEH";
/// Bytes before the vectors.
const HEAD: usize = 12;
/// Vectors with a larger coordinate are not known (Middlebury).
const UNKNOWN: f32 = 1e9;
/// What is written for those.
const WRITTEN: f32 = 1e10;

/// Reads a flow by the extension of its file; `photo` is the size of the photo it belongs to, which it may differ from by one scale.
pub(crate) fn read_file(path: &Path, photo: Size) -> Result<Flow, SceneError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    match extension.as_str() {
        "flo" => read_flo(path, photo),
        "npz" => read_npz(path, photo),
        "npy" => npy::with(path, 4, |array| from_arrays(path, &array, None, photo)),
        _ => Err(wrong(path, "is not a flow that can be read", "save flow as .flo, .npz or .npy")),
    }
}

/// Writes a flow as a `.flo` file (Middlebury), whole or not at all. Pixels that the other picture does not show are written as not
/// known, `1e10`.
///
/// # Errors
/// Names the file and what the system said; [`ErrorKind::Value`] where the flow does not hold what its size says.
pub fn write_flo(path: &Path, flow: &Flow) -> Result<(), SceneError> {
    let Flow { width, height, vectors, seen } = flow;
    let refuse = |what: String| {
        let problem = Problem::new(path, what, "give one vector and one pixel of the mask for each pixel");
        SceneError::new(ErrorKind::Value, problem)
    };
    let pixels = Size::new(*width, *height).pixels();
    if vectors.len() as u64 != pixels || (seen.width(), seen.height()) != (*width, *height) {
        let what = format!("the flow to write is {width}x{height} and holds {} vectors", vectors.len());
        return Err(refuse(what));
    }
    let side = |n: u32| i32::try_from(n).map_err(|_| refuse(format!("a side of {n} pixels is too long")));
    let (columns, rows) = (side(*width)?, side(*height)?);
    write_atomically(path, |out| {
        out.write_all(&TAG)?;
        out.write_all(&columns.to_le_bytes())?;
        out.write_all(&rows.to_le_bytes())?;
        for (vector, seen) in vectors.iter().zip(seen.iter()) {
            let written = if seen { *vector } else { [WRITTEN; 2] };
            for x in written {
                out.write_all(&x.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

fn read_flo(path: &Path, photo: Size) -> Result<Flow, SceneError> {
    let bytes = files::read_bytes(path)?;
    let at = |place: usize, what: String| {
        let problem = Problem::new(path, what, "write the file again").at(Place::Byte(place as u64));
        SceneError::new(ErrorKind::Format, problem)
    };
    let (head, body) = match bytes.split_first_chunk::<HEAD>() {
        Some((head, body)) if head.starts_with(&TAG) => (head, body),
        Some(_) => return Err(at(0, "is not a .flo file: its tag is not 202021.25".into())),
        None => return Err(at(bytes.len(), format!("is cut off in its header of {HEAD} bytes"))),
    };
    let [.., w0, w1, w2, w3, h0, h1, h2, h3] = *head;
    let (columns, rows) = (i32::from_le_bytes([w0, w1, w2, w3]), i32::from_le_bytes([h0, h1, h2, h3]));
    let (Ok(width), Ok(height)) = (u32::try_from(columns), u32::try_from(rows)) else {
        return Err(at(4, format!("has a size of {columns} columns and {rows} rows")));
    };
    let size = Size::new(width, height);
    if size.pixels().checked_mul(8) != Some(body.len() as u64) {
        let what = format!("is {size} and holds {} bytes of vectors, not 8 for each pixel", body.len());
        return Err(at(HEAD, what));
    }
    let _held = DecodeMemory::of_process().reserve(path, &format!("its {size} pixels"), 9 * size.pixels())?;
    let number = f32::from_le_bytes;
    let vector = |&[x0, x1, x2, x3, y0, y1, y2, y3]: &[u8; 8]| [number([x0, x1, x2, x3]), number([y0, y1, y2, y3])];
    known(path, size, photo, body.as_chunks::<8>().0.iter().map(vector).collect(), |_| true)
}

fn read_npz(path: &Path, photo: Size) -> Result<Flow, SceneError> {
    let archive = Archive::read(path)?;
    archive.with("flow", 4, |flow| {
        if !archive.has("mask") {
            return from_arrays(path, &flow, None, photo);
        }
        archive.with("mask", 0, |mask| from_arrays(path, &flow, Some(&mask), photo))
    })
}

fn from_arrays(path: &Path, flow: &npy::Array, mask: Option<&npy::Array>, photo: Size) -> Result<Flow, SceneError> {
    let shaped = |array: &npy::Array, name: &str, what: &str, remedy: &str| {
        let problem = Problem::new(path, what, remedy).field(format!("{name}.shape"));
        SceneError::new(ErrorKind::Format, problem.value(format!("{:?}", array.shape)))
    };
    let &[height, width, 2] = flow.shape.as_slice() else {
        return Err(shaped(flow, "flow", "is not a flow", "save it as [rows][columns][2], x before y"));
    };
    let side = |n: usize| {
        u32::try_from(n).map_err(|_| wrong(path, format!("a side of {n} pixels is too long"), "save a smaller flow"))
    };
    let size = Size::new(side(width)?, side(height)?);
    if let Some(mask) = mask
        && !matches!(*mask.shape.as_slice(), [h, w] | [h, w, 1] if (h, w) == (height, width))
    {
        let what = format!("the mask is of another size than its flow of {height} rows and {width} columns");
        return Err(shaped(mask, "mask", &what, "save it as [rows][columns], 1 where the flow is valid"));
    }
    let vectors = flow.data.as_chunks::<2>().0.iter().map(|vector| vector.map(|x| x as f32)).collect();
    known(path, size, photo, vectors, |k| mask.is_none_or(|mask| mask.data[k] >= 0.5))
}

/// The flow of vectors of which some are not known, held against its photo.
fn known(
    path: &Path,
    size: Size,
    photo: Size,
    mut vectors: Vec<[f32; 2]>,
    is_valid: impl Fn(usize) -> bool,
) -> Result<Flow, SceneError> {
    if !same_shape(size, photo) {
        let turned = same_shape(Size::new(size.height, size.width), photo);
        let why = if turned { ": rows and columns may be swapped" } else { "" };
        let what = format!("the flow is {size} and its photo {photo}{why}");
        let problem = Problem::new(path, what, "make it from the photo that it belongs to, or remove it");
        return Err(SceneError::new(ErrorKind::Image, problem));
    }
    let Size { width, height } = size;
    let mut seen = BitMask::new(width, height);
    for (k, vector) in vectors.iter_mut().enumerate() {
        // NaN is not within anything.
        if is_valid(k) && vector.iter().all(|x| x.abs() <= UNKNOWN) {
            seen.set(k as u32 % width, (k / width as usize) as u32);
        } else {
            *vector = [0.0; 2];
        }
    }
    Ok(Flow { width, height, vectors, seen })
}

fn wrong(path: &Path, what: impl Into<String>, remedy: &str) -> SceneError {
    SceneError::new(ErrorKind::Format, Problem::new(path, what, remedy))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PHOTO: Size = Size::new(4, 3);

    fn flow() -> Flow {
        let seen = BitMask::from_fn(4, 3, |x, y| (x, y) != (1, 2));
        let vector = |k: usize| if k == 9 { [0.0; 2] } else { [0.25 * k as f32 - 1.0, -3.5 + k as f32] };
        Flow { width: 4, height: 3, vectors: (0..12).map(vector).collect(), seen }
    }

    fn read(bytes: &[u8], photo: Size) -> Result<Flow, SceneError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.flo");
        std::fs::write(&path, bytes).unwrap();
        read_file(&path, photo)
    }

    fn written(flow: &Flow) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("made/a.flo");
        write_flo(&path, flow).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn what_was_written_is_read_and_its_bytes_are_those_of_middlebury() {
        let bytes = written(&flow());
        assert_eq!(bytes[..HEAD], *b"PIEH\x04\0\0\0\x03\0\0\0");
        assert_eq!(f32::from_le_bytes(TAG), 202_021.25);
        assert_eq!(bytes[HEAD..HEAD + 8], [(-1.0_f32).to_le_bytes(), (-3.5_f32).to_le_bytes()].concat());
        assert_eq!(bytes[HEAD + 72..HEAD + 80], [WRITTEN.to_le_bytes(); 2].concat());
        assert_eq!(read(&bytes, PHOTO).unwrap(), flow());
        assert_eq!(read(&bytes, Size::new(8, 6)).unwrap(), flow(), "at its own size");
        let empty = Flow { width: 0, height: 0, vectors: Vec::new(), seen: BitMask::new(0, 0) };
        assert!(read(&written(&empty), PHOTO).unwrap_err().to_string().contains("the flow is 0x0 and its photo 4x3"));
    }

    #[test]
    fn vectors_that_are_not_numbers_or_huge_are_not_known() {
        let mut bytes = written(&flow());
        for (k, x) in [(0, f32::NAN), (1, f32::INFINITY), (2, -1.1e9), (3, 1e9)] {
            bytes[HEAD + 8 * k..HEAD + 8 * k + 4].copy_from_slice(&x.to_le_bytes());
        }
        let read = read(&bytes, PHOTO).unwrap();
        assert_eq!([0, 1, 2, 3].map(|x| read.seen.get(x, 0)), [false, false, false, true]);
        assert_eq!(read.vectors[..3], [[0.0; 2]; 3]);
    }

    #[test]
    fn broken_files_are_named() {
        let bytes = written(&flow());
        let said = |bytes: &[u8], photo: Size| read(bytes, photo).unwrap_err().to_string();
        assert!(said(&bytes[..7], PHOTO).contains("a.flo: byte 7: is cut off in its header"));
        assert!(said(&bytes[..40], PHOTO).contains("byte 12: is 4x3 and holds 28 bytes of vectors"));
        assert!(said(&[&bytes[..], &[0]].concat(), PHOTO).contains("holds 97 bytes of vectors"));
        assert!(said(&[&b"HEIP"[..], &bytes[4..]].concat(), PHOTO).contains("its tag is not 202021.25"));
        assert!(said(&[&bytes[..4], &[0xff; 8], &bytes[12..]].concat(), PHOTO).contains("-1 columns and -1 rows"));
        let huge = [0xff_u8, 0xff, 0xff, 0x7f].repeat(2);
        assert!(said(&[&bytes[..4], &huge[..], &bytes[12..]].concat(), PHOTO).contains("of vectors"));
        assert!(said(&bytes, Size::new(4, 9)).contains("the flow is 4x3 and its photo 4x9;"));
        let turned = known(Path::new("a.flo"), Size::new(8, 6), Size::new(6, 8), vec![[0.0; 2]; 48], |_| true);
        let turned = turned.unwrap_err().to_string();
        assert!(turned.contains("the flow is 8x6 and its photo 6x8: rows and columns may be swapped"), "{turned}");
        let other = read_file(Path::new("a.png"), PHOTO).unwrap_err().to_string();
        assert!(other.contains("save flow as .flo, .npz or .npy"), "{other}");
        let wrong = Flow { vectors: Vec::new(), ..flow() };
        let error = write_flo(Path::new("a.flo"), &wrong).unwrap_err().to_string();
        assert!(error.contains("4x3 and holds 0 vectors"), "{error}");
    }

    #[test]
    fn arrays_must_have_the_shapes_of_flow() {
        let path = Path::new("a.npz");
        let array = |shape: &[usize], value: f64| {
            let data = vec![value; shape.iter().product()];
            npy::Array { shape: shape.to_vec(), data }
        };
        let flow = array(&[3, 4, 2], 1.5);
        let read = from_arrays(path, &flow, Some(&array(&[3, 4], 0.0)), PHOTO).unwrap();
        assert_eq!((read.seen.count(), read.vectors[0]), (0, [0.0; 2]));
        assert_eq!(from_arrays(path, &flow, Some(&array(&[3, 4, 1], 1.0)), PHOTO).unwrap().seen.count(), 12);
        assert_eq!(from_arrays(path, &flow, None, PHOTO).unwrap().vectors, [[1.5; 2]; 12]);
        let said = |flow: &npy::Array, mask: Option<&npy::Array>| {
            from_arrays(path, flow, mask, PHOTO).unwrap_err().to_string()
        };
        assert!(said(&array(&[2, 3, 4], 0.0), None).contains("`flow.shape` = [2, 3, 4]: is not a flow"));
        assert!(said(&array(&[9, 3, 2], 0.0), None).contains("the flow is 3x9 and its photo 4x3"));
        assert!(said(&flow, Some(&array(&[4, 3], 1.0))).contains("`mask.shape` = [4, 3]: the mask is of another size"));
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn any_flow_comes_back(width in 1_u32..7, height in 1_u32..7, seed: u32) {
            let hidden = |k: u32| seed >> (k % 32) & 1 == 1;
            let vector = |k: u32| match hidden(k) {
                true => [0.0; 2],
                false => [(seed % 997) as f32 / 7.0 - k as f32, k as f32 * 1e6],
            };
            let seen = BitMask::from_fn(width, height, |x, y| !hidden(y * width + x));
            let flow = Flow { width, height, vectors: (0..width * height).map(vector).collect(), seen };
            prop_assert_eq!(read(&written(&flow), Size::new(width, height)).unwrap(), flow);
        }
    }
}

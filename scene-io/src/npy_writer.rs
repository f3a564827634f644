//! NumPy `.npy` arrays of numbers to files.

use crate::SceneError;
use crate::export::write_atomically;
use std::path::Path;

/// Numbers that a NumPy array can hold.
pub(crate) trait Number: Copy {
    /// NumPy's name of the type.
    const TYPE: &str;
    /// Little end first.
    fn bytes(self) -> impl IntoIterator<Item = u8>;
}

impl Number for f32 {
    const TYPE: &str = "<f4";
    fn bytes(self) -> impl IntoIterator<Item = u8> {
        self.to_le_bytes()
    }
}

impl Number for f64 {
    const TYPE: &str = "<f8";
    fn bytes(self) -> impl IntoIterator<Item = u8> {
        self.to_le_bytes()
    }
}

/// An array in C order as `.npy`, version 1.0.
///
/// # Panics
/// If the shape does not hold the values.
pub(crate) fn write_npy<T: Number>(path: &Path, shape: &[u32], values: &[T]) -> Result<(), SceneError> {
    assert_eq!(shape.iter().map(|n| *n as usize).product::<usize>(), values.len(), "shape {shape:?}");
    let sizes: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '{}', 'fortran_order': False, 'shape': ({sizes}), }}", T::TYPE);
    // Magic, version and length take 10 bytes; values start at a multiple of 64, after a line end.
    let start = (10 + header.len() + 1).next_multiple_of(64);
    header.push_str(&" ".repeat(start - 10 - header.len() - 1));
    header.push('\n');
    write_atomically(path, |out| {
        out.write_all(b"\x93NUMPY\x01\x00")?;
        out.write_all(&(header.len() as u16).to_le_bytes())?;
        out.write_all(header.as_bytes())?;
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.bytes()).collect();
        out.write_all(&bytes)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_read_by_another_reader() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a/b.npy");
        for shape in [[2, 3].as_slice(), &[6], &[1, 2, 3]] {
            let values = [0.0, -1.5, f64::MAX, 1e-300, f64::INFINITY, 7.0];
            write_npy(&path, shape, &values).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let array = npyz::NpyFile::new(&bytes[..]).unwrap();
            assert_eq!(array.shape(), shape.iter().map(|n| u64::from(*n)).collect::<Vec<_>>());
            assert_eq!(array.into_vec::<f64>().unwrap(), values);
        }
        write_npy(&path, &[0, 4], &[] as &[f32]).unwrap();
        assert_eq!(crate::npy::read(&path).unwrap().shape, [0, 4]);
    }
}

//! The array file of a checkpoint, as bytes: safetensors, whose numbers have their least significant byte first on every machine.

use crate::tensors::{Tensor, TensorData, TensorMap};
use bytemuck::{AnyBitPattern, NoUninit};
use safetensors::tensor::{Dtype, View};
use std::borrow::Cow;
use std::collections::HashMap;

/// One array as the format asks for it.
struct Stored<'a> {
    dtype: Dtype,
    shape: &'a [usize],
    bytes: Cow<'a, [u8]>,
}

impl View for Stored<'_> {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

/// Named arrays as the bytes of a safetensors file.
///
/// # Panics
/// Where a shape does not fit the length of its data.
pub fn serialise(state: &[Tensor<'_>]) -> Vec<u8> {
    let arrays = state.iter().map(|t| {
        let (dtype, numbers, bytes) = match &t.data {
            TensorData::F32(x) => (Dtype::F32, x.len(), to_bytes(x)),
            TensorData::U64(x) => (Dtype::U64, x.len(), to_bytes(x)),
        };
        let entries: usize = t.shape.iter().product();
        assert!(
            entries == numbers,
            "state array `{}` of {numbers} numbers does not fill its shape {:?}",
            t.name,
            t.shape
        );
        (t.name.as_str(), Stored { dtype, shape: &t.shape, bytes })
    });
    safetensors::serialize(arrays, None::<HashMap<String, String>>).expect("valid arrays serialise")
}

pub(super) fn deserialise(bytes: &[u8]) -> Result<TensorMap, String> {
    let file = safetensors::SafeTensors::deserialize(bytes).map_err(|e| format!("array file: {e}"))?;
    let mut state = TensorMap::new();
    for (name, view) in file.tensors() {
        let data = match view.dtype() {
            Dtype::F32 => TensorData::F32(Cow::Owned(from_bytes(view.data()))),
            Dtype::U64 => TensorData::U64(Cow::Owned(from_bytes(view.data()))),
            other => return Err(format!("array `{name}` has type {other:?}, expected F32 or U64")),
        };
        state.insert(name.clone(), Tensor { name, shape: view.shape().to_vec(), data });
    }
    Ok(state)
}

/// Numbers as the file has them; without a copy where that is the order of this machine.
fn to_bytes<T: NoUninit>(numbers: &[T]) -> Cow<'_, [u8]> {
    let bytes = bytemuck::cast_slice(numbers);
    if cfg!(target_endian = "little") { Cow::Borrowed(bytes) } else { Cow::Owned(turned(bytes, size_of::<T>())) }
}

/// The numbers of a file. `bytes` may begin at any address.
fn from_bytes<T: NoUninit + AnyBitPattern>(bytes: &[u8]) -> Vec<T> {
    if cfg!(target_endian = "little") {
        bytemuck::pod_collect_to_vec(bytes)
    } else {
        bytemuck::pod_collect_to_vec(&turned(bytes, size_of::<T>()))
    }
}

/// Each number of `width` bytes, last byte first.
fn turned(bytes: &[u8], width: usize) -> Vec<u8> {
    bytes.chunks(width).flat_map(|number| number.iter().rev()).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> [Tensor<'static>; 2] {
        let floats = TensorData::F32(Cow::Owned(vec![1.5, -2.0, f32::from_bits(0x7fc0_1234)]));
        let counts = TensorData::U64(Cow::Owned(vec![0x0102_0304_0506_0708, u64::MAX - 1]));
        [
            Tensor { name: "floats".into(), shape: vec![3], data: floats },
            Tensor { name: "counts".into(), shape: vec![2, 1], data: counts },
        ]
    }

    /// What is after the header: the same on every machine.
    #[test]
    fn arrays_have_their_least_significant_byte_first() {
        let bytes = serialise(&state());
        let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let counts = [8, 7, 6, 5, 4, 3, 2, 1, 0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        let floats = [0, 0, 0xc0, 0x3f, 0, 0, 0, 0xc0, 0x34, 0x12, 0xc0, 0x7f];
        assert_eq!(bytes[8 + header..], [&counts[..], &floats[..]].concat());
    }

    #[test]
    fn arrays_come_back_from_any_address() {
        let bytes = serialise(&state());
        for shift in 0..8 {
            let shifted = [&[0; 8][..shift], &bytes].concat();
            let back = deserialise(&shifted[shift..]).unwrap();
            for tensor in &state() {
                let found = &back[&tensor.name];
                assert_eq!(found.shape, tensor.shape);
                match (&found.data, &tensor.data) {
                    (TensorData::F32(a), TensorData::F32(b)) => {
                        assert!(a.iter().zip(b.iter()).all(|(a, b)| a.to_bits() == b.to_bits()));
                    }
                    (a, b) => assert_eq!(a, b),
                }
            }
        }
    }

    #[test]
    fn numbers_are_turned_one_by_one() {
        assert_eq!(turned(&[1, 2, 3, 4, 5, 6, 7, 8], 4), [4, 3, 2, 1, 8, 7, 6, 5]);
        assert!(turned(&[], 8).is_empty());
    }
}

//! Which parts of each training photo are static: one bit for each square of pixels.

use engine::data::Batch;
use engine::system::{SystemError, Tensor, TensorMap, take_u64, u64_tensor};
use losses::heuristics::Extent;

/// A map for each training view; empty until they are found.
#[derive(Clone, Default)]
pub struct StaticMaps(Vec<StaticMap>);

/// Static squares of one photo, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct StaticMap {
    pub(crate) width: usize,
    /// Pixels of the photo along a side of a square.
    pub(crate) stride: usize,
    /// 1 static, 0 not.
    pub(crate) bits: Vec<u8>,
}

impl StaticMap {
    /// The same in squares of `stride` pixels, `extent` of them.
    pub(crate) fn in_squares(&self, stride: usize, extent: Extent) -> Vec<u8> {
        let middle = |k: usize| k * stride + stride / 2;
        (0..extent.pixels()).map(|i| self.at(middle(i % extent.width), middle(i / extent.width))).collect()
    }

    /// Whether pixel `(x, y)` is static. What lies beyond the last whole square is as that square.
    pub(crate) fn at(&self, x: usize, y: usize) -> u8 {
        let height = self.bits.len().checked_div(self.width).unwrap_or(0);
        if height == 0 {
            return 1;
        }
        let (x, y) = ((x / self.stride).min(self.width - 1), (y / self.stride).min(height - 1));
        self.bits[y * self.width + x]
    }
}

impl StaticMaps {
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// One for each view, in their order.
    pub(crate) fn set_all(&mut self, maps: Vec<StaticMap>) {
        self.0 = maps;
    }

    /// Leave pixels that are not static out of a batch; none until maps are found.
    pub(crate) fn leave_out(&self, batch: &mut Batch) {
        let Batch { weight, view, pixel, .. } = batch;
        for ((weight, &view), &[x, y]) in weight.iter_mut().zip(&*view).zip(&*pixel) {
            if self.0.get(view as usize).is_some_and(|map| map.at(x.into(), y.into()) == 0) {
                *weight = 0.0;
            }
        }
    }

    /// A view's map; `None` before maps are found.
    pub(crate) fn of(&self, view: usize) -> Option<&StaticMap> {
        self.0.get(view)
    }

    /// A view's map, one value a pixel.
    pub(crate) fn pixels(&self, view: usize, extent: Extent) -> Option<Vec<f32>> {
        let map = self.0.get(view)?;
        Some((0..extent.pixels()).map(|i| f32::from(map.at(i % extent.width, i / extent.width))).collect())
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.0.iter().map(|map| map.bits.len()).sum()
    }

    /// Tensors `NAME.words` and `NAME.maps`.
    pub(crate) fn push_state(&self, name: &str, out: &mut Vec<Tensor<'_>>) {
        // Their number; for each its width, stride and length; then 64 squares to a word.
        let mut words = vec![self.0.len() as u64];
        words.extend(self.0.iter().flat_map(|map| [map.width as u64, map.stride as u64, map.bits.len() as u64]));
        for map in &self.0 {
            words
                .extend(map.bits.chunks(64).map(|bits| bits.iter().rev().fold(0, |word, &b| word << 1 | u64::from(b))));
        }
        out.push(u64_tensor(format!("{name}.words"), vec![words.len() as u64]));
        out.push(u64_tensor(format!("{name}.maps"), words));
    }

    pub(crate) fn load_state(&mut self, name: &str, state: &TensorMap) -> Result<(), SystemError> {
        let words = take_u64(state, &format!("{name}.words"), 1)?[0] as usize;
        let words = take_u64(state, &format!("{name}.maps"), words)?;
        self.0 = unpack(&words).ok_or_else(|| SystemError::State {
            name: format!("{name}.maps"),
            problem: "its lengths do not fit its content".into(),
        })?;
        Ok(())
    }
}

/// Maps from the words of [`StaticMaps::push_state`].
fn unpack(words: &[u64]) -> Option<Vec<StaticMap>> {
    let (&count, rest) = words.split_first()?;
    let (heads, mut rest) = rest.split_at_checked(usize::try_from(count).ok()?.checked_mul(3)?)?;
    let mut maps = Vec::with_capacity(heads.len() / 3);
    for head in heads.chunks_exact(3) {
        let [width, stride, len] = [head[0], head[1], head[2]].map(|v| usize::try_from(v).ok());
        let (width, stride, len) = (width?, stride?, len?);
        let (bits, after) = rest.split_at_checked(len.div_ceil(64))?;
        if len > 0 && (stride == 0 || width == 0 || !len.is_multiple_of(width)) {
            return None;
        }
        let bits = (0..len).map(|i| (bits[i / 64] >> (i % 64) & 1) as u8).collect();
        maps.push(StaticMap { width, stride, bits });
        rest = after;
    }
    rest.is_empty().then_some(maps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_survive_a_checkpoint_and_damaged_ones_are_refused() {
        let mut maps = StaticMaps::default();
        let bits: Vec<u8> = (0..70).map(|i| u8::from(i % 3 == 0)).collect();
        maps.set_all(vec![StaticMap::default(), StaticMap { width: 10, stride: 4, bits }]);
        let mut tensors = Vec::new();
        maps.push_state("static", &mut tensors);
        let state: TensorMap = tensors.into_iter().map(|t| (t.name.clone(), t.into_owned())).collect();
        let mut read = StaticMaps::default();
        read.load_state("static", &state).unwrap();
        assert_eq!(read.0, maps.0);
        let good = [1, 2, 1, 4, 0b1010];
        assert_eq!(unpack(&good).unwrap()[0].bits, [0, 1, 0, 1]);
        for damaged in [&good[..4], &[], &[u64::MAX], &[1, 0, 1, 4, 0], &[1, 3, 1, 4, 0], &[1, 2, 0, 4, 0], &[0, 7]] {
            assert!(unpack(damaged).is_none(), "{damaged:?}");
        }
    }

    #[test]
    fn pixels_beyond_the_last_square_are_as_that_square() {
        let map = StaticMap { width: 2, stride: 3, bits: vec![1, 0, 0, 1] };
        assert_eq!([map.at(0, 0), map.at(5, 0), map.at(7, 0), map.at(7, 7), map.at(0, 7)], [1, 0, 0, 1, 0]);
        assert_eq!(map.in_squares(2, Extent { width: 4, height: 2 }), [1, 0, 0, 0, 0, 1, 1, 1]);
    }
}

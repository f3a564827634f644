//! A depth map at another size.

use super::map::{DepthMap, is_known};

impl DepthMap {
    /// The map at another size: each pixel takes the depth that is known nearest to its centre, of those inside the area it
    /// covers; a hole where none is. Depths are never mixed: the mean of a surface and what is behind it is neither.
    ///
    /// # Panics
    /// If `z` is shorter than the size says.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let columns: Vec<Span> = (0..width).map(|x| Span::of(x, width, self.width)).collect();
        let mut z = Vec::with_capacity(width as usize * height as usize);
        for y in 0..height {
            let row = Span::of(y, height, self.height);
            z.extend(columns.iter().map(|column| self.nearest(column, &row)));
        }
        Self { width, height, z }
    }

    fn nearest(&self, column: &Span, row: &Span) -> f32 {
        let mut best = (f64::INFINITY, 0.0);
        for y in row.from..row.to {
            for x in column.from..column.to {
                let z = self.z[y * self.width as usize + x];
                let off = (x as f64 + 0.5 - column.centre).powi(2) + (y as f64 + 0.5 - row.centre).powi(2);
                if is_known(z) && off < best.0 {
                    best = (off, z);
                }
            }
        }
        best.1
    }
}

/// What one pixel of the new size covers of the old one, along an axis.
struct Span {
    from: usize,
    to: usize,
    centre: f64,
}

impl Span {
    fn of(at: u32, new: u32, old: u32) -> Self {
        let (at, new, old) = (u64::from(at), u64::from(new), u64::from(old));
        Self {
            from: (at * old / new) as usize,
            to: ((at + 1) * old).div_ceil(new) as usize,
            centre: (at as f64 + 0.5) * old as f64 / new as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_nearest_known_depth_is_taken_and_holes_stay_holes() {
        #[rustfmt::skip]
        let map = DepthMap::new(4, 4, vec![
            1.0, 0.0, 0.0, 0.0,
            2.0, 3.0, 0.0, 0.0,
            0.0, 0.0, 5.0, 5.0,
            0.0, 7.0, 5.0, 5.0,
        ]).unwrap();
        // Of four corners equally near to the centre the first known one is taken.
        assert_eq!(map.resized(2, 2).z, [1.0, 0.0, 7.0, 5.0]);
        let large = map.resized(8, 8);
        assert_eq!(large.resized(4, 4), map);
        assert_eq!(map.resized(4, 4), map);
        assert!(map.resized(0, 3).z.is_empty());
    }

    proptest! {
        #![proptest_config(testkit::property::cases(64))]

        #[test]
        fn no_depth_is_made_up(
            (w, h) in (1_u32..9, 1_u32..9), (nw, nh) in (1_u32..20, 1_u32..20), seed in prop::collection::vec(0_u8..4, 64),
        ) {
            let z: Vec<f32> = seed.iter().take((w * h) as usize).map(|v| f32::from(*v)).collect();
            let map = DepthMap::new(w, h, z).unwrap();
            let new = map.resized(nw, nh);
            prop_assert_eq!(new.z.len(), (nw * nh) as usize);
            for z in &new.z {
                prop_assert!(*z == 0.0 || map.z.contains(z));
            }
            if map.holes() == 0 {
                prop_assert_eq!(new.holes(), 0);
            }
        }
    }
}

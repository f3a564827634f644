//! One level of a feature grid (dense or hashed), blended trilinearly, from its definition.

/// One level: coordinates in cells are `x * scale + shift`.
pub struct Level<'a> {
    /// Cells a unit.
    pub scale: f64,
    /// Offset of the vertices, cells.
    pub shift: f64,
    /// Largest cell number along an axis.
    pub last_cell: f64,
    /// Features of an entry.
    pub features: usize,
    /// Number of the entry of the vertex at integer coordinates.
    pub entry: &'a dyn Fn([u32; 3]) -> usize,
}

impl Level<'_> {
    /// Entries and weights of the eight vertices around `x` in `[0, 1]^3`.
    #[must_use]
    pub fn corners(&self, x: [f64; 3]) -> [(usize, f64); 8] {
        let p = x.map(|x| x.clamp(0.0, 1.0) * self.scale + self.shift);
        let cell = p.map(|p| p.floor().min(self.last_cell));
        core::array::from_fn(|corner| {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2];
            let weight = (0..3).map(|a| {
                let share = p[a] - cell[a];
                if up[a] == 1 { share } else { 1.0 - share }
            });
            let vertex = [0, 1, 2].map(|a| cell[a] as u32 + up[a] as u32);
            ((self.entry)(vertex), weight.product())
        })
    }

    /// The features at `x`; `table` `[entries][features]`.
    ///
    /// # Panics
    /// Where an entry lies past the end of `table`.
    #[must_use]
    pub fn forward(&self, table: &[f32], x: [f64; 3]) -> Vec<f64> {
        let corners = self.corners(x);
        let value = |f: usize| corners.map(|(e, w)| w * f64::from(table[e * self.features + f])).iter().sum();
        (0..self.features).map(value).collect()
    }

    /// Add the gradient of `<out_bar, forward(x)>` to `table_bar`.
    ///
    /// # Panics
    /// Where an entry lies past the end of `table_bar`.
    pub fn backward(&self, x: [f64; 3], out_bar: &[f64], table_bar: &mut [f64]) {
        for (entry, weight) in self.corners(x) {
            for (f, bar) in out_bar.iter().enumerate() {
                table_bar[entry * self.features + f] += weight * bar;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dense(v: [u32; 3]) -> usize {
        (v[0] + 4 * (v[1] + 4 * v[2])) as usize
    }

    const LEVEL: Level<'_> = Level { scale: 3.0, shift: 0.0, last_cell: 2.0, features: 1, entry: &dense };

    #[test]
    fn a_linear_table_is_blended_to_a_linear_function() {
        let table: Vec<f32> = (0..64).map(|e| (e % 4 + 10 * (e / 4 % 4) + 100 * (e / 16)) as f32).collect();
        for x in [[0.0; 3], [1.0; 3], [0.2, 0.5, 0.9]] {
            let want = 3.0 * (x[0] + 10.0 * x[1] + 100.0 * x[2]);
            assert!((LEVEL.forward(&table, x)[0] - want).abs() < 1e-9);
        }
    }

    #[test]
    fn backward_is_the_transpose_of_forward() {
        let x = [0.31, 0.77, 0.05];
        let mut bar = vec![0.0; 64];
        LEVEL.backward(x, &[2.0], &mut bar);
        for (i, got) in bar.iter().enumerate() {
            let mut unit = vec![0.0; 64];
            unit[i] = 1.0;
            assert!((got - 2.0 * LEVEL.forward(&unit, x)[0]).abs() < 1e-12);
        }
        assert!((bar.iter().sum::<f64>() - 2.0).abs() < 1e-12, "the weights sum to one");
    }
}

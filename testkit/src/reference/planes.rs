//! Features on planes through a box, blended bilinearly on each and then combined.

/// How the features of all planes become one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Combine {
    /// The sum over the planes.
    Sum,
    /// The product over the planes.
    Product,
    /// The sum over three pairs of products, first with last.
    Hex,
}

impl Combine {
    /// The features `v` of all planes as one.
    #[must_use]
    pub fn value(self, v: &[f64]) -> f64 {
        match self {
            Self::Sum => v.iter().sum(),
            Self::Product => v.iter().product(),
            Self::Hex => v[0] * v[5] + v[1] * v[4] + v[2] * v[3],
        }
    }

    /// Derivative of `value` with respect to `v[p]`.
    fn partial(self, v: &[f64], p: usize) -> f64 {
        match self {
            Self::Sum => 1.0,
            Self::Product => v.iter().enumerate().filter(|(q, _)| *q != p).map(|(_, v)| v).product(),
            Self::Hex => v[5 - p],
        }
    }
}

/// The planes, which lie in the table one after the other.
#[derive(Clone, Debug)]
pub struct Planes<'a> {
    /// Vertices along each axis of the box.
    pub resolution: &'a [u32],
    /// Features of a vertex.
    pub features: usize,
    /// The two axes that each plane spans; the first is the faster one.
    pub pairs: &'a [[usize; 2]],
    /// How features become one.
    pub combine: Combine,
}

/// What is known about one point and one feature.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The feature.
    pub value: f64,
    /// Its derivatives by the table: index and derivative. An index may come more than once.
    pub by_table: Vec<(usize, f64)>,
    /// Its derivatives by the axes of the box.
    pub by_x: [f64; 4],
}

/// One vertex around a point: where its features start in the table, weight, derivative of the weight by each axis.
struct Corner {
    start: usize,
    weight: f64,
    by_x: [f64; 4],
}

impl Planes<'_> {
    /// Numbers of the table.
    #[must_use]
    pub fn table_len(&self) -> usize {
        self.start(self.pairs.len())
    }

    /// Feature `feature` of a point; `x` in `[-1, 1]`, clamped to it.
    #[must_use]
    pub fn point(&self, table: &[f64], x: &[f64], feature: usize) -> Point {
        let all: Vec<_> = (0..self.pairs.len()).map(|p| self.corners(p, x)).collect();
        let blend = |corners: &[Corner]| corners.iter().map(|c| c.weight * table[c.start + feature]).sum::<f64>();
        let v: Vec<f64> = all.iter().map(|c| blend(c)).collect();
        let (mut by_table, mut by_x) = (Vec::new(), [0.0; 4]);
        for (p, corners) in all.iter().enumerate() {
            let partial = self.combine.partial(&v, p);
            for c in corners {
                by_table.push((c.start + feature, partial * c.weight));
                (0..4).for_each(|a| by_x[a] += partial * c.by_x[a] * table[c.start + feature]);
            }
        }
        Point { value: self.combine.value(&v), by_table, by_x }
    }

    /// Where a plane starts in the table.
    fn start(&self, plane: usize) -> usize {
        let vertices = |pair: &[usize; 2]| pair.iter().map(|&a| self.resolution[a] as usize).product::<usize>();
        self.pairs[..plane].iter().map(vertices).sum::<usize>() * self.features
    }

    fn corners(&self, plane: usize, x: &[f64]) -> Vec<Corner> {
        let (pair, start) = (self.pairs[plane], self.start(plane));
        let side = pair.map(|a| {
            let r = self.resolution[a] as usize;
            let p = (x[a].clamp(-1.0, 1.0) + 1.0) / 2.0 * (r - 1) as f64;
            let cell = (p.floor() as usize).min(r.saturating_sub(2));
            let derivative = if (-1.0..=1.0).contains(&x[a]) { (r - 1) as f64 / 2.0 } else { 0.0 };
            (cell, p - cell as f64, derivative, r)
        });
        let mut all = Vec::new();
        for up in [[0, 0], [1, 0], [0, 1], [1, 1]] {
            let part = |k: usize| {
                let (_, f, derivative, _) = side[k];
                if up[k] == 1 { (f, derivative) } else { (1.0 - f, -derivative) }
            };
            let ((wa, da), (wb, db)) = (part(0), part(1));
            let vertex = [0, 1].map(|k| side[k].0 + up[k]);
            // The vertex past a single one has no weight.
            if vertex[0] >= side[0].3 || vertex[1] >= side[1].3 {
                continue;
            }
            let mut by_x = [0.0; 4];
            (by_x[pair[0]], by_x[pair[1]]) = (da * wb, wa * db);
            let at = start + (vertex[0] + side[0].3 * vertex[1]) * self.features;
            all.push(Corner { start: at, weight: wa * wb, by_x });
        }
        all
    }
}

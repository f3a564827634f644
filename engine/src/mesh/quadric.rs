//! How far a point in six dimensions (place and colour) is from the planes of the triangles that it stands for.
//!
//! Source: Garland and Heckbert, "Simplifying surfaces with color and texture using quadric error metrics", 1998.

/// Dimensions: x, y, z, and three of colour.
pub(super) const DIM: usize = 6;
/// Numbers of a symmetric matrix.
const HALF: usize = DIM * (DIM + 1) / 2;

/// A vertex: place in cells, colour in units of as much.
pub(super) type Point = [f64; DIM];

/// `x^T A x + 2 b^T x + c`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quadric {
    a: [f64; HALF],
    b: [f64; DIM],
    c: f64,
}

/// Place of `(i, j)`, `i <= j`, in the upper triangle.
const fn at(i: usize, j: usize) -> usize {
    i * DIM - i * (i + 1) / 2 + j
}

fn dot(a: &Point, b: &Point) -> f64 {
    (0..DIM).map(|k| a[k] * b[k]).sum()
}

pub(super) fn minus(a: &Point, b: &Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

impl Quadric {
    pub(super) const ZERO: Self = Self { a: [0.0; HALF], b: [0.0; DIM], c: 0.0 };

    /// Squared distance to the plane of a triangle, `weight` times.
    pub(super) fn plane([p, q, r]: [&Point; 3], weight: f64) -> Self {
        let unit = |v: Point| {
            let length = dot(&v, &v).sqrt();
            (length > 1e-12).then(|| v.map(|x| x / length))
        };
        let Some(e) = unit(minus(q, p)) else { return Self::ZERO };
        let side = minus(r, p);
        let along = dot(&e, &side);
        let Some(f) = unit(std::array::from_fn(|k| side[k] - along * e[k])) else { return Self::ZERO };
        let (pe, pf) = (dot(p, &e), dot(p, &f));
        let mut out = Self::ZERO;
        for i in 0..DIM {
            for j in i..DIM {
                out.a[at(i, j)] = weight * (f64::from(u8::from(i == j)) - e[i] * e[j] - f[i] * f[j]);
            }
            out.b[i] = weight * (pe * e[i] + pf * f[i] - p[i]);
        }
        out.c = weight * (dot(p, p) - pe * pe - pf * pf);
        out
    }

    /// Squared distance in space to the plane through `p` across `normal`, a unit vector, `weight` times.
    pub(super) fn wall(p: &Point, normal: [f64; 3], weight: f64) -> Self {
        let n: Point = [normal[0], normal[1], normal[2], 0.0, 0.0, 0.0];
        let d = -dot(p, &n);
        let mut out = Self::ZERO;
        for i in 0..DIM {
            for j in i..DIM {
                out.a[at(i, j)] = weight * n[i] * n[j];
            }
            out.b[i] = weight * d * n[i];
        }
        out.c = weight * d * d;
        out
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.a.iter_mut().zip(&other.a).for_each(|(a, b)| *a += b);
        self.b.iter_mut().zip(&other.b).for_each(|(a, b)| *a += b);
        self.c += other.c;
    }

    /// Its value at `x`, `>= 0`.
    pub(super) fn error(&self, x: &Point) -> f64 {
        let mut sum = self.c;
        for i in 0..DIM {
            sum += x[i] * (2.0 * self.b[i] + self.a[at(i, i)] * x[i]);
            for j in i + 1..DIM {
                sum += 2.0 * x[i] * x[j] * self.a[at(i, j)];
            }
        }
        sum.max(0.0)
    }

    /// Where it is least, held softly at `x`: directions that it says nothing of stay as they are.
    pub(super) fn least(&self, x: &Point) -> Option<Point> {
        let trace: f64 = (0..DIM).map(|i| self.a[at(i, i)]).sum();
        let hold = 1e-3 * trace / DIM as f64;
        if hold <= 0.0 || !hold.is_finite() {
            return None;
        }
        // Cholesky of A + hold I, solved for hold x - b.
        let mut l = [[0.0; DIM]; DIM];
        for i in 0..DIM {
            for j in 0..=i {
                let mut sum = self.a[at(j, i)] + if i == j { hold } else { 0.0 };
                sum -= (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
                l[i][j] = if i == j { (sum > 0.0).then(|| sum.sqrt())? } else { sum / l[j][j] };
            }
        }
        let mut y: Point = std::array::from_fn(|i| hold * x[i] - self.b[i]);
        for i in 0..DIM {
            y[i] = (y[i] - (0..i).map(|k| l[i][k] * y[k]).sum::<f64>()) / l[i][i];
        }
        for i in (0..DIM).rev() {
            y[i] = (y[i] - (i + 1..DIM).map(|k| l[k][i] * y[k]).sum::<f64>()) / l[i][i];
        }
        y.iter().all(|v| v.is_finite()).then_some(y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const P: Point = [1.0, 0.0, 0.0, 0.2, 0.0, 0.1];
    const Q: Point = [0.0, 2.0, 0.0, 0.0, 0.3, 0.1];
    const R: Point = [0.0, 0.0, 3.0, 0.5, 0.0, 0.9];

    #[test]
    fn on_the_plane_there_is_no_error_and_off_it_the_squared_distance() {
        let plane = Quadric::plane([&P, &Q, &R], 2.0);
        let inside: Point = std::array::from_fn(|k| 0.2 * P[k] + 0.5 * Q[k] + 0.3 * R[k]);
        assert!(plane.error(&inside) < 1e-12);
        // A direction across both sides, by Gram and Schmidt.
        let e = minus(&Q, &P).map(|x| x / dot(&minus(&Q, &P), &minus(&Q, &P)).sqrt());
        let s = minus(&R, &P);
        let f: Point = std::array::from_fn(|k| s[k] - dot(&s, &e) * e[k]);
        let f = f.map(|x| x / dot(&f, &f).sqrt());
        let mut n: Point = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0];
        n = std::array::from_fn(|k| n[k] - e[3] * e[k] - f[3] * f[k]);
        let n = n.map(|x| x / dot(&n, &n).sqrt());
        let off: Point = std::array::from_fn(|k| inside[k] + 0.7 * n[k]);
        assert!((plane.error(&off) - 2.0 * 0.49).abs() < 1e-9);
    }

    #[test]
    fn the_least_point_lies_on_all_planes_where_there_is_one() {
        let mut sum = Quadric::ZERO;
        for (axis, place) in [(0, 1.0), (1, -2.0), (2, 0.5)] {
            let normal = std::array::from_fn(|k| f64::from(u8::from(k == axis)));
            sum.add(&Quadric::wall(&[place; DIM], normal, 1.0));
        }
        let start = [0.9, -2.1, 0.6, 0.3, 0.4, 0.5];
        let least = sum.least(&start).unwrap();
        for (k, want) in [1.0, -2.0, 0.5, 0.3, 0.4, 0.5].into_iter().enumerate() {
            assert!((least[k] - want).abs() < 1e-3, "{least:?}");
        }
        assert!(Quadric::ZERO.least(&start).is_none());
        assert_eq!(Quadric::plane([&P, &P, &R], 1.0).error(&Q), 0.0);
    }
}

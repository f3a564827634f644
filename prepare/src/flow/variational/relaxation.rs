//! Successive over-relaxation, the pixels coloured as a chess board: those of one colour have neighbours of the other only, so that all of
//! a colour are relaxed at one time, and the result does not depend on the order.

use super::equations::Pixel;
use crate::flow::field::Field;
use rayon::prelude::*;

/// How far beyond its solution a pixel is moved.
const OVER: f32 = 1.6;
/// A determinant below this is that of a pixel which neither pictures nor neighbours say anything of.
const NOTHING: f32 = 1e-12;

/// A flow, its two colours apart: pixel `(x, y)` is number `x / 2` of row `y` of colour `(x + y) % 2`.
pub(super) struct Checkers {
    width: usize,
    height: usize,
    /// Pixels of a row of one colour; of odd widths the last one of some rows is none.
    half: usize,
    colours: [Vec<[f32; 2]>; 2],
}

impl Checkers {
    pub(super) fn of(flow: &Field) -> Self {
        let (width, height) = (flow.width(), flow.height());
        let half = width.div_ceil(2);
        let colours = [0, 1].map(|colour| {
            let pixels = (0..height).flat_map(|y| (0..half).map(move |i| (2 * i + (y + colour) % 2, y)));
            pixels.map(|(x, y)| if x < width { flow.at(x, y) } else { [0.0; 2] }).collect()
        });
        Self { width, height, half, colours }
    }

    pub(super) fn field(&self) -> Field {
        Field::from_fn(self.width, self.height, |x, y| self.colours[(x + y) % 2][y * self.half + x / 2])
    }

    /// All pixels once, one colour after the other.
    pub(super) fn sweep(&mut self, pixels: &[Pixel]) {
        let (width, height, half) = (self.width, self.height, self.half);
        let [even, odd] = &mut self.colours;
        relax(&Board { width, height, half, pixels, other: odd }, 0, even);
        relax(&Board { width, height, half, pixels, other: even }, 1, odd);
    }
}

/// What is held while a colour is relaxed.
struct Board<'a> {
    width: usize,
    height: usize,
    half: usize,
    pixels: &'a [Pixel],
    /// The other colour.
    other: &'a [[f32; 2]],
}

fn relax(board: &Board<'_>, colour: usize, own: &mut [[f32; 2]]) {
    own.par_chunks_mut(board.half.max(1)).enumerate().for_each(|(y, row)| {
        for (i, flow) in row.iter_mut().enumerate() {
            let x = 2 * i + (y + colour) % 2;
            if x < board.width {
                board.relax(x, y, flow);
            }
        }
    });
}

impl Board<'_> {
    fn relax(&self, x: usize, y: usize, flow: &mut [f32; 2]) {
        let at = y * self.width + x;
        let Pixel { matrix: [mut xx, xy, mut yy], mut wanted, right, below } = self.pixels[at];
        let mut pull = |weight: f32, row: usize, number: usize| {
            let there = self.other[row * self.half + number];
            xx += weight;
            yy += weight;
            wanted = [wanted[0] + weight * there[0], wanted[1] + weight * there[1]];
        };
        if x > 0 {
            pull(self.pixels[at - 1].right, y, (x - 1) / 2);
        }
        if x + 1 < self.width {
            pull(right, y, x.div_ceil(2));
        }
        if y > 0 {
            pull(self.pixels[at - self.width].below, y - 1, x / 2);
        }
        if y + 1 < self.height {
            pull(below, y + 1, x / 2);
        }
        let determinant = xx * yy - xy * xy;
        if determinant > NOTHING {
            let solved =
                [(yy * wanted[0] - xy * wanted[1]) / determinant, (xx * wanted[1] - xy * wanted[0]) / determinant];
            *flow = [flow[0] + OVER * (solved[0] - flow[0]), flow[1] + OVER * (solved[1] - flow[1])];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_is_the_field_it_was_made_of() {
        for (width, height) in [(1, 1), (3, 2), (4, 5), (7, 3)] {
            let field = Field::from_fn(width, height, |x, y| [x as f32, 10.0 * y as f32]);
            assert_eq!(Checkers::of(&field).field(), field, "{width}x{height}");
        }
    }

    #[test]
    fn sweeps_converge_to_the_solution_of_the_equations() {
        let (width, height) = (9, 7);
        let random = |k: usize| ((k * 2_654_435_761) % 1000) as f32 / 1000.0;
        let pixels: Vec<Pixel> = (0..width * height)
            .map(|k| Pixel {
                // 0.4^2 < 0.5 * 0.5: as of a sum of squares.
                matrix: [0.5 + random(k), 0.4, 0.5 + random(k + 1)],
                wanted: [random(k + 2), -random(k + 3)],
                right: if k % width + 1 < width { 0.2 + random(k + 4) } else { 0.0 },
                below: if k / width + 1 < height { 0.2 + random(k + 5) } else { 0.0 },
            })
            .collect();
        let mut checkers = Checkers::of(&Field::zero(width, height));
        for _ in 0..200 {
            checkers.sweep(&pixels);
        }
        let flow = checkers.field();
        for k in 0..width * height {
            let (x, y) = (k % width, k / width);
            let [u, v] = flow.at(x, y);
            let Pixel { matrix: [xx, xy, yy], wanted, right, below } = pixels[k];
            let mut left = [xx * u + xy * v - wanted[0], xy * u + yy * v - wanted[1]];
            let mut pull = |weight: f32, there: [f32; 2]| {
                left = [left[0] + weight * (u - there[0]), left[1] + weight * (v - there[1])];
            };
            if x > 0 {
                pull(pixels[k - 1].right, flow.at(x - 1, y));
            }
            if x + 1 < width {
                pull(right, flow.at(x + 1, y));
            }
            if y > 0 {
                pull(pixels[k - width].below, flow.at(x, y - 1));
            }
            if y + 1 < height {
                pull(below, flow.at(x, y + 1));
            }
            assert!(left[0].abs() < 1e-4 && left[1].abs() < 1e-4, "({x}, {y}): {left:?}");
        }
    }
}

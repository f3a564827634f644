//! Superpixels: a photo cut into small pieces of one colour, for votes where no program drew segments.
//!
//! Letters: `n` pixels, `k` pieces asked for, `S = sqrt(n / k)` their side; each has a centre of colour `c` (CIELAB) and place
//! `p` (pixels). A pixel goes to the centre with the smallest
//!
//! ```text
//! |c - c_j|^2 + (m / S)^2 |p - p_j|^2        among those within S of it along each axis
//! ```
//!
//! `m` compactness: large ones make squares, small ones follow colours. Centres move to the mean of their pixels, ten times
//! over; then each connected piece is one of its own, and those below a quarter of `S^2` join a neighbour.
//!
//! No random numbers: centres start on a lattice, ties go to the lower number, pieces are numbered by their first pixel.
//!
//! Source: Achanta et al., "SLIC superpixels compared to state-of-the-art superpixel methods", 2012, algorithm 1.

use super::extent::Extent;
use crate::LossError;
use alloc::vec::Vec;
use float_core::{m32, m64};

/// Labels are 16 bits wide, and 0 is not a piece.
const MOST: usize = u16::MAX as usize;

/// How a photo is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Superpixels {
    /// Pieces asked for, `1..=65535`; about as many come out.
    pub count: usize,
    /// `m`, in units of CIELAB: finite and above 0.
    pub compactness: f32,
    /// Times that centres move.
    pub rounds: usize,
}

impl Default for Superpixels {
    /// 400 pieces, compactness 10, ten rounds.
    fn default() -> Self {
        Self { count: 400, compactness: 10.0, rounds: 10 }
    }
}

/// CIELAB (white of daylight, D65) of an sRGB colour in `[0, 1]`: lightness 0 to 100, and two chroma axes.
///
/// Source: IEC 61966-2-1 and CIE 15.
#[must_use]
pub fn lab(srgb: [f32; 3]) -> [f32; 3] {
    let linear = srgb.map(|c| if c <= 0.04045 { c / 12.92 } else { m32::powf((c + 0.055) / 1.055, 2.4) });
    // Rows of the matrix from linear sRGB, divided by the white point.
    const XYZ: [[f32; 3]; 3] = [
        [0.412_456_4 / 0.950_47, 0.357_576_1 / 0.950_47, 0.180_437_5 / 0.950_47],
        [0.212_672_9, 0.715_152_2, 0.072_175],
        [0.019_333_9 / 1.088_83, 0.119_192 / 1.088_83, 0.950_304_1 / 1.088_83],
    ];
    let [x, y, z] = XYZ.map(|row| {
        let t = row[0] * linear[0] + row[1] * linear[1] + row[2] * linear[2];
        // A line below (6 / 29)^3, where the root would be too steep.
        if t > 216.0 / 24389.0 { m32::cbrt(t) } else { t * (841.0 / 108.0) + 4.0 / 29.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

#[derive(Clone, Copy, Default)]
struct Centre {
    colour: [f64; 3],
    place: [f64; 2],
}

impl Superpixels {
    float_core::setters! {
        with_count count: usize;
        with_compactness compactness: f32;
        with_rounds rounds: usize;
    }

    /// Cut a photo into pieces: `labels` from 1 on, each connected. Returns how many there are; 0 for no pixels.
    ///
    /// # Shapes and units
    /// * `rgb` `[height][width]` sRGB colours, `[0, 1]`; those that are not finite count as black
    /// * `labels` `[height][width]` out, written
    ///
    /// # Errors
    /// [`LossError::Shape`] where lengths disagree, [`LossError::Parameter`] for a parameter outside its range.
    pub fn run(&self, extent: Extent, rgb: &[[f32; 3]], labels: &mut [u16]) -> Result<usize, LossError> {
        extent.check("rgb", rgb.len())?;
        extent.check("labels", labels.len())?;
        if !(self.compactness > 0.0 && self.compactness.is_finite()) {
            let (what, value) = ("compactness of superpixels", self.compactness);
            return Err(LossError::Parameter { what, value, range: "a finite number above 0" });
        }
        if !(1..=MOST).contains(&self.count) {
            let (what, value) = ("number of superpixels", self.count as f32);
            return Err(LossError::Parameter { what, value, range: "1 to 65535" });
        }
        if rgb.is_empty() {
            return Ok(0);
        }
        let colours: Vec<[f32; 3]> =
            rgb.iter().map(|c| lab(c.map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 }))).collect();
        let side = m64::sqrt(extent.pixels() as f64 / self.count as f64).max(1.0);
        let mut centres = lattice(extent, side, &colours);
        let mut nearest = alloc::vec![0_u32; rgb.len()];
        for _ in 0..self.rounds.max(1) {
            self.assign(extent, side, &colours, &centres, &mut nearest);
            move_centres(extent, &colours, &nearest, &mut centres);
        }
        let least = (side * side / 4.0) as usize;
        Ok(connect(extent, &nearest, least, labels))
    }

    /// The nearest centre of each pixel. Pixels that no centre reaches keep the one they had.
    fn assign(&self, extent: Extent, side: f64, colours: &[[f32; 3]], centres: &[Centre], nearest: &mut [u32]) {
        let mut best = alloc::vec![f64::INFINITY; nearest.len()];
        let per_pixel = (f64::from(self.compactness) / side) * (f64::from(self.compactness) / side);
        for (j, centre) in centres.iter().enumerate() {
            // `as` saturates at 0.
            let span = |at: f64, n: usize| (at - side) as usize..((at + side) as usize + 1).min(n);
            for y in span(centre.place[1], extent.height) {
                for x in span(centre.place[0], extent.width) {
                    let i = y * extent.width + x;
                    let (dx, dy) = (x as f64 + 0.5 - centre.place[0], y as f64 + 0.5 - centre.place[1]);
                    let colour: f64 = (0..3).map(|c| square(f64::from(colours[i][c]) - centre.colour[c])).sum();
                    let distance = colour + per_pixel * (dx * dx + dy * dy);
                    if distance < best[i] {
                        (best[i], nearest[i]) = (distance, j as u32);
                    }
                }
            }
        }
    }
}

fn square(x: f64) -> f64 {
    x * x
}

/// Centres in the middle of the cells of a lattice, each moved to the flattest pixel of the nine around it.
fn lattice(extent: Extent, side: f64, colours: &[[f32; 3]]) -> Vec<Centre> {
    let Extent { width, height } = extent;
    let cells = |n: usize| (m64::floor(n as f64 / side + 0.5) as usize).clamp(1, n);
    let (columns, rows) = (cells(width), cells(height));
    let slope = |x: usize, y: usize| {
        let between = |a: usize, b: usize| -> f32 { (0..3).map(|c| (colours[a][c] - colours[b][c]).abs()).sum() };
        let at = |x: usize, y: usize| y.min(height - 1) * width + x.min(width - 1);
        between(at(x + 1, y), at(x.saturating_sub(1), y)) + between(at(x, y + 1), at(x, y.saturating_sub(1)))
    };
    let mut centres = Vec::with_capacity(columns * rows);
    for row in 0..rows {
        for column in 0..columns {
            let middle = |i: usize, n: usize, cells: usize| (2 * i + 1) * n / (2 * cells);
            let (x0, y0) = (middle(column, width, columns), middle(row, height, rows));
            let mut best = (slope(x0, y0), x0, y0);
            for y in y0.saturating_sub(1)..(y0 + 2).min(height) {
                for x in x0.saturating_sub(1)..(x0 + 2).min(width) {
                    if slope(x, y) < best.0 {
                        best = (slope(x, y), x, y);
                    }
                }
            }
            let (_, x, y) = best;
            let colour = colours[y * width + x].map(f64::from);
            centres.push(Centre { colour, place: [x as f64 + 0.5, y as f64 + 0.5] });
        }
    }
    centres
}

/// Each centre to the mean of its pixels; one without any stays.
fn move_centres(extent: Extent, colours: &[[f32; 3]], nearest: &[u32], centres: &mut [Centre]) {
    let mut sums = alloc::vec![(Centre::default(), 0.0_f64); centres.len()];
    for (i, &j) in nearest.iter().enumerate() {
        let (sum, count) = &mut sums[j as usize];
        (0..3).for_each(|c| sum.colour[c] += f64::from(colours[i][c]));
        sum.place[0] += (i % extent.width) as f64 + 0.5;
        sum.place[1] += (i / extent.width) as f64 + 0.5;
        *count += 1.0;
    }
    for (centre, (sum, count)) in centres.iter_mut().zip(sums).filter(|(_, (_, count))| *count > 0.0) {
        *centre = Centre { colour: sum.colour.map(|c| c / count), place: sum.place.map(|p| p / count) };
    }
}

/// Connected pieces (over edges), numbered by their first pixel; one of less than `least` pixels joins the piece before its
/// first pixel, to the left or above. Returns how many there are.
fn connect(extent: Extent, nearest: &[u32], least: usize, labels: &mut [u16]) -> usize {
    labels.fill(0);
    let (mut count, mut piece) = (0_usize, Vec::new());
    for first in 0..nearest.len() {
        if labels[first] != 0 {
            continue;
        }
        let (x, y) = (first % extent.width, first / extent.width);
        let beside = if x > 0 {
            labels[first - 1]
        } else if y > 0 {
            labels[first - extent.width]
        } else {
            0
        };
        let own = (count + 1).min(MOST) as u16;
        piece.clear();
        piece.push(first);
        labels[first] = own;
        let mut next = 0;
        while let Some(&i) = piece.get(next) {
            next += 1;
            let (x, y) = (i % extent.width, i / extent.width);
            let around = [
                (x > 0).then(|| i - 1),
                (x + 1 < extent.width).then_some(i + 1),
                (y > 0).then(|| i - extent.width),
                (y + 1 < extent.height).then_some(i + extent.width),
            ];
            for other in around.into_iter().flatten() {
                if labels[other] == 0 && nearest[other] == nearest[first] {
                    labels[other] = own;
                    piece.push(other);
                }
            }
        }
        // Labels that ran out are shared with the piece beside, which is there by then.
        if beside != 0 && (piece.len() < least || count == MOST) {
            piece.iter().for_each(|&i| labels[i] = beside);
        } else {
            count += 1;
        }
    }
    count
}

//! Places of a photo that can be found again: texture in two directions, spread over the picture.

use super::photo::Photo;
use glam::DVec2;

/// Side of a cell of the grid that corners are spread over, pixels; in each of them a share is kept first.
const CELL: usize = 24;
/// The smaller eigenvalue of the gradients' moments, in grey levels squared: less is noise.
const LEAST: f32 = 6.0;
/// Border without corners, pixels.
const BORDER: usize = 10;
/// A corner is the strongest place within this radius, pixels.
const APART: usize = 2;

/// Corners of a photo, the best of each cell first: pixels with centres at `+ 0.5`. At most `most`.
pub(super) fn corners(photo: &Photo, most: usize) -> Vec<DVec2> {
    let level = &photo.levels[0];
    let (w, h) = (level.width, level.height);
    if w < 2 * BORDER + 1 || h < 2 * BORDER + 1 {
        return Vec::new();
    }
    let strength = strengths(photo);
    let is_peak = |x: usize, y: usize| {
        let here = strength[y * w + x];
        let beats = |u: usize, v: usize| {
            let there = strength[v * w + u];
            // Of two equal ones the first counts.
            there < here || (there == here && (v, u) >= (y, x))
        };
        (y - APART..=y + APART).all(|v| (x - APART..=x + APART).all(|u| beats(u, v)))
    };
    let across = w.div_ceil(CELL);
    let mut cells: Vec<Vec<(f32, usize, usize)>> = vec![Vec::new(); across * h.div_ceil(CELL)];
    for y in BORDER..h - BORDER {
        for x in BORDER..w - BORDER {
            let here = strength[y * w + x];
            if here >= LEAST && is_peak(x, y) && photo.shows_around(x, y) {
                cells[y / CELL * across + x / CELL].push((here, x, y));
            }
        }
    }
    let mut ranked: Vec<(usize, f32, usize, usize)> = Vec::new();
    for cell in &mut cells {
        cell.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.2, a.1).cmp(&(b.2, b.1))));
        ranked.extend(cell.iter().enumerate().map(|(rank, &(strength, x, y))| (rank, strength, x, y)));
    }
    ranked.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)).then((a.3, a.2).cmp(&(b.3, b.2))));
    ranked.truncate(most);
    ranked.into_iter().map(|(_, _, x, y)| DVec2::new(x as f64 + 0.5, y as f64 + 0.5)).collect()
}

/// The smaller eigenvalue of the mean moments of the gradient over 5x5 pixels, 0 at the border.
fn strengths(photo: &Photo) -> Vec<f32> {
    let level = &photo.levels[0];
    let (w, h) = (level.width, level.height);
    let mut moments = vec![[0.0_f32; 3]; w * h];
    for y in 1..h - 1 {
        for x in 1..w - 1 {
            let dx = 0.5 * (level.grey(x + 1, y) - level.grey(x - 1, y));
            let dy = 0.5 * (level.grey(x, y + 1) - level.grey(x, y - 1));
            moments[y * w + x] = [dx * dx, dx * dy, dy * dy];
        }
    }
    const WEIGHTS: [f32; 5] = [1.0 / 16.0, 4.0 / 16.0, 6.0 / 16.0, 4.0 / 16.0, 1.0 / 16.0];
    let blurred = |from: &[[f32; 3]], step: usize, x: usize, y: usize| {
        let first = y * w + x - 2 * step;
        let mut sum = [0.0_f32; 3];
        for (k, weight) in WEIGHTS.iter().enumerate() {
            let m = from[first + k * step];
            (0..3).for_each(|a| sum[a] += weight * m[a]);
        }
        sum
    };
    let mut rows = vec![[0.0_f32; 3]; w * h];
    for y in 0..h {
        for x in 2..w - 2 {
            rows[y * w + x] = blurred(&moments, 1, x, y);
        }
    }
    let mut out = vec![0.0; w * h];
    for y in 3..h - 3 {
        for x in 3..w - 3 {
            let [a, b, c] = blurred(&rows, w, x, y);
            let half = 0.5 * (a - c);
            out[y * w + x] = 0.5 * (a + c) - (half * half + b * b).sqrt();
        }
    }
    out
}

//! One Gaussian at a time: what readers fill and writers take.

use super::file::count;
use crate::decode_memory::{DecodeMemory, Reserved};
use crate::{ErrorKind, Problem, SceneError};
use splat_core::{Gaussians, MAX_DEGREE, SplatError, rest_len};
use std::path::Path;

/// Opacities nearer than 1e-6 to 0 or 1 have no useful logit: `ln(999999)`.
pub(super) const LOGIT_LIMIT: f32 = 13.815_51;
/// Logarithm of the size of what has none.
pub(super) const LOG_SCALE_FLOOR: f32 = -20.0;
/// Bytes for the readers of a compressed file.
const READERS: u64 = 1 << 19;
/// Rotations shorter than this are none.
pub(super) const SHORTEST: f64 = 1e-8;

/// Raw parameters of one Gaussian.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) mean: [f32; 3],
    pub(super) log_scale: [f32; 3],
    pub(super) wxyz: [f32; 4],
    pub(super) logit: f32,
    pub(super) dc: [f32; 3],
    /// `3 (k - 1) + channel`; those of the cloud's degree count.
    pub(super) rest: [f32; 3 * rest_len(MAX_DEGREE)],
}

impl Row {
    pub(super) const EMPTY: Self = Self {
        mean: [0.0; 3],
        log_scale: [0.0; 3],
        wxyz: [1.0, 0.0, 0.0, 0.0],
        logit: 0.0,
        dc: [0.0; 3],
        rest: [0.0; 3 * rest_len(MAX_DEGREE)],
    };

    pub(super) fn of(cloud: &Gaussians, i: usize) -> Self {
        let n = cloud.len();
        let mut row = Self::EMPTY;
        take(&mut row.mean, &cloud.mean, n, i);
        take(&mut row.log_scale, &cloud.log_scale, n, i);
        take(&mut row.wxyz, &cloud.wxyz, n, i);
        take(&mut row.dc, &cloud.dc, n, i);
        take(&mut row.rest, &cloud.rest, n, i);
        row.logit = cloud.logit[i];
        row
    }

    /// The rotation with length 1; `None` where it has no direction.
    pub(super) fn unit_wxyz(&self) -> Option<[f64; 4]> {
        let q = self.wxyz.map(f64::from);
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        (norm >= SHORTEST).then(|| q.map(|x| x / norm))
    }

    /// Opacity in `[0, 1]`.
    pub(super) fn opacity(&self) -> f64 {
        1.0 / (1.0 + (-f64::from(self.logit)).exp())
    }
}

fn take(row: &mut [f32], field: &[f32], n: usize, i: usize) {
    for (value, column) in row.iter_mut().zip(field.chunks_exact(n)) {
        *value = column[i];
    }
}

fn put(row: &[f32], field: &mut [f32], n: usize, i: usize) {
    for (value, column) in row.iter().zip(field.chunks_exact_mut(n)) {
        column[i] = *value;
    }
}

/// `ln(o / (1 - o))` of an opacity stored as a byte; infinite at the ends.
pub(super) fn logit_of_byte(byte: u8) -> f32 {
    let o = f64::from(byte) / 255.0;
    (o / (1.0 - o)).ln() as f32
}

/// Fills a cloud, leaving out what is not finite.
pub(super) struct Filling {
    cloud: Gaussians,
    kept: usize,
    seen: usize,
    first_dropped: Option<usize>,
    logits: usize,
    scales: usize,
    _held: Reserved<'static>,
}

/// Bytes of a cloud.
fn cloud_bytes(n: usize, degree: usize) -> u64 {
    let numbers = 3 + 3 + 4 + 1 + 3 + 3 * rest_len(degree);
    (4 * numbers as u64).saturating_mul(n as u64)
}

impl Filling {
    /// Room for `n` Gaussians of a file of `file` bytes, which are in memory, too.
    pub(super) fn new(path: &Path, n: usize, degree: usize, file: usize) -> Result<Self, SceneError> {
        let bytes = cloud_bytes(n, degree.min(MAX_DEGREE)).saturating_add(file as u64 + READERS);
        let _held = DecodeMemory::of_process().reserve(path, &format!("its {n} Gaussians"), bytes)?;
        let cloud = Gaussians::new(n, degree).map_err(|e| refuse(path, e))?;
        Ok(Self { cloud, kept: 0, seen: 0, first_dropped: None, logits: 0, scales: 0, _held })
    }

    /// The next of the file. Infinite logits and sizes of 0 are what programs write for opacities of exactly 0 and 1
    /// and for flat splats: they become the nearest useful number.
    pub(super) fn push(&mut self, mut row: Row) {
        let i = self.seen;
        self.seen += 1;
        if row.logit.is_infinite() {
            row.logit = LOGIT_LIMIT.copysign(row.logit);
            self.logits += 1;
        }
        let flat = row.log_scale.contains(&f32::NEG_INFINITY);
        row.log_scale = row.log_scale.map(|s| if s == f32::NEG_INFINITY { LOG_SCALE_FLOOR } else { s });
        let all = row.mean.iter().chain(&row.log_scale).chain(&row.wxyz).chain(&row.dc).chain(&row.rest);
        if !(row.logit.is_finite() && all.copied().all(f32::is_finite)) {
            self.first_dropped.get_or_insert(i);
            return;
        }
        self.scales += usize::from(flat);
        let (n, k) = (self.cloud.len(), self.kept);
        put(&row.mean, &mut self.cloud.mean, n, k);
        put(&row.log_scale, &mut self.cloud.log_scale, n, k);
        put(&row.wxyz, &mut self.cloud.wxyz, n, k);
        put(&row.dc, &mut self.cloud.dc, n, k);
        put(&row.rest, &mut self.cloud.rest, n, k);
        self.cloud.logit[k] = row.logit;
        self.kept += 1;
    }

    /// The cloud; what was done to it goes to the notes.
    pub(super) fn finish(mut self, notes: &mut Vec<String>) -> Gaussians {
        let (n, kept) = (self.cloud.len(), self.kept);
        if self.logits > 0 {
            let what = count(self.logits, "opacity of exactly 0 or 1", "opacities of exactly 0 or 1");
            notes.push(format!("{what} moved inwards by 1e-6"));
        }
        if self.scales > 0 {
            let what = count(self.scales, "Gaussian without extent", "Gaussians without extent");
            notes.push(format!("{what} given a size of e^{LOG_SCALE_FLOOR}"));
        }
        if let Some(first) = self.first_dropped {
            let what = count(n - kept, "Gaussian that is not finite", "Gaussians that are not finite");
            notes.push(format!("{what} dropped of {n}, first number {first}"));
        }
        // In place: a second cloud would take as much again.
        self.cloud.truncate(kept);
        self.cloud
    }
}

/// Is this a cloud that can be written: all fields of their length, all numbers finite?
pub(super) fn check(path: &Path, cloud: &Gaussians) -> Result<(), SceneError> {
    cloud.check().map_err(|e| refuse(path, e))?;
    for (field, numbers) in cloud.fields() {
        if let Some(at) = numbers.iter().position(|x| !x.is_finite()) {
            let (row, i) = (at / cloud.len(), at % cloud.len());
            return Err(unfit(path, i, &format!("{}[{row}]", field.name()), numbers[at], "is not finite"));
        }
    }
    Ok(())
}

/// An error about one number of a cloud to be written.
pub(super) fn unfit(path: &Path, i: usize, field: &str, value: f32, what: &str) -> SceneError {
    let what = format!("Gaussian {i} {what}");
    let problem = Problem::new(path, what, "remove it or write another format").field(field).value(value);
    SceneError::new(ErrorKind::Value, problem)
}

fn refuse(path: &Path, error: SplatError) -> SceneError {
    let problem = Problem::new(path, error.to_string(), "this cloud cannot be stored");
    SceneError::new(ErrorKind::Value, problem).caused_by(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATH: &str = "a.ply";

    fn fill(rows: &[Row]) -> (Gaussians, Vec<String>) {
        let mut filling = Filling::new(Path::new(PATH), rows.len(), 1, 0).unwrap();
        rows.iter().for_each(|row| filling.push(*row));
        let mut notes = Vec::new();
        (filling.finish(&mut notes), notes)
    }

    #[test]
    fn what_is_not_finite_is_dropped_and_counted() {
        let at = |x: f32| Row { mean: [x, 2.0, 3.0], ..Row::EMPTY };
        let mut bad_rest = at(0.0);
        bad_rest.rest[8] = f32::NAN;
        let (cloud, notes) = fill(&[at(1.0), at(f32::NAN), bad_rest, at(4.0), at(f32::INFINITY)]);
        assert_eq!(cloud.mean, [1.0, 4.0, 2.0, 2.0, 3.0, 3.0]);
        assert_eq!((cloud.len(), cloud.degree(), cloud.rest.len()), (2, 1, 18));
        assert_eq!(notes, ["3 Gaussians that are not finite dropped of 5, first number 1"]);
        let (cloud, _) = fill(&[at(f32::NAN)]);
        assert!(cloud.is_empty() && cloud.check().is_ok());
    }

    #[test]
    fn ends_of_opacity_and_size_become_useful_numbers() {
        let row = Row { logit: f32::NEG_INFINITY, log_scale: [f32::NEG_INFINITY, -30.0, 0.0], ..Row::EMPTY };
        let (cloud, notes) = fill(&[row, Row { logit: f32::INFINITY, ..Row::EMPTY }]);
        assert_eq!(cloud.logit, [-LOGIT_LIMIT, LOGIT_LIMIT]);
        assert_eq!(cloud.log_scale[..4], [LOG_SCALE_FLOOR, 0.0, -30.0, 0.0]);
        assert_eq!(notes.len(), 2);
        assert!((Row::of(&cloud, 0).opacity() - 1e-6).abs() < 1e-12, "{}", Row::of(&cloud, 0).opacity());
    }

    #[test]
    fn a_row_comes_back_from_a_cloud() {
        let mut row = Row::EMPTY;
        (row.mean, row.log_scale, row.wxyz) = ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0, 10.0]);
        (row.logit, row.dc) = (11.0, [12.0, 13.0, 14.0]);
        row.rest[..9].copy_from_slice(&[1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5, 8.5, 9.5]);
        let (cloud, _) = fill(&[Row::EMPTY, row, Row::EMPTY]);
        let got = Row::of(&cloud, 1);
        assert_eq!((got.mean, got.log_scale, got.wxyz), (row.mean, row.log_scale, row.wxyz));
        assert_eq!((got.logit, got.dc, got.rest), (row.logit, row.dc, row.rest));
    }

    #[test]
    fn numbers_that_cannot_be_written_are_named() {
        let mut cloud = Gaussians::new(4, 0).unwrap();
        cloud.wxyz[4 * 2 + 3] = f32::INFINITY;
        let error = check(Path::new(PATH), &cloud).unwrap_err().to_string();
        assert!(error.contains("`wxyz[2]` = inf: Gaussian 3 is not finite"), "{error}");
        cloud.wxyz.pop();
        assert!(check(Path::new(PATH), &cloud).unwrap_err().to_string().contains("wxyz"));
    }

    #[test]
    fn opacities_of_bytes_are_logits() {
        assert_eq!((logit_of_byte(0), logit_of_byte(255)), (f32::NEG_INFINITY, f32::INFINITY));
        for byte in 1..255 {
            let row = Row { logit: logit_of_byte(byte), ..Row::EMPTY };
            assert_eq!((255.0 * row.opacity()).round() as u8, byte);
        }
    }
}

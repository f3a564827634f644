//! `.splat`: 32 bytes a Gaussian, no header, little-endian.
//!
//! | bytes | what |
//! | --- | --- |
//! | 0..12 | position, 3 `f32` |
//! | 12..24 | standard deviations, 3 `f32`, linear |
//! | 24..28 | red, green, blue, opacity: `round(255 x)` |
//! | 28..32 | rotation `wxyz`: `round(128 q + 128)`, at most 255 |

use super::file::{SplatFile, count};
use super::rows::{Filling, Row, logit_of_byte, unfit};
use crate::{ErrorKind, Problem, SceneError};
use splat_core::{Gaussians, SH_0};
use std::io::{self, Write};
use std::path::Path;

/// Bytes of a Gaussian.
const RECORD: usize = 32;

/// Is the length that of whole records?
pub(super) fn may_be(bytes: &[u8]) -> bool {
    bytes.len().is_multiple_of(RECORD)
}

pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<SplatFile, SceneError> {
    let (records, left) = bytes.as_chunks::<RECORD>();
    if !left.is_empty() {
        let what = format!("is cut off or is not a .splat file: {} bytes are not a multiple of {RECORD}", bytes.len());
        let problem = Problem::new(path, what, "fetch it again");
        return Err(SceneError::new(ErrorKind::Format, problem));
    }
    let mut filling = Filling::new(path, records.len(), 0, bytes.len())?;
    let (mut turned, mut negative) = (0, 0);
    for record in records {
        let f = |i: usize| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|k| record[4 * i + k]);
            f32::from_le_bytes([a, b, c, d])
        };
        let scale = [3, 4, 5].map(f);
        negative += usize::from(scale.iter().any(|s| *s < 0.0));
        // A rotation of length 0 has no direction: none at all.
        let q = [28, 29, 30, 31].map(|i| (f64::from(record[i]) - 128.0) / 128.0);
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        turned += usize::from(norm == 0.0);
        filling.push(Row {
            mean: [0, 1, 2].map(f),
            // The covariance takes squares.
            log_scale: scale.map(|s| f64::from(s).abs().ln() as f32),
            wxyz: if norm == 0.0 { Row::EMPTY.wxyz } else { q.map(|x| (x / norm) as f32) },
            logit: logit_of_byte(record[27]),
            dc: [24, 25, 26].map(|i| ((f64::from(record[i]) / 255.0 - 0.5) / f64::from(SH_0)) as f32),
            rest: Row::EMPTY.rest,
        });
    }
    let mut notes = Vec::new();
    if negative > 0 {
        notes.push(format!("{} taken without their sign", count(negative, "negative size", "negative sizes")));
    }
    if turned > 0 {
        notes.push(format!("{} without direction taken as none", count(turned, "rotation", "rotations")));
    }
    Ok(SplatFile { cloud: filling.finish(&mut notes), widening: None, notes })
}

/// A cloud that fits, in the order to be written: what covers most comes first, for viewers that show files while they
/// are still loading.
pub(super) struct Sorted<'a> {
    cloud: &'a Gaussians,
    order: Vec<usize>,
}

impl<'a> Sorted<'a> {
    pub(super) fn new(path: &Path, cloud: &'a Gaussians, notes: &mut Vec<String>) -> Result<Self, SceneError> {
        let (mut keys, mut colours, mut thin, mut turned) = (Vec::with_capacity(cloud.len()), 0, 0, 0);
        for i in 0..cloud.len() {
            let row = Row::of(cloud, i);
            for (k, log_scale) in row.log_scale.into_iter().enumerate() {
                let scale = f64::from(log_scale).exp() as f32;
                if scale.is_infinite() {
                    let what = "is larger than a `.splat` file can say";
                    return Err(unfit(path, i, &format!("log_scale[{k}]"), log_scale, what));
                }
                thin += usize::from(scale < f32::MIN_POSITIVE);
            }
            colours += usize::from(row.dc.iter().any(|h| !(0.0..=1.0).contains(&colour(*h))));
            turned += usize::from(row.unit_wxyz().is_none());
            let logit = f64::from(row.logit);
            // ln(s_x s_y s_z o); the logarithm of the logistic function without overflow.
            let opacity = logit.min(0.0) - (-logit.abs()).exp().ln_1p();
            keys.push(row.log_scale.map(f64::from).iter().sum::<f64>() + opacity);
        }
        let mut order: Vec<usize> = (0..cloud.len()).collect();
        order.sort_by(|a, b| keys[*b].total_cmp(&keys[*a]));
        if cloud.degree() > 0 {
            notes.push(format!("colours of degree 1 to {} left out: a .splat file holds degree 0", cloud.degree()));
        }
        let many = [
            (colours, "colour", "colours", "outside [0, 1] clamped"),
            (thin, "size", "sizes", "below 1e-38 raised"),
            (turned, "rotation", "rotations", "without direction written as none"),
        ];
        for (n, one, more, what) in many {
            if n > 0 {
                notes.push(format!("{} {what}", count(n, one, more)));
            }
        }
        Ok(Self { cloud, order })
    }

    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        for &i in &self.order {
            let row = Row::of(self.cloud, i);
            let mut record = [0; RECORD];
            let scale = row.log_scale.map(|s| (f64::from(s).exp() as f32).max(f32::MIN_POSITIVE));
            for (bytes, x) in record.as_chunks_mut::<4>().0.iter_mut().zip(row.mean.into_iter().chain(scale)) {
                *bytes = x.to_le_bytes();
            }
            // `as` clamps to 0..=255.
            let byte = |x: f64| (255.0 * x).round() as u8;
            record[24..27].copy_from_slice(&row.dc.map(|h| byte(colour(h))));
            record[27] = byte(row.opacity());
            let q = row.unit_wxyz().unwrap_or([1.0, 0.0, 0.0, 0.0]);
            record[28..].copy_from_slice(&q.map(|x| (128.0 * x + 128.0).round() as u8));
            out.write_all(&record)?;
        }
        Ok(())
    }
}

/// Colour seen at degree 0.
fn colour(h: f32) -> f64 {
    0.5 + f64::from(SH_0) * f64::from(h)
}

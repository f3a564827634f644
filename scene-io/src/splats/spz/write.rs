//! Writing SPZ, version 3.

use super::super::file::{SplatOptions, count};
use super::super::rows::{Row, unfit};
use super::{ANTIALIASED, COLOUR, FLIP, FLIP_SH, HEADER, MAGIC, MAX_COUNT, MAX_FRACTIONAL_BITS, rotation};
use crate::{ErrorKind, Problem, SceneError};
use flate2::Compression;
use flate2::write::GzEncoder;
use splat_core::{Gaussians, Widening, rest_len};
use std::io::{self, Write};
use std::path::Path;

const VERSION: u32 = 3;
/// Largest magnitude of 24 bits with a sign.
const FIXED_MAX: f64 = 8_388_607.0;
/// What other programs write: fewer are worth a note.
const USUAL_BITS: u32 = 12;
/// Harmonics are rounded to multiples of these, degree 1 and above: fewer values compress better.
const BUCKETS: [f64; 2] = [8.0, 16.0];

/// A cloud that fits.
pub(in super::super) struct Packing<'a> {
    cloud: &'a Gaussians,
    header: [u8; HEADER],
    fractional_bits: u32,
}

impl<'a> Packing<'a> {
    pub(in super::super) fn new(
        path: &Path,
        cloud: &'a Gaussians,
        options: &SplatOptions,
        notes: &mut Vec<String>,
    ) -> Result<Self, SceneError> {
        let n = cloud.len();
        if n > MAX_COUNT {
            let what = format!("{n} Gaussians are more than the {MAX_COUNT} that readers of SPZ take");
            let problem = Problem::new(path, what, "write PLY or fewer Gaussians");
            return Err(SceneError::new(ErrorKind::Value, problem));
        }
        let fractional_bits = bits_for(path, cloud, options.fractional_bits, notes)?;
        note_clamps(cloud, notes);
        let mut header = [0; HEADER];
        header[..4].copy_from_slice(MAGIC);
        header[4..8].copy_from_slice(&VERSION.to_le_bytes());
        // At most ten millions and 24 bits.
        header[8..12].copy_from_slice(&(n as u32).to_le_bytes());
        header[12] = cloud.degree() as u8;
        header[13] = fractional_bits as u8;
        header[14] = if options.widening == Widening::Dims { ANTIALIASED } else { 0 };
        Ok(Self { cloud, header, fractional_bits })
    }

    pub(in super::super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut gzip = GzEncoder::new(out, Compression::default());
        gzip.write_all(&self.header)?;
        let unit = f64::from(1_u32 << self.fractional_bits);
        self.block(&mut gzip, |row, out| {
            for (x, flip) in row.mean.into_iter().zip(FLIP) {
                out.extend(&(fixed(flip * x, unit) as i32).to_le_bytes()[..3]);
            }
        })?;
        self.block(&mut gzip, |row, out| out.push(byte(255.0 * row.opacity())))?;
        self.block(&mut gzip, |row, out| out.extend(row.dc.map(|h| byte(colour(h)))))?;
        self.block(&mut gzip, |row, out| out.extend(row.log_scale.map(|l| byte(size(l)))))?;
        self.block(&mut gzip, |row, out| {
            let [w, x, y, z] = row.unit_wxyz().unwrap_or([1.0, 0.0, 0.0, 0.0]);
            let [a, b, c] = FLIP.map(f64::from);
            out.extend(rotation::pack([w, a * x, b * y, c * z]));
        })?;
        let harmonics = 3 * rest_len(self.cloud.degree());
        self.block(&mut gzip, |row, out| {
            let rest = row.rest[..harmonics].iter().enumerate();
            out.extend(rest.map(|(k, h)| byte(harmonic(FLIP_SH[k / 3] * h, bucket(k)))));
        })?;
        gzip.finish().map(drop)
    }

    fn block(&self, out: &mut dyn Write, each: impl Fn(&Row, &mut Vec<u8>)) -> io::Result<()> {
        let mut bytes = Vec::new();
        for i in 0..self.cloud.len() {
            bytes.clear();
            each(&Row::of(self.cloud, i), &mut bytes);
            out.write_all(&bytes)?;
        }
        Ok(())
    }
}

/// Position as a multiple of `1 / unit`.
fn fixed(x: f32, unit: f64) -> f64 {
    (f64::from(x) * unit).round()
}

fn colour(h: f32) -> f64 {
    255.0 * (COLOUR * f64::from(h) + 0.5)
}

fn size(log_scale: f32) -> f64 {
    16.0 * (f64::from(log_scale) + 10.0)
}

/// Bucket of number `k` of the harmonics of a Gaussian: nine are of degree 1.
fn bucket(k: usize) -> f64 {
    BUCKETS[usize::from(k >= 9)]
}

fn harmonic(h: f32, bucket: f64) -> f64 {
    ((128.0 * f64::from(h) + 128.0) / bucket).round() * bucket
}

/// The nearest of 0 to 255.
fn byte(x: f64) -> u8 {
    x.round() as u8
}

/// Would the nearest byte be more than half a step off?
fn clamped(x: f64, step: f64) -> bool {
    !(-0.5 * step..=255.0 + 0.5 * step).contains(&x)
}

/// Fractional bits that hold all positions: those asked for, or as many as there may be.
fn bits_for(path: &Path, cloud: &Gaussians, asked: Option<u32>, notes: &mut Vec<String>) -> Result<u32, SceneError> {
    let n = cloud.len().max(1);
    let far = cloud.mean.iter().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let (at, x) = far.map_or((0, 0.0), |(at, x)| (at, *x));
    let fits = |bits: &u32| fixed(x, f64::from(1_u32 << bits)).abs() <= FIXED_MAX;
    let bits = match asked {
        Some(bits) if bits > MAX_FRACTIONAL_BITS => {
            let what = format!("{bits} fractional bits asked for where a position has 24");
            let problem = Problem::new(path, what, "ask for 0 to 24, or leave the choice to the writer");
            return Err(SceneError::new(ErrorKind::Value, problem));
        }
        Some(bits) => Some(bits).filter(fits),
        None => (0..=MAX_FRACTIONAL_BITS).rev().find(fits),
    };
    let Some(bits) = bits else {
        let what = format!("lies beyond the 24-bit positions of SPZ with {} fractional bits", asked.unwrap_or(0));
        return Err(unfit(path, at % n, &format!("mean[{}]", at / n), x, &what));
    };
    if bits < USUAL_BITS && asked.is_none() {
        let (i, step) = (at % n, 0.5_f64.powi(bits as i32));
        notes.push(format!("positions rounded to multiples of {step}: Gaussian {i} lies as far out as {x}"));
    }
    Ok(bits)
}

fn note_clamps(cloud: &Gaussians, notes: &mut Vec<String>) {
    let [mut sizes, mut colours, mut harmonics, mut turned] = [0; 4];
    for i in 0..cloud.len() {
        let row = Row::of(cloud, i);
        sizes += row.log_scale.iter().filter(|l| clamped(size(**l), 1.0)).count();
        colours += row.dc.iter().filter(|h| clamped(colour(**h), 1.0)).count();
        let rest = row.rest[..3 * rest_len(cloud.degree())].iter().enumerate();
        let value = |k: usize, h: f32| 128.0 * f64::from(FLIP_SH[k / 3] * h) + 128.0;
        harmonics += rest.filter(|(k, h)| clamped(value(*k, **h), bucket(*k))).count();
        turned += usize::from(row.unit_wxyz().is_none());
    }
    let many = [
        (sizes, "size", "sizes", "clamped to e^-10 … e^5.94"),
        (colours, "colour", "colours", "clamped to -3.3 … 3.3"),
        (harmonics, "colour above degree 0", "colours above degree 0", "clamped to -1 … 1"),
        (turned, "rotation", "rotations", "without direction written as none"),
    ];
    for (n, one, more, what) in many {
        if n > 0 {
            notes.push(format!("{} {what}", count(n, one, more)));
        }
    }
}

//! Reading SPZ.

use super::super::file::SplatFile;
use super::super::rows::{Filling, Row, logit_of_byte};
use super::{ANTIALIASED, COLOUR, EXTENSIONS, FLIP, FLIP_SH, HEADER, MAGIC, MAX_COUNT, MAX_FRACTIONAL_BITS};
use super::{rotation, stride};
use crate::{ErrorKind, Problem, SceneError};
use flate2::bufread::GzDecoder;
use splat_core::{MAX_DEGREE, Widening, rest_len};
use std::io::{self, BufReader, Read};
use std::path::Path;

const REMEDY: &str = "save it again, as SPZ version 3 or as PLY";

/// What the header says, checked.
struct Header {
    count: usize,
    /// Of the file; one more than can be kept is read over.
    degree: usize,
    fractional_bits: u32,
    flags: u8,
    /// Bytes of a rotation.
    rotation: usize,
}

pub(in super::super) fn read(path: &Path, bytes: &[u8]) -> Result<SplatFile, SceneError> {
    let wrong = |what: String| SceneError::new(ErrorKind::Format, Problem::new(path, what, REMEDY));
    if let Some(rest) = bytes.strip_prefix(MAGIC) {
        let version = rest.first_chunk().map_or(0, |v| u32::from_le_bytes(*v));
        return Err(wrong(format!("is not compressed with gzip: SPZ version {version} is not read")));
    }
    if !bytes.starts_with(&[0x1f, 0x8b]) {
        return Err(wrong("is not an SPZ file: it is not compressed with gzip".into()));
    }
    let mut gzip = GzDecoder::new(bytes);
    let broken = |e: io::Error| match e.kind() {
        io::ErrorKind::UnexpectedEof => wrong("is cut off".into()),
        _ => wrong(format!("is damaged: {e}")),
    };
    let mut header = [0; HEADER];
    gzip.read_exact(&mut header).map_err(broken)?;
    let header = Header::parse(&header).map_err(wrong)?;

    // Before memory is taken for the cloud, and without keeping what comes out. One byte more than there should be: what is
    // longer is noticed, and never inflated whole.
    let length = (header.count * stride(header.rotation, rest_len(header.degree))) as u64;
    let inflated = io::copy(&mut gzip.by_ref().take(length + 1), &mut io::sink()).map_err(broken)?;
    if inflated != length {
        let how = if inflated < length { "fewer" } else { "more" };
        return Err(wrong(format!("holds {how} than the {length} bytes of the {} Gaussians listed", header.count)));
    }
    let mut notes = Vec::new();
    let left = gzip.into_inner().len();
    if left > 0 {
        notes.push(format!("ignored {left} bytes behind the compressed data"));
    }
    let unknown = header.flags & !ANTIALIASED;
    if unknown != 0 {
        notes.push(format!("ignored flags of unknown meaning: {unknown:#04x}"));
    }
    if header.degree > MAX_DEGREE {
        notes.push(format!("colours above degree {MAX_DEGREE} left out"));
    }
    let cloud = header.unpack(path, bytes)?.finish(&mut notes);
    let widening = if header.flags & ANTIALIASED == 0 { Widening::Keeps } else { Widening::Dims };
    Ok(SplatFile { cloud, widening: Some(widening), notes })
}

impl Header {
    fn parse(bytes: &[u8; HEADER]) -> Result<Self, String> {
        let word = |i: usize| u32::from_le_bytes([bytes[i], bytes[i + 1], bytes[i + 2], bytes[i + 3]]);
        let [degree, fractional_bits, flags] = [bytes[12], bytes[13], bytes[14]];
        if !bytes.starts_with(MAGIC) {
            return Err("is not an SPZ file: compressed, but something else".into());
        }
        let rotation = match word(4) {
            2 => 3,
            3 => 4,
            other => return Err(format!("SPZ version {other} is not read: 2 and 3 are")),
        };
        let count = word(8) as usize;
        if count > MAX_COUNT {
            return Err(format!("lists {count} Gaussians: more than {MAX_COUNT} are not read"));
        }
        let degree = usize::from(degree);
        if degree > MAX_DEGREE + 1 {
            return Err(format!("lists colours of degree {degree}: 0 to {} are known", MAX_DEGREE + 1));
        }
        let fractional_bits = u32::from(fractional_bits);
        if fractional_bits > MAX_FRACTIONAL_BITS {
            return Err(format!("lists {fractional_bits} fractional bits for positions of 24 bits"));
        }
        if flags & EXTENSIONS != 0 {
            return Err("holds extension records, which are not read".into());
        }
        Ok(Self { count, degree, fractional_bits, flags, rotation })
    }

    /// The Gaussians of a file whose inflated length was found right. Each attribute has a reader of its own, so that nothing but
    /// the cloud is kept.
    fn unpack(&self, path: &Path, bytes: &[u8]) -> Result<Filling, SceneError> {
        let n = self.count;
        let kept = self.degree.min(MAX_DEGREE);
        let damaged =
            |e: io::Error| SceneError::new(ErrorKind::Format, Problem::new(path, format!("is damaged: {e}"), REMEDY));
        let mut start = HEADER as u64;
        let mut block = |each: usize| {
            let block = Block::new(bytes, start, each);
            start += (each * n) as u64;
            block.map_err(damaged)
        };
        let (mut position, mut opacity, mut colour, mut size) = (block(9)?, block(1)?, block(3)?, block(3)?);
        let (mut turn, mut rest) = (block(self.rotation)?, block(3 * rest_len(self.degree))?);
        let unit = 0.5_f64.powi(self.fractional_bits as i32);
        let mut filling = Filling::new(path, n, kept, bytes.len())?;
        for _ in 0..n {
            let mut row = Row::EMPTY;
            for (axis, b) in position.next().map_err(damaged)?.as_chunks::<3>().0.iter().enumerate() {
                // The sign comes down with the shift.
                let fixed = i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8;
                row.mean[axis] = FLIP[axis] * (f64::from(fixed) * unit) as f32;
            }
            row.logit = logit_of_byte(opacity.next().map_err(damaged)?[0]);
            let (colour, size) = (colour.next().map_err(damaged)?, size.next().map_err(damaged)?);
            for channel in 0..3 {
                row.dc[channel] = ((f64::from(colour[channel]) / 255.0 - 0.5) / COLOUR) as f32;
                row.log_scale[channel] = f32::from(size[channel]) / 16.0 - 10.0;
            }
            let [w, x, y, z] = match *turn.next().map_err(damaged)? {
                [a, b, c, d] => rotation::unpack([a, b, c, d]),
                [a, b, c] => rotation::unpack_bytes([a, b, c]),
                _ => [1.0, 0.0, 0.0, 0.0],
            };
            let [x, y, z] = [x, y, z].map(|c| c as f32);
            row.wxyz = [w as f32, FLIP[0] * x, FLIP[1] * y, FLIP[2] * z];
            for (k, byte) in rest.next().map_err(damaged)?[..3 * rest_len(kept)].iter().enumerate() {
                row.rest[k] = FLIP_SH[k / 3] * (f32::from(*byte) - 128.0) / 128.0;
            }
            filling.push(row);
        }
        Ok(filling)
    }
}

/// One attribute of all Gaussians, inflated bit by bit.
struct Block<'a> {
    gzip: BufReader<GzDecoder<&'a [u8]>>,
    one: Vec<u8>,
}

impl<'a> Block<'a> {
    /// From a place of the inflated file, `each` bytes a Gaussian.
    fn new(bytes: &'a [u8], start: u64, each: usize) -> io::Result<Self> {
        let mut gzip = BufReader::new(GzDecoder::new(bytes));
        io::copy(&mut gzip.by_ref().take(start), &mut io::sink())?;
        Ok(Self { gzip, one: vec![0; each] })
    }

    /// That of the next Gaussian.
    fn next(&mut self) -> io::Result<&[u8]> {
        self.gzip.read_exact(&mut self.one)?;
        Ok(&self.one)
    }
}

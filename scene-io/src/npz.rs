//! NumPy `.npz` archives: arrays by name in a ZIP file.
//!
//! Own code for the same reason as [`crate::npy`]'s: sizes are held against the file and the memory before anything is unpacked.
//! Members are stored or deflated, which is all that `numpy.savez` and `numpy.savez_compressed` write. Sizes and places are those of
//! the directory at the end of the file: NumPy's headers before the members leave them open.

use crate::decode_memory::DecodeMemory;
use crate::{ErrorKind, Place, Problem, SceneError, files, npy};
use flate2::Crc;
use flate2::read::DeflateDecoder;
use std::io::Read;
use std::path::{Path, PathBuf};

/// Bytes of the record that ends an archive, without its comment.
const END: usize = 22;
/// Longest comment behind it.
const COMMENT: usize = 0xffff;
/// Bytes of a directory entry and of a header before a member, without their names.
const ENTRY: usize = 46;
const HEADER: usize = 30;

/// An archive in memory, its directory read.
#[derive(Debug)]
pub(crate) struct Archive {
    path: PathBuf,
    bytes: Vec<u8>,
    members: Vec<Member>,
}

#[derive(Debug)]
struct Member {
    name: String,
    is_deflated: bool,
    crc: u32,
    packed: usize,
    unpacked: usize,
    /// Where the header before it begins.
    header: usize,
}

impl Archive {
    /// Reads a file and its directory. What cannot be unpacked (encrypted, another method, beyond 4 GiB) is refused.
    pub(crate) fn read(path: &Path) -> Result<Self, SceneError> {
        Self::parse(path, files::read_bytes(path)?)
    }

    fn parse(path: &Path, bytes: Vec<u8>) -> Result<Self, SceneError> {
        let wrong = |at: usize, what: String| wrong(path, at, what);
        let end = find_end(&bytes)
            .ok_or_else(|| wrong(0, format!("is not a .npz archive, or is cut off ({} bytes)", bytes.len())))?;
        let (count, start) = (u16_at(&bytes, end + 10), u32_at(&bytes, end + 16));
        let (Some(count), Some(start)) = (count, start) else { return Err(wrong(end, "is cut off at its end".into())) };
        let mut at = start as usize;
        let mut members = Vec::new();
        for _ in 0..count {
            let (member, next) = Member::parse(&bytes, at).map_err(|what| wrong(at, what))?;
            members.push(member);
            at = next;
        }
        Ok(Self { path: path.to_path_buf(), bytes, members })
    }

    /// Whether there is an array of this name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.member(name).is_some()
    }

    /// The array of a name, and what is made of it, of `each` bytes a value; see [`npy::with`].
    pub(crate) fn with<T>(
        &self,
        name: &str,
        each: u64,
        work: impl FnOnce(npy::Array) -> Result<T, SceneError>,
    ) -> Result<T, SceneError> {
        let Some(member) = self.member(name) else {
            let names: Vec<&str> = self.members.iter().map(|m| m.name.as_str()).collect();
            let what = format!("holds no array of that name, but: {}", names.join(", "));
            let problem = Problem::new(&self.path, what, format!("save it with numpy.savez(..., {name}=...)"));
            return Err(SceneError::new(ErrorKind::Format, problem.field(name)));
        };
        let packed = self.packed(member)?;
        let whose = self.path.join(&member.name);
        if !member.is_deflated {
            self.check(member, packed)?;
            return npy::with_bytes(&whose, packed, each, work);
        }
        let what = format!("its {} bytes", member.unpacked);
        let _held = DecodeMemory::of_process().reserve(&whose, &what, member.unpacked as u64)?;
        let mut bytes = Vec::new();
        // One byte more shows a member that is longer than the directory says.
        let most = member.unpacked as u64 + 1;
        DeflateDecoder::new(packed).take(most).read_to_end(&mut bytes).map_err(|e| {
            wrong(&self.path, member.header, format!("member `{}` cannot be unpacked: {e}", member.name)).caused_by(e)
        })?;
        self.check(member, &bytes)?;
        npy::with_bytes(&whose, &bytes, each, work)
    }

    fn member(&self, name: &str) -> Option<&Member> {
        self.members.iter().find(|m| m.name.strip_suffix(".npy") == Some(name))
    }

    /// The bytes of a member as they lie in the file.
    fn packed(&self, member: &Member) -> Result<&[u8], SceneError> {
        let find = || {
            let header = self.bytes.get(member.header..)?;
            if !header.starts_with(b"PK\x03\x04") {
                return None;
            }
            let names = usize::from(u16_at(header, 26)?) + usize::from(u16_at(header, 28)?);
            header.get(HEADER + names..)?.get(..member.packed)
        };
        find().ok_or_else(|| wrong(&self.path, member.header, format!("member `{}` is not there whole", member.name)))
    }

    fn check(&self, member: &Member, bytes: &[u8]) -> Result<(), SceneError> {
        let mut crc = Crc::new();
        crc.update(bytes);
        if bytes.len() == member.unpacked && crc.sum() == member.crc {
            return Ok(());
        }
        let what = format!("member `{}` is damaged: length or checksum are not those of the directory", member.name);
        Err(wrong(&self.path, member.header, what))
    }
}

impl Member {
    /// The entry of the directory that begins at a byte, and where the next one does; else what is wrong with it.
    fn parse(bytes: &[u8], at: usize) -> Result<(Self, usize), String> {
        let cut_off = || "the directory of the archive is cut off".to_owned();
        let entry = bytes.get(at..).ok_or_else(cut_off)?;
        if !entry.starts_with(b"PK\x01\x02") {
            return Err("is no entry of the archive's directory".into());
        }
        let short = |at: usize| u16_at(entry, at).ok_or_else(cut_off);
        let long = |at: usize| u32_at(entry, at).ok_or_else(cut_off);
        let (flags, method) = (short(8)?, short(10)?);
        let (crc, packed, unpacked) = (long(16)?, long(20)?, long(24)?);
        let (name, extra, comment) = (usize::from(short(28)?), usize::from(short(30)?), usize::from(short(32)?));
        let header = long(42)?;
        let text = entry.get(ENTRY..ENTRY + name).ok_or_else(cut_off)?;
        let name = String::from_utf8_lossy(text).into_owned();
        if flags & 1 != 0 {
            return Err(format!("member `{name}` is encrypted"));
        }
        if !matches!(method, 0 | 8) {
            return Err(format!("member `{name}` is packed by method {method}, and only stored and deflated are read"));
        }
        if [packed, unpacked, header].contains(&u32::MAX) {
            return Err(format!("member `{name}` is beyond 4 GiB, and smaller ones are read"));
        }
        let next = at + ENTRY + text.len() + extra + comment;
        let (packed, unpacked, header) = (packed as usize, unpacked as usize, header as usize);
        Ok((Self { name, is_deflated: method == 8, crc, packed, unpacked, header }, next))
    }
}

/// Where the record that ends an archive begins: the last one in the file.
fn find_end(bytes: &[u8]) -> Option<usize> {
    let last = bytes.len().checked_sub(END)?;
    let first = last.saturating_sub(COMMENT);
    (first..=last).rev().find(|&at| bytes[at..].starts_with(b"PK\x05\x06"))
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|b| u16::from_le_bytes(*b))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b))
}

fn wrong(path: &Path, at: usize, what: String) -> SceneError {
    let problem = Problem::new(path, what, "write the file again with numpy.savez");
    SceneError::new(ErrorKind::Format, problem.at(Place::Byte(at as u64)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use flate2::write::DeflateEncoder;
    use proptest::prelude::*;
    use std::io::Write;

    fn array(values: &[f32]) -> Vec<u8> {
        let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({},), }}\n", values.len());
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    }

    /// A ZIP file as Python writes it: sizes open in the headers before the members.
    fn zip(members: &[(&str, Vec<u8>)], method: u16) -> Vec<u8> {
        let (mut file, mut directory) = (Vec::new(), Vec::new());
        for (name, bytes) in members {
            let packed = if method == 8 {
                let mut encoder = DeflateEncoder::new(Vec::new(), Compression::default());
                encoder.write_all(bytes).unwrap();
                encoder.finish().unwrap()
            } else {
                bytes.clone()
            };
            let mut crc = Crc::new();
            crc.update(bytes);
            let start = file.len() as u32;
            let shorts = |out: &mut Vec<u8>, values: &[u16]| out.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            let longs = |out: &mut Vec<u8>, values: &[u32]| out.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            file.extend(b"PK\x03\x04");
            shorts(&mut file, &[45, 0, method, 0, 0]);
            longs(&mut file, &[crc.sum(), u32::MAX, u32::MAX]);
            shorts(&mut file, &[name.len() as u16, 4]);
            file.extend(name.as_bytes());
            file.extend([1, 0, 0, 0]);
            file.extend(&packed);
            directory.extend(b"PK\x01\x02");
            shorts(&mut directory, &[45, 45, 0, method, 0, 0]);
            longs(&mut directory, &[crc.sum(), packed.len() as u32, bytes.len() as u32]);
            shorts(&mut directory, &[name.len() as u16, 0, 0, 0, 0]);
            longs(&mut directory, &[0, start]);
            directory.extend(name.as_bytes());
        }
        let (start, count) = (file.len() as u32, members.len() as u16);
        file.extend(&directory);
        file.extend(b"PK\x05\x06\0\0\0\0");
        file.extend([count.to_le_bytes(), count.to_le_bytes()].concat());
        file.extend([(directory.len() as u32).to_le_bytes(), start.to_le_bytes()].concat());
        file.extend([0, 0]);
        file
    }

    fn numbers(bytes: Vec<u8>, name: &str) -> Result<Vec<f64>, SceneError> {
        Archive::parse(Path::new("a.npz"), bytes)?.with(name, 0, |array| Ok(array.data))
    }

    fn two(method: u16) -> Vec<u8> {
        zip(&[("flow.npy", array(&[1.5, -2.0, 0.0, 0.0])), ("mask.npy", array(&[1.0]))], method)
    }

    #[test]
    fn arrays_are_found_by_name_stored_and_deflated() {
        for method in [0, 8] {
            assert_eq!(numbers(two(method), "flow").unwrap(), [1.5, -2.0, 0.0, 0.0]);
            assert_eq!(numbers(two(method), "mask").unwrap(), [1.0]);
            let error = numbers(two(method), "depth").unwrap_err().to_string();
            assert!(error.contains("`depth`: holds no array of that name, but: flow.npy, mask.npy"), "{error}");
        }
        let mut commented = two(0);
        let at = commented.len() - 2;
        commented[at..].copy_from_slice(&3_u16.to_le_bytes());
        commented.extend(b"end");
        assert_eq!(numbers(commented, "mask").unwrap(), [1.0]);
    }

    #[test]
    fn what_cannot_be_unpacked_is_named() {
        let said = |bytes: Vec<u8>| numbers(bytes, "flow").unwrap_err().to_string();
        assert!(said(Vec::new()).contains("is not a .npz archive"));
        assert!(said(b"PK\x03\x04 and no end, however long it goes on".to_vec()).contains("is not a .npz archive"));
        assert!(said(two(9)).contains("method 9"));
        // A bit of the first array.
        let mut spoilt = two(0);
        let at = spoilt.windows(4).position(|w| w == 1.5_f32.to_le_bytes()).unwrap();
        spoilt[at] ^= 1;
        assert!(said(spoilt).contains("member `flow.npy` is damaged"));
        // A member of more bytes than the directory says.
        let mut forged = two(8);
        let entry = forged.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
        forged[entry + 24..entry + 28].copy_from_slice(&10_u32.to_le_bytes());
        assert!(said(forged.clone()).contains("is damaged"));
        // One that asks for more than there is.
        forged[entry + 24..entry + 28].copy_from_slice(&(u32::MAX - 1).to_le_bytes());
        let error = said(forged);
        assert!(error.contains("a.npz/flow.npy") && error.contains("of memory"), "{error}");
    }

    proptest! {
        #![proptest_config(testkit::property::cases(256))]

        #[test]
        fn corrupted_archives_never_panic(method in prop_oneof![Just(0_u16), Just(8)], cut: prop::sample::Index, at: prop::sample::Index, byte: u8) {
            let whole = two(method);
            let mut bytes = whole.clone();
            let place = at.index(bytes.len());
            bytes[place] = byte;
            let _ = numbers(bytes.clone(), "flow");
            bytes.truncate(cut.index(bytes.len()));
            let _ = numbers(bytes, "flow");
            prop_assert!(numbers(whole[..cut.index(whole.len())].to_vec(), "flow").is_err());
        }
    }
}

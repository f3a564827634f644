//! Whether files are the same: hashes of bytes, and of everything that training sees of a dataset.

use crate::error::RunError;
use scene_io::{ImageSource, MaskPolarity, MotionFiles, Priors, Scene, Split};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Files up to twice this are hashed whole, larger ones by their size and this much of either end: a thousand large
/// photographs must not cost minutes.
const END: u64 = 512 * 1024;

/// SHA-256 over [`Scene::fingerprint`] (names, splits, cameras, poses) and the image, mask and prior files of all frames that
/// are used. Folders do not matter: a dataset that was moved is the same.
///
/// # Errors
/// [`RunError::Read`] naming the file.
pub fn dataset_hash(scene: &Scene) -> Result<String, RunError> {
    let mut hash = Sha256::new();
    hash.update(scene.fingerprint());
    for frame in &scene.frames {
        if frame.split == Split::Unused {
            continue;
        }
        match &frame.image {
            ImageSource::File(path) => hash_file(&mut hash, path)?,
            ImageSource::Memory(image) => {
                hash.update(&image.data);
                hash.update(image.mask.as_deref().unwrap_or_default());
            }
        }
        if let Some(mask) = &frame.mask {
            hash.update([match frame.mask_polarity {
                MaskPolarity::WhiteIsIgnored => 0,
                MaskPolarity::WhiteIsUsed => 1,
                MaskPolarity::WhiteIsObject => 2,
            }]);
            hash_file(&mut hash, mask)?;
        }
        let Priors { segments, prompted, features, motion } = &frame.priors;
        let MotionFiles { forward, backward, disparity, mask: moving } = motion;
        for (kind, prior) in (1_u8..).zip([segments, prompted, features, forward, backward, disparity, moving]) {
            if let Some(path) = prior {
                hash.update([kind]);
                hash_prior(&mut hash, path)?;
            }
        }
    }
    Ok(format!("sha256:{}", hex(&hash.finalize())))
}

/// A file, or the files of a folder by their names.
fn hash_prior(hash: &mut Sha256, path: &Path) -> Result<(), RunError> {
    if !path.is_dir() {
        return hash_file(hash, path);
    }
    let entries = std::fs::read_dir(path).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let mut files: Vec<_> = entries.map_err(RunError::read(path))?.iter().map(std::fs::DirEntry::path).collect();
    files.retain(|file| file.is_file());
    files.sort();
    files.iter().try_for_each(|file| {
        hash.update(file.file_name().unwrap_or_default().as_encoded_bytes());
        hash_file(hash, file)
    })
}

fn hash_file(hash: &mut Sha256, path: &Path) -> Result<(), RunError> {
    let mut read = || {
        let mut file = File::open(path)?;
        let size = file.metadata()?.len();
        hash.update(size.to_le_bytes());
        let mut bytes = Vec::new();
        if size <= 2 * END {
            file.read_to_end(&mut bytes)?;
        } else {
            file.by_ref().take(END).read_to_end(&mut bytes)?;
            file.seek(SeekFrom::End(-(END as i64)))?;
            file.take(END).read_to_end(&mut bytes)?;
        }
        hash.update(&bytes);
        Ok(())
    };
    read().map_err(RunError::read(path))
}

/// SHA-256 in hexadecimal.
pub fn sha256(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

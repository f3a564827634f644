//! The baked cloud beside the checkpoint it was made from: a file of a run folder.
//!
//! It belongs to a checkpoint by the SHA-256 of the checkpoint's arrays; a file of another checkpoint, of another version or one
//! that cannot be read is not an error: the field is baked again.

use super::Baked;
use engine::checkpoint::{digest, read_arrays, serialise, sha256};
use engine::error::RunError;
use engine::output::{Storage, write_file};
use engine::system::{Splats, Tensor, TensorMap, f32_tensor, take_f32, take_u64, u64_tensor};
use splat_core::{Gaussians, MAX_DEGREE, RasterSettings, Widening};
use std::path::Path;

/// Name of the file in the run folder.
pub use engine::folder::BAKED as FILE;

/// Changes whenever a bake of the same checkpoint gives something else.
const VERSION: u64 = 1;
/// Gaussians of a file that is read at most: more were never written.
const MOST: u64 = 10_000_000;

/// What the bake of a checkpoint with the appearance and background of the run is known by.
fn key(run: &Path, step: u64) -> Option<Vec<u64>> {
    let digest = sha256(format!("{VERSION} {}", digest(run, step)?).as_bytes());
    Some((0..4).filter_map(|k| u64::from_str_radix(digest.get(16 * k..16 * (k + 1))?, 16).ok()).collect())
}

/// The baked cloud of the checkpoint of `step` of a run, where there is one.
#[must_use]
pub fn load(run: &Path, step: u64) -> Option<Baked> {
    let key = key(run, step)?;
    let (arrays, _) = read_arrays(&run.join(FILE)).ok()?;
    if take_u64(&arrays, "key", key.len()).ok()? != key {
        return None;
    }
    read(&arrays)
}

fn read(arrays: &TensorMap) -> Option<Baked> {
    let shape = take_u64(arrays, "shape", 3).ok()?;
    let (n, degree, widening) = (shape[0], usize::try_from(shape[1]).ok()?, shape[2]);
    if n > MOST || degree > MAX_DEGREE {
        return None;
    }
    let mut gaussians = Gaussians::new(usize::try_from(n).ok()?, degree).ok()?;
    for (field, numbers) in gaussians.fields_mut() {
        numbers.copy_from_slice(&take_f32(arrays, field.name(), numbers.len()).ok()?);
    }
    let facts = take_f32(arrays, "facts", 2).ok()?;
    let widening = if widening == 0 { Widening::Keeps } else { Widening::Dims };
    let rules = RasterSettings::DEFAULT.with_near(facts[0]).with_widening(widening);
    rules.check().ok()?;
    let psnr = Some(f64::from(facts[1])).filter(|x| x.is_finite());
    Some(Baked { splats: Splats { gaussians, rules }, psnr })
}

/// Keep the baked cloud of the checkpoint of `step`: temporary name, then renamed. Nothing is written for a checkpoint that is not
/// there any more.
///
/// # Errors
/// [`RunError::Write`].
pub fn store(storage: &dyn Storage, run: &Path, step: u64, baked: &Baked) -> Result<(), RunError> {
    let Some(key) = key(run, step) else { return Ok(()) };
    let Splats { gaussians, rules } = &baked.splats;
    let widening = u64::from(rules.widening == Widening::Dims);
    let facts = [rules.near, baked.psnr.unwrap_or(f64::NAN) as f32];
    let mut arrays: Vec<Tensor<'_>> = vec![
        u64_tensor("key", key),
        u64_tensor("shape", vec![gaussians.len() as u64, gaussians.degree() as u64, widening]),
        f32_tensor("facts", &facts),
    ];
    arrays.extend(gaussians.fields().map(|(field, numbers)| f32_tensor(field.name(), numbers)));
    write_file(storage, &run.join(FILE), &serialise(&arrays))
}

#[cfg(test)]
mod tests {
    use super::*;
    use engine::output::Disk;
    use std::fs;

    /// A run folder that has a checkpoint, as far as the key reads.
    fn run(sha: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("checkpoint")).unwrap();
        write_checkpoint(folder.path(), sha);
        folder
    }

    fn write_checkpoint(run: &Path, sha: &str) {
        let config =
            r#"{"scene":"s","system":"ngp","seed":0,"background":"black","error_budget":0.0,"data":{},"settings":{}}"#;
        let text = format!(
            r#"{{"format":1,"step":7,"seconds":1.0,"rng":{{"generator":"g","seed":0,"counter":7}},"dataset":"d",
                "tensors":{{"file":"f","bytes":0,"sha256":"{sha}"}},"config":{config}}}"#
        );
        fs::write(run.join("checkpoint/step-00000007.json"), text).unwrap();
    }

    fn baked() -> Baked {
        let mut gaussians = Gaussians::new(3, 1).unwrap();
        gaussians.rest[5] = 0.25;
        let rules = RasterSettings::DEFAULT.with_near(0.5).with_widening(Widening::Dims);
        Baked { splats: Splats { gaussians, rules }, psnr: Some(30.5) }
    }

    #[test]
    fn a_cloud_comes_back_for_its_checkpoint_only() {
        let folder = run("aa");
        assert!(digest(folder.path(), 7).is_some(), "the JSON file is one of a checkpoint");
        assert_eq!(load(folder.path(), 7), None);
        store(&Disk, folder.path(), 7, &baked()).unwrap();
        assert_eq!(load(folder.path(), 7), Some(baked()));
        assert_eq!(load(folder.path(), 8), None);
        write_checkpoint(folder.path(), "bb");
        assert_eq!(load(folder.path(), 7), None, "trained anew");
        store(&Disk, folder.path(), 99, &baked()).unwrap();
        assert_eq!(load(folder.path(), 99), None, "no such checkpoint");
    }

    #[test]
    fn a_broken_file_is_not_a_cloud() {
        let folder = run("aa");
        let none = Baked { psnr: None, ..baked() };
        store(&Disk, folder.path(), 7, &none).unwrap();
        assert_eq!(load(folder.path(), 7), Some(none));
        let file = folder.path().join(FILE);
        let bytes = fs::read(&file).unwrap();
        for cut in [0, 5, bytes.len() / 2, bytes.len() - 1] {
            fs::write(&file, &bytes[..cut]).unwrap();
            assert_eq!(load(folder.path(), 7), None);
        }
    }
}

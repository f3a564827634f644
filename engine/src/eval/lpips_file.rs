//! LPIPS weights from a safetensors file.
//!
//! The file is the user's: `--lpips FILE`, or the variable [`LPIPS_VARIABLE`]. Without one LPIPS is `n/a`. Names and shapes
//! of the tensors are listed in [`losses::metrics::lpips`]; any `F32` file of that naming works.

use losses::metrics::lpips::{Lpips, LpipsError, LpipsTensor};
use safetensors::{Dtype, SafeTensorError, SafeTensors};
use std::borrow::Cow;
use std::io;
use std::path::{Path, PathBuf};

/// The environment variable that names the weight file where no flag does.
pub const LPIPS_VARIABLE: &str = "WILDFIELD_LPIPS";

/// Weights that could not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LpipsFileError {
    /// The file could not be read.
    #[error("cannot read the LPIPS weights `{}`", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file is not a safetensors file, or a broken one.
    #[error("the LPIPS weights `{}` are not a complete safetensors file", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What its reader said.
        source: SafeTensorError,
    },
    /// A tensor is stored in another type than `F32`.
    #[error("the LPIPS weights `{}` hold tensor `{name}` as {dtype:?}: convert the file to F32", path.display())]
    Type {
        /// The file.
        path: PathBuf,
        /// The tensor.
        name: String,
        /// Its type.
        dtype: Dtype,
    },
    /// The tensors are not those of the network.
    #[error("the LPIPS weights `{}` do not make the network (SqueezeNet naming)", path.display())]
    Weights {
        /// The file.
        path: PathBuf,
        /// Which tensor, and what is wrong with it.
        source: LpipsError,
    },
}

/// Where the weights are: what the flag says, else what [`LPIPS_VARIABLE`] says, else nowhere.
#[must_use]
pub fn lpips_path(flag: Option<&Path>) -> Option<PathBuf> {
    let variable = || std::env::var_os(LPIPS_VARIABLE).filter(|v| !v.is_empty()).map(PathBuf::from);
    flag.map(Path::to_path_buf).or_else(variable)
}

/// Read the network from a safetensors file.
///
/// # Errors
/// [`LpipsFileError`]: it names the file, and the tensor where one is at fault.
pub fn load_lpips(path: &Path) -> Result<Lpips, LpipsFileError> {
    let owned = || path.to_path_buf();
    let bytes = std::fs::read(path).map_err(|source| LpipsFileError::Read { path: owned(), source })?;
    let file = SafeTensors::deserialize(&bytes).map_err(|source| LpipsFileError::Format { path: owned(), source })?;
    // A tensor of another type is left out, so that loading stops at it; its name and type are the better error.
    let mut other_type = None;
    let net = Lpips::new(|name| {
        let tensor = file.tensor(name).ok()?;
        if tensor.dtype() != Dtype::F32 {
            other_type = Some((name.to_owned(), tensor.dtype()));
            return None;
        }
        let (values, _) = tensor.data().as_chunks::<4>();
        let data = values.iter().map(|&b| f32::from_le_bytes(b)).collect();
        Some(LpipsTensor { shape: tensor.shape().to_vec(), data: Cow::Owned(data) })
    });
    match (net, other_type) {
        (Err(_), Some((name, dtype))) => Err(LpipsFileError::Type { path: owned(), name, dtype }),
        (net, _) => net.map_err(|source| LpipsFileError::Weights { path: owned(), source }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use losses::metrics::Image;
    use safetensors::tensor::{TensorView, serialize};
    use std::error::Error;

    /// Write named tensors of type `dtype`; read as `F32` their values are 1/4, 1/2, 3/4, 1, 1/4 …
    fn write(folder: &Path, dtype: Dtype, tensors: &[(String, Vec<usize>)]) -> PathBuf {
        let fill = |(_, shape): &(String, Vec<usize>)| -> Vec<u8> {
            let count = shape.iter().product::<usize>() * dtype.bitsize() / 32;
            (0..count).flat_map(|i| ((i % 4 + 1) as f32 / 4.0).to_le_bytes()).collect()
        };
        let bytes: Vec<Vec<u8>> = tensors.iter().map(fill).collect();
        let views = tensors
            .iter()
            .zip(&bytes)
            .map(|((name, shape), data)| (name, TensorView::new(dtype, shape.clone(), data).unwrap()));
        let path = folder.join("weights.safetensors");
        std::fs::write(&path, serialize(views, None).unwrap()).unwrap();
        path
    }

    /// The whole network, every width 2.
    fn complete() -> Vec<(String, Vec<usize>)> {
        let mut out = vec![("scaling.shift".to_owned(), vec![3]), ("scaling.scale".to_owned(), vec![3])];
        let mut conv = |name: String, inputs: usize, side: usize| {
            out.push((format!("{name}.weight"), vec![2, inputs, side, side]));
            out.push((format!("{name}.bias"), vec![2]));
        };
        conv("features.0".to_owned(), 3, 3);
        for n in [3, 4, 6, 7, 9, 10, 11, 12] {
            conv(format!("features.{n}.squeeze"), if n == 3 { 2 } else { 4 }, 1);
            conv(format!("features.{n}.expand1x1"), 2, 1);
            conv(format!("features.{n}.expand3x3"), 2, 3);
        }
        out.extend((0..7).map(|i| (format!("lin{i}.weight"), vec![if i == 0 { 2 } else { 4 }])));
        out
    }

    #[test]
    fn a_file_of_the_naming_works() {
        let folder = tempfile::tempdir().unwrap();
        let net = load_lpips(&write(folder.path(), Dtype::F32, &complete())).unwrap();
        let (a, b) = (vec![200_u8; 20 * 20 * 3], vec![250_u8; 20 * 20 * 3]);
        let (a, b) = (Image::from_u8(20, 20, 3, &a).unwrap(), Image::from_u8(20, 20, 3, &b).unwrap());
        assert_eq!(net.distance(&a, &a), Ok(0.0));
        assert!(net.distance(&a, &b).unwrap() > 0.0);
    }

    #[test]
    fn every_problem_is_one_clear_line() {
        let folder = tempfile::tempdir().unwrap();
        let missing = load_lpips(&folder.path().join("none.safetensors")).unwrap_err();
        assert!(matches!(missing, LpipsFileError::Read { .. }) && missing.to_string().contains("none.safetensors"));

        let path = write(folder.path(), Dtype::F32, &complete());
        let whole = std::fs::read(&path).unwrap();
        for length in [0, 7, 100, whole.len() - 1] {
            std::fs::write(&path, &whole[..length]).unwrap();
            let error = load_lpips(&path).unwrap_err();
            assert!(matches!(error, LpipsFileError::Format { .. }), "{length} bytes: {error}");
        }

        let error = load_lpips(&write(folder.path(), Dtype::F32, &complete()[1..])).unwrap_err();
        assert_eq!(error.source().unwrap().to_string(), "tensor `scaling.shift` is missing");

        let mut tensors = complete();
        tensors.retain(|(name, _)| name != "features.0.weight");
        tensors.push(("features.0.weight".to_owned(), vec![2, 3, 5, 5]));
        let error = load_lpips(&write(folder.path(), Dtype::F32, &tensors)).unwrap_err();
        assert_eq!(
            error.source().unwrap().to_string(),
            "tensor `features.0.weight` has shape [2, 3, 5, 5], expected [any, 3, 3, 3]"
        );

        let error = load_lpips(&write(folder.path(), Dtype::F64, &complete())).unwrap_err();
        assert!(error.to_string().ends_with("hold tensor `scaling.shift` as F64: convert the file to F32"), "{error}");
    }

    #[test]
    fn the_flag_wins_over_the_variable() {
        let flag = Path::new("by-flag.safetensors");
        assert_eq!(lpips_path(Some(flag)), Some(flag.to_path_buf()));
    }
}

//! Which part of a reconstruction is shown and exported: a box, and a filter of floaters.
//!
//! The viewer writes it, `export` obeys it: `crop.json` in a run folder, `FILE.crop.json` beside a file of Gaussians.
//!
//! ```text
//! {
//!   "box": [[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]],   smallest and largest corner, world units; null: everything
//!   "faint": 0.05,    Gaussians of less opacity are left out; 0: none
//!   "large": 0.8,     Gaussians of a larger standard deviation are left out, world units; null: none
//!   "alone": 0.2,     what has its three nearest neighbours farther away is left out, world units; null: nothing
//!   "up": [0, 0, 1]   the direction that is up on the screen; null: as guessed
//! }
//! ```

use crate::error::RunError;
use crate::neighbours::mean_squared_distances;
use crate::output::{Storage, write_file};
use serde::{Deserialize, Serialize};
use splat_core::density::{Rows, opacity};
use splat_core::{Gaussians, SplatError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Name of the file in a run folder, and what is added to the name of a file of Gaussians.
pub const FILE: &str = "crop.json";
/// Bytes a file may have: many times what any has.
const LARGEST_FILE: u64 = 64 << 10;
/// Numbers are no larger than this: nothing `f32` can hold is farther.
const FAR: f64 = 1e30;

/// A box of the scene's frame: smallest and largest corner.
pub type CropBox = [[f64; 3]; 2];

/// What is kept. [`Crop::default`] keeps everything.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Crop {
    /// Smallest and largest corner, the scene's frame, world units; `None`: everything.
    #[serde(rename = "box")]
    pub bounds: Option<CropBox>,
    /// Gaussians of less opacity are left out; 0: none.
    pub faint: f64,
    /// Gaussians with a larger standard deviation along any axis are left out, world units; `None`: none.
    pub large: Option<f64>,
    /// Gaussians whose three nearest neighbours are farther away (root mean square) are left out, world units; `None`: none.
    pub alone: Option<f64>,
    /// Up on the screen, any length but 0; `None`: as guessed. Leaves nothing out.
    pub up: Option<[f64; 3]>,
}

/// What the filter asks of each Gaussian of a cloud; measured once, however often the thresholds change.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traits {
    /// Opacity.
    pub opacity: Vec<f32>,
    /// Largest standard deviation, world units.
    pub size: Vec<f32>,
    /// Root of the mean squared distance to the three nearest others, world units.
    pub apart: Vec<f32>,
}

impl Traits {
    /// Of a cloud.
    ///
    /// # Panics
    /// When fields of the cloud disagree in length.
    #[must_use]
    pub fn of(cloud: &Gaussians) -> Self {
        let n = cloud.len();
        let places: Vec<[f64; 3]> = (0..n).map(|i| place(cloud, i)).collect();
        let largest = |i: usize| (0..3).map(|k| cloud.log_scale[k * n + i]).fold(f32::NEG_INFINITY, f32::max).exp();
        Self {
            opacity: (0..n).map(|i| opacity(cloud, i) as f32).collect(),
            size: (0..n).map(largest).collect(),
            apart: mean_squared_distances(&places).into_iter().map(|square| square.sqrt() as f32).collect(),
        }
    }
}

fn place(cloud: &Gaussians, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|k| f64::from(cloud.mean[k * cloud.len() + i]))
}

impl Crop {
    /// Where the crop of a run folder or a file of Gaussians is kept.
    #[must_use]
    pub fn path_of(what: &Path) -> PathBuf {
        if what.is_dir() {
            return what.join(FILE);
        }
        let mut name = what.file_name().unwrap_or_default().to_os_string();
        name.push(".");
        name.push(FILE);
        what.with_file_name(name)
    }

    /// The crop that is kept for a run folder or a file of Gaussians; `None` where there is none.
    ///
    /// # Errors
    /// [`RunError::Read`]; [`RunError::Content`] naming the file, the field and its value.
    pub fn of(what: &Path) -> Result<Option<Self>, RunError> {
        Self::read(&Self::path_of(what))
    }

    /// The crop in a file; `None` where there is no such file.
    ///
    /// # Errors
    /// As [`Crop::of`].
    pub fn read(path: &Path) -> Result<Option<Self>, RunError> {
        let wrong = |problem: String| RunError::Content { path: path.into(), problem };
        let remedy = "correct it, remove the file, or say `--no-crop`";
        match std::fs::metadata(path) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(RunError::read(path)(e)),
            Ok(file) if file.len() > LARGEST_FILE => {
                return Err(wrong(format!("{} bytes are not a crop: {remedy}", file.len())));
            }
            Ok(_) => {}
        }
        let text = std::fs::read_to_string(path).map_err(RunError::read(path))?;
        let crop: Self = serde_json::from_str(&text).map_err(|e| wrong(format!("{e}: {remedy}")))?;
        crop.check().map_err(|problem| wrong(format!("{problem}: {remedy}")))?;
        Ok(Some(crop))
    }

    /// Keep it.
    ///
    /// # Errors
    /// [`RunError::Option`] for numbers that cannot be; [`RunError::Write`].
    pub fn write(&self, storage: &dyn Storage, path: &Path) -> Result<(), RunError> {
        self.check().map_err(RunError::Option)?;
        let text = serde_json::to_string_pretty(self).map_err(|e| RunError::Option(format!("the crop: {e}")))?;
        write_file(storage, path, format!("{text}\n").as_bytes())
    }

    /// Whether its numbers can be.
    ///
    /// # Errors
    /// A sentence that names the field and its value.
    pub fn check(&self) -> Result<(), String> {
        if let Some([min, max]) = self.bounds {
            for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
                let fine = min[k] < max[k] && min[k] >= -FAR && max[k] <= FAR;
                if !fine {
                    let (min, max) = (min[k], max[k]);
                    return Err(format!("`box`: {axis} from {min} to {max}: write a smaller and a larger number"));
                }
            }
        }
        if !(0.0..=1.0).contains(&self.faint) {
            return Err(format!("`faint` = {}: write an opacity from 0 to 1", self.faint));
        }
        for (field, value) in [("large", self.large), ("alone", self.alone)] {
            if let Some(x) = value.filter(|x| !(*x > 0.0 && *x <= FAR)) {
                return Err(format!("`{field}` = {x}: write a positive number of world units, or null"));
            }
        }
        match self.up {
            Some(up) if !(up.iter().all(|x| x.abs() <= FAR) && up.iter().any(|x| x.abs() > 1e-9)) => {
                Err(format!("`up` = {up:?}: write three finite numbers, not all 0"))
            }
            _ => Ok(()),
        }
    }

    /// Whether nothing is left out.
    #[must_use]
    pub fn keeps_everything(&self) -> bool {
        self.bounds.is_none() && self.faint <= 0.0 && self.large.is_none() && self.alone.is_none()
    }

    /// Whether a point lies in the box.
    #[must_use]
    pub fn holds(&self, x: &[f64; 3]) -> bool {
        self.bounds.is_none_or(|[min, max]| (0..3).all(|k| (min[k]..=max[k]).contains(&x[k])))
    }

    /// Whether Gaussian `i` of a cloud stays.
    ///
    /// # Panics
    /// When there is no such Gaussian, or `traits` are of another cloud.
    #[must_use]
    pub fn keeps(&self, cloud: &Gaussians, traits: &Traits, i: usize) -> bool {
        let below = |limit: Option<f64>, x: f32| limit.is_none_or(|limit| f64::from(x) <= limit);
        f64::from(traits.opacity[i]) >= self.faint
            && below(self.large, traits.size[i])
            && below(self.alone, traits.apart[i])
            && self.holds(&place(cloud, i))
    }

    /// The rows of a cloud of the scene's frame that stay.
    ///
    /// # Errors
    /// [`SplatError`] for a cloud whose fields disagree in length.
    ///
    /// # Panics
    /// When fields of the cloud disagree in length, or `traits` are of another cloud.
    pub fn rows(&self, cloud: &Gaussians, traits: &Traits) -> Result<Rows, SplatError> {
        Rows::keep(cloud.len(), |i| self.keeps(cloud, traits, i))
    }

    /// What stays of a cloud of the scene's frame.
    ///
    /// # Errors
    /// [`SplatError`] for a cloud whose fields disagree in length.
    pub fn cloud(&self, cloud: &Gaussians) -> Result<Gaussians, SplatError> {
        if self.keeps_everything() {
            return Ok(cloud.clone());
        }
        cloud.check()?;
        self.rows(cloud, &Traits::of(cloud))?.follow(cloud)
    }

    /// The part of a box that is in this crop's box.
    ///
    /// # Errors
    /// A sentence, where there is no such part.
    pub fn clip(&self, [min, max]: CropBox) -> Result<CropBox, String> {
        let Some([low, high]) = self.bounds else { return Ok([min, max]) };
        let clipped: CropBox = [[0, 1, 2].map(|k| min[k].max(low[k])), [0, 1, 2].map(|k| max[k].min(high[k]))];
        match (0..3).all(|k| clipped[0][k] < clipped[1][k]) {
            true => Ok(clipped),
            false => Err(format!("the box of `{FILE}` holds nothing of the scene's: set it again in the viewer")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::Disk;
    use std::fs;

    /// Four in a cluster, one apart, one faint, one large.
    fn cloud() -> Gaussians {
        let mut cloud = Gaussians::new(7, 0).unwrap();
        let x = [0.0, 0.1, 0.0, 0.1, 5.0, 0.05, 0.05];
        let y = [0.0, 0.0, 0.1, 0.1, 5.0, 0.05, 0.0];
        for i in 0..7 {
            (cloud.mean[i], cloud.mean[7 + i]) = (x[i], y[i]);
            cloud.logit[i] = if i == 5 { -6.0 } else { 3.0 };
            for k in 0..3 {
                cloud.log_scale[k * 7 + i] = if i == 6 && k == 1 { 1.0 } else { -4.0 };
            }
        }
        cloud
    }

    fn kept(crop: &Crop) -> Vec<u32> {
        let cloud = cloud();
        crop.rows(&cloud, &Traits::of(&cloud)).unwrap().from().to_vec()
    }

    #[test]
    fn each_part_of_the_filter_leaves_out_its_own() {
        assert_eq!(kept(&Crop::default()), [0, 1, 2, 3, 4, 5, 6]);
        assert_eq!(kept(&Crop { faint: 0.05, ..Crop::default() }), [0, 1, 2, 3, 4, 6]);
        assert_eq!(kept(&Crop { large: Some(1.0), ..Crop::default() }), [0, 1, 2, 3, 4, 5]);
        assert_eq!(kept(&Crop { alone: Some(1.0), ..Crop::default() }), [0, 1, 2, 3, 5, 6]);
        let bounds = Some([[-1.0, -1.0, -1.0], [0.07, 1.0, 1.0]]);
        let crop = Crop { bounds, faint: 0.05, large: Some(1.0), alone: Some(1.0), up: None };
        assert_eq!(kept(&crop), [0, 2]);
        assert_eq!(crop.cloud(&cloud()).unwrap().len(), 2);
        assert!(!crop.keeps_everything() && Crop { up: Some([0.0, 0.0, 1.0]), ..Crop::default() }.keeps_everything());
        assert!(Crop { faint: 1.0, ..Crop::default() }.cloud(&cloud()).unwrap().is_empty());
        let none = Gaussians::new(0, 0).unwrap();
        assert!(crop.cloud(&none).unwrap().is_empty());
    }

    #[test]
    fn boxes_are_clipped() {
        let crop = Crop { bounds: Some([[0.0; 3], [2.0; 3]]), ..Crop::default() };
        assert_eq!(crop.clip([[-1.0; 3], [1.0; 3]]).unwrap(), [[0.0; 3], [1.0; 3]]);
        assert!(crop.clip([[3.0; 3], [4.0; 3]]).unwrap_err().contains("crop.json"));
        assert_eq!(Crop::default().clip([[3.0; 3], [4.0; 3]]).unwrap(), [[3.0; 3], [4.0; 3]]);
    }

    #[test]
    fn a_crop_is_kept_beside_what_it_is_of() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cloud.ply");
        fs::write(&file, "ply").unwrap();
        assert_eq!(Crop::path_of(folder.path()), folder.path().join("crop.json"));
        assert_eq!(Crop::path_of(&file), folder.path().join("cloud.ply.crop.json"));
        assert_eq!(Crop::of(folder.path()).unwrap(), None);
        let crop = Crop {
            bounds: Some([[-1.5, 0.0, 1e-3], [1.0, 2.0, 3.0]]),
            faint: 0.05,
            large: Some(0.1),
            alone: None,
            up: Some([0.0, 0.6, 0.8]),
        };
        crop.write(&Disk, &Crop::path_of(&file)).unwrap();
        assert_eq!(Crop::of(&file).unwrap(), Some(crop));
        fs::write(Crop::path_of(folder.path()), "{}").unwrap();
        assert_eq!(Crop::of(folder.path()).unwrap(), Some(Crop::default()), "all fields have a default");
    }

    #[test]
    fn what_is_wrong_with_a_file_is_named_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        for (text, part) in [
            ("", "EOF"),
            ("[1]", "invalid"),
            (r#"{"bos": null}"#, "unknown field `bos`"),
            (r#"{"box": [[0, 0, 0], [1, 0, 1]]}"#, "`box`: y from 0 to 0"),
            (r#"{"box": [[0, 0], [1, 1]]}"#, "invalid length"),
            (r#"{"faint": 2}"#, "`faint` = 2"),
            (r#"{"large": 0}"#, "`large` = 0"),
            (r#"{"alone": -1}"#, "`alone` = -1"),
            (r#"{"up": [0, 0, 0]}"#, "`up`"),
            (&" ".repeat(100_000), "100000 bytes"),
        ] {
            fs::write(&path, text).unwrap();
            let error = Crop::read(&path).unwrap_err().to_string();
            assert!(error.contains(part) && error.contains(FILE) && error.contains("--no-crop"), "{text}: {error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
        let nan = Crop { faint: f64::NAN, ..Crop::default() };
        assert!(nan.write(&Disk, &path).unwrap_err().to_string().contains("`faint`"));
    }
}

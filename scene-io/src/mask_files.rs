//! Where the ignore mask of an image is.

use crate::Problem;
use crate::files::IMAGE_EXTENSIONS;
use crate::options::{LoadOptions, Masks};
use crate::reading::{MaskFolder, RawFrame, Reading};
use std::path::{Path, PathBuf};

/// The ignore mask of a frame whose image was found: the one the dataset names, the one beside the image, the one in a
/// folder of masks; as [`LoadOptions::masks`] allows.
pub(crate) fn find_mask(
    raw: &RawFrame,
    image: &Path,
    reading: &Reading,
    options: &LoadOptions,
) -> Result<Option<PathBuf>, Problem> {
    let (folder, relative) = match &options.masks {
        Masks::Off => return Ok(None),
        Masks::Auto => {
            if let Some(mask) = &raw.mask {
                if mask.is_file() {
                    return Ok(Some(mask.clone()));
                }
                let (file, field) = &raw.listed;
                return Err(Problem::new(file, "the mask is not there", "add it, or give `--masks off`")
                    .frame(&raw.name)
                    .field(format!("{field}.mask_path"))
                    .value(mask.display()));
            }
            let beside = image.with_extension("mask.png");
            if beside.is_file() {
                return Ok(Some(beside));
            }
            if reading.mask_folder == MaskFolder::Unknown {
                return Ok(None);
            }
            match beside_images(image, reading) {
                Some(place) => place,
                None => return Ok(None),
            }
        }
        Masks::Folder(folder) => {
            let relative = match beside_images(image, reading) {
                Some((_, relative)) => relative,
                None => PathBuf::from(image.file_name().unwrap_or_default()),
            };
            (folder.clone(), relative)
        }
    };
    let base = folder.join(&relative);
    let mut appended = base.clone().into_os_string();
    appended.push(".png");
    let flat = relative.file_name().map(|name| folder.join(name));
    let candidates = IMAGE_EXTENSIONS
        .iter()
        .map(|extension| base.with_extension(extension))
        .chain([PathBuf::from(appended)])
        .chain(flat.iter().flat_map(|f| IMAGE_EXTENSIONS.iter().map(|extension| f.with_extension(extension))));
    Ok(candidates.into_iter().find(|c| c.is_file()))
}

/// The folder `masks` (for `images_4`: `masks_4`, else `masks`) beside the images' folder, and the image's way in it.
fn beside_images(image: &Path, reading: &Reading) -> Option<(PathBuf, PathBuf)> {
    let folder = match &reading.images_folder {
        Some(folder) => folder.clone(),
        None => {
            let first = image.strip_prefix(&reading.root).ok()?.components().next()?;
            let name = first.as_os_str().to_str()?;
            if !name.starts_with("images") {
                return None;
            }
            reading.root.join(name)
        }
    };
    let relative = image.strip_prefix(&folder).ok()?.to_path_buf();
    let name = folder.file_name()?.to_str()?;
    let beside = folder.parent()?;
    let suffix = name.strip_prefix("images").unwrap_or("");
    let masks = [format!("masks{suffix}"), "masks".to_owned()].into_iter().map(|m| beside.join(m)).find(|m| m.is_dir());
    Some((masks?, relative))
}

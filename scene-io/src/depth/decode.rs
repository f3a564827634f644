//! Depth files to numbers.

use super::map::DepthMap;
use crate::decode_memory::DecodeMemory;
use crate::picture::{Plan, exr_blocks};
use crate::{ErrorKind, Problem, SceneError, files, npy};
use exr::meta::header::Header;
use exr::prelude::{FlatSamples, MetaData, ReadChannels, ReadLayers, Vec2, read as exr_reader};
use image::DynamicImage;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Reads a depth file as it is, in its own unit and meaning; NaN and negative numbers are left in.
pub(crate) fn read_file(path: &Path) -> Result<DepthMap, SceneError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let map = match extension.as_str() {
        "npy" => array(path)?,
        "exr" => channel(path)?,
        "png" => grey(path)?,
        _ => {
            let what = "is not a depth map that can be read";
            return Err(wrong(path, what, "save depths as .npy, 16-bit grey .png or .exr"));
        }
    };
    if map.z.is_empty() {
        return Err(wrong(path, format!("the depth map is empty ({}x{})", map.width, map.height), "write it again"));
    }
    Ok(map)
}

fn wrong(path: &Path, what: impl Into<String>, remedy: &str) -> SceneError {
    SceneError::new(ErrorKind::Format, Problem::new(path, what, remedy))
}

fn array(path: &Path) -> Result<DepthMap, SceneError> {
    npy::with(path, 4, |array| from_array(path, &array))
}

fn from_array(path: &Path, array: &npy::Array) -> Result<DepthMap, SceneError> {
    let shape = array.shape.as_slice();
    let (&[height, width] | &[height, width, 1]) = shape else {
        let problem = Problem::new(path, "is not a depth map", "save it as [height][width]");
        return Err(SceneError::new(ErrorKind::Format, problem.field("shape").value(format!("{shape:?}"))));
    };
    let size = |n: usize| {
        u32::try_from(n)
            .map_err(|_| wrong(path, format!("a side of {n} pixels is too long"), "save a smaller depth map"))
    };
    Ok(DepthMap { width: size(width)?, height: size(height)?, z: array.data.iter().map(|z| *z as f32).collect() })
}

fn grey(path: &Path) -> Result<DepthMap, SceneError> {
    let plan = Plan::of(path)?;
    let _held = plan.reserve(plan.bytes(4))?;
    let picture = plan.decode()?;
    let (width, height) = (picture.width(), picture.height());
    let z = match picture {
        DynamicImage::ImageLuma8(grey) => grey.into_raw().into_iter().map(f32::from).collect(),
        DynamicImage::ImageLuma16(grey) => grey.into_raw().into_iter().map(f32::from).collect(),
        // Some writers save the same number three times.
        DynamicImage::ImageRgb8(rgb) if rgb.pixels().all(|p| p[0] == p[1] && p[0] == p[2]) => {
            rgb.pixels().map(|p| f32::from(p[0])).collect()
        }
        DynamicImage::ImageRgb16(rgb) if rgb.pixels().all(|p| p[0] == p[1] && p[0] == p[2]) => {
            rgb.pixels().map(|p| f32::from(p[0])).collect()
        }
        other => {
            let what = format!("is not a depth map but a picture of {:?}", other.color());
            return Err(wrong(path, what, "save depths as grey, 16-bit PNG, not as a colour map"));
        }
    };
    Ok(DepthMap { width, height, z })
}

/// Channels that hold depths, best first; a renderer's pass may be called `View.Z`.
const DEPTH_CHANNELS: [&str; 3] = ["Z", "Y", "R"];

fn channel(path: &Path) -> Result<DepthMap, SceneError> {
    files::refuse_folder(path)?;
    let open = || File::open(path).map(BufReader::new).map_err(|e| SceneError::io(path, "read the file", e));
    let broken = |e: exr::error::Error| {
        wrong(path, format!("the EXR file is broken or cut off: {e}"), "copy or write it again").caused_by(e)
    };
    let meta = MetaData::read_from_buffered(open()?, false).map_err(broken)?;
    // The layer is read with all its channels, of which one is kept.
    let of = |header: &Header| {
        let pixels = (header.layer_size.0 as u64).saturating_mul(header.layer_size.1 as u64);
        pixels.saturating_mul(header.channels.bytes_per_pixel as u64 + 4)
    };
    let largest = meta.headers.iter().max_by_key(|header| of(header));
    let (size, bytes) = largest.map_or((Vec2(0, 0), 0), |header| (header.layer_size, of(header)));
    let bytes = bytes.saturating_add(exr_blocks(&mut open()?)).saturating_add(1 << 18);
    let what = format!("its {}x{} pixels", size.0, size.1);
    let _held = DecodeMemory::of_process().reserve(path, &what, bytes)?;
    let image = exr_reader()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(open()?)
        .map_err(broken)?;
    let layer = image.layer_data;
    let full = |name: &str| {
        let is = |text: String| text == name || text.ends_with(&format!(".{name}"));
        layer.channel_data.list.iter().find(|c| is(c.name.to_string()) && c.sampling.0 == 1 && c.sampling.1 == 1)
    };
    let chosen = DEPTH_CHANNELS.into_iter().find_map(full).or(layer.channel_data.list.first());
    let Some(chosen) = chosen else { return Err(wrong(path, "holds no channel", "write the depth into a channel Z")) };
    let z: Vec<f32> = match &chosen.sample_data {
        FlatSamples::F16(values) => values.iter().map(|v| v.to_f32()).collect(),
        FlatSamples::F32(values) => values.clone(),
        FlatSamples::U32(values) => values.iter().map(|v| *v as f32).collect(),
    };
    let (width, height) = (layer.size.0 as u32, layer.size.1 as u32);
    DepthMap::new(width, height, z).ok_or_else(|| {
        let what = format!("its channel {} does not hold {width} x {height} values", chosen.name);
        wrong(path, what, "write the depth at full resolution")
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{AnyChannel, AnyChannels, Encoding, Image, Layer, LayerAttributes, WritableImage, f16};

    fn exr_file(path: &Path, channels: Vec<AnyChannel<FlatSamples>>) {
        let channels = AnyChannels::sort(channels.into_iter().collect());
        let layer = Layer::new(Vec2(3, 2), LayerAttributes::default(), Encoding::SMALL_LOSSLESS, channels);
        Image::from_layer(layer).write().to_file(path).unwrap();
    }

    #[test]
    fn exr_channels_are_found_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let values = |at: f32| (0..6).map(|i| at + i as f32).collect::<Vec<f32>>();
        let f32s = |name: &str, at| AnyChannel::new(name, FlatSamples::F32(values(at)));
        exr_file(&path, vec![f32s("A", 0.0), f32s("Z", 10.0), f32s("R", 20.0)]);
        let map = read_file(&path).unwrap();
        assert_eq!((map.width, map.height, map.z), (3, 2, values(10.0)));
        exr_file(&path, vec![f32s("View.Depth", 1.0), f32s("View.Y", 2.0)]);
        assert_eq!(read_file(&path).unwrap().z, values(2.0));
        let halves = values(5.0).into_iter().map(f16::from_f32).collect();
        exr_file(&path, vec![AnyChannel::new("D", FlatSamples::F16(halves))]);
        assert_eq!(read_file(&path).unwrap().z, values(5.0));
        exr_file(&path, vec![AnyChannel::new("Z", FlatSamples::U32(vec![7; 6]))]);
        assert_eq!(read_file(&path).unwrap().z, [7.0; 6]);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 4]).unwrap();
        let error = read_file(&path).unwrap_err().to_string();
        assert!(error.contains("a.exr") && error.contains("broken or cut off"), "{error}");
    }

    #[test]
    fn grey_pictures_are_depths_and_colours_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        image::ImageBuffer::from_fn(3, 2, |x, y| image::Luma([(1000 * x + y) as u16])).save(&path).unwrap();
        assert_eq!(read_file(&path).unwrap().z, [0.0, 1000.0, 2000.0, 1.0, 1001.0, 2001.0]);
        image::ImageBuffer::from_pixel(3, 2, image::Luma([105_u8])).save(&path).unwrap();
        assert_eq!(read_file(&path).unwrap().z, [105.0; 6]);
        image::ImageBuffer::from_pixel(3, 2, image::Rgb([9_u8; 3])).save(&path).unwrap();
        assert_eq!(read_file(&path).unwrap().z, [9.0; 6]);
        image::ImageBuffer::from_pixel(3, 2, image::Rgb([9_u8, 8, 9])).save(&path).unwrap();
        let error = read_file(&path).unwrap_err().to_string();
        assert!(error.contains("a picture of Rgb8"), "{error}");
        let other = folder.path().join("a.tif");
        std::fs::write(&other, "x").unwrap();
        assert!(read_file(&other).unwrap_err().to_string().contains("is not a depth map that can be read"));
    }
}

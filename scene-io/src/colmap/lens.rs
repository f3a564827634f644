//! COLMAP's camera models by number and name: how many parameters, and which lens they make.

use super::model::ModelCamera;
use crate::Problem;
use render_core::camera::Lens;

/// Names by number, with the number of parameters.
const MODELS: [(&str, usize); 11] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
];

/// Name and number of parameters of a model by its number.
pub(super) fn by_number(number: i32) -> Option<(&'static str, usize)> {
    usize::try_from(number).ok().and_then(|i| MODELS.get(i)).copied()
}

/// Number of parameters of a model by its name.
pub(super) fn by_name(name: &str) -> Option<(&'static str, usize)> {
    MODELS.into_iter().find(|(n, _)| *n == name)
}

/// For messages.
pub(super) fn supported() -> String {
    let names: Vec<&str> = MODELS.iter().map(|(name, _)| *name).collect();
    format!("convert the camera with COLMAP's model_converter or image_undistorter; supported are {}", names.join(", "))
}

/// A camera from its parameters in the order of the file. The problem's place is for the caller to add.
pub(super) fn camera(
    file: &std::path::Path,
    name: &str,
    width: u64,
    height: u64,
    p: &[f64],
) -> Result<ModelCamera, Problem> {
    let problem = |field: &str, value: String, what: &str| {
        Problem::new(file, what, "estimate the camera again").field(field).value(value)
    };
    let (Ok(width), Ok(height)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(problem("width, height", format!("{width} x {height}"), "no image is that large"));
    };
    if width == 0 || height == 0 {
        return Err(problem("width, height", format!("{width} x {height}"), "the image has no pixels"));
    }
    if let Some(i) = p.iter().position(|v| !v.is_finite()) {
        return Err(problem(&format!("params[{i}]"), p[i].to_string(), "is not a finite number"));
    }
    let radial = |k: [f64; 2], p: [f64; 2]| Lens::Perspective { k: [k[0], k[1], 0.0, 0.0, 0.0, 0.0], p };
    let ([fx, fy, cx, cy], lens) = match (name, p) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], Lens::PINHOLE),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Lens::PINHOLE),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f, cx, cy], radial([k, 0.0], [0.0; 2])),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], radial([k1, k2], [0.0; 2])),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => ([fx, fy, cx, cy], radial([k1, k2], [p1, p2])),
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            ([fx, fy, cx, cy], Lens::Fisheye { k: [k1, k2, k3, k4] })
        }
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            ([fx, fy, cx, cy], Lens::Perspective { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] })
        }
        ("FOV", &[fx, fy, cx, cy, omega]) => ([fx, fy, cx, cy], Lens::Fov { omega }),
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => ([f, f, cx, cy], Lens::Fisheye { k: [k, 0.0, 0.0, 0.0] }),
        ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], Lens::Fisheye { k: [k1, k2, 0.0, 0.0] }),
        ("THIN_PRISM_FISHEYE", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx, sy]) => {
            let lens = Lens::ThinPrismFisheye { k: [k1, k2, k3, k4], p: [p1, p2], s: [sx, sy] };
            ([fx, fy, cx, cy], lens)
        }
        _ => {
            let value = format!("{name} with {} parameters", p.len());
            return Err(Problem::new(file, "unknown camera model", supported()).field("MODEL").value(value));
        }
    };
    for (field, f) in [("fx", fx), ("fy", fy)] {
        if f <= 0.0 {
            return Err(problem(field, f.to_string(), "the focal length must be above 0"));
        }
    }
    Ok(ModelCamera { width, height, fx, fy, cx, cy, lens })
}

/// Name of models newer than those above, for messages.
pub(super) fn newer(number: i32) -> &'static str {
    match number {
        11 => "RAD_TAN_THIN_PRISM_FISHEYE",
        12 => "SIMPLE_DIVISION",
        13 => "DIVISION",
        14 => "SIMPLE_FISHEYE",
        15 => "FISHEYE",
        16 => "EQUIRECTANGULAR",
        _ => "unknown",
    }
}

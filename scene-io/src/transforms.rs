//! What the `transforms*.json` family has in common: intrinsics, lens and pose of a frame.

use crate::depth::DepthSource;
use crate::files::plain_name;
use crate::json::Object;
use crate::pose::{Axes, pose_from};
use crate::priors::{FlowPlace, FlowTruth};
use crate::reading::{Intrinsics, RawFrame};
use crate::{Problem, Size, Split, files};
use glam::{DMat3, DVec3};
use render_core::camera::Lens;
use std::path::{Path, PathBuf};

/// A frame of a `transforms*.json`; fields of the frame come before those at top level.
pub(crate) fn raw_frame(root: &Path, top: &Object<'_>, frame: &Object<'_>, split: Split) -> Result<RawFrame, Problem> {
    let Some(written) = frame.string("file_path")? else {
        return Err(frame.problem("file_path", "is missing", "name the image of the frame"));
    };
    let name = plain_name(written);
    let in_frame = |p: Problem| p.frame(&name);
    let image = path_inside(root, frame, "file_path", written).map_err(in_frame)?;
    let matrix = frame.matrix("transform_matrix").map_err(in_frame)?.ok_or_else(|| {
        in_frame(frame.problem("transform_matrix", "is missing", "give the 4x4 camera-to-world matrix"))
    })?;
    let (pose, mended) = pose(&matrix).map_err(|bad| {
        let field = frame.field("transform_matrix");
        let field = bad.entry.map_or(field.clone(), |(i, j)| format!("{field}[{i}][{j}]"));
        in_frame(Problem::new(frame.file, bad.what, bad.remedy).field(field).value(bad.value))
    })?;
    let own = Fields { frame, top };
    let optional_path = |key: &str| match frame.string(key)? {
        Some(written) => path_inside(root, frame, key, written).map(Some),
        None => Ok(None),
    };
    Ok(RawFrame {
        image,
        listed: (frame.file.to_path_buf(), frame.path.clone()),
        size: own.size().map_err(in_frame)?,
        intrinsics: own.intrinsics().map_err(in_frame)?,
        lens: own.lens().map_err(in_frame)?,
        pose,
        mended,
        split,
        time: frame.number("time").map_err(in_frame)?,
        mask: optional_path("mask_path").map_err(in_frame)?,
        depth: match optional_path("depth_file_path").map_err(in_frame)? {
            None => optional_path("depth_path").map_err(in_frame)?,
            depth => depth,
        }
        .map(depth_source),
        transient: optional_path("transient_mask_path").map_err(in_frame)?,
        moving: optional_path("moving_path").map_err(in_frame)?,
        covisible: None,
        flow: flow(root, frame).map_err(in_frame)?,
        ids: None,
        tracks: Vec::new(),
        z_bounds: None,
        sharpness: frame.number("sharpness").map_err(in_frame)?,
        name,
    })
}

/// Truth about flow: three fields, or none.
fn flow(root: &Path, frame: &Object<'_>) -> Result<Option<FlowTruth>, Problem> {
    let [flow, valid] = ["flow_path", "flow_valid_path"].map(|key| match frame.string(key)? {
        Some(written) => path_inside(root, frame, key, written).map(Some),
        None => Ok(None),
    });
    match (flow?, valid?, frame.string("flow_to")?.map(plain_name)) {
        (None, None, None) => Ok(None),
        (Some(flow), Some(valid), Some(to)) => Ok(Some(FlowTruth { to, place: FlowPlace::Files { flow, valid } })),
        _ => {
            let what = "is one of three fields that belong together";
            Err(frame.problem("flow_path", what, "give `flow_path`, `flow_valid_path` and `flow_to`, or none of them"))
        }
    }
}

/// Millimetres in PNG files, as nerfstudio writes them; world units elsewhere.
fn depth_source(path: PathBuf) -> DepthSource {
    let millimetres = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    DepthSource::file(path).in_units_of(if millimetres { 1e-3 } else { 1.0 })
}

/// A path of the file, refused where it leads out of the dataset.
pub(crate) fn path_inside(root: &Path, object: &Object<'_>, key: &str, written: &str) -> Result<PathBuf, Problem> {
    files::inside(root, written).filter(|_| !written.is_empty()).ok_or_else(|| {
        object.problem(key, "leads out of the dataset's folder", "move the file into it and write a relative path")
    })
}

fn pose(m: &[[f64; 4]; 3]) -> Result<(render_core::camera::Pose, crate::pose::Mended), crate::pose::BadPose> {
    let column = |j: usize| DVec3::new(m[0][j], m[1][j], m[2][j]);
    pose_from(Axes::Gl, DMat3::from_cols(column(0), column(1), column(2)), column(3))
}

/// A field of the frame, else of the whole file.
struct Fields<'a, 'b> {
    frame: &'b Object<'a>,
    top: &'b Object<'a>,
}

impl<'a, 'b> Fields<'a, 'b> {
    fn holder(&self, key: &str) -> &'b Object<'a> {
        if self.frame.has(key) { self.frame } else { self.top }
    }

    fn number(&self, key: &str) -> Result<Option<f64>, Problem> {
        self.holder(key).number(key)
    }

    fn coefficients<const N: usize>(&self, keys: [&str; N]) -> Result<[f64; N], Problem> {
        let mut values = [0.0; N];
        for (value, key) in values.iter_mut().zip(keys) {
            *value = self.number(key)?.unwrap_or(0.0);
        }
        Ok(values)
    }

    fn size(&self) -> Result<Option<Size>, Problem> {
        match (self.holder("w").pixels("w")?, self.holder("h").pixels("h")?) {
            (Some(w), Some(h)) => Ok(Some(Size::new(w, h))),
            (None, None) => Ok(None),
            (Some(_), None) => Err(self.top.problem("h", "is missing beside `w`", "give both or neither")),
            (None, Some(_)) => Err(self.top.problem("w", "is missing beside `h`", "give both or neither")),
        }
    }

    fn intrinsics(&self) -> Result<Intrinsics, Problem> {
        let (cx, cy) = (self.number("cx")?, self.number("cy")?);
        if let Some(key) =
            ["fl_x", "fl_y"].into_iter().find(|k| self.frame.has(k)).or(Some("fl_x").filter(|k| self.top.has(k)))
        {
            let fx = self.focal("fl_x")?;
            let fy = self.focal("fl_y")?;
            let first =
                fx.or(fy).ok_or_else(|| self.holder(key).problem(key, "is missing", "give the focal length"))?;
            return Ok(Intrinsics::Pixels { fx: fx.unwrap_or(first), fy: fy.unwrap_or(first), cx, cy });
        }
        let x = match self.angle("camera_angle_x", 1.0)? {
            None => self.angle("x_fov", std::f64::consts::PI / 180.0)?,
            x => x,
        };
        let y = match self.angle("camera_angle_y", 1.0)? {
            None => self.angle("y_fov", std::f64::consts::PI / 180.0)?,
            y => y,
        };
        match x {
            Some(x) => Ok(Intrinsics::Angles { x, y, cx, cy }),
            None => {
                let what = "no focal length: neither `fl_x` nor `camera_angle_x`";
                Err(self.top.problem("fl_x", what, "add one of them, in pixels or radians"))
            }
        }
    }

    fn focal(&self, key: &str) -> Result<Option<f64>, Problem> {
        match self.number(key)? {
            Some(f) if f <= 0.0 => {
                Err(self.holder(key).problem(key, "the focal length must be above 0", "give it in pixels"))
            }
            f => Ok(f),
        }
    }

    /// A full angle of view in radians; `unit` radians make one unit of the file.
    fn angle(&self, key: &str, unit: f64) -> Result<Option<f64>, Problem> {
        match self.number(key)? {
            Some(angle) if angle <= 0.0 || angle * unit >= std::f64::consts::PI => {
                let what = "is not an angle of view between 0 and 180 degrees";
                let remedy =
                    if unit == 1.0 { "give the full angle in radians" } else { "give the full angle in degrees" };
                Err(self.holder(key).problem(key, what, remedy))
            }
            angle => Ok(angle.map(|a| a * unit)),
        }
    }

    fn lens(&self) -> Result<Lens, Problem> {
        for key in ["ftheta_p0", "latlong", "equirectangular", "orthographic"] {
            // `ftheta_p0` is a coefficient, the others are switches.
            let set = if key == "ftheta_p0" { self.holder(key).has(key) } else { self.holder(key).flag(key)? };
            if set {
                let remedy = "use images of a perspective or OpenCV fisheye lens";
                return Err(self.holder(key).problem(key, "this lens model is not supported", remedy));
            }
        }
        let model = self.holder("camera_model").string("camera_model")?.unwrap_or("OPENCV");
        let fisheye = self.holder("is_fisheye").flag("is_fisheye")?;
        match model {
            _ if fisheye => Ok(Lens::Fisheye { k: self.coefficients(["k1", "k2", "k3", "k4"])? }),
            "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "PERSPECTIVE" => {
                let [k1, k2, k3, k4] = self.coefficients(["k1", "k2", "k3", "k4"])?;
                if k4 != 0.0 {
                    let what = "a fourth radial coefficient belongs to fisheye lenses";
                    let remedy = "set camera_model to OPENCV_FISHEYE or FULL_OPENCV, or k4 to 0";
                    return Err(self.holder("k4").problem("k4", what, remedy));
                }
                let p = self.coefficients(["p1", "p2"])?;
                Ok(Lens::Perspective { k: [k1, k2, k3, 0.0, 0.0, 0.0], p })
            }
            "FULL_OPENCV" => {
                let k = self.coefficients(["k1", "k2", "k3", "k4", "k5", "k6"])?;
                Ok(Lens::Perspective { k, p: self.coefficients(["p1", "p2"])? })
            }
            "OPENCV_FISHEYE" | "FISHEYE" | "RADIAL_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" => {
                Ok(Lens::Fisheye { k: self.coefficients(["k1", "k2", "k3", "k4"])? })
            }
            _ => {
                let remedy = "supported are OPENCV, PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, FULL_OPENCV and \
                              OPENCV_FISHEYE";
                Err(self.holder("camera_model").problem("camera_model", "unknown camera model", remedy))
            }
        }
    }
}

//! COLMAP's camera models by name and number.

use alloc::{vec, vec::Vec};

use super::{lens::Lens, parameters::Camera};
use crate::{error::CameraError, pose::Pose};

/// A camera model of COLMAP's `cameras.txt` / `cameras.bin`.
///
/// Later models than [`ColmapModel::ThinPrismFisheye`] are not supported: [`ColmapModel::from_name`] and
/// [`ColmapModel::from_id`] give `None`, and [`ColmapModel::ALL`] lists what is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[allow(missing_docs, reason = "the names are the documentation: see `name` and `parameter_names`")]
pub enum ColmapModel {
    SimplePinhole,
    Pinhole,
    SimpleRadial,
    Radial,
    OpenCv,
    OpenCvFisheye,
    FullOpenCv,
    Fov,
    SimpleRadialFisheye,
    RadialFisheye,
    ThinPrismFisheye,
}

impl ColmapModel {
    /// Every model, by id.
    pub const ALL: [Self; 11] = [
        Self::SimplePinhole,
        Self::Pinhole,
        Self::SimpleRadial,
        Self::Radial,
        Self::OpenCv,
        Self::OpenCvFisheye,
        Self::FullOpenCv,
        Self::Fov,
        Self::SimpleRadialFisheye,
        Self::RadialFisheye,
        Self::ThinPrismFisheye,
    ];

    /// Number in binary files.
    #[must_use]
    pub fn id(self) -> u32 {
        self as u32
    }

    /// Name in text files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::SimplePinhole => "SIMPLE_PINHOLE",
            Self::Pinhole => "PINHOLE",
            Self::SimpleRadial => "SIMPLE_RADIAL",
            Self::Radial => "RADIAL",
            Self::OpenCv => "OPENCV",
            Self::OpenCvFisheye => "OPENCV_FISHEYE",
            Self::FullOpenCv => "FULL_OPENCV",
            Self::Fov => "FOV",
            Self::SimpleRadialFisheye => "SIMPLE_RADIAL_FISHEYE",
            Self::RadialFisheye => "RADIAL_FISHEYE",
            Self::ThinPrismFisheye => "THIN_PRISM_FISHEYE",
        }
    }

    /// Names of the parameters, in file order.
    #[must_use]
    pub fn parameter_names(self) -> &'static [&'static str] {
        match self {
            Self::SimplePinhole => &["f", "cx", "cy"],
            Self::Pinhole => &["fx", "fy", "cx", "cy"],
            Self::SimpleRadial | Self::SimpleRadialFisheye => &["f", "cx", "cy", "k"],
            Self::Radial | Self::RadialFisheye => &["f", "cx", "cy", "k1", "k2"],
            Self::OpenCv => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"],
            Self::OpenCvFisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"],
            Self::FullOpenCv => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
            Self::Fov => &["fx", "fy", "cx", "cy", "omega"],
            Self::ThinPrismFisheye => &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"],
        }
    }

    /// The model of that name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.name() == name)
    }

    /// The model of that number.
    #[must_use]
    pub fn from_id(id: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.id() == id)
    }

    /// A camera of this model; `parameters` in file order.
    ///
    /// # Errors
    /// [`CameraError`] when the number of parameters is another, or what [`Camera::check`] refuses.
    pub fn camera(self, width: u32, height: u32, parameters: &[f64], pose: Pose) -> Result<Camera, CameraError> {
        let names = self.parameter_names();
        if parameters.len() != names.len() {
            return Err(CameraError::ParameterCount { model: self.name(), want: names.len(), got: parameters.len() });
        }
        let (focal, rest) = parameters.split_at(if names[0] == "f" { 1 } else { 2 });
        let (centre, c) = rest.split_at(2);
        let lens = match (self, c) {
            (Self::SimpleRadial, &[k1]) => Lens::opencv5([k1, 0.0, 0.0, 0.0, 0.0]),
            (Self::Radial, &[k1, k2]) => Lens::opencv5([k1, k2, 0.0, 0.0, 0.0]),
            (Self::OpenCv, &[k1, k2, p1, p2]) => Lens::opencv5([k1, k2, p1, p2, 0.0]),
            (Self::OpenCvFisheye, &[k1, k2, k3, k4]) => Lens::Fisheye { k: [k1, k2, k3, k4] },
            (Self::FullOpenCv, &[k1, k2, p1, p2, k3, k4, k5, k6]) => {
                Lens::Perspective { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] }
            }
            (Self::Fov, &[omega]) => Lens::Fov { omega },
            (Self::SimpleRadialFisheye, &[k1]) => Lens::Fisheye { k: [k1, 0.0, 0.0, 0.0] },
            (Self::RadialFisheye, &[k1, k2]) => Lens::Fisheye { k: [k1, k2, 0.0, 0.0] },
            (Self::ThinPrismFisheye, &[k1, k2, p1, p2, k3, k4, sx, sy]) => {
                Lens::ThinPrismFisheye { k: [k1, k2, k3, k4], p: [p1, p2], s: [sx, sy] }
            }
            _ => Lens::PINHOLE, // the two pinholes: the counts were checked
        };
        let (fx, fy) = (focal[0], focal[focal.len() - 1]);
        let camera = Camera { width, height, fx, fy, cx: centre[0], cy: centre[1], lens, pose };
        camera.check()?;
        Ok(camera)
    }

    /// The simplest model that describes a camera exactly, and its parameters in file order.
    #[must_use]
    pub fn describe(camera: &Camera) -> (Self, Vec<f64>) {
        let mut out = vec![camera.fx, camera.fy, camera.cx, camera.cy];
        let model = match camera.lens {
            lens if lens.is_pinhole() => Self::Pinhole,
            Lens::Perspective { k: [k1, k2, 0.0, 0.0, 0.0, 0.0], p: [p1, p2] } => {
                out.extend([k1, k2, p1, p2]);
                Self::OpenCv
            }
            Lens::Perspective { k: [k1, k2, k3, k4, k5, k6], p: [p1, p2] } => {
                out.extend([k1, k2, p1, p2, k3, k4, k5, k6]);
                Self::FullOpenCv
            }
            Lens::Fisheye { k } => {
                out.extend(k);
                Self::OpenCvFisheye
            }
            Lens::Fov { omega } => {
                out.push(omega);
                Self::Fov
            }
            Lens::ThinPrismFisheye { k: [k1, k2, k3, k4], p: [p1, p2], s: [sx, sy] } => {
                out.extend([k1, k2, p1, p2, k3, k4, sx, sy]);
                Self::ThinPrismFisheye
            }
        };
        (model, out)
    }
}

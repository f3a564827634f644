//! Settings of systems for scenes that move; all of them can be given as `--set name=value`, beside those of the field.

use crate::deform::{Ambient, DeformConfig, ElasticAt, Moment, Motion, Origin, PlanesOfTime, SeenBy, Sees, Warp};
use crate::samplers::CueConfig;
use engine::system::SystemError;
use serde::{Deserialize, Serialize};

/// How a moment is told to the networks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MomentKind {
    /// Time, its sines and cosines.
    Time,
    /// The same through a small network.
    Network,
    /// A free code for each moment trained on.
    Codes,
}

/// What a deformation says of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum WarpKind {
    /// Nothing: points stay where they are.
    None,
    /// A displacement.
    Translation,
    /// A rotation and a translation.
    Rigid,
}

/// What the density network sees besides features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SeesKind {
    /// Nothing.
    Place,
    /// The moment.
    Moment,
    /// The moment and the point where it is now.
    Point,
}

/// What a warp does at `t = 0`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum OriginKind {
    /// Nothing: the canonical scene is that of `t = 0`.
    Canonical,
    /// What it does at any other time.
    Free,
}

/// Sets of planes at most.
const MAX_PLANES: usize = 8;

/// Settings of a system for scenes that move.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DynamicConfig {
    /// How a moment is told to the networks: `time`, `network` or `codes`.
    pub moment: MomentKind,
    /// Octaves of the time (`time`, `network`).
    pub time_octaves: usize,
    /// Numbers of a moment (`network`, `codes`).
    pub moment_dims: usize,

    /// What the deformation says of a point: `none`, `translation` or `rigid`.
    pub warp: WarpKind,
    /// What it does at `t = 0`: `canonical` (nothing) or `free`.
    pub origin: OriginKind,
    /// Octaves of the point it sees.
    pub warp_octaves: usize,
    /// Steps over which these come in, coarse to fine; 0: all from the start.
    pub warp_anneal: u64,
    /// Planes of features of place and time: cells along an axis of each set; none: `[]`.
    pub planes: Vec<usize>,
    /// Who sees them: `warp`, `density` or `both`.
    pub planes_seen_by: SeenBy,
    /// Features of a set of planes.
    pub plane_features: usize,
    /// Cells along the axis of time.
    pub plane_times: usize,
    /// Learning rate of the planes, a factor of that of the networks.
    pub plane_lr: f64,
    /// Factor of the variation of their features in space; 0: none.
    pub plane_tv: f32,
    /// Factor of that in time.
    pub plane_slow: f32,
    /// Width and number of its hidden layers.
    pub warp_width: usize,
    /// See `warp_width`.
    pub warp_depth: usize,

    /// Coordinates beyond space; 0: none.
    pub ambient: usize,
    /// Octaves of the point that their network sees.
    pub ambient_octaves: usize,
    /// Width and number of its hidden layers.
    pub ambient_width: usize,
    /// See `ambient_width`.
    pub ambient_depth: usize,
    /// Steps before they come in.
    pub ambient_from: u64,
    /// Steps over which they come in.
    pub ambient_anneal: u64,

    /// What the density network sees besides features: `place` (nothing), `moment`, or `point` (the moment and where the
    /// point is now).
    pub sees: SeesKind,
    /// Octaves of that point.
    pub sees_octaves: usize,

    /// Factor of the elastic loss, which keeps the deformation nearly rigid where matter is; 0: none.
    pub elastic: f32,
    /// Size of a logarithmic stretch from which on it hardly costs more.
    pub elastic_scale: f32,
    /// Samples it looks at: `middle` (one a ray) or `all` that carry weight.
    pub elastic_at: ElasticAt,
    /// Factor of the background loss, which keeps the dataset's points where they are; 0: none.
    pub background: f32,
    /// Points of a step for it.
    pub background_points: usize,
    /// Whether errors lead half of the rays: what moves is seen by one photo a moment.
    pub by_error: bool,
    /// Whether masks lead the rays: none through a tool, more where it often is.
    pub guided: bool,
    /// What is made of measured depth.
    #[serde(flatten)]
    pub cues: CueConfig,
    /// Steps after which all frames have come in, in the order of time; 0: they are there from the start.
    pub curriculum: u64,
    /// Learning rate of the deformation's networks, a factor of the field's.
    pub warp_lr: f64,
    /// Learning rate of what moments are told by, a factor of that.
    pub moment_lr: f64,
}

impl DynamicConfig {
    /// A field that knows no time: nothing moves.
    #[must_use]
    pub fn still() -> Self {
        Self {
            moment: MomentKind::Time,
            time_octaves: 3,
            moment_dims: 8,
            warp: WarpKind::None,
            origin: OriginKind::Free,
            warp_octaves: 6,
            warp_anneal: 0,
            planes: vec![],
            planes_seen_by: SeenBy::Warp,
            plane_features: 8,
            plane_times: 24,
            plane_lr: 10.0,
            plane_tv: 0.0,
            plane_slow: 0.0,
            warp_width: 64,
            warp_depth: 3,
            ambient: 0,
            ambient_octaves: 6,
            ambient_width: 64,
            ambient_depth: 3,
            ambient_from: 100,
            ambient_anneal: 400,
            sees: SeesKind::Place,
            sees_octaves: 4,
            elastic: 0.0,
            elastic_scale: 0.03,
            elastic_at: ElasticAt::Middle,
            background: 0.0,
            background_points: 1024,
            by_error: false,
            guided: false,
            cues: CueConfig::NONE,
            curriculum: 0,
            warp_lr: 0.1,
            moment_lr: 1.0,
        }
    }

    /// The parts of the deformation; `None` where nothing moves.
    pub(crate) fn deform(&self) -> Option<DeformConfig> {
        let motion = match self.warp {
            WarpKind::None => None,
            WarpKind::Translation => Some(Motion::Translation),
            WarpKind::Rigid => Some(Motion::Rigid),
        };
        let seen = self.sees != SeesKind::Place || (!self.planes.is_empty() && self.planes_seen_by != SeenBy::Warp);
        if motion.is_none() && self.ambient == 0 && !seen {
            return None;
        }
        Some(DeformConfig {
            moment: match self.moment {
                MomentKind::Time => Moment::Time { octaves: self.time_octaves },
                MomentKind::Network => {
                    Moment::TimeNetwork { octaves: self.time_octaves, width: self.warp_width, dims: self.moment_dims }
                }
                MomentKind::Codes => Moment::Codes { dims: self.moment_dims },
            },
            warp: motion.map(|motion| Warp {
                octaves: self.warp_octaves,
                anneal: self.warp_anneal,
                width: self.warp_width,
                depth: self.warp_depth,
                motion,
                origin: match self.origin {
                    OriginKind::Canonical => Origin::Canonical,
                    OriginKind::Free => Origin::Free,
                },
            }),
            ambient: (self.ambient > 0).then_some(Ambient {
                dims: self.ambient,
                octaves: self.ambient_octaves,
                width: self.ambient_width,
                depth: self.ambient_depth,
                seen_octaves: 1,
                anneal: [self.ambient_from, self.ambient_anneal],
            }),
            planes: (!self.planes.is_empty()).then(|| PlanesOfTime {
                cells: self.planes.clone(),
                features: self.plane_features,
                times: self.plane_times,
                rate: self.plane_lr,
                variation: [self.plane_tv, self.plane_slow],
                seen_by: self.planes_seen_by,
            }),
            sees: match self.sees {
                SeesKind::Place => Sees::Place,
                SeesKind::Moment => Sees::Moment,
                SeesKind::Point => Sees::MomentAndPoint { octaves: self.sees_octaves },
            },
            elastic: self.elastic,
            elastic_scale: self.elastic_scale,
            elastic_at: self.elastic_at,
            background: self.background,
            background_points: self.background_points,
            curriculum: self.curriculum,
            rate: self.warp_lr,
            code_rate: self.moment_lr,
        })
    }

    /// Check what the parts do not check themselves.
    ///
    /// # Errors
    /// [`SystemError::Config`] naming the setting.
    pub fn check(&self) -> Result<(), SystemError> {
        let bad = |field: &'static str, value: String, problem: &str| {
            Err(SystemError::Config { field, value, problem: problem.into() })
        };
        // Octaves of the ambient network come without the point itself: none of them would leave it nothing to see.
        for (field, value, least, most) in [
            ("time_octaves", self.time_octaves, 0, 16),
            ("warp_octaves", self.warp_octaves, 0, 16),
            ("ambient_octaves", self.ambient_octaves, 1, 16),
            ("sees_octaves", self.sees_octaves, 0, 16),
            ("moment_dims", self.moment_dims, 1, 1024),
            ("warp_width", self.warp_width, 1, 1024),
            ("warp_depth", self.warp_depth, 1, 16),
            ("ambient", self.ambient, 0, 16),
            ("ambient_width", self.ambient_width, 1, 1024),
            ("ambient_depth", self.ambient_depth, 1, 16),
            ("plane_features", self.plane_features, 1, 32),
            ("plane_times", self.plane_times, 1, 1024),
            ("background_points", self.background_points, 0, 1 << 20),
        ] {
            if !(least..=most).contains(&value) {
                return bad(field, value.to_string(), &format!("must be in {least}..={most}"));
            }
        }
        if self.planes.len() > MAX_PLANES || !self.planes.iter().all(|cells| (1..=512).contains(cells)) {
            let problem = format!("must be at most {MAX_PLANES} numbers in 1..=512");
            return bad("planes", format!("{:?}", self.planes), &problem);
        }
        for (field, value, least) in [
            ("elastic", self.elastic, 0.0),
            ("elastic_scale", self.elastic_scale, 1e-6),
            ("background", self.background, 0.0),
            ("plane_tv", self.plane_tv, 0.0),
            ("plane_slow", self.plane_slow, 0.0),
        ] {
            if !(least..=1e3).contains(&value) {
                return bad(field, value.to_string(), &format!("must be in {least}..=1000"));
            }
        }
        if self.by_error && (self.curriculum > 0 || self.guided) {
            let problem = "rays are drawn in one way: set `by_error=false`, or `curriculum=0` and `guided=false`";
            return bad("by_error", "true".into(), problem);
        }
        self.cues.check()?;
        for (field, value) in [("warp_lr", self.warp_lr), ("moment_lr", self.moment_lr), ("plane_lr", self.plane_lr)] {
            if !(0.0..=100.0).contains(&value) {
                return bad(field, value.to_string(), "must be in 0..=100");
            }
        }
        Ok(())
    }
}

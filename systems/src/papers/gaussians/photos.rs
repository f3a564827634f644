//! What photos of one place differ in: appearance, and what stands before the scene; the parts of a cloud that know of it.

use super::depth_files::{has_depths, read_depths};
use super::leaving_out::{AskedOccluders, Judges};
use super::sky::{BeforeSky, SkyPlan, SkySettings};
use super::start::PhotosBefore;
use crate::cloud_appearance::{AppearanceChoice, CloudAppearance, Tone, ToneSettings};
use crate::cloud_maps::{FeatureMaps, MapSettings};
use crate::cloud_occluders::{
    CloudOccluders, ErrorMaskSettings, FeatureMaskSettings, HeadSettings, MaskSettings, StructureSettings,
    VisibilitySettings,
};
use crate::cloud_triplane::{Triplane, TriplaneSettings};
use crate::occluders::outliers::{Backdrop, Brightness};
use crate::occluders::photo_features::has_features;
use crate::plan::has_alpha;
use crate::settings::Settings;
use crate::views::{
    ColourAppearance, DepthShapeTerm, ExtraRows, PictureTerm, PlaceCodes, RenderJudge, RowStart, SamplePlaces,
    Structure, SurveyJudge, first_of, not_negative,
};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::SystemError;
use scene_io::Scene;
use serde::{Deserialize, Serialize};
use splat_core::Gaussians;

/// Numbers of a photo's code in a field before a cloud that has none.
const FIELD_CODES: usize = 32;

/// The parts, before a scene asks for anything.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhotoParts {
    pub(super) appearance: CloudAppearance,
    pub(super) tone: ToneSettings,
    pub(super) maps: MapSettings,
    pub(super) triplane: TriplaneSettings,
    /// Degree of the spherical harmonics where there is an appearance: each photo shows the cloud from one side, and colours that
    /// depend on the side could take the place of its tone.
    pub(super) sh_degree: usize,
    /// Which colours are to have the structure of the photos, where these have an appearance each.
    pub(super) structure: Structure,
    pub(super) occluders: CloudOccluders,
    pub(super) masks: MaskSettings,
    pub(super) judge: StructureSettings,
    pub(super) errors: ErrorMaskSettings,
    pub(super) features: FeatureMaskSettings,
    pub(super) visibility: VisibilitySettings,
    pub(super) head: HeadSettings,
    pub(super) sky: SkySettings,
    /// Depth is held to the shape of estimated depth; `None`: it is not, whatever files there are.
    pub(super) depth: Option<DepthSettings>,
}

/// Depth by files of other programs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DepthSettings {
    /// Weight of how unlike shapes of rendered depth are to those of depth files; without files there is no such term.
    pub(super) depth_weight: f32,
}

/// What is asked of the photos before settings are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen {
    /// Longest side, pixels.
    pub(super) longest: u32,
    /// Whether any has features, as a file.
    pub(super) features: bool,
    /// Whether any has depth or disparity, as a file.
    pub(super) depths: bool,
    /// Whether they show a thing that is cut out.
    pub(super) cut_out: bool,
}

impl Seen {
    pub(super) fn of(scene: &Scene, data: &Dataset) -> Result<Self, SystemError> {
        Ok(Self {
            longest: data.longest_side().unwrap_or(0),
            features: has_features(scene, data),
            depths: has_depths(data),
            cut_out: has_alpha(data)?,
        })
    }
}

impl PhotoParts {
    /// The settings of the parts that are there, after `--set`.
    pub(super) fn asked(&self, seen: Seen, settings: &mut Settings<'_>) -> Result<AskedPhotos, SystemError> {
        let AppearanceChoice { appearance } = settings.of(&AppearanceChoice { appearance: self.appearance })?;
        let appearance = match appearance {
            CloudAppearance::None => AskedAppearance::None,
            CloudAppearance::Codes => {
                let tone = settings.of(&self.tone)?;
                tone.check()?;
                AskedAppearance::Codes(tone)
            }
            CloudAppearance::Maps => {
                let maps = settings.of(&self.maps)?;
                maps.check()?;
                AskedAppearance::Maps(maps)
            }
            CloudAppearance::Triplane => {
                let triplane = settings.of(&self.triplane)?;
                triplane.check()?;
                AskedAppearance::Triplane(triplane)
            }
        };
        let occluders = AskedOccluders::of(self, seen, settings)?;
        let depth = match &self.depth {
            None => AskedDepth::Never,
            Some(depth) => AskedDepth::of(settings.of(depth)?, seen)?,
        };
        let sky = settings.of(&self.sky)?;
        sky.check()?;
        let (sh_degree, structure) = (self.sh_degree, self.structure);
        Ok(AskedPhotos { appearance, sh_degree, structure, occluders, depth, sky })
    }
}

/// Settings after `--set`.
pub(super) struct AskedPhotos {
    appearance: AskedAppearance,
    sh_degree: usize,
    structure: Structure,
    occluders: AskedOccluders,
    depth: AskedDepth,
    sky: SkySettings,
}

/// What depth is held to.
enum AskedDepth {
    /// Nothing, as no one asked.
    Never,
    /// Nothing, as there are no files.
    WithoutFiles,
    /// Shapes in files, with a weight.
    Files(f32),
}

impl AskedDepth {
    fn of(settings: DepthSettings, seen: Seen) -> Result<Self, SystemError> {
        let weight = settings.depth_weight;
        first_of([not_negative("depth_weight", weight.into())])?;
        Ok(match (weight > 0.0, seen.depths) {
            (false, _) => Self::Never,
            (true, false) => Self::WithoutFiles,
            (true, true) => Self::Files(weight),
        })
    }

    /// For people.
    fn line(&self) -> Option<String> {
        match self {
            Self::Never => None,
            Self::WithoutFiles => Some(
                "depth: no photo has a file of depths or disparities, so rendered depth is held to nothing".to_owned(),
            ),
            Self::Files(weight) => {
                Some(format!("depth: rendered depth is held to the shape of the photos' depth files, weight {weight}"))
            }
        }
    }
}

enum AskedAppearance {
    None,
    Codes(ToneSettings),
    Maps(MapSettings),
    Triplane(TriplaneSettings),
}

/// The parts of a cloud.
pub(super) struct PhotoKnowledge {
    rows: OwnRows,
    pub(super) structure: Structure,
    pub(super) appearance: Option<Box<dyn ColourAppearance>>,
    pub(super) judge: Option<Box<dyn RenderJudge>>,
    pub(super) surveys: Option<Box<dyn SurveyJudge>>,
    /// What a picture costs besides its colours.
    pub(super) terms: Vec<Box<dyn PictureTerm>>,
}

/// What each Gaussian has of its own, and its learning rate.
enum OwnRows {
    Nothing,
    Code(f64),
    /// A code, and where it looks in each of `maps` feature maps at the start.
    CodeAndPlaces {
        rate: f64,
        maps: usize,
        seed: u64,
    },
}

impl PhotoKnowledge {
    /// Extra rows of a cloud that begins so: a code for each Gaussian where there is an appearance, and where it looks in maps.
    pub(super) fn rows(&self, start: &Gaussians) -> ExtraRows {
        let codes = || PlaceCodes::of(start);
        let of = |rows, rate, start| ExtraRows { rows, composited: 0, rate, start };
        match self.rows {
            OwnRows::Nothing => ExtraRows::default(),
            OwnRows::Code(rate) => of(PlaceCodes::ROWS, rate, RowStart::Place(codes())),
            OwnRows::CodeAndPlaces { rate, maps, seed } => {
                let samples = SamplePlaces::of(start, maps, seed);
                let rows = PlaceCodes::ROWS + SamplePlaces::rows_of(maps);
                of(rows, rate, RowStart::PlaceAndSamples(codes(), samples))
            }
        }
    }
}

impl AskedPhotos {
    /// What a field before the cloud knows of its photos.
    pub(super) fn before(&self) -> PhotosBefore {
        let codes = match &self.appearance {
            AskedAppearance::None => None,
            AskedAppearance::Codes(tone) => Some(tone.appearance_dims),
            AskedAppearance::Maps(_) | AskedAppearance::Triplane(_) => Some(FIELD_CODES),
        };
        PhotosBefore { codes, masks: self.occluders.outliers().cloned() }
    }

    /// Degree of the spherical harmonics, where photos differ in appearance.
    pub(super) fn sh_degree(&self) -> Option<usize> {
        self.has_appearance().then_some(self.sh_degree)
    }

    fn has_appearance(&self) -> bool {
        !matches!(self.appearance, AskedAppearance::None)
    }

    /// What knows of the appearance, and the rows that it reads.
    fn appearance(
        &self,
        photos: usize,
        horizon: u64,
        seed: u64,
    ) -> Result<(OwnRows, Option<Box<dyn ColourAppearance>>), SystemError> {
        Ok(match self.appearance {
            AskedAppearance::None => (OwnRows::Nothing, None),
            AskedAppearance::Codes(tone) => {
                let part = Tone::new(tone, photos, horizon, seed)?;
                (OwnRows::Code(tone.place_code_lr), Some(Box::new(part)))
            }
            AskedAppearance::Maps(maps) => {
                let part = FeatureMaps::new(maps, photos, horizon, seed)?;
                let rows = OwnRows::CodeAndPlaces { rate: maps.place_code_lr, maps: maps.sampled_maps, seed };
                (rows, Some(Box::new(part)))
            }
            AskedAppearance::Triplane(triplane) => {
                let part = Triplane::new(triplane, photos, horizon, seed)?;
                (OwnRows::Code(triplane.place_code_lr), Some(Box::new(part)))
            }
        })
    }

    /// The parts, for a schedule of `horizon` steps.
    pub(super) fn parts(
        &self,
        scene: &Scene,
        data: &Dataset,
        background: Background,
        horizon: u64,
        seed: u64,
    ) -> Result<PhotoKnowledge, SystemError> {
        let brightness = if self.has_appearance() { Brightness::Each } else { Brightness::Same };
        let (rows, appearance) = self.appearance(data.len(), horizon, seed)?;
        let mut known = PhotoKnowledge {
            rows,
            structure: if self.has_appearance() { self.structure } else { Structure::Picture },
            appearance,
            judge: None,
            surveys: None,
            terms: Vec::new(),
        };
        if let AskedDepth::Files(weight) = self.depth {
            known.terms.push(Box::new(DepthShapeTerm::new(weight, read_depths(data)?)));
        }
        match self.occluders.judges(scene, data, Backdrop::new(background), brightness, horizon, seed)? {
            Judges::None => {}
            Judges::Steps(judge) => known.judge = Some(judge),
            Judges::Surveys(surveys) => known.surveys = Some(surveys),
        }
        Ok(known)
    }

    /// Whether the cloud begins with Gaussians of the sky.
    pub(super) fn sky(&self, scene: &BeforeSky<'_>) -> SkyPlan {
        self.sky.plan(scene)
    }

    /// For people.
    pub(super) fn lines(&self, horizon: u64) -> Vec<String> {
        let appearance = match &self.appearance {
            AskedAppearance::None => "appearance: one for all photos".to_owned(),
            AskedAppearance::Codes(tone) => {
                format!("appearance: a code of {} numbers for each photo, and for each Gaussian", tone.appearance_dims)
            }
            AskedAppearance::Maps(maps) => format!(
                "appearance: {} feature maps of {} pixels a side for each photo, and places in {} of them for each Gaussian",
                1 + maps.sampled_maps,
                maps.encoder_side / 2,
                maps.sampled_maps
            ),
            AskedAppearance::Triplane(TriplaneSettings { plane_from, plane_side, photo_dims, .. }) => {
                let planes = match *plane_from {
                    share if share < 1.0 => format!(
                        "from step {} of the cloud on it is projected back to three planes of {plane_side} cells a side",
                        (share * horizon as f64) as u64
                    ),
                    _ => "it is not projected back".to_owned(),
                };
                format!("appearance: {photo_dims} numbers for each photo as a whole; {planes}")
            }
        };
        [appearance, self.occluders.line(horizon)].into_iter().chain(self.depth.line()).collect()
    }
}

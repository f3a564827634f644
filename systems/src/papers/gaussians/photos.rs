//! What photos of one place differ in: appearance, and what stands before the scene; the parts of a cloud that know of it.

use crate::cloud_appearance::{AppearanceChoice, CloudAppearance, Tone, ToneSettings};
use crate::cloud_occluders::{
    CloudOccluders, MaskSettings, OccluderChoice, PhotoMasks, StructureJudge, StructureSettings,
};
use crate::occluders::outliers::{Backdrop, Brightness, OutlierConfig};
use crate::settings::Settings;
use crate::views::{ColourAppearance, ExtraRows, PlaceCodes, RenderJudge, RowStart, Structure, SurveyJudge};
use engine::data::Dataset;
use engine::options::Background;
use engine::system::SystemError;
use splat_core::Gaussians;

/// The parts, before a scene asks for anything.
#[derive(Clone, Copy, Debug)]
pub(super) struct PhotoParts {
    pub(super) appearance: CloudAppearance,
    pub(super) tone: ToneSettings,
    /// Degree of the spherical harmonics where there is an appearance: each photo shows the cloud from one side, and colours that
    /// depend on the side could take the place of its tone.
    pub(super) sh_degree: usize,
    /// Which colours are to have the structure of the photos, where these have an appearance each.
    pub(super) structure: Structure,
    pub(super) occluders: CloudOccluders,
    pub(super) masks: MaskSettings,
    pub(super) judge: StructureSettings,
}

impl PhotoParts {
    /// The settings of the parts that are there, after `--set`, of photos of a longest side.
    pub(super) fn asked(&self, longest: u32, settings: &mut Settings<'_>) -> Result<AskedPhotos, SystemError> {
        let AppearanceChoice { appearance } = settings.of(&AppearanceChoice { appearance: self.appearance })?;
        let tone = match appearance {
            CloudAppearance::None => None,
            CloudAppearance::Codes => Some(settings.of(&self.tone)?),
        };
        tone.map_or(Ok(()), |tone| tone.check())?;
        let OccluderChoice { occluders } = settings.of(&OccluderChoice { occluders: self.occluders })?;
        let occluders = match occluders {
            CloudOccluders::None => AskedOccluders::None,
            CloudOccluders::Photos => {
                let (masks, outliers) = (settings.of(&self.masks)?, settings.of(&OutlierConfig::of_photos(longest))?);
                masks.check()?;
                outliers.check()?;
                AskedOccluders::Photos(masks, outliers)
            }
            CloudOccluders::Residual => {
                let judge = settings.of(&self.judge)?;
                judge.check()?;
                AskedOccluders::Residual(judge)
            }
        };
        Ok(AskedPhotos { tone, sh_degree: self.sh_degree, structure: self.structure, occluders })
    }
}

/// Settings after `--set`.
pub(super) struct AskedPhotos {
    tone: Option<ToneSettings>,
    sh_degree: usize,
    structure: Structure,
    occluders: AskedOccluders,
}

enum AskedOccluders {
    None,
    Photos(MaskSettings, OutlierConfig),
    Residual(StructureSettings),
}

/// The parts of a cloud.
pub(super) struct PhotoKnowledge {
    place_code_lr: Option<f64>,
    pub(super) structure: Structure,
    pub(super) appearance: Option<Box<dyn ColourAppearance>>,
    pub(super) judge: Option<Box<dyn RenderJudge>>,
    pub(super) surveys: Option<Box<dyn SurveyJudge>>,
}

impl PhotoKnowledge {
    /// Extra rows of a cloud that begins so: a code for each Gaussian, where there is an appearance.
    pub(super) fn rows(&self, start: &Gaussians) -> ExtraRows {
        match self.place_code_lr {
            None => ExtraRows::default(),
            Some(rate) => {
                ExtraRows { rows: PlaceCodes::ROWS, composited: 0, rate, start: RowStart::Place(PlaceCodes::of(start)) }
            }
        }
    }
}

impl AskedPhotos {
    /// Numbers of a photo's code; `None` where all photos have the same appearance.
    pub(super) fn codes(&self) -> Option<usize> {
        self.tone.map(|tone| tone.appearance_dims)
    }

    /// Degree of the spherical harmonics, where photos differ in appearance.
    pub(super) fn sh_degree(&self) -> Option<usize> {
        self.tone.map(|_| self.sh_degree)
    }

    /// The parts, for a schedule of `horizon` steps.
    pub(super) fn parts(
        &self,
        data: &Dataset,
        background: Background,
        horizon: u64,
        seed: u64,
    ) -> Result<PhotoKnowledge, SystemError> {
        let brightness = if self.tone.is_some() { Brightness::Each } else { Brightness::Same };
        let tone = self.tone.map(|tone| Tone::new(tone, data.len(), horizon, seed)).transpose()?;
        let mut known = PhotoKnowledge {
            place_code_lr: self.tone.map(|tone| tone.place_code_lr),
            structure: if tone.is_some() { self.structure } else { Structure::Picture },
            appearance: tone.map(|tone| Box::new(tone) as Box<dyn ColourAppearance>),
            judge: None,
            surveys: None,
        };
        match &self.occluders {
            AskedOccluders::None => {}
            AskedOccluders::Photos(masks, outliers) => {
                let backdrop = Backdrop::new(background);
                known.surveys = Some(Box::new(PhotoMasks::new(*masks, outliers.clone(), backdrop, brightness, data)));
            }
            AskedOccluders::Residual(settings) => {
                known.judge = Some(Box::new(StructureJudge::new(*settings, horizon)));
            }
        }
        Ok(known)
    }

    /// For people.
    pub(super) fn lines(&self, horizon: u64) -> Vec<String> {
        let appearance = match &self.tone {
            None => "appearance: one for all photos".to_owned(),
            Some(tone) => {
                format!("appearance: a code of {} numbers for each photo, and for each Gaussian", tone.appearance_dims)
            }
        };
        let occluders = match &self.occluders {
            AskedOccluders::None => "occluders: none are left out".to_owned(),
            AskedOccluders::Photos(masks, _) => format!(
                "occluders: masks, found by comparing all photos with their renders after {} steps of the cloud, and after twice as many, and so on",
                masks.judge_first
            ),
            AskedOccluders::Residual(judge) => format!(
                "occluders: from step {} of the cloud on, what has not the structure of its photo is left out",
                (judge.judge_from * horizon as f64) as u64
            ),
        };
        vec![appearance, occluders]
    }
}

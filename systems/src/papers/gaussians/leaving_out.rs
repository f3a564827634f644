//! What stands before the scene in photos: which kind of knowledge leaves it out of a cloud.

use super::photos::{PhotoParts, Seen};
use crate::cloud_occluders::{
    CloudOccluders, ErrorJudge, ErrorMaskSettings, FeatureMaskSettings, HeadSettings, MaskSettings, OccluderChoice,
    PhotoFeatures, PhotoMasks, StructureJudge, StructureSettings, VisibilityHead, VisibilityJudge, VisibilitySettings,
};
use crate::limits::refuse;
use crate::occluders::outliers::{Backdrop, Brightness, OutlierConfig};
use crate::occluders::photo_features::{AskedBy, read_features};
use crate::settings::Settings;
use crate::views::{RenderJudge, SurveyJudge};
use engine::data::Dataset;
use engine::system::SystemError;
use scene_io::{Features, Scene};
use std::sync::Arc;

/// Who asks for features.
const BY_FEATURES: AskedBy = AskedBy { field: "occluders", value: "features", without: "occluders=errors" };

/// The kind and its settings, after `--set`.
pub(super) enum AskedOccluders {
    None,
    Photos(MaskSettings, OutlierConfig),
    Residual(StructureSettings),
    Errors(ErrorMaskSettings),
    Features(FeatureMaskSettings),
    Visibility(VisibilitySettings),
    Head(VisibilitySettings, HeadSettings),
}

/// What says which pixels count.
pub(super) enum Judges {
    None,
    /// In each step.
    Steps(Box<dyn RenderJudge>),
    /// From time to time.
    Surveys(Box<dyn SurveyJudge>),
}

impl AskedOccluders {
    pub(super) fn of(parts: &PhotoParts, seen: Seen, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let OccluderChoice { occluders } = settings.of(&OccluderChoice { occluders: parts.occluders })?;
        Ok(match occluders {
            CloudOccluders::None => Self::None,
            CloudOccluders::Photos => {
                let (masks, outliers) =
                    (settings.of(&parts.masks)?, settings.of(&OutlierConfig::of_photos(seen.longest))?);
                masks.check()?;
                outliers.check()?;
                Self::Photos(masks, outliers)
            }
            CloudOccluders::Residual => {
                let judge = settings.of(&parts.judge)?;
                judge.check()?;
                Self::Residual(judge)
            }
            CloudOccluders::Visibility => {
                let judge = settings.of(&parts.visibility)?;
                judge.check()?;
                Self::Visibility(judge)
            }
            CloudOccluders::Head => {
                let (judge, head) = (settings.of(&parts.visibility)?, settings.of(&parts.head)?);
                judge.check()?;
                head.check()?;
                Self::Head(judge, head)
            }
            CloudOccluders::Features => Self::by_features(parts, settings)?,
            CloudOccluders::Auto if seen.features => Self::by_features(parts, settings)?,
            CloudOccluders::Errors | CloudOccluders::Auto => {
                let errors = settings.of(&parts.errors)?;
                errors.check()?;
                Self::Errors(errors)
            }
        })
    }

    fn by_features(parts: &PhotoParts, settings: &mut Settings<'_>) -> Result<Self, SystemError> {
        let features = settings.of(&parts.features)?;
        features.check()?;
        Ok(Self::Features(features))
    }

    /// How masks of whole photos are found, where that leaves things out.
    pub(super) fn outliers(&self) -> Option<&OutlierConfig> {
        match self {
            Self::Photos(_, outliers) => Some(outliers),
            _ => None,
        }
    }

    /// What says which pixels count, for a schedule of `horizon` steps.
    pub(super) fn judges(
        &self,
        scene: &Scene,
        data: &Dataset,
        backdrop: Backdrop,
        brightness: Brightness,
        horizon: u64,
        seed: u64,
    ) -> Result<Judges, SystemError> {
        let judge: Box<dyn RenderJudge> = match self {
            Self::None => return Ok(Judges::None),
            Self::Photos(masks, outliers) => {
                let masks = PhotoMasks::new(*masks, outliers.clone(), backdrop, brightness, data);
                return Ok(Judges::Surveys(Box::new(masks)));
            }
            Self::Residual(settings) => Box::new(StructureJudge::new(*settings, horizon)),
            Self::Visibility(settings) => Box::new(VisibilityJudge::new(*settings, horizon)),
            Self::Head(settings, head) => Box::new(VisibilityHead::new(*settings, *head, horizon, seed)?),
            Self::Errors(settings) => Box::new(ErrorJudge::of_errors(*settings, horizon, seed)),
            Self::Features(settings) => {
                let features = PhotoFeatures::new(features_of(scene, data)?, data);
                Box::new(ErrorJudge::of_features(*settings, features, horizon, seed))
            }
        };
        Ok(Judges::Steps(judge))
    }

    /// For people.
    pub(super) fn line(&self, horizon: u64) -> String {
        match self {
            Self::None => "occluders: none are left out".to_owned(),
            Self::Photos(masks, _) => format!(
                "occluders: masks, found by comparing all photos with their renders after {} steps of the cloud, after twice as many, and so on, \
                 and every {} steps",
                masks.judge_first, masks.judge_every
            ),
            Self::Residual(judge) => format!(
                "occluders: from step {} of the cloud on, what has not the structure of its photo is left out",
                (judge.judge_from * horizon as f64) as u64
            ),
            Self::Errors(errors) => format!(
                "occluders: in each photo pixels with errors above those of {:.0} % of the last photos' pixels are left out \
                 (RobustFilter; with `.features.npy` beside the photos a network could say more)",
                100.0 * errors.inlier_share
            ),
            Self::Features(_) => {
                "occluders: a network says by features of the photos what is left out (SLS-mlp)".to_owned()
            }
            Self::Visibility(judge) => format!(
                "occluders: from step {} of the cloud on, pixels count less the more their colour is off",
                (judge.judge_from * horizon as f64) as u64
            ),
            Self::Head(judge, _) => format!(
                "occluders: from step {} of the cloud on, pixels count as a network says of their photo, which learns where colours are off",
                (judge.judge_from * horizon as f64) as u64
            ),
        }
    }
}

/// The features of all photos.
fn features_of(scene: &Scene, data: &Dataset) -> Result<Vec<Arc<Features>>, SystemError> {
    let features = read_features(scene, data, BY_FEATURES)?;
    if features.is_empty() {
        let photo = data.views().first().map_or("", |view| &view.name);
        let problem = format!(
            "photo `{photo}` has no `.features.npy` beside it, nor has any other: make them, or go without (`--set {}`)",
            BY_FEATURES.without
        );
        return refuse(BY_FEATURES.field, BY_FEATURES.value, problem);
    }
    Ok(features)
}

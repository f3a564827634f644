//! How the part of a paper is planned: first its settings, then, once all names of `--set` are known, the part itself.

use super::choice::{AppearanceKind, Choice, FieldKind};
use crate::appearance::AppearanceModel;
use crate::occluders::OccluderModel;
use crate::occluders::outliers::{Backdrop, Brightness};
use crate::settings::Settings;
use engine::data::Dataset;
use engine::options::RunOptions;
use engine::system::SystemError;
use scene_io::Scene;

/// Builds a part whose settings are known.
pub(super) type Build<'a, M> = Box<dyn FnOnce() -> Result<Box<M>, SystemError> + 'a>;

/// Plans a part: takes its settings from [`Planning::settings`], checks them and gives what builds it.
pub(super) type Plan<M> = for<'a> fn(&mut Planning<'a>) -> Result<Build<'a, M>, SystemError>;

/// Plans an appearance model.
pub(super) type AppearancePlan = Plan<dyn AppearanceModel>;
/// Plans an occluder model.
pub(super) type OccluderPlan = Plan<dyn OccluderModel>;

/// What parts are planned from, and what they ask for.
pub(super) struct Planning<'a> {
    pub(super) choice: Choice,
    pub(super) scene: &'a Scene,
    pub(super) data: &'a Dataset,
    pub(super) run: &'a RunOptions,
    pub(super) backdrop: Backdrop,
    /// Settings of the parts so far.
    pub(super) settings: Settings<'a>,
    /// Lines of the plan.
    pub(super) lines: Vec<String>,
    pub(super) of_field: OfField,
}

/// What an occluder model asks of the field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct OfField {
    /// Factor of the prior on densities.
    pub(super) sparsity: f32,
    /// Rays have samples of a transient part besides.
    pub(super) transient: bool,
}

impl<'a> Planning<'a> {
    /// Of these parts, with no settings yet.
    pub(super) fn new(
        choice: Choice,
        scene: &'a Scene,
        data: &'a Dataset,
        run: &'a RunOptions,
        backdrop: Backdrop,
    ) -> Self {
        let (settings, of_field) = (Settings::new(run), OfField::default());
        Self { choice, scene, data, run, backdrop, settings, lines: Vec::new(), of_field }
    }

    /// `mlp` on the published networks, `ngp` on the hash grid.
    pub(super) fn by_field<T>(&self, ngp: T, mlp: T) -> T {
        match self.choice.field {
            FieldKind::Ngp => ngp,
            FieldKind::Mlp => mlp,
        }
    }

    /// Whether a setting was given with `--set`.
    pub(super) fn is_set(&self, name: &str) -> bool {
        self.run.set.contains_key(name)
    }

    /// Whether photos differ in brightness: there is a model of that.
    pub(super) fn brightness(&self) -> Brightness {
        match self.choice.appearance {
            AppearanceKind::None => Brightness::Same,
            AppearanceKind::Codes | AppearanceKind::Encoder => Brightness::Each,
        }
    }
}

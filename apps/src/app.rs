//! What one app is and another is not. Commands and words are shared.

use engine::RunError;
use engine::data::Dataset;
use engine::options::{DataOptions, Plan, RunOptions};
use engine::run::DefaultSystem;
use engine::system::{System, SystemError};
use scene_io::Scene;
use systems::claims::Claim;

/// Makes a system for a scene and says what it decided.
pub(crate) type BuildFn = fn(&str, &Scene, &Dataset, &RunOptions) -> Result<(Box<dyn System>, Plan), SystemError>;

/// Reads a scene by its word or path.
pub(crate) type LoadFn = fn(&str, &DataOptions) -> Result<Scene, RunError>;

/// An app.
pub(crate) struct App {
    /// Name of the program.
    pub(crate) name: &'static str,
    /// What it does, for `--help`.
    pub(crate) about: &'static str,
    /// Its systems, and what each does otherwise than the paper it is named after.
    pub(crate) claims: &'static [Claim],
    /// System taken when none is named.
    pub(crate) default_system: DefaultSystem<'static>,
    /// Reads scenes.
    pub(crate) load: LoadFn,
    /// Makes systems.
    pub(crate) build: BuildFn,
    /// Embedded scene of the demo.
    pub(crate) demo_scene: &'static str,
    /// System of the demo, where it is not the default.
    pub(crate) demo_system: Option<&'static str>,
    /// Where the demo goes.
    pub(crate) demo_folder: &'static str,
    /// Training steps of the demo: about a minute on two cores.
    pub(crate) demo_steps: u64,
    /// Whether photos have lights of their own and passers-by in them: words for these are understood.
    pub(crate) is_wild: bool,
    /// Whether the scene moves: words for time are understood.
    pub(crate) is_dynamic: bool,
}

impl App {
    /// Whether the scene stands still and shows nothing else: a system is chosen by what the scene is for.
    pub(crate) fn is_static(&self) -> bool {
        !self.is_wild && !self.is_dynamic
    }
}

/// `nerf-static`.
pub(crate) static STATIC: App = App {
    name: "nerf-static",
    about: "Radiance fields of static scenes, reconstructed on the CPU",
    claims: &systems::registry::CLAIMS,
    default_system: DefaultSystem::Chosen(systems::registry::choose),
    load: engine::source::load,
    build: systems::registry::build,
    demo_scene: "synthetic:tabletop",
    demo_system: Some("ngp"),
    demo_folder: "runs/demo",
    demo_steps: 1000,
    is_wild: false,
    is_dynamic: false,
};

/// `nerf-dynamic`.
pub(crate) static DYNAMIC: App = App {
    name: "nerf-dynamic",
    about: "Radiance fields of scenes that move: a video in, any viewpoint at any time out",
    claims: &systems::dynamic::CLAIMS,
    default_system: DefaultSystem::Named("d-nerf"),
    load: systems::dynamic::load,
    build: systems::dynamic::build,
    demo_scene: "synthetic:orbit",
    demo_system: None,
    demo_folder: "runs/demo-dynamic",
    demo_steps: 1000,
    is_wild: false,
    is_dynamic: true,
};

/// `nerf-wild`.
pub(crate) static WILD: App = App {
    name: "nerf-wild",
    about: "Radiance fields from photos of many people: the place, without the passers-by, in any photo's light",
    claims: &systems::wild::CLAIMS,
    default_system: DefaultSystem::Named("auto"),
    load: engine::source::load,
    build: systems::wild::build,
    demo_scene: "synthetic:plaza",
    demo_system: None,
    demo_folder: "runs/demo-wild",
    demo_steps: 1000,
    is_wild: true,
    is_dynamic: false,
};

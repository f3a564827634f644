//! What one app is and another is not. Commands and words are shared.

use engine::RunError;
use engine::options::DataOptions;
use engine::run::DefaultSystem;
use scene_io::Scene;
use systems::registry::Family;

/// Reads a scene by its word or path.
pub(crate) type LoadFn = fn(&str, &DataOptions) -> Result<Scene, RunError>;

/// An app.
pub(crate) struct App {
    /// Name of the program.
    pub(crate) name: &'static str,
    /// What it does, for `--help`.
    pub(crate) about: &'static str,
    /// What it is made for: it lists the systems of this family, has the words for them, and takes every system that fits.
    pub(crate) family: Family,
    /// System taken when none is named.
    pub(crate) default_system: DefaultSystem<'static>,
    /// Reads scenes.
    pub(crate) load: LoadFn,
    /// Embedded scene of the demo.
    pub(crate) demo_scene: &'static str,
    /// System of the demo, where it is not the default.
    pub(crate) demo_system: Option<&'static str>,
    /// Where the demo goes.
    pub(crate) demo_folder: &'static str,
    /// Training steps of the demo: about a minute on two cores.
    pub(crate) demo_steps: u64,
}

/// `nerf-static`.
pub(crate) static STATIC: App = App {
    name: "nerf-static",
    about: "Radiance fields of static scenes, reconstructed on the CPU",
    family: Family::Static,
    default_system: DefaultSystem::Chosen(systems::registry::choose),
    load: engine::source::load,
    demo_scene: "synthetic:tabletop",
    demo_system: Some("ngp"),
    demo_folder: "runs/demo",
    demo_steps: 1000,
};

/// `nerf-dynamic`.
pub(crate) static DYNAMIC: App = App {
    name: "nerf-dynamic",
    about: "Radiance fields of scenes that move: a video in, any viewpoint at any time out",
    family: Family::Moving,
    default_system: DefaultSystem::Chosen(systems::registry::choose_moving),
    load: engine::source::load_in_order,
    demo_scene: "synthetic:orbit",
    demo_system: None,
    demo_folder: "runs/demo-dynamic",
    demo_steps: 4000,
};

/// `nerf-wild`.
pub(crate) static WILD: App = App {
    name: "nerf-wild",
    about: "Radiance fields from photos of many people: the place without occluders, in any photo's appearance",
    family: Family::Wild,
    default_system: DefaultSystem::Chosen(systems::registry::choose_wild),
    load: engine::source::load,
    demo_scene: "synthetic:plaza",
    demo_system: None,
    demo_folder: "runs/demo-wild",
    demo_steps: 1000,
};

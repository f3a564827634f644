//! The systems by name: for each the paper and what differs from it, the scenes that it is for, what it needs from a scene, and how
//! it is built. Every app takes every system that fits the scene.

mod choice;
#[cfg(test)]
mod claim_tests;
mod known;
mod moving_choice;
mod part_words;
#[cfg(test)]
mod tests;
mod wild_choice;

pub use choice::choose;
pub use moving_choice::choose_moving;
pub use part_words::PartWords;
pub use wild_choice::choose_wild;

use crate::claims::Claim;
use crate::plan::{Ask, Built, Shown};
use engine::data::Dataset;
use engine::options::{Plan, RunOptions};
use engine::system::{System, SystemError};
use scene_io::Scene;

/// What kind of scene a system is made for: the app that lists it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Scenes that stand still (`nerf-static`).
    Static,
    /// Photos with occluders, or of different appearance (`nerf-wild`).
    Wild,
    /// Scenes that move (`nerf-dynamic`).
    Moving,
}

/// What a system needs from a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// Photos with cameras.
    Photos,
    /// Photos with times.
    Times,
}

/// Builds a system.
type Build = fn(Ask<'_>) -> Built;

/// A system.
#[derive(Clone, Copy)]
pub struct Entry {
    /// Its name, its paper and what differs from it.
    pub claim: Claim,
    /// The same on the published networks (`field=mlp`), where that differs in more than the field.
    pub on_networks: Option<Claim>,
    /// What it is made for.
    pub families: &'static [Family],
    /// What it needs.
    pub needs: Needs,
    build: Build,
}

/// All systems.
#[must_use]
pub fn entries() -> &'static [Entry] {
    known::ENTRIES
}

/// The systems that are made for a kind of scene.
pub fn family(family: Family) -> impl Iterator<Item = &'static Entry> {
    entries().iter().filter(move |entry| entry.families.contains(&family))
}

/// The names of the systems that are made for a kind of scene.
#[must_use]
pub fn names(of: Family) -> Vec<&'static str> {
    family(of).map(|entry| entry.claim.name).collect()
}

/// The system of a name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Entry> {
    entries().iter().find(|entry| entry.claim.name == name)
}

/// Build the system `name` for a scene.
///
/// # Errors
/// [`SystemError::Config`] for an unknown name, a system that needs what the photos do not show, an unknown setting or one that
/// cannot work; [`SystemError::Scene`] when an image cannot be read, or photos are such that a part cannot work with them.
pub fn build(
    name: &str,
    scene: &Scene,
    data: &Dataset,
    run: &RunOptions,
) -> Result<(Box<dyn System>, Plan), SystemError> {
    let entry = find(name).ok_or_else(|| no_such_system(name))?;
    entry.check(scene)?;
    (entry.build)(Ask::new(entry.claim, scene, data, run))
}

impl Entry {
    /// How far it is the paper's, and how far the same is on the published networks where that is another matter.
    pub fn claims(&self) -> impl Iterator<Item = Claim> {
        [Some(self.claim), self.on_networks].into_iter().flatten()
    }

    /// How far it is the paper's with these settings.
    #[must_use]
    pub fn claim_with(&self, set: &toml::Table) -> Claim {
        let on_networks = set.get("field").and_then(toml::Value::as_str) == Some("mlp");
        self.on_networks.filter(|_| on_networks).unwrap_or(self.claim)
    }

    /// Refuse a scene that lacks what the system needs.
    fn check(&self, scene: &Scene) -> Result<(), SystemError> {
        if self.needs == Needs::Photos || Shown::of(scene) == Shown::Times {
            return Ok(());
        }
        let problem =
            "is for scenes that move, and no photo has a time; `nerf-dynamic` takes the order of the photos for it";
        Err(SystemError::Config { field: "system", value: self.claim.name.into(), problem: problem.into() })
    }
}

/// No system has this name; the names that there are.
fn no_such_system(name: &str) -> SystemError {
    let names: Vec<&str> = entries().iter().map(|entry| entry.claim.name).collect();
    let problem = format!("there is no such system; use one of {}", names.join(", "));
    SystemError::Config { field: "system", value: name.into(), problem }
}

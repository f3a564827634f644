//! What is known of a scene before any system is chosen, and systems built on it.

use super::backdrop::Backdrop;
use super::parallax::check_parallax;
use crate::layout::{Layout, layout};
use crate::photo_model::PhotoModel;
use crate::rays::{RayConfig, RaySystem};
use crate::space::{Space, SpaceConfig, SpaceKind};
use crate::warps::Deform;
use engine::data::Dataset;
use engine::options::{Background, RunOptions};
use engine::system::SystemError;
use float_core::Simd;
use scene_io::Scene;

/// Error of a pixel from skipped work in evaluation renders, where nothing else is said.
const EVALUATION_BUDGET: f32 = 1.0 / 2048.0;

/// What a system for a scene that moves has besides its field.
#[derive(Default)]
pub(crate) struct MovingParts {
    /// What photos differ in; `None`: they show the scene as it is.
    pub(crate) photo_model: Option<Box<dyn PhotoModel>>,
    /// What moves points, and what density sees of the time; `None`: nothing depends on it.
    pub(crate) deform: Option<Deform>,
}

/// What is known of a scene before any system is chosen.
pub(crate) struct Ground {
    pub(crate) layout: Layout,
    /// What was decided, and why.
    pub(crate) lines: Vec<String>,
    pub(crate) background: Background,
    /// The photos have alpha.
    pub(crate) transparent: bool,
    pub(crate) error_budget: f32,
}

impl Ground {
    /// Of a scene that stands still.
    pub(crate) fn of(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        check_parallax(data, run)?;
        Self::without_space(scene, data, run, backdrop(data, run)?).map(Self::say_space)
    }

    /// Of a scene that moves: no photo stands for the others.
    pub(crate) fn of_times(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        check_parallax(data, run)?;
        Self::with_depth(scene, data, run)
    }

    /// The same where depth is known otherwise than by parallax.
    pub(crate) fn with_depth(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        Self::without_space(scene, data, run, None).map(Self::say_space)
    }

    fn say_space(mut self) -> Self {
        self.lines.insert(0, format!("space: {} ({})", self.layout.kind.name(), self.layout.why));
        self
    }

    /// [`of`](Self::of) for systems that fill no space.
    pub(crate) fn of_clouds(scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Self, SystemError> {
        check_parallax(data, run)?;
        Self::without_space(scene, data, run, backdrop(data, run)?)
    }

    /// Before white where the photos have alpha and nothing else was asked for: as most systems were published.
    pub(crate) fn prefer_white(&mut self, run: &RunOptions) {
        if !self.transparent || run.background.is_some() {
            return;
        }
        self.background = Background::White;
        for line in self.lines.iter_mut().filter(|line| line.starts_with("background: ")) {
            *line = "background: white (as published; the images have alpha)".into();
        }
    }

    fn without_space(
        scene: &Scene,
        data: &Dataset,
        run: &RunOptions,
        backdrop: Option<Backdrop>,
    ) -> Result<Self, SystemError> {
        let layout = layout(scene, data);
        let mut lines = Vec::new();
        let transparent = has_alpha(data)?;
        let background = run.background.or(backdrop.as_ref().map(|b| b.background)).unwrap_or(Background::Random);
        lines.push(match (run.background, transparent, backdrop) {
            (Some(b @ (Background::White | Background::Black)), true, _) => format!(
                "background: {0} (asked for; {0} fog cannot be told from it: with `--background random` it could)",
                b.name()
            ),
            (Some(b), ..) => format!("background: {} (asked for)", b.name()),
            (None, true, _) => "background: random (the images have alpha: empty space cannot hide as a colour)".into(),
            (None, false, Some(backdrop)) => backdrop.line,
            (None, false, None) => {
                "background: random (the images have no alpha: every ray must end on something)".into()
            }
        });
        let error_budget = run.error_budget.unwrap_or(EVALUATION_BUDGET);
        Ok(Self { layout, lines, background, transparent, error_budget })
    }

    /// A system of rays for a scene at rest, under the method's name; without a method it is `ngp`.
    pub(crate) fn ngp(
        &mut self,
        data: &Dataset,
        config: &RayConfig,
        seed: u64,
        method: Option<Box<dyn PhotoModel>>,
    ) -> Result<RaySystem, SystemError> {
        let name = method.as_ref().map_or("ngp", |method| method.name());
        let space = self.space_of(config, data)?;
        let system = RaySystem::new(config.clone(), space, self.background, seed, name, method, None)?;
        self.carved(system, data)
    }

    /// A plain field of a scene that moves, for a short training: the cameras rule nothing out, as what moves is elsewhere in other
    /// photos.
    pub(crate) fn plain(&self, data: &Dataset, config: &RayConfig, seed: u64) -> Result<RaySystem, SystemError> {
        let space = self.space_of(config, data)?;
        RaySystem::new(config.clone(), space, self.background, seed, "ngp", None, None)
    }

    /// A system of rays under a system's name, of a scene that moves or of one at rest.
    pub(crate) fn moving(
        &mut self,
        data: &Dataset,
        config: &RayConfig,
        seed: u64,
        scene: &Scene,
        name: &'static str,
        MovingParts { photo_model, mut deform }: MovingParts,
    ) -> Result<RaySystem, SystemError> {
        let space = self.space_of(config, data)?;
        if let Some(deform) = &mut deform {
            let inside: Vec<[f32; 3]> = scene.points.iter().filter_map(|p| space.internal_point(p.xyz)).collect();
            let p: Vec<f32> = (0..3).flat_map(|a| inside.iter().map(move |p| p[a])).collect();
            let mut x = vec![0.0; p.len()];
            space.grid_positions(Simd::best(), &p, &mut x);
            deform.set_background(x);
        }
        let system = RaySystem::new(config.clone(), space, self.background, seed, name, photo_model, deform)?;
        self.carved(system, data)
    }

    fn space_of(&self, config: &RayConfig, data: &Dataset) -> Result<Space, SystemError> {
        config.check()?;
        let SpaceConfig { space: kind, centre, radius, near, .. } = config.space;
        space(&self.layout, data, kind, centre, radius, config.space.extent(), near)
    }

    /// The same with what the cameras rule out.
    fn carved(&mut self, mut system: RaySystem, data: &Dataset) -> Result<RaySystem, SystemError> {
        system.carve(data)?;
        let alpha = self.transparent && !system.may_move();
        self.lines.extend(system.carved().map(|carved| {
            format!(
                "empty space: {} of the occupancy grid's cells are ruled out by the cameras{}",
                percent(carved),
                if alpha { " and the images' alpha" } else { "" }
            )
        }));
        Ok(system)
    }
}

pub(crate) fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Whether a training image has transparent pixels to speak of.
pub(crate) fn has_alpha(data: &Dataset) -> Result<bool, SystemError> {
    Ok(!data.is_empty() && data.image(0)?.channels == 4)
}

pub(crate) fn space(
    layout: &Layout,
    data: &Dataset,
    kind: SpaceKind,
    centre: [f64; 3],
    radius: f64,
    extent: f64,
    near: f32,
) -> Result<Space, SystemError> {
    let (centre, near) = (centre.into(), f64::from(near));
    match (kind, layout.reference) {
        (SpaceKind::Box, _) => Ok(Space::boxed(centre, radius, near)),
        (SpaceKind::Contracted, _) => Ok(Space::contracted(centre, radius, extent, near)),
        (SpaceKind::Ndc, Some((pose, near))) => {
            let cameras: Vec<_> = data.views().iter().map(|v| v.camera).collect();
            Space::ndc(pose, near, &cameras).ok_or_else(not_forward)
        }
        (SpaceKind::Ndc, None) => Err(not_forward()),
    }
}

/// The photos' backdrop, where nothing was said about the background.
fn backdrop(data: &Dataset, run: &RunOptions) -> Result<Option<Backdrop>, SystemError> {
    if run.background.is_some() { Ok(None) } else { super::backdrop::backdrop(data) }
}

fn not_forward() -> SystemError {
    SystemError::Config {
        field: "space",
        value: "ndc".into(),
        problem: "the cameras do not all look the same way; use `contracted` or `box`".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::made::{frames, scene};
    use super::*;

    #[test]
    fn who_asks_for_one_colour_behind_photos_with_alpha_is_told_what_it_hides() {
        for (channels, background, told) in [
            (4, Some(Background::White), true),
            (4, Some(Background::Black), true),
            (4, Some(Background::Random), false),
            (4, None, false),
            (3, Some(Background::White), false),
        ] {
            let (scene, data) = scene(frames(channels, |_, _, _| [90, 90, 90, 255]), Vec::new());
            let run = RunOptions { seed: 0, background, error_budget: None, stop: None, set: Default::default() };
            let lines = Ground::of(&scene, &data, &run).unwrap().lines;
            let line = lines.iter().find(|line| line.starts_with("background: ")).unwrap();
            assert_eq!(line.contains("fog"), told, "{channels} {background:?}: {line}");
        }
    }
}

//! Field or cloud? Which system is taken where none is named, from what is known before training.
//!
//! The rule and the figures that it was chosen by: `docs/decisions/0028-field-or-cloud.md`.

use crate::papers::gaussians::splat;
use crate::plan::{CloudPace, backdrop, field_names, has_alpha, percent};
use engine::data::{Dataset, View};
use engine::options::{Choice, Purpose, RunOptions};
use engine::system::SystemError;
use engine::train::Stop;
use scene_io::Scene;

/// The two that are chosen between.
const FIELD: &str = "ngp";
const CLOUD: &str = "splat";

/// Why geometry is a field's.
pub(super) const OF_GEOMETRY: &str = "for geometry: a cloud of Gaussians has no density";

/// Why photos at several scales are.
pub(super) const OF_SCALES: &str = "photos at several scales";

/// Points cover the pictures from this share of their parts on.
const COVERED: f64 = 0.5;
/// Parts along the longest side of a picture.
const PARTS: u32 = 8;
/// An object's photos are large enough for a cloud from this longest side on, pixels.
const OBJECT_SIDE: u32 = 200;
/// So many steps a cloud takes to be the better one: of an object, and of a scene that begins at points.
const OBJECT_STEPS: f64 = 1500.0;
const STEPS: f64 = 300.0;
/// The same where a field comes first, in photos in which things stand before the scene.
const STEPS_AFTER_FIELD: f64 = 1000.0;

/// Field or cloud, and why.
pub(super) struct Verdict {
    pub(super) cloud: bool,
    pub(super) why: String,
}

impl Verdict {
    fn field(why: impl Into<String>) -> Self {
        Self { cloud: false, why: why.into() }
    }

    fn cloud(why: impl Into<String>) -> Self {
        Self { cloud: true, why: why.into() }
    }
}

/// What is known of a capture before training.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Facts {
    /// Points of the dataset.
    points: usize,
    /// Share of the pictures' parts in which a point is seen.
    covered: f64,
    /// Photos show where nothing is: alpha, or one plain colour all around.
    cut_out: bool,
    longest_side: u32,
    /// Steps of a cloud before the training stops, roughly.
    steps: f64,
}

impl Facts {
    pub(super) fn of(scene: &Scene, data: &Dataset, stop: Option<Stop>) -> Result<Self, SystemError> {
        Ok(Self {
            points: scene.points.len(),
            covered: coverage(data.views()),
            cut_out: has_alpha(data)? || backdrop(data)?.is_some(),
            longest_side: data.longest_side().unwrap_or(0),
            steps: CloudPace::of(data)?.steps(stop).unwrap_or(f64::INFINITY),
        })
    }

    /// Field or cloud, for pictures of a scene that photos show as it is.
    fn verdict(&self) -> Verdict {
        if self.cut_out {
            return self.of_object();
        }
        let share = percent(self.covered);
        let points = self.points;
        if points == 0 {
            return Verdict::field("no points for a cloud to begin at");
        }
        if self.covered < COVERED {
            let least = percent(COVERED);
            return Verdict::field(format!(
                "{points} points are in {share} of the pictures' parts, a cloud takes {least}"
            ));
        }
        self.with_steps(STEPS, &format!("{points} points are in {share} of the pictures' parts"))
    }

    /// The same where things stand before the scene in some photos: a cloud begins where a long training of a field sees surfaces, with
    /// points or without.
    pub(super) fn behind_others(&self) -> Verdict {
        if self.cut_out { self.of_object() } else { self.with_steps(STEPS_AFTER_FIELD, "photos show a place") }
    }

    /// Of photos that show what is empty.
    fn of_object(&self) -> Verdict {
        match self.longest_side {
            size @ ..OBJECT_SIDE => Verdict::field(format!("photos of {size} pixels, a cloud takes {OBJECT_SIDE}")),
            size => self.with_steps(OBJECT_STEPS, &format!("photos of {size} pixels show what is empty")),
        }
    }

    /// A cloud, where there are so many steps of it.
    fn with_steps(&self, least: f64, why: &str) -> Verdict {
        let steps = self.steps;
        if steps < least {
            return Verdict::field(format!(
                "a cloud would do about {steps:.0} steps before the stop, it takes {least:.0}"
            ));
        }
        Verdict::cloud(why)
    }

    /// The system, and why.
    fn choose(&self, purpose: Purpose) -> Choice {
        if purpose == Purpose::Geometry {
            return Choice::new(FIELD, OF_GEOMETRY);
        }
        let Verdict { cloud, why } = self.verdict();
        Choice::new(if cloud { CLOUD } else { FIELD }, why)
    }
}

/// Share of the parts of all pictures in which a point is seen, each picture divided into squares.
fn coverage(views: &[View]) -> f64 {
    let (mut held, mut all) = (0, 0);
    for view in views.iter().filter(|v| v.level == 0) {
        let (w, h) = (view.camera.width, view.camera.height);
        let side = f64::from(w.max(h).div_ceil(PARTS).max(1));
        let [columns, rows] = [w, h].map(|n| (f64::from(n) / side).ceil() as usize);
        let mut parts = vec![false; columns * rows];
        let camera = view.camera.prepare();
        for p in view.points.iter().filter_map(|&x| camera.project(x)) {
            if p.x >= 0.0 && p.y >= 0.0 && p.x < f64::from(w) && p.y < f64::from(h) {
                parts[(p.y / side) as usize * columns + (p.x / side) as usize] = true;
            }
        }
        held += parts.iter().filter(|held| **held).count();
        all += parts.len();
    }
    held as f64 / f64::from(u32::try_from(all).unwrap_or(u32::MAX)).max(1.0)
}

/// The system for a capture where none is named. A setting that one system alone has decides; otherwise what the capture holds
/// and what it is for.
///
/// # Errors
/// [`SystemError::Config`] for settings of which one is the field's alone and one the cloud's; [`SystemError::Scene`] when an image
/// cannot be read.
pub fn choose(scene: &Scene, data: &Dataset, run: &RunOptions, purpose: Purpose) -> Result<Choice, SystemError> {
    if let Some((system, key)) = implied(&run.set)? {
        return Ok(Choice::new(system, format!("`{key}` is a setting of it alone")));
    }
    if has_scales(data) {
        return Ok(Choice::new(FIELD, OF_SCALES));
    }
    Ok(Facts::of(scene, data, run.stop)?.choose(purpose))
}

/// Photos are given at several scales, which no cloud is trained on.
pub(super) fn has_scales(data: &Dataset) -> bool {
    data.views().iter().any(|view| view.level > 0)
}

/// The system that a setting asks for, and the setting.
fn implied(set: &toml::Table) -> Result<Option<(&'static str, &str)>, SystemError> {
    let cloud = splat::names();
    let field = field_names();
    let only = |mine: &toml::Table, other: &toml::Table| {
        set.keys().find(|key| mine.contains_key(*key) && !other.contains_key(*key)).map(String::as_str)
    };
    match (only(&field, &cloud), only(&cloud, &field)) {
        (Some(field), Some(cloud)) => Err(SystemError::Config {
            field: "set",
            value: format!("{field}, {cloud}"),
            problem: format!(
                "`{field}` is a setting of `{FIELD}` alone, `{cloud}` of `{CLOUD}`: leave one out, or name a `--system`"
            ),
        }),
        (Some(field), None) => Ok(Some((FIELD, field))),
        (None, Some(cloud)) => Ok(Some((CLOUD, cloud))),
        (None, None) => Ok(None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: Facts = Facts { points: 9000, covered: 0.9, cut_out: false, longest_side: 480, steps: 2000.0 };
    const OBJECT: Facts = Facts { points: 0, covered: 0.0, cut_out: true, longest_side: 400, steps: 2000.0 };

    #[test]
    fn a_cloud_takes_points_or_an_object_and_time() {
        let chosen = |facts: Facts| facts.choose(Purpose::Viewing).system;
        assert_eq!(chosen(POINTS), "splat");
        assert_eq!(chosen(Facts { covered: 0.3, ..POINTS }), "ngp");
        assert_eq!(chosen(Facts { points: 0, covered: 0.0, ..POINTS }), "ngp");
        assert_eq!(chosen(Facts { steps: 450.0, ..POINTS }), "splat", "bonsai after fifteen seconds");
        assert_eq!(chosen(Facts { steps: 100.0, ..POINTS }), "ngp");
        assert_eq!(chosen(OBJECT), "splat");
        assert_eq!(chosen(Facts { steps: 950.0, ..OBJECT }), "ngp", "lego400 after half a minute");
        assert_eq!(chosen(Facts { longest_side: 100, ..OBJECT }), "ngp");
        for facts in [POINTS, OBJECT] {
            assert_eq!(facts.choose(Purpose::Geometry).system, "ngp");
        }
    }

    #[test]
    fn the_reason_has_figures() {
        let line = |facts: Facts| facts.choose(Purpose::Viewing).line;
        for (line, figure) in [
            (line(POINTS), "9000 points are in 90.0 %"),
            (line(Facts { covered: 0.3, ..POINTS }), "30.0 %"),
            (line(Facts { steps: 100.0, ..POINTS }), "100 steps"),
            (line(OBJECT), "400 pixels"),
        ] {
            assert!(line.starts_with("system: ") && line.contains(figure), "{line}");
        }
    }
}

//! Which system is taken for a scene that moves where none is named: two parts for a film that fills its pictures; for things that are cut
//! out a cloud that moves, or a displacement where a cloud has too few steps, and for geometry.
//!
//! The rule and the figures that it was chosen by: `docs/decisions/0054-two-parts.md`, `docs/decisions/0061-four-dimensional-gaussians.md`.

use crate::papers::gaussians::four_d_gaussians;
use crate::plan::{CloudPace, backdrop, has_alpha};
use crate::settings::elsewhere;
use engine::data::Dataset;
use engine::options::{Choice, Purpose, RunOptions};
use engine::system::SystemError;
use scene_io::Scene;

/// Those that are chosen between.
const FILM: &str = "two-parts";
const THING: &str = "d-nerf";
const CLOUD: &str = "4dgs";

/// So many steps a cloud takes to be the better one.
const STEPS: f64 = 300.0;

/// How settings begin that one of them alone has, whatever the scene: those of a displacement and of the planes beside it, those of a hash
/// grid of space and time, and those of a cloud that moves.
const IMPLIED: [(&str, &str); 14] = [
    ("warp", THING),
    ("origin", THING),
    ("time_", THING),
    ("planes", THING),
    ("coherence", THING),
    ("sees", THING),
    ("moving_levels", FILM),
    ("moving_features", FILM),
    ("moving_log2_table", FILM),
    ("moving_n_", FILM),
    ("moving_times", FILM),
    ("motion_", CLOUD),
    ("max_splats", CLOUD),
    ("densify", CLOUD),
];

/// The system for a scene that moves, where none is named. A setting that one of them alone has decides first; then whether photos show
/// what is empty: where nothing hides what moves, too much of space may hold it; then a setting that a cloud has not, what it is for, and
/// how many steps there are.
///
/// # Errors
/// [`SystemError::Scene`] when an image cannot be read.
pub fn choose_moving(_: &Scene, data: &Dataset, run: &RunOptions, purpose: Purpose) -> Result<Choice, SystemError> {
    let implied = |key: &str| match key {
        "field" => Some(THING),
        _ => IMPLIED.iter().find(|(begin, _)| key.starts_with(begin)).map(|(_, system)| *system),
    };
    if let Some((key, system)) = run.set.keys().find_map(|key| Some((key, implied(key)?))) {
        return Ok(Choice::new(system, format!("`{key}` is a setting of it alone")));
    }
    if !has_alpha(data)? {
        // A cloud begins where alpha shows something; without alpha it would begin anywhere.
        return Ok(match backdrop(data)? {
            Some(_) => Choice::new(THING, "photos show what is empty, by one colour"),
            None => Choice::new(FILM, "photos show a place, not a thing that is cut out"),
        });
    }
    let of_cloud = four_d_gaussians::names();
    if let Some(key) = run.set.keys().find(|key| !of_cloud.contains_key(*key) && !elsewhere(key)) {
        return Ok(Choice::new(THING, format!("photos show what is empty, and a cloud has no setting `{key}`")));
    }
    if purpose == Purpose::Geometry {
        return Ok(Choice::new(THING, "photos show what is empty; for geometry: a cloud of Gaussians has no density"));
    }
    let steps = CloudPace::of(data)?.moving().steps(run.stop).unwrap_or(f64::INFINITY);
    if steps < STEPS {
        let why = format!("a cloud that moves would do about {steps:.0} steps before the stop, it takes {STEPS:.0}");
        return Ok(Choice::new(THING, why));
    }
    let why = "photos show what is empty";
    if steps.is_infinite() {
        return Ok(Choice::new(CLOUD, why));
    }
    Ok(Choice::new(
        CLOUD,
        format!("{why}; about {steps:.0} steps of a cloud that moves before the stop, it takes {STEPS:.0}"),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made::{SIDE, frames, scene};
    use engine::options::{Stop, parse_set};

    fn chosen(data: &Dataset, place: &Scene, set: &[&str], stop: Option<Stop>, purpose: Purpose) -> &'static str {
        let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
        let run = RunOptions { seed: 0, background: None, error_budget: None, stop, set };
        choose_moving(place, data, &run, purpose).unwrap().system
    }

    #[test]
    fn a_film_has_two_parts_and_a_thing_that_is_cut_out_a_cloud_or_a_displacement() {
        let of = |data: &Dataset, place: &Scene, set: &[&str]| chosen(data, place, set, None, Purpose::Viewing);
        let (place, data) = scene(frames(3, |k, x, y| [(60 * k) as u8, (7 * x) as u8, (7 * y) as u8, 255]), Vec::new());
        assert_eq!(of(&data, &place, &[]), "two-parts");
        assert_eq!(of(&data, &place, &["moving_from=0.2"]), "two-parts");
        assert_eq!(of(&data, &place, &["levels=4"]), "two-parts", "both fields have it");
        assert_eq!(of(&data, &place, &["horizon=900"]), "two-parts", "all have it");
        assert_eq!(of(&data, &place, &["field=mlp"]), "d-nerf");
        assert_eq!(of(&data, &place, &["warp_octaves=2"]), "d-nerf");
        assert_eq!(of(&data, &place, &["motion_from=0.2"]), "4dgs");
        let middle = |x: u32| (SIDE / 4..3 * SIDE / 4).contains(&x);
        let colour =
            |alpha: u8| move |_, x, y| if middle(x) && middle(y) { [9, 9, 9, 255] } else { [255, 255, 255, alpha] };
        let (place, data) = scene(frames(3, colour(255)), Vec::new());
        assert_eq!(of(&data, &place, &[]), "d-nerf", "before one colour, without alpha");
        let (place, data) = scene(frames(4, colour(0)), Vec::new());
        assert_eq!(of(&data, &place, &[]), "4dgs");
        for set in ["background=static", "depth=1", "by_error=true", "planes=[]", "field=mlp"] {
            assert_eq!(of(&data, &place, &[set]), "d-nerf", "{set}");
        }
        for set in ["field_steps=300", "horizon=900", "accept_no_parallax=true"] {
            assert_eq!(of(&data, &place, &[set]), "4dgs", "{set}");
        }
        assert_eq!(of(&data, &place, &["max_splats=900"]), "4dgs");
        assert_eq!(of(&data, &place, &["levels=4"]), "d-nerf");
        assert_eq!(of(&data, &place, &["moving_levels=4"]), "two-parts");
        let stopped = |stop, purpose| chosen(&data, &place, &[], stop, purpose);
        assert_eq!(stopped(None, Purpose::Geometry), "d-nerf");
        assert_eq!(stopped(Some(Stop::Steps(299)), Purpose::Viewing), "d-nerf");
        assert_eq!(stopped(Some(Stop::Steps(300)), Purpose::Viewing), "4dgs");
    }
}

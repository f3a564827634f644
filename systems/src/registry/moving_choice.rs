//! Which system is taken for a scene that moves where none is named: two parts for a film that fills its pictures, a displacement for
//! things that are cut out.
//!
//! The rule and the figures that it was chosen by: `docs/decisions/0054-two-parts.md`.

use crate::plan::{backdrop, has_alpha};
use engine::data::Dataset;
use engine::options::{Choice, Purpose, RunOptions};
use engine::system::SystemError;
use scene_io::Scene;

/// The two that are chosen between.
const FILM: &str = "two-parts";
const THING: &str = "d-nerf";

/// How settings begin that one of them alone has: those of a displacement and of the planes beside it, and those of a hash grid of space and time.
const IMPLIED: [(&str, &str); 12] = [
    ("warp", THING),
    ("origin", THING),
    ("time_", THING),
    ("planes", THING),
    ("coherence", THING),
    ("field", THING),
    ("sees", THING),
    ("moving_levels", FILM),
    ("moving_features", FILM),
    ("moving_log2_table", FILM),
    ("moving_n_", FILM),
    ("moving_times", FILM),
];

/// The system for a scene that moves, where none is named. A setting that one of them alone has decides; otherwise whether photos show
/// what is empty: where nothing hides what moves, too much of space may hold it.
///
/// # Errors
/// [`SystemError::Scene`] when an image cannot be read.
pub fn choose_moving(_: &Scene, data: &Dataset, run: &RunOptions, _: Purpose) -> Result<Choice, SystemError> {
    let implied = |key: &str| IMPLIED.iter().find(|(begin, _)| key.starts_with(begin)).map(|(_, system)| *system);
    if let Some((key, system)) = run.set.keys().find_map(|key| Some((key, implied(key)?))) {
        return Ok(Choice::new(system, format!("`{key}` is a setting of it alone")));
    }
    if has_alpha(data)? || backdrop(data)?.is_some() {
        return Ok(Choice::new(THING, "photos show what is empty"));
    }
    Ok(Choice::new(FILM, "photos show a place, not a thing that is cut out"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made::{SIDE, frames, scene};
    use engine::options::parse_set;

    fn chosen(data: &Dataset, place: &Scene, set: &[&str]) -> &'static str {
        let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
        let run = RunOptions { seed: 0, background: None, error_budget: None, stop: None, set };
        choose_moving(place, data, &run, Purpose::Viewing).unwrap().system
    }

    #[test]
    fn a_film_has_two_parts_and_a_thing_that_is_cut_out_a_displacement() {
        let (place, data) = scene(frames(3, |k, x, y| [(60 * k) as u8, (7 * x) as u8, (7 * y) as u8, 255]), Vec::new());
        assert_eq!(chosen(&data, &place, &[]), "two-parts");
        assert_eq!(chosen(&data, &place, &["moving_from=0.2"]), "two-parts");
        assert_eq!(chosen(&data, &place, &["warp_octaves=2"]), "d-nerf");
        let middle = |x: u32| (SIDE / 4..3 * SIDE / 4).contains(&x);
        let (place, data) =
            scene(frames(3, |_, x, y| if middle(x) && middle(y) { [9, 9, 9, 255] } else { [255; 4] }), Vec::new());
        assert_eq!(chosen(&data, &place, &[]), "d-nerf");
        assert_eq!(chosen(&data, &place, &["moving_levels=4"]), "two-parts");
    }
}

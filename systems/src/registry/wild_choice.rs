//! Which system is taken for photos of many people where none is named: a cloud of Gaussians, or the field whose parts the photos need.
//!
//! The rule and the figures that it was chosen by: `docs/decisions/0065-a-cloud-from-photos-of-many-people-by-default.md`.

use super::choice::{Facts, OF_GEOMETRY, OF_SCALES, Verdict, has_scales};
use crate::papers::gaussians::{splat, wild_gaussians};
use crate::papers::wild::auto::{FEW_PHOTOS, needs};
use crate::papers::wild::{AppearanceKind, OccluderKind};
use crate::plan::{Ground, field_names};
use crate::settings::elsewhere;
use engine::data::Dataset;
use engine::options::{Choice, Purpose, RunOptions};
use engine::system::SystemError;
use scene_io::Scene;

/// The two that are chosen between.
const FIELD: &str = "auto";
const CLOUD: &str = "wild-gaussians";

/// Settings that both have, and words of them that one of them alone knows.
const WORDS: [(&str, &str, &str); 14] = [
    ("appearance", "encoder", FIELD),
    ("occluders", "robust", FIELD),
    ("occluders", "transient", FIELD),
    ("occluders", "visibility", FIELD),
    ("occluders", "filter", FIELD),
    ("occluders", "masks", FIELD),
    ("occluders", "photos", CLOUD),
    ("occluders", "residual", CLOUD),
    ("occluders", "errors", CLOUD),
    ("occluders", "features", CLOUD),
    ("occluders", "auto", CLOUD),
    ("occluders", "visibility_head", CLOUD),
    ("appearance", "maps", CLOUD),
    ("appearance", "triplane", CLOUD),
];

/// The system for photos of many people, where none is named. A setting that one of them alone has decides first; then what it is for,
/// how many photos and steps there are. Of a cloud it is found out, too, whether photos differ in appearance and hold occluders.
///
/// # Errors
/// As a short training has them; [`SystemError::Scene`] when an image cannot be read.
pub fn choose_wild(scene: &Scene, data: &Dataset, run: &RunOptions, purpose: Purpose) -> Result<Choice, SystemError> {
    if let Some(choice) = implied(&run.set) {
        return if choice.system == CLOUD { with_needs(choice, scene, data, run) } else { Ok(choice) };
    }
    if purpose == Purpose::Geometry {
        return Ok(Choice::new(FIELD, OF_GEOMETRY));
    }
    if has_scales(data) {
        return Ok(Choice::new(FIELD, OF_SCALES));
    }
    let photos = data.len();
    if photos < FEW_PHOTOS {
        return Ok(Choice::new(FIELD, format!("{photos} photos, a cloud takes {FEW_PHOTOS}")));
    }
    match Facts::of(scene, data, run.stop)?.behind_others() {
        Verdict { cloud: false, why } => Ok(Choice::new(FIELD, why)),
        Verdict { cloud: true, why } => with_needs(Choice::new(CLOUD, format!("{photos} {why}")), scene, data, run),
    }
}

/// What a setting asks for.
fn implied(set: &toml::Table) -> Option<Choice> {
    let chosen = |system, key: &str| Choice::new(system, format!("`{key}` is a setting of it alone"));
    for (name, word, system) in WORDS {
        if set.get(name).and_then(toml::Value::as_str) == Some(word) {
            return Some(chosen(system, &format!("{name}={word}")));
        }
    }
    let (cloud, still, field) = (wild_gaussians::names(), splat::names(), field_names());
    let of_field = set.keys().find(|key| !cloud.contains_key(*key) && !elsewhere(key));
    if let Some(key) = of_field {
        return Some(Choice::new(FIELD, format!("a cloud has no setting `{key}`")));
    }
    set.keys().find(|key| still.contains_key(*key) && !field.contains_key(*key)).map(|key| chosen(CLOUD, key))
}

/// The cloud with the parts that the photos need, but for those that were asked for.
fn with_needs(choice: Choice, scene: &Scene, data: &Dataset, run: &RunOptions) -> Result<Choice, SystemError> {
    if ["appearance", "occluders"].iter().all(|part| run.set.contains_key(*part)) {
        return Ok(choice);
    }
    let mut ground = Ground::of(scene, data, run)?;
    let before = ground.lines.len();
    // The short training has no settings of the cloud.
    let plain = RunOptions { set: toml::Table::new(), ..run.clone() };
    let (appearance, occluders) = needs(&mut ground, data, &plain)?;
    let appearance = match appearance {
        AppearanceKind::None => "none",
        AppearanceKind::Codes | AppearanceKind::Encoder => "codes",
    };
    let occluders = match occluders {
        OccluderKind::None => "none",
        _ => "photos",
    };
    let mut set = toml::Table::new();
    set.insert("appearance".into(), appearance.into());
    set.insert("occluders".into(), occluders.into());
    let of_user = |line: &String| run.set.keys().any(|key| line.starts_with(&format!("{key}:")));
    let lines = ground.lines.split_off(before).into_iter().filter(|line| !of_user(line)).collect();
    Ok(choice.with(set, lines))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::made::{Points, capture, frames, scene};
    use crate::registry::PartWords;
    use engine::options::{Stop, parse_set};

    fn asked(data: &Dataset, place: &Scene, set: &[&str], stop: Option<Stop>, purpose: Purpose) -> Choice {
        let set = set.iter().map(|s| parse_set(s).unwrap()).collect();
        let run = RunOptions { seed: 0, background: None, error_budget: None, stop, set };
        choose_wild(place, data, &run, purpose).unwrap()
    }

    /// So many photos of one camera each.
    fn photos(count: usize) -> (Scene, Dataset) {
        let (place, _) = capture(Points::WithTracks);
        let more = place.frames.iter().cycle().take(count).cloned();
        let named = more.enumerate().map(|(k, mut frame)| {
            frame.name = format!("{k}.png");
            frame
        });
        scene(named.collect(), place.points.clone())
    }

    #[test]
    fn few_photos_little_time_and_geometry_are_for_the_field() {
        let (place, data) = photos(18);
        let known = ["appearance=none", "occluders=none"];
        let of = |stop, purpose| asked(&data, &place, &known, stop, purpose).system;
        assert_eq!(of(None, Purpose::Viewing), CLOUD);
        assert_eq!(of(None, Purpose::Geometry), FIELD);
        assert_eq!(of(Some(Stop::Steps(999)), Purpose::Viewing), FIELD);
        let (place, few) = photos(FEW_PHOTOS - 1);
        let choice = asked(&few, &place, &known, None, Purpose::Viewing);
        assert!(choice.system == FIELD && choice.line.contains("15 photos"), "{}", choice.line);
        let (place, small) = scene(frames(4, |_, x, y| [x as u8, y as u8, 9, if x > y { 255 } else { 0 }]), Vec::new());
        assert_eq!(asked(&small, &place, &known, None, Purpose::Viewing).system, FIELD);
    }

    #[test]
    fn a_setting_of_one_of_them_implies_it() {
        let (place, data) = photos(12);
        let of = |set: &[&str]| asked(&data, &place, set, None, Purpose::Viewing).system;
        let known = ["appearance=none", "occluders=none"];
        assert_eq!(of(&[known[0], "occluders=photos"]), CLOUD);
        assert_eq!(of(&[known[0], "occluders=residual", "judge_from=0.2"]), CLOUD);
        assert_eq!(of(&[known[0], known[1], "max_splats=900"]), CLOUD);
        for set in ["occluders=masks", "appearance=encoder", "field=mlp", "n_max=64", "no_such=1"] {
            assert_eq!(of(&[set]), FIELD, "{set}");
        }
    }

    #[test]
    fn every_word_that_one_of_them_alone_has_implies_it() {
        let [fields, clouds] = [PartWords::of_fields(), PartWords::of_clouds()];
        let parts = [
            ("appearance", &fields.appearance, &clouds.appearance),
            ("occluders", &fields.occluders, &clouds.occluders),
        ];
        for (name, of_fields, of_clouds) in parts {
            for (words, others, system) in [(of_fields, of_clouds, FIELD), (of_clouds, of_fields, CLOUD)] {
                for word in words.iter().filter(|word| !others.contains(word)) {
                    let set = toml::Table::from_iter([(name.to_owned(), word.as_str().into())]);
                    assert_eq!(implied(&set).map(|choice| choice.system), Some(system), "{name}={word}");
                }
            }
        }
    }

    #[test]
    fn a_cloud_has_the_parts_that_the_photos_need_and_says_why() {
        let (place, data) = photos(FEW_PHOTOS);
        let choice = asked(&data, &place, &["max_splats=900", "occluders=none"], None, Purpose::Viewing);
        assert_eq!(choice.system, CLOUD);
        assert!(choice.set.contains_key("appearance"), "{:?}", choice.set);
        let lines = choice.lines.join("\n");
        assert!(lines.contains("appearance: ") && !lines.contains("occluders: "), "{lines}");
    }
}

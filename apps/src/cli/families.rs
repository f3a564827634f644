//! Words that only systems of some families understand. An app shows the words of its own family; the others it takes where the system
//! that is named, or that of the run, is of one of their families.

use crate::app::App;
use clap::ArgMatches;
use clap::parser::ValueSource;
use std::path::PathBuf;
use systems::registry::{Family, PartWords, find};

/// Which system an app takes where none is named.
pub(crate) fn default_system(family: Family) -> &'static str {
    match family {
        Family::Static => "`ngp` or `splat`, whichever suits the scene",
        Family::Wild => "`wild-gaussians`, or `auto` for few photos, little time, geometry and settings of a field",
        Family::Moving => {
            "`4dgs` for things that are cut out, or `d-nerf` for little time (fewer than 300 steps of a cloud), geometry, a backdrop of \
             one colour without alpha and settings that a cloud has not; `two-parts` for places"
        }
    }
}

/// The words of `--set` that force a part of a system for photos of many people on or off, for `--help`.
pub(super) fn part_words() -> String {
    let [fields, clouds] = [PartWords::of_fields(), PartWords::of_clouds()].map(|words| {
        format!("`appearance={}` and `occluders={}`", words.appearance.join("|"), words.occluders.join("|"))
    });
    format!(
        "On photos of many people these force any part on or off. Fields: {fields}; clouds: {clouds}. Of `nerfies` and `hypernerf` \
         `appearance=none|codes` does"
    )
}

/// A subcommand, and one of its arguments; without one the subcommand itself.
type Word = (&'static str, Option<&'static str>);

/// The words of some families, the apps that show them, and why other systems do not have them.
struct Words {
    families: &'static [Family],
    apps: &'static str,
    why: &'static str,
    words: &'static [Word],
}

const WORDS: [Words; 4] = [
    Words {
        families: &[Family::Wild],
        apps: "nerf-wild",
        why: "no system of its is named here, so photos show no occluders",
        words: &[("demo", Some("field")), ("train", Some("field")), ("masks", None)],
    },
    Words {
        families: &[Family::Wild, Family::Moving],
        apps: "nerf-wild and nerf-dynamic",
        why: "no system of theirs is named here, so all photos have one appearance",
        words: &[
            ("train", Some("eval_appearance")),
            ("eval", Some("eval_appearance")),
            ("render", Some("appearance")),
            ("render", Some("fit_camera")),
            ("export", Some("appearance")),
            ("export", Some("fit_camera")),
        ],
    },
    Words {
        families: &[Family::Moving],
        apps: "nerf-dynamic",
        why: "no system of its is named here, so the scene stands still",
        words: &[
            ("render", Some("time")),
            ("export", Some("time")),
            ("priors", None),
            ("check", Some("priors")),
            ("train", Some("priors")),
            ("eval", Some("priors")),
        ],
    },
    Words {
        families: &[Family::Static],
        apps: "nerf-static",
        why: "only there a system is chosen by what the scene is for",
        words: &[("train", Some("for"))],
    },
];

/// The words of the other families.
pub(super) fn words_of_others(family: Family) -> impl Iterator<Item = Word> {
    WORDS.iter().filter(move |words| !words.families.contains(&family)).flat_map(|words| words.words.iter().copied())
}

/// What is wrong with a word that neither the app nor the system has.
pub(super) fn foreign_word(app: &App, matches: &ArgMatches) -> Option<String> {
    let (word, given) = matches.subcommand()?;
    let is_given = |argument: &Option<&str>| {
        argument.is_none_or(|name| given.value_source(name) == Some(ValueSource::CommandLine))
    };
    let foreign: Vec<(&Words, Option<&str>)> = WORDS
        .iter()
        .filter(|words| !words.families.contains(&app.family))
        .flat_map(|words| words.words.iter().map(move |(sub, argument)| (words, *sub, *argument)))
        .filter(|(_, sub, argument)| *sub == word && is_given(argument))
        .map(|(words, _, argument)| (words, argument))
        .collect();
    // Most command lines have none of them: no run is read for these.
    if foreign.is_empty() {
        return None;
    }
    let families = system(word, given).and_then(|name| find(&name)).map_or(&[][..], |entry| entry.families);
    let is_theirs = |words: &Words| words.families.iter().any(|family| families.contains(family));
    let (words, argument) = foreign.into_iter().find(|&(words, _)| !is_theirs(words))?;
    let shown = argument.map_or_else(|| word.into(), |name| format!("--{}", name.replace('_', "-")));
    Some(format!("`{shown}` is a word of {}: {}", words.apps, words.why))
}

/// The system that is named, or that of the run.
fn system(word: &str, given: &ArgMatches) -> Option<String> {
    let value = |name: &str| given.try_get_one::<String>(name).ok().flatten().cloned();
    let path = |name: &str| given.try_get_one::<PathBuf>(name).ok().flatten();
    value("system").or_else(|| {
        let run = if word == "train" { path("out") } else { path("run") };
        Some(engine::folder::config(run?)?.system)
    })
}

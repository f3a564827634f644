//! What messages tell people to type exists.

use crate::tools::{nerf, nerf_dynamic, nerf_wild};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Commands and options of the three apps, from their help.
fn known() -> (BTreeSet<String>, BTreeSet<String>) {
    let (mut commands, mut options) = (BTreeSet::new(), BTreeSet::new());
    for app in [nerf as fn(&[&str]) -> crate::tools::Answer, nerf_wild, nerf_dynamic] {
        let help = app(&["--help"]).out;
        let listed = help.lines().skip_while(|l| !l.starts_with("Commands:")).skip(1);
        for command in listed.take_while(|l| !l.is_empty()).filter_map(|l| l.split_whitespace().next()) {
            options.extend(words_of(&app(&[command, "--help"]).out));
            commands.insert(command.to_string());
        }
    }
    (commands, options)
}

/// Every `--word` of a text.
fn words_of(text: &str) -> Vec<String> {
    let is_word = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
    let words = text.match_indices("--").filter_map(|(at, _)| {
        let word: String = text[at..].chars().take_while(|c| is_word(*c)).collect();
        let word = word.trim_end_matches('-');
        (!text[..at].ends_with(['-', '<']) && word.len() > 2).then(|| word.to_string())
    });
    words.collect()
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Spans between backticks in the code of a source file, that is, in its messages: comments and tests are left out.
fn spans(source: &str) -> Vec<String> {
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    // Strings may be continued over lines.
    let code: Vec<&str> = code.lines().map(str::trim).filter(|line| !line.starts_with("//")).collect();
    let code = code.join(" ").replace("\\ ", "");
    code.split('`').skip(1).step_by(2).map(ToString::to_string).collect()
}

#[test]
fn every_option_that_a_message_names_is_one_of_some_app() {
    let (commands, options) = known();
    assert!(commands.contains("train") && options.contains("--holdout"), "{commands:?} {options:?}");
    let mut files = Vec::new();
    for part in ["scene-io", "engine", "systems", "apps"] {
        sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(part).join("src"), &mut files);
    }
    let (mut seen, mut unknown) = (0, Vec::new());
    for file in files {
        for span in spans(&fs::read_to_string(&file).unwrap()) {
            // Ours: an option alone, or a command with its options; other programs' command lines begin with their name.
            let ours = span.starts_with("--") || span.split(' ').next().is_some_and(|w| commands.contains(w));
            for word in words_of(&span).into_iter().filter(|_| ours) {
                seen += 1;
                if !options.contains(&word) {
                    unknown.push(format!("{}: `{span}`: {word}", file.display()));
                }
            }
        }
    }
    assert!(seen > 60, "{seen} options found in messages: the search is broken");
    assert!(unknown.is_empty(), "options that no app has:\n{}", unknown.join("\n"));
}

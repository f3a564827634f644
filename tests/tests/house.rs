//! How the house is built: no circles, arrows that point one way, drivers that know no paper, functions and settings of a size that
//! a reader can hold, parameters whose parts have names. What is known to break a rule is in a list that may only shrink.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use tests::sources::{Crate, circles, crates, sources, tokens, without_tests};

/// Circles of more than two files that are still there: crate and files.
const FILE_CIRCLES: [(&str, &[&str]); 0] = [];

/// Circles of rooms (top-level modules) that are still there: crate and rooms.
const ROOM_CIRCLES: [(&str, &[&str]); 0] = [];

/// Functions of more than [`MOST_LINES`] lines that are still there: file, name, lines now.
const LONG_FUNCTIONS: [(&str, &str, usize); 0] = [];

/// Settings of more than [`MOST_FIELDS`] fields that are still there: file, name, fields now.
const LARGE_SETTINGS: [(&str, &str, usize); 0] = [];

/// Words of a paper that the code of a driver still says: file, word, how often.
const PAPERS_IN_DRIVERS: [(&str, &str, usize); 0] = [];

/// Parameters that are tuples and still there: file, function, parameter. What the crate `image` gives; and of the tests' own kit
/// a function and its `_backward`.
const TUPLES: [(&str, &str, &str); 3] = [
    ("scene-io/src/size.rs", "from", "columns_and_rows"),
    ("testkit/src/gradient/f32_pair.rs", "check_f32_pair", "single"),
    ("testkit/src/gradient/f32_pair.rs", "check_f32_pair", "twin"),
];

const MOST_LINES: usize = 100;
const MOST_FIELDS: usize = 20;

/// Compare circles that were found with those that are known; a circle of fewer files than the known one is news, too.
fn compare(found: Vec<(String, BTreeSet<String>)>, known: &[(&str, &[&str])], of: &str) {
    let known: BTreeSet<(String, BTreeSet<String>)> = known
        .iter()
        .map(|(krate, files)| ((*krate).into(), files.iter().map(|file| (*file).into()).collect()))
        .collect();
    let found: BTreeSet<_> = found.into_iter().collect();
    let listed = |circles: Vec<&(String, BTreeSet<String>)>| {
        let line = |(krate, files): &(String, BTreeSet<String>)| {
            let files: Vec<String> = files.iter().map(|file| format!("\"{file}\"")).collect();
            format!("    (\"{krate}\", &[{}]),\n", files.join(", "))
        };
        circles.into_iter().map(line).collect::<String>()
    };
    let (new, gone) = (listed(found.difference(&known).collect()), listed(known.difference(&found).collect()));
    assert!(
        new.is_empty(),
        "new circles of {of}:\n{new}cut them; where one of the list became smaller, correct the list"
    );
    assert!(gone.is_empty(), "circles of {of} that are not there any more; take them out of the list:\n{gone}");
}

#[test]
fn no_circle_of_more_than_two_files_and_none_of_rooms() {
    let (mut files, mut rooms, mut arrows) = (Vec::new(), Vec::new(), 0);
    for (krate, sources) in crates(&sources()) {
        let graph = Crate::new(&sources);
        arrows += graph.files().values().map(BTreeSet::len).sum::<usize>();
        files.extend(circles(&graph.files()).into_iter().filter(|c| c.len() > 2).map(|c| (krate.clone(), c)));
        rooms.extend(circles(&graph.rooms()).into_iter().map(|c| (krate.clone(), c)));
    }
    assert!(arrows > 2000, "{arrows} imports found: the search is wrong");
    compare(files, &FILE_CIRCLES, "files");
    compare(rooms, &ROOM_CIRCLES, "rooms");
}

/// A document of the repository, from its root.
fn document(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)).unwrap()
}

#[test]
fn every_room_of_the_systems_stands_in_the_document_of_the_house() {
    let text = document("docs/ARCHITECTURE.md");
    let (_, rooms) = text.split_once("\n## Inside `systems`\n").unwrap();
    let cells = rooms.lines().filter_map(|line| line.strip_prefix("| ")?.split(" | ").next()).collect::<String>();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../systems/src");
    let folders = std::fs::read_dir(root).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_dir());
    let names: BTreeSet<String> = folders.map(|entry| entry.file_name().into_string().unwrap()).collect();
    assert!(names.len() > 20, "{names:?}");
    let missing: Vec<&String> = names.iter().filter(|name| !cells.contains(&format!("`{name}`"))).collect();
    assert!(missing.is_empty(), "docs/ARCHITECTURE.md, Inside `systems`: no line for {missing:?}");
}

#[test]
fn code_that_the_documents_quote_of_k_planes_stands_there() {
    let lines = |text: &str| text.lines().map(|line| line.trim().to_owned()).collect::<BTreeSet<_>>();
    let code = lines(&document("systems/src/papers/dynamic/k_planes.rs"));
    let text = document("docs/ADDING_A_SYSTEM.md");
    let (_, quote) = text.split_once("```rust\npub(crate) fn build(").unwrap();
    let (quote, _) = quote.split_once("\n```").unwrap();
    let quoted: Vec<&str> = quote.lines().skip(1).map(str::trim).filter(|line| !line.starts_with("//")).collect();
    assert!(quoted.len() > 8, "{quoted:?}");
    for line in quoted {
        assert!(code.contains(line), "docs/ADDING_A_SYSTEM.md quotes a line that k_planes.rs has not: {line}");
    }
}

#[test]
fn the_engine_names_no_system() {
    for (path, source) in sources().iter().filter(|(path, _)| path.starts_with("engine/")) {
        let (code, _) = without_tests(&tokens(source));
        assert!(!code.contains(&"systems".into()), "{path} names the crate `systems`");
    }
}

/// Names of papers and their systems, as parts of a name: `MipNerf360Config` is mip, nerf, 360, config.
const PAPERS: [&str; 12] =
    ["nerf", "nerfw", "ngp", "mip", "nerfies", "tineuvox", "endo", "hyper", "kplanes", "nsff", "hugs", "gs"];

/// Parts of a name: at underscores, and where a capital letter begins a word.
fn parts(name: &str) -> Vec<String> {
    let (mut out, mut last_was_lower) = (vec![String::new()], false);
    for c in name.chars() {
        if c == '_' || (c.is_uppercase() && last_was_lower) {
            out.push(String::new());
        }
        if c != '_' {
            out.last_mut().unwrap().extend(c.to_lowercase());
        }
        last_was_lower = c.is_lowercase() || c.is_ascii_digit();
    }
    out
}

#[test]
fn names_fall_into_parts() {
    assert_eq!(parts("MipNerf360Config"), ["mip", "nerf360", "config"]);
    assert_eq!(parts("ha_nerf"), ["ha", "nerf"]);
    assert_eq!(parts("NGP"), ["ngp"]);
}

#[test]
fn a_driver_names_no_paper() {
    let mut found = BTreeMap::new();
    let folders = ["systems/src/rays/", "systems/src/views/", "systems/src/networks/"];
    let mut files = 0;
    for (krate, sources) in crates(&sources()).into_iter().filter(|(krate, _)| krate == "systems") {
        let compiled = Crate::new(&sources).files();
        for (path, source) in sources.iter().filter(|(path, _)| compiled.contains_key(path)) {
            let path = format!("{krate}/src/{path}");
            if !folders.iter().any(|folder| path.starts_with(folder)) {
                continue;
            }
            files += 1;
            for name in without_tests(&tokens(source)).0 {
                let parts = parts(&name);
                let is_paper = |part: &String| PAPERS.contains(&part.trim_end_matches(|c: char| c.is_ascii_digit()));
                if parts.iter().any(is_paper) || name.contains("k_planes") || name.contains("KPlanes") {
                    *found.entry((path.clone(), name)).or_insert(0) += 1;
                }
            }
        }
    }
    assert!(files > 30, "{files} files of drivers found: the search is wrong");
    let known: BTreeMap<(String, String), usize> =
        PAPERS_IN_DRIVERS.iter().map(|(path, word, count)| (((*path).into(), (*word).into()), *count)).collect();
    assert_eq!(found, known, "a driver names a paper (or one fewer than the list says)");
}

/// Functions of a source: name and lines, from the line of `fn` to that of the closing brace.
fn functions(source: &str) -> Vec<(String, usize)> {
    let lines: Vec<&str> = source.lines().collect();
    let mut out = Vec::new();
    for (i, line) in lines.iter().enumerate() {
        let indent = line.len() - line.trim_start().len();
        let words: Vec<&str> = line.trim_start().split([' ', '(', '<']).collect();
        let Some(at) = words.iter().position(|word| *word == "fn") else { continue };
        let before = ["pub", "pub(crate)", "pub(super)", "const", "unsafe", "extern", "\"C\"", "crate)", "super)"];
        if !words[..at].iter().all(|word| before.contains(word)) || line.trim_end().ends_with(['}', ';']) {
            continue;
        }
        // A formatted function ends at the first brace of its own indent.
        let end = format!("{}}}", " ".repeat(indent));
        if let Some(length) = lines[i..].iter().position(|line| *line == end) {
            out.push((words.get(at + 1).copied().unwrap_or_default().into(), length + 1));
        }
    }
    out
}

#[test]
fn functions_are_measured_in_lines() {
    let source = "fn a() {\n    1\n}\n\nimpl X {\n    pub(crate) const fn b(\n        x: u8,\n    ) {\n        fn c() {\n        }\n    }\n}\nfn d() {}\n";
    let found = functions(source);
    let expected = [("a", 3), ("b", 6), ("c", 2)];
    assert_eq!(found, expected.map(|(name, lines)| (name.to_string(), lines)));
}

#[test]
fn no_function_is_longer_than_a_hundred_lines() {
    let (mut found, mut all) = (BTreeSet::new(), 0);
    for (krate, sources) in crates(&sources()) {
        let compiled = Crate::new(&sources).files();
        for (path, source) in sources.iter().filter(|(path, _)| compiled.contains_key(path)) {
            // Tests are at the end of their file.
            let source = source.split("\n#[cfg(test)]\nmod tests {").next().unwrap_or_default();
            for (name, lines) in functions(source) {
                all += 1;
                if lines > MOST_LINES {
                    found.insert((format!("{krate}/src/{path}"), name, lines));
                }
            }
        }
    }
    assert!(all > 3000, "{all} functions found: the search is wrong");
    shrinks(&found, &LONG_FUNCTIONS);
}

#[test]
fn no_settings_have_more_than_twenty_fields() {
    let (mut found, mut all) = (BTreeSet::new(), 0);
    for (path, source) in sources().iter().filter(|(path, _)| path.contains("/src/")) {
        let (tokens, _) = without_tests(&tokens(source));
        for (name, fields) in settings(&tokens) {
            all += 1;
            if fields > MOST_FIELDS {
                found.insert((path.clone(), name, fields));
            }
        }
    }
    assert!(all > 50, "{all} structs that are read from files found: the search is wrong");
    shrinks(&found, &LARGE_SETTINGS);
}

/// Structs that derive `Deserialize`: names and numbers of fields.
fn settings(tokens: &[String]) -> Vec<(String, usize)> {
    let mut out = Vec::new();
    let mut i = 0;
    while i < tokens.len() {
        let is_derive =
            tokens[i] == "derive" && tokens[i..].iter().take_while(|t| *t != "]").any(|t| t == "Deserialize");
        i += 1;
        if !is_derive {
            continue;
        }
        let Some(at) = tokens[i..].iter().position(|t| ["struct", "enum"].contains(&t.as_str())) else { continue };
        let (name, mut depth, mut fields) = (tokens[i + at + 1].clone(), 0, 0);
        if tokens[i + at] == "enum" || tokens.get(i + at + 2).is_none_or(|t| t != "{") {
            continue;
        }
        for (k, token) in tokens.iter().enumerate().skip(i + at + 2) {
            match token.as_str() {
                "{" | "(" | "[" | "<" => depth += 1,
                "}" | ")" | "]" | ">" => depth -= 1,
                // Attributes are one deeper.
                ":" if depth == 1 && tokens[k - 1] != "#" => fields += 1,
                _ => {}
            }
            if depth == 0 {
                break;
            }
        }
        out.push((name, fields));
    }
    out
}

#[test]
fn fields_of_settings_are_counted() {
    let source = "#[derive(Clone, Deserialize)]\n#[serde(default)]\npub struct A { pub a: Vec<Option<u8>>, #[serde(x = \"y\")] pub(crate) b: [u8; 3] }\n\
                  #[derive(Deserialize)] enum E { X { a: u8 } } #[derive(Clone)] struct B { a: u8 } #[derive(Deserialize)] struct C(u8);";
    assert_eq!(settings(&tokens(source)), [("A".to_string(), 2)]);
}

#[test]
fn no_parameter_is_a_tuple() {
    let (mut found, mut all) = (BTreeSet::new(), 0);
    for (krate, sources) in crates(&sources()) {
        let compiled = Crate::new(&sources).files();
        for (path, source) in sources.iter().filter(|(path, _)| compiled.contains_key(path)) {
            for (function, parameter, is_tuple) in parameters(&without_tests(&tokens(source)).0) {
                all += 1;
                if is_tuple {
                    found.insert((format!("{krate}/src/{path}"), function, parameter));
                }
            }
        }
    }
    assert!(all > 8000, "{all} parameters found: the search is wrong");
    let known: BTreeSet<_> = TUPLES.map(|(path, name, of)| (path.to_string(), name.to_string(), of.to_string())).into();
    assert_eq!(found, known, "a parameter is a tuple: give its parts names (or there is one fewer than the list says)");
}

/// Parameters of functions: the function, the name or pattern, and whether the type is a tuple or a reference to one.
fn parameters(tokens: &[String]) -> Vec<(String, String, bool)> {
    let mut out = Vec::new();
    for i in (0..tokens.len()).filter(|i| tokens[*i] == "fn") {
        // A type `fn(A)` has no name.
        let Some(name) = tokens.get(i + 1).filter(|name| *name != "(") else { continue };
        let mut rest = &tokens[i + 2..];
        if rest.first().is_some_and(|t| t == "<") {
            rest = &rest[inside(rest).len() + 2..];
        }
        for parameter in split(inside(rest), ",") {
            let parts = split(parameter, ":");
            let Some((pattern, kind)) = parts.first().zip(parts.get(1)) else { continue };
            // Only `&`, a lifetime's name and `mut` stand before a tuple.
            let begin = kind.iter().position(|t| t == "(").unwrap_or(kind.len());
            let (before, kind) = kind.split_at(begin);
            let is_plain = before.first().is_none_or(|t| t == "&")
                && before.iter().all(|t| !["[", "<", "Fn", "FnMut", "FnOnce"].contains(&t.as_str()));
            let is_tuple = is_plain && split(inside(kind), ",").len() > 1;
            out.push((name.clone(), pattern.concat(), is_tuple));
        }
    }
    out
}

/// What stands between the bracket at the beginning and its partner.
fn inside(tokens: &[String]) -> &[String] {
    let end = depths(tokens).skip(1).position(|depth| depth == 0).unwrap_or(tokens.len());
    tokens.get(1..end).unwrap_or_default()
}

/// How many brackets are open before each token, and after the last one.
fn depths(tokens: &[String]) -> impl Iterator<Item = usize> {
    let change = |(i, token): (usize, &String)| match token.as_str() {
        "(" | "[" | "{" | "<" => 1,
        ")" | "]" | "}" => -1,
        // Not that of `->`.
        ">" if i == 0 || tokens[i - 1] != "-" => -1,
        _ => 0,
    };
    let mut depth = 0_isize;
    std::iter::once(0).chain(tokens.iter().enumerate().map(change)).map(move |change| {
        depth += change;
        depth.max(0).unsigned_abs()
    })
}

/// Parts between a sign that is in no bracket; nothing follows a last one.
fn split<'a>(tokens: &'a [String], sign: &str) -> Vec<&'a [String]> {
    let signs = depths(tokens).zip(tokens).enumerate().filter(|(_, (depth, token))| *depth == 0 && *token == sign);
    let (mut out, mut begin) = (Vec::new(), 0);
    for (at, _) in signs {
        out.push(&tokens[begin..at]);
        begin = at + 1;
    }
    if begin < tokens.len() || !out.is_empty() {
        out.push(&tokens[begin..]);
    }
    out
}

#[test]
fn tuples_are_found_among_parameters() {
    let source = "impl X { fn a<T: Into<(u8, u8)>, F: Fn(T) -> u8>(&self, x: (u32,\n u32), (y, z): (T, T), f: &mut impl Fn(u8, u8)) {} }
                  fn b<'a>(x: &'a (u8, [u8; 2]), y: &mut (A, B<C, D>), s: &[(u8, u8)], o: Option<(u8, u8)>, f: fn(u8, u8)) {}
                  fn c(e: &(dyn Error + 'a), u: (), f: &(impl Fn(u8, u8) -> (u8, u8) + Sync), g: [u8; 2],) -> (u8, u8) {}
                  #[cfg(test)] mod tests { use super::*; fn d(x: (u8, u8)) {} } fn e(last: (u8,)) {}";
    let all = parameters(&without_tests(&tokens(source)).0);
    let found: Vec<&str> = all.iter().filter(|(.., is_tuple)| *is_tuple).map(|(_, name, _)| name.as_str()).collect();
    assert_eq!((all.len(), found), (13, vec!["x", "(y,z)", "x", "y", "last"]));
}

/// What breaks a rule is what the list says: nothing new, and what was mended or became smaller is taken out or corrected.
fn shrinks(found: &BTreeSet<(String, String, usize)>, known: &[(&str, &str, usize)]) {
    let known: BTreeSet<(String, String, usize)> =
        known.iter().map(|(path, name, size)| ((*path).into(), (*name).into(), *size)).collect();
    let new: Vec<_> = found.difference(&known).collect();
    let gone: Vec<_> = known.difference(found).collect();
    assert!(
        new.is_empty(),
        "too large: {new:?}; split them (the list may only shrink; listed and not found: {gone:?})"
    );
    assert!(gone.is_empty(), "mended, so take them out of the list: {gone:?}");
}

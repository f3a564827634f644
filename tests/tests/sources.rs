//! What the sources themselves must keep: every `unsafe` is in the list that was read, every property takes its number of
//! cases from one place.

use std::collections::BTreeMap;
use std::fs;
use tests::sources::{code, root, sources};

/// How often a word stands in code.
fn count(code: &str, word: &str) -> usize {
    code.split(|c: char| !c.is_alphanumeric() && c != '_').filter(|w| *w == word).count()
}

#[test]
fn comments_and_strings_are_no_code() {
    let source = "unsafe { a } // unsafe\n/* unsafe */ let x = \"unsafe \\\" unsafe\"; let y = r#\"unsafe \" \"#; let q = '\"'; unsafe fn f() {}\n\
                  #![deny(unsafe_op_in_unsafe_fn)]";
    assert_eq!(count(&code(source), "unsafe"), 2, "{}", code(source));
}

#[test]
fn every_unsafe_is_in_the_list_that_was_read() {
    let page = fs::read_to_string(root().join("docs/UNSAFE.md")).unwrap();
    // Headings: ## `path` (number of times the word stands in its code)
    let listed: BTreeMap<String, usize> = page
        .lines()
        .filter_map(|line| {
            let (path, count) = line.strip_prefix("## `")?.split_once("` (")?;
            Some((path.to_owned(), count.strip_suffix(')')?.parse().ok()?))
        })
        .collect();
    let found: BTreeMap<String, usize> = sources()
        .iter()
        .map(|(path, source)| (path.clone(), count(&code(source), "unsafe")))
        .filter(|(_, count)| *count > 0)
        .collect();
    assert!(found.contains_key("float-core/src/simd.rs"), "the search finds nothing");
    for (path, count) in &found {
        let read = listed.get(path).copied().unwrap_or(0);
        assert!(
            read == *count,
            "{path} has {count} times `unsafe`, and docs/UNSAFE.md has {read}: read what is new, write down on what it relies, and \
             correct the number in the heading"
        );
    }
    for path in listed.keys() {
        assert!(found.contains_key(path), "docs/UNSAFE.md lists {path}, which has no `unsafe` any more");
    }
}

#[test]
fn every_property_takes_its_cases_from_one_place() {
    let mut properties = 0;
    for (path, source) in sources() {
        if path == "testkit/src/property.rs" || path == "tests/tests/sources.rs" {
            continue;
        }
        let code = code(&source);
        let number = |after: &str| after.starts_with(|c: char| c.is_ascii_digit());
        let own = ["with_cases(", "TestRunner::new(ProptestConfig", "TestRunner::default()"]
            .iter()
            .any(|own| code.contains(own))
            || code.contains("proptest") && code.split("cases: ").skip(1).any(number);
        assert!(!own, "{path} sets the number of its cases: take testkit::property::cases");
        for block in code.split("proptest!").skip(1) {
            // `proptest! {` only: not the import, not the closure form.
            let Some(inside) = block.trim_start().strip_prefix('{') else { continue };
            properties += 1;
            let inside = inside.trim_start();
            let takes = ["#![proptest_config(testkit::property::cases", "#![proptest_config(crate::property::cases"];
            assert!(
                takes.iter().any(|from| inside.starts_with(from)),
                "{path}: a block of properties does not begin with #![proptest_config(testkit::property::cases(n))]"
            );
        }
    }
    assert!(properties > 80, "{properties} blocks of properties found: the search is wrong");
}

#[test]
fn no_seed_is_set_for_everybody() {
    for name in ["config", "config.toml"] {
        let set = fs::read_to_string(root().join(".cargo").join(name)).unwrap_or_default();
        assert!(
            !set.contains("PROPTEST"),
            ".cargo/{name} sets variables of proptest for everybody; .ci/run does so for itself"
        );
    }
    let ci = fs::read_to_string(root().join(".ci/run")).unwrap();
    assert!(ci.contains("export PROPTEST_RNG_SEED="), "the gate draws other cases in every run");
}

/// The first block of code behind a line that begins with `fence`, without the lines that documentation hides.
fn example<'a>(lines: impl Iterator<Item = &'a str>, fence: &str) -> Vec<&'a str> {
    let mut lines = lines.skip_while(|line| !line.starts_with(fence));
    let inside = lines.by_ref().skip(1).take_while(|line| !line.starts_with("```"));
    inside.filter(|line| !line.starts_with("# ")).collect()
}

#[test]
fn a_crates_readme_shows_the_example_of_its_documentation() {
    let mut compared = 0;
    for folder in fs::read_dir(root()).unwrap().map(|entry| entry.unwrap().path()) {
        let (library, readme) = (folder.join("src/lib.rs"), folder.join("README.md"));
        let (Ok(library), Ok(readme)) = (fs::read_to_string(library), fs::read_to_string(readme)) else { continue };
        let docs = library
            .lines()
            .map_while(|line| line.strip_prefix("//!"))
            .map(|line| line.strip_prefix(' ').unwrap_or(line));
        let (want, got) = (example(docs, "```"), example(readme.lines(), "```rust"));
        if want.is_empty() {
            continue;
        }
        assert_eq!(got, want, "{}: the README's example differs from that of src/lib.rs", folder.display());
        compared += 1;
    }
    assert!(compared >= 4, "{compared} crates with a README");
}

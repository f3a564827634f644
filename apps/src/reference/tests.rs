//! The documents are those that the programs would write.

use super::{MARKS, RENEW, between_marks, pages};
use crate::app::{DYNAMIC, STATIC, WILD};
use crate::cli::{Cli, default_system};
use std::path::Path;
use systems::registry::{Family, PartWords};

#[test]
fn documents_are_as_the_programs_would_write_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    for page in pages(&root).unwrap() {
        let line = page.is.lines().zip(page.should.lines()).position(|(is, should)| is != should);
        let line = line.unwrap_or_else(|| page.is.lines().count().min(page.should.lines().count())) + 1;
        assert!(page.is == page.should, "{} is stale from line {line} on: run `{RENEW}` to renew it", page.path);
    }
}

#[test]
fn the_page_of_the_command_line_has_every_word_and_every_system() {
    let page = super::cli::page();
    let mut seen = 0;
    for app in [&STATIC, &WILD, &DYNAMIC] {
        for command in Cli::of(app).get_subcommands().filter(|command| !command.is_hide_set()) {
            let (_, section) = page.split_once(&format!("\n## {}\n", command.get_name())).unwrap();
            let section = section.split("\n## ").next().unwrap();
            let (_, data) = page.split_once("\n## Reading a dataset\n").unwrap();
            for arg in command.get_arguments().filter(|arg| !arg.is_hide_set()) {
                let Some(long) = arg.get_long() else { continue };
                let is_there = |text: &str| text.contains(&format!("| `--{long}"));
                let of_data = section.contains("(#reading-a-dataset)") && is_there(data);
                assert!(is_there(section) || of_data, "{} {} --{long}", app.name, command.get_name());
                seen += 1;
            }
        }
    }
    assert!(seen > 150, "{seen} options found: the search is broken");
    for entry in systems::registry::entries() {
        assert!(page.contains(&format!("* `{}`", entry.claim.name)), "{}", entry.claim.name);
    }
    assert!(!page.contains("--patience"), "a hidden option");
}

#[test]
fn pages_written_by_hand_say_what_help_says() {
    let page = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(name);
        std::fs::read_to_string(path).unwrap().split_whitespace().collect::<Vec<_>>().join(" ")
    };
    let (moving, default) = (page("moving.md"), default_system(Family::Moving));
    assert!(moving.contains(&format!("Without `--system` it is {default};")), "docs/moving.md: {default}");
    let wild = page("wild.md");
    let command = Cli::of(&WILD);
    let mut options = command.find_subcommand("train").into_iter().flat_map(|train| train.get_arguments());
    let help = options.find(|option| option.get_id() == "set").unwrap().get_long_help().unwrap().to_string();
    for words in [PartWords::of_fields(), PartWords::of_clouds()] {
        let listed =
            format!("`appearance={}` and `occluders={}`", words.appearance.join("|"), words.occluders.join("|"));
        assert!(wild.contains(&listed), "docs/wild.md: {listed}");
        assert!(help.contains(&listed), "{listed}: {help}");
    }
}

#[test]
fn tables_go_between_the_marks_and_nothing_else_changes() {
    let text = format!("a\n{}\nold\n{}\nz\n", MARKS[0], MARKS[1]);
    let new = between_marks(&text, "new\n").unwrap();
    assert_eq!(new, format!("a\n{}\n\nnew\n\n{}\nz\n", MARKS[0], MARKS[1]));
    assert_eq!(between_marks(&new, "new").unwrap(), new);
    assert!(between_marks("no marks", "new").is_none());
}

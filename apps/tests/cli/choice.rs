//! Which system is taken where none is named, and what the command line says about it.

use crate::tools::{SMALL, dataset, error_line, nerf, nerf_wild, text};
use std::fs;

#[test]
fn a_system_that_was_chosen_is_written_down_and_resumed() {
    let (folder, scene) = dataset();
    for (name, words, system, why) in [
        ("geometry", &["--for", "geometry"][..], "ngp", "for geometry"),
        ("few", &[], "ngp", "photos of"),
        ("field", &SMALL, "ngp", "is a setting of it alone"),
        ("cloud", &["--max-splats", "200"], "splat", "`max_splats` is a setting of it alone"),
    ] {
        let run = folder.path().join(name);
        let train = ["train", text(&scene), "--out", text(&run), "--steps", "2"];
        let answer = nerf(&[&train[..], words].concat());
        assert_eq!(answer.code, 0, "{}", answer.err);
        let line = answer.out.lines().find(|line| line.trim_start().starts_with("system: ")).unwrap_or_default();
        assert!(line.contains(&format!("system: {system} (")), "{name}: {}", answer.out);
        assert!(line.contains(why), "{name}: {line}");
        let config = fs::read_to_string(run.join("config.toml")).unwrap();
        assert!(config.contains(&format!("system = \"{system}\"")), "{config}");
        // Typed again with what it was for: the run keeps its system.
        let resumed = nerf(&["train", "--resume", "--for", "viewing", "--out", text(&run), "--steps", "3"]);
        assert_eq!(resumed.code, 0, "{}", resumed.err);
        assert!(resumed.out.contains(&format!("{system}: ")), "{}", resumed.out);
    }
}

#[test]
fn what_contradicts_itself_is_refused() {
    let (folder, scene) = dataset();
    let run = folder.path().join("run");
    let train = ["train", text(&scene), "--out", text(&run), "--steps", "1"];
    let both = nerf(&[&train[..], &["--max-splats", "200", "--set", "n_max=64"]].concat());
    assert_eq!(both.code, 1);
    assert!(error_line(&both).contains("max_splats") && error_line(&both).contains("--system"), "{}", both.err);
    for (words, part) in [(&["--for", "films"][..], "geometry"), (&["--for", "viewing", "--system", "ngp"], "--system")]
    {
        let answer = nerf(&[&train[..], words].concat());
        assert_eq!(answer.code, 2, "{}", answer.err);
        assert!(answer.err.contains(part), "{}", answer.err);
    }
    let wild = nerf_wild(&[&train[..], &["--for", "viewing"]].concat());
    assert_eq!(wild.code, 2);
    assert!(wild.err.contains("--for") && wild.err.contains("nerf-static"), "{}", wild.err);
}

//! The reader reads every golden file that is in the repository.

use std::path::Path;
use testkit::golden::Golden;

#[test]
fn every_golden_file_in_the_repository_is_read() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "json") {
            let golden = Golden::read(&path).unwrap();
            // `TOPIC.json`, or `TOPIC_PART.json` for a part of one.
            let stem = path.file_stem().unwrap().to_str().unwrap();
            let part =
                stem.strip_prefix(&golden.topic).unwrap_or_else(|| panic!("{stem} is of topic {}", golden.topic));
            assert!(part.is_empty() || part.starts_with('_'), "{stem} is of topic {}", golden.topic);
            assert!(!golden.records.is_empty());
            files += 1;
        }
    }
    assert!(files > 0, "no golden files");
}

#[test]
fn a_missing_file_is_named() {
    let message = Golden::read(Path::new("nowhere/x.json")).unwrap_err().to_string();
    assert!(message.contains("nowhere/x.json"), "{message}");
}

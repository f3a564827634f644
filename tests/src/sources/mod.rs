//! The sources of this repository, read by tests that hold how it is built.

mod imports;
mod tokens;

pub use imports::{Crate, Graph, circles, crates};
pub use tokens::{tokens, without_tests};

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The root of the repository.
#[must_use]
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Rust sources of the repository, by path from its root.
#[must_use]
pub fn sources() -> BTreeMap<String, String> {
    fn walk(folder: &Path, prefix: &str, out: &mut BTreeMap<String, String>) {
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let name = entry.file_name().into_string().unwrap();
            let path = format!("{prefix}{name}");
            if entry.file_type().unwrap().is_dir() {
                if name != "target" && !name.starts_with('.') {
                    walk(&entry.path(), &format!("{path}/"), out);
                }
            } else if name.ends_with(".rs") {
                out.insert(path, fs::read_to_string(entry.path()).unwrap());
            }
        }
    }
    let mut out = BTreeMap::new();
    walk(&root(), "", &mut out);
    assert!(out.len() > 300, "{} sources found: the walk is wrong", out.len());
    out
}

/// A source without its comments and the insides of its strings.
#[must_use]
pub fn code(source: &str) -> String {
    let (mut out, bytes, mut i) = (String::new(), source.as_bytes(), 0);
    while i < bytes.len() {
        let rest = &bytes[i..];
        if rest.starts_with(b"//") {
            i += rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
        } else if rest.starts_with(b"/*") {
            i += rest.windows(2).position(|w| w == b"*/").map_or(rest.len(), |n| n + 2);
        } else if rest.starts_with(b"'\"'") || rest.starts_with(b"'\\\"'") {
            i += if rest[1] == b'\\' { 4 } else { 3 };
        } else if rest[0] == b'"' {
            // Raw if `r` and hashes stand before it: then it ends at a quote with as many hashes.
            let hashes = bytes[..i].iter().rev().take_while(|&&b| b == b'#').count();
            let raw = i > hashes && bytes[i - hashes - 1] == b'r';
            let end = [b"\"".to_vec(), vec![b'#'; hashes]].concat();
            i += 1;
            while i < bytes.len() && !(bytes[i..].starts_with(if raw { &end } else { b"\"" })) {
                i += if !raw && bytes[i] == b'\\' { 2 } else { 1 };
            }
            i += 1;
            out.push_str("\"\"");
        } else {
            out.push(char::from(rest[0]));
            i += 1;
        }
    }
    out
}

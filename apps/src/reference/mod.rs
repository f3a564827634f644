//! Documents that are made of what the programs know: `docs/cli.md` of the command line, and the tables of systems in `README.md` of
//! the registry. `cargo run -p apps --example docs` writes them; a test fails when they are stale.

mod cli;
mod systems_tables;
mod table;

pub use table::RENEW;

use std::path::Path;
use std::{fs, io};

/// Lines of `README.md` between which the tables of systems stand.
const MARKS: [&str; 2] =
    ["<!-- systems: made from the registry by `cargo run -p apps --example docs` -->", "<!-- /systems -->"];

/// A document that is made: its path from the root of the repository, what stands there, and what should.
#[derive(Debug)]
pub struct Page {
    /// Its path, from the root.
    pub path: &'static str,
    /// What stands there; empty where there is no such file.
    pub is: String,
    /// What should stand there.
    pub should: String,
}

/// The documents below `root`, the root of the repository.
///
/// # Errors
/// When a file cannot be read, or `README.md` has lost the marks between which its tables stand.
pub fn pages(root: &Path) -> io::Result<Vec<Page>> {
    let path = root.join("docs/cli.md");
    let cli = if path.exists() { fs::read_to_string(path)? } else { String::new() };
    let readme = fs::read_to_string(root.join("README.md"))?;
    let renewed = between_marks(&readme, &systems_tables::page())
        .ok_or_else(|| io::Error::other(format!("README.md: no lines `{}` and `{}`", MARKS[0], MARKS[1])))?;
    Ok(vec![
        Page { path: "docs/cli.md", is: cli, should: cli::page() },
        Page { path: "README.md", is: readme, should: renewed },
    ])
}

/// A text with `inner` between the marks.
fn between_marks(text: &str, inner: &str) -> Option<String> {
    let (before, rest) = text.split_once(MARKS[0])?;
    let (_, after) = rest.split_once(MARKS[1])?;
    Some(format!("{before}{}\n\n{}\n\n{}{after}", MARKS[0], inner.trim(), MARKS[1]))
}

#[cfg(test)]
mod tests;

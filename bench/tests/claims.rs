//! What README and documents say of systems named after papers is what the code says.

use std::fs;
use std::path::{Path, PathBuf};
use systems::claims::Claim;

/// All systems that bear a paper's name.
fn claims() -> Vec<Claim> {
    systems::registry::entries().iter().map(|entry| entry.claim).filter(Claim::is_of_a_paper).collect()
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// The cells of a row of a Markdown table; none for other lines and for rules.
fn cells(line: &str) -> Vec<&str> {
    match line.strip_prefix('|').and_then(|rest| rest.strip_suffix('|')) {
        Some(row) if !line.starts_with("| ---") => row.split('|').map(str::trim).collect(),
        _ => Vec::new(),
    }
}

/// The system that a cell begins with, and the rest of it.
fn system<'c>(cell: &'c str, claims: &[Claim]) -> Option<(Claim, &'c str)> {
    let text = cell.trim_start_matches(['*', '`']);
    let end = text.find(|c: char| !(c.is_ascii_alphanumeric() || c == '-')).unwrap_or(text.len());
    let claim = claims.iter().find(|claim| claim.name == &text[..end])?;
    Some((*claim, text[end..].trim_start_matches(['*', '`'])))
}

/// The claim of a system whose row has this mark: that of the published networks where it is theirs.
fn of_row(claim: Claim, mark: &str) -> Claim {
    let networks = systems::registry::find(claim.name).and_then(|entry| entry.on_networks);
    networks.filter(|networks| mark.starts_with(networks.mark)).unwrap_or(claim)
}

/// A figure follows the name: the cell is one of a comparison, not a row's name.
fn is_figure(rest: &str) -> bool {
    rest.trim_start_matches([' ', '*']).starts_with(|c: char| c.is_ascii_digit() || c == '-')
        || ["missed", "above"].iter().any(|word| rest.trim().starts_with(word))
}

#[test]
fn readme_has_a_row_for_each_system_with_what_differs() {
    let text = read(&root().join("README.md"));
    let (_, tables) = text.split_once("\n## Systems\n").expect("a section of systems");
    let tables = tables.split("\n## ").next().unwrap();
    for claim in claims() {
        let rows: Vec<Vec<&str>> =
            tables.lines().map(cells).filter(|c| c.first() == Some(&&*format!("`{}`", claim.name))).collect();
        assert_eq!(rows.len(), 1, "{}: rows in README", claim.name);
        let has = |what: &str| rows[0].contains(&what);
        assert!(has(claim.mark) && has(claim.paper), "{}: `{}` in {:?}", claim.name, claim.mark, rows[0]);
    }
}

#[test]
fn results_mark_every_row_and_column_named_after_a_paper() {
    let (claims, text) = (claims(), read(&root().join("docs/RESULTS.md")));
    let mut seen = 0;
    for line in text.lines() {
        for cell in cells(line) {
            let Some((claim, rest)) = system(cell, &claims) else { continue };
            let names = rest.is_empty() || rest.starts_with([' ', ',', ':', '(']);
            if !names || is_figure(rest) {
                continue;
            }
            seen += 1;
            let claim = of_row(claim, rest.trim_start_matches([' ', '(']));
            // What was otherwise then is said where it was.
            assert!(
                rest.starts_with(&format!(" ({}", claim.mark)) || rest.contains("squares"),
                "no mark of {}: {line}",
                claim.name
            );
        }
    }
    assert!(seen > 80, "{seen} rows found: the search is broken");
}

#[test]
fn pages_mark_their_rows_and_say_in_full_what_differs() {
    let claims = claims();
    let (mut rows, mut pages) = (0, 0);
    for entry in fs::read_dir(root().join("docs/bench")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "md") {
            continue;
        }
        let text = read(&path);
        let mut columns: Option<(usize, usize)> = None;
        let mut told = false;
        for line in text.lines() {
            let cells = cells(line);
            if cells.is_empty() {
                if !line.starts_with('|') {
                    columns = None;
                }
                continue;
            }
            let at = |name: &str| cells.iter().position(|c| *c == name);
            if let Some(found) = at("system").zip(at("not as published")) {
                (columns, told) = (Some(found), true);
                continue;
            }
            let Some((name, mark)) = columns else { continue };
            let Some((claim, _)) = system(cells[name], &claims) else { continue };
            rows += 1;
            let claim = of_row(claim, cells[mark]);
            assert!(cells[mark].starts_with(claim.mark), "{}: {line}", path.display());
            let full = format!("* `{}` ({}): {}", claim.name, claim.paper, claim.differs);
            assert!(text.lines().any(|l| l == full), "{}: no line `{full}`", path.display());
        }
        pages += usize::from(told);
    }
    assert!(pages >= 10 && rows > 60, "{pages} pages, {rows} rows: the search is broken");
}

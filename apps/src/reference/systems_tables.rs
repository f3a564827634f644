//! The tables of systems in `README.md`.

use super::table::Table;
use crate::cli::default_system;
use systems::registry::{Entry, Family, Needs, entries};

/// Each family, its heading, its app, and what else is said of it.
const FAMILIES: [(Family, &str, &str, &str); 3] = [
    (Family::Static, "For scenes that stand still", "nerf-static", ""),
    (
        Family::Wild,
        "For photos of many people",
        "nerf-wild",
        " They work on the field of `ngp`, but for `wild-gaussians`, `gs-w`, `wild-gs`, `spotless` and `degauss`, which are clouds, and the \
         column *not as published* is about that; `--field mlp` is nearer to the papers and takes hours.",
    ),
    (
        Family::Moving,
        "For scenes that move",
        "nerf-dynamic",
        " They work on the field of `ngp`, but for `tineuvox` and `k-planes`, which have their own, and `4dgs` and `degauss`, clouds.",
    ),
];

/// A table for each family. A system stands where its first family is; the others name it.
pub(super) fn page() -> String {
    FAMILIES
        .map(|(family, heading, app, about)| {
            let default = default_system(family);
            let (table, above) = (table(family), above(family));
            format!("### {heading}\n\n`{app}`; without `--system`, {default}.{about}\n\n{table}{above}")
        })
        .join("\n")
}

/// A line with the systems of the family that stand in the table of another.
fn above(family: Family) -> String {
    let is_here = |entry: &&Entry| entry.families.contains(&family) && entry.families.first() != Some(&family);
    let names: Vec<String> = entries().iter().filter(is_here).map(|entry| format!("`{}`", entry.claim.name)).collect();
    if names.is_empty() { String::new() } else { format!("\nFrom the tables above: {}.\n", names.join(", ")) }
}

fn table(family: Family) -> String {
    let mut table = Table::new(&["`--system`", "what it is", "take it for", "not as published", "needs", "paper"]);
    for entry in entries().iter().filter(|entry| entry.families.first() == Some(&family)) {
        let claim = entry.claim;
        let said = |text: &str| if text.is_empty() { "-".to_owned() } else { text.to_owned() };
        table.row([
            format!("`{}`", claim.name),
            claim.what.into(),
            claim.take.into(),
            said(claim.mark),
            needs(entry),
            said(claim.paper),
        ]);
    }
    table.text()
}

/// What a system needs from a scene.
pub(super) fn needs(entry: &Entry) -> String {
    let needs = match entry.needs {
        Needs::Photos => "photos",
        Needs::Times => "photos with times",
    };
    let moves = entry.needs == Needs::Photos && entry.families.contains(&Family::Moving);
    format!("{needs}{}", if moves { ", with times or without" } else { "" })
}

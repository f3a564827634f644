//! What rows named after papers are not: from [`systems::claims`], in each row and below the tables.

use crate::page::Item;
use crate::table::Cell;
use systems::claims::Claim;
use systems::registry;

/// What is claimed of a system.
fn find(name: &str) -> Option<Claim> {
    registry::find(name).map(|entry| entry.claim)
}

/// The column that says it.
pub(crate) const COLUMN: &str = "not as published";

/// What a system does otherwise than its paper, in a few words; `set`: settings of the row besides.
pub(crate) fn mark(system: &str, set: &str) -> Cell {
    match find(system).filter(Claim::is_of_a_paper) {
        None => Cell::Missing,
        Some(claim) if set.is_empty() => claim.mark.into(),
        Some(claim) => format!("{}, but for settings of the row", claim.mark).into(),
    }
}

/// The same in full for each system of a page, once; nothing without any.
pub(crate) fn note<'a>(systems: impl IntoIterator<Item = &'a str>) -> Option<Item> {
    let mut claims: Vec<Claim> = Vec::new();
    for claim in systems.into_iter().filter_map(find).filter(Claim::is_of_a_paper) {
        if !claims.contains(&claim) {
            claims.push(claim);
        }
    }
    let lines: Vec<String> = claims.iter().map(|c| format!("* `{}` ({}): {}", c.name, c.paper, c.differs)).collect();
    (!lines.is_empty()).then(|| {
        let head = "Names are those of the systems here. What each does otherwise than the paper it is named after:";
        Item::Text(format!("{head}\n\n{}", lines.join("\n")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn papers_names_are_marked_and_told_of_once() {
        assert_eq!(mark("plain", ""), Cell::Missing);
        let Cell::Text(text) = mark("hugs", "") else { panic!("a mark") };
        assert!(text.contains("not HuGS"), "{text}");
        assert!(
            matches!(mark("hugs", "restart = 'anew'"), Cell::Text(t) if t.ends_with(", but for settings of the row"))
        );
        let Some(Item::Text(text)) = note(["plain", "hugs", "ngp", "hugs"]) else { panic!("a note") };
        assert_eq!(text.matches("* `").count(), 2, "{text}");
        assert!(text.contains(find("hugs").unwrap().differs));
        assert!(note(["plain", "auto"]).is_none());
    }
}

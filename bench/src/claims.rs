//! What rows named after papers are not: from [`systems::claims`], in each row and below the tables.

use crate::page::Item;
use crate::table::Cell;
use systems::claims::Claim;
use systems::registry;

/// A system with its settings.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Named<'a> {
    pub(crate) system: &'a str,
    /// TOML.
    pub(crate) set: &'a str,
}

impl<'a> From<&'a str> for Named<'a> {
    fn from(system: &'a str) -> Self {
        Self { system, set: "" }
    }
}

/// What is claimed of a system with its settings, and whether others of these are left than the one that chooses the claim.
fn find(named: Named<'_>) -> Option<(Claim, bool)> {
    let entry = registry::find(named.system)?;
    let set: toml::Table = named.set.parse().unwrap_or_default();
    let claim = entry.claim_with(&set);
    let others = set.keys().filter(|key| claim == entry.claim || *key != FIELD).count();
    Some((claim, others > 0))
}

/// The setting by which a system has another claim.
const FIELD: &str = "field";

/// The column that says it.
pub(crate) const COLUMN: &str = "not as published";

/// What a system does otherwise than its paper, in a few words; `set`: settings of the row besides.
pub(crate) fn mark(system: &str, set: &str) -> Cell {
    match find(Named { system, set }).filter(|(claim, _)| claim.is_of_a_paper()) {
        None => Cell::Missing,
        Some((claim, false)) => claim.mark.into(),
        Some((claim, true)) => format!("{}, but for settings of the row", claim.mark).into(),
    }
}

/// The same in full for each system of a page, once; nothing without any.
pub(crate) fn note<'a, N: Into<Named<'a>>>(systems: impl IntoIterator<Item = N>) -> Option<Item> {
    let mut claims: Vec<Claim> = Vec::new();
    let found = systems.into_iter().filter_map(|named| find(named.into()));
    for (claim, _) in found.filter(|(claim, _)| claim.is_of_a_paper()) {
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
        assert!(text.contains(find("hugs".into()).unwrap().0.differs));
        assert!(note(["plain", "auto"]).is_none());
    }

    #[test]
    fn a_system_on_the_published_networks_has_a_mark_and_a_line_of_its_own() {
        let text = |set: &str| match mark("d-nerf", set) {
            Cell::Text(text) => text,
            other => panic!("a mark, not {other:?}"),
        };
        let (hybrid, published) = (text(""), text("field = 'mlp'"));
        assert!(hybrid.contains("hybrid") && published.contains("published networks"), "{hybrid}, {published}");
        assert_eq!(text("field = 'mlp'\norigin = 'exact'"), format!("{published}, but for settings of the row"));
        assert_eq!(text("field = 'ngp'"), format!("{hybrid}, but for settings of the row"));
        let rows = ["", "field = 'mlp'", "field = 'mlp'\nseed = 1"].map(|set| Named { system: "d-nerf", set });
        let Some(Item::Text(text)) = note(rows) else { panic!("a note") };
        let lines = ["* `d-nerf`", "* `d-nerf, field=mlp`"].map(|line| text.matches(line).count());
        assert_eq!(lines, [1, 1], "{text}");
    }
}

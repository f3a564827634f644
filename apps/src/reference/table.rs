//! Tables of Markdown, and the command that renews the documents they stand in.

/// What renews the documents.
pub const RENEW: &str = "cargo run -p apps --example docs";

/// A table of Markdown.
pub(super) struct Table(String);

impl Table {
    pub(super) fn new(heads: &[&str]) -> Self {
        let mut table = Self(String::new());
        table.row(heads.iter().map(ToString::to_string));
        table.row(heads.iter().map(|_| "---".into()));
        table
    }

    /// Add a row. A bar within a cell would end it.
    pub(super) fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        let cells: Vec<String> = cells.into_iter().map(|cell| cell.replace('|', "\\|")).collect();
        self.0.push_str(&format!("| {} |\n", cells.join(" | ")));
    }

    pub(super) fn text(self) -> String {
        self.0
    }
}

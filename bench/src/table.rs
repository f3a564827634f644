//! Tables of measured numbers: Markdown for people, CSV for programs.

use crate::error::BenchError;

/// One entry.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Cell {
    /// Words.
    Text(String),
    /// A finite number.
    Number(f64),
    /// A finite number of decibels: two decimals.
    Decibels(f64),
    /// Not measured, or nothing to say: `-`, empty in CSV.
    Missing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(x: f64) -> Self {
        Self::Number(x)
    }
}

impl From<usize> for Cell {
    fn from(n: usize) -> Self {
        Self::Number(n as f64)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(x: Option<T>) -> Self {
        x.map_or(Self::Missing, Into::into)
    }
}

/// Rows of the same columns.
#[derive(Clone, Debug)]
pub(crate) struct Table {
    /// Stem of the CSV file.
    pub(crate) name: &'static str,
    /// What is in it.
    pub(crate) caption: &'static str,
    columns: Vec<&'static str>,
    rows: Vec<Vec<Cell>>,
}

impl Table {
    pub(crate) fn new(name: &'static str, caption: &'static str, columns: &[&'static str]) -> Self {
        Self { name, caption, columns: columns.to_vec(), rows: Vec::new() }
    }

    /// Append a row; as many cells as columns.
    pub(crate) fn row<const N: usize>(&mut self, cells: [Cell; N]) -> Result<(), BenchError> {
        assert_eq!(N, self.columns.len(), "{}: a row has one cell a column", self.name);
        for (cell, column) in cells.iter().zip(&self.columns) {
            if let Cell::Number(value) | Cell::Decibels(value) = *cell
                && !value.is_finite()
            {
                return Err(BenchError::NonFinite {
                    table: self.name.into(),
                    column: (*column).into(),
                    row: cells.first().map(markdown).unwrap_or_default(),
                    value,
                });
            }
        }
        self.rows.push(cells.to_vec());
        Ok(())
    }

    /// Decibels where they are known.
    pub(crate) fn decibels(x: Option<f64>) -> Cell {
        x.map_or(Cell::Missing, Cell::Decibels)
    }

    /// Whether there is no row.
    pub(crate) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The columns in which anything was measured; all of a table without rows.
    pub(crate) fn without_empty_columns(mut self) -> Self {
        let told = |c: &usize| self.rows.is_empty() || self.rows.iter().any(|r| r[*c] != Cell::Missing);
        let kept: Vec<usize> = (0..self.columns.len()).filter(told).collect();
        self.columns = kept.iter().map(|&c| self.columns[c]).collect();
        self.rows = self.rows.into_iter().map(|row| kept.iter().map(|&c| row[c].clone()).collect()).collect();
        self
    }

    /// A Markdown table; numbers right-aligned.
    pub(crate) fn markdown(&self) -> String {
        let numeric = |c: usize| self.rows.iter().any(|r| matches!(r[c], Cell::Number(_) | Cell::Decibels(_)));
        let rule: Vec<&str> = (0..self.columns.len()).map(|c| if numeric(c) { "---:" } else { "---" }).collect();
        let mut text = format!("| {} |\n| {} |\n", self.columns.join(" | "), rule.join(" | "));
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(markdown).collect();
            text += &format!("| {} |\n", cells.join(" | "));
        }
        text
    }

    /// The same with a header line, values with six digits.
    pub(crate) fn csv(&self) -> String {
        let mut text = self.columns.iter().map(|c| quoted(c)).collect::<Vec<_>>().join(",") + "\n";
        for row in &self.rows {
            let cells: Vec<String> = row
                .iter()
                .map(|cell| match cell {
                    Cell::Text(t) => quoted(t),
                    Cell::Number(x) | Cell::Decibels(x) => plain(*x, 6),
                    Cell::Missing => String::new(),
                })
                .collect();
            text += &(cells.join(",") + "\n");
        }
        text
    }
}

fn markdown(cell: &Cell) -> String {
    match cell {
        Cell::Text(text) => text.replace('|', "\\|"),
        Cell::Number(x) => number(*x),
        Cell::Decibels(x) => format!("{x:.2}"),
        Cell::Missing => "-".into(),
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.into() }
}

/// Three digits: `12.3`, `4560`, `1.2e-7`.
pub(crate) fn number(x: f64) -> String {
    plain(x, 3)
}

/// So many significant digits, without an exponent from 1e-3 to 1e7; whole numbers in full.
fn plain(x: f64, digits: i32) -> String {
    if x == 0.0 {
        return "0".into();
    }
    let magnitude = x.abs().log10().floor() as i32;
    if x.fract() == 0.0 && magnitude < 7 {
        return format!("{x:.0}");
    }
    if !(-3..7).contains(&magnitude) {
        return format!("{x:.*e}", (digits - 1).max(0) as usize);
    }
    format!("{x:.*}", (digits - 1 - magnitude).max(0) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        assert_eq!(
            [0.0, 12.345, 0.012345, 1.2345e-7, 4567.8, 3.0, 65_536.0, 1e9].map(number),
            ["0", "12.3", "0.0123", "1.23e-7", "4568", "3", "65536", "1.00e9"]
        );
    }

    #[test]
    fn tables_are_written_twice_and_refuse_what_is_no_number() {
        let mut table = Table::new("t", "c", &["what", "x"]);
        table.row(["a, \"b\"".into(), 1.5.into()]).unwrap();
        table.row(["c|d".into(), Table::decibels(None)]).unwrap();
        assert_eq!(table.csv(), "what,x\n\"a, \"\"b\"\"\",1.50000\nc|d,\n");
        assert_eq!(table.markdown(), "| what | x |\n| --- | ---: |\n| a, \"b\" | 1.50 |\n| c\\|d | - |\n");
        let error = table.row(["bad".into(), f64::NAN.into()]).unwrap_err();
        assert_eq!(error.to_string(), "t: x of `bad` is NaN, which is not a result");
        assert_eq!(table.csv().lines().count(), 3);
        table.row(["e".into(), Table::decibels(Some(31.125_4))]).unwrap();
        assert!(table.markdown().ends_with("| e | 31.13 |\n") && table.csv().ends_with("e,31.1254\n"));
    }

    #[test]
    fn columns_without_anything_are_left_out() {
        let mut table = Table::new("t", "c", &["a", "b", "c"]);
        assert_eq!(table.clone().without_empty_columns().csv(), "a,b,c\n");
        table.row(["x".into(), Cell::Missing, Cell::Missing]).unwrap();
        table.row(["y".into(), Cell::Missing, 2.0.into()]).unwrap();
        assert_eq!(table.without_empty_columns().csv(), "a,c\nx,\ny,2\n");
    }
}

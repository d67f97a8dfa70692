//! Text tables for people: the first column is left-aligned, the others right-aligned.

use std::fmt::Write;

/// Rows of cells. The first row is the head.
#[derive(Default)]
pub struct TextTable {
    rows: Vec<Vec<String>>,
}

impl TextTable {
    /// A table with this head and no rows.
    pub fn new<S: Into<String>>(head: impl IntoIterator<Item = S>) -> Self {
        Self { rows: vec![head.into_iter().map(Into::into).collect()] }
    }

    /// Adds a row.
    pub fn add_row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// True if there are no rows below the head.
    pub fn is_empty(&self) -> bool {
        self.rows.len() < 2
    }

    /// The table as text. Each line is indented by two spaces and ends with a line feed.
    pub fn to_text(&self) -> String {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |column: usize| {
            self.rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            for (index, (cell, width)) in row.iter().zip(&widths).enumerate() {
                let _ = match index {
                    0 => write!(line, "  {cell:<width$}"), // writing to a string cannot fail
                    _ => write!(line, "  {cell:>width$}"),
                };
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_right_aligned() {
        let mut table = TextTable::new(["feature", "mm²"]);
        table.add_row(["path", "3"]);
        table.add_row(["économie", "1234.5"]);
        assert_eq!(table.to_text(), "  feature      mm²\n  path           3\n  économie  1234.5\n");
    }
}

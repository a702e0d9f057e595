//! Tables of numbers: written as CSV, JSON and Markdown with the same digits.

use crate::lab::plot::short;
use serde_json::{Value, json};
use std::fmt::Write;

/// One cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Unknown.
    Empty,
    /// Text.
    Text(String),
    /// A number, rounded to five digits.
    Number(f64),
}

impl From<f64> for Cell {
    fn from(value: f64) -> Self {
        if !value.is_finite() {
            return Self::Empty;
        }
        // Integers stay exact.
        let rounded = || format!("{value:.4e}").parse().unwrap_or(value);
        Self::Number(if value.fract() == 0.0 { value } else { rounded() })
    }
}

impl From<Option<f64>> for Cell {
    fn from(value: Option<f64>) -> Self {
        value.map_or(Self::Empty, Self::from)
    }
}

impl From<usize> for Cell {
    fn from(value: usize) -> Self {
        Self::Number(value as f64)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.into())
    }
}

/// One table of the report.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Name of its files.
    pub name: &'static str,
    /// Headline.
    pub title: String,
    /// Description of the measurement, in sentences.
    pub how: String,
    /// Quantity and unit of each column.
    pub columns: Vec<String>,
    /// Rows, each with as many cells as there are columns.
    pub rows: Vec<Vec<Cell>>,
    /// Skipped points and the reasons, one sentence each.
    pub skipped: Vec<String>,
}

impl Table {
    /// A table without rows.
    pub fn new(name: &'static str, title: &str, how: String, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|c| (*c).to_owned()).collect();
        Self { name, title: title.into(), how, columns, ..Self::default() }
    }

    /// Adds a row.
    pub fn push(&mut self, row: Vec<Cell>) {
        assert_eq!(row.len(), self.columns.len(), "{}: a row of another length", self.name);
        self.rows.push(row);
    }

    /// The number of a row in the column of this name.
    pub fn number(&self, row: usize, column: &str) -> Option<f64> {
        match self.rows.get(row)?.get(self.columns.iter().position(|c| c == column)?)? {
            Cell::Number(value) => Some(*value),
            _ => None,
        }
    }

    /// Values of two columns, for rows where both are known and positive and `wanted` holds.
    pub fn pairs(&self, x: &str, y: &str, wanted: impl Fn(usize) -> bool) -> Vec<(f64, f64)> {
        let known = |row| Some((self.number(row, x)?, self.number(row, y)?));
        let all = (0..self.rows.len()).filter(|row| wanted(*row)).filter_map(known);
        all.filter(|(x, y)| *x > 0.0 && *y > 0.0).collect()
    }

    /// Whether a row contains this text.
    pub fn has(&self, row: usize, word: &str) -> bool {
        self.rows[row].iter().any(|cell| matches!(cell, Cell::Text(text) if text == word))
    }

    /// Comma-separated values; unknown cells are empty.
    pub fn csv(&self) -> String {
        let line = |cells: Vec<String>| cells.join(",") + "\n";
        let mut csv = line(self.columns.clone());
        for row in &self.rows {
            csv += &line(row.iter().map(|cell| cell.full()).collect());
        }
        csv
    }

    /// The same as JSON; unknown cells are null.
    pub fn json(&self) -> Value {
        let value = |cell: &Cell| match cell {
            Cell::Empty => Value::Null,
            Cell::Text(text) => json!(text),
            Cell::Number(number) => json!(number),
        };
        let rows: Vec<Vec<Value>> = self.rows.iter().map(|row| row.iter().map(value).collect()).collect();
        json!({
            "name": self.name, "title": self.title, "how": self.how, "columns": self.columns, "rows": rows,
            "skipped": self.skipped,
        })
    }

    /// Title, description, the table with three significant digits, and the skipped points.
    pub fn markdown(&self) -> String {
        let mut text = format!("## {}\n\n{}\n\n", self.title, self.how);
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        text += &line(self.columns.clone());
        text += &line(vec!["---".into(); self.columns.len()]);
        for row in &self.rows {
            text += &line(row.iter().map(Cell::brief).collect());
        }
        for skipped in &self.skipped {
            let _ = write!(text, "\nLeft out: {skipped}\n");
        }
        text
    }
}

impl Cell {
    fn full(&self) -> String {
        match self {
            Self::Empty => String::new(),
            Self::Text(text) => text.clone(),
            Self::Number(number) => format!("{number}"),
        }
    }

    fn brief(&self) -> String {
        match self {
            Self::Empty => "-".into(),
            Self::Number(number) if number.fract() != 0.0 => short(*number),
            _ => self.full(),
        }
    }
}

/// Exponent of a power law: slope of the least squares line through the logarithms of points. `None` for fewer than two
/// distinct x.
pub fn exponent(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = points.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let mean = |part: fn(&(f64, f64)) -> f64| logs.iter().map(part).sum::<f64>() / count;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let spread: f64 = logs.iter().map(|p| (p.0 - x).powi(2)).sum();
    (spread > 1e-9).then(|| logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>() / spread)
}

/// Least squares plane z = a + b x + c y through points, as [a, b, c]; for logarithms b and c are the exponents of a
/// power law in two quantities. `None` if the points are collinear.
pub fn power_law(points: &[[f64; 3]]) -> Option<[f64; 3]> {
    let count = points.len() as f64;
    let mean = [0, 1, 2].map(|i| points.iter().map(|p| p[i]).sum::<f64>() / count);
    let product = |i: usize, j: usize| points.iter().map(|p| (p[i] - mean[i]) * (p[j] - mean[j])).sum::<f64>();
    let (xx, xy, yy) = (product(0, 0), product(0, 1), product(1, 1));
    let determinant = xx * yy - xy * xy;
    if determinant.is_nan() || determinant <= 1e-9 * (xx * yy).max(1e-9) {
        return None;
    }
    let b = (product(0, 2) * yy - product(1, 2) * xy) / determinant;
    let c = (product(1, 2) * xx - product(0, 2) * xy) / determinant;
    Some([mean[2] - b * mean[0] - c * mean[1], b, c])
}

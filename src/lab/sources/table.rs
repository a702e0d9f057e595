//! Figures of the chain, and their presentation.

use glam::DVec3;

use crate::metrics::metrics;

/// Differences between two pictures; all relative to the mean of the reference, except `mare`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Mean absolute relative error of the first picture against the second, as `Metrics::mare`.
    pub mare: f64,
    /// Mean absolute difference.
    pub mae: f64,
    /// Root mean square difference.
    pub rmse: f64,
    /// Mean difference, first minus second. The steps of a chain add up to the whole.
    pub bias: f64,
}

impl Figures {
    /// Compares two pictures; `truth` gives the mean. All 0 if `truth` is black.
    pub fn of(first: &[DVec3], second: &[DVec3], truth: &[DVec3]) -> Self {
        let mean = truth.iter().map(|p| p.element_sum()).sum::<f64>();
        if mean <= 0.0 {
            return Self { mare: 0.0, mae: 0.0, rmse: 0.0, bias: 0.0 };
        }
        let narrow = |picture: &[DVec3]| -> Vec<[f32; 3]> { picture.iter().map(|p| p.as_vec3().to_array()).collect() };
        let sum = |of: fn(DVec3) -> f64| first.iter().zip(second).map(|(a, b)| of(*a - *b)).sum::<f64>();
        let n = 3.0 * truth.len() as f64;
        Self {
            mare: metrics(&narrow(first), &narrow(second)).mare,
            mae: sum(|d| d.abs().element_sum()) / mean,
            rmse: (sum(DVec3::length_squared) * n).sqrt() / mean,
            bias: sum(DVec3::element_sum) / mean,
        }
    }
}

/// Share of the squared error between `first` and `last` due to the step from `before` to `after`:
/// `<before - after, first - last> / |first - last|^2`. The shares of all steps add up to 1; a step that undoes others
/// has a negative one.
pub fn square_share(before: &[DVec3], after: &[DVec3], first: &[DVec3], last: &[DVec3]) -> f64 {
    let whole = first.iter().zip(last).map(|(a, b)| *a - *b);
    let total: f64 = whole.clone().map(DVec3::length_squared).sum();
    let along: f64 = before.iter().zip(after).zip(whole).map(|((a, b), whole)| (*a - *b).dot(whole)).sum();
    if total > 0.0 { along / total } else { 0.0 }
}

/// One approximation.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the approximation.
    pub name: String,
    /// Change when it is replaced after all approximations above it.
    pub change: Figures,
    /// Its mean absolute change, relative to the sum over all steps.
    pub share: f64,
    /// Its share of the whole squared error, see [`square_share`].
    pub square_share: f64,
    /// Error of the engine against the reference with only this approximation replaced.
    pub alone: Option<Figures>,
}

/// All results for one lobe.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Name of the lobe: diffuse or glossy.
    pub lobe: String,
    /// Steps from the engine to the reference: one bounce, path-traced.
    pub rows: Vec<Row>,
    /// Further steps: light paths that the method does not include.
    pub beyond: Vec<Row>,
    /// The engine against the reference.
    pub whole: Figures,
    /// Noise of the path-traced pictures without and with shadows.
    pub noise: [Figures; 2],
}

/// Column titles and their meaning.
pub const COLUMNS: [(&str, &str); 8] = [
    ("made exact", "approximation that is replaced, in addition to all above it"),
    ("MARE", "mean absolute relative error of the picture before against the one after"),
    ("RMSE", "root mean square change, relative to the truth's mean"),
    ("bias", "mean change, relative to the truth's mean; the steps add up to the whole"),
    ("share", "mean absolute change, relative to the sum over all steps"),
    ("of squares", "share of the whole squared error; adds up to 100 %, negative if a step undoes others"),
    ("alone: MARE", "error of the engine against the truth with only this approximation made exact"),
    ("alone: RMSE", "likewise"),
];

impl Table {
    /// Title row, one row per step, the whole, and the steps beyond; in percent.
    pub fn cells(&self) -> Vec<Vec<String>> {
        let percent = |v: f64| format!("{:.2} %", 100.0 * v);
        let signed = |v: f64| format!("{:+.2} %", 100.0 * v);
        let row = |row: &Row, shares: bool| {
            let change = row.change;
            let mut cells = vec![row.name.clone(), percent(change.mare), percent(change.rmse), signed(change.bias)];
            let shared = [percent(row.share), signed(row.square_share)];
            cells.extend(if shares { shared } else { ["", ""].map(str::to_owned) });
            cells.extend(row.alone.map_or(["", ""].map(str::to_owned), |f| [percent(f.mare), percent(f.rmse)]));
            cells
        };
        let mut cells = vec![COLUMNS.map(|column| column.0.to_owned()).to_vec()];
        cells.extend(self.rows.iter().map(|r| row(r, true)));
        let w = self.whole;
        let whole = [percent(w.mare), percent(w.rmse), signed(w.bias), String::new(), String::new()];
        cells.push(
            ["engine against the truth".into()]
                .into_iter()
                .chain(whole)
                .chain([percent(w.mare), percent(w.rmse)])
                .collect(),
        );
        cells.extend(self.beyond.iter().map(|r| row(r, false)).map(|mut cells| {
            cells[0] = format!("beyond: {}", cells[0]);
            cells
        }));
        cells
    }

    /// The same as a table in Markdown.
    pub fn markdown(&self) -> String {
        let line = |cells: &Vec<String>| format!("| {} |\n", cells.join(" | "));
        let cells = self.cells();
        let rule = format!("|{}\n", " --- |".to_owned() + &" ---: |".repeat(cells[0].len() - 1));
        line(&cells[0]) + &rule + &cells[1..].iter().map(line).collect::<String>()
    }
}

//! Small SVG plots: curves and scatter plots over logarithmic or named axes, legible on light and dark backgrounds.

use std::fmt::Write;

/// A plot.
pub struct Plot {
    /// Title.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis; logarithmic.
    pub y: Axis,
    /// Series in drawing order.
    pub series: Vec<Series>,
    /// Whether the Pareto front is joined, ringed and labelled: marks that no other mark beats in both x and y.
    pub front: bool,
    /// Width and height [CSS pixels].
    pub size: [f64; 2],
}

/// An axis: logarithmic, or with one position per name.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// Quantity and unit.
    pub label: String,
    /// Names of the values 0, 1, 2, ...; if empty the axis is logarithmic.
    pub names: Vec<String>,
}

/// Marks of one colour and shape.
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Its marks.
    pub marks: Vec<Mark>,
    /// Whether a line joins the marks.
    pub line: bool,
    /// Index of the colour, of `COLORS`.
    pub color: usize,
}

/// One mark. Values that an axis cannot show (zero, negative, not finite) are left out.
#[derive(Clone, Debug)]
pub struct Mark {
    /// Horizontal value.
    pub x: f64,
    /// Vertical value.
    pub y: f64,
    /// Shown next to marks of the front, and as a tooltip.
    pub label: String,
}

const STYLE: &str = include_str!("plot.css");

/// Number of colours in `STYLE`. Further series repeat them with other marks.
const COLORS: usize = 16;

/// Indices of the Pareto-optimal points, from the smallest x to the smallest y; smaller is better in both coordinates.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let mut order: Vec<usize> =
        (0..points.len()).filter(|i| points[*i].0.is_finite() && points[*i].1.is_finite()).collect();
    order.sort_by(|a, b| points[*a].0.total_cmp(&points[*b].0).then(points[*a].1.total_cmp(&points[*b].1)));
    let mut front: Vec<usize> = Vec::new();
    for i in order {
        if front.last().is_none_or(|last| points[i].1 < points[*last].1) {
            front.push(i);
        }
    }
    front
}

/// Labelled values of a logarithmic axis from `low` to `high`: powers of ten; if there are fewer than three, also their
/// multiples by 2 and 5, or all multiples. `0 < low < high`.
pub fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    assert!(0.0 < low && low < high && high.is_finite(), "an axis from {low} to {high}");
    let multiples = |factors: &[u32]| -> Vec<f64> {
        let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
        // Parsed from text, which gives the nearest float to 3e-4; powers times factors may miss it.
        let all =
            (first..=last).flat_map(|e| factors.iter().map(move |f| format!("{f}e{e}").parse().unwrap_or(f64::NAN)));
        all.filter(|v| (low * (1.0 - 1e-9)..=high * (1.0 + 1e-9)).contains(v)).collect()
    };
    let sets: [&[u32]; 3] = [&[1], &[1, 2, 5], &[1, 2, 3, 4, 5, 6, 7, 8, 9]];
    let enough = sets.iter().map(|factors| multiples(factors)).find(|ticks| ticks.len() >= 3);
    let ticks = enough.unwrap_or_else(|| multiples(sets[2]));
    // At most eight labels.
    let step = ticks.len().div_ceil(8).max(1);
    if step > 1 && ticks.len() > 9 { ticks.into_iter().step_by(step).collect() } else { ticks }
}

/// Formats a number for an axis.
pub fn tick_label(value: f64) -> String {
    if !(1e-4..1e6).contains(&value) {
        return format!("{value:e}");
    }
    // Shortest form that reads back equal: 0.05, not 0.050000000000000003.
    format!("{value}")
}

/// Escapes text for XML content or attributes.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Maps values of an axis to positions from 0 to 1.
enum Scale {
    Log { low: f64, high: f64 },
    Names(usize),
}

impl Scale {
    fn new(axis: &Axis, values: impl Iterator<Item = f64>) -> Self {
        if !axis.names.is_empty() {
            return Self::Names(axis.names.len());
        }
        let shown: Vec<f64> = values.filter(|v| *v > 0.0 && v.is_finite()).collect();
        let (mut low, mut high) = shown.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), v| (l.min(*v), h.max(*v)));
        if shown.is_empty() {
            (low, high) = (0.1, 10.0);
        }
        // A range below a factor of four has too few round numbers to label.
        let widen = (2.0 / (high / low).sqrt()).max(1.0);
        (low, high) = (low / widen, high * widen);
        let margin = (high / low).powf(0.06);
        Self::Log { low: low / margin, high: high * margin }
    }

    fn at(&self, value: f64) -> f64 {
        match self {
            Self::Log { low, high } => (value / low).ln() / (high / low).ln(),
            Self::Names(count) => (value + 0.5) / *count as f64,
        }
    }

    fn can_show(&self, value: f64) -> bool {
        value.is_finite() && (matches!(self, Self::Names(_)) || value > 0.0)
    }

    /// Labelled and unlabelled positions.
    fn ticks(&self, axis: &Axis) -> (Vec<(f64, String)>, Vec<f64>) {
        match self {
            Self::Names(_) => {
                let places = axis.names.iter().enumerate();
                (places.map(|(i, name)| (self.at(i as f64), name.clone())).collect(), Vec::new())
            }
            Self::Log { low, high } => {
                let ticks = log_ticks(*low, *high);
                let decades = (high / low).log10();
                let (first, last) = (low.log10().floor() as i32, high.log10().ceil() as i32);
                let all = (first..=last).flat_map(|e| (1..10).map(move |f| f64::from(f) * 10_f64.powi(e)));
                let minor = all.filter(|v| decades < 5.0 && (*low..=*high).contains(v)).map(|v| self.at(v)).collect();
                (ticks.into_iter().map(|v| (self.at(v), tick_label(v))).collect(), minor)
            }
        }
    }
}

/// Approximate width of a label [CSS pixels].
fn width(text: &str) -> f64 {
    6.7 * text.chars().count() as f64
}

/// A rectangle: left, top, right, bottom.
type Area = [f64; 4];

fn overlap(a: &Area, b: &Area) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// A plot under construction.
struct Canvas<'a> {
    plot: &'a Plot,
    svg: String,
    x: Scale,
    y: Scale,
    /// Area of the marks.
    area: Area,
}

impl Canvas<'_> {
    fn place(&self, mark: &Mark) -> Option<(f64, f64)> {
        let [left, top, right, bottom] = self.area;
        (self.x.can_show(mark.x) && self.y.can_show(mark.y))
            .then(|| (left + self.x.at(mark.x) * (right - left), bottom - self.y.at(mark.y) * (bottom - top)))
    }

    fn put(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.svg.write_fmt(text);
    }

    fn axes(&mut self) {
        let [left, top, right, bottom] = self.area;
        let (ticks, minor) = self.x.ticks(&self.plot.x);
        for x in minor.iter().map(|t| left + t * (right - left)) {
            self.put(format_args!("<path class=\"pl-minor\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/>"));
        }
        let (y_ticks, y_minor) = self.y.ticks(&self.plot.y);
        for y in y_minor.iter().map(|t| bottom - t * (bottom - top)) {
            self.put(format_args!("<path class=\"pl-minor\" d=\"M{left:.1} {y:.1}H{right:.1}\"/>"));
        }
        let mut free = f64::NEG_INFINITY;
        for (t, label) in ticks {
            let x = left + t * (right - left);
            self.put(format_args!("<path class=\"pl-grid\" d=\"M{x:.1} {top:.1}V{bottom:.1}\"/>"));
            // Skip labels that would overlap the previous one; the line stays.
            if x - width(&label) / 2.0 > free {
                let y = bottom + 17.0;
                self.put(format_args!(
                    "<text class=\"pl-t\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{}</text>",
                    escape(&label)
                ));
                free = x + width(&label) / 2.0 + 4.0;
            }
        }
        let mut free = f64::INFINITY;
        for (t, label) in y_ticks {
            let y = bottom - t * (bottom - top);
            self.put(format_args!("<path class=\"pl-grid\" d=\"M{left:.1} {y:.1}H{right:.1}\"/>"));
            if y < free {
                let (x, y) = (left - 7.0, y + 4.0);
                self.put(format_args!(
                    "<text class=\"pl-t\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"end\">{}</text>",
                    escape(&label)
                ));
                free = y - 17.0;
            }
        }
        let (w, h) = (right - left, bottom - top);
        self.put(format_args!(
            "<rect class=\"pl-frame\" x=\"{left:.1}\" y=\"{top:.1}\" width=\"{w:.1}\" height=\"{h:.1}\"/>"
        ));
        let (title, x_label, y_label) =
            (escape(&self.plot.title), escape(&self.plot.x.label), escape(&self.plot.y.label));
        let (middle, below, centre) = ((left + right) / 2.0, bottom + 37.0, (top + bottom) / 2.0);
        self.put(format_args!("<text class=\"pl-t pl-h\" x=\"14\" y=\"22\">{title}</text>"));
        self.put(format_args!(
            "<text class=\"pl-t\" x=\"{middle:.1}\" y=\"{below:.1}\" text-anchor=\"middle\">{x_label}</text>"
        ));
        self.put(format_args!(
            "<text class=\"pl-t\" transform=\"translate(16 {centre:.1}) rotate(-90)\" text-anchor=\"middle\">\
             {y_label}</text>"
        ));
    }

    fn series(&mut self) {
        for series in &self.plot.series {
            let places: Vec<_> = series.marks.iter().filter_map(|m| Some((self.place(m)?, m))).collect();
            if series.line && places.len() > 1 {
                let path: Vec<String> = places.iter().map(|((x, y), _)| format!("{x:.1} {y:.1}")).collect();
                self.put(format_args!(
                    "<path class=\"pl-line pl-c{}\" d=\"M{}\"/>",
                    series.color % COLORS,
                    path.join("L")
                ));
            }
            for ((x, y), mark) in places {
                let label = format!("{}: {} ({}, {})", series.name, mark.label, short(mark.x), short(mark.y));
                self.mark(series.color, x, y, &label);
            }
        }
    }

    /// Shapes vary with colours.
    fn mark(&mut self, color: usize, x: f64, y: f64, title: &str) {
        let shape = match color % 4 {
            0 => format!("M{:.1} {y:.1}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0z", x - 4.0),
            1 => format!("M{:.1} {:.1}h7.4v7.4h-7.4z", x - 3.7, y - 3.7),
            2 => format!("M{x:.1} {:.1}l5 5l-5 5l-5 -5z", y - 5.0),
            _ => format!("M{x:.1} {:.1}l5 8.6h-10z", y - 5.2),
        };
        let color = color % COLORS;
        self.put(format_args!(
            "<path class=\"pl-mark pl-c{color}\" d=\"{shape}\"><title>{}</title></path>",
            escape(title)
        ));
    }

    fn front(&mut self) {
        let marks: Vec<&Mark> =
            self.plot.series.iter().flat_map(|s| &s.marks).filter(|m| self.place(m).is_some()).collect();
        let front = pareto_front(&marks.iter().map(|m| (m.x, m.y)).collect::<Vec<_>>());
        let places: Vec<(f64, f64)> = marks.iter().filter_map(|m| self.place(m)).collect();
        let mut taken: Vec<Area> = places.iter().map(|(x, y)| [x - 5.0, y - 5.0, x + 5.0, y + 5.0]).collect();
        let path: Vec<String> = front.iter().map(|i| format!("{:.1} {:.1}", places[*i].0, places[*i].1)).collect();
        if path.len() > 1 {
            self.put(format_args!("<path class=\"pl-front\" d=\"M{}\"/>", path.join("L")));
        }
        for i in front {
            let (x, y) = places[i];
            self.put(format_args!("<circle class=\"pl-ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"8\"/>"));
            let (w, [left, top, right, bottom]) = (width(&marks[i].label), self.area);
            let spots =
                [(11.0, -8.0), (11.0, 18.0), (-11.0 - w, 18.0), (-11.0 - w, -8.0), (11.0, -24.0), (-11.0 - w, 34.0)];
            let areas = spots.map(|(dx, dy)| [x + dx, y + dy - 11.0, x + dx + w, y + dy + 3.0]);
            let inside = |a: &Area| a[0] > left && a[2] < right && a[1] > top && a[3] < bottom;
            // Without room the label is only shown as a tooltip.
            let Some(area) = areas.into_iter().find(|a| inside(a) && !taken.iter().any(|t| overlap(a, t))) else {
                continue;
            };
            taken.push(area);
            let label = escape(&marks[i].label);
            self.put(format_args!(
                "<text class=\"pl-t pl-label\" x=\"{:.1}\" y=\"{:.1}\">{label}</text>",
                area[0],
                area[3] - 3.0
            ));
        }
    }

    fn legend(&mut self) {
        let (x, mut y) = (self.area[2] + 18.0, self.area[1] + 8.0);
        for series in &self.plot.series {
            if series.line {
                let (from, to) = (x - 8.0, x + 8.0);
                self.put(format_args!(
                    "<path class=\"pl-line pl-c{}\" d=\"M{from:.1} {y:.1}H{to:.1}\"/>",
                    series.color % COLORS
                ));
            }
            self.mark(series.color, x, y, &series.name);
            let (left, base) = (x + 14.0, y + 4.0);
            self.put(format_args!(
                "<text class=\"pl-t\" x=\"{left:.1}\" y=\"{base:.1}\">{}</text>",
                escape(&series.name)
            ));
            y += 20.0;
        }
        if self.plot.front {
            let (from, to, left, base) = (x - 8.0, x + 8.0, x + 14.0, y + 4.0);
            self.put(format_args!("<path class=\"pl-front\" d=\"M{from:.1} {y:.1}H{to:.1}\"/>"));
            self.put(format_args!("<circle class=\"pl-ring\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\"/>"));
            self.put(format_args!("<text class=\"pl-t\" x=\"{left:.1}\" y=\"{base:.1}\">Pareto front</text>"));
        }
    }
}

/// Formats a number with three significant digits.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let digits = (2 - value.abs().log10().floor() as i32).clamp(0, 9) as usize;
    format!("{value:.digits$}")
}

impl Plot {
    /// The plot as a standalone SVG document, which can also be embedded in a page.
    pub fn svg(&self) -> String {
        let [w, h] = self.size;
        let names = self.series.iter().map(|s| s.name.as_str()).chain(self.front.then_some("Pareto front"));
        let legend = 36.0 + names.map(width).fold(0.0, f64::max);
        let area = [68.0, 38.0, w - legend - 8.0, h - 50.0];
        let marks = || self.series.iter().flat_map(|s| &s.marks);
        let (x, y) = (Scale::new(&self.x, marks().map(|m| m.x)), Scale::new(&self.y, marks().map(|m| m.y)));
        let mut canvas = Canvas { plot: self, svg: String::new(), x, y, area };
        canvas.put(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {w} {h}\" width=\"{w}\" height=\"{h}\" \
             role=\"img\">\
             <title>{}</title><style>{STYLE}</style><rect class=\"pl-bg\" width=\"{w}\" height=\"{h}\" rx=\"6\"/>",
            escape(&self.title)
        ));
        canvas.axes();
        canvas.series();
        if self.front {
            canvas.front();
        }
        canvas.legend();
        canvas.svg.push_str("</svg>\n");
        canvas.svg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn front_of_a_hand_made_set() {
        let points =
            [(1.0, 9.0), (2.0, 9.0), (2.0, 5.0), (3.0, 6.0), (4.0, 1.0), (9.0, 1.0), (f64::NAN, 0.0), (0.5, 20.0)];
        assert_eq!(pareto_front(&points), [7, 0, 2, 4]);
        assert_eq!(pareto_front(&[(1.0, 1.0), (1.0, 1.0)]).len(), 1);
        assert_eq!(pareto_front(&[]), [] as [usize; 0]);
    }

    #[test]
    fn ticks_are_round_numbers_inside_the_axis() {
        assert_eq!(log_ticks(0.5, 2000.0), [1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(log_ticks(0.03, 0.6), [0.05, 0.1, 0.2, 0.5]);
        assert_eq!(log_ticks(2.1, 6.3), [3.0, 4.0, 5.0, 6.0]);
        assert_eq!(log_ticks(1e-3, 1.0), [0.001, 0.01, 0.1, 1.0]);
        for (low, high) in [(3e-7, 4e-7 * 4.0), (0.9, 1.1e12), (1e-12, 1e12), (99.0, 101.0 * 4.0)] {
            let ticks = log_ticks(low, high);
            assert!((2..=9).contains(&ticks.len()), "{low} to {high}: {ticks:?}");
            assert!(ticks.iter().all(|t| (low..=high).contains(t)), "{low} to {high}: {ticks:?}");
        }
    }

    #[test]
    fn colours_differ_and_stand_out() {
        let linear = |hex: &str| {
            let channel = |i: usize| {
                let value = f64::from(u8::from_str_radix(&hex[i..i + 2], 16).unwrap()) / 255.0;
                if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
            };
            [channel(1), channel(3), channel(5)]
        };
        let luminance = |[r, g, b]: [f64; 3]| 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let (light, dark) = STYLE.split_once("@media").unwrap();
        for (style, ground) in [(light, "#ffffff"), (dark, "#15181d")] {
            let colors: Vec<[f64; 3]> = (0..COLORS)
                .map(|i| {
                    let rule = format!(".pl-c{i} {{ stroke: ");
                    let at = style.find(&rule).unwrap_or_else(|| panic!("no colour {i}")) + rule.len();
                    linear(&style[at..at + 7])
                })
                .collect();
            let ground = luminance(linear(ground));
            for (i, color) in colors.iter().enumerate() {
                let own = luminance(*color);
                let contrast = (own.max(ground) + 0.05) / (own.min(ground) + 0.05);
                assert!(contrast >= 3.0, "colour {i} on {ground}: contrast {contrast:.2}");
                for (j, other) in colors[..i].iter().enumerate() {
                    let apart = (0..3).map(|c| (color[c].cbrt() - other[c].cbrt()).powi(2)).sum::<f64>().sqrt();
                    assert!(apart > 0.15, "colours {j} and {i} on {ground}: {apart:.2} apart");
                }
            }
        }
    }

    #[test]
    fn labels_are_short() {
        let labels: Vec<String> = [0.05, 0.3, 1000.0, 2e-5, 1e7].map(tick_label).into();
        assert_eq!(labels, ["0.05", "0.3", "1000", "2e-5", "1e7"]);
        assert!(log_ticks(1e-4, 9e-4).iter().all(|t| tick_label(*t).len() <= 6));
    }

    fn plot(marks: Vec<Mark>, names: Vec<String>) -> String {
        let x = Axis { label: "time < later & \"more\"".into(), names };
        let series = vec![Series { name: "caches".into(), marks, line: true, color: 0 }];
        Plot { title: "t".into(), x, y: Axis::default(), series, front: true, size: [600.0, 400.0] }.svg()
    }

    #[test]
    fn what_an_axis_cannot_show_is_left_out() {
        let mark = |x, y| Mark { x, y, label: String::new() };
        let svg = plot(vec![mark(1.0, 0.0), mark(0.0, 1.0), mark(f64::NAN, 1.0), mark(3.0, 2.0)], Vec::new());
        // One mark, and one in the legend.
        assert_eq!(svg.matches("pl-mark pl-c0").count(), 2, "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(svg.contains("time &lt; later &amp; &quot;more&quot;"), "{svg}");
        for empty in [plot(Vec::new(), Vec::new()), plot(vec![mark(0.0, 1.0)], vec!["printed".into()])] {
            assert!(empty.starts_with("<svg") && !empty.contains("NaN"), "{empty}");
        }
    }
}

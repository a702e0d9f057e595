//! Stored results of points: one line each, which a restart reads back instead of measuring again.

use super::measure::Layers;
use super::references::Truth;
use crate::error::Result;
use crate::files;
use crate::metrics::display::Values;
use crate::metrics::flip::{PIXELS_PER_DEGREE, flip};
use crate::metrics::metrics;
use crate::metrics::ssim::ssim;
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// One measured point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Hash of everything that the point depends on.
    pub key: String,
    /// Kind of indirect light and value of each knob; brute force has fewer knobs.
    pub knobs: Vec<(String, String)>,
    /// Caches placed.
    pub caches: u32,
    /// Their spacing \[m\].
    pub spacing: f64,
    /// Number of VALs.
    pub vals: u32,
    /// Triangles after tessellation.
    pub triangles: usize,
    /// Median GPU time \[ms\] of each stage.
    pub stages: Vec<(String, f64)>,
    /// Number of frames in the median.
    pub frames: usize,
    /// Errors against each reference, layer by layer.
    pub errors: Vec<Errors>,
    /// Reason if the measurement failed; the fields above are empty then.
    pub failed: Option<String>,
}

/// Errors of one layer against one reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Errors {
    /// Name of the reference.
    pub truth: String,
    /// Name of the layer.
    pub layer: String,
    /// Number of pixels that show a surface in both images.
    pub pixels: usize,
    /// Metrics by name; NaN where a metric is undefined or infinite.
    pub values: Vec<(String, f64)>,
}

impl Errors {
    /// Errors of all layers of a picture against a reference, over pixels that show a surface in both; empty if there
    /// are none.
    pub fn of(picture: &Layers, truth: Truth, reference: &Layers) -> Vec<Self> {
        let both: Vec<bool> = picture.covered.iter().zip(&reference.covered).map(|(a, b)| *a && *b).collect();
        let pixels = both.iter().filter(|b| **b).count();
        if pixels == 0 {
            return Vec::new();
        }
        // Error maps depend on a pixel's surroundings: make pixels black where only one image shows a surface.
        let masked = |image: &[[f32; 3]]| -> Vec<[f32; 3]> {
            image.iter().zip(&both).map(|(pixel, both)| if *both { *pixel } else { [0.0; 3] }).collect()
        };
        let mean =
            |map: Vec<f64>| map.iter().zip(&both).filter(|(_, b)| **b).map(|(v, _)| v).sum::<f64>() / pixels as f64;
        let references = reference.named();
        let layer = |(name, image): (&str, Vec<[f32; 3]>)| {
            let (_, reference) = references.iter().find(|(other, _)| *other == name)?;
            let (image, reference) = (masked(&image), masked(reference));
            let kept = |image: &[[f32; 3]]| -> Vec<[f32; 3]> {
                image.iter().zip(&both).filter(|(_, both)| **both).map(|(pixel, _)| *pixel).collect()
            };
            let found = metrics(&kept(&image), &kept(&reference));
            let ssim = mean(ssim(&image, &reference, picture.size, Values::Radiance));
            let flip = mean(flip(&image, &reference, picture.size, Values::Radiance, PIXELS_PER_DEGREE));
            let values = found.named().into_iter().chain([("ssim", ssim), ("flip", flip)]);
            let values = values.map(|(name, value)| (name.to_owned(), finite(value))).collect();
            Some(Self { truth: truth.name().into(), layer: name.into(), pixels, values })
        };
        picture.named().into_iter().filter_map(layer).collect()
    }
}

/// Metrics of a row in column order.
pub const METRICS: [&str; 10] =
    ["mae", "mare", "rmse", "relmse", "relmse-trimmed", "median-relative", "bias", "psnr", "ssim", "flip"];

/// JSON has no infinity: stored values must read back equal.
fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { f64::NAN }
}

impl Row {
    /// GPU time \[ms\] of the frame: the sum of its stages.
    pub fn frame_ms(&self) -> f64 {
        self.stages.iter().map(|(_, ms)| ms).sum()
    }

    /// Value of a knob.
    pub fn knob(&self, name: &str) -> Option<&str> {
        self.knobs.iter().find(|(knob, _)| knob == name).map(|(_, value)| value.as_str())
    }

    /// A metric of a layer against a reference.
    pub fn error(&self, truth: Truth, layer: &str, metric: &str) -> Option<f64> {
        let errors = self.errors.iter().find(|e| e.truth == truth.name() && e.layer == layer)?;
        errors.values.iter().find(|(name, _)| name == metric).map(|(_, value)| *value)
    }

    /// The row as an object of results.json.
    pub fn to_json(&self) -> Value {
        let errors = self.errors.iter().map(|e| {
            let mut object = json!({ "reference": e.truth, "layer": e.layer, "pixels": e.pixels });
            for (name, value) in &e.values {
                object[name] = json!(value);
            }
            object
        });
        json!({
            "schema": SCHEMA,
            "key": self.key,
            "knobs": self.knobs.iter().map(|(name, value)| json!([name, value])).collect::<Vec<_>>(),
            "caches": self.caches,
            "spacing": self.spacing,
            "vals": self.vals,
            "triangles": self.triangles,
            "stages": self.stages.iter().map(|(name, ms)| json!({ "name": name, "gpu_ms": ms })).collect::<Vec<_>>(),
            "frames": self.frames,
            "errors": errors.collect::<Vec<_>>(),
            "failed": self.failed,
        })
    }

    /// Reads a row that `to_json` wrote; `None` if it is invalid.
    pub fn from_json(value: &Value) -> Option<Self> {
        if value.get("schema")?.as_u64()? != SCHEMA {
            return None;
        }
        let text = |value: &Value| value.as_str().map(str::to_owned);
        let number = |value: &Value| if value.is_null() { Some(f64::NAN) } else { value.as_f64() };
        let knob = |pair: &Value| Some((text(pair.get(0)?)?, text(pair.get(1)?)?));
        let stage = |stage: &Value| Some((text(stage.get("name")?)?, number(stage.get("gpu_ms")?)?));
        let errors = |object: &Value| {
            // JSON objects are unordered: use the order of the metrics.
            let value = |name: &&str| Some(((*name).to_owned(), number(object.get(*name)?)?));
            Some(Errors {
                truth: text(object.get("reference")?)?,
                layer: text(object.get("layer")?)?,
                pixels: object.get("pixels")?.as_u64()? as usize,
                values: METRICS.iter().map(value).collect::<Option<_>>()?,
            })
        };
        Some(Self {
            key: text(value.get("key")?)?,
            knobs: value.get("knobs")?.as_array()?.iter().map(knob).collect::<Option<_>>()?,
            caches: value.get("caches")?.as_u64()?.try_into().ok()?,
            spacing: number(value.get("spacing")?)?,
            vals: value.get("vals")?.as_u64()?.try_into().ok()?,
            triangles: value.get("triangles")?.as_u64()? as usize,
            stages: value.get("stages")?.as_array()?.iter().map(stage).collect::<Option<_>>()?,
            frames: value.get("frames")?.as_u64()? as usize,
            errors: value.get("errors")?.as_array()?.iter().map(errors).collect::<Option<_>>()?,
            failed: value.get("failed")?.as_str().map(str::to_owned),
        })
    }
}

/// Version of the row format.
const SCHEMA: u64 = 1;

/// Rows of all finished points, one JSON object per line. Rows of other scenes, settings and program versions stay in
/// the file, but are not found.
pub struct Store {
    path: PathBuf,
    rows: Vec<Row>,
}

impl Store {
    /// Reads a file of rows; empty if the file is missing. Invalid lines are skipped with a warning.
    ///
    /// # Errors
    /// Fails if a folder or file cannot be read or written.
    pub fn open(path: &Path) -> Result<Self> {
        let mut rows = Vec::new();
        let unread = |reason| crate::Error::Input { file: path.into(), place: "finished points".into(), reason };
        let bytes = if path.exists() { files::read(path).map_err(unread)? } else { Vec::new() };
        for (i, line) in String::from_utf8_lossy(&bytes).lines().enumerate() {
            match serde_json::from_str(line).ok().as_ref().and_then(Row::from_json) {
                Some(row) => rows.push(row),
                None => log::warn!("{}: line {} is not a finished point; it is skipped", path.display(), i + 1),
            }
        }
        Ok(Self { path: path.into(), rows })
    }

    /// The row with this key.
    pub fn find(&self, key: &str) -> Option<&Row> {
        self.rows.iter().find(|row| row.key == key)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds a row, or replaces the one with its key, and writes the file.
    ///
    /// # Errors
    /// Fails if a folder or file cannot be read or written.
    pub fn keep(&mut self, row: Row) -> Result<()> {
        self.rows.retain(|other| other.key != row.key);
        self.rows.push(row);
        files::replace_file(&self.path, |file| self.rows.iter().try_for_each(|row| writeln!(file, "{}", row.to_json())))
    }
}

/// All rows as CSV: one line per layer and reference, or one for a failed point.
pub fn csv(rows: &[Row]) -> String {
    let mut knobs: Vec<&str> = Vec::new();
    let mut stages: Vec<&str> = Vec::new();
    let mut metrics: Vec<&str> = Vec::new();
    let add = |list: &mut Vec<_>, name| {
        if !list.contains(&name) {
            list.push(name);
        }
    };
    for row in rows {
        row.knobs.iter().for_each(|(name, _)| add(&mut knobs, name.as_str()));
        row.stages.iter().for_each(|(name, _)| add(&mut stages, name.as_str()));
        row.errors.iter().flat_map(|e| &e.values).for_each(|(name, _)| add(&mut metrics, name.as_str()));
    }
    let mut header: Vec<String> = knobs.iter().map(|name| (*name).to_owned()).collect();
    header.extend(["caches_placed", "spacing_m", "vals", "triangles", "frames", "frame_ms"].map(str::to_owned));
    header.extend(stages.iter().map(|name| format!("{}_ms", name.replace(' ', "_"))));
    header.extend(["reference", "layer", "pixels"].map(str::to_owned));
    header.extend(metrics.iter().map(|name| (*name).to_owned()));
    header.push("failed".into());
    let mut lines = vec![header];
    let number = |value: Option<f64>| value.filter(|v| v.is_finite()).map_or(String::new(), |v| v.to_string());
    let find = |list: &[(String, f64)], name: &str| list.iter().find(|(n, _)| n == name).map(|(_, v)| *v);
    for row in rows {
        let mut start: Vec<String> = knobs.iter().map(|name| row.knob(name).unwrap_or_default().to_owned()).collect();
        if row.failed.is_some() {
            start.extend(vec![String::new(); 6]);
        } else {
            start.extend([row.caches.to_string(), row.spacing.to_string(), row.vals.to_string()]);
            start.extend([row.triangles.to_string(), row.frames.to_string(), row.frame_ms().to_string()]);
        }
        start.extend(stages.iter().map(|name| number(find(&row.stages, name))));
        for errors in &row.errors {
            let mut line = start.clone();
            line.extend([errors.truth.clone(), errors.layer.clone(), errors.pixels.to_string()]);
            line.extend(metrics.iter().map(|name| number(find(&errors.values, name))));
            line.push(String::new());
            lines.push(line);
        }
        if row.errors.is_empty() {
            start.extend(vec![String::new(); 3 + metrics.len()]);
            start.push(row.failed.clone().unwrap_or_default());
            lines.push(start);
        }
    }
    lines.iter().map(|line| line.iter().map(|cell| quoted(cell)).collect::<Vec<_>>().join(",") + "\n").collect()
}

/// Quotes a CSV cell (RFC 4180).
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(key: &str) -> Row {
        let value =
            |(i, name): (usize, &&str)| ((*name).to_owned(), if *name == "psnr" { f64::NAN } else { 0.5 * i as f64 });
        let values = METRICS.iter().enumerate().map(value).collect();
        let errors = vec![Errors { truth: "same-vals".into(), layer: "indirect".into(), pixels: 7, values }];
        Row {
            key: key.into(),
            knobs: vec![("caches".into(), "50".into())],
            stages: vec![("rsm".into(), 1.5), ("gather".into(), 2.0)],
            frames: 5,
            errors,
            ..Row::default()
        }
    }

    #[test]
    fn rows_read_back_as_written() {
        let read = Row::from_json(&row("a").to_json()).expect("a row");
        assert_eq!(read.to_json(), row("a").to_json());
        let names = |row: &Row| row.errors[0].values.iter().map(|v| v.0.clone()).collect::<Vec<_>>();
        assert_eq!((names(&read), &read.knobs), (names(&row("a")), &row("a").knobs));
        assert_eq!(read.frame_ms(), 3.5);
        assert!(read.errors[0].values.iter().any(|(name, v)| name == "psnr" && v.is_nan()));
        assert_eq!(Row::from_json(&json!({ "schema": 1, "key": "a" })), None);
        let mut other = row("a").to_json();
        other["schema"] = json!(2);
        assert_eq!(Row::from_json(&other), None);
    }

    #[test]
    fn a_row_holds_every_metric() {
        let layers = |value: f32| Layers {
            size: [2, 1],
            diffuse: vec![[value; 3]; 2],
            glossy: Some(vec![[0.5; 3]; 2]),
            covered: vec![true, value > 1.0],
        };
        let errors = Errors::of(&layers(2.0), Truth::SameVals, &layers(1.0));
        let names: Vec<&str> = errors.iter().map(|e| e.layer.as_str()).collect();
        assert_eq!(names, ["indirect.diffuse", "indirect.glossy", "indirect"]);
        for errors in &errors {
            assert_eq!(errors.values.iter().map(|v| v.0.as_str()).collect::<Vec<_>>(), METRICS);
            assert_eq!(errors.pixels, 1, "only what shows a surface in both");
        }
        let mae = |layer: usize| errors[layer].values[0].1;
        assert_eq!((mae(0), mae(1), mae(2)), (1.0, 0.0, 1.0));
        // Pixels other than the one that counts differ, but neither map sees them.
        let beside = Layers { diffuse: vec![[2.0; 3], [9.0; 3]], ..layers(2.0) };
        let same = Errors::of(&beside, Truth::SameVals, &Layers { covered: vec![true, false], ..layers(2.0) });
        assert!(same[0].values.iter().all(|(name, v)| match name.as_str() {
            "ssim" => (v - 1.0).abs() < 1e-9,
            "psnr" => v.is_nan(),
            _ => *v == 0.0,
        }));
        let nothing = Layers { covered: vec![false; 2], ..layers(1.0) };
        assert_eq!(Errors::of(&layers(2.0), Truth::SameVals, &nothing), []);
    }

    #[test]
    fn every_line_of_a_table_has_every_column() {
        let failed = Row {
            knobs: vec![("caches".into(), "9".into()), ("rsm".into(), "64".into())],
            failed: Some("too large, \"really\"".into()),
            ..Row::default()
        };
        let table = csv(&[row("a"), failed]);
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(
            lines[0],
            "caches,rsm,caches_placed,spacing_m,vals,triangles,frames,frame_ms,rsm_ms,gather_ms,reference,layer,\
             pixels,mae,mare,rmse,relmse,relmse-trimmed,median-relative,bias,psnr,ssim,flip,failed"
        );
        assert_eq!(lines[1], "50,,0,0,0,0,5,3.5,1.5,2,same-vals,indirect,7,0,0.5,1,1.5,2,2.5,3,,4,4.5,");
        assert_eq!(lines[2], "9,64,,,,,,,,,,,,,,,,,,,,,,\"too large, \"\"really\"\"\"");
        assert_eq!(lines.len(), 3);
    }
}

//! A sky around the scene: its radiance, its sun, and the directional lights that represent the rest of its light.
//!
//! Median cut (Debevec 2005): circles of latitude and longitude divide the sphere, first at the horizon. The region
//! with the largest luminous energy is repeatedly cut across its longer side into halves of equal energy until the
//! wanted number is reached. Each region becomes parallel light with exactly its energy, from its centre of energy.

mod sun;

use super::studio::Backdrop;
use super::{Light, LightKind, Scene, luminance};
use glam::{DVec2, DVec3, Vec3};
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Radiance from all directions, on a grid of latitude and longitude.
#[derive(Clone, Debug)]
pub struct Sky {
    /// Number of columns.
    pub width: u32,
    /// Number of rows, the first around +Y.
    pub height: u32,
    /// Radiance [cd/m^2], row by row. The middle column is around -Z; column numbers increase towards +X.
    pub texels: Vec<Vec3>,
    /// Displayed radiance, row by row, if it differs from `texels`: it includes the sun, which is a separate light.
    pub shown: Option<Vec<Vec3>>,
    /// Rotation about +Y \[rad\], counter-clockwise seen from above.
    pub turn: f64,
    /// Range of the scene's lights that represent the sky, without its sun.
    pub lights: Range<usize>,
}

/// Columns and rows of a grid with uniform radiance; they set where regions can be cut.
const EVEN: [u32; 2] = [512, 256];

/// A region of texels.
#[derive(Clone)]
struct Region {
    columns: Range<usize>,
    rows: Range<usize>,
    /// Luminous energy of the region.
    energy: f64,
}

/// Cells that stand for the sky itself: columns and rows.
const FINE: [usize; 2] = [64, 32];

/// Normals over which the brightness of lights is fitted, and steps of the fit.
const NORMALS: usize = 256;
const STEPS: usize = 100;

impl Sky {
    /// A sky from a grid of radiances [cd/m^2]. Negative values and NaN count as 0.
    pub fn new(width: u32, height: u32, radiance: impl Iterator<Item = Vec3>, turn: f64) -> Self {
        let clean = |c: f32| if c.is_finite() { c.max(0.0) } else { 0.0 };
        let texels: Vec<Vec3> = radiance.map(|r| Vec3::from(r.to_array().map(clean))).collect();
        assert_eq!(texels.len(), width as usize * height as usize, "a sky's texels");
        Self { width, height, texels, shown: None, turn, lights: 0..0 }
    }

    /// A sky of uniform radiance [cd/m^2].
    pub fn even(radiance: Vec3) -> Self {
        let [width, height] = EVEN;
        Self::new(width, height, std::iter::repeat_n(radiance, (width * height) as usize), 0.0)
    }

    /// Puts the sky over a scene. Adds its sun, if it has one, as a separate light, and at most `lights` directional
    /// lights for the rest. A black sky adds no lights.
    pub fn put_over(mut self, scene: &mut Scene, lights: usize) {
        if let Some(sun) = self.split_sun() {
            scene.notes.push(sun::note(&sun, self.illuminance()));
            scene.lights.push(sun);
        }
        let first = scene.lights.len();
        scene.lights.extend(self.lights(lights));
        self.lights = first..scene.lights.len();
        scene.sky = Some(self);
        scene.backdrop = Backdrop::Sky;
    }

    /// Solid angle \[sr\] of a texel of a row.
    pub(crate) fn solid_angle(&self, row: usize) -> f64 {
        let edge = |row: usize| (PI * row as f64 / f64::from(self.height)).cos();
        TAU / f64::from(self.width) * (edge(row) - edge(row + 1))
    }

    /// Unit direction towards the middle of a texel.
    pub(crate) fn direction(&self, column: usize, row: usize) -> DVec3 {
        self.direction_at(DVec2::new(column as f64 + 0.5, row as f64 + 0.5))
    }

    /// Unit direction towards a position on the grid \[texels\], counted from the first column and row.
    pub fn direction_at(&self, place: DVec2) -> DVec3 {
        let latitude = PI * place.y / f64::from(self.height);
        let longitude = TAU * (place.x / f64::from(self.width) - 0.5) - self.turn;
        DVec3::new(latitude.sin() * longitude.sin(), latitude.cos(), -latitude.sin() * longitude.cos())
    }

    /// Position on the grid \[texels\] of a unit direction.
    pub fn place(&self, direction: DVec3) -> DVec2 {
        // Straight up and down, any longitude is right.
        let level = direction.x != 0.0 || direction.z != 0.0;
        let longitude = if level { direction.x.atan2(-direction.z) } else { 0.0 } + self.turn;
        let across = (longitude / TAU + 0.5).rem_euclid(1.0);
        let down = direction.y.clamp(-1.0, 1.0).acos() / PI;
        DVec2::new(across * f64::from(self.width), down * f64::from(self.height))
    }

    /// Radiance [cd/m^2] from a unit direction, bilinear between texel centres. Twin of glsl/sky.frag.
    pub fn radiance(&self, direction: DVec3) -> DVec3 {
        let DVec2 { x, y } = self.place(direction) - 0.5;
        let texel = |column: f64, row: f64| {
            // Beyond a pole the grid continues on the opposite side.
            let on = row.clamp(0.0, f64::from(self.height - 1));
            let turn = if on == row { 0 } else { self.width / 2 };
            let column = (column + f64::from(turn)).rem_euclid(f64::from(self.width)) as usize;
            self.texels[on as usize * self.width as usize + column].as_dvec3()
        };
        let (left, above) = (x.floor(), y.floor());
        let row = |row: f64| texel(left, row).lerp(texel(left + 1.0, row), x - left);
        row(above).lerp(row(above + 1.0), y - above)
    }

    /// The sky as displayed, with its sun.
    pub(super) fn as_shown(&self) -> Cow<'_, Self> {
        match &self.shown {
            Some(shown) => {
                let (width, height, turn, lights) = (self.width, self.height, self.turn, self.lights.clone());
                Cow::Owned(Self { width, height, texels: shown.clone(), shown: None, turn, lights })
            }
            None => Cow::Borrowed(self),
        }
    }

    /// Total light \[lx\], each direction received by a plane that faces it: the integral of radiance over the sphere.
    pub fn illuminance(&self) -> DVec3 {
        self.sum(&(0..self.width as usize), &(0..self.height as usize)).0
    }

    /// Integral over texels of radiance \[lx\], and of direction times luminance.
    fn sum(&self, columns: &Range<usize>, rows: &Range<usize>) -> (DVec3, DVec3) {
        let (mut light, mut vector) = (DVec3::ZERO, DVec3::ZERO);
        for row in rows.clone() {
            let solid_angle = self.solid_angle(row);
            for column in columns.clone() {
                let texel = self.texels[row * self.width as usize + column].as_dvec3() * solid_angle;
                light += texel;
                vector += luminance(texel) * self.direction(column, row);
            }
        }
        (light, vector)
    }

    /// The directional lights that represent the sky: one for each region. Each is as bright as makes the irradiance of
    /// open surfaces, whichever way they face, most like the sky's.
    fn lights(&self, count: usize) -> Vec<Light> {
        let mut lights: Vec<_> = self.divided(count).iter().map(|r| self.sum(&r.columns, &r.rows)).collect();
        let part = |i: usize, count: usize, size: u32| i * size as usize / count..(i + 1) * size as usize / count;
        let cell = |i| {
            let [column, row] = [i % FINE[0], i / FINE[0]];
            self.sum(&part(column, FINE[0], self.width), &part(row, FINE[1], self.height))
        };
        let fine: Vec<_> = (0..FINE[0] * FINE[1]).map(cell).collect();
        let whole: DVec3 = lights.iter().map(|light| light.0).sum();
        let shares = shares(&lights, &fine);
        for (light, share) in lights.iter_mut().zip(shares) {
            light.0 *= share;
        }
        // Each channel keeps its energy.
        let factor = whole / lights.iter().map(|light| light.0).sum::<DVec3>().max(DVec3::splat(f64::MIN_POSITIVE));
        (0..).zip(lights).map(|(i, (light, vector))| parallel(format!("sky {i}"), light * factor, vector)).collect()
    }

    /// Regions of about equal energy.
    fn divided(&self, count: usize) -> Vec<Region> {
        let region = |rows: Range<usize>| self.region(0..self.width as usize, rows);
        let (horizon, rows) = (self.height as usize / 2, self.height as usize);
        // A floor sees only one hemisphere: no light may represent parts of both.
        let mut regions = match count {
            0 | 1 => vec![region(0..rows)],
            _ => vec![region(0..horizon), region(horizon..rows)],
        };
        regions.retain(|region| !region.rows.is_empty());
        while regions.len() < count {
            // A single texel cannot be cut.
            let cuttable = |r: &&(usize, &Region)| r.1.columns.len() > 1 || r.1.rows.len() > 1;
            let brightest = regions
                .iter()
                .enumerate()
                .filter(|r| cuttable(&r) && r.1.energy > 0.0)
                .max_by(|a, b| a.1.energy.total_cmp(&b.1.energy));
            let Some((index, _)) = brightest else { break };
            let region = regions.swap_remove(index);
            regions.extend(self.cut(&region));
        }
        regions.retain(|region| region.energy > 0.0);
        regions
    }

    fn region(&self, columns: Range<usize>, rows: Range<usize>) -> Region {
        let energy = luminance(self.sum(&columns, &rows).0);
        Region { columns, rows, energy }
    }

    /// Cuts a region across its longer side into two of nearly equal energy.
    fn cut(&self, region: &Region) -> [Region; 2] {
        let Region { columns, rows, energy } = region;
        let middle = PI * 0.5 * (rows.start + rows.end) as f64 / f64::from(self.height);
        let wide = TAU * columns.len() as f64 / f64::from(self.width) * middle.sin();
        let high = PI * rows.len() as f64 / f64::from(self.height);
        let across_columns = columns.len() > 1 && (wide >= high || rows.len() == 1);
        let range = if across_columns { columns } else { rows };
        let mut before = 0.0;
        let mut at = range.start + 1;
        for line in range.clone() {
            let own = match across_columns {
                true => luminance(self.sum(&(line..line + 1), rows).0),
                false => luminance(self.sum(columns, &(line..line + 1)).0),
            };
            at = line + usize::from((before + own - 0.5 * energy).abs() <= (before - 0.5 * energy).abs());
            before += own;
            if before >= 0.5 * energy {
                break;
            }
        }
        let at = at.clamp(range.start + 1, range.end - 1);
        if across_columns {
            [self.region(columns.start..at, rows.clone()), self.region(at..columns.end, rows.clone())]
        } else {
            [self.region(columns.clone(), rows.start..at), self.region(columns.clone(), at..rows.end)]
        }
    }
}

/// Factors on lights, given as illuminance \[lx\] and a vector towards them, with which they light open surfaces most like many finer ones
/// do: least squares over all normals, by multiplicative steps, which keep factors positive (Lee and Seung 2001).
fn shares(lights: &[(DVec3, DVec3)], fine: &[(DVec3, DVec3)]) -> Vec<f64> {
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    let normals = (0..NORMALS).map(|i| {
        let z = 1.0 - (2 * i + 1) as f64 / NORMALS as f64;
        let (sin, cos) = (golden * i as f64).sin_cos();
        DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
    });
    let received =
        |n: DVec3, (light, vector): &(DVec3, DVec3)| luminance(*light) * n.dot(vector.normalize_or(DVec3::Y)).max(0.0);
    // By normal: the irradiance of each light, and of all fine ones.
    let (given, wanted): (Vec<Vec<f64>>, Vec<f64>) = normals
        .map(|n| (lights.iter().map(|l| received(n, l)).collect(), fine.iter().map(|f| received(n, f)).sum::<f64>()))
        .unzip();
    let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
    let weighted = |light: usize, by: &[f64]| -> f64 { given.iter().zip(by).map(|(row, by)| row[light] * by).sum() };
    let mut shares = vec![1.0; lights.len()];
    for _ in 0..STEPS {
        let sums: Vec<f64> = given.iter().map(|row| dot(row, &shares)).collect();
        for (light, share) in shares.iter_mut().enumerate() {
            *share *= weighted(light, &wanted) / weighted(light, &sums).max(f64::MIN_POSITIVE);
        }
    }
    shares
}

/// Parallel light \[lx\] from a direction of any length.
fn parallel(name: String, light: DVec3, from: DVec3) -> Light {
    let peak = light.max_element();
    Light {
        name,
        kind: LightKind::Directional,
        color: (light / peak).as_vec3(),
        intensity: peak as f32,
        range: None,
        radius: 0.0,
        position: DVec3::ZERO,
        direction: -from.try_normalize().unwrap_or(DVec3::Y).as_vec3(),
    }
}

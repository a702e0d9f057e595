//! Divides a surface into small cells, each with the caches that points in it can refer to. Pixels look them up in the
//! model's rest space, without an unwrap. METHOD 5, thesis 6.1.4.
//!
//! A cell lists every cache within `reach` of its surface. Weights vanish at `reach`, so that light does not jump at
//! cell boundaries, however the surface is divided into triangles.

use super::grid::Grid;
use super::surface::Surface;
use super::voxel::clip;
use super::{CacheSet, ModelCaches, NO_CACHE};
use crate::error::{Error, Result};
use crate::scene::{Mesh, Scene};
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// Most caches of a cell; the nearest are kept.
const LONGEST_ROW: usize = 64;

/// All rows are as long as the longest, rounded up to a multiple of this.
const ROW_STEP: usize = 8;

/// `reach` in units of `d_eps`; every point has a cache within this distance.
const REACH: f64 = 1.0;

/// Side of a cell in units of `d_eps`; the same as the bake's voxels.
const SIDE: f64 = 0.5;

/// Share of a side by which surface also counts for neighbouring cells; more than a device's rounding.
const MARGIN: f64 = 2e-3;

/// Most cells along an axis.
const AXIS_LIMIT: f64 = 65_536.0;

/// The cells of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct CellSet {
    /// Largest distance to a cache that a point refers to [m in world space].
    pub reach: f64,
    /// Number of references per cell.
    pub row: usize,
    /// One per model of the cache set.
    pub models: Vec<Cells>,
}

/// The cells of one model.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Centre of the model [model space].
    pub centre: DVec3,
    /// Transforms points relative to `centre` to world metres: the linear part of an instance's transform.
    pub linear: DMat3,
    /// Corner of cell 0, 0, 0 [m, from `centre`].
    pub low: DVec3,
    /// Side of a cell \[m\].
    pub side: f64,
    /// Cells that contain surface, ascending.
    pub cells: Vec<[u16; 3]>,
    /// `CellSet::row` cache indices per cell, nearest first; padded with `NO_CACHE`.
    pub references: Vec<u16>,
}

impl CacheSet {
    /// Adds the cells in which pixels look up their caches. Fails with `TooLarge` if the spacing is tiny compared to a
    /// model.
    ///
    /// # Errors
    /// Fails if there are more cells than can be numbered; ask for fewer caches.
    pub fn with_cells(mut self, scene: &Scene) -> Result<Self> {
        let reach = REACH * self.spacing;
        let models = super::models(scene).0;
        let found: Vec<(Cells, Vec<Vec<u16>>)> = (models.iter().zip(&self.models))
            .map(|(model, caches)| cells(&scene.meshes[model.mesh], &model.surface, caches, self.spacing))
            .collect::<Result<_>>()?;
        let longest = found.iter().flat_map(|(_, rows)| rows).map(Vec::len).max().unwrap_or(0);
        let row = longest.next_multiple_of(ROW_STEP).max(ROW_STEP);
        let padded = |(mut cells, rows): (Cells, Vec<Vec<u16>>)| {
            cells.references = vec![NO_CACHE; rows.len() * row];
            for (to, from) in cells.references.chunks_mut(row).zip(rows) {
                to[..from.len()].copy_from_slice(&from);
            }
            cells
        };
        self.cells = Some(CellSet { reach, row, models: found.into_iter().map(padded).collect() });
        Ok(self)
    }
}

/// A piece of surface in a cell.
struct Piece {
    cell: [u16; 3],
    triangle: u32,
    low: DVec3,
    high: DVec3,
}

/// The cells of a model, and separately their references.
fn cells(mesh: &Mesh, surface: &Surface, caches: &ModelCaches, spacing: f64) -> Result<(Cells, Vec<Vec<u16>>)> {
    let side = SIDE * spacing;
    let mut made = Cells {
        centre: surface.centre,
        linear: surface.linear,
        low: surface.low - 0.5 * side,
        side,
        cells: Vec::new(),
        references: Vec::new(),
    };
    if surface.triangles.is_empty() || caches.caches.is_empty() {
        return Ok((made, Vec::new()));
    }
    if ((surface.high - surface.low) / side).max_element() + 3.0 > AXIS_LIMIT {
        return Err(Error::TooLarge(format!(
            "mesh '{}': a spacing of {spacing:.3e} m is too small for cache lookup per pixel: ask for a larger \
             spacing or --interp vertex",
            mesh.name
        )));
    }
    let mut pieces: Vec<Piece> = (surface.triangles.par_iter().enumerate())
        .flat_map_iter(|(triangle, t)| pieces_of(surface.corners(t), triangle as u32, made.low, side))
        .collect();
    pieces.par_sort_unstable_by_key(|piece| (piece.cell, piece.triangle));
    let in_cells: Vec<&[Piece]> = pieces.chunk_by(|a, b| a.cell == b.cell).collect();
    made.cells = in_cells.iter().map(|pieces| pieces[0].cell).collect();

    let place = |cache: &super::Cache| {
        let [a, b, c] = mesh.triangle(cache.triangle as usize).map(|v| surface.positions[v]);
        let [second, third] = cache.barycentric.map(f64::from);
        a + (b - a) * second + (c - a) * third
    };
    let positions: Vec<DVec3> = caches.caches.iter().map(place).collect();
    let facing = |cache: &super::Cache| surface.normal_matrix * cache.normal.as_dvec3();
    let normals: Vec<DVec3> = caches.caches.iter().map(facing).collect();
    let grid = Grid::new(&positions, REACH * spacing);
    let rows = (in_cells.par_iter())
        .map(|pieces| row(surface, pieces, &positions, &normals, &grid, REACH * spacing))
        .collect();
    Ok((made, rows))
}

/// The pieces of a triangle, one for each cell that they belong to.
fn pieces_of(corners: [DVec3; 3], triangle: u32, origin: DVec3, side: f64) -> Vec<Piece> {
    let mut pieces = Vec::new();
    clip(corners, origin, side, &mut |_, polygon| {
        let low = polygon.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = polygon.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let cell = |p: DVec3| ((p - origin) / side).floor().max(DVec3::ZERO);
        let (first, last) = (cell(low - MARGIN * side), cell(high + MARGIN * side));
        for x in first.x as u16..=last.x as u16 {
            for y in first.y as u16..=last.y as u16 {
                for z in first.z as u16..=last.z as u16 {
                    pieces.push(Piece { cell: [x, y, z], triangle, low, high });
                }
            }
        }
    });
    pieces
}

/// The caches that points of a cell can refer to, nearest to its middle first.
fn row(
    surface: &Surface,
    pieces: &[Piece],
    positions: &[DVec3],
    normals: &[DVec3],
    grid: &Grid,
    reach: f64,
) -> Vec<u16> {
    let low = pieces.iter().fold(DVec3::INFINITY, |low, p| low.min(p.low));
    let high = pieces.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(p.high));
    let middle = (low + high) * 0.5;
    let vertices = || pieces.iter().flat_map(|p| surface.triangles[p.triangle as usize].vertices);
    let seen = |cache: usize| vertices().any(|v| surface.normals[v as usize].dot(normals[cache]) > 0.0);
    let mut found: Vec<(f64, u16)> = Vec::new();
    grid.near(middle, reach + low.distance(middle), |cache| {
        let position = positions[cache];
        if position.distance(position.clamp(low, high)) <= reach * (1.0 + MARGIN) && seen(cache) {
            found.push((position.distance_squared(middle), cache as u16));
        }
    });
    if found.is_empty() {
        // No cache faces the same way: use the nearest ones.
        found = positions.iter().map(|p| p.distance_squared(middle)).zip(0_u16..).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.truncate(ROW_STEP);
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.truncate(LONGEST_ROW);
    found.into_iter().map(|(_, cache)| cache).collect()
}

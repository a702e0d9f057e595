//! A hashed grid of points, for finding the points near a position.

use glam::DVec3;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Points grouped by cell.
pub(super) struct Grid {
    /// Side of a cell.
    pub(super) side: f64,
    /// Smallest and largest coordinates of occupied cells.
    pub(super) bounds: ([i32; 3], [i32; 3]),
    cells: HashMap<[i32; 3], (u32, u32), BuildHasherDefault<CellHasher>>,
    order: Vec<u32>,
    cell_of: Vec<[i32; 3]>,
}

impl Grid {
    /// Sorts the points into cells.
    pub(super) fn new(points: &[DVec3], side: f64) -> Self {
        let cell_of: Vec<_> = points.iter().map(|p| cell(*p, side)).collect();
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        order.sort_unstable_by_key(|&i| (cell_of[i as usize], i));
        let mut cells = HashMap::default();
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        let mut first = 0;
        for run in order.chunk_by(|&a, &b| cell_of[a as usize] == cell_of[b as usize]) {
            let cell = cell_of[run[0] as usize];
            cells.insert(cell, (first, first + run.len() as u32));
            first += run.len() as u32;
            for axis in 0..3 {
                low[axis] = low[axis].min(cell[axis]);
                high[axis] = high[axis].max(cell[axis]);
            }
        }
        Self { side, bounds: (low, high), cells, order, cell_of }
    }

    /// Number of occupied cells.
    pub(super) fn cell_count(&self) -> usize {
        self.cells.len()
    }

    /// Cell of a point.
    pub(super) fn cell_of(&self, point: u32) -> [i32; 3] {
        self.cell_of[point as usize]
    }

    /// Distance from a position to a cell.
    pub(super) fn distance(&self, cell: [i32; 3], place: DVec3) -> f64 {
        let low = DVec3::from_array(cell.map(f64::from)) * self.side;
        (place - place.clamp(low, low + self.side)).length()
    }

    /// Points in a cell, ascending.
    pub(super) fn at(&self, cell: [i32; 3]) -> &[u32] {
        self.cells.get(&cell).map_or(&[], |&(first, end)| &self.order[first as usize..end as usize])
    }

    /// All points, in an order that depends only on the points.
    pub(super) fn all(&self) -> &[u32] {
        &self.order
    }

    /// Visits all points within the radius and some beyond, in a deterministic order.
    pub(super) fn near(&self, centre: DVec3, radius: f64, mut visit: impl FnMut(usize)) {
        let (mut low, mut high) = (cell(centre - radius, self.side), cell(centre + radius, self.side));
        let mut count = 1.0;
        for axis in 0..3 {
            low[axis] = low[axis].max(self.bounds.0[axis]);
            high[axis] = high[axis].min(self.bounds.1[axis]);
            count *= (f64::from(high[axis]) - f64::from(low[axis]) + 1.0).max(0.0);
        }
        if count > self.cells.len() as f64 {
            return self.order.iter().for_each(|&i| visit(i as usize));
        }
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    self.at([x, y, z]).iter().for_each(|&i| visit(i as usize));
                }
            }
        }
    }
}

/// Cell of a point; saturates at the range of i32 far outside of any grid.
pub(super) fn cell(point: DVec3, side: f64) -> [i32; 3] {
    (point / side).floor().to_array().map(|x| x as i32)
}

/// A fast hash of cells. The default hasher, which resists flooding, took half of the lookup time.
#[derive(Default)]
struct CellHasher(u64);

impl Hasher for CellHasher {
    fn finish(&self) -> u64 {
        self.0 ^ self.0 >> 29
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&byte| self.write_i32(i32::from(byte)));
    }

    fn write_i32(&mut self, value: i32) {
        self.0 = (self.0.rotate_left(21) ^ u64::from(value as u32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn write_usize(&mut self, _length: usize) {} // of an array, always three
}

//! Cells of the models' surfaces, in which pixels look up references. METHOD 5 and 9; the bake makes the cells
//! (`bake::CellSet`).

use crate::bake::{CellSet, Cells};
use crate::error::Result;
use crate::gpu::{Buffer, Device};
use crate::shared::{CellEntry, CellGrid, NO_REFERENCES};
use glam::{DAffine3, DMat3, DMat4};

/// The cells on the device.
pub struct CellBuffers {
    /// One grid per model.
    pub grids: Buffer,
    /// Hash tables of all models.
    pub entries: Buffer,
    /// References per cell.
    pub row: usize,
    /// Distance of the farthest cache that a pixel references \[m\].
    pub reach: f64,
}

impl CellBuffers {
    /// Uploads the cells.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub fn new(gpu: &Device, cells: &CellSet) -> Result<Self> {
        let (mut grids, mut entries) = (Vec::new(), Vec::new());
        for model in &cells.models {
            let table = table(model);
            let scale = DMat3::from_diagonal(glam::DVec3::splat(1.0 / model.side));
            let cell_from_offset = DAffine3::from_mat3_translation(scale * model.linear, -model.low / model.side);
            grids.push(CellGrid {
                cell_from_offset: DMat4::from(cell_from_offset).as_mat4(),
                centre: model.centre.as_vec3(),
                first_entry: entries.len() as u32,
                entry_mask: table.len() as u32 - 1,
            });
            entries.extend(table);
        }
        Ok(Self {
            grids: gpu.buffer_from("scene.cell_grids", &grids)?,
            entries: gpu.buffer_from("scene.cell_entries", &entries)?,
            row: cells.row,
            reach: cells.reach,
        })
    }
}

/// A hash table of which at least half stays free.
fn table(cells: &Cells) -> Vec<CellEntry> {
    let size = (2 * cells.cells.len()).next_power_of_two().max(2);
    let mut table = vec![CellEntry { xy: 0, z: 0, row: NO_REFERENCES }; size];
    for (row, [x, y, z]) in cells.cells.iter().map(|cell| cell.map(u32::from)).enumerate() {
        let xy = x | y << 16;
        let mut at = hash(xy, z) as usize & (size - 1);
        while table[at].row != NO_REFERENCES {
            at = (at + 1) & (size - 1);
        }
        table[at] = CellEntry { xy, z, row: row as u32 };
    }
    table
}

/// Must match `cell_hash` in glsl/lib/cells.glsl.
fn hash(xy: u32, z: u32) -> u32 {
    let h = xy.wrapping_mul(0x9e37_79b1) ^ z.wrapping_mul(0x85eb_ca77);
    let h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h ^ (h >> 13)
}

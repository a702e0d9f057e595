//! Light that arrives at a surface's pixels from one light at a time, and the lists of pixels that need work. METHOD 14.

use crate::error::Result;
use crate::gpu::{Buffer, Cmd, Device};
use crate::shared::{Arriving, LightWork, WORK_ROW};

/// Side of a tile \[pixels\].
const TILE: u32 = 8;

/// Results of rays to one light, and lists of tiles and pixels. Tiles have 8 x 8 pixels.
pub struct Arrivals {
    /// All rays of each pixel together.
    pub pixels: Buffer,
    /// First ray of each pixel.
    pub firsts: Buffer,
    /// Tiles with a surface.
    pub shown: Buffer,
    /// Their number.
    pub shown_work: Buffer,
    /// Picture size, then the tiles that the light reaches.
    pub lit: Buffer,
    /// Their number.
    pub lit_work: Buffer,
    /// Pixels whose neighbours' rays differ.
    pub undecided: Buffer,
    /// Their number.
    pub undecided_work: Buffer,
    /// `LightWork` of empty lists.
    none: Buffer,
}

impl Arrivals {
    /// Creates the buffers for pictures of this size, at most 65536 pixels a side.
    ///
    /// # Errors
    /// Fails if the device runs out of memory.
    pub(super) fn new(gpu: &Device, name: &str, [w, h]: [u32; 2]) -> Result<Self> {
        assert!(w.max(h) <= 1 << 16, "lists hold 16 bits per coordinate");
        let buffer = |what: &str, bytes| gpu.buffer(&format!("{name}.{what}"), bytes);
        let pixels = u64::from(w) * u64::from(h);
        let tiles = w.div_ceil(TILE) as usize * h.div_ceil(TILE) as usize;
        let mut lit = vec![0; 2 + tiles];
        lit[..2].copy_from_slice(&[w, h]);
        let none = LightWork { groups_x: WORK_ROW, groups_z: 1, vertices: 6, ..LightWork::default() };
        let work = size_of::<LightWork>() as u64;
        Ok(Self {
            pixels: buffer("arriving", pixels * size_of::<Arriving>() as u64)?,
            firsts: buffer("first_rays", 4 * pixels)?,
            shown: buffer("shown_tiles", 4 * tiles as u64)?,
            shown_work: buffer("shown_work", work)?,
            lit: gpu.buffer_from(&format!("{name}.lit_tiles"), &lit)?,
            lit_work: buffer("lit_work", work)?,
            undecided: buffer("undecided", 4 * pixels)?,
            undecided_work: buffer("undecided_work", work)?,
            none: gpu.buffer_from(&format!("{name}.no_work"), &[none])?,
        })
    }

    /// Empties a list.
    pub(super) fn empty(&self, cmd: &Cmd<'_>, work: &Buffer) {
        cmd.copy_buffer(&self.none, work, size_of::<LightWork>() as u64);
    }
}

//! Frame rates of the thesis on a GTX 780: tables 6.1, 6.2 and 6.3.

/// Table 6.1: triangles; 500 caches.
pub const TRIANGLES: &str = include_str!("../../../assets/thesis/triangles.csv");

/// Table 6.2: resolution; 1000 caches.
pub const RESOLUTION: &str = include_str!("../../../assets/thesis/resolution.csv");

/// Table 6.3: caches x VALs; 150 000 triangles.
pub const CACHES: &str = include_str!("../../../assets/thesis/caches.csv");

/// Nominal arithmetic peak of a GTX 780 [flop/s].
const PEAK: f64 = 4e12;

/// Pairs of cache and VAL per floating-point operation at the largest point of table 6.3, diffuse lobe, from whole
/// frames.
pub fn pairs_per_flop() -> Option<f64> {
    let ms = frame_ms(CACHES, &[16_000], "D_262144")?;
    Some(16_000.0 * 262_144.0 / (ms * 1e-3) / PEAK)
}

/// Frame time \[ms\] in the row whose first cells are `key` and the column of this name.
pub fn frame_ms(table: &str, key: &[u32], column: &str) -> Option<f64> {
    let mut lines = table.lines();
    let column = lines.next()?.split(',').position(|name| name == column)?;
    let is_it = |line: &&str| {
        let mut cells = line.split(',').map(|cell| cell.parse::<u32>().ok());
        key.iter().all(|wanted| cells.next().flatten() == Some(*wanted))
    };
    let fps: f64 = lines.find(is_it)?.split(',').nth(column)?.parse().ok()?;
    Some(1000.0 / fps)
}

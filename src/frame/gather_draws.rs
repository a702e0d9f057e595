//! Stage 6 by draws: draws every tile of VALs over the atlas, with two caches per texel, and adds the results into
//! float targets. The depth test culls. METHOD 3-4, thesis 5.3.

use super::proxies::Lit;
use super::settings::{DrawSource, whole_tiles};
use crate::error::{Error, Result};
use crate::gpu::{
    Attach, Attachments, Bind, Blend, Buffer, Cmd, Cull, Depth, Device, Format, Image, Load, Pipeline, Raster, Shape,
    Use,
};
use crate::shared::{ATLAS_COLUMNS, GatherPush, TEXEL_CACHES};

/// The gather by draws.
pub struct Draws {
    /// Layout of the caches in the images.
    pub texels: Texels,
    /// Sums: positions and irradiance of the diffuse lobe, then of the glossy lobe, for the first cache of a texel,
    /// then for the second.
    pub sums: Vec<Image>,
    /// Mask of lit texels; only where caches are culled.
    pub mask: Option<Mask>,
    sum: Pipeline,
    source: DrawSource,
    tile: u32,
    resolve: Pipeline,
}

/// Mask of lit texels. A texel is live if any of its caches is, as a group is in the cluster path.
pub struct Mask {
    /// Depth is 1 where a texel is lit.
    pub image: Image,
    /// 1 where a visible vertex or cell references a cache of the texel. The mask is drawn from these flags.
    pub flags: Buffer,
}

impl Draws {
    /// Creates the gather for this many caches.
    ///
    /// # Errors
    /// Fails if the device has fewer simultaneous colour targets than there are sums.
    pub fn new(
        gpu: &Device,
        caches: u32,
        glossy: bool,
        cull: bool,
        source: DrawSource,
        tile: u32,
        dim: bool,
    ) -> Result<Self> {
        if !Self::can(gpu) {
            return Err(Error::NoDevice(format!(
                "{} has fewer than 8 simultaneous colour targets, which the gather by draws needs; use --gather compute",
                gpu.report().name
            )));
        }
        // Stage 7 also needs the distance of the glossy lobe's VALs from the cache.
        let spread = u32::from(dim);
        let targets = [Format::R32G32B32A32_SFLOAT; 4 * TEXEL_CACHES as usize];
        let texels = Texels { caches };
        let lobes = if glossy { &["diffuse", "glossy"][..] } else { &["diffuse"] };
        let mut sums = Vec::new();
        for cache in ["first", "second"] {
            for (lobe, sum) in lobes.iter().flat_map(|lobe| [(lobe, "position"), (lobe, "irradiance")]) {
                let name = format!("gather.{cache}_{lobe}_{sum}");
                sums.push(gpu.target(&name, Format::R32G32B32A32_SFLOAT, texels.width(), texels.rows())?);
            }
        }
        let mask = || -> Result<Mask> {
            Ok(Mask {
                image: gpu.target("cull.mask", Format::D32_SFLOAT, texels.width(), texels.rows())?,
                flags: gpu.buffer("cull.texel_flags", 4 * u64::from(texels.count().max(1)))?,
            })
        };
        Ok(Self {
            texels,
            sums,
            mask: cull.then(mask).transpose()?,
            sum: gpu.raster(&Raster {
                vertex: "tile.vert",
                fragment: Some(if glossy { "gather.frag" } else { "gather_diffuse.frag" }),
                shape: Shape::Triangles,
                streams: &[],
                colors: &targets[..targets.len() / if glossy { 1 } else { 2 }],
                blend: Blend::Add,
                depth: if cull { Depth::Behind } else { Depth::None },
                cull: Cull::None,
                multisampled: false,
                constants: &[source as u32, spread, u32::from(gpu.is_software())],
            })?,
            source,
            tile: whole_tiles(tile),
            resolve: gpu.compute("proxies_images.comp", &[u32::from(glossy), 1, spread])?,
        })
    }

    /// Whether the device has as many simultaneous colour targets as there are sums.
    pub fn can(gpu: &Device) -> bool {
        gpu.most_color_targets() >= 4 * TEXEL_CACHES
    }

    /// Records the stage.
    pub fn record(&self, cmd: &Cmd<'_>, lit: &Lit<'_>) {
        let sums: Vec<_> = self.sums.iter().map(Attach::clear).collect();
        let depth = self.mask.as_ref().map(|mask| Attach { image: &mask.image, load: Load::ReadOnly });
        for (i, (first_proxy, eye)) in lit.runs().enumerate() {
            if i > 0 {
                cmd.barrier(Use::ComputeRead | Use::ComputeWrite, Use::ColorWrite | Use::ComputeWrite); // sums, proxies
            }
            let (cache_count, columns) = (lit.atlas.count, self.texels.columns());
            let push = GatherPush { cache_count, tile: self.tile, columns, first_proxy, eye, ..GatherPush::default() };
            cmd.render(&Attachments { colors: &sums, depth, area: self.texels.area() }, |draw| {
                let vals = lit.vals;
                let resources: [Bind<'_>; 4] = [
                    (&lit.atlas.caches).into(),
                    (&vals.live_count).into(),
                    if self.source == DrawSource::Texels { Bind::Texels } else { Bind::SomeTexels }(&vals.live),
                    (&vals.live).into(),
                ];
                draw.bind(&self.sum, &resources);
                for first in (0..vals.count).step_by(self.tile as usize) {
                    draw.push(&GatherPush { first, ..push });
                    draw.draw(3);
                }
            });
            cmd.barrier(Use::ColorWrite, Use::ComputeRead);
            let [[a, b, c, d], [e, f, g, h]] = self.sums_of_texel().map(|of_cache| of_cache.map(Bind::Image));
            let (caches, proxies) = ((&lit.atlas.caches).into(), (&lit.proxies.buffer).into());
            cmd.bind(&self.resolve, &[caches, proxies, a, b, c, d, e, f, g, h]);
            cmd.push(&push);
            cmd.dispatch(cache_count, 1, 1);
        }
    }

    /// Images of the sums for each cache of a texel. Without a glossy lobe, those of the diffuse lobe take its
    /// bindings.
    fn sums_of_texel(&self) -> [[&Image; 4]; TEXEL_CACHES as usize] {
        let (first, second) = self.sums.split_at(self.sums.len() / 2);
        [first, second].map(|sums| [0, 1, 2, 3].map(|i| &sums[i % sums.len()]))
    }
}

/// Layout of caches in images: blocks of 8 x 8 texels with two caches each. Must match glsl/lib/atlas.glsl.
#[derive(Clone, Copy, Debug)]
pub struct Texels {
    /// Number of caches of all instances.
    pub caches: u32,
}

impl Texels {
    /// Number of texels that hold caches.
    pub fn count(&self) -> u32 {
        self.caches.div_ceil(TEXEL_CACHES)
    }

    /// Index of a cache's texel, row by row.
    pub fn texel(&self, cache: u32) -> usize {
        let (texel, columns) = (cache / TEXEL_CACHES, self.columns());
        let (block, within) = (texel / 64, texel % 64);
        let (x, y) = (block % columns * 8 + within % 8, block / columns * 8 + within / 8);
        (y * self.width() + self.left() + x) as usize
    }

    /// Number of rows of blocks.
    fn block_rows(&self) -> u32 {
        self.caches.div_ceil(64 * TEXEL_CACHES * ATLAS_COLUMNS).max(1)
    }

    /// Number of columns of blocks, chosen so that as few blocks as possible stay unused.
    pub fn columns(&self) -> u32 {
        self.caches.div_ceil(64 * TEXEL_CACHES).div_ceil(self.block_rows()).max(1)
    }

    /// Number of texels to the left of the blocks.
    fn left(&self) -> u32 {
        if self.columns() <= 16 { 64 - 8 * self.columns().div_ceil(2) } else { 0 }
    }

    /// Number of texels in a row.
    fn width(&self) -> u32 {
        self.left() + 8 * self.columns()
    }

    /// Area of the blocks: corner and size \[texels\].
    pub fn area(&self) -> [u32; 4] {
        [self.left(), 0, 8 * self.columns(), self.rows()]
    }

    /// Number of rows of texels.
    pub fn rows(&self) -> u32 {
        8 * self.block_rows()
    }
}

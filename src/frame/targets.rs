//! Every image and buffer that a frame writes: one line each with name, format, size and when.

use super::bounce::BounceTargets;
use super::gather::{GatherPath, GatherSettings};
use super::pack::live_args;
use super::pyramid::Pyramid;
use super::{Plan, ProxyWeight, SceneBuffers, Settings};
use crate::error::{Error, Result};
use crate::gpu::{Buffer, Cmd, Format, Gpu, Image};
use crate::shared::{
    ATLAS_COLUMNS, CLUSTER_GROUP, Cache, DEPTH_IMAGE_TEXELS, GATHER_THREADS, GatherSums, OCCLUDER_GROUP, OccluderGroup,
    PACK_BLOCK, Proxy, TEXEL_CACHES, VAL_TILE, Val, VertexLight, VisibleArgs, VisibleVertex,
};
use glam::Vec3;

/// The resources of a frame; stages write and read them, nobody else owns any.
pub struct Targets {
    /// Picture size [pixels].
    pub size: [u32; 2],
    /// Reversed depth: 1 at the near plane, 0 where nothing is.
    pub depth: Image,
    /// Shading normal and Phong exponent.
    pub normal: Image,
    /// `rho_d`, and x of the octahedral geometric normal.
    pub albedo: Image,
    /// `rho_g`, and y of the octahedral geometric normal.
    pub specular: Image,
    /// Which triangle a pixel shows: draw, from 1, and number within it. Only where caches are interpolated.
    pub element: Option<Image>,
    /// Emitted and directly reflected radiance.
    pub direct: Image,
    /// The picture: tone-mapped sRGB.
    pub output: Image,
    /// Exposure value that the picture's own luminance asks for.
    pub exposure: Buffer,
    /// Shadow map of one light at a time; six-view lights tile it three by two.
    pub shadow: Option<Image>,
    /// One extended RSM at a time.
    pub rsm: Option<RsmTargets>,
    /// Indirect radiance.
    pub indirect: Option<IndirectTargets>,
    /// Caches in the world and their proxies.
    pub caches: Option<CacheTargets>,
    /// What the camera sees of the scene; only where caches are interpolated.
    pub visible: Option<VisibleTargets>,
}

/// Stage 4.
pub struct RsmTargets {
    /// World position, and 1 where something is.
    pub position: Image,
    /// Normal on the lit side, and the material.
    pub normal: Image,
    /// `rho_d`.
    pub albedo: Image,
    /// Reversed depth.
    pub depth: Image,
    /// What its texels become.
    pub vals: ValTargets,
}

/// The VALs of all lights.
pub struct ValTargets {
    /// One of each texel, light by light, view by view, row by row; then those of the surfaces that emit.
    pub all: Buffer,
    /// How many.
    pub count: u32,
    /// 1 where a VAL carries light or pulls a proxy.
    pub flags: Buffer,
    /// Flagged VALs of each block.
    pub blocks: Buffer,
    /// The flagged ones, in order, padded with dark ones to whole tiles.
    pub live: Buffer,
    /// Their number before padding.
    pub live_count: Buffer,
}

/// Stage 8.
pub struct IndirectTargets {
    /// Diffuse lobe.
    pub diffuse: Image,
    /// Glossy lobe; only where a material has one.
    pub glossy: Option<Image>,
}

/// Stages 3 and 6.
pub struct CacheTargets {
    /// The atlas: every instance's caches in the world.
    pub atlas: Buffer,
    /// Proxy lights of both lobes; of a cache that is not lit what an earlier frame has left.
    pub proxies: Buffer,
    /// Caches of all instances.
    pub count: u32,
    /// Sums of the gather's fragment path: positions and irradiance of the diffuse, then of the glossy lobe, of a texel's
    /// first cache, then of its second.
    pub sums: Vec<Image>,
    /// Sums of its compute path, part by part of the VALs.
    pub parts: Option<Buffer>,
    /// Which caches its compute path lights.
    pub live: Option<LiveCaches>,
    /// Which texels its fragment path lights: depth 1; only where caches are culled. A texel is live with any of its
    /// caches, as a group is with clusters.
    pub mask: Option<Image>,
    /// 1 where a visible element refers to a texel's caches: what the mask is drawn from.
    pub texel_flags: Option<Buffer>,
    /// What clustering adds.
    pub clusters: Option<ClusterTargets>,
    /// What further bounces add.
    pub bounces: Option<BounceTargets>,
    /// Bounds of stage 7's groups of discs; only with shadows of proxies.
    pub occluders: Option<Buffer>,
    /// Slot by slot of the list, where the view of a live cache ends; only with shadows of every VAL.
    pub depth_images: Option<Buffer>,
}

/// The list that the compute path works through: of caches, or of groups of consecutive ones with clusters. A group is
/// live with any of its caches, and all of it is lit: what a cache receives does not depend on which others are seen.
pub struct LiveCaches {
    /// 1 where a visible element refers to an item; all 0 between frames.
    pub flags: Buffer,
    /// Flagged items of each block.
    pub blocks: Buffer,
    /// Indices of live items, ascending; of all, until culling says otherwise.
    pub list: Buffer,
    /// Their number, and the gather's dispatch; of all of them, too.
    pub args: Buffer,
    /// How many of the parts are there, of the caches of each of the gather's threads; all 0 between frames.
    pub arrived: Buffer,
    /// Items of all instances.
    pub count: u32,
    /// Caches of an item.
    pub group: u32,
    /// Items of a workgroup.
    pub per_workgroup: u32,
    /// VALs, or nodes, of a part: those of `GatherSettings`, or more where the parts would take too much memory.
    pub split: u32,
}

/// What the gather by clusters needs beside the pyramid.
pub struct ClusterTargets {
    /// Number of nodes.
    pub node_count: Buffer,
    /// What each slot of the list receives by the coarse cut [lx].
    pub totals: Buffer,
    /// Pairs of a cache and a node or VAL that each workgroup has computed.
    pub pairs: Buffer,
}

/// Vertices of the triangles that pixels show, or cells of the surfaces.
pub struct VisibleTargets {
    /// Per vertex or cell of each instance: the last frame that showed it.
    pub seen: Buffer,
    /// Per vertex: where in `list`. With cells, per pixel: the cell's row of references.
    pub slots: Buffer,
    /// Each once.
    pub list: Buffer,
    /// Averaged lights of vertices.
    pub lights: Buffer,
    /// How many.
    pub args: Buffer,
    /// `args` of none.
    pub none: Buffer,
}

impl Targets {
    /// Makes what the plan needs.
    pub fn new(gpu: &Gpu, plan: &Plan, scene: &SceneBuffers, settings: &Settings) -> Result<Self> {
        let [w, h] = settings.size;
        let float = Format::R32G32B32A32_SFLOAT;
        let half = Format::R16G16B16A16_SFLOAT;
        let depth = Format::D32_SFLOAT;
        let shadow = settings.shadow_map;
        let mut made = Self {
            size: settings.size,
            depth: gpu.target("gbuffer.depth", depth, w, h)?,
            normal: gpu.target("gbuffer.normal", float, w, h)?,
            albedo: gpu.target("gbuffer.albedo", half, w, h)?,
            specular: gpu.target("gbuffer.specular", half, w, h)?,
            element: plan.lightskin.then(|| gpu.target("gbuffer.element", Format::R32G32_UINT, w, h)).transpose()?,
            direct: gpu.target("direct.radiance", float, w, h)?,
            output: gpu.target("composite.output", Format::R8G8B8A8_SRGB, w, h)?,
            exposure: gpu.buffer("composite.exposure", 16)?,
            shadow: plan.direct.then(|| gpu.target("direct.shadow", depth, shadow, shadow)).transpose()?,
            rsm: plan.indirect().then(|| RsmTargets::new(gpu, scene, settings)).transpose()?,
            indirect: plan
                .indirect()
                .then(|| {
                    Ok::<_, Error>(IndirectTargets {
                        diffuse: gpu.target("interpolate.diffuse", float, w, h)?,
                        glossy: plan.glossy.then(|| gpu.target("interpolate.glossy", float, w, h)).transpose()?,
                    })
                })
                .transpose()?,
            caches: None,
            visible: plan.lightskin.then(|| VisibleTargets::new(gpu, scene, settings.size)).transpose()?,
        };
        if plan.lightskin {
            let vals = made.rsm.as_ref().map_or(0, |rsm| rsm.vals.count);
            let mut caches = CacheTargets::new(gpu, plan.glossy, scene.cache_count, vals, &settings.gather)?;
            if settings.cluster.is_some() {
                caches.cluster(gpu, Pyramid::node_count(scene, settings.rsm))?;
            }
            if plan.bounces {
                caches.bounce(gpu, vals)?;
            }
            if plan.occlude || plan.depth_images {
                caches.occluders = Some(caches.new_occluders(gpu)?);
            }
            if plan.depth_images {
                caches.shadow(gpu)?;
            }
            if plan.cull && settings.gather.path == GatherPath::Fragment {
                caches.mask = Some(gpu.target("cull.mask", Format::D32_SFLOAT, caches.width(), caches.rows())?);
                caches.texel_flags = Some(gpu.buffer("cull.texel_flags", 4 * u64::from(caches.texels()))?);
            }
            made.caches = Some(caches);
        }
        Ok(made)
    }

    /// Every image, for the one transition at a frame's beginning.
    pub fn images(&self) -> Vec<&Image> {
        let mut all = vec![&self.depth, &self.normal, &self.albedo, &self.specular, &self.direct, &self.output];
        all.extend(&self.element);
        all.extend(&self.shadow);
        if let Some(rsm) = &self.rsm {
            all.extend([&rsm.position, &rsm.normal, &rsm.albedo, &rsm.depth]);
        }
        if let Some(indirect) = &self.indirect {
            all.push(&indirect.diffuse);
            all.extend(&indirect.glossy);
        }
        if let Some(caches) = &self.caches {
            all.extend(&caches.sums);
            all.extend(&caches.mask);
        }
        all
    }

    /// Every buffer.
    pub fn buffers(&self) -> Vec<&Buffer> {
        let mut all = vec![&self.exposure];
        if let Some(RsmTargets { vals, .. }) = &self.rsm {
            all.extend([&vals.all, &vals.flags, &vals.blocks, &vals.live, &vals.live_count]);
        }
        if let Some(caches) = &self.caches {
            all.extend([&caches.atlas, &caches.proxies]);
            all.extend(&caches.parts);
            all.extend(&caches.occluders);
            all.extend(&caches.depth_images);
            all.extend(&caches.texel_flags);
            all.extend(caches.live.iter().flat_map(|l| [&l.flags, &l.blocks, &l.list, &l.args, &l.arrived]));
            all.extend(caches.clusters.iter().flat_map(|c| [&c.node_count, &c.totals, &c.pairs]));
            all.extend(caches.bounces.iter().flat_map(BounceTargets::buffers));
        }
        all.extend(self.visible.iter().flat_map(|v| [&v.seen, &v.slots, &v.list, &v.lights, &v.args, &v.none]));
        all
    }
}

impl RsmTargets {
    fn new(gpu: &Gpu, scene: &SceneBuffers, settings: &Settings) -> Result<Self> {
        let n = if scene.lights().is_empty() { 1 } else { settings.rsm };
        let val_count: u64 = scene.lights().iter().map(|l| u64::from(l.views) * u64::from(l.rsm_size(n)).pow(2)).sum();
        let val_count = val_count + scene.emitters.len() as u64;
        let val_count = u32::try_from(val_count).ok().filter(|c| *c <= 1 << 25);
        let val_count =
            val_count.ok_or_else(|| Error::TooLarge("more than 33 million VALs; ask for a smaller --rsm".into()))?;
        let float = Format::R32G32B32A32_SFLOAT;
        Ok(Self {
            position: gpu.target("rsm.position", float, n, n)?,
            normal: gpu.target("rsm.normal", float, n, n)?,
            albedo: gpu.target("rsm.albedo", float, n, n)?,
            depth: gpu.target("rsm.depth", Format::D32_SFLOAT, n, n)?,
            vals: ValTargets::with(gpu, val_count, &scene.emitters, settings.proxy_weight)?,
        })
    }
}

impl ValTargets {
    fn new(gpu: &Gpu, count: u32) -> Result<Self> {
        let bytes = |count: u32| u64::from(count) * size_of::<Val>() as u64;
        Ok(Self {
            all: gpu.buffer("rsm.vals", bytes(count))?,
            count,
            flags: gpu.buffer("rsm.val_flags", 4 * u64::from(count))?,
            blocks: gpu.buffer("rsm.val_blocks", 4 * u64::from(count.div_ceil(PACK_BLOCK)))?,
            live: gpu.buffer("rsm.live_vals", bytes(count.next_multiple_of(VAL_TILE)))?,
            live_count: gpu.buffer("rsm.live_val_count", 4)?,
        })
    }

    /// So many, of which the last are given and stay.
    fn with(gpu: &Gpu, count: u32, last: &[Val], weight: ProxyWeight) -> Result<Self> {
        let made = Self::new(gpu, count)?;
        if last.is_empty() {
            return Ok(made);
        }
        let (given, given_flags) = weighed(last, weight);
        let mut all = vec![Val::default(); count as usize - last.len()];
        let mut flags = vec![0; all.len()];
        all.extend(given);
        flags.extend(given_flags);
        Ok(Self { all: gpu.buffer_from("rsm.vals", &all)?, flags: gpu.buffer_from("rsm.val_flags", &flags)?, ..made })
    }

    /// Records that the last ones are these from now on.
    pub fn update(&self, cmd: &Cmd<'_>, last: &[Val], weight: ProxyWeight) {
        let (vals, flags) = weighed(last, weight);
        let first = u64::from(self.count) - last.len() as u64;
        cmd.update(&self.all, first * size_of::<Val>() as u64, &vals);
        cmd.update(&self.flags, 4 * first, &flags);
    }

    /// These VALs, all of them live.
    pub fn of(gpu: &Gpu, vals: &[Val]) -> Result<Self> {
        let mut padded = vals.to_vec();
        padded.resize(vals.len().next_multiple_of(VAL_TILE as usize), Val { area: 1.0, ..Val::default() });
        let count = vals.len() as u32;
        let live = gpu.buffer_from("rsm.live_vals", &padded)?;
        Ok(Self { live, live_count: gpu.buffer_from("rsm.live_val_count", &[count])?, ..Self::new(gpu, count)? })
    }
}

/// VALs with the weights that their proxies' positions have, and which of them carry light.
fn weighed(vals: &[Val], weight: ProxyWeight) -> (Vec<Val>, Vec<u32>) {
    let weight_of = |val: &Val| match weight {
        ProxyWeight::Irradiance => val.flux.dot(Vec3::new(0.2126, 0.7152, 0.0722)),
        ProxyWeight::FormFactor if val.flux == Vec3::ZERO => 0.0,
        ProxyWeight::FormFactor => val.area,
    };
    vals.iter().map(|val| (Val { weight: weight_of(val), ..*val }, u32::from(val.flux != Vec3::ZERO))).unzip()
}

/// Most memory that the parts of the compute path's sums take [bytes], unless a part would then be too long.
const PARTS_BYTES: u64 = 64 << 20;

/// Most VALs of a part: older lavapipe leaves loops after 65 535 rounds, and a few VALs are a round.
const LONGEST_PART: u32 = 32_768;

/// Most nodes: each is a round, and so are four of the VALs below, three a node, at most.
const LONGEST_CLUSTER_PART: u32 = 12_288;

/// Nodes of a part if memory allows: those over 3000 VALs.
const CLUSTER_PART: u32 = 1024;

impl CacheTargets {
    /// Targets of the gather without culling.
    pub fn new(gpu: &Gpu, glossy: bool, count: u32, vals: u32, settings: &GatherSettings) -> Result<Self> {
        let n = u64::from(count.max(1));
        let mut made = Self {
            atlas: gpu.buffer("atlas.caches", n * size_of::<Cache>() as u64)?,
            proxies: gpu.buffer_from("gather.proxies", &vec![Proxy::default(); n as usize])?,
            count,
            sums: Vec::new(),
            parts: None,
            live: None,
            mask: None,
            texel_flags: None,
            clusters: None,
            bounces: None,
            occluders: None,
            depth_images: None,
        };
        match settings.path {
            GatherPath::Fragment => {
                let lobes = if glossy { &["diffuse", "glossy"][..] } else { &["diffuse"] };
                let [width, height] = [made.width(), made.rows()];
                for cache in ["first", "second"] {
                    for (lobe, sum) in lobes.iter().flat_map(|lobe| [(lobe, "position"), (lobe, "irradiance")]) {
                        let name = format!("gather.{cache}_{lobe}_{sum}");
                        made.sums.push(gpu.target(&name, Format::R32G32B32A32_SFLOAT, width, height)?);
                    }
                }
            }
            GatherPath::Compute => {
                let per_workgroup = GATHER_THREADS * settings.caches_per_thread;
                made.list(gpu, [vals, settings.split, LONGEST_PART], [1, per_workgroup])?;
            }
        }
        Ok(made)
    }

    /// Makes the compute path's parts and list: of so many lights, so many in a part if memory allows and never more than so
    /// many, for so many caches in an item and items in a workgroup.
    fn list(&mut self, gpu: &Gpu, [lights, split, longest]: [u32; 3], [group, per_workgroup]: [u32; 2]) -> Result<()> {
        let lights = u64::from(lights.max(1));
        let n = u64::from(self.count.max(1));
        let sums = n * size_of::<GatherSums>() as u64;
        let in_memory = lights.div_ceil((PARTS_BYTES / sums).max(1));
        let split = in_memory.max(split.into()).next_multiple_of(VAL_TILE.into()).min(longest.into());
        self.parts = Some(gpu.buffer("gather.parts", sums * lights.div_ceil(split))?);
        let items = n.div_ceil(group.into());
        let live = self.count.div_ceil(group);
        let args = live_args(live, lights, per_workgroup, split);
        self.live = Some(LiveCaches {
            flags: gpu.buffer_from("cull.flags", &vec![0_u32; items as usize])?,
            blocks: gpu.buffer("cull.blocks", 4 * items.div_ceil(PACK_BLOCK.into()))?,
            list: gpu.buffer_from("cull.live", &(0..items as u32).collect::<Vec<_>>())?,
            args: gpu.buffer_from("cull.live_args", &[args])?,
            arrived: gpu.buffer_from("gather.arrived", &vec![0_u32; items as usize])?,
            count: live,
            group,
            per_workgroup,
            split: split as u32,
        });
        Ok(())
    }

    /// Makes parts and list anew, for groups of caches and parts of a pyramid, and what else clustering needs.
    pub fn cluster(&mut self, gpu: &Gpu, nodes: u32) -> Result<()> {
        self.list(gpu, [nodes, CLUSTER_PART, LONGEST_CLUSTER_PART], [CLUSTER_GROUP, 1])?;
        let live = self.live.as_ref().expect("made above");
        let workgroups = u64::from(live.count.max(1)) * u64::from(nodes.div_ceil(live.split).max(1));
        self.clusters = Some(ClusterTargets {
            node_count: gpu.buffer_from("gather.node_count", &[nodes])?,
            totals: gpu.buffer("gather.totals", 4 * u64::from(self.count.max(1)))?,
            pairs: gpu.buffer("gather.pairs", 4 * workgroups)?,
        });
        Ok(())
    }

    /// Makes parts anew, for those of the caches' own VALs in front of the `vals` of the primary lights, and what else
    /// further bounces need.
    fn bounce(&mut self, gpu: &Gpu, vals: u32) -> Result<()> {
        let live = self.live.as_ref().expect("of the compute path");
        let parts = self.count.div_ceil(live.split);
        let sums = u64::from(self.count.max(1)) * size_of::<GatherSums>() as u64;
        self.parts = Some(gpu.buffer("gather.parts", sums * u64::from(parts + vals.div_ceil(live.split).max(1)))?);
        self.bounces = Some(BounceTargets::new(gpu, self.count, parts)?);
        Ok(())
    }

    /// Makes the depth images that shadows of every VAL need.
    pub fn shadow(&mut self, gpu: &Gpu) -> Result<()> {
        let bytes = u64::from(self.count.max(1)) * u64::from(4 * DEPTH_IMAGE_TEXELS);
        self.depth_images = Some(gpu.buffer("gather.depth_images", bytes)?);
        Ok(())
    }

    /// Buffer with the number of VALs, or nodes over them, that are split into parts.
    pub fn light_count<'a>(&'a self, vals: &'a ValTargets) -> &'a Buffer {
        self.clusters.as_ref().map_or(&vals.live_count, |clusters| &clusters.node_count)
    }

    /// Texels of the fragment path's images that hold caches.
    pub fn texels(&self) -> u32 {
        self.count.div_ceil(TEXEL_CACHES)
    }

    /// Texel of a cache in the fragment path's images, row by row; twin of glsl/lib/atlas.glsl.
    pub fn texel(&self, cache: u32) -> usize {
        let (texel, columns) = (cache / TEXEL_CACHES, self.columns());
        let (block, within) = (texel / 64, texel % 64);
        let (x, y) = (block % columns * 8 + within % 8, block / columns * 8 + within / 8);
        (y * self.width() + self.left() + x) as usize
    }

    /// Images of the fragment path's sums for each cache of a texel; those of the diffuse lobe stand in where there is no
    /// glossy one.
    pub fn sums_of_texel(&self) -> [[&Image; 4]; TEXEL_CACHES as usize] {
        let (first, second) = self.sums.split_at(self.sums.len() / 2);
        [first, second].map(|sums| [0, 1, 2, 3].map(|i| &sums[i % sums.len()]))
    }

    /// Bounds of the groups of caches that stage 7, or what draws depth images, skips together.
    pub fn new_occluders(&self, gpu: &Gpu) -> Result<Buffer> {
        let groups = u64::from(self.count.div_ceil(OCCLUDER_GROUP).max(1));
        gpu.buffer("occlude.groups", groups * size_of::<OccluderGroup>() as u64)
    }

    /// Rows of blocks in the fragment path's images.
    fn block_rows(&self) -> u32 {
        self.count.div_ceil(64 * TEXEL_CACHES * ATLAS_COLUMNS).max(1)
    }

    /// Columns of blocks in the fragment path's images; as few blocks as possible are left over.
    pub fn columns(&self) -> u32 {
        self.count.div_ceil(64 * TEXEL_CACHES).div_ceil(self.block_rows()).max(1)
    }

    /// Texels to the left of the blocks.
    fn left(&self) -> u32 {
        if self.columns() <= 16 { 64 - 8 * self.columns().div_ceil(2) } else { 0 }
    }

    /// Texels of a row of the fragment path's images.
    fn width(&self) -> u32 {
        self.left() + 8 * self.columns()
    }

    /// What of the fragment path's images holds blocks: corner and size [texels].
    pub fn area(&self) -> [u32; 4] {
        [self.left(), 0, 8 * self.columns(), self.rows()]
    }

    /// Rows of texels in the fragment path's images.
    pub fn rows(&self) -> u32 {
        8 * self.block_rows()
    }
}

impl VisibleTargets {
    fn new(gpu: &Gpu, scene: &SceneBuffers, [w, h]: [u32; 2]) -> Result<Self> {
        let all = u64::from(scene.slot_count.max(1));
        let pixels = u64::from(w) * u64::from(h);
        let by_cells = scene.cells.is_some();
        let most = all.min(3 * pixels);
        let none = VisibleArgs { groups_y: 1, groups_z: 1, ..VisibleArgs::default() };
        Ok(Self {
            seen: gpu.buffer_from("visible.seen", &vec![0_u32; all as usize])?,
            slots: gpu.buffer("visible.slots", 4 * if by_cells { pixels } else { all })?,
            list: gpu.buffer("visible.list", most * size_of::<VisibleVertex>() as u64)?,
            lights: gpu.buffer("visible.lights", if by_cells { 1 } else { most } * size_of::<VertexLight>() as u64)?,
            args: gpu.buffer("visible.args", size_of::<VisibleArgs>() as u64)?,
            none: gpu.buffer_from("visible.none", &[none])?,
        })
    }
}

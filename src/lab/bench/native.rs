//! Stage 6 on the CPU with native vector registers and all cores: the yardstick for software devices.
//!
//! The sums of `glsl/lib/gather.glsl` in f32, VAL after VAL. A tile of VALs is summed in registers and then added to
//! the previous tiles' sums. Each lane holds one cache; VALs are broadcast from memory. The widest registers of the
//! machine are chosen at run time.

use super::simd::{exp2, log2};
use crate::shared::{Cache, GatherSums, VAL_TILE, Val};
use glam::{Vec3, Vec4};
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::f32::consts::PI;

/// Numbers in `GatherSums`, except for the last, which only shadows need.
const SUMS: usize = 15;

/// Numbers of the diffuse lobe, which come first.
const DIFFUSE: usize = 8;

/// Caches per task: the number of lanes of the widest register.
const GROUP: usize = 16;

/// VALs processed at a time.
const AT_ONCE: usize = 2;

/// Floats of a VAL in memory; see `shared::Val`.
type ValFloats = [f32; 12];

/// Lights every cache by every VAL, seen from `eye` (as in `shared::GatherPush`). Without `glossy` the glossy sums are
/// 0 and cost nothing.
pub fn gather(vals: &[Val], caches: &[Cache], eye: Vec4, glossy: bool) -> Vec<GatherSums> {
    let vals: &[ValFloats] = bytemuck::cast_slice(vals);
    let mut sums = vec![GatherSums::default(); caches.len()];
    let arch = Arch::new();
    sums.par_chunks_mut(GROUP).zip(caches.par_chunks(GROUP)).for_each(|(sums, caches)| {
        let lanes = Lanes::new(caches, eye);
        if glossy {
            arch.dispatch(Group::<true> { vals, lanes: &lanes, sums });
        } else {
            arch.dispatch(Group::<false> { vals, lanes: &lanes, sums });
        }
    });
    sums
}

/// Name of the CPU, with family and model, which identify its generation if a hypervisor hides the name.
#[cfg(target_arch = "x86_64")]
pub fn cpu() -> String {
    let cpu = raw_cpuid::CpuId::new();
    let name = cpu.get_processor_brand_string().map_or("x86-64".to_owned(), |brand| brand.as_str().trim().to_owned());
    match cpu.get_feature_info() {
        Some(info) => format!("{name} (family {}, model {})", info.family_id(), info.model_id()),
        None => name,
    }
}

/// The CPU's architecture.
#[cfg(not(target_arch = "x86_64"))]
pub fn cpu() -> String {
    std::env::consts::ARCH.to_owned()
}

/// Name of the vector registers in use and their number of lanes.
pub fn registers() -> (String, usize) {
    struct Width;
    impl WithSimd for Width {
        type Output = usize;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }
    let arch = Arch::new();
    let name = format!("{arch:?}");
    (name.split('(').next().unwrap_or_default().to_owned(), arch.dispatch(Width))
}

/// A group of caches, one per lane. Spare lanes repeat the last cache.
struct Lanes {
    position: [[f32; GROUP]; 3],
    against: [[f32; GROUP]; 3],
    mirrored: [[f32; GROUP]; 3],
    half_exponent: [f32; GROUP],
}

impl Lanes {
    fn new(caches: &[Cache], eye: Vec4) -> Self {
        let mut lanes = Self {
            position: [[0.0; GROUP]; 3],
            against: [[0.0; GROUP]; 3],
            mirrored: [[0.0; GROUP]; 3],
            half_exponent: [0.0; GROUP],
        };
        for lane in 0..GROUP {
            let Cache { position, normal, exponent, .. } = caches[lane.min(caches.len() - 1)];
            let view = if eye.w > 0.0 { position - eye.truncate() } else { -eye.truncate() };
            let view = view * view.length_squared().max(1e-30).sqrt().recip();
            let mirrored: Vec3 = view - 2.0 * normal.dot(view) * normal;
            for axis in 0..3 {
                lanes.position[axis][lane] = position[axis];
                lanes.against[axis][lane] = -normal[axis];
                lanes.mirrored[axis][lane] = mirrored[axis];
            }
            lanes.half_exponent[lane] = 0.5 * exponent;
        }
        lanes
    }
}

/// One task: a group of caches.
struct Group<'a, const GLOSSY: bool> {
    vals: &'a [ValFloats],
    lanes: &'a Lanes,
    sums: &'a mut [GatherSums],
}

impl<const GLOSSY: bool> WithSimd for Group<'_, GLOSSY> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for (register, out) in self.sums.chunks_mut(S::F32_LANES).enumerate() {
            let register = |lanes: &[f32; GROUP]| S::as_simd_f32s(lanes).0[register];
            let vector = |lanes: &[[f32; GROUP]; 3]| [register(&lanes[0]), register(&lanes[1]), register(&lanes[2])];
            let caches = Caches {
                position: vector(&self.lanes.position),
                against: vector(&self.lanes.against),
                mirrored: vector(&self.lanes.mirrored),
                half_exponent: register(&self.lanes.half_exponent),
            };
            let mut total = [simd.splat_f32s(0.0); SUMS];
            for tile in self.vals.chunks(VAL_TILE as usize) {
                let sums = caches.gather::<GLOSSY>(simd, tile);
                for (total, sum) in total.iter_mut().zip(sums) {
                    *total = simd.add_f32s(*total, sum);
                }
            }
            let numbers: &[f32] = bytemuck::cast_slice(&total);
            for (lane, out) in out.iter_mut().enumerate() {
                let out: &mut [f32; SUMS + 1] = bytemuck::cast_mut(out);
                for (i, out) in out[..SUMS].iter_mut().enumerate() {
                    *out = numbers[i * S::F32_LANES + lane];
                }
            }
        }
    }
}

/// One register of caches.
struct Caches<S: Simd> {
    position: [S::f32s; 3],
    /// Negated normal.
    against: [S::f32s; 3],
    mirrored: [S::f32s; 3],
    half_exponent: S::f32s,
}

impl<S: Simd> Caches<S> {
    /// Sums over one tile.
    #[inline(always)]
    fn gather<const GLOSSY: bool>(&self, simd: S, tile: &[ValFloats]) -> [S::f32s; SUMS] {
        let mut sums = [simd.splat_f32s(0.0); SUMS];
        let (several, rest) = tile.as_chunks::<AT_ONCE>();
        for vals in several {
            self.add::<GLOSSY, AT_ONCE>(simd, vals, &mut sums);
        }
        for val in rest {
            self.add::<GLOSSY, 1>(simd, &[*val], &mut sums);
        }
        sums
    }

    /// Adds the light of several VALs. Each step processes all of them, so that a CPU can work on one while it waits
    /// for another.
    #[inline(always)]
    fn add<const GLOSSY: bool, const N: usize>(&self, simd: S, vals: &[ValFloats; N], sums: &mut [S::f32s; SUMS]) {
        let all = |value: f32| simd.splat_f32s(value);
        let (mul, fma) = (|a, b| simd.mul_f32s(a, b), |a, b, c| simd.mul_add_f32s(a, b, c));
        let dot = |a: &[S::f32s; 3], b: &[S::f32s; 3]| fma(a[2], b[2], fma(a[1], b[1], mul(a[0], b[0])));
        let zero = all(0.0);
        let [cx, cy, cz] = self.position;
        let mut d = [[zero; 3]; N];
        let (mut d2, mut g, mut lobe) = ([zero; N], [zero; N], [zero; N]);
        for i in 0..N {
            let [x, y, z, area, nx, ny, nz, ..] = vals[i].map(all);
            d[i] = [simd.sub_f32s(x, cx), simd.sub_f32s(y, cy), simd.sub_f32s(z, cz)];
            d2[i] = dot(&d[i], &d[i]);
            let facing = simd.max_f32s(mul(all(PI), d2[i]), area);
            let inverse = simd.div_f32s(all(1.0), simd.max_f32s(mul(d2[i], facing), all(1e-37)));
            // Both cosines carry |d|; both dot products are negative where the VAL lights the cache.
            let to_cache = simd.min_f32s(dot(&[nx, ny, nz], &d[i]), zero);
            let to_val = simd.min_f32s(dot(&self.against, &d[i]), zero);
            g[i] = mul(mul(to_cache, to_val), inverse);
            if GLOSSY {
                let along = simd.max_f32s(dot(&self.mirrored, &d[i]), zero);
                lobe[i] = simd.max_f32s(mul(mul(along, along), mul(facing, inverse)), all(1e-37));
            }
        }
        if GLOSSY {
            // cos^k = (cos^2)^(k / 2).
            lobe = exp2(simd, log2(simd, lobe).map(|log| mul(self.half_exponent, log)));
        }
        for i in 0..N {
            let [.., red, green, blue, weight] = vals[i].map(all);
            let (w, g) = (mul(weight, g[i]), g[i]);
            let [x, y, z] = d[i];
            let add = |sums: &mut [S::f32s], w, g| {
                for (sum, part) in sums.iter_mut().zip([x, y, z]) {
                    *sum = fma(part, w, *sum);
                }
                sums[3] = simd.add_f32s(sums[3], w);
                for (sum, part) in sums[4..].iter_mut().zip([red, green, blue]) {
                    *sum = fma(part, g, *sum);
                }
            };
            let (diffuse, glossy) = sums.split_at_mut(DIFFUSE);
            add(diffuse, w, g);
            diffuse[7] = fma(d2[i], w, diffuse[7]);
            if GLOSSY {
                add(glossy, mul(w, lobe[i]), mul(g, lobe[i]));
            }
        }
    }
}

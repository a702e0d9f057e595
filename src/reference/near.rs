//! Short rays from a point of a surface, in f64: their hits and the resulting light. Twin of `glsl/near_rays.comp`,
//! `near_hits.comp` (without its rays to the sky) and `near.comp`.
//! METHOD 11.

use super::brdf::Lobe;
use super::depth_image::tangents;
use super::light::facing_irradiance;
use super::world::{Sides, Surface, World};
use crate::scene::{Light, LightKind, luminance, material};
use crate::shared::{DIRECTION_SIDE, DIRECTIONS, GUIDE_WORDS, GUIDES, NEAR_SIDE, NO_DIRECTION, Val};
use glam::{DQuat, DVec2, DVec3};
use std::f64::consts::PI;

/// Point `i` of `count` directions about +z with cosine density.
pub fn direction(i: u32, count: u32) -> DVec3 {
    let r2 = (f64::from(i) + 0.5) / f64::from(count);
    let angle = f64::from(i) * PI * (3.0 - 5.0_f64.sqrt());
    DVec3::new(r2.sqrt() * angle.cos(), r2.sqrt() * angle.sin(), (1.0 - r2).sqrt())
}

/// Index of the texel that contains a direction in a cache's light by direction. The unit vector maps to the octahedron
/// |x| + |y| + |z| = 1, whose lower half is folded out around the upper one.
pub fn direction_index(way: DVec3) -> usize {
    let on = way / way.abs().element_sum();
    let fold = |a: f64, b: f64| if on.z < 0.0 { (1.0 - b.abs()).copysign(if a < 0.0 { -1.0 } else { 1.0 }) } else { a };
    let texel =
        |a: f64| ((a + 1.0) / 2.0 * f64::from(DIRECTION_SIDE)).clamp(0.0, f64::from(DIRECTION_SIDE - 1)) as usize;
    texel(fold(on.y, on.x)) * DIRECTION_SIDE as usize + texel(fold(on.x, on.y))
}

/// Middle of a direction's texel on the unfolded octahedron, in the square from -1 to 1.
fn texel_middle(index: usize) -> [f64; 2] {
    let side = DIRECTION_SIDE as usize;
    [index % side, index / side].map(|i| (i as f64 + 0.5) / side as f64 * 2.0 - 1.0)
}

/// A direction's texel and its eight neighbours.
fn beside(texel: usize) -> impl Iterator<Item = usize> {
    let middle = texel_middle(texel);
    let one = 2.0 / f64::from(DIRECTION_SIDE);
    (-1..=1).flat_map(|j| (-1..=1).map(move |i| [f64::from(i), f64::from(j)])).map(move |step| {
        // Beyond its edge the square goes on as if turned about the edge's middle.
        let [mut x, mut y] = [0, 1].map(|k| middle[k] + step[k] * one);
        if x.abs() > 1.0 {
            [x, y] = [2.0_f64.copysign(x) - x, -y];
        }
        if y.abs() > 1.0 {
            [x, y] = [-x, 2.0_f64.copysign(y) - y];
        }
        direction_index(on_octahedron(x, y).normalize())
    })
}

/// Share of a direction that is open to the sky, by the number of open quarters per direction. It is 0 where the sky all
/// around is open, too: there caches know the sky, and no ray need follow it.
pub fn open_share(texel: usize, quarters: impl Fn(usize) -> u32) -> f64 {
    if beside(texel).all(|texel| quarters(texel) == 4) { 0.0 } else { f64::from(quarters(texel)) / 4.0 }
}

/// Solid angle \[sr\] of a direction's square on the octahedron, evaluated at its centre.
pub fn solid_angle(index: usize) -> f64 {
    let [x, y] = texel_middle(index);
    // The face's area is sqrt(3) times its projection, seen under the cosine 1 / (sqrt(3) |on|).
    (2.0 / f64::from(DIRECTION_SIDE)).powi(2) / on_octahedron(x, y).length().powi(3)
}

/// Radiance [cd/m^2] from the device's packed form: 8 bits a channel and a shared exponent.
pub fn unpack_radiance(packed: u32) -> DVec3 {
    let part = |i: u32| f64::from(packed >> (8 * i) & 0xff);
    DVec3::new(part(0), part(1), part(2)) * 2.0_f64.powi((packed >> 24) as i32 - 135)
}

/// Mean radiance [cd/m^2] from VALs at a point for each direction. VALs fade in between the squared distances `fade`
/// [m^2]; `sees` tells whether the way to a VAL, given relative to the point, is open. The light of `together`
/// consecutive VALs comes from the direction of the one that lights the point most.
pub fn radiances(
    vals: &[Val],
    (position, normal): (DVec3, DVec3),
    fade: [f64; 2],
    together: usize,
    sees: impl Fn(DVec3) -> bool,
) -> Vec<DVec3> {
    let mut sums = vec![DVec3::ZERO; DIRECTIONS as usize];
    // Vector to a VAL, its light on a surface that faces it, and a measure of how much of it the point gets.
    let from = |val: &Val| {
        let d = val.position.as_dvec3() - position;
        let (squared, way) = (d.length_squared(), d.normalize_or_zero());
        let share = ((squared - fade[0]) / (fade[1] - fade[0])).clamp(0.0, 1.0);
        let facing = -val.normal.as_dvec3().dot(way);
        let geometry = share * facing.max(0.0) / f64::from(val.area).max(PI * squared);
        (d, geometry * val.flux.as_dvec3(), geometry * normal.dot(d))
    };
    for group in vals.chunks(together) {
        let lit: Vec<_> = group.iter().map(from).filter(|(.., at_point)| *at_point > 0.0).collect();
        let most = lit.iter().copied().reduce(|most, other| if other.2 > most.2 { other } else { most });
        if let Some((d, ..)) = most.filter(|(d, ..)| sees(*d)) {
            sums[direction_index(d.normalize())] += lit.iter().map(|(_, light, _)| *light).sum::<DVec3>();
        }
    }
    sums.into_iter().enumerate().map(|(i, sum)| sum / solid_angle(i)).collect()
}

/// Least roughness of the lobe in which surfaces reflect direct light along rays.
const LEAST_LOBE: f32 = 0.35;

/// BRDF [1/sr] of a surface for a ray of this unit direction, by the unit direction to the light.
pub fn brdf_along(surface: &Surface, looking: DVec3) -> impl Fn(DVec3) -> DVec3 + use<> {
    let mut widened = surface.reflection;
    match &mut widened.lobe {
        material::Lobe::Ggx { roughness, .. } => *roughness = roughness.max(LEAST_LOBE),
        material::Lobe::Phong { exponent, .. } => *exponent = exponent.min(0.5 / LEAST_LOBE.powi(4) - 0.5),
    }
    let lobe = Lobe::new(&widened, surface.vertex_normal, looking);
    let diffuse = surface.reflection.diffuse(-surface.vertex_normal.dot(looking)).as_dvec3() / PI;
    move |towards| diffuse + lobe.brdf(towards)
}

/// Radiance [cd/m^2] that a surface reflects along a ray of this unit direction from all punctual lights.
pub fn reflected_direct(world: &World<'_>, surface: &Surface, looking: DVec3) -> DVec3 {
    let brdf = brdf_along(surface, looking);
    let given = |light: &Light| {
        let (irradiance, way) = facing_irradiance(light, surface.position);
        let distance = match light.kind {
            LightKind::Directional => f64::INFINITY,
            _ => light.position.distance(surface.position) * (1.0 - 1e-6),
        };
        let (cosine, above) = (surface.vertex_normal.dot(way), surface.geometric.dot(way));
        let arrives = cosine > 0.0 && above > 0.0 && !world.blocked_within(surface.position, way, distance);
        if arrives { irradiance * cosine * brdf(way) } else { DVec3::ZERO }
    };
    world.scene().lights.iter().map(given).sum()
}

/// Direction, not of unit length, at a place of the octahedron, unfolded into the square from -1 to 1.
pub fn on_octahedron(x: f64, y: f64) -> DVec3 {
    let z = 1.0 - x.abs() - y.abs();
    let folded = |a: f64, b: f64| if z < 0.0 { (1.0 - b.abs()).copysign(a) } else { a };
    DVec3::new(folded(x, y), folded(y, x), z)
}

/// Unit vector to the middle of a direction's texel.
pub fn middle_of(index: usize) -> DVec3 {
    let [x, y] = texel_middle(index);
    on_octahedron(x, y).normalize()
}

/// Where most of a cache's light comes from: how many of [`GUIDES`] parts of equal illuminance each direction has.
/// `luminances` by direction [cd/m^2], with the sky's; `normal` of the cache.
pub fn part_counts(luminances: &[f64], normal: DVec3) -> Vec<u32> {
    let illuminance = |(i, luminance): (usize, &f64)| luminance * solid_angle(i) * middle_of(i).dot(normal).max(0.1);
    let light: Vec<f64> = luminances.iter().enumerate().map(illuminance).collect();
    let total: f64 = light.iter().sum();
    let parts = |light: f64| if total > 0.0 { (light / total * f64::from(GUIDES)).round() as u32 } else { 0 };
    let (mut sum, mut counted) = (0.0, 0);
    let part_count = |light: f64| {
        sum += light;
        let count = parts(sum) - counted;
        counted += count;
        count
    };
    light.into_iter().map(part_count).collect()
}

/// Light of caches by direction, as the device stores it.
pub struct FarLight<'a> {
    /// Packed radiance [cd/m^2], [`DIRECTIONS`] values per cache.
    pub radiances: &'a [u32],
    /// What guides rays, [`GUIDE_WORDS`] values per cache.
    pub guides: &'a [u32],
}

/// One of a point's rays.
#[derive(Clone, Copy, Debug)]
pub struct NearRay {
    /// Unit direction.
    pub way: DVec3,
    /// Length \[m\]; infinite where caches disagree.
    pub reach: f64,
    /// Projected solid angle that the ray stands for \[sr\].
    pub weight: f64,
    /// Radiance from far surfaces, as caches know it [cd/m^2].
    pub far: DVec3,
}

impl FarLight<'_> {
    /// Number of a cache's parts in a direction.
    fn parts(&self, cache: usize, texel: usize) -> u32 {
        self.guides[cache * GUIDE_WORDS as usize + texel] & 0xff
    }

    /// Direction of one of a cache's parts; [`NO_DIRECTION`] if it has no light.
    fn part_direction(&self, cache: usize, part: u32) -> u32 {
        self.guides[(cache as u32 * GUIDE_WORDS + DIRECTIONS + part / 4) as usize] >> (8 * (part % 4)) & 0xff
    }

    /// Greatest luminance [cd/m^2] of a direction and its eight neighbours, as a cache knows it.
    fn luminance_about(&self, cache: usize, texel: usize) -> f64 {
        let known = |texel: usize| unpack_radiance(self.radiances[cache * DIRECTIONS as usize + texel]);
        beside(texel).map(|texel| luminance(known(texel))).fold(0.0, f64::max)
    }

    /// Rays of a point with the two unit `normals` of its triangle and its vertices: `each` about the vertex normal, and
    /// `guided` ones. `x` and `y` are the column and row of its pixel. Rays about the normal are turned about
    /// it by `turn` \[rad\], and guided ones go elsewhere by it. `caches` about the point have these weights, which sum to 1,
    /// the greatest first. If `reach` \[m\] is infinite, the caches' light counts for nothing.
    pub fn rays(
        &self,
        caches: &[(usize, f64)],
        [geometric, normal]: [DVec3; 2],
        ([each, guided], [x, y]): ([u32; 2], [u32; 2]),
        [reach, turn]: [f64; 2],
    ) -> Vec<NearRay> {
        const SQUARE: u32 = NEAR_SIDE * NEAR_SIDE;
        let square = [x, y].map(|at| at / NEAR_SIDE);
        let subset = y % NEAR_SIDE * NEAR_SIDE + x % NEAR_SIDE;
        let [tangent, bitangent] = tangents(normal);
        let about = (0..each).map(|i| {
            let local = DQuat::from_rotation_z(turn) * direction(i * SQUARE + subset, each * SQUARE);
            tangent * local.x + bitangent * local.y + normal * local.z
        });
        let follow = (0..guided).filter_map(|i| {
            let number = i * SQUARE + subset;
            let step = [0.8566748838, 0.7338918566, 0.6287067210, 0.5385968675];
            let chance = |k: usize| {
                let [x, y] = square.map(f64::from);
                let of_view = turn / (2.0 * PI) * [1.0, 7.0, 19.0, 43.0][k];
                (0.5 + f64::from(number) * step[k] + x * step[(k + 3) % 4] + y * step[(k + 2) % 4] + of_view).fract()
            };
            let mut sum = 0.0;
            let upto = |share: f64| {
                sum += share;
                sum
            };
            let ends: Vec<f64> = caches.iter().map(|(_, share)| *share).map(upto).collect();
            let cache = ends.iter().position(|end| chance(0) < *end).unwrap_or(caches.len().checked_sub(1)?);
            let part = (f64::from(number) + chance(1)) * f64::from(GUIDES) / f64::from(guided * SQUARE);
            let to = self.part_direction(caches[cache].0, part as u32);
            let side = DIRECTION_SIDE;
            let at = |texel: u32, within: f64| (f64::from(texel) + within) / f64::from(side) * 2.0 - 1.0;
            let way = on_octahedron(at(to % side, chance(2)), at(to / side, chance(3))).normalize();
            (to != NO_DIRECTION && way.dot(normal) > 0.0 && way.dot(geometric) > 0.0).then_some(way)
        });
        let ray = |way: DVec3| {
            let texel = direction_index(way);
            let known = |cache: usize| unpack_radiance(self.radiances[cache * DIRECTIONS as usize + texel]);
            let most = caches.iter().map(|(cache, _)| luminance(known(*cache))).fold(0.0, f64::max);
            let agree = caches.iter().all(|(cache, _)| self.luminance_about(*cache, texel) >= 0.3 * most);
            // Guided rays per solid angle, by the texels per solid angle at this direction of the octahedron.
            let parts: f64 = caches.iter().map(|(cache, share)| share * f64::from(self.parts(*cache, texel))).sum();
            let texels = f64::from(DIRECTIONS) / 4.0 / way.abs().element_sum().powi(3);
            let above = way.dot(geometric);
            let guides = if above > 0.0 { f64::from(guided) * parts / f64::from(GUIDES) * texels } else { 0.0 };
            let cosine = way.dot(normal).max(0.0);
            NearRay {
                way: way - 2.0 * above.min(0.0) * geometric,
                reach: if agree { reach } else { f64::INFINITY },
                weight: cosine / (f64::from(each) / PI * cosine + guides).max(1e-30),
                far: caches.iter().map(|(cache, share)| *share * known(*cache)).sum(),
            }
        };
        about.chain(follow).map(ray).collect()
    }
}

/// What a point's rays find of a sky.
#[derive(Clone, Copy, Debug, Default)]
pub struct SkyAlong {
    /// Irradiance by the sky along the rays that reach it \[lx\].
    pub open: DVec3,
    /// The same along all rays.
    pub all: DVec3,
    /// Sum of the sky's luminance behind surfaces that rays about the normal hit [cd/m^2], and its sum over their distance
    /// \[cd/m^3\].
    pub hidden: DVec2,
}

/// The sky along a point's rays, of which `each` are about the normal. A surface within their reach blocks them. Beyond that,
/// `sky` tells by direction how open the caches call it, and its radiance; if they call it neither open nor closed, the
/// ray goes on and decides.
pub fn sky_along(
    world: &World<'_>,
    position: DVec3,
    (rays, each): (&[NearRay], u32),
    sky: impl Fn(DVec3) -> (f64, DVec3),
) -> SkyAlong {
    let mut found = SkyAlong::default();
    for (ray, number) in rays.iter().zip(0..) {
        let (open, radiance) = sky(ray.way);
        let decides = (open - 0.5).abs() < 0.4999;
        let reach = if decides { f64::INFINITY } else { ray.reach };
        match world.nearest(position, ray.way, Sides::Both).filter(|hit| hit.distance < reach) {
            Some(hit) if number < each => found.hidden += luminance(radiance) * DVec2::new(1.0, 1.0 / hit.distance),
            Some(_) => {}
            None if decides => found.open += ray.weight * radiance,
            None => found.open += ray.weight * open * radiance,
        }
        found.all += ray.weight * radiance;
    }
    found
}

/// Result of one pixel's rays, as far as pixels share it.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// Irradiance from the surfaces hit \[lx\].
    pub irradiance: DVec3,
    /// Share of the caches' light along rays that hit nothing.
    pub open: DVec3,
    /// Share of the sky's light along rays that reach it.
    pub open_sky: DVec3,
    /// Mean reciprocal distance of what hides the sky \[1/m\].
    pub sky_crowding: f64,
    /// Mean reciprocal length of the rays \[1/m\].
    pub crowding: f64,
    /// Luminance of the irradiance from the surfaces hit and of the caches' light along the other rays \[lx\].
    pub light: f64,
    /// Mean square of single pixels' light \[lx^2\].
    pub light_squared: f64,
    /// Position of the surface.
    pub position: DVec3,
    /// Unit normals of the vertices and of the triangle.
    pub normals: [DVec3; 2],
}

/// Unit normal from the device's code: 12 bits for each place on the unfolded octahedron.
pub fn decoded_normal(code: f32) -> DVec3 {
    let [x, y] = [code as u32 % 4096, code as u32 / 4096].map(|place| (f64::from(place) - 2048.0) / 2047.0);
    on_octahedron(x, y).normalize()
}

/// Similarity of two surfaces: how far the rays of one are valid for the other. `d` is the vector between them. Each has
/// two unit normals, that of its vertices and that of its triangle. Twin of `glsl/lib/near_alike.glsl`.
pub fn alike(d: DVec3, [vertex, geometric]: [DVec3; 2], [other_vertex, other_geometric]: [DVec3; 2]) -> f64 {
    let smooth = |low: f64, high: f64, x: f64| {
        let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    let out_of_plane = [geometric, other_geometric].map(|n| d.dot(n).abs() / d.length().max(1e-15));
    let [turned, edge] = [vertex - other_vertex, geometric - other_geometric].map(|by| by.length());
    let allowed = turned / 4.0 + if edge > turned { edge - turned } else { 0.0 };
    let off_plane = smooth(0.05, 0.2, out_of_plane[0].max(out_of_plane[1]) - allowed);
    let facing = [vertex.dot(other_vertex), geometric.dot(other_geometric)].map(|cosine| smooth(0.5, 0.9, cosine));
    (1.0 - off_plane) * facing[0].min(facing[1]) + 1e-4
}

/// Spreads results once over pixels this many steps apart; `None` if a pixel shows no surface. Twin of
/// `glsl/near_spread.comp`.
pub fn spread(found: &[Option<Found>], [width, height]: [usize; 2], step: usize) -> Vec<Option<Found>> {
    // The filter has combined a square of pixels, and passes of smaller steps about as many as this one's step squared.
    let pixels = (NEAR_SIDE as usize).pow(2) + step.pow(2);
    let variance = |p: &Found| (p.light_squared - p.light.powi(2)).max(0.0) / pixels as f64;
    let of_pixel = |index: usize| {
        let own = found[index]?;
        let (mut irradiance, mut open, mut weights) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        let [mut light, mut light_squared] = [0.0; 2];
        let (mut open_sky, mut sky_weights) = (DVec3::ZERO, 0.0);
        for (dx, dy) in (-1..=1_isize).flat_map(|dy| (-1..=1_isize).map(move |dx| (dx, dy))) {
            let x = (index % width).checked_add_signed(dx * step as isize).filter(|x| *x < width);
            let y = (index / width).checked_add_signed(dy * step as isize).filter(|y| *y < height);
            let Some(p) = x.zip(y).and_then(|(x, y)| found[y * width + x]) else { continue };
            let d = own.position - p.position;
            let weight = |crowding: f64| {
                let near = 0.5_f64.powi((dx.abs() + dy.abs()) as i32) * alike(d, own.normals, p.normals);
                if (dx, dy) == (0, 0) { 1.0 } else { near * (-(5.0 * d.length() * crowding).powi(2)).exp() }
            };
            let stops = ((own.light + 1e-20) / (p.light + 1e-20)).log2();
            // A difference of two standard deviations counts half.
            let (apart, noise) = ((own.light - p.light).powi(2), variance(&own) + variance(&p));
            let certain = if apart > 0.0 { apart / (apart + 4.0 * noise) } else { 0.0 };
            let by_light = weight(own.crowding.max(p.crowding)) * (-stops * stops * certain).exp();
            light += by_light * p.light;
            light_squared += by_light * p.light_squared;
            irradiance += by_light * p.irradiance;
            open += by_light * p.open;
            weights += by_light;
            let by_sky = weight(own.sky_crowding.max(p.sky_crowding));
            open_sky += by_sky * p.open_sky;
            sky_weights += by_sky;
        }
        let [irradiance, open] = [irradiance, open].map(|sum| sum / weights);
        let [light, light_squared] = [light, light_squared].map(|sum| sum / weights);
        Some(Found { irradiance, open, open_sky: open_sky / sky_weights, light, light_squared, ..own })
    };
    (0..found.len()).map(of_pixel).collect()
}

/// Radiance that a pixel's lobe receives, as far as pixels share it.
#[derive(Clone, Copy, Debug)]
pub struct FoundLobe {
    /// Mean radiance [cd/m^2].
    pub taken: DVec3,
    /// Position of the surface.
    pub position: DVec3,
    /// Unit normals of the vertices and of the triangle.
    pub normals: [DVec3; 2],
    /// Unit axis of the lobe.
    pub mirrored: DVec3,
    /// Width of the lobe \[rad\].
    pub width: f64,
    /// Mean reciprocal length of the lobe's rays \[1/m\].
    pub nearness: f64,
}

/// Spreads lobes' radiance [cd/m^2] once over pixels this many steps apart whose lobes look at the same place; `None`
/// if a pixel has no lobe. Twin of `glsl/near_spread.comp`.
pub fn spread_lobes(found: &[Option<FoundLobe>], [width, height]: [usize; 2], step: usize) -> Vec<Option<DVec3>> {
    let of_pixel = |index: usize| {
        let own = found[index]?;
        let (mut taken, mut weights) = (DVec3::ZERO, 0.0);
        for (dx, dy) in (-1..=1_isize).flat_map(|dy| (-1..=1_isize).map(move |dx| (dx, dy))) {
            let x = (index % width).checked_add_signed(dx * step as isize).filter(|x| *x < width);
            let y = (index / width).checked_add_signed(dy * step as isize).filter(|y| *y < height);
            let Some(p) = x.zip(y).and_then(|(x, y)| found[y * width + x]) else { continue };
            // Distance between the points that both look at, per distance, in widths of the narrower lobe.
            let (narrow, wide) = (own.width.min(p.width), own.width.max(p.width));
            let d = own.position - p.position;
            let apart = (d * own.nearness.max(p.nearness) + own.mirrored - p.mirrored).length() / narrow;
            let t = ((narrow / wide - 0.25) / 0.5).clamp(0.0, 1.0);
            let like = t * t * (3.0 - 2.0 * t);
            let weight = match (dx, dy) {
                (0, 0) => 1.0,
                _ => {
                    let near = 0.5_f64.powi((dx.abs() + dy.abs()) as i32) * alike(d, own.normals, p.normals);
                    near * like * (-8.0 * apart * apart).exp()
                }
            };
            taken += weight * p.taken;
            weights += weight;
        }
        Some(taken / weights)
    };
    (0..found.len()).map(of_pixel).collect()
}

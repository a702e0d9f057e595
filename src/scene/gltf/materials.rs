//! Materials, textures and images; reads only those that drawn primitives use.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use glam::{Affine2, Vec3, Vec4};
use image::ImageFormat;
use rayon::prelude::*;

use super::{Notes, files};
use crate::Result;
use crate::image::decode::{self, Encoded};
use crate::image::ktx2;
use crate::scene::accessor::Accessors;
use crate::scene::json::{Document, Object, error_at, printable};
use crate::scene::material::{MOST_UV, texture_transform};
use crate::scene::medium::Subsurface;
use crate::scene::{Image, Material, Phong, Sampler, Texture, Wrap};

/// Largest width and height \[texels\] of an image, supported by every desktop Vulkan driver.
const MAX_SIDE: u32 = 16384;

/// Upper bound of absorption in glass \[1/m\].
const MOST_ATTENUATION: f64 = 1e9;

/// The materials in use so far. Their textures refer to the file's images until `finish`.
pub(super) struct Materials<'a> {
    document: &'a Document,
    /// Index in `list` by the file's material (`None` for glTF's default).
    pub indices: BTreeMap<Option<usize>, usize>,
    /// The scene's materials.
    pub list: Vec<Material>,
}

impl<'a> Materials<'a> {
    pub(super) fn new(document: &'a Document) -> Self {
        Self { document, indices: BTreeMap::new(), list: Vec::new() }
    }

    /// The scene's index of a primitive's material.
    pub(super) fn index(&mut self, primitive: &Object, notes: &mut Notes) -> Result<usize> {
        let key = primitive.index("material")?;
        if let Some(&index) = self.indices.get(&key) {
            return Ok(index);
        }
        let material = match key {
            Some(index) => {
                let object = self.document.item("materials", index, primitive)?;
                let name = object.name(|| format!("material {index}"));
                Reader { document: self.document, notes }.material(&object, name)?
            }
            None => Material::default(),
        };
        self.list.push(material);
        self.indices.insert(key, self.list.len() - 1);
        Ok(self.list.len() - 1)
    }

    /// The materials and the decoded images that they use. Textures whose image does not decode are dropped with a
    /// note.
    pub(super) fn finish(mut self, accessors: &Accessors, notes: &mut Notes) -> Result<(Vec<Material>, Vec<Image>)> {
        let mut wanted: Vec<usize> =
            self.list.iter_mut().flat_map(Material::textures_mut).filter_map(|t| t.as_ref().map(|t| t.image)).collect();
        wanted.sort_unstable();
        wanted.dedup();
        let folder = files::folder(&self.document.file);
        let mut sources = Vec::new();
        for &index in &wanted {
            sources.push(source(self.document, index, accessors)?);
        }
        let too_large = |reason| error_at(&self.document.file, "images", reason);
        let decoded = decode_all(&sources, &folder).map_err(too_large)?;

        let mut images = Vec::new();
        let mut renumbered = BTreeMap::new();
        for ((&index, source), image) in wanted.iter().zip(&sources).zip(decoded) {
            match image {
                Ok(image) => {
                    renumbered.insert(index, images.len());
                    images.push(image);
                }
                Err(reason) => {
                    notes.add(format!("Image {index} '{}' is not used: {reason}.", source.name));
                }
            }
        }
        for texture in self.list.iter_mut().flat_map(Material::textures_mut) {
            *texture = texture.and_then(|t| renumbered.get(&t.image).map(|&image| Texture { image, ..t }));
        }
        Ok((self.list, images))
    }
}

/// Reads materials and notes what it has to change.
struct Reader<'a, 'n> {
    document: &'a Document,
    notes: &'n mut Notes,
}

impl Reader<'_, '_> {
    fn material(&mut self, object: &Object, name: String) -> Result<Material> {
        let mut material = Material { name, double_sided: object.flag("doubleSided")?, ..Material::default() };
        if let Some(pbr) = object.object("pbrMetallicRoughness")? {
            let base = pbr.vector::<4>("baseColorFactor")?.unwrap_or([1.0; 4]);
            material.base_color = Vec4::from(self.clamped(&pbr, "baseColorFactor", base, 1.0));
            material.base_color_texture = self.texture(&pbr, "baseColorTexture")?;
            material.metallic = self.factor(&pbr, "metallicFactor", 1.0, 1.0)?;
            material.roughness = self.factor(&pbr, "roughnessFactor", 1.0, 1.0)?;
            material.metallic_roughness_texture = self.texture(&pbr, "metallicRoughnessTexture")?;
        } else if let Some(old) = object.extension("KHR_materials_pbrSpecularGlossiness")? {
            self.specular_glossiness(&old, &mut material)?;
        }
        material.normal_texture = self.texture(object, "normalTexture")?;
        if let Some(normal) = object.object("normalTexture")? {
            material.normal_scale = normal.number("scale")?.unwrap_or(1.0) as f32;
        }

        // Some exporters write factors above 1 instead of a strength; accept that.
        let emissive = object.vector::<3>("emissiveFactor")?.unwrap_or([0.0; 3]);
        material.emissive = Vec3::from(self.clamped(object, "emissiveFactor", emissive, f64::from(f32::MAX)));
        if let Some(extension) = object.extension("KHR_materials_emissive_strength")? {
            // 1e12 cd/m^2 is far above the sun's 1.6e9 and far below values whose products and sums overflow.
            material.emissive *= self.factor(&extension, "emissiveStrength", 1.0, 1e12)?;
        }
        material.emissive = material.emissive.min(Vec3::splat(1e12));
        material.emissive_texture = self.texture(object, "emissiveTexture")?;

        material.alpha_cutoff = match object.text("alphaMode")? {
            None | Some("OPAQUE") => None,
            Some("MASK") => Some(self.factor(object, "alphaCutoff", 0.5, f64::from(f32::MAX))?),
            Some("BLEND") => {
                self.notes.count("Materials with alphaMode BLEND that let light pass where alpha is under 0.5", 1);
                material.blend = true;
                Some(0.5)
            }
            Some(mode) => {
                return Err(
                    object.error(format!("has the unknown alphaMode {}: export the file again", printable(mode)))
                );
            }
        };

        if let Some(extension) = object.extension("KHR_materials_ior")? {
            let ior = extension.number("ior")?.unwrap_or(1.5);
            // In this extension, 0 means total reflection.
            material.ior = if ior == 0.0 || ior >= 1.0 { ior as f32 } else { 1.0 };
            if f64::from(material.ior) != f64::from(ior as f32) {
                self.notes.add(format!("{}: ior is {ior}, taken as 1.", extension.place));
            }
        }
        if let Some(extension) = object.extension("KHR_materials_specular")? {
            material.specular = self.factor(&extension, "specularFactor", 1.0, 1.0)?;
            material.specular_texture = self.texture(&extension, "specularTexture")?;
            let color = extension.vector::<3>("specularColorFactor")?.unwrap_or([1.0; 3]);
            let color = self.clamped(&extension, "specularColorFactor", color, f64::from(f32::MAX));
            material.specular_color = Vec3::from(color);
            material.specular_color_texture = self.texture(&extension, "specularColorTexture")?;
        }
        if let Some(extension) = object.extension("KHR_materials_transmission")? {
            material.transmission = self.factor(&extension, "transmissionFactor", 0.0, 1.0)?;
            material.transmission_texture = self.texture(&extension, "transmissionTexture")?;
            // For shadows a surface is either opaque or clear; most light passes an evenly clear one.
            let clear = material.transmission >= 0.5 && material.transmission_texture.is_none();
            if clear && material.alpha_cutoff.is_none() {
                material.alpha_cutoff = Some(f32::INFINITY);
            }
        }
        if let Some(extension) = object.extension("KHR_materials_volume")? {
            material.thickness = self.factor(&extension, "thicknessFactor", 0.0, f64::from(f32::MAX))?;
            let distance = extension.number("attenuationDistance")?.unwrap_or(f64::INFINITY);
            let color = extension.vector::<3>("attenuationColor")?.unwrap_or([1.0; 3]);
            let color = self.clamped(&extension, "attenuationColor", color, 1.0);
            if distance > 0.0 {
                let rate = |left: f32| -f64::from(left.max(1e-6)).ln() / distance;
                material.attenuation = Vec3::from(color.map(|left| rate(left).min(MOST_ATTENUATION) as f32));
            }
            material.thickness_texture = self.texture(&extension, "thicknessTexture")?;
        }
        if let Some(extension) = object.extension("KHR_materials_clearcoat")? {
            material.coat = self.factor(&extension, "clearcoatFactor", 0.0, 1.0)?;
            material.coat_texture = self.texture(&extension, "clearcoatTexture")?;
            material.coat_roughness = self.factor(&extension, "clearcoatRoughnessFactor", 0.0, 1.0)?;
            material.coat_roughness_texture = self.texture(&extension, "clearcoatRoughnessTexture")?;
            if extension.value("clearcoatNormalTexture").is_some() {
                self.notes.count("Normal textures of clear coats that are not used", 1);
            }
        }
        if let Some(extension) = object.extension("KHR_materials_sheen")? {
            let color = extension.vector::<3>("sheenColorFactor")?.unwrap_or([0.0; 3]);
            material.sheen_color = Vec3::from(self.clamped(&extension, "sheenColorFactor", color, 1.0));
            material.sheen_color_texture = self.texture(&extension, "sheenColorTexture")?;
            material.sheen_roughness = self.factor(&extension, "sheenRoughnessFactor", 0.0, 1.0)?;
            material.sheen_roughness_texture = self.texture(&extension, "sheenRoughnessTexture")?;
        }
        material.phong = self.phong(object)?;
        if let Some(own) = extras(object, "subsurface")? {
            self.subsurface(&own, &mut material)?;
        }
        Ok(material)
    }

    /// The archived extension, for materials without metallic-roughness: a dielectric with explicit F0. Index of
    /// refraction 0 makes F0 equal to the specular colour.
    fn specular_glossiness(&mut self, object: &Object, material: &mut Material) -> Result<()> {
        let diffuse = object.vector::<4>("diffuseFactor")?.unwrap_or([1.0; 4]);
        let specular = object.vector::<3>("specularFactor")?.unwrap_or([1.0; 3]);
        material.base_color = Vec4::from(self.clamped(object, "diffuseFactor", diffuse, 1.0));
        material.base_color_texture = self.texture(object, "diffuseTexture")?;
        material.metallic = 0.0;
        material.roughness = 1.0 - self.factor(object, "glossinessFactor", 1.0, 1.0)?;
        material.ior = 0.0;
        material.specular_color = Vec3::from(self.clamped(object, "specularFactor", specular, 1.0));
        material.specular_color_texture = self.texture(object, "specularGlossinessTexture")?;
        if material.specular_color_texture.is_some() {
            self.notes.count("Glossiness textures of which only the colour is used", 1);
        }
        Ok(())
    }

    /// `extras.lightskin.phong`.
    fn phong(&mut self, object: &Object) -> Result<Option<Phong>> {
        let Some(phong) = extras(object, "phong")? else { return Ok(None) };
        let specular =
            phong.vector::<3>("specular")?.ok_or_else(|| phong.error("has no specular [r, g, b], which is needed"))?;
        let exponent = phong.number("exponent")?.ok_or_else(|| phong.error("has no exponent, which is needed"))?;
        if exponent < 0.0 {
            return Err(phong.error(format!("exponent is {exponent}; at least 0 is needed")));
        }
        let specular = Vec3::from(self.clamped(&phong, "specular", specular, 1.0));
        Ok(Some(Phong { specular, exponent: exponent as f32 }))
    }

    /// `extras.lightskin.subsurface`: a preset, a colour with a radius, or coefficients.
    fn subsurface(&mut self, own: &Object, material: &mut Material) -> Result<()> {
        let positive = |key: &str, least: f64, most: f64| -> Result<Option<f32>> {
            match own.number(key)? {
                Some(x) if !(least..=most).contains(&x) => {
                    Err(own.error(format!("{key} is {x}; {least} to {most} is needed")))
                }
                x => Ok(x.map(|x| x as f32)),
            }
        };
        let channels = |key: &str, least: f64, most: f64| -> Result<Option<Vec3>> {
            let Some(values) = own.vector::<3>(key)? else { return Ok(None) };
            match values.iter().find(|x| !(least..=most).contains(*x)) {
                Some(x) => Err(own.error(format!("{key} holds {x}; {least} to {most} is needed"))),
                None => Ok(Some(Vec3::from(values.map(|x| x as f32)))),
            }
        };
        let own_ior = positive("ior", 1.0, 4.0)?;
        let ior = own_ior.unwrap_or(if material.ior >= 1.0 { material.ior.min(4.0) } else { 1.5 });
        let has = |key| own.value(key).is_some();
        let mut medium = match (own.text("preset")?, channels("color", 0.0, 1.0)?, channels("sigma_s", 0.0, 1e9)?) {
            (Some(name), None, None) => {
                let found = Subsurface::preset(name).ok_or_else(|| {
                    let known: Vec<_> = Subsurface::presets().collect();
                    own.error(format!("has the unknown preset {}; use one of {}", printable(name), known.join(", ")))
                })?;
                Subsurface { ior: own_ior.unwrap_or(found.ior), ..found }
            }
            (None, Some(color), None) => {
                let radius = match own.value("radius") {
                    Some(value) if value.is_number() => positive("radius", 1e-9, 1e6)?.map(Vec3::splat),
                    _ => channels("radius", 1e-9, 1e6)?,
                };
                let radius = radius.ok_or_else(|| {
                    own.error("has a color but no radius; the radius, a mean free path in metres, is needed")
                })?;
                Subsurface::of_color(color, radius, ior)
            }
            (None, None, Some(sigma_s)) => {
                let sigma_a = channels("sigma_a", 0.0, 1e9)?
                    .ok_or_else(|| own.error("has sigma_s but no sigma_a, which is needed"))?;
                if (sigma_s + sigma_a).min_element() <= 0.0 {
                    return Err(
                        own.error("sigma_s and sigma_a are both 0 in a channel, where nothing would stop light; raise one of them")
                    );
                }
                let g = positive("g", -0.99, 0.99)?.unwrap_or(0.0);
                Subsurface { sigma_s, sigma_a, g, ior, scale: 1.0 }
            }
            _ => return Err(own.error("needs one of preset, color with radius, or sigma_s with sigma_a")),
        };
        medium.scale = positive("scale", 1e-6, 1e6)?.unwrap_or(1.0);
        if has("g") && !has("sigma_s") {
            return Err(own.error("g needs sigma_s and sigma_a; presets and colours do not use it"));
        }
        let is_seen_through = material.is_seen_through();
        if is_seen_through {
            self.notes.add(format!(
                "{}: a material with subsurface scattering is opaque; its transparency is ignored.",
                own.place
            ));
        }
        if material.base_color_texture.is_some() && (is_seen_through || material.alpha_cutoff.is_none()) {
            self.notes.add(format!(
                "{}: the subsurface medium gives the colour; the base colour texture is not used.",
                own.place
            ));
        }
        material.fill(medium);
        Ok(())
    }

    fn factor(&mut self, object: &Object, key: &str, default: f64, most: f64) -> Result<f32> {
        let value = object.number(key)?.unwrap_or(default);
        Ok(self.clamped(object, key, [value], most)[0])
    }

    /// Clamps numbers to [0, most], with a note if that changes them.
    fn clamped<const N: usize>(&mut self, object: &Object, key: &str, values: [f64; N], most: f64) -> [f32; N] {
        if values.iter().any(|x| !(0.0..=most).contains(x)) {
            let range = if most < 1e30 { format!("clamped to 0 ... {most}") } else { "clamped to 0".into() };
            self.notes.add(format!("{}: {key} is {values:?}, {range}.", object.place));
        }
        values.map(|x| x.clamp(0.0, most) as f32)
    }

    fn texture(&mut self, owner: &Object, key: &str) -> Result<Option<Texture>> {
        let Some(info) = owner.object(key)? else { return Ok(None) };
        let index = info.index("index")?.ok_or_else(|| info.error("has no index: export the file again"))?;
        let texture = self.document.item("textures", index, &info)?;
        let mut uv_set = info.whole("texCoord")?.unwrap_or(0);
        let mut transform = Affine2::IDENTITY;
        if let Some(extension) = info.extension("KHR_texture_transform")? {
            let offset = extension.vector::<2>("offset")?.unwrap_or([0.0; 2]);
            let scale = extension.vector::<2>("scale")?.unwrap_or([1.0; 2]);
            let rotation = extension.number("rotation")?.unwrap_or(0.0);
            uv_set = extension.whole("texCoord")?.unwrap_or(uv_set);
            transform = texture_transform(offset, rotation, scale);
            let most = f64::from(MOST_UV);
            if offset.into_iter().chain(scale).any(|x| x.abs() > most) {
                self.notes.add(format!("{}: offset and scale are clamped to -{most} ... {most}.", extension.place));
            }
        }
        let sampler = match texture.index("sampler")? {
            Some(index) => sampler(&self.document.item("samplers", index, &texture)?)?,
            None => Sampler::default(),
        };
        let Some(image) = source_of(&texture)? else {
            let place = &texture.place;
            self.notes.add(format!("{}: {place} has no readable image and is not used.", info.place));
            return Ok(None);
        };
        self.document.item("images", image, &texture)?;
        if uv_set > 1 {
            self.notes.add(format!("{}: TEXCOORD_{uv_set} is not supported, the texture is not used.", info.place));
            return Ok(None);
        }
        Ok(Some(Texture { image, uv_set: uv_set as u8, transform, sampler }))
    }
}

/// A member of `extras.lightskin`. Other extras may hold anything; only the entry under our own name is checked.
fn extras<'a>(object: &Object<'a>, key: &str) -> Result<Option<Object<'a>>> {
    if object.value("extras").and_then(|extras| extras.get("lightskin")).is_none() {
        return Ok(None);
    }
    let lightskin = object.object("extras")?.and_then(|extras| extras.object("lightskin").transpose()).transpose()?;
    lightskin.and_then(|own| own.object(key).transpose()).transpose()
}

/// The image of a texture. WebP and KTX2 are preferred: the plain source is usually a lossier fallback for loaders that
/// cannot read them.
fn source_of(texture: &Object) -> Result<Option<usize>> {
    for name in ["EXT_texture_webp", "KHR_texture_basisu"] {
        let source = texture.extension(name)?.map(|extension| extension.index("source")).transpose()?.flatten();
        if source.is_some() {
            return Ok(source);
        }
    }
    texture.index("source")
}

fn sampler(object: &Object) -> Result<Sampler> {
    let wrap = |key: &str| match object.whole(key)? {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33648) => Ok(Wrap::Mirror),
        Some(33071) => Ok(Wrap::Clamp),
        Some(code) => Err(object.error(format!("has the unknown {key} {code}: export the file again"))),
    };
    let nearest = match object.whole("magFilter")? {
        None | Some(9729) => false,
        Some(9728) => true,
        Some(code) => return Err(object.error(format!("has the unknown magFilter {code}: export the file again"))),
    };
    Ok(Sampler { wrap_u: wrap("wrapS")?, wrap_v: wrap("wrapT")?, nearest })
}

/// Location of an image's bytes: in memory, or the URI of a file.
struct Source<'a> {
    name: String,
    bytes: std::result::Result<&'a [u8], &'a str>,
}

/// Finds an image in a buffer view or under a URI.
fn source<'a>(document: &'a Document, index: usize, accessors: &Accessors<'a>) -> Result<Source<'a>> {
    let object = document.item("images", index, &document.object())?;
    let uri = object.text("uri")?;
    let name = object.name(|| match uri {
        Some(uri) if !uri.starts_with("data:") => printable(uri),
        _ => format!("image {index}"),
    });
    let bytes = match (uri, object.index("bufferView")?) {
        (Some(uri), _) => Err(uri),
        (None, Some(view)) => Ok(accessors.view(view, &object)?.0),
        (None, None) => return Err(object.error("has neither uri nor bufferView: export the file again")),
    };
    Ok(Source { name, bytes })
}

impl Source<'_> {
    /// Opens the image and reads its header.
    fn header(&self, folder: &Path) -> std::result::Result<Encoded<'_>, String> {
        let mut contents: Box<dyn files::Contents> = match self.bytes {
            Ok(bytes) => Box::new(Cursor::new(bytes)),
            Err(uri) => files::reader(folder, uri)?,
        };
        // The format is detected by content: mimeType and extension are often wrong.
        let start = contents.fill_buf().map_err(|error| printable(&error.to_string()))?;
        let encoded = if start.starts_with(ktx2::MAGIC) {
            decode::ktx2(contents)
        } else {
            let known = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP];
            let format = image::guess_format(start).ok().filter(|format| known.contains(format));
            decode::header(contents, format.ok_or("it is neither PNG, JPEG, WebP nor KTX2")?)
        };
        let encoded = encoded.map_err(|reason| not_decoded(&reason))?;
        let [width, height] = encoded.size;
        if width > MAX_SIDE || height > MAX_SIDE {
            return Err(format!("it has {width} x {height} texels, at most {MAX_SIDE} x {MAX_SIDE} are possible"));
        }
        Ok(encoded)
    }

    fn decode(&self, folder: &Path) -> std::result::Result<Image, String> {
        let rgba = self.header(folder)?.decode().map_err(|reason| not_decoded(&reason))?.into_rgba8();
        Ok(Image { name: self.name.clone(), width: rgba.width(), height: rgba.height(), rgba: rgba.into_raw() })
    }
}

fn not_decoded(reason: &str) -> String {
    format!("it does not decode ({})", printable(reason))
}

/// Decodes all images, as many at the same time as the memory limit allows. Each result is the image, or the reason why
/// it does not decode.
fn decode_all(
    sources: &[Source],
    folder: &Path,
) -> std::result::Result<Vec<std::result::Result<Image, String>>, String> {
    // For each image, bytes of the result and bytes during decoding.
    let needs: Vec<[u64; 2]> = sources
        .par_iter()
        .map(|source| source.header(folder).map_or([0, 0], |encoded| [4 * encoded.texels, encoded.working]))
        .collect();
    let kept: u64 = needs.iter().map(|need| need[0]).sum();
    let largest = needs.iter().map(|need| need[1]).max().unwrap_or(0);
    decode::within(kept.saturating_add(largest))?;
    let mut images = Vec::new();
    while images.len() < sources.len() {
        let rest = images.len()..sources.len();
        let mut room = decode::max_memory() - kept;
        let fits = |index: &usize| {
            let left = room.checked_sub(needs[*index][1]);
            room = left.unwrap_or(0);
            left.is_some()
        };
        let now: Vec<usize> = rest.take_while(fits).collect();
        images.par_extend(now.par_iter().map(|&index| sources[index].decode(folder)));
    }
    Ok(images)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;
    use std::f64::consts::TAU;

    /// Compares with the matrices in the extension's README.
    #[test]
    fn texture_transform_is_that_of_the_extension() {
        let quarter = texture_transform([0.25, 0.5], TAU / 4.0, [2.0, 3.0]);
        let uv = quarter.transform_point2(Vec2::new(0.1, 0.2));
        assert!((uv - Vec2::new(0.25 + 0.6, 0.5 - 0.2)).length() < 1e-6, "{uv}");
    }
}

//! glTF materials in our terms. Base-colour and emissive textures are reduced to their mean colour.

use std::path::Path;

use glam::Vec3;
use gltf::Document;
use gltf::image::{Data, Format};
use gltf::material::AlphaMode;
use gltf::texture::Texture;

use super::Material;
use super::assemble::Assembler;
use super::gltf_geometry::{Buffers, is_readable};

/// Where the document's materials went.
pub(super) struct Materials {
    /// Index in the scene of each material of the document.
    numbers: Vec<u32>,
    /// Index in the scene of the material of surfaces without one, once there is one.
    default: Option<u32>,
}

impl Materials {
    /// The scene's index of a primitive's material. Surfaces without one become light grey: the format's
    /// own default is a white metal, which nobody who forgot a material had in mind.
    pub(super) fn of(&mut self, material: &gltf::Material, assembler: &mut Assembler) -> u32 {
        match material.index().and_then(|index| self.numbers.get(index).copied()) {
            Some(number) => number,
            None => *self.default.get_or_insert_with(|| assembler.material(Material::default())),
        }
    }
}

/// Reads all materials of a document.
pub(super) fn read(
    document: &Document,
    base: Option<&Path>,
    buffers: &Buffers,
    assembler: &mut Assembler,
) -> Materials {
    let mut ignored = 0;
    let mut averaged = 0;
    let mut numbers = Vec::new();
    for material in document.materials() {
        let mut mean = |texture: Texture| match mean_color(&texture, base, buffers) {
            Some(color) => {
                averaged += 1;
                color
            }
            None => {
                ignored += 1;
                Vec3::ONE
            }
        };
        let pbr = material.pbr_metallic_roughness();
        let [red, green, blue, alpha] = pbr.base_color_factor();
        let color_mean = pbr.base_color_texture().map_or(Vec3::ONE, |info| mean(info.texture()));
        let emission_mean = material.emissive_texture().map_or(Vec3::ONE, |info| mean(info.texture()));
        let emission =
            Vec3::from_array(material.emissive_factor()) * material.emissive_strength().unwrap_or(1.0);
        ignored +=
            usize::from(pbr.metallic_roughness_texture().is_some() || material.normal_texture().is_some());
        let transmission =
            material.transmission().map_or(0.0, |transmission| transmission.transmission_factor());
        // Alpha blending lets light straight through: transmission without refraction.
        let see_through = if material.alpha_mode() == AlphaMode::Blend { 1.0 - alpha } else { 0.0 };
        let straight = see_through > transmission || is_thin(&material);
        numbers.push(assembler.material(Material {
            base_color: Vec3::new(red, green, blue) * color_mean,
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            transmission: transmission.max(see_through),
            ior: if straight { 1.0 } else { material.ior().unwrap_or(1.5) },
            emission: emission * emission_mean,
        }));
    }
    if averaged > 0 {
        assembler.note(format!("Replaced {averaged} textures by their mean colour."));
    }
    if ignored > 0 {
        assembler.note(format!("Ignored textures of {ignored} materials; their factors are used."));
    }
    Materials { numbers, default: None }
}

/// Whether the material's extras name a kind of surface that is glass without thickness: a pane modelled by
/// one sheet, which must not bend light.
fn is_thin(material: &gltf::Material) -> bool {
    let Some(raw) = material.extras() else {
        return false;
    };
    let parsed: Option<serde_json::Value> = serde_json::from_str(raw.get()).ok();
    parsed.is_some_and(|extras| extras.get("source").and_then(|kind| kind.as_str()) == Some("thindielectric"))
}

/// Mean linear colour of a texture, or nothing when its image cannot be read.
fn mean_color(texture: &Texture, base: Option<&Path>, buffers: &Buffers) -> Option<Vec3> {
    let source = texture.source().source();
    if let gltf::image::Source::View { view, .. } = &source {
        let end = view.offset().checked_add(view.length())?;
        if end > buffers.get(view.buffer().index())?.0.len() {
            return None;
        }
    }
    if let gltf::image::Source::Uri { uri, .. } = &source
        && !is_readable(uri)
    {
        return None;
    }
    let image = Data::from_source(source, base, buffers).ok()?;
    // Grey images stand for all three colours.
    let (channels, is_grey) = match image.format {
        Format::R8 => (1, true),
        Format::R8G8 => (2, true),
        Format::R8G8B8 => (3, false),
        Format::R8G8B8A8 => (4, false),
        _ => return None,
    };
    // Each of the 256 values is decoded once; sums stay exact in double precision.
    let linear: Vec<f64> = (0..256).map(|value| srgb_to_linear(f64::from(value) / 255.0)).collect();
    let mut sum = [0.0; 3];
    let mut count = 0.0;
    for pixel in image.pixels.chunks_exact(channels) {
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum += linear[pixel[if is_grey { 0 } else { channel }] as usize];
        }
        count += 1.0;
    }
    (count > 0.0).then(|| Vec3::from_array(sum.map(|sum| (sum / count) as f32)))
}

/// The inverse of the sRGB transfer function (IEC 61966-2-1).
fn srgb_to_linear(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

//! glTF materials in our terms, with their textures.
//!
//! All textures of a material are looked up at one set of texture coordinates, moved by one transform: those
//! of its base colour, or of the first texture it has. Textures that ask for others get a note.

use std::path::Path;

use glam::{Mat2, Vec2, Vec3};
use gltf::texture::{Texture, WrappingMode};
use gltf::{Document, material::AlphaMode};

use super::texture::{Encoding, Wrap};
use super::{Material, Volume, assemble::Assembler, images, limits::IMAGE_BYTES_MAX};

/// Alpha from which on a surface is solid where the file says it blends, though its texture only cuts out.
const CUT_OUT: f32 = 0.5;

/// Where the document's materials went.
pub(super) struct Materials {
    /// Index in the scene of each material of the document, and where its textures are looked up.
    numbers: Vec<(u32, Coordinates)>,
    /// Index in the scene of the material of surfaces without one, once there is one.
    default: Option<u32>,
}

/// Which texture coordinates of a mesh a material takes, and what becomes of them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Coordinates {
    /// Number of the set; nothing for a material without textures.
    pub(super) set: Option<u32>,
    transform: Option<(Mat2, Vec2)>,
}

impl Coordinates {
    /// A pair of a mesh's coordinates where the textures are looked up.
    pub(super) fn moved(&self, at: [f32; 2]) -> Vec2 {
        let at = Vec2::from_array(at);
        self.transform.map_or(at, |(matrix, offset)| matrix * at + offset)
    }
}

impl Materials {
    /// The index of a primitive's material; light grey for none, not the format's white metal.
    pub(super) fn of(&mut self, material: &gltf::Material, assembler: &mut Assembler) -> u32 {
        match material.index().and_then(|index| self.numbers.get(index)) {
            Some((number, _)) => *number,
            None => *self.default.get_or_insert_with(|| assembler.material(Material::default())),
        }
    }

    pub(super) fn coordinates(&self, material: &gltf::Material) -> Coordinates {
        let known = material.index().and_then(|index| self.numbers.get(index));
        known.map_or(Coordinates::default(), |(_, coordinates)| *coordinates)
    }
}

pub(super) fn read(
    document: &Document,
    base: Option<&Path>,
    buffers: &[gltf::buffer::Data],
    assembler: &mut Assembler,
) -> Materials {
    let mut reader = Reader { base, buffers, assembler, elsewhere: 0 };
    let numbers = document.materials().map(|material| reader.material(&material)).collect();
    let elsewhere = "Left out {} textures that take other coordinates than the first of their material.";
    reader.assembler.note_count(reader.elsewhere, elsewhere);
    Materials { numbers, default: None }
}

struct Reader<'a> {
    base: Option<&'a Path>,
    buffers: &'a [gltf::buffer::Data],
    assembler: &'a mut Assembler,
    /// Textures left out for their coordinates.
    elsewhere: usize,
}

impl Reader<'_> {
    fn material(&mut self, material: &gltf::Material) -> (u32, Coordinates) {
        let pbr = material.pbr_metallic_roughness();
        let transmission = material.transmission();
        let infos = [
            pbr.base_color_texture(),
            pbr.metallic_roughness_texture(),
            material.emissive_texture(),
            transmission.as_ref().and_then(|transmission| transmission.transmission_texture()),
        ];
        let places: [Option<Coordinates>; 4] =
            [0, 1, 2, 3].map(|index| infos[index].as_ref().map(coordinates_of));
        let normal = material.normal_texture();
        // The crate does not give the transform of a normal map, which nearly always is that of the others.
        let normal_set = normal.as_ref().map(|normal| normal.tex_coord());
        let place = places.iter().flatten().next().copied();
        let place = place.or(normal_set.map(|set| Coordinates { set: Some(set), transform: None }));
        let [base, rough, glow, through] = [0, 1, 2, 3].map(|index| {
            let info = infos[index].as_ref()?;
            self.texture(info.texture(), place == places[index], ENCODINGS[index])
        });
        let normal = normal.and_then(|normal| {
            let fits = place.is_some_and(|place| place.set == normal_set);
            Some((self.texture(normal.texture(), fits, Encoding::Linear)?, normal.scale()))
        });
        let [red, green, blue, alpha] = pbr.base_color_factor();
        let mut described = Material {
            base_color: Vec3::new(red, green, blue),
            metallic: pbr.metallic_factor(),
            roughness: pbr.roughness_factor(),
            transmission: transmission.map_or(0.0, |transmission| transmission.transmission_factor()),
            ior: material.ior().unwrap_or(1.5),
            emission: Vec3::from_array(material.emissive_factor())
                * material.emissive_strength().unwrap_or(1.0),
            base_color_texture: base,
            metallic_roughness_texture: rough,
            normal_texture: normal.map(|(texture, _)| texture),
            normal_scale: normal.map_or(1.0, |(_, scale)| scale),
            emission_texture: glow,
            transmission_texture: through,
            ..Material::default()
        };
        self.alpha(material, alpha, &mut described);
        // A transmitting surface without a volume is infinitely thin (KHR_materials_transmission).
        let volume = material.volume().filter(|volume| volume.thickness_factor() > 0.0);
        described.volume = volume.map(|volume| {
            Volume::new(Vec3::from_array(volume.attenuation_color()), volume.attenuation_distance())
        });
        if is_thin(material) {
            described.ior = 1.0;
        }
        (self.assembler.material(described), place.unwrap_or_default())
    }

    fn alpha(&mut self, material: &gltf::Material, opacity: f32, described: &mut Material) {
        let texture = described.base_color_texture;
        let cutout = |cutoff: f32| if opacity > 0.0 { cutoff / opacity } else { f32::MAX };
        match material.alpha_mode() {
            AlphaMode::Opaque => {}
            AlphaMode::Mask => {
                described.cutoff = Some(cutout(material.alpha_cutoff().unwrap_or(CUT_OUT)));
            }
            AlphaMode::Blend if texture.is_some_and(|texture| self.assembler.cuts_out(texture)) => {
                described.cutoff = Some(cutout(CUT_OUT));
                let name = material.name().unwrap_or("without a name");
                self.assembler.note(format!(
                    "Material {name} blends by a texture that is nearly everywhere clear or solid: it is cut out instead."
                ));
            }
            // Alpha blending lets light straight through: transmission without refraction.
            AlphaMode::Blend => {
                described.blends = true;
                described.opacity = opacity;
                described.ior = 1.0;
                described.transmission = described.transmission.max(1.0 - opacity);
            }
        }
    }

    /// A texture's number in the scene; nothing, and a note, for one that cannot be read.
    fn texture(&mut self, texture: Texture, fits: bool, encoding: Encoding) -> Option<u32> {
        if !fits {
            self.elsewhere += 1;
            return None;
        }
        let sampler = texture.sampler();
        let wrap = [sampler.wrap_s(), sampler.wrap_t()].map(|mode| match mode {
            WrappingMode::ClampToEdge => Wrap::Clamp,
            WrappingMode::MirroredRepeat => Wrap::Mirror,
            WrappingMode::Repeat => Wrap::Repeat,
        });
        let image = texture.source();
        let (base, buffers) = (self.base, self.buffers);
        let name = image.name().map_or_else(|| format!("image {}", image.index()), str::to_owned);
        self.assembler.texture(&format!("image {}", image.index()), &name, encoding, wrap, || {
            match image.source() {
                gltf::image::Source::View { view, .. } => {
                    let data = buffers.get(view.buffer().index()).map_or(&[][..], |data| &data.0[..]);
                    let end = view.offset().checked_add(view.length());
                    let bytes = end.and_then(|end| data.get(view.offset()..end));
                    images::decode(bytes.ok_or("it reaches outside its buffer")?, Path::new(""))
                }
                gltf::image::Source::Uri { uri, .. } => {
                    let name = if uri.starts_with("data:") { "" } else { uri };
                    images::decode(&images::fetch(uri, base, IMAGE_BYTES_MAX)?, Path::new(name))
                }
            }
        })
    }
}

/// The encodings of base colour, roughness, emission and transmission.
const ENCODINGS: [Encoding; 4] = [Encoding::Srgb, Encoding::Linear, Encoding::Srgb, Encoding::Linear];

fn coordinates_of(info: &gltf::texture::Info) -> Coordinates {
    let Some(transform) = info.texture_transform() else {
        return Coordinates { set: Some(info.tex_coord()), transform: None };
    };
    let (scale, offset) = (Vec2::from_array(transform.scale()), Vec2::from_array(transform.offset()));
    // Scaled, then turned counter-clockwise in coordinates that run down, then moved.
    let (sin, cos) = transform.rotation().sin_cos();
    let matrix = Mat2::from_cols(Vec2::new(cos, -sin) * scale.x, Vec2::new(sin, cos) * scale.y);
    Coordinates {
        set: Some(transform.tex_coord().unwrap_or(info.tex_coord())),
        transform: Some((matrix, offset)),
    }
}

/// Whether the extras name glass without thickness: one sheet, which must not bend light.
fn is_thin(material: &gltf::Material) -> bool {
    let Some(raw) = material.extras() else { return false };
    let parsed: Option<serde_json::Value> = serde_json::from_str(raw.get()).ok();
    parsed.is_some_and(|extras| extras.get("source").and_then(|kind| kind.as_str()) == Some("thindielectric"))
}

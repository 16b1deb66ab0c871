//! The pictures that MTL materials name: base colour, alpha, emission, roughness, metal and normals.

use std::path::Path;

use glam::Vec3;

use super::images::{self, Pixels};
use super::mtl_text::{Described, map};
use super::texture::{Encoding, Wrap};
use super::{Material, assemble::Assembler};

/// Alpha from which a surface with an alpha map is solid.
const CUT_OUT: f32 = 0.5;

/// Makes one picture of up to two files.
type Make<'a> = dyn Fn([Option<&str>; 2]) -> Result<Pixels, String> + 'a;

pub(super) fn has_maps(material: &Described) -> bool {
    ["map_Kd", "map_d", "map_Ke", "map_Pr", "map_Pm", "norm"].iter().any(|key| material.get(key).is_some())
}

/// Reads the pictures of a material, which stand in `folder` or below.
pub(super) fn read(material: &Described, folder: &Path, assembler: &mut Assembler, described: &mut Material) {
    let named = |key: &str| material.get(key).and_then(map);
    let decoded = |name: &str| images::decode(&images::read_file(&folder.join(name))?, Path::new(name));
    let mut add = |maps: [Option<(String, bool)>; 2], encoding, make: &Make| {
        let names = [0, 1].map(|index| maps[index].as_ref().map(|(name, _)| name.as_str()));
        let first = maps.iter().flatten().next()?;
        let wrap = if first.1 { Wrap::Clamp } else { Wrap::Repeat };
        assembler.texture(&format!("{names:?}"), &first.0, encoding, [wrap; 2], || make(names))
    };
    let (colour, alpha) = (named("map_Kd"), named("map_d"));
    let has_alpha_map = alpha.is_some();
    described.base_color_texture = add([colour, alpha], Encoding::Srgb, &|[colour, alpha]| {
        with_alpha(colour.map(decoded).transpose()?, alpha.map(decoded).transpose()?)
    });
    described.metallic_roughness_texture =
        add([named("map_Pr"), named("map_Pm")], Encoding::Linear, &|[rough, metal]| {
            merged(rough.map(decoded).transpose()?, metal.map(decoded).transpose()?, |rough, metal| {
                [255, rough.map_or(255, |[value, ..]| value), metal.map_or(255, |[value, ..]| value), 255]
            })
        });
    if material.get("map_Pm").is_some() && material.get("Pm").is_none() {
        described.metallic = 1.0;
    }
    if material.get("map_Pr").is_some() && material.get("Pr").is_none() {
        described.roughness = 1.0;
    }
    let plain = |[name, _]: [Option<&str>; 2]| decoded(name.unwrap_or_default());
    described.emission_texture = add([named("map_Ke"), None], Encoding::Srgb, &plain);
    if described.emission_texture.is_some() && described.emission == Vec3::ZERO {
        described.emission = Vec3::ONE;
    }
    described.normal_texture = add([named("norm"), None], Encoding::Linear, &plain);
    let cuts_out = |texture| has_alpha_map || assembler.cuts_out(texture);
    if described.base_color_texture.is_some_and(cuts_out) {
        described.cutoff = Some(CUT_OUT);
    }
}

/// A picture of base colours with the alpha of another one: its alpha, else its brightness.
fn with_alpha(colour: Option<Pixels>, alpha: Option<Pixels>) -> Result<Pixels, String> {
    let has_own = alpha.as_ref().is_some_and(|alpha| alpha.pixels.iter().any(|pixel| pixel[3] < 255));
    merged(colour, alpha, |colour, alpha| {
        let [r, g, b, own] = colour.unwrap_or([255; 4]);
        [r, g, b, alpha.map_or(own, |[value, _, _, alpha]| if has_own { alpha } else { value })]
    })
}

/// Two pictures as one, as large as the first; of the other the nearest pixels are taken.
fn merged(
    first: Option<Pixels>,
    second: Option<Pixels>,
    merge: impl Fn(Option<[u8; 4]>, Option<[u8; 4]>) -> [u8; 4],
) -> Result<Pixels, String> {
    let size = first.as_ref().or(second.as_ref()).map(|pixels| (pixels.width, pixels.height));
    let (width, height) = size.ok_or("it names no picture")?;
    let of = |pixels: &Option<Pixels>, x: u32, y: u32| {
        pixels.as_ref().map(|from| {
            let scaled = |place: u32, edge: u32, of: u32| {
                (u64::from(place) * u64::from(of) / u64::from(edge)) as usize
            };
            from.pixels[scaled(y, height, from.height) * from.width as usize + scaled(x, width, from.width)]
        })
    };
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let pixels = places.map(|(x, y)| merge(of(&first, x, y), of(&second, x, y))).collect();
    Ok(Pixels { width, height, pixels })
}

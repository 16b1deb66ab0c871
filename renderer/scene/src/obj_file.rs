//! Reads Wavefront OBJ with its MTL material files.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use glam::Vec3;

use super::assemble::{Assembler, Lighting};
use super::mtl_text::{self, Described};
use super::obj_text::{self, Parsed};
use super::{Material, Scene, SceneError, Up, obj_maps, text};

pub(super) fn read(path: &Path, bytes: &[u8], up: Up) -> Result<Scene, SceneError> {
    let malformed = SceneError::malformed(path, "OBJ", "repair that line or export the scene again");
    let folder = path.parent().unwrap_or(Path::new("."));
    let text = text::decoded(bytes);
    let libraries = Libraries::read(&text, folder);
    // Of two materials of one name the later one is meant.
    let names = libraries.materials.iter().map(|material| material.name.as_str());
    let numbers: HashMap<&str, usize> = names.zip(0..).collect();
    let with_textures = libraries.materials.iter().any(obj_maps::has_maps);
    let parsed = obj_text::parse(&text, with_textures, &numbers).map_err(malformed)?;
    let mut assembler = Assembler::of_file(path, up);
    note_what_is_left_out(&parsed, &libraries, &mut assembler);
    if let Some(origin) = parsed.origin {
        assembler.moved_to(origin);
    }
    if parsed.groups.is_empty() {
        assembler.note("no faces");
    }
    let default = assembler.material(Material::default());
    let mut numbers = Vec::new();
    for material in &libraries.materials {
        let mut described = from_mtl(material);
        obj_maps::read(material, folder, &mut assembler, &mut described);
        numbers.push(assembler.material(described));
    }
    for group in parsed.groups {
        let material = group.material.map_or(default, |number| numbers[number]);
        assembler.mesh(group.name, material, &group.part)?;
    }
    assembler.finish(Lighting::Automatic, Vec::new())
}

#[derive(Default)]
struct Libraries {
    materials: Vec<Described>,
    /// Names of files that cannot be read.
    missing: Vec<String>,
    /// Numbers of ignored keywords in them.
    ignored: BTreeMap<String, usize>,
}

impl Libraries {
    fn read(text: &str, folder: &Path) -> Self {
        let mut libraries = Self::default();
        for name in mtl_text::libraries(text, folder) {
            match std::fs::read(folder.join(&name)) {
                Ok(bytes) => {
                    let materials = mtl_text::materials(&text::decoded(&bytes), &mut libraries.ignored);
                    libraries.materials.extend(materials);
                }
                Err(_) => libraries.missing.push(name),
            }
        }
        libraries
    }
}

/// One sentence for each kind of thing that is in the files and not in the scene.
fn note_what_is_left_out(parsed: &Parsed, libraries: &Libraries, assembler: &mut Assembler) {
    for name in &libraries.missing {
        assembler.note(format!("The material file {name} cannot be read; its surfaces are light grey."));
    }
    if let Some(name) = parsed.unknown.first().filter(|_| libraries.missing.is_empty()) {
        let count = parsed.unknown.len();
        assembler.note(format!("{count} materials, such as {name}, stand in no material file: light grey."));
    }
    if !libraries.ignored.is_empty() {
        let statements: Vec<String> =
            libraries.ignored.iter().map(|(keyword, count)| format!("{keyword} ({count})")).collect();
        assembler.note(format!("Ignored statements of material files: {}.", statements.join(", ")));
    }
    for (count, what) in [
        (parsed.ignored, "points, lines, curves and faces with fewer than three corners"),
        (parsed.astray, "numbers of texture coordinates or normals that the file does not have"),
        (parsed.coloured, "colours of vertices"),
    ] {
        assembler.note_count(count, &format!("Ignored {{}} {what}."));
    }
}

/// A material of ambient, diffuse and specular, and of its extension by `Pr` and `Pm`, in our terms.
fn from_mtl(material: &Described) -> Material {
    let number = |key: &str| material.number(key);
    let diffuse = material.colour("Kd").unwrap_or(Material::default().base_color);
    let specular = material.colour("Ks").unwrap_or(Vec3::ZERO);
    // A black diffuse and a bright specular colour is how the classic model says metal.
    let metal = diffuse.max_element() < 0.05 && specular.max_element() > 0.3;
    // The width of a Blinn highlight is that of a roughness of (2 / (n + 2))^(1/4) (Walter et al. 2007).
    let glossy = specular.max_element() > 0.02;
    let roughness = match number("Ns") {
        Some(exponent) if glossy => (2.0 / (exponent.max(0.0) + 2.0)).powf(0.25),
        _ => 1.0,
    };
    let dissolve = number("d").or_else(|| number("Tr").map(|transparency| 1.0 - transparency)).unwrap_or(1.0);
    // A dissolved material lets light through, like blending in glTF; it bends light only if it says so.
    let dissolved = dissolve < 1.0;
    let ior = if dissolved { 1.0 } else { 1.5 };
    Material {
        base_color: if metal { specular } else { diffuse },
        metallic: number("Pm").unwrap_or(if metal { 1.0 } else { 0.0 }),
        roughness: number("Pr").unwrap_or(roughness),
        transmission: 1.0 - dissolve,
        blends: dissolved,
        opacity: dissolve,
        ior: number("Ni").unwrap_or(ior),
        emission: material.colour("Ke").unwrap_or(Vec3::ZERO),
        ..Material::default()
    }
}

//! Reads Wavefront OBJ with its MTL material files.
//!
//! The text is looked over before it is parsed: faces are checked so that an error can name its line, and
//! what the parser would misread (lines and points, empty material names) is taken out.

use std::cell::RefCell;
use std::io::{BufReader, Cursor};
use std::path::Path;

use glam::{Vec2, Vec3};
use tobj::{LoadError, LoadOptions};

use super::assemble::{Assembler, Lighting};
use super::obj_maps;
use super::obj_text::{self, Checked};
use super::part::Part;
use super::{Material, Scene, SceneError};

/// Reads one file. See [`super::load`].
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Scene, SceneError> {
    let malformed = |cause: String| SceneError::Malformed {
        path: path.to_owned(),
        format: "OBJ",
        cause,
        remedy: "repair that line or export the scene again",
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    let text = String::from_utf8_lossy(bytes);
    let with_textures = obj_text::material_files(&text).any(|name| names_textures(folder, name));
    let Checked { text, ignored, faces } = obj_text::check(&text, with_textures).map_err(malformed)?;
    let mut assembler = Assembler::of_file(path);
    if ignored > 0 {
        assembler.note(format!(
            "Ignored {ignored} points, lines, curves and faces with fewer than three corners."
        ));
    }
    if faces == 0 {
        assembler.note("no faces");
        return assembler.finish(Lighting::Automatic, Vec::new());
    }
    let missing = RefCell::new(Vec::new());
    let options =
        LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let loaded = tobj::load_obj_buf(&mut BufReader::new(Cursor::new(text.as_bytes())), &options, |name| {
        read_materials(folder, name).inspect_err(|_| missing.borrow_mut().push(name.display().to_string()))
    });
    let (models, materials) = loaded.map_err(|error| malformed(format!("{error}")))?;
    let materials = materials.unwrap_or_default();
    for name in missing.into_inner() {
        assembler.note(format!("The material file {name} cannot be read; its surfaces are light grey."));
    }
    let default = assembler.material(Material::default());
    let mut numbers = Vec::new();
    for material in &materials {
        let mut described = from_mtl(material);
        obj_maps::read(material, folder, &mut assembler, &mut described);
        numbers.push(assembler.material(described));
    }
    for model in &models {
        let mesh = &model.mesh;
        let part = Part {
            positions: triples(&mesh.positions),
            normals: if mesh.normals.len() == mesh.positions.len() {
                triples(&mesh.normals)
            } else {
                Vec::new()
            },
            // Pictures stand upside down.
            uvs: mesh.texcoords.as_chunks().0.iter().map(|[u, v]| Vec2::new(*u, 1.0 - v)).collect(),
            indices: mesh.indices.as_chunks().0.to_vec(),
        };
        let material = mesh.material_id.and_then(|number| numbers.get(number).copied()).unwrap_or(default);
        assembler.mesh(model.name.clone(), material, &part)?;
    }
    assembler.finish(Lighting::Automatic, Vec::new())
}

fn triples(numbers: &[f32]) -> Vec<Vec3> {
    numbers.as_chunks().0.iter().map(|triple| Vec3::from_array(*triple)).collect()
}

/// Whether a material file that stands beside the OBJ names any picture.
fn names_textures(folder: &Path, name: &str) -> bool {
    let materials = read_materials(folder, Path::new(name));
    materials.is_ok_and(|(materials, _)| materials.iter().any(obj_maps::has_maps))
}

/// Reads a material file that stands beside the OBJ.
fn read_materials(folder: &Path, name: &Path) -> tobj::MTLLoadResult {
    let bytes = std::fs::read(folder.join(name)).map_err(|_| LoadError::OpenFileFailed)?;
    let text = obj_text::repair_materials(&String::from_utf8_lossy(&bytes));
    tobj::load_mtl_buf(&mut BufReader::new(Cursor::new(text.as_bytes())))
}

/// A material of the classic ambient-diffuse-specular model, and of its common extension by `Pr` (roughness)
/// and `Pm` (metallic), in our terms.
fn from_mtl(material: &tobj::Material) -> Material {
    let number =
        |key: &str| material.unknown_param.get(key).and_then(|value| value.trim().parse::<f32>().ok());
    let diffuse = material.diffuse.map_or(Material::default().base_color, Vec3::from_array);
    let specular = material.specular.map_or(Vec3::ZERO, Vec3::from_array);
    // A black diffuse and a bright specular colour is how the classic model says metal.
    let metal = diffuse.max_element() < 0.05 && specular.max_element() > 0.3;
    // The width of a Blinn highlight of exponent n is that of a microfacet roughness of (2 / (n + 2))^(1/4)
    // (Walter et al. 2007, with roughness squared as the slope).
    let glossy = specular.max_element() > 0.02;
    let roughness = match material.shininess {
        Some(exponent) if glossy => (2.0 / (exponent.max(0.0) + 2.0)).powf(0.25),
        _ => 1.0,
    };
    let dissolve =
        material.dissolve.or_else(|| number("Tr").map(|transparency| 1.0 - transparency)).unwrap_or(1.0);
    Material {
        base_color: if metal { specular } else { diffuse },
        metallic: number("Pm").unwrap_or(if metal { 1.0 } else { 0.0 }),
        roughness: number("Pr").unwrap_or(roughness),
        transmission: 1.0 - dissolve,
        ior: material.optical_density.unwrap_or(1.5),
        emission: material.emissive.map_or(Vec3::ZERO, Vec3::from_array),
        ..Material::default()
    }
}

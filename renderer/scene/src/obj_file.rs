//! Reads Wavefront OBJ with its MTL material files.
//!
//! The text is checked before it is parsed, so that an error can name its line. Statements that the parser
//! would misread (lines and points, empty material names) are taken out.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;

use glam::{Vec2, Vec3};
use tobj::{LoadError, LoadOptions};

use super::assemble::{Assembler, Lighting};
use super::obj_text::{self, Checked};
use super::part::Part;
use super::{Material, Scene, SceneError, Up, mtl_text, obj_maps, text};

/// Reads one file. See [`super::load`].
pub(super) fn read(path: &Path, bytes: &[u8], up: Up) -> Result<Scene, SceneError> {
    let malformed = |cause: String| SceneError::Malformed {
        path: path.to_owned(),
        format: "OBJ",
        cause,
        remedy: "repair that line or export the scene again",
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    let text = text::decoded(bytes);
    let libraries = Libraries::read(&text, folder);
    let with_textures = libraries.all().any(obj_maps::has_maps);
    let checked = obj_text::check(&text, with_textures, libraries.loaded.len()).map_err(malformed)?;
    let mut assembler = Assembler::of_file(path, up);
    note_what_is_left_out(&checked, &libraries, &mut assembler);
    if let Some(origin) = checked.origin {
        assembler.moved_to(origin);
    }
    if checked.faces == 0 {
        assembler.note("no faces");
        return assembler.finish(Lighting::Automatic, Vec::new());
    }
    let loaded = RefCell::new(libraries.loaded);
    // Polygons are cut here: not all of them are convex.
    let options =
        LoadOptions { triangulate: false, single_index: true, ignore_points: true, ignore_lines: true };
    let parsed = tobj::load_obj_buf(&mut BufReader::new(checked.text.as_bytes()), &options, |number| {
        let number = number.to_str().and_then(|number| number.parse::<usize>().ok());
        let library = number.and_then(|number| loaded.borrow_mut().get_mut(number).map(std::mem::take));
        library.ok_or(LoadError::OpenFileFailed)
    });
    let (models, materials) = parsed.map_err(|error| malformed(format!("{error}")))?;
    let default = assembler.material(Material::default());
    let mut numbers = Vec::new();
    for material in &materials.unwrap_or_default() {
        let mut described = from_mtl(material);
        obj_maps::read(material, folder, &mut assembler, &mut described);
        numbers.push(assembler.material(described));
    }
    for model in &models {
        let number = model.mesh.material_id.and_then(|number| numbers.get(number).copied());
        assembler.mesh(model.name.clone(), number.unwrap_or(default), &part_of(&model.mesh))?;
    }
    assembler.finish(Lighting::Automatic, Vec::new())
}

/// The material files of an OBJ.
struct Libraries {
    loaded: Vec<Library>,
    /// Names of files that cannot be read.
    missing: Vec<String>,
    /// Numbers of ignored keywords in them.
    ignored: BTreeMap<String, usize>,
}

/// Materials and their numbers by name, as the parser has them.
type Library = <tobj::MTLLoadResult as IntoIterator>::Item;

impl Libraries {
    fn read(text: &str, folder: &Path) -> Self {
        let mut libraries = Self { loaded: Vec::new(), missing: Vec::new(), ignored: BTreeMap::new() };
        for name in mtl_text::libraries(text, folder) {
            let Ok(bytes) = std::fs::read(folder.join(&name)) else {
                libraries.missing.push(name);
                continue;
            };
            let repaired = mtl_text::repaired(&text::decoded(&bytes));
            match tobj::load_mtl_buf(&mut BufReader::new(repaired.text.as_bytes())) {
                Ok(library) => libraries.loaded.push(library),
                Err(_) => libraries.missing.push(name),
            }
            for (keyword, count) in repaired.ignored {
                *libraries.ignored.entry(keyword).or_default() += count;
            }
        }
        libraries
    }

    fn all(&self) -> impl Iterator<Item = &tobj::Material> {
        self.loaded.iter().flat_map(|(materials, _)| materials)
    }
}

/// One sentence for each kind of thing that is in the files and not in the scene.
fn note_what_is_left_out(checked: &Checked, libraries: &Libraries, assembler: &mut Assembler) {
    for name in &libraries.missing {
        assembler.note(format!("The material file {name} cannot be read; its surfaces are light grey."));
    }
    let unknown = |name: &&String| libraries.all().all(|material| material.name != **name);
    let unknown: Vec<&String> = checked.materials.iter().filter(unknown).collect();
    if let Some(name) = unknown.first().filter(|_| libraries.missing.is_empty()) {
        let count = unknown.len();
        assembler.note(format!("{count} materials, such as {name}, stand in no material file: light grey."));
    }
    if !libraries.ignored.is_empty() {
        let statements: Vec<String> =
            libraries.ignored.iter().map(|(keyword, count)| format!("{keyword} ({count})")).collect();
        assembler.note(format!("Ignored statements of material files: {}.", statements.join(", ")));
    }
    for (count, what) in [
        (checked.ignored, "points, lines, curves and faces with fewer than three corners"),
        (checked.astray, "numbers of texture coordinates or normals that the file does not have"),
        (checked.coloured, "colours of vertices"),
    ] {
        if count > 0 {
            assembler.note(format!("Ignored {count} {what}."));
        }
    }
}

/// A mesh with its polygons cut.
fn part_of(mesh: &tobj::Mesh) -> Part {
    let mut normals = triples(&mesh.normals);
    if normals.iter().all(|normal| *normal == Vec3::ZERO) {
        normals.clear();
    }
    let mut part = Part {
        positions: triples(&mesh.positions),
        normals,
        // Pictures stand upside down.
        uvs: mesh.texcoords.as_chunks().0.iter().map(|[u, v]| Vec2::new(*u, 1.0 - v)).collect(),
        indices: Vec::new(),
    };
    let mut rest = &mesh.indices[..];
    if mesh.face_arities.is_empty() {
        part.indices = rest.as_chunks().0.to_vec();
    }
    for corners in &mesh.face_arities {
        let (face, following) = rest.split_at((*corners as usize).min(rest.len()));
        part.push_polygon(face);
        rest = following;
    }
    part
}

fn triples(numbers: &[f32]) -> Vec<Vec3> {
    numbers.as_chunks().0.iter().map(|triple| Vec3::from_array(*triple)).collect()
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
    // A dissolved material lets light through as it is, like blending in glTF; it bends and reflects light if
    // it says so.
    let dissolved = dissolve < 1.0;
    let ior = if dissolved { 1.0 } else { 1.5 };
    Material {
        base_color: if metal { specular } else { diffuse },
        metallic: number("Pm").unwrap_or(if metal { 1.0 } else { 0.0 }),
        roughness: number("Pr").unwrap_or(roughness),
        transmission: 1.0 - dissolve,
        blends: dissolved,
        opacity: dissolve,
        ior: material.optical_density.unwrap_or(ior),
        emission: material.emissive.map_or(Vec3::ZERO, Vec3::from_array),
        ..Material::default()
    }
}

//! Reads PLY, the Stanford polygon format: ASCII and binary of both byte orders. Colours and elements
//! besides vertices and faces are ignored.

use std::io::Cursor;
use std::path::Path;

use glam::Vec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Header, Property, PropertyAccess, PropertyAccessResult};

use super::assemble::{Assembler, Lighting};
use super::error::one_line;
use super::part::Part;
use super::{Material, Scene, SceneError};

/// Reads one file. See [`super::load`].
pub(super) fn read(path: &Path, bytes: &[u8]) -> Result<Scene, SceneError> {
    let malformed = |cause: String| SceneError::Malformed {
        path: path.to_owned(),
        format: "PLY",
        cause,
        remedy: "export it again, complete and in PLY 1.0",
    };
    let told = |error: ParseError| malformed(one_line(&error.to_string()));
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Vertex>::new().read_header(&mut reader).map_err(told)?;
    let mut part = Part::default();
    let mut with_normals = false;
    let mut assembler = Assembler::of_file(path);
    let mut faces = 0;
    for element in header.elements.values() {
        // Every element takes at least a byte, whether a digit or an empty list's length.
        if element.count > bytes.len() {
            return Err(malformed(format!(
                "its header promises {} elements \"{}\", more than the file has bytes",
                element.count, element.name
            )));
        }
        match element.name.as_str() {
            "vertex" => {
                let vertices = payload::<Vertex>(&mut reader, element, &header).map_err(told)?;
                with_normals = ["nx", "ny", "nz"].iter().all(|name| element.properties.contains_key(*name));
                part.positions = vertices.iter().map(|vertex| vertex.position).collect();
                part.normals = vertices.iter().map(|vertex| vertex.normal).collect();
            }
            "face" => {
                faces = element.count;
                for (number, face) in
                    payload::<Face>(&mut reader, element, &header).map_err(told)?.into_iter().enumerate()
                {
                    let corners: Option<Vec<u32>> =
                        face.corners.iter().map(|corner| u32::try_from(*corner).ok()).collect();
                    let corners = corners
                        .ok_or_else(|| malformed(format!("face {number} has a negative vertex number")))?;
                    part.push_polygon(&corners);
                }
            }
            other => {
                payload::<DefaultElement>(&mut reader, element, &header).map_err(told)?;
                if other == "tristrips" {
                    assembler.note("Ignored triangle strips; only faces are read.");
                }
            }
        }
    }
    let vertices = part.positions.len();
    let out_of_range = |corners: &&[u32; 3]| corners.iter().any(|corner| *corner as usize >= vertices);
    if let Some(corners) = part.indices.iter().find(out_of_range) {
        return Err(malformed(format!(
            "a face names vertices {corners:?}, but there are only {vertices} vertices"
        )));
    }
    if !with_normals {
        part.normals.clear();
    }
    if part.indices.is_empty() {
        assembler.note(format!("{vertices} vertices and {faces} faces"));
    }
    let material = assembler.material(Material::default());
    let name = assembler.name().to_owned();
    assembler.mesh(name, material, &part)?;
    assembler.finish(Lighting::Automatic, Vec::new())
}

fn payload<E: PropertyAccess>(
    reader: &mut Reader<Cursor<&[u8]>>,
    element: &ElementDef,
    header: &Header,
) -> Result<Vec<E>, ParseError> {
    Parser::<E>::new().read_payload_for_element(reader, element, header)
}

#[derive(Clone, Copy)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: Vec3::NAN, normal: Vec3::ZERO }
    }

    fn set_property(&mut self, key: &str, property: Property) -> PropertyAccessResult {
        let field = match key {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            _ => return PropertyAccessResult::Ignored,
        };
        match property.to_f32_lossy() {
            Some(value) => {
                *field = value;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

struct Face {
    corners: Vec<i64>,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: Vec::new() }
    }

    fn set_property(&mut self, key: &str, property: Property) -> PropertyAccessResult {
        if !matches!(key, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

//! Reads PLY in text and both byte orders: positions and faces, without colours and texture coordinates.

use std::{borrow::Cow, io::Cursor, path::Path};

use glam::{DVec3, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    DefaultElement, ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult,
};

use super::assemble::{Assembler, Lighting};
use super::{
    Material, Scene, SceneError, Up, error::one_line, part::Part, place::far_middle, ply_text, text,
};

pub(super) fn read(path: &Path, bytes: &[u8], up: Up) -> Result<Scene, SceneError> {
    let malformed = SceneError::malformed(path, "PLY", "export it again, complete and in PLY 1.0");
    let parse_error = |error: ParseError| malformed(one_line(&error.to_string()));
    let (bytes, body) = ply_text::with_plain_header(bytes);
    let header =
        Parser::<Vertex>::new().read_header(&mut Reader::new(Cursor::new(&bytes))).map_err(parse_error)?;
    // Every element takes at least a byte, whether a digit or an empty list's length.
    if let Some(element) = header.elements.values().find(|element| element.count > bytes.len()) {
        return Err(malformed(format!(
            "its header promises {} elements \"{}\", more than the file has bytes",
            element.count, element.name
        )));
    }
    let bytes = match header.encoding {
        Encoding::Ascii => {
            let body_text = text::decoded(&bytes[body..]);
            let body_text = ply_text::with_a_line_each(&body_text, &header);
            Cow::Owned([&bytes[..body], body_text.as_bytes()].concat())
        }
        _ => bytes,
    };
    let mut reader = Reader::new(Cursor::new(&bytes[..]));
    Parser::<Vertex>::new().read_header(&mut reader).map_err(parse_error)?;
    let mut assembler = Assembler::of_file(path, up);
    let content = Content::read(&mut reader, &header).map_err(parse_error)?;
    for note in &content.notes {
        assembler.note(note.clone());
    }
    let origin = far_middle(content.vertices.iter().map(|vertex| vertex.position));
    if let Some(origin) = origin {
        assembler.moved_to(origin);
    }
    let part = content.part(origin.unwrap_or(DVec3::ZERO)).map_err(malformed)?;
    if part.indices.is_empty() {
        assembler.note(format!("{} vertices and {} faces", part.positions.len(), content.faces.len()));
    }
    let material = assembler.material(Material::default());
    let name = assembler.name().to_owned();
    assembler.mesh(name, material, &part)?;
    assembler.finish(Lighting::Automatic, Vec::new())
}

#[derive(Default)]
struct Content {
    vertices: Vec<Vertex>,
    with_normals: bool,
    faces: Vec<Face>,
    /// One sentence for each kind of thing that is left out.
    notes: Vec<String>,
}

impl Content {
    fn read(reader: &mut Reader<Cursor<&[u8]>>, header: &Header) -> Result<Self, ParseError> {
        let mut content = Self::default();
        for element in header.elements.values() {
            let has = |names: &[&str]| names.iter().all(|name| element.properties.contains_key(*name));
            let mut leave_out = |what: &str| {
                content.notes.extend(text::counted(element.count, &format!("Ignored {{}} {what}.")));
            };
            match element.name.as_str() {
                "vertex" => {
                    if has(&["red"]) || has(&["r"]) || has(&["diffuse_red"]) {
                        leave_out("colours of vertices");
                    }
                    if has(&["s"]) || has(&["u"]) || has(&["texture_u"]) {
                        leave_out("texture coordinates of vertices");
                    }
                    content.with_normals = has(&["nx", "ny", "nz"]);
                    content.vertices = payload::<Vertex>(reader, element, header)?;
                }
                "face" => {
                    if has(&["red"]) {
                        leave_out("colours of faces");
                    }
                    if has(&["texcoord"]) {
                        leave_out("texture coordinates of faces");
                    }
                    content.faces = payload::<Face>(reader, element, header)?;
                }
                other => {
                    leave_out(&format!("elements \"{other}\"; only vertices and faces are read"));
                    payload::<DefaultElement>(reader, element, header)?;
                }
            }
        }
        Ok(content)
    }

    /// Vertices, seen from `origin`, and cut polygons, or a sentence about a face.
    fn part(&self, origin: DVec3) -> Result<Part, String> {
        let positions = self.vertices.iter().map(|vertex| (vertex.position - origin).as_vec3());
        let mut part = Part { positions: positions.collect(), ..Part::default() };
        if self.with_normals {
            part.normals = self.vertices.iter().map(|vertex| vertex.normal).collect();
        }
        let vertices = part.positions.len();
        for (number, face) in self.faces.iter().enumerate() {
            let corners: Option<Vec<u32>> =
                face.corners.iter().map(|corner| u32::try_from(*corner).ok()).collect();
            let corners = corners.ok_or_else(|| format!("face {number} has a negative vertex number"))?;
            if corners.iter().any(|corner| *corner as usize >= vertices) {
                let first = &corners[..corners.len().min(8)];
                return Err(format!("face {number} names vertices {first:?}, but there are only {vertices}"));
            }
            part.push_polygon(&corners);
        }
        Ok(part)
    }
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
    position: DVec3,
    normal: Vec3,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: DVec3::NAN, normal: Vec3::ZERO }
    }

    fn set_property(&mut self, key: &str, property: Property) -> PropertyAccessResult {
        if !["x", "y", "z", "nx", "ny", "nz"].contains(&key) {
            return PropertyAccessResult::Ignored;
        }
        let value = match property {
            Property::Double(value) => Some(value),
            Property::Int(value) => Some(f64::from(value)),
            Property::UInt(value) => Some(f64::from(value)),
            _ => property.to_f32_lossy().map(f64::from),
        };
        let Some(value) = value else { return PropertyAccessResult::UnsupportedType };
        match key {
            "x" => self.position.x = value,
            "y" => self.position.y = value,
            "z" => self.position.z = value,
            "nx" => self.normal.x = value as f32,
            "ny" => self.normal.y = value as f32,
            _ => self.normal.z = value as f32,
        }
        PropertyAccessResult::Set
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

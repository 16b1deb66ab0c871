//! Copies of a mesh below one node (the extension EXT_mesh_gpu_instancing).

use std::collections::HashMap;

use glam::{Mat4, Quat, Vec3};
use gltf::Document;
use gltf::accessor::{DataType, Dimensions};
use serde_json::Value;
use treewright_accel::limits::INSTANCES_MAX;

use super::gltf_geometry::{Buffers, items};
use super::{animation::turn, assemble::Assembler};

/// By the number of a node: where the copies of its mesh stand, in its own space.
pub(super) type Copies = HashMap<usize, Vec<Mat4>>;

/// Reads the copies of all nodes. Unreadable ones get a note, and their mesh stands once.
pub(super) fn read(
    json: &Value,
    document: &Document,
    buffers: &Buffers,
    assembler: &mut Assembler,
) -> Copies {
    let mut copies = Copies::new();
    let mut unread = 0;
    let nodes = json.get("nodes").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    for (number, node) in nodes.iter().enumerate() {
        if let Some(attributes) = node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes") {
            match of_node(attributes, document, buffers) {
                Some(places) => drop(copies.insert(number, places)),
                None => unread += 1,
            }
        }
    }
    assembler.note_count(
        unread,
        "{} nodes have copies of their mesh (EXT_mesh_gpu_instancing) that cannot be read: one is shown.",
    );
    copies
}

fn of_node(attributes: &Value, document: &Document, buffers: &Buffers) -> Option<Vec<Mat4>> {
    let mut count = None;
    let mut vectors = |name: &str, default: Vec3| {
        let Some(found) = attributes.get(name) else { return Some(Err(default)) };
        let kind = (Dimensions::Vec3, DataType::F32);
        let found: Vec<[f32; 3]> = values(&accessor(found, document)?, kind, buffers)?;
        (*count.get_or_insert(found.len()) == found.len()).then_some(Ok(found))
    };
    let translations = vectors("TRANSLATION", Vec3::ZERO)?;
    let scales = vectors("SCALE", Vec3::ONE)?;
    let rotations: Option<Vec<[f32; 4]>> = match attributes.get("ROTATION") {
        Some(found) => Some(quaternions(found, document, buffers)?),
        None => None,
    };
    let count = count.or(rotations.as_ref().map(Vec::len))?;
    if rotations.as_ref().is_some_and(|all| all.len() != count) {
        return None;
    }
    let of = |all: &Result<Vec<[f32; 3]>, Vec3>, place: usize| match all {
        Ok(all) => Vec3::from_array(all[place]),
        Err(default) => *default,
    };
    let place = |place: usize| {
        let turn = rotations.as_ref().map_or(Quat::IDENTITY, |all| turn(&all[place]));
        Mat4::from_scale_rotation_translation(of(&scales, place), turn, of(&translations, place))
    };
    Some((0..count).map(place).collect())
}

/// Rotations of copies: in single precision, or in signed integers that stand for -1 to 1.
fn quaternions(number: &Value, document: &Document, buffers: &Buffers) -> Option<Vec<[f32; 4]>> {
    let accessor = accessor(number, document)?;
    let of = |kind| (Dimensions::Vec4, kind);
    match accessor.data_type() {
        DataType::I8 if accessor.normalized() => {
            let all: Vec<[i8; 4]> = values(&accessor, of(DataType::I8), buffers)?;
            let part = |part: i8| (f32::from(part) / f32::from(i8::MAX)).max(-1.0);
            Some(all.into_iter().map(|one| one.map(part)).collect())
        }
        DataType::I16 if accessor.normalized() => {
            let all: Vec<[i16; 4]> = values(&accessor, of(DataType::I16), buffers)?;
            let part = |part: i16| (f32::from(part) / f32::from(i16::MAX)).max(-1.0);
            Some(all.into_iter().map(|one| one.map(part)).collect())
        }
        _ => values(&accessor, of(DataType::F32), buffers),
    }
}

fn accessor<'a>(number: &Value, document: &'a Document) -> Option<gltf::Accessor<'a>> {
    document.accessors().nth(usize::try_from(number.as_u64()?).ok()?)
}

/// The values of an accessor, within limits.
fn values<T: gltf::accessor::Item>(
    accessor: &gltf::Accessor<'_>,
    (dimensions, kind): (Dimensions, DataType),
    buffers: &Buffers,
) -> Option<Vec<T>> {
    if accessor.count() > INSTANCES_MAX {
        return None;
    }
    Some(items(accessor, (dimensions, &[kind]), buffers).ok()?.collect())
}

//! The triangles of one glTF primitive, from buffers.

use std::path::Path;

use glam::Vec3;
use gltf::accessor::{Accessor, DataType, Dimensions, Item, Iter};
use gltf::{Primitive, Semantic, buffer::Source, mesh::Mode};

use super::limits::{FILE_BYTES_MAX, VERTICES_MAX};
use super::{gltf_material::Coordinates, images::fetch, part::Part};

/// The buffers of a document, by index.
pub(super) type Buffers = [gltf::buffer::Data];

/// Reads the buffers of a document: its binary chunk, data in addresses, files in the folder `base`.
///
/// # Errors
/// One sentence that names the buffer and its file.
pub(super) fn buffers(
    document: &gltf::Document,
    base: Option<&Path>,
    mut blob: Option<Vec<u8>>,
) -> Result<Vec<gltf::buffer::Data>, String> {
    let read = |buffer: gltf::Buffer| {
        let number = buffer.index();
        let mut data = match buffer.source() {
            Source::Bin => {
                blob.take().ok_or(format!("buffer {number} has neither an address nor a binary chunk"))?
            }
            Source::Uri(address) => fetch(address, base, FILE_BYTES_MAX).map_err(|cause| {
                let name: String = address.chars().take(80).collect();
                format!("buffer {number}, {name}: {cause}")
            })?,
        };
        if data.len() < buffer.length() {
            let (expected, found) = (buffer.length(), data.len());
            return Err(format!("buffer {number} should have {expected} bytes, it has {found}"));
        }
        data.resize(data.len().next_multiple_of(4), 0);
        Ok(gltf::buffer::Data(data))
    };
    document.buffers().map(read).collect()
}

/// Reads a primitive in the mesh's own space, with the texture coordinates that its material takes; nothing
/// for points, lines and primitives without vertices.
///
/// # Errors
/// One sentence about an accessor that reaches outside its buffer.
pub(super) fn read(
    primitive: &Primitive,
    buffers: &Buffers,
    coordinates: &Coordinates,
) -> Result<Option<Part>, String> {
    if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
        return Ok(None);
    }
    let Some(positions) = primitive.get(&Semantic::Positions).filter(|positions| positions.count() > 0)
    else {
        return Ok(None);
    };
    check(&positions, VECTORS, buffers)?;
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
    let mut part = Part::default();
    let outside = || "its positions reach outside their buffer".to_owned();
    part.positions.extend(reader.read_positions().ok_or_else(outside)?.map(Vec3::from_array));
    if let Some(normals) =
        primitive.get(&Semantic::Normals).filter(|normals| normals.count() == positions.count())
    {
        check(&normals, VECTORS, buffers)?;
        let outside = || "its normals reach outside their buffer".to_owned();
        part.normals.extend(reader.read_normals().ok_or_else(outside)?.map(Vec3::from_array));
    }
    if let Some(set) = coordinates.set
        && let Some(uvs) = primitive.get(&Semantic::TexCoords(set))
        && uvs.count() == positions.count()
    {
        check(&uvs, PAIRS, buffers)?;
        let outside = || "its texture coordinates reach outside their buffer".to_owned();
        let uvs = reader.read_tex_coords(set).ok_or_else(outside)?.into_f32();
        part.uvs.extend(uvs.map(|at| coordinates.moved(at)));
    }
    let numbers: Vec<u32> = match primitive.indices() {
        Some(indices) if indices.count() == 0 => return Ok(None),
        Some(indices) => {
            check(&indices, INDICES, buffers)?;
            let outside = || "its indices reach outside their buffer".to_owned();
            reader.read_indices().ok_or_else(outside)?.into_u32().collect()
        }
        None => (0..part.positions.len() as u32).collect(),
    };
    match primitive.mode() {
        Mode::TriangleStrip => {
            part.indices.extend(numbers.windows(3).enumerate().map(|(index, window)| {
                // Every other triangle of a strip runs the other way round.
                if index % 2 == 0 {
                    [window[0], window[1], window[2]]
                } else {
                    [window[1], window[0], window[2]]
                }
            }))
        }
        Mode::TriangleFan => part.push_fan(&numbers),
        _ => part.indices.extend_from_slice(numbers.as_chunks().0),
    }
    Ok(Some(part))
}

/// The elements of an accessor, checked. An accessor without any is refused.
///
/// # Errors
/// One sentence about an accessor of another type, or one that reaches outside its buffer.
pub(super) fn items<'a, T: Item>(
    accessor: &Accessor,
    expected: (Dimensions, &[DataType]),
    buffers: &'a Buffers,
) -> Result<Iter<'a, T>, String> {
    check(accessor, expected, buffers)?;
    let fault = |what: &str| format!("accessor {} {what}", accessor.index());
    if accessor.count() == 0 {
        return Err(fault("has no elements"));
    }
    let data = move |buffer: gltf::Buffer<'_>| buffers.get(buffer.index()).map(|data| &data.0[..]);
    Iter::new(accessor.clone(), data).ok_or_else(|| fault("reaches outside its buffer"))
}

/// The number of vertices of a primitive as its accessor says it.
pub(super) fn vertex_count(primitive: &Primitive) -> u64 {
    primitive.get(&Semantic::Positions).map_or(0, |positions| positions.count() as u64)
}

/// The approximate number of triangles of a primitive, from its accessors alone.
pub(super) fn triangle_count(primitive: &Primitive) -> u64 {
    let corners = primitive.indices().map_or(vertex_count(primitive), |indices| indices.count() as u64);
    match primitive.mode() {
        Mode::Triangles => corners / 3,
        Mode::TriangleStrip | Mode::TriangleFan => corners.saturating_sub(2),
        _ => 0,
    }
}

/// The types of positions and normals.
pub(super) const VECTORS: (Dimensions, &[DataType]) = (Dimensions::Vec3, &[DataType::F32]);
/// The types of texture coordinates.
const PAIRS: (Dimensions, &[DataType]) = (Dimensions::Vec2, &[DataType::F32, DataType::U8, DataType::U16]);
const INDICES: (Dimensions, &[DataType]) =
    (Dimensions::Scalar, &[DataType::U8, DataType::U16, DataType::U32]);

/// Checks an accessor before it is read: the reader trusts types, counts, offsets and strides.
pub(super) fn check(
    accessor: &Accessor,
    expected: (Dimensions, &[DataType]),
    buffers: &Buffers,
) -> Result<(), String> {
    let fault = |what: String| Err(format!("accessor {} {what}", accessor.index()));
    if accessor.dimensions() != expected.0 || !expected.1.contains(&accessor.data_type()) {
        let held = format!("holds {:?} of {:?}", accessor.dimensions(), accessor.data_type());
        let is_quantised = accessor.dimensions() == expected.0 && accessor.data_type() != DataType::F32;
        return fault(match is_quantised && expected.1.contains(&DataType::F32) {
            true => format!("{held}; the extension KHR_mesh_quantization is not read"),
            false => held,
        });
    }
    if accessor.count() > VERTICES_MAX {
        return fault(format!("has {} elements, more than the limit of {VERTICES_MAX}", accessor.count()));
    }
    if let Some(sparse) = accessor.sparse()
        && (sparse.count() == 0 || sparse.count() > accessor.count())
    {
        return fault(format!("replaces {} of its {} elements", sparse.count(), accessor.count()));
    }
    let is_close =
        |view: &gltf::buffer::View<'_>| view.stride().is_some_and(|stride| stride < accessor.size());
    // Indices of sparse elements take four bytes at most, the least stride that there may be.
    if accessor.sparse().is_some_and(|sparse| is_close(&sparse.values().view())) {
        return fault("has sparse elements that lie closer together than they are long".to_owned());
    }
    if accessor.view().is_some_and(|view| is_close(&view)) {
        return fault("has elements that lie closer together than they are long".to_owned());
    }
    let is_inside = |view: gltf::buffer::View<'_>, offset: usize, size: usize, count: usize| {
        let stride = view.stride().unwrap_or(size);
        let end_in_view = stride
            .checked_mul(count.saturating_sub(1))
            .and_then(|bytes| bytes.checked_add(size))
            .and_then(|bytes| bytes.checked_add(offset));
        let end_of_view = view.offset().checked_add(view.length());
        let available = buffers.get(view.buffer().index()).map_or(0, |data| data.0.len());
        end_in_view.is_some_and(|end| end <= view.length()) && end_of_view.is_some_and(|end| end <= available)
    };
    let sparse_fits = accessor.sparse().is_none_or(|sparse| {
        let (indices, values) = (sparse.indices(), sparse.values());
        is_inside(indices.view(), indices.offset(), indices.index_type().size(), sparse.count())
            && is_inside(values.view(), values.offset(), accessor.size(), sparse.count())
    });
    let fits =
        |view: gltf::buffer::View<'_>| is_inside(view, accessor.offset(), accessor.size(), accessor.count());
    match sparse_fits && accessor.view().is_none_or(fits) {
        true => Ok(()),
        false => fault("reaches outside its buffer".to_owned()),
    }
}

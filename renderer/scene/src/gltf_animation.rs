//! The motion in a glTF file: the keys of its animations, its skins, and the morph targets of its meshes.

use glam::{Mat4, Vec3, Vec4};
use gltf::accessor::{DataType, Dimensions};
use gltf::animation::{Channel, Interpolation, Property};
use gltf::{Accessor, Document, Node, Primitive, Semantic, animation::util::ReadOutputs};

use super::animation::{Clip, Influence, Piece, Rig, Track};
use super::gltf_geometry::{Buffers, VECTORS, check, items};
use super::limits::{KEY_NUMBERS_MAX, POSED_VERTICES_MAX};
use super::{assemble::Assembler, part::Part};

/// Types of numbers that integers may stand for.
const NUMBERS: &[DataType] = &[DataType::F32, DataType::I8, DataType::U8, DataType::I16, DataType::U16];

/// Reads animations and skins by `order`, parents first. Unreadable ones are left out with a note.
pub(super) fn read(
    document: &Document,
    order: Vec<(usize, Option<usize>)>,
    buffers: &Buffers,
    assembler: &mut Assembler,
) -> Rig {
    let mut is_shown = vec![false; document.nodes().len()];
    order.iter().for_each(|(node, _)| is_shown[*node] = true);
    let (mut numbers, mut faults) = (0, Vec::new());
    let mut clips = Vec::new();
    for animation in document.animations() {
        let mut tracks: Vec<Track> = Vec::new();
        for channel in animation.channels().filter(|channel| is_shown[channel.target().node().index()]) {
            match track(&channel, buffers, &mut numbers) {
                Ok(track) => tracks.push(track),
                Err(fault) => faults.push(fault),
            }
        }
        let last = tracks.iter().filter_map(|track| track.times.last());
        let duration_s = last.copied().fold(0.0, f32::max);
        clips.push(Clip { name: animation.name().map(str::to_owned), duration_s, tracks });
    }
    if let Some(first) = faults.first() {
        assembler.note(format!("Left out {} channels of animations: {first}.", faults.len()));
    }
    let mut skins = Vec::new();
    for skin in document.skins() {
        let joints: Vec<usize> = skin.joints().map(|joint| joint.index()).collect();
        skins.push(bound(&joints, skin.inverse_bind_matrices(), &is_shown, buffers).unwrap_or_else(
            |fault| {
                assembler.note(format!("Left out skin {}: {fault}.", skin.index()));
                Vec::new()
            },
        ));
    }
    let rest = document.nodes().map(|node| node.transform()).collect();
    Rig { clips, rest, order, skins, ..Rig::default() }
}

/// Reads the keys of a channel. `numbers` counts those of all.
fn track(channel: &Channel, buffers: &Buffers, numbers: &mut usize) -> Result<Track, String> {
    let (sampler, target) = (channel.sampler(), channel.target());
    let (input, output) = (sampler.input(), sampler.output());
    let (node, property, interpolation) = (target.node(), target.property(), sampler.interpolation());
    let (dimensions, kinds, width) = match property {
        Property::Translation | Property::Scale => (Dimensions::Vec3, &NUMBERS[..1], 3),
        Property::Rotation => (Dimensions::Vec4, NUMBERS, 4),
        Property::MorphTargetWeights => (Dimensions::Scalar, NUMBERS, target_count(&node)),
    };
    let values = output.count().saturating_mul(dimensions.multiplicity());
    let wanted = numbers.saturating_add(input.count()).saturating_add(values);
    if wanted > KEY_NUMBERS_MAX {
        return Err(format!("all together have more than {KEY_NUMBERS_MAX} numbers in their keys"));
    }
    *numbers = wanted;
    let keys = items::<f32>(&input, (Dimensions::Scalar, &[DataType::F32]), buffers)?;
    let times: Vec<f32> = keys.collect();
    let is_rising = times.windows(2).all(|pair| pair[0] < pair[1]);
    if !is_rising || times.iter().any(|time| !time.is_finite() || *time < 0.0) {
        return Err(format!("the times in accessor {} do not rise from 0 or later", input.index()));
    }
    check(&output, (dimensions, kinds), buffers)?;
    let parts = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let expected = times.len().saturating_mul(parts).saturating_mul(width);
    if expected == 0 || values != expected {
        return Err(format!(
            "accessor {} has {} elements for {} keys",
            output.index(),
            output.count(),
            times.len()
        ));
    }
    let reader = channel.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
    let values: Vec<f32> = match reader.read_outputs() {
        Some(ReadOutputs::Translations(all) | ReadOutputs::Scales(all)) => all.flatten().collect(),
        Some(ReadOutputs::Rotations(all)) => all.into_f32().flatten().collect(),
        Some(ReadOutputs::MorphTargetWeights(all)) => all.into_f32().collect(),
        None => return Err(format!("accessor {} reaches outside its buffer", output.index())),
    };
    if values.len() != expected || values.iter().any(|value| !value.is_finite()) {
        return Err(not_finite(&output));
    }
    Ok(Track { node: node.index(), property, interpolation, times, values, width })
}

fn not_finite(accessor: &Accessor) -> String {
    format!("accessor {} holds numbers that are not finite", accessor.index())
}

/// The number of morph targets of a node's mesh.
fn target_count(node: &Node) -> usize {
    let primitives = node.mesh().into_iter().flat_map(|mesh| mesh.primitives());
    primitives.map(|primitive| primitive.morph_targets().count()).max().unwrap_or_default()
}

/// The joints of a skin with their inverse bind matrices.
fn bound(
    joints: &[usize],
    matrices: Option<Accessor>,
    is_shown: &[bool],
    buffers: &Buffers,
) -> Result<Vec<(usize, Mat4)>, String> {
    if joints.is_empty() {
        return Err("it has no joints, or such as there are not".to_owned());
    }
    if let Some(hidden) = joints.iter().find(|joint| !is_shown[**joint]) {
        return Err(format!("its joint, node {hidden}, is not in the scene that is shown"));
    }
    let Some(matrices) = matrices else {
        return Ok(joints.iter().map(|joint| (*joint, Mat4::IDENTITY)).collect());
    };
    if matrices.count() < joints.len() {
        return Err(format!("it has {} joints and {} matrices", joints.len(), matrices.count()));
    }
    let all = items::<[[f32; 4]; 4]>(&matrices, (Dimensions::Mat4, &[DataType::F32]), buffers)?;
    let all = joints.iter().copied().zip(all.map(|columns| Mat4::from_cols_array_2d(&columns)));
    let bound: Vec<(usize, Mat4)> = all.collect();
    if bound.iter().any(|(_, matrix)| !matrix.is_finite()) {
        return Err(not_finite(&matrices));
    }
    Ok(bound)
}

/// A primitive that is skinned, morphed or moved, from its triangles in its mesh's own space. `posed` counts
/// the vertices of all.
///
/// # Errors
/// One sentence about a morph target or a skin that cannot be read.
pub(super) fn piece(
    primitive: &Primitive,
    part: &Part,
    (node, to_node): (&Node, Mat4),
    rig: &Rig,
    buffers: &Buffers,
    posed: &mut usize,
) -> Result<Piece, String> {
    let vertices = part.positions.len();
    let count = primitive.morph_targets().count();
    let wanted = posed.saturating_add(vertices.saturating_mul(1 + count));
    if wanted > POSED_VERTICES_MAX {
        return Err(format!("there are more than {POSED_VERTICES_MAX} vertices and changes of such"));
    }
    *posed = wanted;
    let changes = |accessor: Option<Accessor>| match accessor {
        Some(accessor) if accessor.count() != vertices => {
            Err(format!("a morph target has {} of {vertices} vertices", accessor.count()))
        }
        Some(accessor) => {
            let all = items::<[f32; 3]>(&accessor, VECTORS, buffers)?.map(Vec3::from_array);
            let all: Vec<Vec3> = all.collect();
            if all.iter().all(|change| change.is_finite()) { Ok(all) } else { Err(not_finite(&accessor)) }
        }
        None => Ok(Vec::new()),
    };
    let mut targets = Vec::new();
    for target in primitive.morph_targets() {
        targets.push([changes(target.positions())?, changes(target.normals())?]);
    }
    let own = node.weights().or(node.mesh().and_then(|mesh| mesh.weights()));
    let skin = node.skin().map(|skin| skin.index()).filter(|skin| !rig.skins[*skin].is_empty());
    let skin = match skin {
        Some(skin) => Some((skin, influences(primitive, vertices, rig.skins[skin].len(), buffers)?)),
        None => None,
    };
    Ok(Piece {
        node: node.index(),
        to_node,
        vertices: [part.positions.clone(), part.normals.clone()],
        targets,
        weights: own.map(<[f32]>::to_vec).unwrap_or_default(),
        skin,
    })
}

/// The joints of each vertex, with weights that add up to one.
fn influences(
    primitive: &Primitive,
    vertices: usize,
    joint_count: usize,
    buffers: &Buffers,
) -> Result<Vec<Influence>, String> {
    let kinds: [&[DataType]; 2] =
        [&[DataType::U8, DataType::U16], &[DataType::F32, DataType::U8, DataType::U16]];
    for (semantic, kinds) in [Semantic::Joints(0), Semantic::Weights(0)].into_iter().zip(kinds) {
        let accessor = primitive.get(&semantic).filter(|accessor| accessor.count() == vertices);
        let accessor = accessor.ok_or("not all its vertices have joints and weights")?;
        check(&accessor, (Dimensions::Vec4, kinds), buffers)?;
    }
    let reader = primitive.reader(|buffer| buffers.get(buffer.index()).map(|data| &data.0[..]));
    let (Some(joints), Some(weights)) = (reader.read_joints(0), reader.read_weights(0)) else {
        return Err("its joints or weights reach outside their buffer".to_owned());
    };
    let influence = |(joints, weights): ([u16; 4], [f32; 4])| {
        let weights = Vec4::from(weights).max(Vec4::ZERO);
        let sum = weights.element_sum();
        let weights = if sum > 0.0 && sum.is_finite() { weights / sum } else { Vec4::X }.to_array();
        let mut joints = joints;
        for (joint, _) in joints.iter_mut().zip(weights).filter(|(_, weight)| *weight == 0.0) {
            *joint = 0;
        }
        match joints.iter().find(|joint| usize::from(**joint) >= joint_count) {
            Some(joint) => Err(format!("a vertex hangs on joint {joint} of {joint_count}")),
            None => Ok((joints, weights)),
        }
    };
    joints.into_u16().zip(weights.into_f32()).map(influence).collect()
}

//! Scenes that move by animations of their file, after glTF 2.0: nodes, joints, and morph targets.

use std::{collections::HashMap, sync::Arc};

use glam::{Affine3A, DMat4, DVec3, Mat3, Mat4, Quat, Vec3, Vec3A};
use gltf::animation::{Interpolation, Property};
use gltf::scene::Transform;
use rayon::prelude::*;
use treewright_accel::{Instances, Triangles};

use super::{Placement, Up, part::normal_matrix};

/// The keys of one property of a node.
#[derive(Clone, Debug)]
pub(super) struct Track {
    pub(super) node: usize,
    pub(super) property: Property,
    pub(super) interpolation: Interpolation,
    /// Rising, in seconds; at least one.
    pub(super) times: Vec<f32>,
    /// `width` numbers a key; a cubic spline has thrice as many: tangent, value, and tangent after it.
    pub(super) values: Vec<f32>,
    pub(super) width: usize,
}

/// Least scale that leaves room for an inverse.
const SCALE_MIN: f32 = 1e-6;

impl Track {
    /// Whether it may flatten its node: by scales of next to nothing, or of both signs.
    fn may_flatten(&self) -> bool {
        let keeps_side = |axis: usize| {
            let scales = || self.values.iter().skip(axis).step_by(3);
            scales().all(|scale| *scale > SCALE_MIN) || scales().all(|scale| *scale < -SCALE_MIN)
        };
        let is_cubic = self.interpolation == Interpolation::CubicSpline;
        self.property == Property::Scale && (is_cubic || !(0..3).all(keeps_side))
    }

    /// The value at a time; before the first key its value, and after the last one that.
    fn at(&self, seconds: f32) -> Vec<f32> {
        let next = self.times.partition_point(|key| *key <= seconds);
        let key = next.saturating_sub(1);
        let is_cubic = self.interpolation == Interpolation::CubicSpline;
        let parts = if is_cubic { 3 } else { 1 };
        let part = |key: usize, part: usize| &self.values[(key * parts + part) * self.width..][..self.width];
        let from = part(key, parts / 2);
        if next == 0 || next == self.times.len() || self.interpolation == Interpolation::Step {
            return from.to_vec();
        }
        let to = part(next, parts / 2);
        let step = self.times[next] - self.times[key];
        let share = (seconds - self.times[key]) / step;
        if is_cubic {
            let (square, cube) = (share * share, share * share * share);
            let shares = [
                2.0 * cube - 3.0 * square + 1.0,
                step * (cube - 2.0 * square + share),
                3.0 * square - 2.0 * cube,
                step * (cube - square),
            ];
            let terms = [from, part(key, 2), to, part(next, 0)];
            let mixed = |place: usize| (0..4).map(|term| shares[term] * terms[term][place]).sum::<f32>();
            (0..self.width).map(mixed).collect()
        } else if self.property == Property::Rotation {
            turn(from).slerp(turn(to), share).to_array().to_vec()
        } else {
            from.iter().zip(to).map(|(from, to)| from + (to - from) * share).collect()
        }
    }
}

/// The rotation of four numbers, which need not be of unit length; none for zeros.
pub(super) fn turn(numbers: &[f32]) -> Quat {
    let turn = Quat::from_slice(numbers);
    if turn.length_squared() > 0.0 { turn.normalize() } else { Quat::IDENTITY }
}

/// One animation of a file.
#[derive(Clone, Debug)]
pub(super) struct Clip {
    pub(super) name: Option<String>,
    /// The time of its last key.
    pub(super) duration_s: f32,
    pub(super) tracks: Vec<Track>,
}

/// The four joints of a skinned vertex and their weights.
pub(super) type Influence = ([u16; 4], [f32; 4]);

/// A primitive in its mesh's own space, where a node shows it.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) node: usize,
    /// From the mesh's space to the node's.
    pub(super) to_node: Mat4,
    /// Positions and normals; no normals for a flat one.
    pub(super) vertices: [Vec<Vec3>; 2],
    /// By morph target: the changes of positions and normals.
    pub(super) targets: Vec<[Vec<Vec3>; 2]>,
    /// Weights of the targets at rest.
    pub(super) weights: Vec<f32>,
    /// The number of the skin, and by vertex what it hangs on.
    pub(super) skin: Option<(usize, Vec<Influence>)>,
}

/// The matrix that moves a vertex that hangs on some of a skin's joints.
fn blended((joints, weights): &Influence, matrices: &[Mat4]) -> Mat4 {
    joints.iter().zip(weights).map(|(joint, weight)| matrices[usize::from(*joint)] * *weight).sum()
}

impl Piece {
    /// Positions and normals in the mesh's own space, with targets of these weights.
    pub(super) fn morphed(&self, weights: &[f32]) -> [Vec<Vec3>; 2] {
        let mut vertices = self.vertices.clone();
        for (target, weight) in self.targets.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
            for (vectors, changes) in vertices.iter_mut().zip(target) {
                vectors.par_iter_mut().zip(changes).for_each(|(vector, change)| *vector += *change * *weight);
            }
        }
        vertices
    }

    /// Whether its skin mirrors a triangle in a pose, so that it is seen from the other side.
    pub(super) fn is_mirrored(&self, triangle: &[u32; 3], pose: &Pose) -> bool {
        self.skin.as_ref().is_some_and(|(skin, influences)| {
            let influence = influences.get(triangle[0] as usize);
            influence.is_some_and(|one| blended(one, &pose.joints[*skin]).determinant() < 0.0)
        })
    }

    /// Positions and normals in a pose. A skinned mesh stands where its joints are.
    pub(super) fn posed(&self, pose: &Pose) -> [Vec<Vec3>; 2] {
        let fixed = pose.worlds[self.node].as_mat4() * self.to_node;
        let place = |vertex: usize| match &self.skin {
            Some((skin, influences)) => blended(&influences[vertex], &pose.joints[*skin]),
            None => fixed,
        };
        let [mut positions, mut normals] =
            self.morphed(pose.weights.get(&self.node).unwrap_or(&self.weights));
        let moved = |(vertex, at): (usize, &mut Vec3)| *at = place(vertex).transform_point3(*at);
        positions.par_iter_mut().enumerate().for_each(moved);
        let turned = |(vertex, normal): (usize, &mut Vec3)| {
            *normal = (normal_matrix(&Mat3::from_mat4(place(vertex))) * *normal).normalize_or_zero();
        };
        normals.par_iter_mut().enumerate().for_each(turned);
        [positions, normals]
    }
}

/// An instance that a node carries.
#[derive(Clone, Debug)]
pub(super) struct Carried {
    /// Its number among those that the file places.
    pub(super) instance: usize,
    pub(super) node: usize,
    /// From the mesh's space to the node's.
    pub(super) to_node: Mat4,
}

/// Where everything is at a moment.
#[derive(Clone, Debug, Default)]
pub(super) struct Pose {
    /// By node: from its space to the scene's.
    worlds: Vec<DMat4>,
    /// By node: weights of morph targets that an animation gives.
    weights: HashMap<usize, Vec<f32>>,
    /// By skin and joint: from the space of a skinned mesh to the scene's.
    joints: Vec<Vec<Mat4>>,
}

/// The nodes of a file, and the meshes that move with them.
#[derive(Clone, Debug, Default)]
pub(super) struct Rig {
    pub(super) clips: Vec<Clip>,
    /// By node: where it stands in its parent's space at rest.
    pub(super) rest: Vec<Transform>,
    /// The nodes of the scene that is shown, each with its parent and after it.
    pub(super) order: Vec<(usize, Option<usize>)>,
    /// By skin: joints with their inverse bind matrices. Empty for one that cannot be read.
    pub(super) skins: Vec<Vec<(usize, Mat4)>>,
    pub(super) pieces: Vec<Piece>,
    /// The number of their vertices.
    pub(super) vertex_count: u32,
    /// The instances that move.
    pub(super) carried: Vec<Carried>,
    /// The number of instances that the file places, moving or not.
    pub(super) instance_count: usize,
}

impl Rig {
    /// By node: whether it or one above moves; whether its weights change; whether it may be flattened.
    pub(super) fn moving(&self) -> [Vec<bool>; 3] {
        let mut moving: [Vec<bool>; 3] = std::array::from_fn(|_| vec![false; self.rest.len()]);
        for track in self.clips.iter().flat_map(|clip| &clip.tracks) {
            moving[usize::from(track.property == Property::MorphTargetWeights)][track.node] = true;
            moving[2][track.node] |= track.may_flatten();
        }
        for (node, parent) in &self.order {
            for kind in [0, 2] {
                let is_carried = parent.is_some_and(|parent| moving[kind][parent]);
                moving[kind][*node] |= is_carried;
            }
        }
        moving
    }

    /// Takes out tracks that move no piece and no instance by targets, nodes, joints or what is above.
    pub(super) fn keep_what_moves(&mut self) {
        let (mut carries, mut morphs) = (vec![false; self.rest.len()], vec![false; self.rest.len()]);
        let mut is_used = vec![false; self.skins.len()];
        self.carried.iter().for_each(|carried| carries[carried.node] = true);
        for piece in &self.pieces {
            morphs[piece.node] |= !piece.targets.is_empty();
            match &piece.skin {
                Some((skin, _)) => is_used[*skin] = true,
                None => carries[piece.node] = true,
            }
        }
        for (skin, _) in self.skins.iter().zip(is_used).filter(|(_, is_used)| *is_used) {
            skin.iter().for_each(|(joint, _)| carries[*joint] = true);
        }
        for (node, parent) in self.order.iter().rev() {
            if let Some(parent) = parent {
                carries[*parent] |= carries[*node];
            }
        }
        for clip in &mut self.clips {
            clip.tracks.retain(|track| match track.property {
                Property::MorphTargetWeights => morphs[track.node],
                _ => carries[track.node],
            });
        }
    }

    /// The pose at a time of a clip in seconds, or at rest.
    pub(super) fn pose(&self, moment: Option<(&Clip, f32)>, to_scene: DMat4) -> Pose {
        let (mut moved, mut weights) = (HashMap::new(), HashMap::new());
        let tracks =
            moment.iter().flat_map(|(clip, seconds)| clip.tracks.iter().map(move |track| (track, *seconds)));
        for (track, seconds) in tracks {
            let now = track.at(seconds);
            if track.property == Property::MorphTargetWeights {
                weights.insert(track.node, now);
                continue;
            }
            let (shift, turned, scale) = moved.entry(track.node).or_insert_with(|| {
                let (shift, turned, scale) = self.rest[track.node].clone().decomposed();
                (Vec3::from(shift), turn(&turned), Vec3::from(scale))
            });
            match track.property {
                Property::Rotation => *turned = turn(&now),
                Property::Scale => *scale = Vec3::from_slice(&now),
                _ => *shift = Vec3::from_slice(&now),
            }
        }
        let mut worlds = vec![to_scene; self.rest.len()];
        for (node, parent) in &self.order {
            let local = match moved.get(node) {
                Some((shift, turned, scale)) => {
                    Mat4::from_scale_rotation_translation(*scale, *turned, *shift)
                }
                None => Mat4::from_cols_array_2d(&self.rest[*node].clone().matrix()),
            };
            worlds[*node] = parent.map_or(to_scene, |parent| worlds[parent]) * local.as_dmat4();
        }
        let of_skin = |skin: &Vec<(usize, Mat4)>| {
            let matrices = skin.iter().map(|(joint, bind)| (worlds[*joint] * bind.as_dmat4()).as_mat4());
            matrices.collect::<Vec<_>>()
        };
        let joints = self.skins.iter().map(of_skin).collect();
        Pose { worlds, weights, joints }
    }
}

/// The animations of a scene's file.
#[derive(Clone, Debug)]
pub struct Animated {
    rig: Arc<Rig>,
    /// From places of the file to places of the scene.
    to_scene: DMat4,
    /// From lengths of the file to those of the scene, in objects too.
    factor: f64,
    /// By vertex of the scene: its number among those of all pieces, or any larger one where it stands still.
    sources: Arc<[u32]>,
    /// The instances that were copied into the world, and by vertex of the scene the number of its own.
    copied: Option<(Arc<Instances>, Arc<[u32]>)>,
}

impl Animated {
    /// Of a scene whose vertices come from these of the rig.
    pub(super) fn new(rig: Rig, sources: Vec<u32>, placement: &Placement, up: Up) -> Self {
        let to_scene = DMat4::from_scale(DVec3::splat(placement.factor))
            * DMat4::from_translation(-placement.origin)
            * DMat4::from_mat3(up.matrix().as_dmat3());
        let (rig, sources, factor) = (Arc::new(rig), sources.into(), placement.factor);
        Self { rig, to_scene, factor, sources, copied: None }
    }

    /// The scene with its instances copied into the world: by vertex, its original and its instance.
    pub(super) fn copied(&self, instances: &Arc<Instances>, copies: &[(u32, u32)]) -> Self {
        let sources = copies.iter().map(|(vertex, _)| self.sources[*vertex as usize]).collect();
        let of_vertex = copies.iter().map(|(_, instance)| *instance).collect();
        let copied = (!self.rig.carried.is_empty()).then(|| (Arc::clone(instances), of_vertex));
        Self { rig: Arc::clone(&self.rig), sources, copied, ..*self }
    }

    /// Whether vertices move, and not only whole instances.
    pub(super) fn moves_vertices(&self) -> bool {
        !self.rig.pieces.is_empty() || self.copied.is_some()
    }

    /// The animations that move something: the number of each, and its name.
    pub fn all(&self) -> impl Iterator<Item = (usize, Option<&str>)> {
        let clips = self.rig.clips.iter().enumerate().filter(|(_, clip)| !clip.tracks.is_empty());
        clips.map(|(number, clip)| (number, clip.name.as_deref()))
    }

    /// The number of the animation of this name, or of this number from 0; of the first without any.
    pub fn find(&self, wanted: Option<&str>) -> Option<usize> {
        let Some(wanted) = wanted else { return self.all().next().map(|(number, _)| number) };
        let named = self.all().find(|(_, name)| *name == Some(wanted));
        let found = named.or_else(|| self.all().find(|(number, _)| number.to_string() == wanted));
        found.map(|(number, _)| number)
    }

    fn pose(&self, clip: usize, share: f32) -> Pose {
        let clip = &self.rig.clips[clip];
        self.rig.pose(Some((clip, share * clip.duration_s)), self.to_scene)
    }

    /// The places of the scene's instances at a share of an animation, from those at rest.
    pub(super) fn places(&self, clip: usize, share: f32, rest: &Instances) -> Vec<Affine3A> {
        let pose = self.pose(clip, share);
        let mut places: Vec<Affine3A> = rest.placed().iter().map(|instance| instance.to_world).collect();
        // What stands in the world itself comes before those of the file.
        let first = places.len().saturating_sub(self.rig.instance_count);
        let to_file = DMat4::from_scale(DVec3::splat(1.0 / self.factor));
        for carried in &self.rig.carried {
            let to_world = pose.worlds[carried.node] * carried.to_node.as_dmat4() * to_file;
            if let Some(place) = places.get_mut(first + carried.instance) {
                *place = Affine3A::from_mat4(to_world.as_mat4());
            }
        }
        places
    }

    /// The motion of copied instances by an animation: by vertex, from its place at rest to that now.
    fn carrying(&self, clip: usize, share: f32) -> impl Fn(usize) -> Option<Affine3A> + Sync {
        let copied = self.copied.as_ref();
        let moves = copied.map_or_else(Vec::new, |(instances, _)| {
            let pairs = instances.placed().iter().zip(self.places(clip, share, instances));
            let by = pairs.map(|(rest, now)| (now != rest.to_world).then(|| now * rest.to_object));
            by.collect::<Vec<Option<Affine3A>>>()
        });
        move |vertex: usize| copied.and_then(|(_, of_vertex)| moves[of_vertex[vertex] as usize])
    }

    /// Positions and normals of the scene at a share of an animation, from those at rest.
    pub(super) fn at(
        &self,
        clip: usize,
        share: f32,
        rest: &Triangles,
        normals: &[Vec3],
    ) -> (Vec<Vec3A>, Vec<Vec3>) {
        let (pose, carrying) = (self.pose(clip, share), self.carrying(clip, share));
        let (mut posed, mut turned) = (Vec::new(), Vec::new());
        for piece in &self.rig.pieces {
            let [positions, normals] = piece.posed(&pose);
            posed.extend(positions);
            turned.extend(normals);
            turned.resize(posed.len(), Vec3::ZERO);
        }
        let sources = self.sources.par_iter().map(|source| *source as usize);
        let place = |(vertex, (source, at)): (usize, (usize, &Vec3A))| match posed.get(source) {
            Some(at) => Vec3A::from(*at),
            None => carrying(vertex).map_or(*at, |by| by.transform_point3a(*at)),
        };
        let positions: Vec<Vec3A> = sources.clone().zip(rest.positions()).enumerate().map(place).collect();
        let upright = |(vertex, (source, normal)): (usize, (usize, &Vec3))| match turned.get(source) {
            Some(normal) => *normal,
            None => carrying(vertex).map_or(*normal, |by| {
                (normal_matrix(&Mat3::from(by.matrix3)) * *normal).normalize_or(*normal)
            }),
        };
        let mut normals: Vec<Vec3> = sources.zip(normals).enumerate().map(upright).collect();
        if normals.is_empty() {
            return (positions, normals);
        }
        // Flat triangles have vertices of their own.
        for corners in rest.indices().iter().map(|corners| corners.map(|corner| corner as usize)) {
            if corners.iter().any(|corner| normals[*corner] == Vec3::ZERO) {
                let [a, b, c] = corners.map(|corner| positions[corner]);
                let flat = Vec3::from((b - a).cross(c - a).normalize_or(Vec3A::Y));
                for corner in corners {
                    if normals[corner] == Vec3::ZERO {
                        normals[corner] = flat;
                    }
                }
            }
        }
        (positions, normals)
    }
}

//! Motions for scenes that stand still, so that updates of structures can be tuned on any scene.
//!
//! Three deform everything (`sway`, `twist`, `ripple`), five move parts: each about itself (`rigid`), apart
//! (`explode`), through one another (`swarm`), down and up again (`fall`), or round on a path of its own
//! (`crowd`). A part is an instance, or in a scene without any a connected set of triangles, which share
//! corners. All come round after a cycle, and time 0 is the scene at rest. The last (`file`) is an animation
//! of the scene's own file, which keeps to neither.

use std::f32::consts::{PI, TAU};
use std::{collections::HashMap, sync::Arc};

use glam::{Affine3A, Quat, Vec3, Vec3A};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use treewright_accel::{Instance, Instances};

use super::{Bounds, Scene, SceneError, error::one_line, objects::can_stand};

/// A way to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Motion {
    /// Everything bends to and fro, the more the higher.
    Sway,
    /// Everything turns about the upright through the middle, the more the higher.
    Twist,
    /// Waves run through everything.
    Ripple,
    /// Each part turns about itself, and rises and sinks.
    Rigid,
    /// Parts fly apart and come back.
    Explode,
    /// Parts circle the middle, each at a speed of its own.
    Swarm,
    /// Parts fall to the ground, one after the other, and rise again.
    Fall,
    /// Parts walk, each round a circle of its own and facing the way; the large ones rest.
    Crowd,
    /// As an animation of the scene's file says; a cycle is its duration.
    File,
}

impl Motion {
    /// All, in the order in which they are listed.
    pub const ALL: [Self; 9] = [
        Self::Sway,
        Self::Twist,
        Self::Ripple,
        Self::Rigid,
        Self::Explode,
        Self::Swarm,
        Self::Fall,
        Self::Crowd,
        Self::File,
    ];

    /// As it is written, e.g. `sway`.
    pub fn name(self) -> &'static str {
        self.words().0
    }

    /// Its effect, in a sentence without a full stop.
    pub fn about(self) -> &'static str {
        self.words().1
    }

    /// Whether points of a part move otherwise than the rest of it.
    fn deforms(self) -> bool {
        matches!(self, Self::Sway | Self::Twist | Self::Ripple)
    }

    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::Sway => ("sway", "Everything bends to and fro, the more the higher"),
            Self::Twist => ("twist", "Everything turns about the upright, the more the higher"),
            Self::Ripple => ("ripple", "Waves run through everything"),
            Self::Rigid => ("rigid", "Each part turns about itself, rises and sinks"),
            Self::Explode => ("explode", "Parts fly apart and come back"),
            Self::Swarm => ("swarm", "Parts circle the middle, each at its own speed"),
            Self::Fall => ("fall", "Parts fall to the ground one by one, and rise again"),
            Self::Crowd => ("crowd", "Parts walk, each on a path of its own; the largest rest"),
            Self::File => ("file", "As an animation of the glTF file says (see --animation)"),
        }
    }
}

/// A scene that is made to move.
#[derive(Clone, Debug)]
pub struct Mover {
    base: Arc<Scene>,
    motion: Motion,
    bounds: Bounds,
    /// By object its box, in a scene of instances.
    boxes: Vec<Bounds>,
    /// The part of each vertex. Instances are parts in order.
    part_of: Vec<u32>,
    parts: Vec<Part>,
    /// The number of the file's animation.
    clip: usize,
}

/// A part of a crowd rests if it reaches through this share of the scene, such as the ground.
const LARGE: f32 = 0.4;

/// Triangles that move as one.
#[derive(Clone, Copy, Debug)]
struct Part {
    center: Vec3,
    lowest: f32,
    is_large: bool,
    /// Four numbers from -1 to 1 of its own.
    own: [f32; 4],
}

impl Mover {
    /// Prepares a scene: O(vertices + instances).
    ///
    /// # Errors
    /// [`SceneError::Instanced`] for a scene of instances that is to be deformed, and those of
    /// [`Mover::of_file`].
    pub fn new(base: Arc<Scene>, motion: Motion) -> Result<Self, SceneError> {
        if motion == Motion::File {
            return Self::of_file(base, None);
        }
        let (bounds, boxes) = (base.bounds(), base.placed().object_boxes());
        let (part_of, around_parts): (Vec<u32>, Vec<Bounds>) = match &base.instances {
            Some(_) if motion.deforms() => {
                return Err(SceneError::Instanced(base.name.clone()));
            }
            Some(instances) => {
                let around = |one: &Instance| boxes[one.object as usize].transformed(&one.to_world);
                (Vec::new(), instances.placed().iter().map(around).collect())
            }
            None => parts_of(&base),
        };
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let parts = around_parts.iter().map(|around| {
            let own = std::array::from_fn(|_| random.random_range(-1.0..1.0));
            // An instance of nothing is nowhere.
            let is_there = around.min.x <= around.max.x;
            let (center, lowest) = if is_there { (around.center(), around.min.y) } else { (Vec3::ZERO, 0.0) };
            Part { center, lowest, is_large: around.diagonal() > LARGE * bounds.diagonal(), own }
        });
        let parts = parts.collect();
        Ok(Self { base, motion, bounds, boxes, part_of, parts, clip: 0 })
    }

    /// Prepares a scene that moves by an animation of its file: that of this name or number, from 0, or the
    /// first one.
    ///
    /// # Errors
    /// [`SceneError::NoAnimation`] where there is none.
    pub fn of_file(base: Arc<Scene>, animation: Option<&str>) -> Result<Self, SceneError> {
        let animated = base.animated.as_ref();
        let Some(clip) = animated.and_then(|animated| animated.find(animation)) else {
            let named =
                |(number, name): (usize, Option<&str>)| format!("{number} {}", name.unwrap_or_default());
            let known =
                animated.map(|animated| one_line(&animated.all().map(named).collect::<Vec<_>>().join(", ")));
            return Err(SceneError::NoAnimation {
                name: base.name.clone(),
                wanted: animation.unwrap_or("0").to_owned(),
                known: known.unwrap_or("none".to_owned()),
            });
        };
        let boxes = base.placed().object_boxes();
        let (bounds, part_of, parts) = (Bounds::NOTHING, Vec::new(), Vec::new());
        Ok(Self { base, motion: Motion::File, bounds, boxes, part_of, parts, clip })
    }

    /// The scene at a moment, where 0 to 1 is one cycle. Triangles and instances keep their numbers. Where
    /// only instances move, their triangles are shared by all moments.
    ///
    /// # Errors
    /// [`SceneError::Moved`] where a vertex leaves the coordinates that there are, and
    /// [`SceneError::MovedInstance`] where an instance does.
    pub fn at(&self, time: f32) -> Result<Arc<Scene>, SceneError> {
        let (time, base) = (time.rem_euclid(1.0), &self.base);
        let number = if self.clip > 0 { self.clip.to_string() } else { String::new() };
        let name = format!("{}-{}{number}", base.name, self.motion.name());
        let animated = base.animated.as_ref().filter(|_| self.motion == Motion::File);
        let moved = match animated {
            Some(animated) => animated
                .moves_vertices()
                .then(|| animated.at(self.clip, time, &base.triangles, &base.normals)),
            None => base.instances.is_none().then(|| self.made(time)),
        };
        let mut now = Scene { name, ..(**base).clone() };
        if let Some((positions, normals)) = moved {
            (now.triangles, now.normals) = (Arc::new(base.triangles.moved(positions)?), normals);
        }
        if let Some(instances) = &base.instances {
            let places = match animated {
                Some(animated) => animated.places(self.clip, time, instances),
                None => {
                    let pairs = self.parts.iter().zip(instances.placed());
                    pairs.map(|(part, one)| self.place(part, time) * one.to_world).collect()
                }
            };
            now.instances = Some(self.placed(instances, places)?);
        }
        Ok(Arc::new(now))
    }

    /// Instances in other places, one for each.
    fn placed(&self, before: &Instances, places: Vec<Affine3A>) -> Result<Arc<Instances>, SceneError> {
        let stands =
            |(to_world, one): (&Affine3A, &Instance)| can_stand(&self.boxes[one.object as usize], to_world);
        if let Some(instance) = places.iter().zip(before.placed()).position(|pair| !stands(pair)) {
            return Err(SceneError::MovedInstance(self.base.name.clone(), instance));
        }
        Ok(Arc::new(before.moved(places).expect("their places were checked")))
    }

    /// Positions and normals in a motion that is made up.
    fn made(&self, time: f32) -> (Vec<Vec3A>, Vec<Vec3>) {
        let parts = if self.motion.deforms() { &[] } else { &self.parts[..] };
        let places: Vec<Affine3A> = parts.iter().map(|part| self.place(part, time)).collect();
        let moved = |vertex: usize, at: Vec3A| match places.get(self.part_of[vertex] as usize) {
            Some(place) => place.transform_point3a(at),
            None => self.deformed(at.into(), time).into(),
        };
        let before = self.base.triangles.positions();
        let positions: Vec<Vec3A> =
            before.par_iter().enumerate().map(|(vertex, at)| moved(vertex, *at)).collect();
        // Directions in the surface stay in it: the normal is upright on two of them.
        let reach = self.bounds.diagonal() * 1e-3;
        let turned = |(vertex, normal): (usize, &Vec3)| {
            let along = Vec3A::from(normal.any_orthonormal_vector());
            let across = Vec3A::from(*normal).cross(along);
            let (at, here) = (before[vertex], positions[vertex]);
            let [along, across] =
                [along, across].map(|to| moved(vertex, at + to * reach) - moved(vertex, at - to * reach));
            let upright = Vec3::from(along.cross(across)).normalize_or(*normal);
            if here.is_finite() { upright } else { *normal }
        };
        let normals = self.base.normals.par_iter().enumerate().map(turned).collect();
        (positions, normals)
    }

    fn place(&self, part: &Part, time: f32) -> Affine3A {
        let (size, middle) = (self.bounds.diagonal(), self.bounds.center());
        let [one, two, three, four] = part.own;
        let axis = Vec3::new(one, 0.5 + two.abs(), three).normalize_or(Vec3::Y);
        let about = |hub: Vec3, turn: Quat| {
            Affine3A::from_translation(hub) * Affine3A::from_quat(turn) * Affine3A::from_translation(-hub)
        };
        let shifted = |by: Vec3, turn: Quat| Affine3A::from_translation(by) * about(part.center, turn);
        // Once or twice round in a cycle, one way or the other.
        let round = || {
            let turns = if one.abs() < 0.5 { one.signum() } else { 2.0 * one.signum() };
            Quat::from_rotation_y(TAU * turns * time)
        };
        match self.motion {
            Motion::Sway | Motion::Twist | Motion::Ripple | Motion::File => Affine3A::IDENTITY,
            Motion::Rigid => {
                let rise = 0.02 * size * two * ((TAU * time + PI * four).sin() - (PI * four).sin());
                let turns = if one < 0.0 { -1.0 } else { 1.0 };
                shifted(Vec3::Y * rise, Quat::from_rotation_y(turns * TAU * time))
            }
            Motion::Explode => {
                let out = (PI * time).sin().powi(2);
                let by = (part.center - middle) * (0.6 + 0.4 * four) + axis * (0.05 * size * two);
                shifted(by * out, Quat::from_axis_angle(axis, TAU * one * out))
            }
            Motion::Swarm => {
                let rise = 0.05 * size * two * ((TAU * time + PI * three).sin() - (PI * three).sin());
                Affine3A::from_translation(Vec3::Y * rise) * about(middle, round())
            }
            Motion::Crowd if part.is_large => Affine3A::IDENTITY,
            Motion::Crowd => {
                let radius = size * (0.02 + 0.06 * two.abs());
                about(part.center + Quat::from_rotation_y(PI * three) * Vec3::X * radius, round())
            }
            Motion::Fall => {
                // A third of a cycle to fall from the top; each begins in a time of its own.
                let since = (0.5 - (time - 0.5).abs() - 0.1 * (1.0 + four)).max(0.0);
                let height = self.bounds.size().y;
                let drop = (height * (3.0 * since).powi(2)).min(part.lowest - self.bounds.min.y);
                let share = if height > 0.0 { drop / height } else { 0.0 };
                let away = Vec3::new(one, 0.0, three) * (0.3 * drop);
                shifted(away - Vec3::Y * drop, Quat::from_axis_angle(axis, 2.0 * one * share))
            }
        }
    }

    fn deformed(&self, at: Vec3, time: f32) -> Vec3 {
        let (size, middle) = (self.bounds.size(), self.bounds.center());
        let diagonal = self.bounds.diagonal().max(f32::MIN_POSITIVE);
        let height = if size.y > 0.0 { (at.y - self.bounds.min.y) / size.y } else { 0.0 };
        match self.motion {
            Motion::Sway => {
                let phase = 2.0 * (at.x + 0.7 * at.z) / diagonal;
                let bend = (TAU * time + phase).sin() - phase.sin();
                at + Vec3::new(1.0, 0.0, 0.4) * (0.1 * size.y * height * height * bend)
            }
            Motion::Twist => {
                let turn = Quat::from_rotation_y(1.2 * height * (TAU * time).sin());
                let arm = Vec3::new(at.x - middle.x, 0.0, at.z - middle.z);
                Vec3::new(middle.x, at.y, middle.z) + turn * arm
            }
            Motion::Ripple => {
                let along = TAU * 3.0 * (at.x + 0.6 * at.z) / diagonal;
                at + Vec3::Y * (0.03 * diagonal * ((along - TAU * time).sin() - along.sin()))
            }
            _ => at,
        }
    }
}

/// The part of each vertex, and the box around each part. Vertices in one place are one.
fn parts_of(scene: &Scene) -> (Vec<u32>, Vec<Bounds>) {
    let positions = scene.triangles.positions();
    let mut first_there: HashMap<[u32; 3], u32> = HashMap::with_capacity(positions.len());
    let mut parent: Vec<u32> = (0..)
        .zip(positions)
        .map(|(number, at)| *first_there.entry(at.to_array().map(f32::to_bits)).or_insert(number))
        .collect();
    for [a, b, c] in scene.triangles.indices() {
        let root = root(&mut parent, *a);
        for other in [*b, *c] {
            let other = self::root(&mut parent, other);
            // The lower number stays, so that the order of triangles does not matter.
            let (low, high) = (root.min(other), root.max(other));
            parent[high as usize] = low;
        }
    }
    let (mut number_of, mut boxes) = (HashMap::new(), Vec::<Bounds>::new());
    let part = |(vertex, at): (u32, &Vec3A)| {
        let root = root(&mut parent, vertex);
        let number = *number_of.entry(root).or_insert_with(|| {
            boxes.push(Bounds::NOTHING);
            boxes.len() as u32 - 1
        });
        let (at, around) = (Vec3::from(*at), &mut boxes[number as usize]);
        *around = around.union(&Bounds { min: at, max: at });
        number
    };
    let part_of = (0..).zip(positions).map(part).collect();
    (part_of, boxes)
}

/// The vertex that stands for a vertex's part; the way there is shortened.
fn root(parent: &mut [u32], vertex: u32) -> u32 {
    let mut at = vertex;
    while parent[at as usize] != at {
        parent[at as usize] = parent[parent[at as usize] as usize];
        at = parent[at as usize];
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;

    fn scene(name: &str) -> Arc<Scene> {
        let options = builtin::Options { detail: 0.05, ..builtin::Options::default() };
        Arc::new(builtin::build(name, &options).expect("it is built in"))
    }

    #[test]
    fn every_motion_begins_with_the_scene_as_it_was_and_comes_round() {
        let base = scene("quick");
        let reach = Bounds::of(&base.triangles).diagonal();
        for motion in Motion::ALL.into_iter().filter(|motion| *motion != Motion::File) {
            let mover = Mover::new(base.clone(), motion).expect("it has no instances");
            let far = |time: f32| {
                let now = mover.at(time).expect("it stays in range");
                assert_eq!(now.triangles.indices(), base.triangles.indices());
                let pairs = now.triangles.positions().iter().zip(base.triangles.positions());
                pairs.map(|(now, before)| now.distance(*before)).fold(0.0, f32::max) / reach
            };
            for time in [0.0, 1.0, -2.0] {
                assert!(far(time) < 1e-4, "{motion:?} at {time}: {}", far(time));
            }
            assert!(far(0.35) > 0.01, "{motion:?} moves: {}", far(0.35));
            let now = mover.at(0.35).expect("it stays in range");
            assert!(now.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-4), "{motion:?}");
        }
    }

    #[test]
    fn parts_stay_whole() {
        let base = scene("gallery");
        for motion in [Motion::Rigid, Motion::Explode, Motion::Swarm, Motion::Fall, Motion::Crowd] {
            let mover = Mover::new(base.clone(), motion).expect("it has no instances");
            assert!(mover.parts.len() > 20, "{}", mover.parts.len());
            let now = mover.at(0.4).expect("it stays in range");
            let edges = |scene: &Scene| -> Vec<f32> {
                let corners = (0..scene.triangles.len()).map(|number| scene.triangles.corners(number));
                corners.map(|[a, b, _]| a.distance(b)).collect()
            };
            let size = Bounds::of(&base.triangles).diagonal();
            for (before, after) in edges(&base).into_iter().zip(edges(&now)) {
                assert!((before - after).abs() < 1e-4 * size, "{motion:?}: {before} became {after}");
            }
        }
    }

    #[test]
    fn normals_turn_with_their_surface() {
        let base = scene("statue");
        let mover = Mover::new(base.clone(), Motion::Twist).expect("it has no instances");
        let now = mover.at(0.2).expect("it stays in range");
        let mut upright = 0;
        for (number, corners) in now.triangles.indices().iter().enumerate() {
            let [a, b, c] = now.triangles.corners(number);
            let flat = Vec3::from((b - a).cross(c - a)).normalize_or_zero();
            upright +=
                usize::from(corners.iter().all(|&corner| now.normals[corner as usize].dot(flat) > 0.3));
        }
        assert!(upright * 10 > now.triangles.len() * 9, "{upright} of {}", now.triangles.len());
    }

    #[test]
    fn instances_move_as_they_are() {
        let base = scene("forest");
        let before = base.instances.as_deref().expect("it is made of instances").placed();
        for motion in [Motion::Rigid, Motion::Explode, Motion::Swarm, Motion::Fall, Motion::Crowd] {
            let mover = Mover::new(base.clone(), motion).expect("its parts move");
            let moved = |time: f32| {
                let now = mover.at(time).expect("it stays in range");
                assert!(Arc::ptr_eq(&now.triangles, &base.triangles), "{motion:?}");
                let places = now.instances.as_deref().expect("they stay instances").placed().to_vec();
                let pairs = before.iter().zip(&places);
                let far = |(before, now): (&Instance, &Instance)| {
                    now.to_world.translation.distance(before.to_world.translation)
                };
                let most = pairs.clone().map(far).fold(0.0, f32::max);
                (pairs.filter(|pair| pair.0.to_world != pair.1.to_world).count(), most)
            };
            let reach = base.bounds().diagonal();
            for time in [0.0, 3.0] {
                assert!(moved(time).1 < 1e-4 * reach, "{motion:?} at {time}: {}", moved(time).1);
            }
            let (count, _) = moved(0.35);
            // The ground, first of all, rests in a crowd.
            let all = before.len() - usize::from(motion == Motion::Crowd);
            assert!(
                count == all || motion == Motion::Fall && count > all / 2,
                "{motion:?}: {count} of {all}"
            );
        }
        let crowd = Mover::new(base.clone(), Motion::Crowd).expect("its parts move");
        let now = crowd.at(0.35).expect("it stays in range");
        assert_eq!(now.instance(0).map(|ground| ground.to_world), Some(Affine3A::IDENTITY));
    }

    #[test]
    fn instances_are_refused_with_the_remedy() {
        let error = Mover::new(scene("forest"), Motion::Sway).expect_err("it is made of instances");
        assert!(error.to_string().contains("--flatten"), "{error}");
        let error = Mover::new(scene("quick"), Motion::File).expect_err("it is from no file");
        assert!(error.to_string().contains("no animation"), "{error}");
    }
}

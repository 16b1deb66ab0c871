//! Cameras: those a file describes, aimed at something, and one made up where a file has none.
//!
//! A made-up camera looks at an object from outside, three-quarters from the front. A scene whose middle is
//! surrounded by front sides is a room or a street, and gets a camera inside it.

use glam::Vec3;

use super::{Camera, Placed, bounds::Bounds, limits::FOV_RANGE_DEG, probe};

/// Angle of view of a camera that looks at an object.
const OBJECT_FOV_DEG: f32 = 38.0;
/// Angle of view of a camera in a room.
const ROOM_FOV_DEG: f32 = 62.0;
/// Where an object is looked at from: front, a little right, a little above.
const OBJECT_FROM: Vec3 = Vec3::new(0.62, 0.38, 1.0);
/// Width over height that a made-up camera reckons with.
const ASPECT: f32 = 4.0 / 3.0;
/// Rays that ask whether the middle of the scene is inside a room.
const ROOM_RAYS: usize = 48;
/// Share of those rays, without upward ones, that meet a front side: open doors are part of rooms.
const ROOM_SHARE: f32 = 0.7;

/// A camera as files describe it: often with a direction but no point that it looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPose {
    /// Eye point.
    pub position: Vec3,
    /// Direction of view, any length but zero.
    pub forward: Vec3,
    /// Roughly up.
    pub up: Vec3,
    /// Full vertical angle of view.
    pub vertical_fov_deg: f32,
    /// See [`Camera::framed_aspect`].
    pub framed_aspect: Option<f32>,
    /// Distance to the point looked at, where the file has one.
    pub distance: Option<f32>,
}

impl From<&Camera> for CameraPose {
    fn from(camera: &Camera) -> Self {
        let Camera { position, target, up, vertical_fov_deg, framed_aspect } = *camera;
        let (forward, distance) = (target - position, Some(position.distance(target)));
        Self { position, forward, up, vertical_fov_deg, framed_aspect, distance }
    }
}

impl CameraPose {
    /// The camera, by default aimed at its nearest point to the scene's middle. `None` without a direction.
    pub fn aim(&self, bounds: &Bounds) -> Option<Camera> {
        let forward = self.forward.try_normalize()?;
        if !self.position.is_finite() || !self.vertical_fov_deg.is_finite() {
            return None;
        }
        let shortest = (bounds.diagonal() * 0.1).max(f32::MIN_POSITIVE);
        let distance =
            self.distance.unwrap_or_else(|| (bounds.center() - self.position).dot(forward)).max(shortest);
        let mut up = self.up.normalize_or(Vec3::Y);
        if up.cross(forward).length() < 1e-3 {
            up = forward.any_orthonormal_vector();
        }
        Some(Camera {
            position: self.position,
            target: self.position + forward * distance,
            up,
            vertical_fov_deg: self.vertical_fov_deg.clamp(*FOV_RANGE_DEG.start(), *FOV_RANGE_DEG.end()),
            framed_aspect: self.framed_aspect.filter(|aspect| (0.01..=100.0).contains(aspect)),
        })
    }
}

/// A camera for a scene that brought none, and the end of the sentence that says so.
pub(crate) fn made_up(placed: &Placed, bounds: &Bounds) -> (Camera, &'static str) {
    match room_camera(placed, bounds) {
        Some(camera) => (camera, "one was put inside it, looking along its longer side."),
        None => (object_camera(bounds), "one was put outside, looking at its middle."),
    }
}

/// Looks at the middle of the box from outside; the whole box is in the picture.
fn object_camera(bounds: &Bounds) -> Camera {
    let target = bounds.center();
    let from = OBJECT_FROM.normalize();
    let right = Vec3::Y.cross(from).normalize();
    let up = from.cross(right);
    let slope = (OBJECT_FOV_DEG.to_radians() * 0.5).tan();
    // Far enough that each corner projects inside the picture.
    let distance = bounds
        .corners()
        .iter()
        .map(|corner| {
            let offset = *corner - target;
            let across = (offset.dot(right).abs() / ASPECT).max(offset.dot(up).abs());
            offset.dot(from) + across / slope
        })
        .fold(0.0, f32::max);
    // A point-like scene still needs a distance, and so does the picture a margin.
    let distance = if distance > 0.0 { distance * 1.04 } else { 1.0 };
    Camera {
        position: target + from * distance,
        target,
        up: Vec3::Y,
        vertical_fov_deg: OBJECT_FOV_DEG,
        framed_aspect: Some(ASPECT),
    }
}

/// A camera at one end of a room, or nothing when the scene is no room.
fn room_camera(placed: &Placed, bounds: &Bounds) -> Option<Camera> {
    let directions = probe::sphere_directions(ROOM_RAYS);
    let met = probe::nearest(placed, bounds.center(), &directions);
    let sideways = directions.iter().zip(&met).filter(|(direction, _)| direction.y < 0.35);
    let count = sideways.clone().count();
    let inside = sideways.filter(|(_, met)| met.front).count();
    if (inside as f32) < ROOM_SHARE * count as f32 {
        return None;
    }
    let size = bounds.size();
    let (along, length) = if size.x >= size.z { (Vec3::X, size.x) } else { (Vec3::Z, size.z) };
    let floor = bounds.center() - Vec3::Y * size.y * 0.5;
    let mut best: Option<(f32, Camera)> = None;
    for end in [0.44, 0.38, 0.32, 0.26, -0.26, -0.32, -0.38, -0.44] {
        for height in [0.16, 0.24, 0.34] {
            let position = floor + along * (length * end) + Vec3::Y * (size.y * height);
            let target = floor - along * (length * end * 0.5) + Vec3::Y * (size.y * (height + 0.08));
            let camera = Camera::upright(position, target, ROOM_FOV_DEG);
            let score = openness(placed, &camera, bounds.diagonal());
            if best.as_ref().is_none_or(|(highest, _)| score > *highest) {
                best = Some((score, camera));
            }
        }
    }
    best.filter(|(score, _)| *score > 0.0).map(|(_, camera)| camera)
}

/// Mean length of a camera's view; 0 when it stands in a wall or right before one.
fn openness(placed: &Placed, camera: &Camera, diagonal: f32) -> f32 {
    let forward = (camera.target - camera.position).normalize_or(Vec3::NEG_Z);
    let directions: Vec<Vec3> =
        probe::sphere_directions(64).into_iter().filter(|direction| direction.dot(forward) > 0.6).collect();
    let met = probe::nearest(placed, camera.position, &directions);
    let too_near =
        |met: &probe::Meeting| met.distance < 0.02 * diagonal || (met.distance.is_finite() && !met.front);
    let blocked = met.iter().filter(|met| too_near(met)).count();
    if blocked * 4 > met.len() {
        return 0.0;
    }
    met.iter().map(|met| met.distance.min(diagonal)).sum::<f32>() / met.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use treewright_accel::Triangles;

    use super::*;
    use crate::shapes::Shapes;

    fn box_scene(inward: bool) -> (Triangles, Bounds) {
        let mut shapes = Shapes::new();
        shapes.cuboid(Vec3::new(-4.0, 0.0, -1.0), Vec3::new(4.0, 2.0, 1.0));
        let mut part = shapes.part;
        if inward {
            part.indices.iter_mut().for_each(|triangle| triangle.swap(1, 2));
        }
        let positions = part.positions.iter().map(|position| (*position).into()).collect();
        let triangles = Triangles::new(positions, part.indices).unwrap();
        let bounds = Bounds::of(&triangles);
        (triangles, bounds)
    }

    #[test]
    fn a_solid_is_seen_from_outside_and_whole() {
        let (triangles, bounds) = box_scene(false);
        let (camera, _) = made_up(&Placed::flat(&triangles), &bounds);
        assert!(!bounds.contains(camera.position));
        let forward = (camera.target - camera.position).normalize();
        let right = forward.cross(camera.up).normalize();
        let up = right.cross(forward);
        let slope = (camera.vertical_fov_deg.to_radians() * 0.5).tan();
        for corner in bounds.corners() {
            let offset = corner - camera.position;
            let depth = offset.dot(forward);
            assert!(
                offset.dot(up).abs() <= depth * slope && offset.dot(right).abs() <= depth * slope * ASPECT
            );
        }
    }

    #[test]
    fn a_room_is_seen_from_inside_along_its_length() {
        let (triangles, bounds) = box_scene(true);
        let (camera, _) = made_up(&Placed::flat(&triangles), &bounds);
        assert!(bounds.contains(camera.position));
        assert!((camera.target - camera.position).normalize().x.abs() > 0.9);
    }

    #[test]
    fn views_without_sense_are_refused() {
        let (_, bounds) = box_scene(false);
        let view = CameraPose {
            position: Vec3::ZERO,
            forward: Vec3::X,
            up: Vec3::X,
            vertical_fov_deg: 900.0,
            framed_aspect: None,
            distance: None,
        };
        let camera = view.aim(&bounds).unwrap();
        assert_eq!(camera.vertical_fov_deg, 170.0);
        assert!(camera.up.dot(Vec3::X).abs() < 1e-5);
        assert!(CameraPose { forward: Vec3::ZERO, ..view }.aim(&bounds).is_none());
        assert!(CameraPose { position: Vec3::NAN, ..view }.aim(&bounds).is_none());
    }
}

//! A few rays through bare triangles, for questions that are asked once a scene, without a tree.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use treewright_accel::Triangles;

use super::Placed;

/// Triangles looked at by one task.
const CHUNK: usize = 16 * 1024;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Meeting {
    /// Distance along the direction; infinite when nothing is met.
    pub(crate) distance: f32,
    /// Whether the side met is the front (counter-clockwise) side.
    pub(crate) front: bool,
}

impl Meeting {
    fn closer(self, other: Self) -> Self {
        if other.distance < self.distance { other } else { self }
    }
}

const MISS: Meeting = Meeting { distance: f32::INFINITY, front: false };

/// The first meeting of each ray from one origin, by looking at every triangle.
pub(crate) fn nearest(placed: &Placed, origin: Vec3, directions: &[Vec3]) -> Vec<Meeting> {
    let rays: Vec<(Vec3A, Vec3A)> =
        directions.iter().map(|direction| (origin.into(), (*direction).into())).collect();
    let nothing = || vec![MISS; rays.len()];
    let closer = |a: Vec<Meeting>, b: Vec<Meeting>| a.into_iter().zip(b).map(|(a, b)| a.closer(b)).collect();
    let Some(instances) = placed.instances() else {
        return placed
            .triangles()
            .indices()
            .par_chunks(CHUNK)
            .map(|chunk| nearest_in(placed.triangles(), chunk, &rays))
            .reduce(nothing, closer);
    };
    let boxes = placed.object_boxes();
    instances
        .placed()
        .par_iter()
        .map(|instance| {
            let object = instance.object as usize;
            let range = &instances.objects()[object];
            let by = &instance.to_object;
            let moved = |(at, way): &(Vec3A, Vec3A)| (by.transform_point3a(*at), by.transform_vector3a(*way));
            let moved: Vec<_> = rays.iter().map(moved).collect();
            let mut best = nothing();
            // Few instances lie in the way of a ray, and only their triangles are looked at.
            let met: Vec<usize> =
                (0..moved.len()).filter(|&ray| boxes[object].is_met(moved[ray].0, moved[ray].1)).collect();
            if met.is_empty() {
                return best;
            }
            let chosen: Vec<_> = met.iter().map(|&ray| moved[ray]).collect();
            let indices = &placed.triangles().indices()[range.start as usize..range.end as usize];
            let mirrored = instance.to_world.matrix3.determinant() < 0.0;
            for (ray, meeting) in met.into_iter().zip(nearest_in(placed.triangles(), indices, &chosen)) {
                best[ray] = Meeting { front: meeting.front != mirrored, ..meeting };
            }
            best
        })
        .reduce(nothing, closer)
}

fn nearest_in(triangles: &Triangles, indices: &[[u32; 3]], rays: &[(Vec3A, Vec3A)]) -> Vec<Meeting> {
    let mut best = vec![MISS; rays.len()];
    for corners in indices {
        let corners = corners.map(|vertex| triangles.positions()[vertex as usize]);
        for ((origin, direction), best) in rays.iter().zip(&mut best) {
            if let Some(meeting) = meet(corners, *origin, *direction) {
                *best = best.closer(meeting);
            }
        }
    }
    best
}

/// Intersection of a ray and a triangle after Möller and Trumbore (1997).
fn meet([a, b, c]: [Vec3A; 3], origin: Vec3A, direction: Vec3A) -> Option<Meeting> {
    let (ab, ac) = (b - a, c - a);
    let across = direction.cross(ac);
    let determinant = ab.dot(across);
    if determinant == 0.0 {
        return None;
    }
    let inverse = 1.0 / determinant;
    let from = origin - a;
    let u = from.dot(across) * inverse;
    let around = from.cross(ab);
    let v = direction.dot(around) * inverse;
    let distance = ac.dot(around) * inverse;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0)
        .then_some(Meeting { distance, front: determinant > 0.0 })
}

/// Directions spread evenly over the sphere (a Fibonacci spiral).
pub(crate) fn sphere_directions(count: usize) -> Vec<Vec3> {
    let golden_angle = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    (0..count)
        .map(|index| {
            let y = 1.0 - 2.0 * (index as f32 + 0.5) / count as f32;
            let radius = (1.0 - y * y).sqrt();
            let (sin, cos) = (golden_angle * index as f32).sin_cos();
            Vec3::new(cos * radius, y, sin * radius)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearer_of_two_triangles_and_its_side() {
        let square = |z: f32| [Vec3A::new(-5.0, -5.0, z), Vec3A::new(5.0, -5.0, z), Vec3A::new(0.0, 9.0, z)];
        let positions = [square(-4.0), square(-2.0)].concat();
        let triangles = Triangles::new(positions, vec![[0, 1, 2], [3, 5, 4]]).unwrap();
        let met = nearest(&Placed::flat(&triangles), Vec3::ZERO, &[Vec3::NEG_Z, Vec3::Z]);
        assert_eq!(met[0], Meeting { distance: 2.0, front: false });
        assert_eq!(met[1], MISS);
        let met = nearest(&Placed::flat(&triangles), Vec3::new(0.0, 0.0, -3.0), &[Vec3::NEG_Z]);
        assert_eq!(met[0], Meeting { distance: 1.0, front: true });
    }

    #[test]
    fn directions_have_unit_length_and_balance() {
        let directions = sphere_directions(64);
        assert!(directions.iter().all(|direction| (direction.length() - 1.0).abs() < 1e-5));
        assert!(directions.iter().sum::<Vec3>().length() < 1.0);
    }
}

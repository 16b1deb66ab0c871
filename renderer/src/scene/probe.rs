//! A few rays through bare triangles, for questions that are asked once a scene: is this point inside a
//! room, how far is the next wall. Too few for a tree to pay off.

use glam::{Vec3, Vec3A};
use rayon::prelude::*;
use treewright_accel::Triangles;

/// Triangles looked at by one task.
const CHUNK: usize = 16 * 1024;

/// What a ray meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Meeting {
    /// Distance along the direction; infinite when nothing is met.
    pub(crate) distance: f32,
    /// Whether the side met is the front (counter-clockwise) side.
    pub(crate) front: bool,
}

const MISS: Meeting = Meeting { distance: f32::INFINITY, front: false };

/// The first meeting of each ray from one origin, by looking at every triangle.
pub(crate) fn nearest(triangles: &Triangles, origin: Vec3, directions: &[Vec3]) -> Vec<Meeting> {
    let origin = Vec3A::from(origin);
    let directions: Vec<Vec3A> = directions.iter().map(|direction| Vec3A::from(*direction)).collect();
    let closer = |a: Meeting, b: Meeting| if b.distance < a.distance { b } else { a };
    triangles
        .indices()
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut best = vec![MISS; directions.len()];
            for corners in chunk {
                let corners = corners.map(|vertex| triangles.positions()[vertex as usize]);
                for (direction, best) in directions.iter().zip(&mut best) {
                    if let Some(meeting) = meet(corners, origin, *direction) {
                        *best = closer(*best, meeting);
                    }
                }
            }
            best
        })
        .reduce(
            || vec![MISS; directions.len()],
            |a, b| a.into_iter().zip(b).map(|(a, b)| closer(a, b)).collect(),
        )
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
        let met = nearest(&triangles, Vec3::ZERO, &[Vec3::NEG_Z, Vec3::Z]);
        assert_eq!(met[0], Meeting { distance: 2.0, front: false });
        assert_eq!(met[1], MISS);
        let met = nearest(&triangles, Vec3::new(0.0, 0.0, -3.0), &[Vec3::NEG_Z]);
        assert_eq!(met[0], Meeting { distance: 1.0, front: true });
    }

    #[test]
    fn directions_have_unit_length_and_balance() {
        let directions = sphere_directions(64);
        assert!(directions.iter().all(|direction| (direction.length() - 1.0).abs() < 1e-5));
        assert!(directions.iter().sum::<Vec3>().length() < 1.0);
    }
}

//! Polygons cut into triangles: convex ones as fans, others by ear clipping (the crate `earcut`).

use earcut::Earcut;
use glam::{DVec2, DVec3, Vec3};

/// A corner counts as turned inward where the sine of its angle is below this: rounding bends straight edges.
const BENT: f64 = -1e-6;

/// Cuts a polygon into triangles of its orientation by its corners, along its normal after Newell.
pub(super) fn triangles(corners: &[u32], positions: &[Vec3], mut push: impl FnMut([u32; 3])) {
    if corners.len() > 3
        && let Some(flat) = projected(corners, positions)
        && turns(&flat).is_none_or(|turns| turns > 1.5)
    {
        let mut found: Vec<u32> = Vec::new();
        Earcut::new().earcut(flat.iter().map(DVec2::to_array), &[], &mut found);
        for triangle in found.as_chunks().0 {
            let [a, b, c] = triangle.map(|place| flat[place as usize]);
            // The projection turns counter-clockwise.
            let [first, second, third] = triangle.map(|place| corners[place as usize]);
            let is_turned = (b - a).perp_dot(c - a) < 0.0;
            push(if is_turned { [first, third, second] } else { [first, second, third] });
        }
        if !found.is_empty() {
            return;
        }
    }
    if let [first, rest @ ..] = corners {
        rest.windows(2).for_each(|edge| push([*first, edge[0], edge[1]]));
    }
}

/// The corners on the plane of two axes, counter-clockwise. `None` without area or a finite corner.
fn projected(corners: &[u32], positions: &[Vec3]) -> Option<Vec<DVec2>> {
    let at = |corner: &u32| positions.get(*corner as usize).map(|position| position.as_dvec3());
    let solid: Vec<DVec3> = corners.iter().map(at).collect::<Option<_>>()?;
    let first = *solid.first()?;
    let following = solid.iter().cycle().skip(1);
    // Relative to a corner, so that a place far from the origin costs no digits.
    let normal: DVec3 = solid.iter().zip(following).map(|(a, b)| (*a - first).cross(*b - first)).sum();
    let across = normal.abs();
    let largest = across.max_element();
    if !(largest > 0.0 && largest.is_finite()) {
        return None;
    }
    let flat = |corner: &DVec3| {
        let offset = *corner - first;
        if across.z == largest {
            DVec2::new(offset.x * normal.z.signum(), offset.y)
        } else if across.y == largest {
            DVec2::new(offset.z * normal.y.signum(), offset.x)
        } else {
            DVec2::new(offset.y * normal.x.signum(), offset.z)
        }
    };
    Some(solid.iter().map(flat).collect())
}

/// Full turns of a counter-clockwise polygon's edges, one if convex; `None` if a corner turns inward.
fn turns(flat: &[DVec2]) -> Option<f64> {
    let following = flat.iter().cycle().skip(1);
    let edges: Vec<DVec2> =
        flat.iter().zip(following).map(|(a, b)| *b - *a).filter(|edge| edge.length() > 0.0).collect();
    let pairs = edges.iter().zip(edges.iter().cycle().skip(1));
    let angles = pairs.map(|(before, after)| {
        let sine = before.perp_dot(*after) / (before.length() * after.length());
        (sine >= BENT).then(|| before.angle_to(*after).abs())
    });
    angles.sum::<Option<f64>>().map(|sum| sum / std::f64::consts::TAU)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn cut(positions: &[Vec3]) -> Vec<[u32; 3]> {
        let corners: Vec<u32> = (0..positions.len() as u32).collect();
        let mut found = Vec::new();
        triangles(&corners, positions, |triangle| found.push(triangle));
        found
    }

    /// Sum of the areas of all triangles, and of their vectors.
    fn areas(positions: &[Vec3], triangles: &[[u32; 3]]) -> (f32, Vec3) {
        let vectors = triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
            (b - a).cross(c - a) * 0.5
        });
        vectors.fold((0.0, Vec3::ZERO), |(area, sum), vector| (area + vector.length(), sum + vector))
    }

    #[test]
    fn a_concave_polygon_covers_its_outline_and_a_convex_one_stays_a_fan() {
        let arrow = [[0, 4], [0, 0], [4, 0], [4, 4], [2, 1]].map(|[x, y]| Vec3::new(x as f32, y as f32, 0.0));
        let (area, sum) = areas(&arrow, &cut(&arrow));
        assert!((area - 10.0).abs() < 1e-5 && (sum - Vec3::Z * 10.0).length() < 1e-5, "{area} {sum}");
        let square = [[0, 0], [2, 0], [2, 2], [0, 2]].map(|[x, y]| Vec3::new(0.0, x as f32, y as f32));
        assert_eq!(cut(&square), [[0, 1, 2], [0, 2, 3]]);
        // A corner twice and one on an edge change nothing.
        let doubled = [[0, 0], [1, 0], [2, 0], [2, 0], [2, 2], [0, 2]];
        let doubled = doubled.map(|[x, y]| Vec3::new(x as f32, y as f32, 5.0));
        assert_eq!(cut(&doubled), [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]);
    }

    #[test]
    fn polygons_without_sense_are_cut_somehow() {
        assert_eq!(cut(&[Vec3::ZERO; 5]).len(), 3);
        assert_eq!(cut(&[Vec3::NAN; 4]).len(), 2);
        assert!(cut(&[Vec3::ZERO, Vec3::X]).is_empty() && cut(&[]).is_empty());
        let mut found = Vec::new();
        triangles(&[0, 1, 2, 77], &[Vec3::ZERO, Vec3::X, Vec3::Y], |triangle| found.push(triangle));
        assert_eq!(found.len(), 2, "numbers out of range are reported later");
    }

    proptest! {
        /// Polygons whose corners lie round a centre at any distance, in any plane.
        #[test]
        fn stars_are_covered_once(
            radii in prop::collection::vec(0.2_f32..3.0, 4..24),
            turn in prop::array::uniform3(-3.0_f32..3.0),
            shift in prop::array::uniform3(-50.0_f32..50.0),
        ) {
            let rotation = glam::Quat::from_euler(glam::EulerRot::XYZ, turn[0], turn[1], turn[2]);
            let count = radii.len() as f32;
            let positions: Vec<Vec3> = radii.iter().enumerate().map(|(place, radius)| {
                let (sin, cos) = (place as f32 / count * std::f32::consts::TAU).sin_cos();
                rotation * Vec3::new(cos * radius, sin * radius, 0.0) + Vec3::from_array(shift)
            }).collect();
            let (area, sum) = areas(&positions, &cut(&positions));
            let sine = (std::f32::consts::TAU / count).sin();
            let outline: f32 = (0..radii.len())
                .map(|place| 0.5 * radii[place] * radii[(place + 1) % radii.len()] * sine)
                .sum();
            prop_assert!((area / outline - 1.0).abs() < 1e-3, "{} for {}", area, outline);
            prop_assert!((sum - rotation * Vec3::Z * outline).length() < 1e-3 * outline);
        }
    }
}

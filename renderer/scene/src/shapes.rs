//! The shapes that built-in scenes are made of: boxes, spheres, lathes and sweeps, with unit normals.
//!
//! Flat shapes get vertices of their own for each face; smooth ones share them.

use std::f32::consts::TAU;

use glam::{BVec3, Vec2, Vec3};

use super::part::Part;

/// A part under construction; every vertex has a normal.
#[derive(Clone, Debug, Default)]
pub struct Shapes {
    /// The shapes so far.
    pub part: Part,
}

impl Shapes {
    /// Nothing yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn vertex(&mut self, position: Vec3, normal: Vec3) -> u32 {
        self.part.positions.push(position);
        self.part.normals.push(normal);
        (self.part.positions.len() - 1) as u32
    }

    /// A flat triangle, counter-clockwise from the front.
    pub fn triangle(&mut self, a: Vec3, b: Vec3, c: Vec3) {
        let normal = (b - a).cross(c - a).normalize_or(Vec3::Y);
        let corners = [a, b, c].map(|position| self.vertex(position, normal));
        self.part.indices.push(corners);
    }

    /// A flat quadrilateral of two triangles, counter-clockwise from the front.
    pub fn quad(&mut self, a: Vec3, b: Vec3, c: Vec3, d: Vec3) {
        let normal = (c - a).cross(d - b).normalize_or(Vec3::Y);
        let [a, b, c, d] = [a, b, c, d].map(|position| self.vertex(position, normal));
        self.part.indices.extend([[a, b, c], [a, c, d]]);
    }

    /// A flat rectangle from `low` to `high` in coordinates of its own, which `at` places.
    pub fn rectangle(&mut self, low: Vec2, high: Vec2, at: impl Fn(f32, f32) -> Vec3) {
        self.quad(at(low.x, low.y), at(high.x, low.y), at(high.x, high.y), at(low.x, high.y));
    }

    /// A level square that faces up, around the vertical axis.
    pub fn level(&mut self, half: Vec2, height: f32) {
        self.rectangle(-half, half, |x, z| Vec3::new(x, height, -z));
    }

    /// A closed box of 12 triangles.
    pub fn cuboid(&mut self, min: Vec3, max: Vec3) {
        self.open_cuboid(min, max, true);
    }

    /// A box, with or without its lower side (10 triangles without, for what stands on a floor).
    pub fn open_cuboid(&mut self, min: Vec3, max: Vec3, with_bottom: bool) {
        let p = |x: bool, y: bool, z: bool| Vec3::select(BVec3::new(x, y, z), max, min);
        let (o, i) = (false, true);
        self.quad(p(o, o, i), p(i, o, i), p(i, i, i), p(o, i, i));
        self.quad(p(i, o, o), p(o, o, o), p(o, i, o), p(i, i, o));
        self.quad(p(i, o, i), p(i, o, o), p(i, i, o), p(i, i, i));
        self.quad(p(o, o, o), p(o, o, i), p(o, i, i), p(o, i, o));
        self.quad(p(o, i, i), p(i, i, i), p(i, i, o), p(o, i, o));
        if with_bottom {
            self.quad(p(o, o, o), p(i, o, o), p(i, o, i), p(o, o, i));
        }
    }

    /// A flat-topped slab whose upper edges are bevelled, without a lower side: 10 triangles.
    pub fn bevelled_slab(&mut self, min: Vec3, max: Vec3, bevel: f32) {
        let low = |x: f32, z: f32| Vec3::new(x, max.y - bevel, z);
        let high = |x: f32, z: f32| Vec3::new(x, max.y, z);
        let outer = [(min.x, max.z), (max.x, max.z), (max.x, min.z), (min.x, min.z)];
        let b = bevel;
        let inner =
            [(min.x + b, max.z - b), (max.x - b, max.z - b), (max.x - b, min.z + b), (min.x + b, min.z + b)];
        for side in 0..4 {
            let next = (side + 1) % 4;
            self.quad(
                low(outer[side].0, outer[side].1),
                low(outer[next].0, outer[next].1),
                high(inner[next].0, inner[next].1),
                high(inner[side].0, inner[side].1),
            );
        }
        let [a, b, c, d] = inner.map(|(x, z)| high(x, z));
        self.quad(a, b, c, d);
    }

    /// A smooth grid of cells over (u, v) in 0..1; its front is where d/du × d/dv points.
    pub fn surface(&mut self, columns: usize, rows: usize, wrap: bool, point: impl Fn(f32, f32) -> Vec3) {
        let (columns, rows) = (columns.max(if wrap { 3 } else { 1 }), rows.max(1));
        let across = if wrap { columns } else { columns + 1 };
        let mut sheet = Part::default();
        for row in 0..=rows {
            for column in 0..across {
                sheet.positions.push(point(column as f32 / columns as f32, row as f32 / rows as f32));
            }
        }
        let number = |column: usize, row: usize| (row * across + column % across) as u32;
        for row in 0..rows {
            for column in 0..columns {
                let [a, b] = [number(column, row), number(column + 1, row)];
                let [d, c] = [number(column, row + 1), number(column + 1, row + 1)];
                for triangle in [[a, b, c], [a, c, d]] {
                    if !collapsed(triangle.map(|vertex| sheet.positions[vertex as usize])) {
                        sheet.indices.push(triangle);
                    }
                }
            }
        }
        sheet.normals = sheet.smooth_normals();
        self.part.append(&sheet);
    }

    /// Turns a profile of (radius, height) points around the vertical through `base`; doubled ones are sharp.
    pub fn lathe(&mut self, base: Vec3, profile: &[Vec2], segments: usize) {
        // Runs between repeated points are smooth; a repeated point starts a new run with its own normals.
        for run in profile.chunk_by(|a, b| a != b).filter(|run| run.len() > 1) {
            self.surface(segments, run.len() - 1, true, |u, v| {
                let point = run[(v * (run.len() - 1) as f32).round() as usize];
                base + on_circle(u * TAU, point.x, point.y)
            });
        }
    }

    /// As the function above, with an edge at every point.
    pub fn turned(&mut self, base: Vec3, profile: &[(f32, f32)], segments: usize) {
        let sharp: Vec<Vec2> = profile.iter().flat_map(|point| [Vec2::from(*point); 2]).collect();
        self.lathe(base, &sharp, segments);
    }

    /// A sphere of `2 * segments * (rings)` triangles, near enough.
    pub fn sphere(&mut self, center: Vec3, radius: f32, segments: usize, rings: usize) {
        self.surface(segments, rings, true, |u, v| {
            center + on_sphere(u * TAU, std::f32::consts::PI * (v - 0.5)) * radius
        });
    }

    /// A round bar along a line of points, open at its ends.
    pub fn tube(&mut self, path: &[Vec3], radius: f32, segments: usize) {
        let directions: Vec<Vec3> = (0..path.len())
            .map(|index| {
                let (before, after) = (path[index.saturating_sub(1)], path[(index + 1).min(path.len() - 1)]);
                (after - before).normalize_or(Vec3::Y)
            })
            .collect();
        let Some(first) = directions.first() else { return };
        // The side direction is carried along the bar so that it does not twist.
        let mut side = first.any_orthonormal_vector();
        let frames: Vec<(Vec3, Vec3)> = directions
            .iter()
            .map(|direction| {
                side = (side - *direction * side.dot(*direction))
                    .normalize_or(direction.any_orthonormal_vector());
                (side, direction.cross(side))
            })
            .collect();
        self.surface(segments, path.len().saturating_sub(1), true, |u, v| {
            let index = (v * (path.len() - 1) as f32).round() as usize;
            let (sin, cos) = (u * TAU).sin_cos();
            path[index] + (frames[index].0 * cos + frames[index].1 * sin) * radius
        });
    }

    /// A cylinder between two points, open at its ends.
    pub fn rod(&mut self, from: Vec3, to: Vec3, radius: f32, segments: usize) {
        self.tube(&[from, to], radius, segments);
    }

    /// A flat disc that faces up.
    pub fn disc(&mut self, center: Vec3, radius: f32, segments: usize) {
        let segments = segments.max(3);
        let rim = |index: usize| center + on_circle(TAU * index as f32 / segments as f32, 1.0, 0.0) * radius;
        for index in 0..segments {
            self.triangle(center, rim(index), rim(index + 1));
        }
    }

    /// A bar with a counter-clockwise cross-section, swept along frames of (origin, right, up); flat sides.
    pub fn sweep(&mut self, section: &[Vec2], frames: &[(Vec3, Vec3, Vec3)]) {
        let place =
            |(origin, right, up): (Vec3, Vec3, Vec3), point: Vec2| origin + right * point.x + up * point.y;
        for pair in frames.windows(2) {
            for index in 0..section.len() {
                let (from, to) = (section[index], section[(index + 1) % section.len()]);
                self.quad(place(pair[0], from), place(pair[0], to), place(pair[1], to), place(pair[1], from));
            }
        }
    }
}

/// A point at a height on a circle around the vertical axis; at angle 0 in front, along z.
pub fn on_circle(angle: f32, radius: f32, height: f32) -> Vec3 {
    let (sin, cos) = angle.sin_cos();
    Vec3::new(sin * radius, height, cos * radius)
}

/// A point of the unit sphere at an angle around the vertical axis and one above the horizon.
pub fn on_sphere(angle: f32, lift: f32) -> Vec3 {
    let (up, out) = lift.sin_cos();
    on_circle(angle, out, up)
}

/// Whether two corners coincide, as at the pole of a sphere.
fn collapsed([a, b, c]: [Vec3; 3]) -> bool {
    let edges = [(b - a).length_squared(), (c - b).length_squared(), (a - c).length_squared()];
    let longest = edges.into_iter().fold(0.0, f32::max);
    edges.into_iter().any(|edge| edge <= longest * 1e-11)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every triangle's front side agrees with its normals, and normals have unit length.
    fn check(shapes: &Shapes, outward_from: Option<Vec3>) {
        let part = &shapes.part;
        assert!(part.normals.iter().all(|normal| (normal.length() - 1.0).abs() < 1e-4));
        for triangle in &part.indices {
            let [a, b, c] = triangle.map(|vertex| part.positions[vertex as usize]);
            let normal = (b - a).cross(c - a);
            if normal.length() < 1e-9 {
                continue;
            }
            for vertex in triangle {
                assert!(normal.dot(part.normals[*vertex as usize]) > 0.0);
            }
            if let Some(middle) = outward_from {
                assert!(normal.dot((a + b + c) / 3.0 - middle) > 0.0, "a triangle faces inward");
            }
        }
    }

    #[test]
    fn closed_shapes_face_outward() {
        let mut shapes = Shapes::new();
        shapes.cuboid(-Vec3::ONE, Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(shapes.part.indices.len(), 12);
        check(&shapes, Some(Vec3::new(0.0, 0.5, 1.0)));
        let mut shapes = Shapes::new();
        shapes.sphere(Vec3::ONE, 2.0, 16, 8);
        check(&shapes, Some(Vec3::ONE));
        let mut shapes = Shapes::new();
        shapes.lathe(Vec3::ZERO, &[Vec2::new(1.0, -1.0), Vec2::new(1.2, 0.0), Vec2::new(1.0, 1.0)], 12);
        check(&shapes, Some(Vec3::ZERO));
        let mut shapes = Shapes::new();
        shapes.rod(Vec3::new(0.0, -1.0, 0.0), Vec3::new(0.3, 1.0, 0.2), 0.2, 8);
        check(&shapes, Some(Vec3::new(0.15, 0.0, 0.1)));
        let mut shapes = Shapes::new();
        shapes.bevelled_slab(Vec3::ZERO, Vec3::ONE, 0.1);
        check(&shapes, Some(Vec3::splat(0.5)));
    }

    #[test]
    fn a_swept_bar_faces_outward() {
        let section =
            [Vec2::new(-1.0, -1.0), Vec2::new(1.0, -1.0), Vec2::new(1.0, 1.0), Vec2::new(-1.0, 1.0)];
        let frames = [Vec3::ZERO, Vec3::new(0.0, 0.0, 5.0)].map(|origin| (origin, Vec3::X, Vec3::Y));
        let mut shapes = Shapes::new();
        shapes.sweep(&section, &frames);
        check(&shapes, Some(Vec3::new(0.0, 0.0, 2.5)));
    }
}

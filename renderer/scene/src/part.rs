//! One mesh before it joins a scene: positions, normals and triangles with their own numbering.

use glam::{Mat3, Mat4, Vec2, Vec3};

use super::polygon;

/// Triangles with their own vertex numbering, before they join a scene.
#[derive(Clone, Debug, Default)]
pub struct Part {
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Shading normals parallel to `positions`, or empty for flat triangles.
    pub normals: Vec<Vec3>,
    /// Texture coordinates parallel to `positions`, or none. (0, 0) is a picture's upper left corner.
    pub uvs: Vec<Vec2>,
    /// Three vertex numbers a triangle.
    pub indices: Vec<[u32; 3]>,
}

/// The matrix that moves normals, but for their length: the cofactors, also of flattened meshes.
pub(super) fn normal_matrix(linear: &Mat3) -> Mat3 {
    Mat3::from_cols(
        linear.y_axis.cross(linear.z_axis),
        linear.z_axis.cross(linear.x_axis),
        linear.x_axis.cross(linear.y_axis),
    ) * linear.determinant().signum()
}

impl Part {
    /// Moves everything by an affine transform. A mirroring one turns the winding too.
    pub fn transform(&mut self, transform: &Mat4) {
        let linear = Mat3::from_mat4(*transform);
        for position in &mut self.positions {
            *position = transform.transform_point3(*position);
        }
        let upright = normal_matrix(&linear);
        for normal in &mut self.normals {
            *normal = (upright * *normal).normalize_or_zero();
        }
        if linear.determinant() < 0.0 {
            for triangle in &mut self.indices {
                triangle.swap(1, 2);
            }
        }
    }

    /// Adds another part's triangles. Both have normals or neither has, and so with texture coordinates.
    pub fn append(&mut self, other: &Part) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.uvs.extend_from_slice(&other.uvs);
        self.indices.extend(other.indices.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }

    /// Adds a polygon, cut into triangles. The positions of its corners have to be there already.
    pub fn push_polygon(&mut self, corners: &[u32]) {
        polygon::triangles(corners, &self.positions, |triangle| self.indices.push(triangle));
    }

    /// Adds a fan of triangles round its first corner.
    pub fn push_fan(&mut self, corners: &[u32]) {
        if let [first, rest @ ..] = corners {
            self.indices.extend(rest.windows(2).map(|edge| [*first, edge[0], edge[1]]));
        }
    }

    /// Area-weighted unit normals of the vertices; up where there is no area. Wrong triangles do not count.
    pub fn smooth_normals(&self) -> Vec<Vec3> {
        let mut normals = vec![Vec3::ZERO; self.positions.len()];
        for triangle in &self.indices {
            let corners = triangle.map(|vertex| self.positions.get(vertex as usize));
            let [Some(&a), Some(&b), Some(&c)] = corners else { continue };
            let weighted = (b - a).cross(c - a);
            for vertex in triangle {
                normals[*vertex as usize] += weighted;
            }
        }
        for normal in &mut normals {
            *normal = normal.normalize_or(Vec3::Y);
        }
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mirroring_keeps_front_sides_in_front() {
        let mut part = Part {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
            normals: vec![Vec3::Z; 3],
            indices: vec![[0, 1, 2]],
            ..Part::default()
        };
        part.transform(&Mat4::from_scale(Vec3::new(-2.0, 1.0, 1.0)));
        let [a, b, c] = part.indices[0].map(|vertex| part.positions[vertex as usize]);
        assert_eq!((b - a).cross(c - a).normalize(), Vec3::Z);
        assert_eq!(part.normals[0], Vec3::Z);
    }

    #[test]
    fn normals_stay_upright_under_uneven_scaling() {
        let tilted = Vec3::new(1.0, 1.0, 0.0).normalize();
        let mut part = Part { positions: vec![Vec3::ZERO], normals: vec![tilted], ..Part::default() };
        part.transform(&Mat4::from_scale(Vec3::new(2.0, 1.0, 1.0)));
        let expected = Vec3::new(0.5, 1.0, 0.0).normalize();
        assert!((part.normals[0] - expected).length() < 1e-6);
    }
}

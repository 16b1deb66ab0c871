//! The cylinder of the paper's section 4.3: long thin triangles, half as long as a scene's diagonal, turning
//! through its geometry; a hard case for boxes and for a builder that splits triangles.

use std::{f32::consts::TAU, path::PathBuf, sync::Arc};

use glam::{Mat3, Vec2, Vec3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use treewright_accel::Triangles;

use super::{Material, Mesh, Scene, SceneError, bounds::Bounds, part::Part, placed::Placed};

/// Radius of the cylinder in shares of its length.
const SLENDER: f32 = 0.07;
/// Lean of its axis, in radians.
const LEAN: f32 = 0.18;
/// Seed of a cylinder that joins a given scene: its needles are equal at every angle.
const SEED: u64 = 1;

/// The needles, two crossing triangles each, in two parts. `turn` is a share; `between` draws.
pub(crate) fn bundles(
    bounds: &Bounds,
    turn: f32,
    needles: usize,
    mut between: impl FnMut(f32, f32) -> f32,
) -> [Part; 2] {
    let (middle, length) = (bounds.center(), bounds.diagonal() * 0.5);
    let turn = Mat3::from_rotation_y(TAU * turn) * Mat3::from_rotation_z(LEAN);
    let mut bundles = [Part::default(), Part::default()];
    for needle in 0..needles {
        let radius = SLENDER * length * between(0.0, 1.0).sqrt();
        let angle = between(0.0, TAU);
        let twist = between(-0.25, 0.25);
        let width = length * between(0.0004, 0.0011);
        let at = |angle: f32, x: f32| Vec3::new(x, radius * angle.cos(), radius * angle.sin());
        let (from, to) = (at(angle, -0.5 * length), at(angle + twist, 0.5 * length));
        let part = &mut bundles[needle % 2];
        for side in [Vec3::Y, Vec3::Z] {
            let corners = [from - side * width, from + side * width, to].map(|corner| middle + turn * corner);
            let first = part.positions.len() as u32;
            part.positions.extend(corners);
            part.normals
                .extend([(corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or(Vec3::Y); 3]);
            part.indices.push([first, first + 1, first + 2]);
        }
    }
    bundles
}

impl Scene {
    /// The scene without instances and with `needles` needles as a cylinder through its middle, turned by
    /// `turn` of a round. Cameras and light stay.
    ///
    /// # Errors
    /// [`SceneError::TooMany`] and [`SceneError::Geometry`] beyond the limits of scenes.
    pub fn with_needles(&self, turn: f32, needles: usize) -> Result<Self, SceneError> {
        let mut scene = self.flattened()?;
        let bounds = Placed::new(&scene.triangles, None).bounds();
        let mut dice = ChaCha8Rng::seed_from_u64(SEED);
        let parts = bundles(&bounds, turn, needles, |low, high| low + (high - low) * dice.random::<f32>());
        let before = &scene.triangles;
        let cards: Vec<_> = (0..before.len())
            .filter_map(|triangle| Some((triangle as u32, before.card(triangle)?)))
            .collect();
        let masks = before.masks().to_vec();
        let mut positions = before.positions().to_vec();
        let mut indices = before.indices().to_vec();
        let colours = [Vec3::new(0.72, 0.3, 0.13), Vec3::new(0.55, 0.6, 0.66)];
        for (number, (part, base_color)) in parts.iter().zip(colours).enumerate() {
            if part.indices.is_empty() {
                continue;
            }
            let (first_vertex, first_triangle) = (positions.len() as u32, indices.len() as u32);
            positions.extend(part.positions.iter().map(|position| glam::Vec3A::from(*position)));
            indices.extend(part.indices.iter().map(|corners| corners.map(|corner| corner + first_vertex)));
            // Flat scenes have no normals, and scenes without textures no coordinates for them.
            if !scene.normals.is_empty() {
                scene.normals.extend(&part.normals);
            }
            if !scene.uvs.is_empty() {
                scene.uvs.extend(part.positions.iter().map(|_| Vec2::ZERO));
            }
            scene.materials.push(Material { base_color, roughness: 0.4, ..Material::default() });
            scene.meshes.push(Mesh {
                name: format!("needles {}", number + 1),
                first_triangle,
                triangle_count: part.indices.len() as u32,
                material: (scene.materials.len() - 1) as u32,
            });
        }
        let refuse = |source| SceneError::Geometry {
            path: PathBuf::from(&self.name),
            mesh: "needles".to_owned(),
            source,
        };
        let mut triangles = Triangles::new(positions, indices).map_err(refuse)?;
        if !cards.is_empty() {
            triangles = triangles.masked(masks, cards).map_err(refuse)?;
        }
        scene.triangles = Arc::new(triangles);
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use crate::builtin::{Options, build};

    #[test]
    fn a_scene_gets_needles_of_half_its_diagonal_that_turn_and_keeps_the_rest() {
        let options = Options { detail: 0.02, ..Options::default() };
        for name in ["gallery", "forest"] {
            let scene = build(name, &options).expect("it is built in");
            let whole = scene.flattened().expect("it is small");
            let with = scene.with_needles(0.0, 50).expect("it is small");
            let turned = scene.with_needles(0.25, 50).expect("it is small");
            assert_eq!(with.triangles.len(), whole.triangles.len() + 100, "{name}");
            assert_eq!(with.triangles.positions().len(), turned.triangles.positions().len());
            for kept in [0, whole.triangles.len() - 1] {
                assert_eq!(with.triangles.corners(kept), whole.triangles.corners(kept));
            }
            let covered: u32 = with.meshes.iter().map(|mesh| mesh.triangle_count).sum();
            assert_eq!(covered as usize, with.triangles.len());
            assert!(with.meshes.iter().all(|mesh| (mesh.material as usize) < with.materials.len()));
            let parallel = |length: usize| length == 0 || length == with.triangles.positions().len();
            assert!(parallel(with.normals.len()) && parallel(with.uvs.len()), "{name}");
            let last = with.triangles.len() - 1;
            let [a, _, c] = with.triangles.corners(last);
            let bounds = crate::Placed::new(&whole.triangles, None).bounds();
            let share = (c - a).length() / bounds.diagonal();
            assert!((0.48..0.56).contains(&share), "{name}: {share}");
            assert_ne!(with.triangles.corners(last), turned.triangles.corners(last));
        }
    }
}

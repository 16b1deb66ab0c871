//! Scenes: geometry in world space or as instances, materials, lights, cameras.
//!
//! Whatever a scene came from (glTF, OBJ, PLY, a built-in generator), it ends up as one [`Scene`]; the
//! integrator and the indicators know nothing else.

pub mod assemble;
mod bounds;
pub mod builtin;
pub mod camera_path;
mod error;
mod flatten;
pub mod framing;
mod gltf_extras;
mod gltf_file;
mod gltf_geometry;
mod gltf_material;
pub mod indicators;
pub mod limits;
mod load;
#[cfg(test)]
mod load_tests;
mod obj_file;
mod obj_text;
mod objects;
pub mod part;
pub mod placed;
mod ply_file;
mod probe;
pub mod shapes;
mod sky;

use std::sync::Arc;

use glam::Vec3;
use treewright_accel::{Instances, Triangles};

pub use bounds::Bounds;
pub use error::SceneError;
pub use load::load;
pub use placed::Placed;

/// A scene ready to be rendered.
#[derive(Clone, Debug)]
pub struct Scene {
    /// For people and for studies: the file's stem or the built-in's name.
    pub name: String,
    /// All triangles: in world space, or each in its object's space where there are `instances`.
    pub triangles: Arc<Triangles>,
    /// Where objects stand. Most scenes have none and are met as they are; with them, rays meet only what an
    /// instance places. Objects are made of whole meshes.
    pub instances: Option<Arc<Instances>>,
    /// Shading normal of each vertex (unit length, parallel to `triangles.positions()`); empty when every
    /// triangle is flat. The front (counter-clockwise) side of a triangle is where its normals point.
    pub normals: Vec<Vec3>,
    /// Meshes in order of their triangles; together they cover all of them. See [`Scene::placed_meshes`].
    pub meshes: Vec<Mesh>,
    /// At least one.
    pub materials: Vec<Material>,
    /// What shines besides emissive triangles.
    pub sky: Sky,
    /// Cameras of the file, or one framing camera. At least one.
    pub cameras: Vec<Camera>,
    /// Keys of a hand-laid camera path; empty when nobody laid one (see [`crate::camera_path`]).
    pub path_keys: Vec<Camera>,
    /// What the loader had to leave out or make up, one sentence each.
    pub notes: Vec<String>,
}

impl Scene {
    /// Whether there are lights that shadow rays are sent to: a sun, or surfaces that shine.
    pub fn has_sampled_lights(&self) -> bool {
        let shines = |light: Vec3| light.max_element() > 0.0;
        let sun = self.sky.sun.is_some_and(|sun| shines(sun.irradiance));
        sun || self.meshes.iter().any(|mesh| shines(self.materials[mesh.material as usize].emission))
    }
}

/// A run of triangles with one material.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Name in the file, for people.
    pub name: String,
    /// Number of its first triangle.
    pub first_triangle: u32,
    /// How many triangles it has.
    pub triangle_count: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// How a surface scatters and emits. Linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Albedo, or reflectance of a metal. 0 to 1.
    pub base_color: Vec3,
    /// 0 dielectric to 1 metal.
    pub metallic: f32,
    /// 0 mirror to 1 rough.
    pub roughness: f32,
    /// Share of light that passes through, 0 to 1.
    pub transmission: f32,
    /// Index of refraction.
    pub ior: f32,
    /// Emitted radiance.
    pub emission: Vec3,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            base_color: Vec3::splat(0.7),
            metallic: 0.0,
            roughness: 1.0,
            transmission: 0.0,
            ior: 1.5,
            emission: Vec3::ZERO,
        }
    }
}

/// Light from outside: a vertical gradient and an optional sun. Black for closed scenes with their own lights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// Radiance straight up.
    pub zenith: Vec3,
    /// Radiance at and below the horizon.
    pub horizon: Vec3,
    /// A distant light.
    pub sun: Option<Sun>,
}

/// A distant light of small angular size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit vector towards it.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it.
    pub irradiance: Vec3,
    /// Half of its angular diameter.
    pub half_angle_rad: f32,
}

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Eye point.
    pub position: Vec3,
    /// Point looked at.
    pub target: Vec3,
    /// Roughly up; (0, 1, 0) unless the file says otherwise.
    pub up: Vec3,
    /// Full vertical angle of view.
    pub vertical_fov_deg: f32,
    /// Width over height of the picture it was made for, if that is known: in a narrower one the vertical angle
    /// widens, so that all it was made to show stays in sight. Otherwise the vertical angle is kept.
    pub framed_aspect: Option<f32>,
}

impl Camera {
    /// Tangent of half the vertical angle in a picture of `aspect`, its width over its height.
    pub fn half_height(&self, aspect: f32) -> f32 {
        let half = (self.vertical_fov_deg.clamp(0.1, 179.0).to_radians() * 0.5).tan();
        match self.framed_aspect {
            Some(framed) if framed > aspect => half * framed / aspect,
            _ => half,
        }
    }
}

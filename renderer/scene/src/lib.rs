//! Scenes: geometry in world space or as instances, materials, lights, cameras.
//!
//! Every source (glTF, OBJ, PLY, a built-in generator) gives one [`Scene`]; the integrator and the indicators
//! know nothing else.

mod animation;
pub mod assemble;
mod bounds;
pub mod builtin;
pub mod camera_path;
mod environment;
mod error;
mod flatten;
pub mod framing;
mod gltf_animation;
mod gltf_extras;
mod gltf_file;
mod gltf_geometry;
mod gltf_instances;
mod gltf_json;
mod gltf_material;
mod images;
pub mod indicators;
pub mod limits;
mod load;
#[cfg(test)]
mod load_animation_tests;
#[cfg(test)]
mod load_far_tests;
#[cfg(test)]
mod load_gltf_tests;
#[cfg(test)]
mod load_tests;
#[cfg(test)]
mod load_text_tests;
#[cfg(test)]
mod load_texture_tests;
pub mod motion;
mod mtl_text;
mod needles;
mod obj_file;
mod obj_maps;
mod obj_text;
mod objects;
pub mod part;
mod place;
pub mod placed;
mod ply_file;
mod ply_text;
mod polygon;
mod probe;
mod punctual;
pub mod shapes;
mod sky;
mod text;
pub mod texture;
mod textures;
mod up;

use std::sync::Arc;

use glam::{Vec2, Vec3};
use treewright_accel::{Instances, Triangles};

pub use animation::Animated;
pub use bounds::Bounds;
pub use environment::Environment;
pub use error::SceneError;
pub use load::{load, load_upright};
pub use place::Placement;
pub use placed::Placed;
pub use punctual::{Arrival, Cone, Punctual};
pub use texture::{Texture, Wrap};
pub use up::Up;

/// A scene ready to be rendered.
#[derive(Clone, Debug)]
pub struct Scene {
    /// For people and for studies: the file's stem or the built-in's name.
    pub name: String,
    /// All triangles: in world space, or each in its object's space where there are `instances`.
    pub triangles: Arc<Triangles>,
    /// Where objects of whole meshes stand; without any, all is met as it is.
    pub instances: Option<Arc<Instances>>,
    /// Unit shading normal of each vertex, on the front (counter-clockwise) side; none if all are flat.
    pub normals: Vec<Vec3>,
    /// Texture coordinates of each vertex; empty when no mesh has a texture.
    pub uvs: Vec<Vec2>,
    /// The textures that materials name by number.
    pub textures: Vec<Arc<Texture>>,
    /// Meshes in order of their triangles; together they cover all of them. See [`Scene::placed_meshes`].
    pub meshes: Vec<Mesh>,
    /// At least one.
    pub materials: Vec<Material>,
    /// The light of the sky.
    pub sky: Sky,
    /// Lights without size.
    pub lights: Vec<Punctual>,
    /// Light from outside as a picture, in place of the sky.
    pub environment: Option<Arc<Environment>>,
    /// Cameras of the file, or one framing camera. At least one.
    pub cameras: Vec<Camera>,
    /// Keys of a hand-laid camera path; empty without one (see [`crate::camera_path`]).
    pub path_keys: Vec<Camera>,
    /// The transform from places of the file to places of the scene.
    pub placement: Placement,
    /// The animations of the file, where they move what is drawn (see [`motion::Motion::File`]).
    pub animated: Option<Animated>,
    /// Omissions and additions of the loader, one sentence each.
    pub notes: Vec<String>,
}

impl Scene {
    /// Whether shadow rays are sent to any light: a sun, lights without size, surfaces that shine.
    pub fn has_sampled_lights(&self) -> bool {
        let shines = |light: Vec3| light.max_element() > 0.0;
        let sun = self.sky.sun.is_some_and(|sun| shines(sun.irradiance));
        sun || self.environment.is_some()
            || !self.lights.is_empty()
            || self.meshes.iter().any(|mesh| shines(self.materials[mesh.material as usize].emission))
    }
}

/// A run of triangles with one material.
#[derive(Clone, Debug)]
pub struct Mesh {
    /// Name in the file, for people.
    pub name: String,
    /// Number of its first triangle.
    pub first_triangle: u32,
    /// The number of its triangles.
    pub triangle_count: u32,
    /// Index into [`Scene::materials`].
    pub material: u32,
}

/// The scattering and emission of a surface. Linear RGB.
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
    /// Number of a texture that the base colour is multiplied by.
    pub base_color_texture: Option<u32>,
    /// Number of a texture whose green is multiplied by the roughness and whose blue by the share of metal.
    pub metallic_roughness_texture: Option<u32>,
    /// Number of a texture of normals in tangent space: x along the first coordinate, y up in the picture.
    pub normal_texture: Option<u32>,
    /// Factor on the lean of those normals; 1 leaves them as they are.
    pub normal_scale: f32,
    /// Number of a texture that the emission is multiplied by.
    pub emission_texture: Option<u32>,
    /// Number of a texture whose red is multiplied by the transmission.
    pub transmission_texture: Option<u32>,
    /// Rays go through where the base colour's alpha is below this. Above 1: nowhere solid.
    pub cutoff: Option<f32>,
    /// Transmission is blending: straight and untinted, more where alpha times `opacity` is lower.
    pub blends: bool,
    /// Factor of the base colour texture's alpha in blending.
    pub opacity: f32,
    /// The inside of a solid, where light bends; without one a transmitting surface is a thin sheet.
    pub volume: Option<Volume>,
}

/// The inside of a transmitting solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Share of light lost on a short way, per unit of length, by colour.
    pub absorption: Vec3,
}

impl Volume {
    /// A material that leaves the share `color` of light after `distance` (Beer's law), by default clear.
    pub fn new(color: Vec3, distance: f32) -> Self {
        let lost = color.clamp(Vec3::splat(1e-6), Vec3::ONE).map(|share| -share.ln());
        let absorption = if distance > 0.0 { lost / distance } else { Vec3::ZERO };
        Self { absorption: if absorption.is_finite() { absorption } else { Vec3::ZERO } }
    }
}

impl Material {
    /// Whether it has any texture.
    pub fn is_textured(&self) -> bool {
        self.all_textures().into_iter().flatten().next().is_some()
    }

    /// The numbers of its textures.
    pub fn all_textures(&self) -> [Option<u32>; 5] {
        [
            self.base_color_texture,
            self.metallic_roughness_texture,
            self.normal_texture,
            self.emission_texture,
            self.transmission_texture,
        ]
    }
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
            base_color_texture: None,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emission_texture: None,
            transmission_texture: None,
            cutoff: None,
            blends: false,
            opacity: 1.0,
            volume: None,
        }
    }
}

/// Light from outside: a vertical gradient and an optional sun. Black for scenes with their own lights.
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
    /// Width over height of its picture, if known: narrower ones widen the vertical angle.
    pub framed_aspect: Option<f32>,
}

impl Camera {
    /// An upright one that keeps its vertical angle in every picture.
    pub const fn upright(position: Vec3, target: Vec3, vertical_fov_deg: f32) -> Self {
        Self { position, target, up: Vec3::Y, vertical_fov_deg, framed_aspect: None }
    }

    /// Unit vectors to the right, up and forward, as a picture shows them.
    pub fn axes(&self) -> [Vec3; 3] {
        let forward = (self.target - self.position).normalize_or(Vec3::NEG_Z);
        // Looking along the up vector: any right will do.
        let right = forward.cross(self.up).normalize_or(forward.any_orthonormal_vector());
        [right, right.cross(forward), forward]
    }

    /// Tangent of half the vertical angle in a picture of `aspect`, its width over its height.
    pub fn half_height(&self, aspect: f32) -> f32 {
        let half = (self.vertical_fov_deg.clamp(0.001, 179.0).to_radians() * 0.5).tan();
        match self.framed_aspect {
            Some(framed) if framed > aspect => half * framed / aspect,
            _ => half,
        }
    }
}

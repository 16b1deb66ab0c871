//! The path tracer: one sample a pixel a frame, at most so many bounces, the same picture every time.
//!
//! A frame is a pure function of scene, camera, size, seed and sample number. It depends neither on the
//! number of threads nor, but for triangles that coincide, on the acceleration structure. The ray loop is
//! compiled once per kind of [`Intersector`]. Path tracing after Kajiya 1986; the limit of three bounces is
//! the paper's (section 3.1).

mod bsdf;
mod lights;
mod path;
pub mod random;
pub mod sampling;
mod surface;

use std::ops::AddAssign;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use treewright_accel::{Intersector, Ray};

pub use bsdf::{Bsdf, BsdfSample, Scatter};
pub use lights::{LightSample, Lights};

use crate::film::{Film, TILE};
use crate::render_options::RenderOptions;
use crate::scene::{Camera, Scene};
use random::PathRandom;

/// A scene with the tables that shading needs. Independent of the acceleration structure and the camera.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// What is rendered.
    pub scene: Arc<Scene>,
    /// Its lights.
    pub lights: Lights,
    /// Material of each triangle.
    material_of: Vec<u32>,
    /// Parallel to the scene's materials.
    bsdfs: Vec<Bsdf>,
    /// Whether light passes straight through anything.
    has_sheets: bool,
}

impl Prepared {
    /// Makes the tables: O(triangles).
    pub fn new(scene: Arc<Scene>) -> Self {
        let mut material_of = Vec::with_capacity(scene.triangles.len());
        for mesh in &scene.meshes {
            material_of.extend(std::iter::repeat_n(mesh.material, mesh.triangle_count as usize));
        }
        assert_eq!(material_of.len(), scene.triangles.len(), "the meshes of a scene cover its triangles");
        let bsdfs: Vec<Bsdf> = scene.materials.iter().map(Bsdf::new).collect();
        Self {
            lights: Lights::new(&scene),
            has_sheets: scene.meshes.iter().any(|mesh| bsdfs[mesh.material as usize].is_thin()),
            material_of,
            bsdfs,
            scene,
        }
    }
}

/// What makes two frames different, besides the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where it is seen from.
    pub camera: Camera,
    /// Seed of every random number.
    pub seed: u64,
    /// Most bounces of a path, not counting the ray from the camera.
    pub bounces: u32,
}

/// What happened while samples were rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Nearest-hit queries.
    pub rays: u64,
    /// Those that hit something.
    pub hits: u64,
    /// Any-hit queries.
    pub shadow_rays: u64,
    /// Samples that were not finite or negative, and counted as black.
    pub bad_samples: u64,
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.shadow_rays += other.shadow_rays;
        self.bad_samples += other.bad_samples;
    }
}

/// Adds one sample to each pixel of the film. Runs on the rayon pool it is called in; the film's number of
/// samples is the number of this one.
pub fn render_sample<I: Intersector>(
    prepared: &Prepared,
    intersector: &I,
    view: &View,
    _options: &RenderOptions,
    film: &mut Film,
) -> Counts {
    let lens = Lens::new(&view.camera, film.width(), film.height());
    let (width, height, sample) = (film.width(), film.height(), film.samples());
    let tiles_across = film.tiles_across();
    let counts = film
        .tiles_mut()
        .enumerate()
        // Tiles differ in cost by an order of magnitude, so each is a task of its own.
        .with_max_len(1)
        .map(|(tile, pixels)| {
            let mut counts = Counts::default();
            let (left, top) = ((tile as u32 % tiles_across) * TILE, (tile as u32 / tiles_across) * TILE);
            for (index, sum) in pixels.iter_mut().enumerate() {
                let (x, y) = (left + index as u32 % TILE, top + index as u32 / TILE);
                if x >= width || y >= height {
                    continue;
                }
                let mut random = PathRandom::new(view.seed, y * width + x, sample);
                let ray = lens.ray(x, y, random.pair());
                let radiance =
                    path::radiance(prepared, intersector, ray, view.bounces, &mut random, &mut counts);
                if radiance.is_finite() && radiance.min_element() >= 0.0 {
                    *sum += radiance;
                } else {
                    counts.bad_samples += 1;
                }
            }
            counts
        })
        .reduce(Counts::default, |mut sum, counts| {
            sum += counts;
            sum
        });
    film.count_sample();
    counts
}

/// A pinhole camera's rays.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    position: Vec3,
    corner: Vec3,
    right: Vec3,
    down: Vec3,
}

impl Lens {
    /// The lens of a camera for a picture of `width` × `height` pixels.
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let forward = (camera.target - camera.position).normalize_or(Vec3::NEG_Z);
        let right = forward
            .cross(camera.up)
            .try_normalize()
            // Looking along the up vector: any right will do.
            .unwrap_or_else(|| forward.any_orthonormal_vector());
        let up = right.cross(forward);
        let half_height = (camera.vertical_fov_deg.clamp(0.1, 179.0).to_radians() * 0.5).tan();
        let half_width = half_height * width as f32 / height as f32;
        Self {
            position: camera.position,
            corner: forward - right * half_width + up * half_height,
            right: right * (2.0 * half_width / width as f32),
            down: -up * (2.0 * half_height / height as f32),
        }
    }

    /// The ray through a point of a pixel, given by two numbers in [0, 1).
    pub fn ray(&self, x: u32, y: u32, [u, v]: [f32; 2]) -> Ray {
        let direction = self.corner + self.right * (x as f32 + u) + self.down * (y as f32 + v);
        Ray { origin: self.position, direction: direction.normalize(), t_min: 0.0, t_max: f32::INFINITY }
    }
}

#[cfg(test)]
mod tests;

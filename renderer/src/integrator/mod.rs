//! The path tracer: one sample a pixel a frame, a bounded number of bounces, repeatable to the bit.
//!
//! A frame is a pure function of scene, camera, size, seed and sample number, and but for triangles that
//! coincide not of the acceleration structure. The ray loop is compiled once per kind of
//! [`Intersector`](treewright_accel::Intersector), the shading once per set of [`Needs`]. Kajiya 1986; three
//! bounces are the paper's (section 3.1).
//!
//! [`render_sample`] hands tiles to threads; `path` and `stages` are the two orders of work. `vertex` shades
//! one hit, `chunk` many at once.

mod bsdf;
mod chunk;
mod environment;
mod frame;
mod lamp;
mod lamp_groups;
mod lamp_guide;
mod lens;
mod lights;
pub(crate) mod morton;
mod multiple;
mod needs;
mod path;
mod pilot;
mod places;
mod prepared;
mod punctual;
pub mod random;
mod render;
mod roulette;
pub mod sampling;
mod shadows;
mod sheets;
mod sky_guide;
mod solid;
mod stages;
mod surface;
mod textures;
mod vertex;

use std::ops::AddAssign;

use glam::Vec3;
use serde::Serialize;

pub use bsdf::{Bsdf, BsdfSample, Scatter, Seen};
pub use lamp::LightSample;
pub use lens::Lens;
pub use lights::Lights;
pub use needs::{Needs, Omission};
pub(crate) use pilot::learn;
pub use prepared::Prepared;
pub use render::render_sample;
pub(crate) use sky_guide::Learnt;

use crate::scene::Camera;

/// The inputs of a frame besides the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where it is seen from.
    pub camera: Camera,
    /// Seed of every random number.
    pub seed: u64,
    /// Most bounces of a path, not counting the ray from the camera.
    pub bounces: u32,
}

/// Counts of rays while samples were rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Rays from the camera and after bounces, and those that look for sheets along shadow rays.
    pub rays: u64,
    /// The rays that hit something.
    pub hits: u64,
    /// Rays towards lights.
    pub shadow_rays: u64,
    /// Samples that were not finite or negative, and counted as black.
    pub bad_samples: u64,
}

impl Counts {
    /// Adds a sample to a pixel's sum if it is sound.
    #[inline(always)]
    fn add_sample(&mut self, sum: &mut Vec3, radiance: Vec3) {
        if radiance.is_finite() && radiance.min_element() >= 0.0 {
            *sum += radiance;
        } else {
            self.bad_samples += 1;
        }
    }
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.rays += other.rays;
        self.hits += other.hits;
        self.shadow_rays += other.shadow_rays;
        self.bad_samples += other.bad_samples;
    }
}

#[cfg(test)]
mod appearance_tests;
#[cfg(test)]
mod light_sampling_tests;
#[cfg(test)]
mod order_tests;
#[cfg(test)]
mod tests;

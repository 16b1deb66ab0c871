//! The common part of generators: the assembler, a seeded random number generator, counts by detail.

use std::sync::Arc;

use glam::{Vec3, Vec4};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::texture::{Encoding, Wrap};
use crate::{
    Camera, Environment, Material, SceneError, Sky, Sun, assemble::Assembler, images::Pixels, part::Part,
    shapes::Shapes,
};

/// Options of a built-in scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Scales the number of triangles; 1 is the number that [`super::about`] names. 0.001 to 8.
    pub detail: f32,
    /// Seed of all random choices.
    pub seed: u64,
    /// Moment of an animated scene ([`super::is_animated`]), where 0 to 1 is one round; any finite number.
    pub time: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { detail: 1.0, seed: 1, time: 0.0 }
    }
}

/// The results of a generator besides meshes.
pub(super) struct LightAndPath {
    pub(super) sky: Sky,
    /// Keys of the camera path; the first is the scene's camera.
    pub(super) keys: Vec<Camera>,
}

/// A material, or the number of one that is registered.
pub(super) trait Paint {
    fn registered(self, generator: &mut Generator) -> u32;
}

impl Paint for u32 {
    fn registered(self, _: &mut Generator) -> u32 {
        self
    }
}

impl Paint for Material {
    fn registered(self, generator: &mut Generator) -> u32 {
        generator.material(self)
    }
}

pub(super) struct Generator<'a> {
    pub(super) assembler: &'a mut Assembler,
    dice: ChaCha8Rng,
    pub(super) options: Options,
    /// Light from outside as a picture, beside a sky that is black.
    pub(super) environment: Option<Arc<Environment>>,
}

impl<'a> Generator<'a> {
    pub(super) fn new(assembler: &'a mut Assembler, options: Options) -> Self {
        let dice = ChaCha8Rng::seed_from_u64(options.seed);
        Self { assembler, dice, options, environment: None }
    }

    /// The number of segments along one direction of a surface: its triangles go with the square.
    pub(super) fn segments(&self, at_full_detail: usize) -> usize {
        ((at_full_detail as f32 * self.options.detail.sqrt()).round() as usize).max(4)
    }

    /// The number of a thing that comes in numbers.
    pub(super) fn count(&self, at_full_detail: usize) -> usize {
        ((at_full_detail as f32 * self.options.detail).round() as usize).max(1)
    }

    pub(super) fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.dice.random::<f32>()
    }

    pub(super) fn within(&mut self, low: Vec3, high: Vec3) -> Vec3 {
        let [x, y, z] = [0, 1, 2].map(|axis| self.between(low[axis], high[axis]));
        Vec3::new(x, y, z)
    }

    /// A whole number below a limit, which is at least 1.
    pub(super) fn below(&mut self, limit: usize) -> usize {
        self.dice.random_range(0..limit.max(1))
    }

    pub(super) fn chance(&mut self, probability: f32) -> bool {
        self.dice.random::<f32>() < probability
    }

    /// Adds a part as an object of its own and gives the number to place it by.
    pub(super) fn object(&mut self, name: &str, material: u32, part: &Part) -> Result<u32, SceneError> {
        self.assembler.begin_object();
        self.add_part(name, material, part)?;
        Ok(self.assembler.end_object())
    }

    pub(super) fn material(&mut self, material: Material) -> u32 {
        self.assembler.material(material)
    }

    pub(super) fn materials<const N: usize>(&mut self, materials: [Material; N]) -> [u32; N] {
        materials.map(|material| self.material(material))
    }

    /// Adds a picture of `size` pixels by its stored colours, 0 to 1, over texture coordinates.
    pub(super) fn picture(
        &mut self,
        name: &str,
        [width, height]: [u32; 2],
        encoding: Encoding,
        wrap: Wrap,
        colour: impl Fn(f32, f32) -> Vec4,
    ) -> Option<u32> {
        let middle = |place: u32, edge: u32| (place as f32 + 0.5) / edge as f32;
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (middle(x, width), middle(y, height))));
        let stored = |colour: Vec4| {
            (colour.clamp(Vec4::ZERO, Vec4::ONE) * 255.0).round().to_array().map(|value| value as u8)
        };
        let make =
            || Ok(Pixels { width, height, pixels: places.map(|(u, v)| stored(colour(u, v))).collect() });
        self.assembler.texture(name, name, encoding, [wrap; 2], make)
    }

    pub(super) fn add(&mut self, name: &str, paint: impl Paint, shapes: &Shapes) -> Result<(), SceneError> {
        let material = paint.registered(self);
        self.add_part(name, material, &shapes.part)
    }

    /// Adds shapes of one name, each in its material.
    pub(super) fn add_each(
        &mut self,
        name: &str,
        materials: &[u32],
        shapes: &[Shapes],
    ) -> Result<(), SceneError> {
        shapes.iter().zip(materials).try_for_each(|(shapes, material)| self.add(name, *material, shapes))
    }

    pub(super) fn add_part(&mut self, name: &str, material: u32, part: &Part) -> Result<(), SceneError> {
        self.assembler.mesh(name, material, part)
    }
}

/// A sky with a sun: radiance of both ends, where the sun stands, and its light.
pub(super) fn sunny(zenith: [f32; 3], horizon: [f32; 3], towards: [f32; 3], light: [f32; 3]) -> Sky {
    let sun = Sun::towards(Vec3::from_array(towards), Vec3::from_array(light));
    Sky { zenith: Vec3::from_array(zenith), horizon: Vec3::from_array(horizon), sun: Some(sun) }
}

pub(super) fn key(position: [f32; 3], target: [f32; 3], vertical_fov_deg: f32) -> Camera {
    Camera::upright(Vec3::from_array(position), Vec3::from_array(target), vertical_fov_deg)
}

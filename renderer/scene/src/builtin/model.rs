//! The city as an architect's model, white and matt under an overcast sky, which needs few features.

use glam::Vec3;

use super::city;
use super::generator::{Generator, LightAndPath};
use crate::{Material, SceneError, Sky};

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let plan = city::build(generator)?;
    // An index of refraction of 1 reflects nothing: Lambert's surface and no more.
    generator.assembler.repaint(Material { base_color: Vec3::splat(0.78), ior: 1.0, ..Material::default() });
    Ok(LightAndPath { sky: Sky { zenith: Vec3::splat(1.1), horizon: Vec3::splat(0.8), sun: None }, ..plan })
}

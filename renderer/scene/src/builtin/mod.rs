//! Built-in scenes, generated from a name, a level of detail and a seed: equal ones give equal bytes.
//!
//! They cover the properties by which acceleration structures differ. `hall` is architecture with large and
//! small triangles side by side. `voxels` has many equal axis-aligned faces. `gallery`, `needles`, `hair`,
//! `cables` and `scaffold` have thin and long ones. `statue` is one dense surface. `city` has a wide extent,
//! and so has `model`, whose shading needs few features. `forest` fits memory only as instances. `grove` has
//! cards that are mostly holes. `sea` has a mesh that deforms; parts move in `needles` and `sea`. Light is
//! hard to find in `market`, `loft` and `doorway`. `quick` is a small one for trials; `patio` has its shapes
//! under an environment map.

mod architecture;
mod city;
mod courtyard;
mod forest;
mod gallery;
mod generator;
mod grove;
mod hall;
mod lights;
mod model;
mod needles;
mod noise;
mod palette;
mod sea;
mod slender;
mod statue;
#[cfg(test)]
mod tests;
mod voxel_mesh;
mod voxels;

use std::path::PathBuf;

use generator::{Generator, LightAndPath};

pub use generator::Options;

use super::assemble::{Assembler, Lighting};
use super::{Scene, SceneError, framing::CameraPose, limits::DETAIL_RANGE};

/// A scene in the list: its name, its description, and its generator.
type Entry = (&'static str, &'static str, fn(&mut Generator) -> Result<LightAndPath, SceneError>);

const SCENES: [Entry; 18] = [
    (
        "hall",
        "columned hall with coffered ceiling, sunlit through high windows; 250,000 triangles",
        hall::build,
    ),
    ("voxels", "landscape of cubes with caves, trees, a lake and a keep; 500,000 triangles", voxels::build),
    ("gallery", "picture gallery of thin frames, wires and railings; 200,000 triangles", gallery::build),
    ("statue", "finely displaced figure under a dome with an open eye; 1,000,000 triangles", statue::build),
    ("needles", "bundle of long thin triangles turning through the hall; 100,000 triangles", needles::build),
    ("hair", "bust whose hair of 60,000 strands blows in the wind; 185,000 triangles", slender::hair),
    ("cables", "yard spanned by sagging cables and bundles of them; 145,000 triangles", slender::cables),
    (
        "scaffold",
        "frame of thin poles, braces and planks before a wall; 140,000 triangles",
        slender::scaffold,
    ),
    ("city", "blocks of towers with window frames, lamps, cars and trees; 480,000 triangles", city::build),
    (
        "model",
        "the city as a white model under an overcast sky: one matt material, no lamps; 480,000 triangles",
        model::build,
    ),
    ("sea", "sailing boats on a heaving sea around a lighthouse, in motion; 200,000 triangles", sea::build),
    (
        "forest",
        "forest around a lake, made of instances; 10,000,000 triangles placed, 300,000 of them unique",
        forest::build,
    ),
    (
        "grove",
        "grove behind a wire fence: leaves, grass and wire cut out of cards by their textures; 200,000 triangles",
        grove::build,
    ),
    ("market", "stalls at night under a thousand small lanterns; 330,000 triangles", lights::market),
    (
        "loft",
        "room that the sky reaches through two windows and a lamp through a slit; 2,500 triangles",
        lights::loft,
    ),
    (
        "doorway",
        "room without windows, lit by lamps of the next one through a door that is ajar; 4,700 triangles",
        lights::doorway,
    ),
    (
        "quick",
        "small courtyard with a fountain for tests and demonstrations; 20,000 triangles",
        courtyard::build,
    ),
    (
        "patio",
        "the courtyard of quick under an environment map with a small sun; 20,000 triangles",
        courtyard::patio,
    ),
];

/// The names of all built-in scenes.
pub fn names() -> impl Iterator<Item = &'static str> {
    SCENES.iter().map(|(name, ..)| *name)
}

/// Whether a built-in scene changes with time.
pub fn is_animated(name: &str) -> bool {
    ["needles", "sea"].contains(&name)
}

/// One line about a built-in scene, or nothing when there is none of that name.
pub fn about(name: &str) -> Option<&'static str> {
    SCENES.iter().find(|entry| entry.0 == name).map(|entry| entry.1)
}

/// Generates a built-in scene.
///
/// # Errors
/// [`SceneError::UnknownBuiltin`] and [`SceneError::BadOption`].
pub fn build(name: &str, options: &Options) -> Result<Scene, SceneError> {
    let Some((name, _, generate)) = SCENES.iter().find(|entry| entry.0 == name) else {
        let known = names().collect::<Vec<_>>().join(", ");
        return Err(SceneError::UnknownBuiltin { name: name.to_owned(), known });
    };
    if !DETAIL_RANGE.contains(&options.detail) {
        return Err(SceneError::BadOption("detail", options.detail));
    }
    if !options.time.is_finite() {
        return Err(SceneError::BadOption("time", options.time));
    }
    let mut assembler = Assembler::new(*name, &PathBuf::from(format!("builtin:{name}")));
    let (plan, environment) = {
        let mut generator = Generator::new(&mut assembler, *options);
        (generate(&mut generator)?, generator.environment)
    };
    let views = plan.keys.iter().take(1).map(CameraPose::from);
    let mut scene = assembler.finish(Lighting::Given(plan.sky), views.collect())?;
    scene.path_keys = plan.keys;
    scene.environment = environment;
    Ok(scene)
}

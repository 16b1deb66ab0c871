//! A bundle of long thin triangles in the shape of a cylinder that turns through the hall (paper section
//! 4.3): half as long as the scene's diagonal, it crosses most of the geometry at most angles, which is the
//! hard case for boxes aligned to axes.

use std::f32::consts::TAU;

use glam::{Mat3, Vec3};

use super::generator::Options;
use super::generator::{Generator, LightAndPath, key};
use super::hall;
use super::palette::polished;
use crate::SceneError;
use crate::bounds::Bounds;
use crate::part::Part;

/// Share of the detail that the hall gets.
const HALL_DETAIL: f32 = 0.4;
/// Needles at full detail, two crossing triangles each.
const NEEDLES: usize = 3_000;
/// Share of a round at which it starts.
const START: f32 = 0.1;
/// Radius of the cylinder in shares of its length.
const SLENDER: f32 = 0.07;

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let own = generator.options;
    generator.options = Options { detail: (own.detail * HALL_DETAIL).max(0.001), ..own };
    let hall = hall::build(generator)?;
    generator.options = own;
    let Bounds { min, max } = generator.bounds();
    let middle = (min + max) * 0.5;
    let length = (max - min).length() * 0.5;
    // The axis leans a little and turns about the vertical; it starts across the nave, through its walls.
    let turn = Mat3::from_rotation_y(TAU * (own.time.rem_euclid(1.0) + START)) * Mat3::from_rotation_z(0.18);
    let mut bundles = [Part::default(), Part::default()];
    for needle in 0..generator.count(NEEDLES) {
        let radius = SLENDER * length * generator.between(0.0, 1.0).sqrt();
        let angle = generator.between(0.0, TAU);
        let twist = generator.between(-0.25, 0.25);
        let width = length * generator.between(0.0004, 0.0011);
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
    let red = generator.material(polished(0.72, 0.3, 0.13, 0.4));
    let grey = generator.material(polished(0.55, 0.6, 0.66, 0.4));
    generator.add_part("red needles", red, &bundles[0])?;
    generator.add_part("grey needles", grey, &bundles[1])?;
    Ok(LightAndPath {
        sky: hall.sky,
        keys: vec![
            key([-21.0, 2.2, 2.6], [2.0, 5.6, -1.4], 60.0),
            key([-12.0, 3.4, -3.4], [4.0, 6.0, 1.0], 60.0),
            key([-3.0, 9.4, 3.6], [8.0, 5.4, -1.0], 62.0),
            key([9.0, 4.0, -3.0], [-4.0, 6.2, 0.6], 62.0),
            key([18.0, 2.4, 2.8], [0.0, 6.4, 0.0], 60.0),
        ],
    })
}

//! The undergrowth: bushes, ferns, grass, reeds and stones.

use std::f32::consts::{PI, TAU};

use glam::Vec3;

use super::trees::leaf;
use crate::builtin::noise::{octaves, ridges};
use crate::shapes::{Shapes, on_sphere};
use crate::{SceneError, builtin::generator::Generator, builtin::palette::matt, part::Part};

/// Bushes and boulders.
pub(super) fn bushes(generator: &mut Generator) -> Result<Vec<u32>, SceneError> {
    let mut all = Vec::new();
    for [red, green, blue] in [[0.1, 0.16, 0.04], [0.14, 0.2, 0.05], [0.2, 0.13, 0.05]] {
        let green = generator.material(matt(red, green, blue));
        all.push(bush(generator, green)?);
    }
    let stone = generator.material(matt(0.3, 0.29, 0.27));
    for number in 0..2 {
        all.push(boulder(generator, stone, number)?);
    }
    Ok(all)
}

/// Tufts of grass, ferns and reeds.
pub(super) fn undergrowth(generator: &mut Generator) -> Result<Vec<u32>, SceneError> {
    let mut all = Vec::new();
    for ([red, green, blue], tall) in [([0.16, 0.23, 0.05], 0.5), ([0.23, 0.25, 0.08], 0.75)] {
        let green = generator.material(matt(red, green, blue));
        let object = tuft(generator, green, tall)?;
        all.extend([object; 2]);
    }
    let green = generator.material(matt(0.08, 0.18, 0.035));
    for _ in 0..2 {
        all.push(fern(generator, green)?);
    }
    Ok(all)
}

fn bush(generator: &mut Generator, green: u32) -> Result<u32, SceneError> {
    let mut leaves = Part::default();
    let count = generator.count(1_100).max(30);
    let size = 0.09 * (1_100.0 / count as f32).sqrt().min(3.0);
    for _ in 0..count {
        let (angle, lift) = (generator.between(0.0, TAU), generator.between(0.0, 1.0));
        let outward = on_sphere(angle, lift * PI * 0.5);
        let bumpy = 0.75 + 0.25 * (angle * 3.0).sin() * (lift * 5.0).cos();
        let foot = outward * Vec3::new(0.85, 0.95, 0.85) * (bumpy * generator.between(0.55, 1.0));
        let along = generator.within(Vec3::new(-1.0, -0.4, -1.0), Vec3::ONE);
        let along = (along + outward).normalize_or(outward) * size;
        let across = along.cross(outward).normalize_or(along.any_orthonormal_vector()) * (size * 0.45);
        leaf(&mut leaves, foot, along, across, outward);
    }
    generator.object("bush", green, &leaves)
}

fn boulder(generator: &mut Generator, stone: u32, number: u64) -> Result<u32, SceneError> {
    let seed = generator.options.seed + 60 + number;
    let (around, rows) = (generator.segments(36), generator.segments(22));
    let mut shapes = Shapes::new();
    shapes.surface(around, rows, true, |u, v| {
        let at = on_sphere(TAU * u, PI * (v - 0.5));
        let rough = 0.75 + 0.45 * octaves(seed, at * 1.3, 3) - 0.12 * ridges(seed + 1, at * 3.0, 3);
        at * Vec3::new(0.9, 0.55, 0.7) * rough + Vec3::Y * 0.12
    });
    generator.object("boulder", stone, &shapes.part)
}

fn tuft(generator: &mut Generator, green: u32, tall: f32) -> Result<u32, SceneError> {
    let mut blades = Part::default();
    for _ in 0..generator.count(190).max(12) {
        let (angle, from) = (generator.between(0.0, TAU), generator.between(0.0, 0.5));
        let (sin, cos) = angle.sin_cos();
        let out = Vec3::new(sin, 0.0, cos);
        let (foot, length) = (out * from, tall * generator.between(0.5, 1.15));
        let bend = generator.between(0.1, 0.5);
        let side = Vec3::new(cos, 0.0, -sin) * 0.011;
        let knee = foot + (Vec3::Y + out * bend * 0.5).normalize() * (length * 0.55);
        let tip = knee + (Vec3::Y * 0.6 + out * bend * 2.0).normalize() * (length * 0.5);
        let first = blades.positions.len() as u32;
        blades.positions.extend([foot - side, foot + side, knee + side * 0.8, knee - side * 0.8, tip]);
        blades.normals.extend([(Vec3::Y + out * 0.4).normalize(); 5]);
        let corners = [[0, 1, 2], [0, 2, 3], [3, 2, 4]];
        blades.indices.extend(corners.map(|triangle| triangle.map(|corner: u32| corner + first)));
    }
    generator.object("grass", green, &blades)
}

fn fern(generator: &mut Generator, green: u32) -> Result<u32, SceneError> {
    let mut leaves = Part::default();
    let (fronds, pinnae) = (11, generator.segments(16));
    for frond in 0..fronds {
        let angle = TAU * (frond as f32 + generator.between(-0.3, 0.3)) / fronds as f32;
        let (sin, cos) = angle.sin_cos();
        let (out, side) = (Vec3::new(sin, 0.0, cos), Vec3::new(cos, 0.0, -sin));
        let length = generator.between(0.55, 0.85);
        for pinna in 0..pinnae {
            let share = (pinna as f32 + 0.7) / pinnae as f32;
            let rise = (share * 2.2).sin() * 0.5;
            let foot = out * (length * share) + Vec3::Y * (length * rise);
            let size = length * 0.26 * (1.0 - share).powf(0.7) * (share * 6.0).min(1.0);
            for way in [-1.0, 1.0] {
                let along = (side * way + out * 0.35 - Vec3::Y * 0.15).normalize() * size;
                leaf(&mut leaves, foot, along, out * (size * 0.16), (Vec3::Y + out * 0.3).normalize());
            }
        }
    }
    generator.object("fern", green, &leaves)
}

//! Sailing boats on a heaving sea, one mesh that deforms in place, around a lighthouse; time is a circle.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Mat4, Vec2, Vec3};

use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::{octaves, ridges};
use super::palette::{glow, matt, polished};
use crate::SceneError;
use crate::shapes::{Shapes, on_circle, on_sphere};

/// Edge of the sea, metres.
const SIZE: f32 = 90.0;
/// Boats at full detail.
const BOATS: usize = 14;

/// Waves: direction in rounds of the circle, length in metres, height, and how often one passes in a round.
const WAVES: [(f32, f32, f32, f32); 6] = [
    (0.04, 23.0, 0.55, 2.0),
    (0.11, 13.0, 0.3, 3.0),
    (-0.07, 8.0, 0.17, 4.0),
    (0.2, 4.6, 0.08, 6.0),
    (-0.16, 2.9, 0.045, 7.0),
    (0.31, 1.7, 0.02, 9.0),
];

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let time = generator.options.time.rem_euclid(1.0);
    let side = generator.segments(280);
    let mut sea = Shapes::new();
    sea.surface(side, side, false, |u, v| surface(Vec2::new((u - 0.5) * SIZE, (0.5 - v) * SIZE), time));
    generator.add("sea", polished(0.012, 0.05, 0.065, 0.08), &sea)?;
    lighthouse(generator)?;
    boats(generator, time)?;
    let sky = sunny([0.2, 0.34, 0.62], [0.95, 0.78, 0.6], [-0.8, 0.32, -0.4], [3.4, 2.6, 1.7]);
    let keys = vec![
        key([19.0, 4.6, 26.0], [-2.0, 2.6, 0.0], 46.0),
        key([27.0, 3.6, 10.0], [-1.0, 2.6, -1.0], 46.0),
        key([26.0, 5.4, -12.0], [0.0, 2.0, 0.0], 48.0),
        key([8.0, 7.6, -25.0], [0.0, 2.4, 0.0], 50.0),
        key([-14.0, 4.0, -20.0], [0.0, 3.0, 0.0], 48.0),
    ];
    Ok(LightAndPath { sky, keys })
}

/// A point of the sea: trochoids after Gerstner (1802), with crests sharper than troughs.
fn surface(at: Vec2, time: f32) -> Vec3 {
    let mut point = Vec3::new(at.x, 0.0, at.y);
    for (direction, length, height, passes) in WAVES {
        let (sin, cos) = (TAU * direction).sin_cos();
        let along = Vec2::new(cos, sin);
        let (rise, forth) = (TAU * (along.dot(at) / length - passes * time)).sin_cos();
        point += Vec3::new(along.x * forth, rise, along.y * forth) * height;
    }
    point
}

fn lighthouse(generator: &mut Generator) -> Result<(), SceneError> {
    let white = generator.material(matt(0.8, 0.78, 0.74));
    let red = generator.material(matt(0.62, 0.07, 0.05));
    let seed = generator.options.seed;
    let (around, rows) = (generator.segments(90), generator.segments(50));
    let mut island = Shapes::new();
    island.surface(around, rows, true, |u, v| {
        let at = on_sphere(TAU * u, PI * 0.5 * v);
        let rough = 0.8 + 0.5 * octaves(seed, at * 2.0, 3) + 0.3 * (ridges(seed + 1, at * 4.0, 3) - 0.4);
        let flat = 1.0 - v.powi(6);
        Vec3::new(at.x * 7.5 * rough, -3.0 + at.y * (5.4 + 0.8 * (rough - 0.8) * flat), at.z * 6.5 * rough)
    });
    generator.add("rock", matt(0.2, 0.18, 0.16), &island)?;
    let segments = generator.segments(40);
    for band in 0..5 {
        let radius = |at: usize| 1.35 - 0.11 * at as f32;
        let height = |at: usize| 1.6 + 1.6 * at as f32;
        let mut tower = Shapes::new();
        let profile = [Vec2::new(radius(band), height(band)), Vec2::new(radius(band + 1), height(band + 1))];
        tower.lathe(Vec3::ZERO, &profile, segments);
        generator.add("tower", if band % 2 == 0 { white } else { red }, &tower)?;
    }
    let mut top = Shapes::new();
    let roof = [(1.25, 9.6), (1.25, 9.75), (1.25, 9.75), (0.9, 9.75)].map(|(r, y)| Vec2::new(r, y));
    top.lathe(Vec3::ZERO, &roof, segments);
    top.lathe(Vec3::ZERO, &[(0.95, 10.9), (0.5, 11.5), (0.05, 11.7)].map(|(r, y)| Vec2::new(r, y)), segments);
    for post in 0..8 {
        let at = |height: f32| on_circle(TAU * post as f32 / 8.0, 0.85, height);
        top.rod(at(9.7), at(10.95), 0.05, 6);
    }
    generator.add("lantern", red, &top)?;
    let mut bulb = Shapes::new();
    bulb.sphere(Vec3::Y * 10.3, 0.32, generator.segments(16), generator.segments(10));
    generator.add("lamp", glow(80.0, 66.0, 40.0), &bulb)
}

fn boats(generator: &mut Generator, time: f32) -> Result<(), SceneError> {
    let wood = generator.material(polished(0.3, 0.16, 0.08, 0.4));
    let sails = generator.materials([matt(0.82, 0.78, 0.68), matt(0.7, 0.2, 0.1), matt(0.16, 0.28, 0.42)]);
    let (hull, sail) = boat(generator);
    for number in 0..generator.count(BOATS) {
        // Each goes round the lighthouse on a circle of its own, some the other way.
        let radius = generator.between(11.0, 36.0);
        let way = if generator.chance(0.3) { -1.0 } else { 1.0 };
        let angle = generator.between(0.0, TAU) + way * TAU * time;
        let (sin, cos) = angle.sin_cos();
        let at = Vec2::new(cos, sin) * radius;
        let ahead = Vec2::new(-sin, cos) * way;
        let point = |offset: Vec2| surface(at + offset, time);
        let bow = (point(ahead) - point(-ahead)).normalize_or(Vec3::X);
        let side = Vec2::new(ahead.y, -ahead.x);
        let up = bow.cross(point(-side) - point(side)).normalize_or(Vec3::Y);
        let up = if up.y < 0.0 { -up } else { up };
        let scale = generator.between(0.8, 1.3);
        let axes = Mat3::from_cols(bow, up, bow.cross(up)) * scale;
        let to_sea = Mat4::from_translation(point(Vec2::ZERO)) * Mat4::from_mat3(axes);
        for (shapes, material) in [(&hull, wood), (&sail, sails[number % sails.len()])] {
            let mut part = shapes.part.clone();
            part.transform(&to_sea);
            generator.add_part("boat", material, &part)?;
        }
    }
    Ok(())
}

/// A hull with mast and boom along the x axis, and its sails.
fn boat(generator: &Generator) -> (Shapes, Shapes) {
    let (mut hull, mut sails) = (Shapes::new(), Shapes::new());
    let (long, round) = (generator.segments(36), generator.segments(20));
    hull.surface(long, round, false, |u, v| {
        let x = (u - 0.5) * 4.4;
        // Pointed at the bow, blunt at the stern.
        let beam = 0.78 * (1.0 - (u * 1.06 - 0.06).max(0.0).powi(3)) * (0.55 + u).min(1.0);
        let (depth, across) = (PI * v).sin_cos();
        Vec3::new(
            x + 0.25 * u * (1.0 - depth),
            0.42 + 0.2 * u * u - 0.75 * depth * (1.0 - 0.45 * u),
            beam * across,
        )
    });
    hull.surface(long, 2, false, |u, v| {
        let beam = 0.74 * (1.0 - (u * 1.06 - 0.06).max(0.0).powi(3)) * (0.55 + u).min(1.0);
        Vec3::new((u - 0.5) * 4.3 + 0.2 * u, 0.34 + 0.2 * u * u, beam * (1.0 - 2.0 * v))
    });
    hull.rod(Vec3::new(0.3, 0.1, 0.0), Vec3::new(0.3, 5.6, 0.0), 0.05, 8);
    hull.rod(Vec3::new(0.3, 0.95, 0.0), Vec3::new(-1.9, 0.95, 0.35), 0.04, 6);
    let cells = generator.segments(26);
    // Triangles of cloth, bellied by the wind.
    let mut cloth = |foot: Vec3, clew: Vec3, head: Vec3, belly: f32| {
        sails.surface(cells, cells, false, |u, v| {
            let (u, v) = (u * 0.98 + 0.01, v * 0.96 + 0.02);
            let edge = foot.lerp(head, v);
            edge + (clew - foot) * (u * (1.0 - v)) + Vec3::Z * (belly * (PI * u).sin() * (PI * v).sin())
        });
    };
    cloth(Vec3::new(0.22, 1.05, 0.0), Vec3::new(-1.85, 1.05, 0.35), Vec3::new(0.22, 5.5, 0.0), 0.42);
    cloth(Vec3::new(2.1, 0.75, 0.0), Vec3::new(0.5, 0.9, 0.35), Vec3::new(0.36, 5.0, 0.0), 0.36);
    (hull, sails)
}

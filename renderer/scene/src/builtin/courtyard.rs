//! A small courtyard for tests and trials: an arcade around a fountain, a tree, a few shiny things.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{Vec2, Vec3};

use super::architecture::{Opening, WallPlane, arched_wall, archivolt, chequered, column};
use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::octaves;
use super::palette::{brass, glass, glow, matt, metal, polished};
use crate::shapes::{Shapes, on_circle};
use crate::{Environment, SceneError, Sky};

/// Half the side of the open yard, metres.
const HALF: f32 = 6.0;
/// Depth of the arcade.
const WALK: f32 = 2.6;
const COLUMN: f32 = 2.6;
const EAVES: f32 = 4.6;
const BAYS: usize = 4;

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    floor(generator)?;
    arcade(generator)?;
    fountain(generator)?;
    tree(generator)?;
    ornaments(generator)?;
    let sky = sunny([0.26, 0.45, 0.85], [0.8, 0.85, 0.9], [0.5, 0.75, 0.3], [4.2, 3.6, 2.8]);
    let keys = vec![
        key([-4.6, 1.9, 5.6], [0.6, 1.5, -0.8], 52.0),
        key([-1.0, 2.4, 6.4], [0.2, 1.4, 0.0], 52.0),
        key([3.6, 2.0, 4.6], [-0.4, 1.5, -0.6], 54.0),
        key([6.8, 1.7, 0.6], [-1.0, 1.6, 0.0], 56.0),
        key([3.0, 3.8, -3.8], [-0.6, 1.2, 0.6], 54.0),
    ];
    Ok(LightAndPath { sky, keys })
}

/// The courtyard with the light of its sky in an environment map.
pub(super) fn patio(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let plan = build(generator)?;
    generator.environment = Some(Arc::new(Environment::of_sky(&plan.sky)));
    Ok(LightAndPath { sky: Sky::BLACK, ..plan })
}

fn floor(generator: &mut Generator) -> Result<(), SceneError> {
    let shades = generator.materials([polished(0.62, 0.52, 0.4, 0.5), polished(0.46, 0.3, 0.22, 0.5)]);
    let across = generator.segments(16);
    let step = 2.0 * (HALF + WALK) / across as f32;
    let tiles = chequered(Vec2::splat(-HALF - WALK), [across; 2], Vec2::splat(step), 0.01);
    generator.add_each("tiles", &shades, &tiles)?;
    let mut bed = Shapes::new();
    let half = HALF + WALK;
    bed.cuboid(Vec3::new(-half, -0.4, -half), Vec3::new(half, -0.03, half));
    generator.add("bed", shades[1], &bed)
}

fn arcade(generator: &mut Generator) -> Result<(), SceneError> {
    let marble = generator.material(polished(0.8, 0.78, 0.74, 0.35));
    let (around, rows, arc) = (generator.segments(12), generator.segments(5), generator.segments(8));
    let (mut walls, mut trims, mut roof) = (Shapes::new(), Shapes::new(), Shapes::new());
    let bay = 2.0 * HALF / BAYS as f32;
    let turns =
        [(Vec3::X, Vec3::Z), (Vec3::NEG_Z, Vec3::X), (Vec3::NEG_X, Vec3::NEG_Z), (Vec3::Z, Vec3::NEG_X)];
    for (right, front) in turns {
        // Each side stands behind the yard's middle and looks at it.
        for index in 0..BAYS {
            let plane = WallPlane {
                corner: right * (-HALF + index as f32 * bay) - front * HALF + Vec3::Y * COLUMN,
                right,
                front,
                thickness: 0.34,
            };
            let arch = Opening { middle: bay * 0.5, half_width: bay * 0.5 - 0.28, sill: 0.0, spring: 0.0 };
            arched_wall(&mut walls, &plane, Vec2::new(bay, EAVES - COLUMN), &arch, arc);
            archivolt(&mut trims, &plane, &arch, 0.2, arc);
            let mut shapes = Shapes::new();
            column(&mut shapes, plane.corner.with_y(0.0) - front * 0.17, COLUMN, 0.19, around, rows);
            generator.add("column", marble, &shapes)?;
        }
        let back = |x: f32, y: f32| right * x - front * (HALF + WALK) + Vec3::Y * y;
        let out = HALF + WALK;
        walls.quad(back(-out, 0.0), back(out, 0.0), back(out, EAVES + 1.1), back(-out, EAVES + 1.1));
        // A tiled lean-to roof, ribbed along its slope.
        let ribs = generator.segments(40);
        let edge = |x: f32| right * (x * (HALF - 0.25)) - front * (HALF - 0.25) + Vec3::Y * EAVES;
        let top = |x: f32| right * (x * out) - front * out + Vec3::Y * (EAVES + 1.1);
        roof.surface(ribs * 2, 1, false, |u, v| {
            let x = 2.0 * u - 1.0;
            let lift = 0.05 * (u * ribs as f32 * PI).sin().abs();
            edge(x).lerp(top(x), v) + Vec3::Y * lift
        });
    }
    generator.add("walls", matt(0.78, 0.62, 0.44), &walls)?;
    generator.add("arch trims", marble, &trims)?;
    generator.add("roof", matt(0.55, 0.22, 0.13), &roof)
}

fn fountain(generator: &mut Generator) -> Result<(), SceneError> {
    let around = generator.segments(28);
    let profile = [
        (1.75, 0.0),
        (1.75, 0.12),
        (1.6, 0.12),
        (1.6, 0.5),
        (1.72, 0.56),
        (1.72, 0.64),
        (1.45, 0.64),
        (1.45, 0.4),
    ];
    let stem = [
        (0.3, 0.4),
        (0.16, 0.6),
        (0.2, 0.9),
        (0.12, 1.1),
        (0.2, 1.25),
        (0.62, 1.42),
        (0.7, 1.5),
        (0.6, 1.48),
        (0.1, 1.4),
        (0.06, 1.75),
    ];
    let mut shapes = Shapes::new();
    shapes.turned(Vec3::ZERO, &profile, around);
    shapes.lathe(Vec3::ZERO, &stem.map(|(r, y)| Vec2::new(r, y)), around);
    generator.add("fountain", polished(0.7, 0.68, 0.64, 0.4), &shapes)?;
    let rings = generator.segments(12);
    let mut surface = Shapes::new();
    surface.surface(around, rings, true, |u, v| {
        let radius = 1.45 * (1.0 - v);
        on_circle(TAU * u, radius, 0.54 + 0.012 * (radius * 26.0).sin() * v)
    });
    generator.add("water", polished(0.03, 0.14, 0.17, 0.03), &surface)
}

fn tree(generator: &mut Generator) -> Result<(), SceneError> {
    let foot = Vec3::new(3.4, 0.0, -3.4);
    let mut trunk = Shapes::new();
    let line = [(0.0, 0.0, 0.0), (0.05, 0.8, 0.02), (-0.06, 1.6, 0.08), (0.1, 2.5, -0.05)];
    trunk.tube(&line.map(|(x, y, z)| foot + Vec3::new(x, y, z)), 0.13, generator.segments(8));
    generator.add("trunk", matt(0.25, 0.16, 0.1), &trunk)?;
    // Leaves are single triangles scattered through a cloud.
    let mut leaves = Shapes::new();
    for _ in 0..generator.count(3600) {
        let out = generator.within(Vec3::NEG_ONE, Vec3::ONE);
        let reach = 1.25 + 0.5 * octaves(generator.options.seed, out * 2.0, 2);
        let middle =
            foot + Vec3::Y * 3.1 + out.normalize_or(Vec3::Y) * (reach * generator.between(0.2, 1.0).sqrt());
        let size = generator.between(0.06, 0.12);
        let mut corner = || middle + generator.within(Vec3::NEG_ONE, Vec3::ONE) * size;
        leaves.triangle(corner(), corner(), corner());
    }
    generator.add("leaves", matt(0.16, 0.34, 0.08), &leaves)
}

fn ornaments(generator: &mut Generator) -> Result<(), SceneError> {
    let segments = generator.segments(28);
    let mut ball = Shapes::new();
    ball.sphere(Vec3::new(-2.9, 0.62, 1.4), 0.6, segments, segments / 2);
    generator.add("gilded ball", metal(1.0, 0.76, 0.34, 0.08), &ball)?;
    let mut drop = Shapes::new();
    drop.sphere(Vec3::new(2.2, 0.46, 2.6), 0.45, segments, segments / 2);
    generator.add("glass ball", glass(0.95, 0.98, 0.97), &drop)?;
    let (mut lanterns, mut flames) = (Shapes::new(), Shapes::new());
    for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        let hook = Vec3::new(x * (HALF + 1.1), EAVES + 0.3, z * (HALF + 1.1));
        let lamp = hook.with_y(2.5);
        lanterns.rod(hook, lamp + Vec3::Y * 0.14, 0.01, 4);
        flames.sphere(lamp, 0.13, segments / 2, segments / 4 + 1);
    }
    generator.add("lantern chains", brass(), &lanterns)?;
    generator.add("lantern lights", glow(24.0, 15.0, 7.0), &flames)
}

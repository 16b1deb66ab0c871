//! A columned hall: nave and two aisles under a coffered ceiling, the sun falling through high windows.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::architecture::{Opening, WallPlane, arched_wall, archivolt, chequered, coffer, column, lattice};
use super::generator::{Generator, LightAndPath, key, sunny};
use super::palette::{brass, glow, matt, metal, polished};
use crate::{SceneError, shapes::Shapes};

/// Half the length, metres.
const HALF_LENGTH: f32 = 24.0;
/// Where the rows of columns stand.
const ROW: f32 = 5.0;
/// Where the outer walls stand.
const OUTER: f32 = 9.0;
/// Height of the columns.
const COLUMN: f32 = 5.2;
/// Height of the arcade and of the aisles.
const AISLE: f32 = 8.2;
const CEILING: f32 = 13.4;
const BAYS: usize = 9;
const BAY: f32 = 2.0 * HALF_LENGTH / BAYS as f32;
const WALL: f32 = 0.5;

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    floor(generator)?;
    arcades(generator)?;
    walls(generator)?;
    ceiling(generator)?;
    lamps(generator)?;
    furniture(generator)?;
    let sky = sunny([0.9, 1.4, 2.4], [1.3, 1.6, 2.0], [0.31, 0.76, 0.57], [26.0, 21.0, 14.5]);
    let keys = vec![
        key([-21.0, 1.75, 2.4], [4.0, 4.6, -1.6], 58.0),
        key([-12.0, 1.9, 3.0], [6.0, 4.2, -2.0], 58.0),
        key([-4.0, 2.4, 2.6], [9.0, 4.0, -1.0], 60.0),
        key([3.0, 4.6, 0.6], [16.0, 5.0, 0.0], 62.0),
        key([9.0, 7.6, -2.4], [-6.0, 5.4, 1.0], 62.0),
        key([2.0, 3.2, -7.0], [-10.0, 3.4, -2.0], 60.0),
        key([-9.0, 1.8, -7.0], [4.0, 4.4, 0.0], 58.0),
    ];
    Ok(LightAndPath { sky, keys })
}

fn floor(generator: &mut Generator) -> Result<(), SceneError> {
    let across = generator.segments(24);
    let along = across * 8 / 3;
    let (step_x, step_z) = (2.0 * HALF_LENGTH / along as f32, 2.0 * OUTER / across as f32);
    let corner = Vec2::new(-HALF_LENGTH, -OUTER);
    let tiles = chequered(corner, [along, across], Vec2::new(step_x, step_z), 0.012);
    let mut bed = Shapes::new();
    bed.level(Vec2::new(HALF_LENGTH + WALL, OUTER + WALL), -0.03);
    let pale = generator.material(polished(0.72, 0.66, 0.56, 0.22));
    let dark = generator.material(polished(0.16, 0.17, 0.2, 0.16));
    generator.add("floor bed", matt(0.3, 0.28, 0.25), &bed)?;
    generator.add("pale tiles", pale, &tiles[0])?;
    generator.add("dark tiles", dark, &tiles[1])
}

/// The two planes of arcade walls, front towards the nave.
fn arcade_plane(side: f32, bay: usize) -> WallPlane {
    // Seen from the nave, the right of the wall at +z is -x and that of the wall at -z is +x.
    let start = if side > 0.0 { HALF_LENGTH - bay as f32 * BAY } else { -HALF_LENGTH + bay as f32 * BAY };
    WallPlane {
        corner: Vec3::new(start, COLUMN, side * (ROW - WALL * 0.5)),
        right: Vec3::new(-side, 0.0, 0.0),
        front: Vec3::new(0.0, 0.0, -side),
        thickness: WALL,
    }
}

fn arcades(generator: &mut Generator) -> Result<(), SceneError> {
    let marble = generator.material(polished(0.78, 0.72, 0.63, 0.35));
    let stone = generator.material(matt(0.74, 0.66, 0.54));
    let trim = generator.material(polished(0.82, 0.78, 0.7, 0.5));
    let iron = generator.material(metal(0.25, 0.24, 0.23, 0.5));
    let (around, rows, arc) = (generator.segments(36), generator.segments(14), generator.segments(28));
    for side in [-1.0, 1.0] {
        for index in 0..=BAYS {
            let mut shapes = Shapes::new();
            let foot = Vec3::new(-HALF_LENGTH + index as f32 * BAY, 0.0, side * ROW);
            column(&mut shapes, foot, COLUMN, 0.42, around, rows);
            generator.add("column", marble, &shapes)?;
        }
        let (mut walls, mut mouldings, mut bars) = (Shapes::new(), Shapes::new(), Shapes::new());
        for bay in 0..BAYS {
            let plane = arcade_plane(side, bay);
            let arch = Opening { middle: BAY * 0.5, half_width: BAY * 0.5 - 0.45, sill: 0.0, spring: 0.0 };
            arched_wall(&mut walls, &plane, Vec2::new(BAY, AISLE - COLUMN), &arch, arc);
            archivolt(&mut mouldings, &plane, &arch, 0.34, arc);
            let upper = WallPlane { corner: plane.corner + Vec3::Y * (AISLE - COLUMN), ..plane };
            let window = Opening { middle: BAY * 0.5, half_width: 1.15, sill: 1.3, spring: 3.2 };
            arched_wall(&mut walls, &upper, Vec2::new(BAY, CEILING - AISLE), &window, arc);
            archivolt(&mut mouldings, &upper, &window, 0.22, arc);
            lattice(&mut bars, &upper, &window, 5, 0.035);
        }
        // A cornice runs along the nave between arches and windows.
        let section = [(0.0, 0.0), (0.14, 0.05), (0.18, 0.16), (0.3, 0.2), (0.3, 0.3), (0.0, 0.3)];
        let section = section.map(|(out, up)| Vec2::new(out, up));
        let plane = arcade_plane(side, 0);
        let from = plane.corner + Vec3::Y * (AISLE - COLUMN + 0.45);
        let frame = |origin| (origin, plane.front, Vec3::Y);
        let mut section_seen: Vec<Vec2> = section.to_vec();
        // Walking to the wall's right, front × up points against the walk on neither side.
        if plane.front.cross(Vec3::Y).dot(plane.right) < 0.0 {
            section_seen.reverse();
        }
        mouldings.sweep(&section_seen, &[frame(from), frame(from + plane.right * (2.0 * HALF_LENGTH))]);
        generator.add("arcade wall", stone, &walls)?;
        generator.add("mouldings", trim, &mouldings)?;
        generator.add("window bars", iron, &bars)?;
    }
    Ok(())
}

fn walls(generator: &mut Generator) -> Result<(), SceneError> {
    let arc = generator.segments(20);
    let (mut walls, mut mouldings, mut bars) = (Shapes::new(), Shapes::new(), Shapes::new());
    let window = Opening { middle: BAY * 0.5, half_width: 0.8, sill: 2.6, spring: 5.4 };
    for side in [-1.0, 1.0] {
        for bay in 0..BAYS {
            let inner = arcade_plane(side, bay);
            let plane = WallPlane { corner: Vec3::new(inner.corner.x, 0.0, side * OUTER), ..inner };
            arched_wall(&mut walls, &plane, Vec2::new(BAY, AISLE), &window, arc);
            archivolt(&mut mouldings, &plane, &window, 0.2, arc);
            lattice(&mut bars, &plane, &window, 4, 0.03);
        }
    }
    // The far end has one great window over the altar step, the near end a blind wall.
    let far = WallPlane {
        corner: Vec3::new(HALF_LENGTH, 0.0, -OUTER),
        right: Vec3::Z,
        front: Vec3::NEG_X,
        thickness: WALL,
    };
    let great = Opening { middle: OUTER, half_width: 2.7, sill: 4.2, spring: 8.6 };
    arched_wall(&mut walls, &far, Vec2::new(2.0 * OUTER, CEILING), &great, arc * 2);
    archivolt(&mut mouldings, &far, &great, 0.5, arc * 2);
    lattice(&mut bars, &far, &great, 9, 0.05);
    let near = -HALF_LENGTH;
    walls.cuboid(Vec3::new(near - WALL, 0.0, -OUTER), Vec3::new(near, CEILING, OUTER));
    generator.add("outer walls", matt(0.7, 0.6, 0.47), &walls)?;
    generator.add("outer mouldings", polished(0.8, 0.75, 0.66, 0.5), &mouldings)?;
    generator.add("outer window bars", metal(0.25, 0.24, 0.23, 0.5), &bars)
}

fn ceiling(generator: &mut Generator) -> Result<(), SceneError> {
    let across = 7;
    let along = 32;
    let half = Vec2::new(HALF_LENGTH / along as f32, (ROW - WALL * 0.5) / across as f32);
    let (around, rings) = (generator.segments(24), generator.segments(5));
    let mut coffers = Shapes::new();
    for column in 0..along {
        for row in 0..across {
            let x = -HALF_LENGTH + (2 * column + 1) as f32 * half.x;
            let z = -(ROW - WALL * 0.5) + (2 * row + 1) as f32 * half.y;
            coffer(&mut coffers, Vec3::new(x, CEILING, z), half, 0.42, around, rings);
        }
    }
    let mut roof = Shapes::new();
    for side in [-1.0_f32, 1.0] {
        let (from, to) = (side * (ROW + WALL * 0.5), side * (OUTER + WALL));
        let (low, high) = (from.min(to), from.max(to));
        roof.cuboid(Vec3::new(-HALF_LENGTH, AISLE, low), Vec3::new(HALF_LENGTH, AISLE + 0.15, high));
        let joists = generator.segments(54);
        for joist in 0..joists {
            let x = -HALF_LENGTH + (joist as f32 + 0.5) * 2.0 * HALF_LENGTH / joists as f32;
            roof.cuboid(Vec3::new(x - 0.09, AISLE - 0.28, low), Vec3::new(x + 0.09, AISLE, high));
        }
    }
    generator.add("coffered ceiling", polished(0.32, 0.19, 0.1, 0.45), &coffers)?;
    generator.add("aisle roofs", matt(0.24, 0.15, 0.09), &roof)
}

fn lamps(generator: &mut Generator) -> Result<(), SceneError> {
    let bronze = generator.material(brass());
    let flame = generator.material(glow(120.0, 84.0, 46.0));
    let (around, thick) = (generator.segments(64), generator.segments(10));
    let (segments, rings) = (generator.segments(12), generator.segments(8));
    for bay in (0..BAYS).step_by(2) {
        let middle = Vec3::new(-HALF_LENGTH + (bay as f32 + 0.5) * BAY, 5.9, 0.0);
        let (mut ring, mut bulbs) = (Shapes::new(), Shapes::new());
        let loop_at = |angle: f32| middle + Vec3::new(angle.sin() * 0.95, 0.0, angle.cos() * 0.95);
        ring.surface(around, thick, true, |u, v| {
            let out = Vec3::new((TAU * u).sin(), 0.0, (TAU * u).cos());
            let (sin, cos) = (-TAU * v).sin_cos();
            middle + out * (0.95 + 0.045 * cos) - Vec3::Y * (0.045 * sin)
        });
        for bulb in 0..8 {
            let angle = TAU * bulb as f32 / 8.0;
            let foot = loop_at(angle);
            bulbs.sphere(foot + Vec3::Y * 0.13, 0.085, segments, rings);
            if bulb % 2 == 0 {
                ring.rod(foot, middle + Vec3::Y * 1.4, 0.012, 6);
            }
        }
        ring.rod(middle + Vec3::Y * 1.4, Vec3::new(middle.x, CEILING + 0.4, 0.0), 0.02, 6);
        generator.add("chandelier", bronze, &ring)?;
        generator.add("chandelier lights", flame, &bulbs)?;
    }
    Ok(())
}

fn furniture(generator: &mut Generator) -> Result<(), SceneError> {
    let mut benches = Shapes::new();
    for side in [-1.0_f32, 1.0] {
        for row in 0..9 {
            let x = -16.0 + row as f32 * 2.0;
            let (low, high) = ((side * 1.2).min(side * 3.9), (side * 1.2).max(side * 3.9));
            benches.cuboid(Vec3::new(x, 0.42, low), Vec3::new(x + 0.45, 0.48, high));
            benches.cuboid(Vec3::new(x - 0.06, 0.48, low), Vec3::new(x, 0.95, high));
            for z in [low, high - 0.08] {
                benches.open_cuboid(Vec3::new(x - 0.06, 0.0, z), Vec3::new(x + 0.45, 0.42, z + 0.08), false);
            }
        }
    }
    generator.add("benches", polished(0.36, 0.2, 0.1, 0.4), &benches)?;
    let mut runner = Shapes::new();
    runner.bevelled_slab(Vec3::new(-HALF_LENGTH + 0.5, 0.0, -0.8), Vec3::new(11.0, 0.015, 0.8), 0.01);
    generator.add("carpet", matt(0.42, 0.05, 0.05), &runner)?;
    let (around, along, thick) = (generator.segments(48), generator.segments(420), generator.segments(16));
    let mut pedestal = Shapes::new();
    let profile =
        [(1.5, 0.0), (1.5, 0.2), (1.2, 0.2), (1.2, 0.4), (0.62, 0.5), (0.55, 1.3), (0.8, 1.45), (0.8, 1.6)];
    let foot = Vec3::new(14.0, 0.0, 0.0);
    pedestal.turned(foot, &profile, around);
    pedestal.disc(foot + Vec3::Y * 1.6, 0.8, around);
    generator.add("pedestal", polished(0.85, 0.83, 0.8, 0.2), &pedestal)?;
    // A knot of gilded bronze: the line of a trefoil with a thick round body.
    let line: Vec<Vec3> = (0..=along)
        .map(|index| {
            let t = TAU * index as f32 / along as f32;
            let (x, y) = (t.sin() + 2.0 * (2.0 * t).sin(), t.cos() - 2.0 * (2.0 * t).cos());
            foot + Vec3::new(-(3.0 * t).sin() * 0.45, 3.1 + y * 0.42, x * 0.42)
        })
        .collect();
    let mut knot = Shapes::new();
    knot.tube(&line, 0.19, thick);
    generator.add("gilded knot", metal(1.0, 0.74, 0.32, 0.12), &knot)
}

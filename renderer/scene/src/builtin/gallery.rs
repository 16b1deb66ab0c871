//! A picture gallery: frames on wires, a balcony, a glazed roof on bars; most triangles are thin.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::generator::{Generator, LightAndPath, key, sunny};
use super::palette::{brass, glass, glow, matt, metal, polished, steel};
use crate::shapes::{Shapes, on_circle};
use crate::{Material, SceneError};

const HALF_LENGTH: f32 = 15.0;
const HALF_WIDTH: f32 = 5.5;
const HEIGHT: f32 = 6.4;
const BALCONY: f32 = 3.4;

const PAINTS: [(f32, f32, f32); 8] = [
    (0.75, 0.12, 0.08),
    (0.9, 0.62, 0.1),
    (0.08, 0.2, 0.5),
    (0.05, 0.35, 0.32),
    (0.85, 0.82, 0.72),
    (0.05, 0.05, 0.06),
    (0.5, 0.2, 0.4),
    (0.55, 0.66, 0.75),
];

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    room(generator)?;
    roof(generator)?;
    pictures(generator)?;
    balcony(generator)?;
    sculpture(generator)?;
    spotlights(generator)?;
    let sky = sunny([0.9, 1.2, 1.6], [1.3, 1.4, 1.5], [0.35, 0.85, 0.3], [9.0, 8.2, 6.8]);
    let keys = vec![
        key([-13.2, 1.65, 2.6], [-1.0, 2.1, -1.2], 60.0),
        key([-7.5, 1.65, 2.2], [0.5, 1.9, -2.0], 60.0),
        key([-3.2, 1.6, -2.8], [3.0, 1.8, -5.2], 55.0),
        key([3.4, 1.7, -2.6], [6.5, 2.1, 5.0], 58.0),
        key([8.6, 2.6, 1.2], [0.0, 2.0, -1.0], 60.0),
        key([12.4, 4.9, 0.8], [0.0, 1.6, 0.0], 62.0),
    ];
    Ok(LightAndPath { sky, keys })
}

fn room(generator: &mut Generator) -> Result<(), SceneError> {
    let parquet = generator.materials([polished(0.38, 0.22, 0.11, 0.3), polished(0.3, 0.17, 0.08, 0.3)]);
    let (x, z) = (HALF_LENGTH, HALF_WIDTH);
    let mut walls = Shapes::new();
    walls.cuboid(Vec3::new(-x, 0.0, -z - 0.3), Vec3::new(x, HEIGHT, -z));
    walls.cuboid(Vec3::new(-x, 0.0, z), Vec3::new(x, HEIGHT, z + 0.3));
    walls.cuboid(Vec3::new(-x - 0.3, 0.0, -z), Vec3::new(-x, HEIGHT, z));
    walls.cuboid(Vec3::new(x, 0.0, -z), Vec3::new(x + 0.3, HEIGHT, z));
    generator.add("walls", matt(0.42, 0.12, 0.13), &walls)?;
    // Long planks in staggered rows, of two shades.
    let mut planks = [Shapes::new(), Shapes::new()];
    let rows = generator.segments(72);
    let width = 2.0 * z / rows as f32;
    for row in 0..rows {
        let low = -z + row as f32 * width;
        let mut from = -x - generator.between(0.0, 1.2);
        while from < x {
            let to = from + 1.3;
            let shade = usize::from(generator.chance(0.4));
            let (left, right) = (from.max(-x) + 0.001, to.min(x) - 0.001);
            planks[shade].bevelled_slab(
                Vec3::new(left, -0.02, low + 0.001),
                Vec3::new(right, 0.0, low + width - 0.001),
                0.002,
            );
            from = to;
        }
    }
    generator.add_each("planks", &parquet, &planks)?;
    let mut bed = Shapes::new();
    bed.level(Vec2::new(x, z), -0.01);
    generator.add("floor bed", parquet[1], &bed)?;
    // Skirting and cornice, with a moulded section.
    let mut trim = Shapes::new();
    let section =
        [(0.0, 0.0), (0.07, 0.0), (0.07, 0.12), (0.03, 0.18), (0.0, 0.18)].map(|(a, b)| Vec2::new(a, b));
    for (y, flip) in [(0.0, 1.0), (HEIGHT, -1.0)] {
        for side in [-1.0_f32, 1.0] {
            let inward = Vec3::new(0.0, 0.0, -side);
            let frame = |x: f32| (Vec3::new(x, y, side * z), inward, Vec3::Y * flip);
            let ends = if inward.cross(Vec3::Y * flip).x > 0.0 { [-x, x] } else { [x, -x] };
            trim.sweep(&section, &ends.map(frame));
        }
    }
    generator.add("trim", matt(0.82, 0.8, 0.76), &trim)
}

/// Panes between thin bars, the panes left open for the light.
fn roof(generator: &mut Generator) -> Result<(), SceneError> {
    let mut edge = Shapes::new();
    for side in [-1.0_f32, 1.0] {
        let (low, high) = ((side * 2.6).min(side * HALF_WIDTH), (side * 2.6).max(side * HALF_WIDTH));
        edge.cuboid(Vec3::new(-HALF_LENGTH, HEIGHT, low), Vec3::new(HALF_LENGTH, HEIGHT + 0.2, high));
    }
    generator.add("ceiling", matt(0.85, 0.85, 0.85), &edge)?;
    let mut bars = Shapes::new();
    let ribs = generator.segments(60);
    let arc = generator.segments(24);
    let vault = |angle: f32, x: f32| Vec3::new(x, HEIGHT + 0.2 + 1.5 * angle.sin(), 2.6 * angle.cos());
    for rib in 0..=ribs {
        let x = -HALF_LENGTH + 2.0 * HALF_LENGTH * rib as f32 / ribs as f32;
        let line: Vec<Vec3> = (0..=arc).map(|index| vault(PI * index as f32 / arc as f32, x)).collect();
        bars.tube(&line, 0.018, 5);
    }
    for purlin in 0..=12 {
        let angle = PI * purlin as f32 / 12.0;
        let line: Vec<Vec3> = (0..=ribs)
            .map(|rib| vault(angle, -HALF_LENGTH + 2.0 * HALF_LENGTH * rib as f32 / ribs as f32))
            .collect();
        bars.tube(&line, 0.014, 4);
    }
    generator.add("roof bars", metal(0.3, 0.31, 0.33, 0.4), &bars)
}

/// One picture on a wall: the middle of its canvas, the direction to its right, and its size.
struct Hanging {
    middle: Vec3,
    right: Vec3,
    size: Vec2,
}

fn pictures(generator: &mut Generator) -> Result<(), SceneError> {
    let frames = generator.materials([
        metal(0.95, 0.7, 0.3, 0.25),
        polished(0.12, 0.06, 0.03, 0.25),
        metal(0.8, 0.8, 0.82, 0.2),
    ]);
    let paints: Vec<u32> =
        PAINTS.iter().map(|(r, g, b)| generator.material(polished(*r, *g, *b, 0.5))).collect();
    let wire = generator.material(steel());
    let mut wires = Shapes::new();
    let mut rails = Shapes::new();
    for side in [-1.0_f32, 1.0] {
        for (level, hang, rail) in [(0, 1.75, 2.95), (1, 4.75, 6.0)] {
            let rail_at = |x: f32| Vec3::new(x, rail, side * (HALF_WIDTH - 0.06));
            rails.rod(rail_at(-HALF_LENGTH + 0.2), rail_at(HALF_LENGTH - 0.2), 0.02, 8);
            let mut x = -HALF_LENGTH + 1.2;
            while x < HALF_LENGTH - 1.4 {
                let size = Vec2::new(generator.between(0.7, 1.7), generator.between(0.7, 1.5));
                let hanging = Hanging {
                    middle: Vec3::new(x + size.x * 0.5, hang, side * (HALF_WIDTH - 0.09)),
                    right: Vec3::new(-side, 0.0, 0.0),
                    size,
                };
                let material = frames[generator.below(frames.len())];
                frame(generator, &hanging, material)?;
                canvas(generator, &hanging, &paints)?;
                for end in [-0.35, 0.35] {
                    let top = hanging.middle + hanging.right * (size.x * end) + Vec3::Y * (size.y * 0.5);
                    wires.rod(top, rail_at(top.x), 0.004, 5);
                }
                x += size.x + generator.between(0.35, 0.6) + level as f32 * 0.2;
            }
        }
    }
    generator.add("wires", wire, &wires)?;
    generator.add("rails", wire, &rails)
}

/// A mitred frame with a hollow moulding and a row of beads along its inner edge.
fn frame(generator: &mut Generator, hanging: &Hanging, material: u32) -> Result<(), SceneError> {
    let front = hanging.right.cross(Vec3::Y);
    let mut shapes = Shapes::new();
    // Out from the canvas and forward from the wall; the first and last point lie on the back.
    let profile = [
        (0.0, -0.05),
        (0.0, 0.012),
        (0.012, 0.022),
        (0.022, 0.016),
        (0.04, 0.014),
        (0.06, 0.024),
        (0.074, 0.04),
        (0.09, 0.046),
        (0.104, 0.04),
        (0.11, 0.024),
        (0.11, -0.05),
    ];
    let half = hanging.size * 0.5;
    let corner = |index: usize, out: f32, forward: f32| {
        let (x, y) = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)][index % 4];
        hanging.middle
            + hanging.right * (x * (half.x + out))
            + Vec3::Y * (y * (half.y + out))
            + front * forward
    };
    let pieces = generator.segments(5);
    for side in 0..4 {
        for pair in profile.windows(2) {
            let [(out_a, fwd_a), (out_b, fwd_b)] = [pair[0], pair[1]];
            for piece in 0..pieces {
                let mix = |out, fwd, t: usize| {
                    corner(side, out, fwd).lerp(corner(side + 1, out, fwd), t as f32 / pieces as f32)
                };
                shapes.quad(
                    mix(out_b, fwd_b, piece),
                    mix(out_b, fwd_b, piece + 1),
                    mix(out_a, fwd_a, piece + 1),
                    mix(out_a, fwd_a, piece),
                );
            }
        }
        let (from, to) = (corner(side, 0.03, 0.02), corner(side + 1, 0.03, 0.02));
        let beads = ((from.distance(to) / 0.13) * generator.options.detail.min(4.0)).ceil() as usize;
        for bead in 0..beads {
            let middle = from.lerp(to, (bead as f32 + 0.5) / beads as f32);
            shapes.sphere(middle, 0.012, 6, 4);
        }
    }
    generator.add("frame", material, &shapes)
}

/// A picture of coloured rectangles, each split again until it is small.
fn canvas(generator: &mut Generator, hanging: &Hanging, paints: &[u32]) -> Result<(), SceneError> {
    let front = hanging.right.cross(Vec3::Y);
    let mut fields = vec![(Vec2::splat(-0.5), Vec2::splat(0.5))];
    for _ in 0..generator.below(9) + 3 {
        let (low, high) = fields.swap_remove(generator.below(fields.len()));
        let cut = generator.between(0.3, 0.7);
        let size = (high - low) * hanging.size;
        if size.x > size.y {
            let x = low.x + (high.x - low.x) * cut;
            fields.extend([(low, Vec2::new(x, high.y)), (Vec2::new(x, low.y), high)]);
        } else {
            let y = low.y + (high.y - low.y) * cut;
            fields.extend([(low, Vec2::new(high.x, y)), (Vec2::new(low.x, y), high)]);
        }
    }
    let mut shapes: Vec<Shapes> = vec![Shapes::new(); paints.len()];
    for (low, high) in fields {
        let paint = generator.below(paints.len());
        let at = |x: f32, y: f32| {
            hanging.middle + hanging.right * (x * hanging.size.x) + Vec3::Y * (y * hanging.size.y)
                - front * 0.02
        };
        shapes[paint].rectangle(low, high, at);
    }
    generator.add_each("canvas", paints, &shapes)
}

/// A walk along three sides of the room with a balustrade of turned rods.
fn balcony(generator: &mut Generator) -> Result<(), SceneError> {
    let brass = generator.material(brass());
    let deep = 1.1;
    let (x, z) = (HALF_LENGTH, HALF_WIDTH);
    let mut floor = Shapes::new();
    floor.cuboid(Vec3::new(-x, BALCONY - 0.15, -z), Vec3::new(x, BALCONY, -z + deep));
    floor.cuboid(Vec3::new(-x, BALCONY - 0.15, z - deep), Vec3::new(x, BALCONY, z));
    floor.cuboid(Vec3::new(x - deep, BALCONY - 0.15, -z + deep), Vec3::new(x, BALCONY, z - deep));
    generator.add("balcony", polished(0.3, 0.17, 0.08, 0.3), &floor)?;
    let (around, rows) = (generator.segments(8), generator.segments(9));
    let runs = [
        (Vec3::new(-x, BALCONY, -z + deep), Vec3::new(x - deep, BALCONY, -z + deep)),
        (Vec3::new(x - deep, BALCONY, -z + deep), Vec3::new(x - deep, BALCONY, z - deep)),
        (Vec3::new(x - deep, BALCONY, z - deep), Vec3::new(-x, BALCONY, z - deep)),
    ];
    for (from, to) in runs {
        let mut shapes = Shapes::new();
        let count = (from.distance(to) / 0.2) as usize;
        for index in 0..=count {
            let foot = from.lerp(to, index as f32 / count as f32);
            shapes.surface(around, rows, true, |u, v| {
                let radius = 0.011 + 0.012 * (PI * v).sin().powi(6) + 0.006 * (3.0 * PI * v).sin().powi(8);
                foot + on_circle(TAU * u, radius, v * 0.95)
            });
        }
        for height in [0.08, 0.95] {
            shapes.rod(
                from + Vec3::Y * height,
                to + Vec3::Y * height,
                if height > 0.5 { 0.03 } else { 0.012 },
                10,
            );
        }
        generator.add("balustrade", brass, &shapes)?;
    }
    Ok(())
}

/// A closed curve of wire that winds around a sphere, on a glass stand, with a bench on either side.
fn sculpture(generator: &mut Generator) -> Result<(), SceneError> {
    let along = generator.segments(36) * generator.segments(36);
    let line: Vec<Vec3> = (0..=along)
        .map(|index| {
            let t = TAU * index as f32 / along as f32;
            let (up, around) = ((17.0 * t).sin() * 1.3, 12.0 * t);
            let reach = (1.0 + 0.12 * (29.0 * t).sin()) * 0.95;
            Vec3::new(up.cos() * around.sin(), up.sin(), up.cos() * around.cos()) * reach + Vec3::Y * 1.95
        })
        .collect();
    let mut shapes = Shapes::new();
    shapes.tube(&line, 0.01, 6);
    generator.add("wire sculpture", metal(0.95, 0.5, 0.32, 0.15), &shapes)?;
    let mut block = Shapes::new();
    block.cuboid(Vec3::new(-0.45, 0.005, -0.45), Vec3::new(0.45, 0.9, 0.45));
    generator.add("glass stand", glass(0.92, 0.97, 0.95), &block)?;
    let mut benches = Shapes::new();
    for x in [-6.0, 6.0] {
        benches.cuboid(Vec3::new(x - 1.2, 0.4, -0.3), Vec3::new(x + 1.2, 0.52, 0.3));
        for (dx, dz) in [(-1.1, -0.25), (1.1, -0.25), (-1.1, 0.25), (1.1, 0.25)] {
            benches.rod(Vec3::new(x + dx, 0.0, dz), Vec3::new(x + dx, 0.4, dz), 0.025, 8);
        }
    }
    generator.add("benches", polished(0.1, 0.07, 0.05, 0.35), &benches)
}

fn spotlights(generator: &mut Generator) -> Result<(), SceneError> {
    let segments = generator.segments(10);
    let (mut bodies, mut bulbs) = (Shapes::new(), Shapes::new());
    for side in [-1.0_f32, 1.0] {
        for index in 0..8 {
            let x = -HALF_LENGTH + 2.0 + index as f32 * 3.7;
            let hook = Vec3::new(x, BALCONY - 0.15, side * (HALF_WIDTH - 1.0));
            let lamp = hook - Vec3::Y * 0.3;
            let aim = Vec3::new(0.0, -0.9, side * 0.6).normalize();
            bodies.rod(hook, lamp, 0.006, 5);
            bodies.rod(lamp, lamp + aim * 0.18, 0.05, segments);
            bulbs.sphere(lamp + aim * 0.14, 0.04, segments, segments / 2 + 1);
        }
    }
    generator.add("spotlights", Material { roughness: 0.5, ..matt(0.03, 0.03, 0.03) }, &bodies)?;
    generator.add("spotlight bulbs", glow(40.0, 32.0, 22.0), &bulbs)
}

//! Light that is hard to find: a night market under lanterns; a loft with two windows and a slit; a room that
//! is lit through a door.

use std::f32::consts::TAU;

use glam::{Vec2, Vec3};

use super::architecture::chequered;
use super::generator::{Generator, LightAndPath, key};
use super::palette::{brass, glow, matt, polished};
use crate::shapes::{Shapes, on_circle};
use crate::{SceneError, Sky};

/// Half the market's width, metres.
const MARKET: f32 = 30.0;
/// The loft: half width, height, half depth.
const LOFT: Vec3 = Vec3::new(4.0, 3.2, 5.0);
/// The angle by which the door of `doorway` stands open.
const AJAR_RAD: f32 = 0.7;

fn night(level: f32) -> Sky {
    Sky { horizon: Vec3::new(0.5, 0.55, 0.8) * level, zenith: Vec3::new(0.2, 0.3, 0.6) * level, sun: None }
}

/// Stalls in rows with lanterns over each, below a fifth of the detail over some. Lanterns are of many sizes
/// and colours.
pub(super) fn market(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let shades = generator.materials([matt(0.34, 0.3, 0.27), matt(0.22, 0.2, 0.19)]);
    let across = generator.segments(120);
    let step = Vec2::splat(2.0 * MARKET / across as f32);
    let tiles = chequered(Vec2::splat(-MARKET), [across; 2], step, 0.01);
    generator.add_each("paving", &shades, &tiles)?;
    let cloths = generator.materials([
        matt(0.6, 0.12, 0.1),
        matt(0.75, 0.68, 0.5),
        matt(0.12, 0.3, 0.38),
        polished(0.5, 0.35, 0.1, 0.4),
    ]);
    let lights = generator.materials([
        glow(30.0, 17.0, 7.0),
        glow(12.0, 13.0, 16.0),
        glow(40.0, 8.0, 3.0),
        glow(6.0, 18.0, 9.0),
    ]);
    let (mut posts, mut chains, mut heaps) = (Shapes::new(), Shapes::new(), Shapes::new());
    let mut canvas = [(); 4].map(|()| Shapes::new());
    let mut lanterns = [(); 4].map(|()| Shapes::new());
    let one_in = ((0.2 / generator.options.detail).round() as i32).max(1);
    for row in -5..=5 {
        for stall in -6..=6 {
            let foot = Vec3::new(row as f32 * 5.0, 0.0, stall as f32 * 4.2);
            let half = Vec3::new(generator.between(0.9, 1.3), generator.between(2.2, 2.9), 1.4);
            for (x, z) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                posts.rod(foot + half * Vec3::new(x, 0.0, z), foot + half * Vec3::new(x, 1.0, z), 0.05, 6);
            }
            posts.cuboid(foot + half * Vec3::new(-1.0, 0.32, -1.0), foot + half * Vec3::new(1.0, 0.36, 1.0));
            let sag = generator.between(0.1, 0.5);
            let steps = generator.segments(10);
            canvas[generator.below(4)].surface(steps, steps, false, |u, v| {
                let low = sag * (1.0 - (2.0 * u - 1.0).powi(2)) * (1.0 - (2.0 * v - 1.0).powi(2));
                foot + Vec3::new(2.0 * u - 1.0, 0.0, 2.0 * v - 1.0) * half * 1.1
                    + Vec3::Y * (half.y + 0.3 - low)
            });
            for _ in 0..generator.count(14) {
                let middle =
                    generator.within(half * Vec3::new(-0.9, 0.4, -0.9), half * Vec3::new(0.9, 0.44, 0.9));
                heaps.sphere(foot + middle, generator.between(0.06, 0.13), 8, 5);
            }
            let is_lit = ((row + 5) * 13 + stall + 6) % one_in == 0;
            let hooks = if is_lit { generator.count(5) } else { 0 };
            for _ in 0..hooks {
                let hook = foot + generator.within(Vec3::new(-2.2, 3.2, -2.0), Vec3::new(2.2, 4.6, 2.0));
                let lamp = hook - Vec3::Y * generator.between(0.5, 1.3);
                chains.rod(hook, lamp, 0.008, 3);
                lanterns[generator.below(4)].sphere(lamp, generator.between(0.03, 0.12), 4, 3);
            }
        }
    }
    generator.add("posts", matt(0.4, 0.26, 0.15), &posts)?;
    generator.add("chains", brass(), &chains)?;
    generator.add("fruit", polished(0.7, 0.3, 0.06, 0.25), &heaps)?;
    generator.add_each("canvas", &cloths, &canvas)?;
    generator.add_each("lanterns", &lights, &lanterns)?;
    let keys = vec![
        key([2.6, 1.7, 13.0], [2.2, 1.5, 0.0], 60.0),
        key([12.4, 4.4, 20.0], [0.0, 1.0, 0.0], 55.0),
        key([-7.6, 1.6, -9.0], [-2.0, 1.6, 2.0], 60.0),
        key([-2.4, 7.5, -24.0], [0.0, 0.5, 0.0], 50.0),
    ];
    Ok(LightAndPath { sky: night(0.004), keys })
}

/// A closed room with two small windows; behind a screen with a slit stands a lamp.
pub(super) fn loft(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let mut walls = Shapes::new();
    let thick = 0.25;
    let corner = |x: f32, y: f32, z: f32| Vec3::new(x, y, z) * LOFT;
    walls.cuboid(corner(-1.0, 0.0, -1.0) - Vec3::splat(thick), corner(1.0, 0.0, 1.0));
    walls.cuboid(corner(-1.0, 1.0, -1.0), corner(1.0, 1.0, 1.0) + Vec3::splat(thick));
    walls.cuboid(corner(-1.0, 0.0, -1.0) - Vec3::Z * thick, corner(1.0, 1.0, -1.0));
    walls.cuboid(corner(-1.0, 0.0, 1.0), corner(1.0, 1.0, 1.0) + Vec3::Z * thick);
    walls.cuboid(corner(-1.0, 0.0, -1.0) - Vec3::X * thick, corner(-1.0, 1.0, 1.0));
    // The wall with the windows, in bands around them.
    let (sill, head) = (0.42, 0.78);
    for (low, high) in [(-1.0, -0.62), (-0.44, 0.3), (0.48, 1.0)] {
        walls.cuboid(corner(1.0, sill, low), corner(1.0, head, high) + Vec3::X * thick);
    }
    walls.cuboid(corner(1.0, 0.0, -1.0), corner(1.0, sill, 1.0) + Vec3::X * thick);
    walls.cuboid(corner(1.0, head, -1.0), corner(1.0, 1.0, 1.0) + Vec3::X * thick);
    generator.add("walls", matt(0.75, 0.72, 0.66), &walls)?;
    let mut bars = Shapes::new();
    for (low, high) in [(-0.62, -0.44), (0.3, 0.48)] {
        let middle = (low + high) * 0.5;
        bars.rod(corner(1.02, sill, middle), corner(1.02, head, middle), 0.03, generator.segments(8));
        bars.rod(corner(1.02, 0.6, low), corner(1.02, 0.6, high), 0.03, generator.segments(8));
    }
    generator.add("window bars", matt(0.85, 0.85, 0.82), &bars)?;
    let mut floor = Shapes::new();
    let planks = generator.segments(36);
    for plank in 0..planks {
        let at = |edge: usize| -1.0 + 2.0 * edge as f32 / planks as f32;
        let high = 0.02 + generator.between(0.0, 0.004);
        floor.cuboid(corner(at(plank), 0.0, -1.0), corner(at(plank + 1) - 0.004, 0.0, 1.0) + Vec3::Y * high);
    }
    generator.add("planks", polished(0.45, 0.3, 0.18, 0.35), &floor)?;
    let mut panels = Shapes::new();
    for (low, high) in [(-0.98, -0.62), (-0.6, -0.2)] {
        panels.cuboid(corner(low, 0.0, -0.62), corner(high, 0.72, -0.6));
    }
    panels.cuboid(corner(-0.98, 0.72, -0.98), corner(-0.2, 0.74, -0.6));
    panels.cuboid(corner(-0.21, 0.0, -0.98), corner(-0.2, 0.72, -0.6));
    generator.add("screen", matt(0.5, 0.2, 0.16), &panels)?;
    let mut lamp = Shapes::new();
    lamp.sphere(corner(-0.6, 0.4, -0.85), 0.12, generator.segments(16), generator.segments(8));
    generator.add("lamp", glow(60.0, 44.0, 26.0), &lamp)?;
    let mut vases = Shapes::new();
    for index in 0..5 {
        let around = generator.segments(40);
        let foot = on_circle(TAU * index as f32 / 5.0, generator.between(0.8, 1.6), 0.02) + Vec3::Z;
        let belly = generator.between(0.12, 0.3);
        let profile = [(0.6, 0.0), (1.0, 0.8), (0.9, 1.4), (0.35, 2.0), (0.5, 2.6)];
        vases.lathe(foot, &profile.map(|(radius, high)| Vec2::new(radius, high) * belly), around);
    }
    generator.add("vases", polished(0.1, 0.25, 0.45, 0.1), &vases)?;
    let keys = vec![
        key([-3.2, 1.7, 4.4], [1.2, 1.1, -1.4], 60.0),
        key([-3.4, 1.6, 0.6], [2.0, 1.2, 0.4], 60.0),
        key([0.4, 1.7, -2.6], [1.0, 1.3, 3.0], 60.0),
        key([3.2, 1.6, 4.2], [-1.6, 1.2, -3.2], 60.0),
    ];
    let sky = Sky { horizon: Vec3::new(2.4, 2.5, 2.7), zenith: Vec3::new(1.0, 1.5, 2.8), sun: None };
    Ok(LightAndPath { sky, keys })
}

/// Two rooms without windows. Lamps hang in one; the other has what light comes through a door that is ajar.
pub(super) fn doorway(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let at = Vec3::new;
    let mut walls = Shapes::new();
    for (low, high) in [
        (at(-5.2, -0.2, -3.2), at(5.2, 0.0, 3.2)),
        (at(-5.2, 2.8, -3.2), at(5.2, 3.0, 3.2)),
        (at(-5.2, 0.0, -3.2), at(-5.0, 2.8, 3.2)),
        (at(5.0, 0.0, -3.2), at(5.2, 2.8, 3.2)),
        (at(-5.0, 0.0, -3.2), at(5.0, 2.8, -3.0)),
        (at(-5.0, 0.0, 3.0), at(5.0, 2.8, 3.2)),
        // The wall between the rooms, on both sides of the door and above it.
        (at(-0.15, 0.0, -3.0), at(0.0, 2.8, -0.5)),
        (at(-0.15, 0.0, 0.5), at(0.0, 2.8, 3.0)),
        (at(-0.15, 2.1, -0.5), at(0.0, 2.8, 0.5)),
    ] {
        walls.cuboid(low, high);
    }
    generator.add("walls", matt(0.74, 0.7, 0.63), &walls)?;
    let (sin, cos) = AJAR_RAD.sin_cos();
    let section = [(0.0, 0.0), (0.99, 0.0), (0.99, 0.04), (0.0, 0.04)].map(|(x, y)| Vec2::new(x, y));
    let end = |high: f32| (at(0.0, high, -0.495), at(sin, 0.0, cos), at(cos, 0.0, -sin));
    let mut leaf = Shapes::new();
    leaf.sweep(&section, &[end(0.03), end(2.09)]);
    generator.add("door", polished(0.62, 0.56, 0.45, 0.4), &leaf)?;
    let (mut globes, mut rods) = (Shapes::new(), Shapes::new());
    for z in [-1.6, 0.0, 1.6] {
        let lamp = at(-2.6, 2.0, z);
        globes.sphere(lamp, 0.15, generator.segments(16), generator.segments(8));
        rods.rod(lamp.with_y(2.14), lamp.with_y(2.8), 0.01, 4);
    }
    generator.add("lamps", glow(70.0, 58.0, 42.0), &globes)?;
    generator.add("lamp rods", brass(), &rods)?;
    furniture(generator)?;
    let keys = vec![
        key([4.5, 1.6, -2.5], [1.2, 1.0, 1.0], 60.0),
        key([4.4, 1.7, 2.3], [0.0, 1.1, 0.2], 60.0),
        key([3.6, 1.5, -1.0], [0.9, 1.1, 2.8], 60.0),
        key([0.9, 1.6, -2.4], [3.2, 0.9, 1.6], 60.0),
    ];
    Ok(LightAndPath { sky: Sky::BLACK, keys })
}

/// Planks, a table with vases and a bookcase behind the door.
fn furniture(generator: &mut Generator) -> Result<(), SceneError> {
    let at = Vec3::new;
    let (mut floor, mut table, mut vases) = (Shapes::new(), Shapes::new(), Shapes::new());
    let planks = generator.segments(40);
    let wide = 5.0 / planks as f32;
    for plank in 0..planks {
        let left = plank as f32 * wide;
        let high = 0.02 + generator.between(0.0, 0.004);
        floor.cuboid(at(left, 0.0, -3.0), at(left + wide - 0.01, high, 3.0));
    }
    generator.add("planks", polished(0.45, 0.3, 0.18, 0.35), &floor)?;
    table.cuboid(at(2.0, 0.72, 0.6), at(3.4, 0.76, 1.8));
    for (x, z) in [(2.08, 0.68), (3.32, 0.68), (3.32, 1.72), (2.08, 1.72)] {
        table.rod(at(x, 0.0, z), at(x, 0.72, z), 0.03, 8);
    }
    for index in 0..4 {
        let foot = on_circle(TAU * index as f32 / 4.0, 0.35, 0.76) + at(2.7, 0.0, 1.2);
        let belly = generator.between(0.07, 0.12);
        let profile = [(0.6, 0.0), (1.0, 0.8), (0.9, 1.4), (0.35, 2.0), (0.5, 2.6)];
        vases.lathe(
            foot,
            &profile.map(|(radius, high)| Vec2::new(radius, high) * belly),
            generator.segments(40),
        );
    }
    generator.add("vases", polished(0.1, 0.25, 0.45, 0.1), &vases)?;
    let covers =
        generator.materials([matt(0.5, 0.12, 0.1), matt(0.14, 0.26, 0.4), polished(0.6, 0.5, 0.3, 0.4)]);
    let mut books = [(); 3].map(|()| Shapes::new());
    for x in [0.57, 2.4] {
        table.cuboid(at(x, 0.0, 2.68), at(x + 0.03, 2.2, 3.0));
    }
    for shelf in 0..5 {
        let high = 0.1 + 0.42 * shelf as f32;
        table.cuboid(at(0.6, high - 0.03, 2.68), at(2.4, high, 3.0));
        let count = generator.count(32);
        let wide = 1.8 / count as f32;
        for book in 0..count {
            let left = 0.6 + wide * book as f32;
            let (front, top) = (generator.between(2.7, 2.76), high + generator.between(0.2, 0.34));
            books[generator.below(3)].cuboid(at(left, high, front), at(left + wide * 0.95, top, 2.98));
        }
    }
    generator.add("table and bookcase", matt(0.4, 0.26, 0.15), &table)?;
    generator.add_each("books", &covers, &books)
}

//! A landscape of cubes: hills and ridges, a lake, caves with glowing stones, woods, and a keep.
//!
//! After the kind of world that the paper's scene "vokselia" shows: very many axis-aligned faces of a few
//! sizes, much of them hidden below ground.

use std::f32::consts::TAU;

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::{at_cell, gradient, octaves, ridges};
use super::palette::{glow, matt, polished};
use super::voxel_mesh::{AIR, Grid};
use crate::{Camera, Material, SceneError};

/// Cubes along one side of the world at full detail.
const SIDE: f32 = 252.0;
const HEIGHT: i32 = 96;
const WATER_LEVEL: i32 = 27;
/// Meshes are cut into blocks of this side.
const BLOCK: i32 = 64;
const GRASS: u8 = 1;
const EARTH: u8 = 2;
const ROCK: u8 = 3;
const SAND: u8 = 4;
const WATER: u8 = 5;
const SNOW: u8 = 6;
const WOOD: u8 = 7;
const LEAVES: u8 = 8;
const AUTUMN: u8 = 9;
const BRICK: u8 = 10;
const ROOF: u8 = 11;
const LIGHT: u8 = 12;
const PLANK: u8 = 13;

/// Names and materials of the kinds, from number 1 on.
fn kinds() -> [(&'static str, Material); 13] {
    [
        ("grass", matt(0.14, 0.29, 0.06)),
        ("earth", matt(0.3, 0.19, 0.1)),
        ("rock", matt(0.27, 0.26, 0.25)),
        ("sand", matt(0.76, 0.66, 0.42)),
        ("water", polished(0.04, 0.17, 0.27, 0.06)),
        ("snow", polished(0.9, 0.92, 0.95, 0.6)),
        ("wood", matt(0.24, 0.14, 0.07)),
        ("leaves", matt(0.07, 0.2, 0.045)),
        ("autumn leaves", matt(0.62, 0.26, 0.05)),
        ("brick", matt(0.55, 0.5, 0.44)),
        ("roof", matt(0.5, 0.12, 0.08)),
        ("glowing stone", glow(14.0, 9.0, 4.0)),
        ("planks", matt(0.5, 0.34, 0.18)),
    ]
}

/// Height of the ground, in cubes.
fn ground(seed: u64, x: i32, z: i32) -> i32 {
    let at = Vec3::new(x as f32, 0.0, z as f32);
    let hills = octaves(seed, at / 88.0, 5) * 26.0;
    let peaks = (ridges(seed + 77, at / 150.0, 4) - 0.5).max(0.0) * 120.0;
    ((31.0 + hills + peaks) as i32).clamp(6, HEIGHT - 16)
}

/// The material at a depth of a column, caves aside.
fn layer(seed: u64, x: i32, z: i32, y: i32, top: i32) -> u8 {
    let rough = (at_cell(seed + 5, i64::from(x), 0, i64::from(z)) * 4.0) as i32;
    match top - y {
        0 if top <= WATER_LEVEL + 1 => SAND,
        0 if top > 66 + rough => SNOW,
        0 if top > 54 + rough => ROCK,
        0 => GRASS,
        1..=3 if top <= WATER_LEVEL + 1 => SAND,
        1..=3 if top <= 54 + rough => EARTH,
        _ => ROCK,
    }
}

/// Whether a place below ground is hollow: tunnels where two noises are near zero, chambers by a third.
fn hollow(seed: u64, x: i32, y: i32, z: i32) -> bool {
    let at = Vec3::new(x as f32, y as f32 * 1.6, z as f32);
    let tunnel = gradient(seed + 21, at / 27.0).abs() < 0.085 && gradient(seed + 22, at / 27.0).abs() < 0.085;
    tunnel || octaves(seed + 23, at / 34.0, 2) > 0.37
}

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let seed = generator.options.seed;
    let side = ((SIDE * generator.options.detail.sqrt()).round() as i32).max(48);
    let mut grid = Grid::new(IVec3::new(side, HEIGHT, side));
    grid.columns_mut().enumerate().for_each(|(index, column)| {
        let (x, z) = (index as i32 / side, index as i32 % side);
        fill_column(seed, x, z, column);
    });
    plant_trees(seed, &mut grid);
    let keep = build_keep(seed, &mut grid);
    let kinds = kinds().map(|(name, material)| (name, generator.material(material)));
    let blocks: Vec<IVec3> = (0..side)
        .step_by(BLOCK as usize)
        .flat_map(|x| (0..side).step_by(BLOCK as usize).map(move |z| IVec3::new(x, 0, z)))
        .collect();
    // Blocks are meshed in parallel and added in order.
    let surfaces: Vec<_> = blocks
        .par_iter()
        .map(|low| grid.surface(*low, (*low + IVec3::new(BLOCK, HEIGHT, BLOCK)).min(grid.size())))
        .collect();
    for (kind, part) in surfaces.into_iter().flatten() {
        let (name, material) = kinds[usize::from(kind) - 1];
        generator.add_part(name, material, &part)?;
    }
    let sky = sunny([0.22, 0.42, 0.85], [0.62, 0.68, 0.76], [-0.62, 0.5, 0.42], [3.3, 2.6, 1.8]);
    Ok(LightAndPath { sky, keys: keys(seed, side, keep) })
}

/// A round flight about the keep, high enough everywhere to see it over the hills and woods.
fn keys(seed: u64, side: i32, keep: IVec3) -> Vec<Camera> {
    let look = keep.as_vec3() + Vec3::new(0.0, 12.0, 0.0);
    let distances = [74.0, 66.0, 78.0, 70.0, 60.0, 72.0, 68.0_f32];
    let last = distances.len() as f32;
    let key_at = |(index, distance): (usize, &f32)| {
        let (sin, cos) = (-0.62 + TAU * index as f32 / last).sin_cos();
        let edge = side as f32 - 4.0;
        let x = (look.x + sin * distance.min(edge)).clamp(4.0, edge);
        let z = (look.z + cos * distance.min(edge)).clamp(4.0, edge);
        // The height at which the line of sight clears the ground and the trees on it, all along.
        let mut y = look.y + 10.0;
        for step in 0..24 {
            let share = step as f32 / 32.0;
            let (at_x, at_z) = (x + (look.x - x) * share, z + (look.z - z) * share);
            let top = ground(seed, at_x as i32, at_z as i32).max(WATER_LEVEL) as f32 + 12.0;
            y = y.max((top - look.y * share) / (1.0 - share));
        }
        key([x, y.min(look.y + 70.0), z], look.to_array(), 48.0)
    };
    distances.iter().enumerate().map(key_at).collect()
}

fn fill_column(seed: u64, x: i32, z: i32, column: &mut [u8]) {
    let top = ground(seed, x, z);
    for y in 0..=top.max(WATER_LEVEL) {
        column[y as usize] = if y > top {
            WATER
        } else if y > 1 && (top > WATER_LEVEL + 2 || y < top - 5) && hollow(seed, x, y, z) {
            let floor_below = !hollow(seed, x, y - 1, z);
            let glows = at_cell(seed + 31, i64::from(x), i64::from(y), i64::from(z)) < 0.006;
            if floor_below && glows && y < top - 3 { LIGHT } else { AIR }
        } else {
            layer(seed, x, z, y, top)
        };
    }
}

fn plant_trees(seed: u64, grid: &mut Grid) {
    const SPACING: i32 = 8;
    let size = grid.size();
    for cell_x in 0..size.x / SPACING {
        for cell_z in 0..size.z / SPACING {
            let dice = |what: i64| at_cell(seed + 41, i64::from(cell_x), what, i64::from(cell_z));
            let x = cell_x * SPACING + 1 + (dice(0) * 6.0) as i32;
            let z = cell_z * SPACING + 1 + (dice(1) * 6.0) as i32;
            let wooded = 0.45 + octaves(seed + 42, Vec3::new(x as f32, 0.0, z as f32) / 60.0, 2) * 1.3;
            let top = ground(seed, x, z);
            if dice(2) > wooded || grid.get(IVec3::new(x, top, z)) != GRASS {
                continue;
            }
            let trunk = 4 + (dice(3) * 4.0) as i32;
            let leaves = if dice(4) < 0.14 { AUTUMN } else { LEAVES };
            let radius = 2.2 + dice(5) * 1.6;
            let crown = IVec3::new(x, top + trunk + 1, z);
            let reach = radius.ceil() as i32;
            for dx in -reach..=reach {
                for dy in -reach..=reach {
                    for dz in -reach..=reach {
                        let at = crown + IVec3::new(dx, dy, dz);
                        let distance = Vec3::new(dx as f32, dy as f32 * 1.2, dz as f32).length();
                        let frayed =
                            at_cell(seed + 43, i64::from(at.x), i64::from(at.y), i64::from(at.z)) * 1.1;
                        if distance + frayed < radius + 0.4 {
                            grid.fill(at, leaves);
                        }
                    }
                }
            }
            grid.set_box(IVec3::new(x, top + 1, z), IVec3::new(x, top + trunk, z), WOOD);
        }
    }
}

/// The evenest place near the middle of the world, a little above the water.
fn keep_site(seed: u64, side: i32) -> IVec3 {
    let mut best = (i32::MAX, IVec3::new(side / 2, WATER_LEVEL + 6, side / 2));
    let range = side * 3 / 10..side * 7 / 10;
    for x in range.clone().step_by(6) {
        for z in range.clone().step_by(6) {
            let reach = [-20, 0, 20];
            let heights = reach.iter().flat_map(|dx| reach.map(|dz| ground(seed, x + dx, z + dz)));
            let (low, high) =
                heights.fold((i32::MAX, 0), |(low, high), height| (low.min(height), high.max(height)));
            let level = ((low + high) / 2).max(WATER_LEVEL + 4);
            let badness = (high - low) * 2 + (level - 38).abs();
            if badness < best.0 {
                best = (badness, IVec3::new(x, level, z));
            }
        }
    }
    best.1
}

/// A walled keep on an even place; returns the middle of its yard.
fn build_keep(seed: u64, grid: &mut Grid) -> IVec3 {
    let yard = keep_site(seed, grid.size().x);
    let offset = |x: i32, y: i32, z: i32| yard + IVec3::new(x, y, z);
    grid.set_box(offset(-21, -14, -21), offset(21, -1, 21), ROCK);
    grid.set_box(offset(-21, 0, -21), offset(21, 0, 21), GRASS);
    grid.set_box(offset(-21, 1, -21), offset(21, 44, 21), AIR);
    grid.set_box(offset(-2, 0, -21), offset(2, 0, 21), PLANK);
    for along in -16..=16 {
        let high = if (along & 3) < 2 { 10 } else { 9 };
        for deep in 0..2 {
            for (x, z) in [(along, -16 + deep), (along, 16 - deep), (-16 + deep, along), (16 - deep, along)] {
                grid.set_box(offset(x, 1, z), offset(x, if deep == 0 { high } else { 8 }, z), BRICK);
            }
        }
        if along % 6 == 0 {
            for (x, z) in [(along, -13), (along, 13), (-13, along), (13, along)] {
                grid.set(offset(x, 1, z), WOOD);
                grid.set(offset(x, 2, z), LIGHT);
            }
        }
    }
    for side in [-17, 16] {
        grid.set_box(offset(-2, 1, side), offset(2, 5, side + 1), AIR);
    }
    for (x, z) in [(-16, -16), (-16, 16), (16, -16), (16, 16)] {
        round_tower(grid, offset(x, 0, z), 4, 15);
    }
    square_tower(grid, offset(0, 0, 0));
    yard
}

fn round_tower(grid: &mut Grid, foot: IVec3, radius: i32, height: i32) {
    for dx in -radius..=radius {
        for dz in -radius..=radius {
            let distance = ((dx * dx + dz * dz) as f32).sqrt();
            if distance > radius as f32 + 0.3 {
                continue;
            }
            let rim = distance > radius as f32 - 1.2;
            let high = height + i32::from(rim && (dx + dz) & 1 == 0);
            grid.set_box(foot + IVec3::new(dx, 1, dz), foot + IVec3::new(dx, high, dz), BRICK);
        }
    }
    grid.set(foot + IVec3::new(0, height + 1, 0), LIGHT);
    // A pointed roof on posts above the platform.
    for rise in 0..=radius + 1 {
        let reach = radius + 1 - rise;
        let y = height + 5 + rise;
        grid.set_box(foot + IVec3::new(-reach, y, -reach), foot + IVec3::new(reach, y, reach), ROOF);
    }
    for (x, z) in [(-3, -3), (-3, 3), (3, -3), (3, 3)] {
        grid.set_box(foot + IVec3::new(x, height + 1, z), foot + IVec3::new(x, height + 4, z), WOOD);
    }
}

fn square_tower(grid: &mut Grid, foot: IVec3) {
    grid.set_box(foot + IVec3::new(-6, 1, -6), foot + IVec3::new(6, 28, 6), BRICK);
    grid.set_box(foot + IVec3::new(-5, 1, -5), foot + IVec3::new(5, 28, 5), AIR);
    for floor in (0..28).step_by(7) {
        grid.set_box(foot + IVec3::new(-5, floor, -5), foot + IVec3::new(5, floor, 5), PLANK);
        grid.set(foot + IVec3::new(0, floor + 1, 0), LIGHT);
        for along in [-3, 0, 3] {
            for side in [-6, 6] {
                let (low, high) = (floor + 3, floor + 5);
                grid.set_box(foot + IVec3::new(along, low, side), foot + IVec3::new(along, high, side), AIR);
                grid.set_box(foot + IVec3::new(side, low, along), foot + IVec3::new(side, high, along), AIR);
            }
        }
    }
    for rise in 0..=8 {
        let reach = 8 - rise;
        let y = 29 + rise;
        grid.set_box(foot + IVec3::new(-reach, y, -reach), foot + IVec3::new(reach, y, reach), ROOF);
    }
}

//! A forest around a lake: ten million triangles, placed by some thousand instances of a few plants and
//! stones.
//!
//! Unique triangles stay below half a million: the ground, and three to four of each kind. Only the ground
//! and the water stand in the world itself.

mod plants;
mod trees;

use std::f32::consts::TAU;

use glam::{Affine3A, Mat3, Quat, Vec3};

use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::{octaves, ridges};
use super::palette::{matt, polished};
use crate::{SceneError, shapes::Shapes};

/// Edge of the ground, metres.
const GROUND: f32 = 210.0;
/// Height of the lake.
const WATER: f32 = -1.6;
/// Places looked at for each kind, at full detail: some are under water, too steep, or bare.
const TRIES: [usize; 3] = [900, 1_350, 3_400];
/// Trees keep so far from where the camera goes.
const PATH_CLEAR: f32 = 5.0;
/// Eye points of the camera path, seen from above.
const WALK: [[f32; 2]; 5] = [[4.0, 41.0], [-16.0, 38.0], [-34.0, 24.0], [-36.0, 2.0], [-24.0, -20.0]];

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let seed = generator.options.seed;
    ground(generator, seed)?;
    let trees = trees::species(generator)?;
    let bushes = plants::bushes(generator)?;
    let small = plants::undergrowth(generator)?;
    for (kind, objects) in [trees, bushes, small].into_iter().enumerate() {
        plant(generator, seed, kind, &objects);
    }
    let eye = |index: usize, up: f32| {
        let [x, z] = WALK[index];
        [x, height(seed, x, z).max(WATER) + up, z]
    };
    let sky = sunny([0.16, 0.31, 0.66], [0.52, 0.57, 0.62], [-0.62, 0.5, 0.12], [3.6, 3.0, 2.1]);
    let keys = vec![
        key(eye(0, 2.1), [-2.0, 2.4, -14.0], 50.0),
        key(eye(1, 2.4), [2.0, 2.0, -12.0], 52.0),
        key(eye(2, 3.4), [10.0, 1.0, -6.0], 54.0),
        key(eye(3, 2.2), [14.0, 2.0, 2.0], 54.0),
        key(eye(4, 2.2), [10.0, 3.0, 16.0], 56.0),
    ];
    Ok(LightAndPath { sky, keys })
}

/// Height of the ground: a basin in the middle, hills around it, higher to the north.
fn height(seed: u64, x: f32, z: f32) -> f32 {
    let at = Vec3::new(x, 0.0, z);
    let shore = 23.0 + 9.0 * octaves(seed + 7, at / 19.0, 3);
    let from_shore = Vec3::new(x * 0.8, 0.0, z).length() - shore;
    // Gently into the water, ever steeper away from it.
    let basin = if from_shore < 0.0 { from_shore * 0.16 } else { (from_shore * 0.05).powf(1.3) * 3.0 };
    let rise = (from_shore.max(0.0) / 70.0).min(1.0);
    let hills = octaves(seed + 8, at / 46.0, 4) * 9.0 * rise + 14.0 * rise * (-z / 120.0).clamp(0.0, 1.0);
    let rough = ridges(seed + 9, at / 7.0, 3) * 0.35 - 0.15;
    WATER + 0.45 + basin + hills + rough
}

/// The direction that points straight out of the ground.
fn upright(seed: u64, x: f32, z: f32) -> Vec3 {
    let step = 0.6;
    let slope = |dx: f32, dz: f32| height(seed, x + dx, z + dz) - height(seed, x - dx, z - dz);
    Vec3::new(-slope(step, 0.0), 2.0 * step, -slope(0.0, step)).normalize()
}

fn ground(generator: &mut Generator, seed: u64) -> Result<(), SceneError> {
    let side = generator.segments(210);
    let mut land = Shapes::new();
    land.surface(side, side, false, |u, v| {
        let (x, z) = ((u - 0.5) * GROUND, (0.5 - v) * GROUND);
        Vec3::new(x, height(seed, x, z), z)
    });
    generator.add("ground", matt(0.15, 0.16, 0.06), &land)?;
    let mut lake = Shapes::new();
    let waves = generator.segments(90);
    lake.surface(waves, waves, false, |u, v| {
        let (x, z) = ((u - 0.5) * 100.0, (0.5 - v) * 100.0);
        Vec3::new(x, WATER + 0.012 * octaves(seed + 11, Vec3::new(x * 0.9, 0.0, z * 0.5), 3), z)
    });
    generator.add("lake", polished(0.012, 0.03, 0.034, 0.03), &lake)?;
    // The ground ends somewhere: a skirt hides that it is thin.
    let mut skirt = Shapes::new();
    let half = GROUND * 0.5;
    skirt.open_cuboid(Vec3::new(-half, -60.0, -half), Vec3::new(half, -12.0, half), false);
    generator.add("rock below", matt(0.1, 0.1, 0.07), &skirt)
}

/// Where a plant of a kind may stand, and how often.
fn grows(seed: u64, kind: usize, x: f32, z: f32) -> bool {
    let above = height(seed, x, z) - WATER;
    let steep = upright(seed, x, z).y;
    let near_path = WALK
        .windows(2)
        .map(|pair| {
            let [a, b] = [pair[0], pair[1]].map(|[x, z]| Vec3::new(x, 0.0, z));
            let (at, along) = (Vec3::new(x, 0.0, z), b - a);
            let share = ((at - a).dot(along) / along.length_squared()).clamp(0.0, 1.0);
            at.distance(a + along * share)
        })
        .fold(f32::INFINITY, f32::min);
    let dense = octaves(seed + 20 + kind as u64, Vec3::new(x, 0.0, z) / 24.0, 2);
    match kind {
        0 => above > 0.9 && steep > 0.72 && near_path > PATH_CLEAR && dense > -0.28,
        1 => above > 0.35 && steep > 0.7 && near_path > PATH_CLEAR * 0.6 && dense > -0.1,
        _ => above > 0.06 && near_path > 1.2 && dense > -0.25,
    }
}

/// Places one kind of plant: a shaken grid, thinner where the ground does not suit it.
fn plant(generator: &mut Generator, seed: u64, kind: usize, objects: &[u32]) {
    // Detail is shared between finer plants and more of them.
    let tries = (TRIES[kind] as f32 * generator.options.detail.sqrt()).max(24.0);
    // Small plants are only worth it where they stand out from the ground.
    let reach = GROUND * if kind == 2 { 0.31 } else { 0.485 };
    let side = tries.sqrt().ceil() as usize;
    for cell in 0..side * side {
        let shaken = |index: usize, by: f32| ((index as f32 + by) / side as f32 * 2.0 - 1.0) * reach;
        let (dx, dz) = (generator.between(0.05, 0.95), generator.between(0.05, 0.95));
        let (x, z) = (shaken(cell % side, dx), shaken(cell / side, dz));
        let (which, turn, size) =
            (generator.below(objects.len()), generator.between(0.0, TAU), generator.between(0.0, 1.0));
        let lean = generator.between(-0.05, 0.05);
        if !grows(seed, kind, x, z) {
            continue;
        }
        // Trees stand up straight, low plants lie along the ground.
        let out = if kind == 0 { Vec3::Y } else { upright(seed, x, z) };
        let turned =
            Quat::from_rotation_arc(Vec3::Y, out) * Quat::from_rotation_y(turn) * Quat::from_rotation_x(lean);
        let scale = [0.72, 0.7, 0.6][kind] + [0.5, 0.7, 0.9][kind] * size;
        // Some are wider than high and some slender, so that no two look alike.
        let spread = 1.0 + 0.16 * (turn * 7.0).sin();
        let linear = Mat3::from_quat(turned) * Mat3::from_diagonal(Vec3::new(spread, 1.0, spread) * scale);
        let foot = Vec3::new(x, height(seed, x, z) - 0.05, z);
        generator.assembler.place(objects[which], Affine3A::from_mat3_translation(linear, foot));
    }
}

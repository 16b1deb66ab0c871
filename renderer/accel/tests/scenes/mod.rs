//! Procedural triangles and rays for tests and measurements, all from seeds.

#![allow(dead_code, reason = "each test uses some of them")]

pub(crate) mod back_ends;
pub(crate) mod verdict;

use std::{f32::consts::TAU, sync::Arc};

use glam::{BVec3A, Vec3, Vec3A};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_accel::{Hit, Ray, Triangles};

pub(crate) fn random(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub(crate) fn in_cube(random: &mut ChaCha8Rng) -> Vec3A {
    Vec3A::new(random.random_range(-1.0..1.0), random.random_range(-1.0..1.0), random.random_range(-1.0..1.0))
}

/// A direction of even distribution.
pub(crate) fn on_sphere(random: &mut ChaCha8Rng) -> Vec3 {
    let z = random.random_range(-1.0f32..1.0);
    let (sin, cos) = (random.random_range(0.0..TAU)).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * cos, r * sin, z)
}

/// Triangles that share no corner.
pub(crate) fn separate(corners: impl IntoIterator<Item = [Vec3A; 3]>) -> Arc<Triangles> {
    let positions: Vec<Vec3A> = corners.into_iter().flatten().collect();
    let indices =
        (0..positions.len() as u32 / 3).map(|first| [3 * first, 3 * first + 1, 3 * first + 2]).collect();
    Arc::new(Triangles::new(positions, indices).expect("the scene is valid"))
}

/// Random triangles in the cube, of edge lengths around `size`.
pub(crate) fn soup(count: usize, size: f32, seed: u64) -> Arc<Triangles> {
    let mut random = random(seed);
    separate((0..count).map(|_| {
        let center = in_cube(&mut random);
        [center, center + in_cube(&mut random) * size, center + in_cube(&mut random) * size]
    }))
}

/// Long thin triangles through the cube.
pub(crate) fn needles(count: usize, seed: u64) -> Arc<Triangles> {
    let mut random = random(seed);
    separate((0..count).map(|_| {
        let (from, to) = (in_cube(&mut random), in_cube(&mut random));
        [from, to, to + in_cube(&mut random) * 0.01]
    }))
}

/// A surface of `2 * side * side` triangles over the square from -1 to 1, `height` above y = 0.
pub(crate) fn surface(side: u32, height: impl Fn(f32, f32) -> f32) -> Arc<Triangles> {
    let at = |i: u32| i as f32 / side as f32 * 2.0 - 1.0;
    let positions = (0..=side)
        .flat_map(|i| (0..=side).map(move |j| (i, j)))
        .map(|(i, j)| Vec3A::new(at(i), height(at(i), at(j)), at(j)))
        .collect();
    let corner = |i: u32, j: u32| i * (side + 1) + j;
    let indices = (0..side)
        .flat_map(|i| (0..side).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    Arc::new(Triangles::new(positions, indices).expect("the scene is valid"))
}

pub(crate) fn hills(side: u32) -> Arc<Triangles> {
    surface(side, |x, z| 0.1 * (9.0 * x).sin() * (7.0 * z).cos() + 0.02 * (61.0 * x + 13.0 * z).sin())
}

/// Blocks of random heights on a ground of two triangles; twelve triangles a block and finer `detail`.
pub(crate) fn city(side: u32, seed: u64) -> Arc<Triangles> {
    let mut random = random(seed);
    let mut corners = vec![
        [Vec3A::new(-1.0, 0.0, -1.0), Vec3A::new(1.0, 0.0, -1.0), Vec3A::new(1.0, 0.0, 1.0)],
        [Vec3A::new(-1.0, 0.0, -1.0), Vec3A::new(1.0, 0.0, 1.0), Vec3A::new(-1.0, 0.0, 1.0)],
    ];
    let cell = 2.0 / side as f32;
    for i in 0..side {
        for j in 0..side {
            let lower = Vec3A::new(-1.0 + cell * (i as f32 + 0.15), 0.0, -1.0 + cell * (j as f32 + 0.15));
            let size = Vec3A::new(0.7 * cell, random.random_range(0.5..8.0) * cell, 0.7 * cell);
            corners.extend(block(lower, lower + size));
        }
    }
    separate(corners)
}

/// The twelve triangles of a box.
fn block(lower: Vec3A, upper: Vec3A) -> impl Iterator<Item = [Vec3A; 3]> {
    const FACES: [[usize; 4]; 6] =
        [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let corner = move |number: usize| {
        let is_upper = BVec3A::new(number & 1 != 0, number & 2 != 0, number & 4 != 0);
        Vec3A::select(is_upper, upper, lower)
    };
    FACES.into_iter().flat_map(move |[a, b, c, d]| [[a, b, c], [a, c, d]].map(|face| face.map(corner)))
}

/// Rays from inside and outside the cube in all directions, some of them short.
pub(crate) fn rays(count: usize, seed: u64) -> Vec<Ray> {
    let mut random = random(seed);
    (0..count)
        .map(|number| Ray {
            origin: Vec3::from(in_cube(&mut random)) * if number % 2 == 0 { 1.0 } else { 3.0 },
            direction: on_sphere(&mut random) * random.random_range(0.1..4.0),
            t_min: if number % 3 == 0 { 0.05 } else { 0.0 },
            t_max: if number % 5 == 0 { random.random_range(0.1..2.0) } else { f32::INFINITY },
        })
        .collect()
}

/// Invalid rays: one broken number each of a good one.
pub(crate) fn invalid(good: Ray) -> Vec<Ray> {
    let mut rays = vec![
        Ray { direction: Vec3::ZERO, ..good },
        Ray { t_min: f32::NAN, ..good },
        Ray { t_max: f32::NAN, ..good },
        Ray { t_min: 2.0, t_max: 1.0, ..good },
        Ray { t_max: -1.0, ..good },
    ];
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in 0..3 {
            let (mut origin, mut direction) = (good.origin, good.direction);
            origin[axis] = bad;
            direction[axis] = bad;
            rays.extend([Ray { origin, ..good }, Ray { direction, ..good }]);
        }
    }
    rays
}

/// Whether two answers to a ray are both none, or of distances that differ by no more than this share.
pub(crate) fn same_distance(expected: Option<Hit>, found: Option<Hit>, tolerance: f32) -> bool {
    match (expected, found) {
        (None, None) => true,
        (Some(expected), Some(found)) => (expected.t - found.t).abs() <= tolerance * (1.0 + expected.t),
        _ => false,
    }
}

/// Whether rounding may decide about the ray where objects move or are placed.
pub(crate) fn is_close_call([a, b, c]: [Vec3A; 3], ray: &Ray, hit: &Hit) -> bool {
    let [a, b, c] = [a, b, c].map(Vec3A::as_dvec3);
    let (origin, direction) = (ray.origin.as_dvec3(), ray.direction.as_dvec3());
    let weights = [hit.u, hit.v, 1.0 - hit.u - hit.v].map(f64::from);
    let normal = (b - a).cross(c - a);
    let longest = (b - a).length().max((c - a).length()).max((c - b).length());
    let slant = (normal.dot(direction) / (normal.length() * direction.length())).abs();
    // How far the hit is inside the triangle, as the ray sees it.
    let inside = weights.into_iter().fold(f64::INFINITY, f64::min) * normal.length() / longest * slant;
    let reach = origin.length() + a.length() + b.length() + c.length();
    let t = f64::from(hit.t);
    let ends = (t - f64::from(ray.t_min)).abs().min((t - f64::from(ray.t_max)).abs());
    inside < 2e-5 * reach || ends < 1e-4 * (1.0 + t)
}

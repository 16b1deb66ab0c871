//! A robed figure, one finely displaced surface, under a dome whose open eye lets the sun in.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::{octaves, ridges};
use super::palette::{brass, glow, matt, polished};
use crate::SceneError;
use crate::shapes::{Shapes, on_circle};

/// Height of the figure, metres.
const FIGURE: f32 = 3.6;
/// Top of the pedestal.
const PEDESTAL: f32 = 1.25;
/// Inner radius of the room.
const ROOM: f32 = 7.0;
/// Height of the drum below the dome.
const DRUM: f32 = 6.0;
/// Radius of the eye of the dome.
const EYE: f32 = 2.5;

/// The figure's outline: share of its height, half width, half depth.
const OUTLINE: [(f32, f32, f32); 17] = [
    (0.0, 0.64, 0.6),
    (0.05, 0.6, 0.56),
    (0.2, 0.5, 0.46),
    (0.36, 0.45, 0.4),
    (0.47, 0.42, 0.34),
    (0.57, 0.33, 0.26),
    (0.66, 0.41, 0.29),
    (0.73, 0.47, 0.28),
    (0.775, 0.43, 0.25),
    (0.8, 0.26, 0.19),
    (0.825, 0.135, 0.14),
    (0.85, 0.13, 0.14),
    (0.88, 0.17, 0.195),
    (0.92, 0.205, 0.235),
    (0.96, 0.195, 0.225),
    (0.985, 0.12, 0.14),
    (1.0, 0.012, 0.014),
];

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    figure(generator)?;
    pedestal(generator)?;
    rotunda(generator)?;
    sconces(generator)?;
    let sky = sunny([1.6, 2.2, 3.2], [1.6, 2.0, 2.6], [0.07, 0.98, 0.16], [7.5, 6.6, 5.2]);
    let keys = vec![
        key([2.5, 2.2, 4.9], [0.0, 3.0, 0.0], 44.0),
        key([4.9, 1.9, 2.8], [0.0, 2.9, 0.0], 48.0),
        key([4.2, 3.4, -1.6], [0.0, 3.4, 0.0], 50.0),
        key([1.0, 4.6, -3.4], [0.0, 3.8, 0.0], 52.0),
        key([-3.6, 3.2, -1.0], [0.0, 3.6, 0.0], 50.0),
        key([-3.4, 2.6, 3.4], [0.0, 3.2, 0.0], 48.0),
        key([-0.6, 4.2, 2.2], [0.0, 4.3, 0.0], 46.0),
    ];
    Ok(LightAndPath { sky, keys })
}

/// Half width and half depth at a share of the height (cubic Hermite with central slopes).
fn outline(v: f32) -> Vec2 {
    let last = OUTLINE.len() - 1;
    let index = OUTLINE.windows(2).position(|pair| v <= pair[1].0).unwrap_or(last - 1);
    let at = |index: usize| Vec2::new(OUTLINE[index].1, OUTLINE[index].2);
    let slope = |index: usize| {
        let (before, after) = (index.saturating_sub(1), (index + 1).min(last));
        (at(after) - at(before)) / (OUTLINE[after].0 - OUTLINE[before].0)
    };
    let span = OUTLINE[index + 1].0 - OUTLINE[index].0;
    let t = ((v - OUTLINE[index].0) / span).clamp(0.0, 1.0);
    let (t2, t3) = (t * t, t * t * t);
    at(index) * (2.0 * t3 - 3.0 * t2 + 1.0)
        + slope(index) * (span * (t3 - 2.0 * t2 + t))
        + at(index + 1) * (3.0 * t2 - 2.0 * t3)
        + slope(index + 1) * (span * (t3 - t2))
}

/// Rises from 0 to 1 between two values.
fn step(low: f32, high: f32, value: f32) -> f32 {
    let t = ((value - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Height of the relief at an angle (0 is the front) and a share of the statue's height.
fn relief(seed: u64, angle: f32, v: f32, at: Vec3) -> f32 {
    let robe = 1.0 - step(0.74, 0.8, v);
    let wander = octaves(seed + 1, Vec3::new(at.x * 1.1, v * 2.2, at.z * 1.1), 3);
    // Folds hang from the girdle, deeper towards the hem; above it they run across the chest.
    let hang = step(0.58, 0.1, v);
    let below =
        (angle * 9.0 + wander * 5.5 + v * 2.0).sin() * 0.5 + (angle * 17.0 - wander * 7.0).sin() * 0.22;
    let above = (v * 62.0 + angle * 3.0 * angle.cos() + wander * 6.0).sin() * 0.5;
    let is_above = step(0.555, 0.6, v);
    let folds = robe * ((1.0 - is_above) * below * (0.018 + 0.055 * hang) + is_above * above * 0.016);
    let girdle =
        0.028 * (-((v - 0.565) / 0.012).powi(2)).exp() * (1.0 + 0.3 * (angle * 60.0 + v * 900.0).sin());
    // Locks cover the head but for the face.
    let front = angle.cos();
    let face = step(0.35, 0.75, front) * step(0.995, 0.94, v);
    let hair = step(0.855, 0.9, v) * (1.0 - face);
    let locks = hair * (0.03 + 0.035 * (ridges(seed + 2, at * 9.0, 3) - 0.5));
    let profile = face * features(angle, v);
    let cloth = ridges(seed + 3, at * 7.0, 6) * 0.012 + octaves(seed + 4, at * 34.0, 4) * 0.0035;
    let skin = octaves(seed + 5, at * 60.0, 3) * 0.0012;
    folds + girdle + locks + profile + cloth * robe + skin * (1.0 - robe)
}

/// Nose, brow, eyes, mouth and chin, as heights over the face.
fn features(angle: f32, v: f32) -> f32 {
    let side = angle.sin();
    let bump = |x: f32, y: f32, wide: f32, high: f32| {
        (-((side - x) / wide).powi(2) - ((v - y) / high).powi(2)).exp()
    };
    let nose = 0.055 * bump(0.0, 0.905, 0.1, 0.011) + 0.03 * bump(0.0, 0.917, 0.07, 0.012);
    let brow = 0.02 * (bump(0.32, 0.931, 0.2, 0.005) + bump(-0.32, 0.931, 0.2, 0.005));
    let eyes = -0.022 * (bump(0.32, 0.92, 0.16, 0.006) + bump(-0.32, 0.92, 0.16, 0.006));
    let lips = 0.016 * (bump(0.0, 0.8885, 0.2, 0.003) + bump(0.0, 0.8835, 0.17, 0.003));
    nose + brow + eyes + lips + 0.02 * bump(0.0, 0.871, 0.2, 0.006)
}

fn figure(generator: &mut Generator) -> Result<(), SceneError> {
    let marble = generator.material(polished(0.86, 0.82, 0.76, 0.45));
    let seed = generator.options.seed;
    let (around, rows) = (generator.segments(780), generator.segments(560));
    let mut body = Shapes::new();
    body.surface(around, rows, true, |u, v| {
        let angle = TAU * u;
        let half = outline(v);
        let (sin, cos) = angle.sin_cos();
        // The figure leans on one leg and turns its shoulders and head against it.
        let sway = Vec3::new(0.07 * (PI * v * 1.5).sin(), 0.0, 0.05 * (PI * v).sin() - 0.02);
        let turn = 0.35 * step(0.3, 0.95, v);
        let (turn_sin, turn_cos) = turn.sin_cos();
        let at = Vec3::new(sin * half.x, v * FIGURE, cos * half.y);
        let out = Vec3::new(sin * half.y, 0.0, cos * half.x).normalize_or(Vec3::Z);
        let fade = step(1.0, 0.985, v);
        let moved = at + out * (relief(seed, angle - TAU * (angle / TAU).round(), v, at) * fade);
        let turned = Vec3::new(
            moved.x * turn_cos + moved.z * turn_sin,
            moved.y,
            moved.z * turn_cos - moved.x * turn_sin,
        );
        turned + sway + Vec3::Y * PEDESTAL
    });
    generator.add("figure", marble, &body)?;
    for side in [-1.0, 1.0] {
        arm(generator, seed, side, marble)?;
    }
    Ok(())
}

/// A sleeved arm from the shoulder over the elbow to the hands that meet before the waist.
fn arm(generator: &mut Generator, seed: u64, side: f32, material: u32) -> Result<(), SceneError> {
    let points = [
        Vec3::new(side * 0.34, 0.765, 0.05),
        Vec3::new(side * 0.5, 0.72, 0.04),
        Vec3::new(side * 0.585, 0.6, 0.06),
        Vec3::new(side * 0.45, 0.555, 0.27),
        Vec3::new(side * 0.17, 0.585, 0.43),
        Vec3::new(side * 0.02, 0.6, 0.45),
    ]
    .map(|point| Vec3::new(point.x, point.y * FIGURE, point.z));
    let widths = [0.13, 0.14, 0.125, 0.115, 0.07, 0.035];
    let at = |v: f32| {
        let along = v * (points.len() - 1) as f32;
        let index = (along as usize).min(points.len() - 2);
        let t = along - index as f32;
        let before = points[index.saturating_sub(1)];
        let after = points[(index + 2).min(points.len() - 1)];
        let (from, to) = (points[index], points[index + 1]);
        let smooth = (from * 2.0
            + (to - before) * t
            + (before * 2.0 - from * 5.0 + to * 4.0 - after) * (t * t)
            + (from * 3.0 - before - to * 3.0 + after) * (t * t * t))
            * 0.5;
        (smooth, widths[index] + (widths[index + 1] - widths[index]) * t)
    };
    let (around, rows) = (generator.segments(130), generator.segments(200));
    let mut shapes = Shapes::new();
    shapes.surface(around, rows, true, |u, v| {
        let (middle, width) = at(v);
        let along = (at((v + 0.01).min(1.0)).0 - at((v - 0.01).max(0.0)).0).normalize_or(Vec3::Y);
        let right = along.cross(Vec3::Z + Vec3::X * 0.3).normalize_or(Vec3::X);
        let up = along.cross(right);
        let (sin, cos) = (TAU * u).sin_cos();
        let out = right * cos + up * sin;
        let folds = (v * 46.0 + octaves(seed + 9, (middle + out) * 3.0, 3) * 7.0 + sin).sin() * 0.014;
        let fine = ridges(seed + 3, (middle + out * width) * 7.0, 6) * 0.012;
        middle + out * (width * step(1.0, 0.97, v) + (folds + fine) * step(1.0, 0.8, v)) + Vec3::Y * PEDESTAL
    });
    generator.add("arm", material, &shapes)
}

fn pedestal(generator: &mut Generator) -> Result<(), SceneError> {
    let around = generator.segments(96);
    let profile = [
        (1.75, 0.0),
        (1.75, 0.16),
        (1.45, 0.16),
        (1.45, 0.32),
        (1.15, 0.32),
        (1.08, 0.42),
        (0.98, 0.46),
        (0.92, 1.0),
        (0.98, 1.06),
        (1.08, 1.1),
        (1.08, PEDESTAL),
    ];
    let mut shapes = Shapes::new();
    shapes.turned(Vec3::ZERO, &profile, around);
    shapes.disc(Vec3::Y * PEDESTAL, 1.08, around);
    generator.add("pedestal", polished(0.22, 0.2, 0.19, 0.18), &shapes)
}

fn rotunda(generator: &mut Generator) -> Result<(), SceneError> {
    let tiles = generator.materials([polished(0.5, 0.42, 0.34, 0.2), polished(0.24, 0.12, 0.1, 0.2)]);
    // The drum is a wall of flat niches between half columns.
    let (around, rows) = (generator.segments(192), generator.segments(24));
    let mut drum = Shapes::new();
    drum.surface(around, rows, true, |u, v| {
        let bay = (u * 16.0).fract();
        let niche = step(0.2, 0.26, bay) * step(0.8, 0.74, bay) * step(0.12, 0.16, v) * step(0.82, 0.76, v);
        let half_column = (1.0 - ((bay - 0.5).abs() - 0.5).abs() / 0.1).max(0.0).sqrt();
        let radius = ROOM + 0.45 * niche - 0.22 * half_column;
        on_circle(-TAU * u, radius, v * DRUM)
    });
    generator.add("drum", matt(0.68, 0.56, 0.43), &drum)?;
    // Coffers in rings up to the eye, each a shallow box in the shell.
    let (around, rows) = (generator.segments(224), generator.segments(80));
    let mut dome = Shapes::new();
    let highest = (EYE / ROOM).acos();
    dome.surface(around, rows, true, |u, v| {
        let (column, row) = ((u * 28.0).fract(), (v * 5.6).fract());
        let inside = |t: f32| step(0.12, 0.2, t) * step(0.88, 0.8, t);
        let deep = if v < 0.9 { 0.28 * inside(column) * inside(row) } else { 0.0 };
        let (lift, out) = (v * highest).sin_cos();
        let (sin, cos) = (-TAU * u).sin_cos();
        let radius = ROOM + deep;
        Vec3::new(sin * out * radius, DRUM + lift * radius, cos * out * radius)
    });
    generator.add("dome", matt(0.7, 0.66, 0.6), &dome)?;
    let rings = generator.segments(14);
    let mut floor = [Shapes::new(), Shapes::new()];
    for ring in 0..rings {
        let (inner, outer) =
            (ROOM * 1.08 * ring as f32 / rings as f32, ROOM * 1.08 * (ring + 1) as f32 / rings as f32);
        let pieces = 8 + ring * 4;
        for piece in 0..pieces {
            let at = |radius: f32, index: usize| on_circle(TAU * index as f32 / pieces as f32, radius, 0.0);
            let shapes = &mut floor[(piece + ring) % 2];
            let [outer_a, outer_b] = [at(outer, piece), at(outer, piece + 1)];
            if ring == 0 {
                shapes.triangle(Vec3::ZERO, outer_a, outer_b);
            } else {
                shapes.quad(at(inner, piece), outer_a, outer_b, at(inner, piece + 1));
            }
        }
    }
    generator.add_each("floor", &tiles, &floor)
}

fn sconces(generator: &mut Generator) -> Result<(), SceneError> {
    let segments = generator.segments(16);
    let (mut bowls, mut flames) = (Shapes::new(), Shapes::new());
    for index in 0..8 {
        let foot = on_circle(TAU * (index as f32 + 0.5) / 8.0, ROOM - 0.55, 2.3);
        let bowl = [(0.02, -0.3), (0.03, -0.1), (0.12, -0.04), (0.17, 0.06)].map(|(r, y)| Vec2::new(r, y));
        bowls.lathe(foot, &bowl, segments);
        flames.sphere(foot + Vec3::Y * 0.1, 0.11, segments, segments / 2 + 2);
    }
    generator.add("sconces", brass(), &bowls)?;
    generator.add("sconce lights", glow(90.0, 62.0, 34.0), &flames)
}

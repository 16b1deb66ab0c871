//! A grove behind a wire fence: leaves, grass and wire are pictures on cards, cut out by their alpha.
//!
//! Foliage as in games and films: few triangles, each with many holes, so that most rays meet cards and go on
//! through them. All pictures are computed here.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::{octaves, ridges};
use crate::shapes::{Shapes, on_circle};
use crate::texture::{Encoding, Wrap};
use crate::{Material, SceneError, part::Part};

/// Edge of the ground, metres.
const GROUND: f32 = 46.0;
/// Trees and cards of each crown at full detail.
const TREES: usize = 44;
const CARDS: usize = 1_900;
/// Tufts of grass at full detail, each of two crossed cards.
const TUFTS: usize = 9_000;
/// Edge of the pictures in pixels.
const PICTURE: u32 = 256;
/// Where the fence stands.
const FENCE_Z: f32 = 11.0;

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let seed = generator.options.seed;
    ground(generator, seed)?;
    fence(generator)?;
    let bark = bark(generator, seed);
    let leaves =
        [[0.16, 0.3, 0.05], [0.24, 0.33, 0.07], [0.4, 0.28, 0.06]].map(|green| foliage(generator, green));
    let (mut trunks, mut crowns) = (Part::default(), [Part::default(), Part::default(), Part::default()]);
    let trees = ((TREES as f32 * generator.options.detail.sqrt()) as usize).max(5);
    let side = (trees as f32).sqrt().ceil();
    for tree in 0..trees {
        let (column, row) = (tree as f32 % side, (tree as f32 / side).floor());
        let shaken = |place: f32, by: f32| (place + by) / side - 0.5;
        let (dx, dz) = (generator.between(0.15, 0.85), generator.between(0.15, 0.85));
        let (x, z) = (shaken(column, dx) * GROUND * 0.9, shaken(row, dz) * GROUND * 0.75 - 6.0);
        // A clearing to walk through.
        if (x - walk(z)).abs() < 2.2 {
            continue;
        }
        let foot = Vec3::new(x, height(seed, x, z) - 0.1, z);
        let kind = generator.below(3);
        grow(generator, foot, &mut trunks, &mut crowns[kind]);
    }
    generator.add_part("trunks", bark, &trunks)?;
    for (crown, leaf) in crowns.iter().zip(leaves) {
        generator.add_part("leaves", leaf, crown)?;
    }
    grass(generator, seed)?;
    let sky = sunny([0.2, 0.36, 0.72], [0.62, 0.68, 0.74], [0.55, 0.62, -0.5], [4.6, 4.0, 2.9]);
    let keys = vec![
        key([2.4, 1.7, 15.5], [-0.6, 2.3, 0.0], 52.0),
        key([-1.8, 1.7, 13.4], [1.0, 2.2, 0.0], 54.0),
        key([walk(6.0), 1.8, 6.0], [walk(-4.0), 2.4, -4.0], 56.0),
        key([walk(-3.0), 2.0, -3.0], [walk(-12.0) + 2.0, 2.6, -12.0], 58.0),
        key([walk(-10.0), 2.4, -10.0], [6.0, 2.6, -2.0], 58.0),
    ];
    Ok(LightAndPath { sky, keys })
}

/// The path through the trees.
fn walk(z: f32) -> f32 {
    1.6 * (z * 0.22).sin()
}

fn height(seed: u64, x: f32, z: f32) -> f32 {
    octaves(seed + 1, Vec3::new(x, 0.0, z) / 9.0, 3) * 0.5
}

/// A sheet of `columns` by `rows` cells over (u, v) in 0..1 squared, its picture `times` as often along each.
fn sheet(part: &mut Part, columns: usize, rows: usize, times: Vec2, point: impl Fn(f32, f32) -> Vec3) {
    const STEP: f32 = 1e-3;
    let first = part.positions.len() as u32;
    for row in 0..=rows {
        for column in 0..=columns {
            let (u, v) = (column as f32 / columns as f32, row as f32 / rows as f32);
            let (along, up) =
                (point(u + STEP, v) - point(u - STEP, v), point(u, v + STEP) - point(u, v - STEP));
            part.positions.push(point(u, v));
            part.normals.push(along.cross(up).normalize_or(Vec3::Y));
            part.uvs.push(Vec2::new(u, 1.0 - v) * times);
        }
    }
    let number = |column: usize, row: usize| first + (row * (columns + 1) + column) as u32;
    for row in 0..rows {
        for column in 0..columns {
            let [a, b] = [number(column, row), number(column + 1, row)];
            let [d, c] = [number(column, row + 1), number(column + 1, row + 1)];
            part.indices.extend([[a, b, c], [a, c, d]]);
        }
    }
}

/// A card with a whole picture: `foot` is the middle of its lower edge.
fn card(part: &mut Part, foot: Vec3, up: Vec3, across: Vec3, normal: Vec3) {
    let first = part.positions.len() as u32;
    part.positions.extend([foot - across, foot + across, foot + across + up, foot - across + up]);
    part.normals.extend([normal; 4]);
    part.uvs.extend([Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO]);
    part.indices.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}

/// Cards that a picture colours and cuts out.
fn cut_out(picture: Option<u32>) -> Material {
    let base_color = Vec3::ONE;
    Material { base_color, base_color_texture: picture, cutoff: Some(0.5), ..Material::default() }
}

fn ground(generator: &mut Generator, seed: u64) -> Result<(), SceneError> {
    let colour = generator.picture("soil", [PICTURE; 2], Encoding::Srgb, Wrap::Mirror, |u, v| {
        let at = Vec3::new(u, v, 0.3) * 6.0;
        let (patch, grain) = (octaves(seed + 2, at, 4), octaves(seed + 3, at * 9.0, 2));
        let moss = (0.5 + 1.4 * patch).clamp(0.0, 1.0);
        let base = Vec3::new(0.42, 0.33, 0.22).lerp(Vec3::new(0.3, 0.38, 0.16), moss);
        (base * (0.95 + 0.35 * grain)).extend(1.0)
    });
    let bumps =
        relief(generator, "soil bumps", 3.0, |u, v| octaves(seed + 3, Vec3::new(u, v, 0.3) * 40.0, 3));
    let soil = generator.material(Material {
        base_color: Vec3::ONE,
        base_color_texture: colour,
        normal_texture: bumps,
        roughness: 1.0,
        ior: 1.0,
        ..Material::default()
    });
    let mut land = Part::default();
    let cells = generator.segments(90);
    sheet(&mut land, cells, cells, Vec2::splat(9.0), |u, v| {
        let (x, z) = ((u - 0.5) * GROUND, (0.5 - v) * GROUND);
        Vec3::new(x, height(seed, x, z), z)
    });
    generator.add_part("ground", soil, &land)
}

/// A normal map of a height given over the picture.
fn relief(
    generator: &mut Generator,
    name: &str,
    steep: f32,
    height: impl Fn(f32, f32) -> f32,
) -> Option<u32> {
    let step = 1.0 / PICTURE as f32;
    generator.picture(name, [PICTURE; 2], Encoding::Linear, Wrap::Mirror, |u, v| {
        let across = height(u + step, v) - height(u - step, v);
        let down = height(u, v + step) - height(u, v - step);
        let normal = Vec3::new(-across * steep, down * steep, 1.0).normalize();
        (normal * 0.5 + 0.5).extend(1.0)
    })
}

fn bark(generator: &mut Generator, seed: u64) -> u32 {
    let groove = move |u: f32, v: f32| ridges(seed + 4, Vec3::new(u * 9.0, v * 2.5, 0.7), 3);
    let colour = generator.picture("bark", [PICTURE; 2], Encoding::Srgb, Wrap::Mirror, |u, v| {
        (Vec3::new(0.44, 0.34, 0.26) * (1.1 - 0.75 * groove(u, v))).extend(1.0)
    });
    let bumps = relief(generator, "bark bumps", 4.0, move |u, v| -groove(u, v));
    generator.material(Material {
        base_color: Vec3::ONE,
        base_color_texture: colour,
        normal_texture: bumps,
        roughness: 0.9,
        ..Material::default()
    })
}

/// A material of leaves on a twig.
fn foliage(generator: &mut Generator, [red, green, blue]: [f32; 3]) -> u32 {
    // Foot, direction and length of each leaf, in a picture of unit size with y up.
    let twig: Vec<(Vec2, Vec2, f32)> = (0..11)
        .map(|number| {
            let share = number as f32 / 10.0;
            let way = if number % 2 == 0 { 1.0 } else { -1.0 };
            let angle = way * (1.05 - 0.9 * share) + generator.between(-0.15, 0.15);
            let foot = Vec2::new(0.5 + 0.04 * (share * 5.0).sin(), 0.06 + 0.66 * share);
            (foot, Vec2::new(angle.sin(), angle.cos()), 0.36 - 0.1 * share)
        })
        .collect();
    let name = format!("leaves {red} {green} {blue}");
    let picture = generator.picture(&name, [PICTURE; 2], Encoding::Srgb, Wrap::Clamp, |u, v| {
        let at = Vec2::new(u, 1.0 - v);
        let mut colour = Vec3::new(0.3, 0.22, 0.12).extend(0.0);
        let stem = 0.009 - (at.x - 0.5 - 0.04 * ((at.y - 0.06) / 0.66 * 5.0).sin()).abs();
        if stem > 0.0 && at.y < 0.74 {
            colour.w = 1.0;
        }
        for &(foot, along, length) in &twig {
            let local = Vec2::new((at - foot).perp_dot(along), (at - foot).dot(along)) / length;
            let half = 0.24 * (PI * local.y.clamp(0.0, 1.0).powf(0.75)).sin();
            let inside = half - local.x.abs();
            if inside > -0.02 && (0.0..1.0).contains(&local.y) {
                let vein = (1.0 - local.x.abs() * 26.0).max(0.0)
                    + 0.35 * (1.0 - ((local.y - local.x.abs() * 0.9) * 9.0).fract() * 7.0).max(0.0);
                let shade = 0.85 + 0.3 * local.y + 0.35 * vein.min(1.0);
                // The colours above are light; pictures store roots.
                let light = Vec3::new(red, green, blue) * shade;
                colour = light.map(f32::sqrt).extend(((inside + 0.02) / 0.02).clamp(0.0, 1.0));
            }
        }
        colour
    });
    generator.material(Material { roughness: 0.75, ..cut_out(picture) })
}

fn grow(generator: &mut Generator, foot: Vec3, trunks: &mut Part, crown: &mut Part) {
    let tall = generator.between(4.2, 7.0);
    let lean = Vec3::new(generator.between(-0.5, 0.5), 0.0, generator.between(-0.5, 0.5));
    let spine = |share: f32| foot + Vec3::Y * (tall * 0.85 * share) + lean * (share * share);
    let radius = 0.035 * tall;
    let rows = generator.segments(10);
    sheet(trunks, generator.segments(12), rows, Vec2::new(1.0, 3.0), |u, v| {
        let thick = (1.0 - v).max(0.0).powf(0.7) + 0.06 + 0.5 * (-v * 22.0).exp();
        spine(v) + on_circle(TAU * u, 1.0, 0.0) * (radius * thick)
    });
    let middle = spine(0.82);
    let reach = Vec3::new(0.34, 0.3, 0.34) * tall;
    let cards = ((CARDS as f32 * generator.options.detail.sqrt()) as usize).max(60);
    let size = 0.085 * tall * (CARDS as f32 / cards as f32).sqrt().min(3.0);
    for _ in 0..cards {
        let (z, angle) = (generator.between(-0.9, 1.0), generator.between(0.0, TAU));
        let (sin, cos) = angle.sin_cos();
        let out = (1.0_f32 - z * z).sqrt();
        let outward = Vec3::new(sin * out, z, cos * out);
        let depth =
            generator.between(0.2, 1.0_f32).sqrt() * (0.8 + 0.25 * (3.0 * angle).sin() * (4.0 * z).cos());
        let shaken = generator.within(Vec3::new(-0.6, -0.5, -0.6), Vec3::new(0.6, 0.4, 0.6));
        let up = (outward + shaken).normalize_or(outward);
        let side = generator.within(Vec3::NEG_ONE, Vec3::ONE);
        let across = up.cross(side).normalize_or(up.any_orthonormal_vector());
        let facing = across.cross(up);
        let facing = if facing.dot(outward) < 0.0 { -facing } else { facing };
        let normal = (facing * 0.6 + outward).normalize_or(outward);
        card(
            crown,
            middle + reach * outward * depth - up * (size * 0.5),
            up * (2.0 * size),
            across * size,
            normal,
        );
    }
}

fn grass(generator: &mut Generator, seed: u64) -> Result<(), SceneError> {
    let picture = generator.picture("grass", [PICTURE; 2], Encoding::Srgb, Wrap::Clamp, |u, v| {
        let up = 1.0 - v;
        let mut colour = Vec3::new(0.36, 0.44, 0.2).extend(0.0);
        for blade in 0..13 {
            let number = blade as f32;
            let (foot, tip) = (0.1 + 0.8 * number / 12.0, 0.12 * (number * 2.4).sin());
            let tall = 0.6 + 0.36 * (number * 1.7).sin().abs();
            let share = up / tall;
            let middle = foot + tip * share * share;
            if share < 1.0 && (u - middle).abs() < 0.022 * (1.0 - share) {
                let green = Vec3::new(0.38, 0.5, 0.2).lerp(Vec3::new(0.6, 0.6, 0.32), share * 0.8);
                colour = (green * (0.75 + 0.3 * share)).extend(1.0);
            }
        }
        colour
    });
    let green = generator.material(Material { roughness: 0.9, ..cut_out(picture) });
    let mut tufts = Part::default();
    for _ in 0..((TUFTS as f32 * generator.options.detail) as usize).max(40) {
        let (x, z) = (generator.between(-0.48, 0.48) * GROUND, generator.between(-0.48, 0.48) * GROUND);
        let (turn, tall) = (generator.between(0.0, PI), generator.between(0.22, 0.6));
        if (x - walk(z)).abs() < 0.9 {
            continue;
        }
        let foot = Vec3::new(x, height(seed, x, z) - 0.03, z);
        for turn in [turn, turn + 0.5 * PI] {
            let (sin, cos) = turn.sin_cos();
            let across = Vec3::new(cos, 0.0, sin);
            let normal = (Vec3::Y + across.cross(Vec3::Y) * 0.3).normalize();
            card(&mut tufts, foot, Vec3::Y * tall, across * (tall * 0.7), normal);
        }
    }
    generator.add_part("grass", green, &tufts)
}

/// Wire netting between posts, one card a field.
fn fence(generator: &mut Generator) -> Result<(), SceneError> {
    let netting = generator.picture("netting", [64; 2], Encoding::Srgb, Wrap::Repeat, |u, v| {
        let wire = |across: f32| ((across.rem_euclid(1.0) - 0.5).abs() - 0.43).max(0.0) / 0.07;
        let (one, other) = (wire(u + v), wire(u - v));
        let solid = if one.max(other) > 0.0 { 1.0 } else { 0.0 };
        Vec3::splat(0.55 + 0.3 * one.max(other)).extend(solid)
    });
    let wire = generator.material(Material { metallic: 1.0, roughness: 0.4, ..cut_out(netting) });
    let wood = generator.material(Material { base_color: Vec3::new(0.3, 0.22, 0.14), ..Material::default() });
    let (mut nets, mut posts) = (Part::default(), Shapes::new());
    let fields = 12;
    for field in 0..=fields {
        let x = (field as f32 / fields as f32 - 0.5) * GROUND * 0.9;
        posts.open_cuboid(
            Vec3::new(x - 0.06, -0.6, FENCE_Z - 0.06),
            Vec3::new(x + 0.06, 1.75, FENCE_Z + 0.06),
            false,
        );
        if field < fields {
            let width = GROUND * 0.9 / fields as f32;
            let first = nets.uvs.len();
            card(
                &mut nets,
                Vec3::new(x + 0.5 * width, -0.3, FENCE_Z),
                Vec3::Y * 1.9,
                Vec3::X * (0.5 * width),
                Vec3::Z,
            );
            nets.uvs[first..].iter_mut().for_each(|uv| *uv *= Vec2::new(width, 1.9) / 0.16);
        }
    }
    generator.add("posts", wood, &posts)?;
    generator.add_part("netting", wire, &nets)
}

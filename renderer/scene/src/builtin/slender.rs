//! Long thin triangles at no right angle: hair in the wind, cables across a yard, and a scaffold.

use std::f32::consts::TAU;

use glam::{IVec3, Mat4, Quat, Vec2, Vec3};

use super::architecture::chequered;
use super::generator::{Generator, LightAndPath, key, sunny};
use super::palette::{glow, matt, metal, polished, steel};
use crate::SceneError;
use crate::shapes::{Shapes, on_circle, on_sphere};

/// Middle of the head, decimetres; its radius is 1.
const HEAD: Vec3 = Vec3::new(0.0, 3.0, 0.0);
/// Where the wind blows the hair.
const WIND: Vec3 = Vec3::new(0.7, -0.3, -0.45);
/// Strands at full detail, three triangles each.
const STRANDS: usize = 60_000;
/// Half the yard, and its height, metres.
const YARD: Vec3 = Vec3::new(24.0, 9.0, 14.0);
/// Cables and bundles of seven at full detail.
const LINES: usize = 1_000;
/// Straight pieces of a cable, eight triangles each.
const PIECES: usize = 10;
/// Width, height and depth of the scaffold, metres.
const FRAME: Vec3 = Vec3::new(60.0, 28.0, 4.2);
/// Its lower corner next to the wall.
const CORNER: Vec3 = Vec3::new(-30.0, 0.0, 0.5);
/// Angle of the scaffold and its wall against the axes, in radians.
const TURN: f32 = 0.6;
/// How far the ends of poles stray from a joint, because they pass each other there.
const STRAY: f32 = 0.07;
/// The poles of a joint: the way to their other end along the wall, up and away, and which are braces.
const POLES: [(IVec3, bool); 6] = [
    (IVec3::new(0, 1, 0), false),
    (IVec3::new(2, 0, 0), false),
    (IVec3::new(0, 0, 1), false),
    (IVec3::new(2, 2, 0), true),
    (IVec3::new(-2, 2, 0), true),
    (IVec3::new(1, 2, 1), true),
];

/// A bust whose hair the wind blows aside; strands are bent strips that taper to a point.
pub(super) fn hair(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let shades = generator.materials([
        polished(0.1, 0.05, 0.025, 0.35),
        polished(0.22, 0.11, 0.05, 0.35),
        polished(0.45, 0.22, 0.08, 0.35),
    ]);
    let (around, rings) = (generator.segments(64), generator.segments(40));
    let (mut bust, mut floor) = (Shapes::new(), Shapes::new());
    bust.sphere(HEAD, 1.0, around, rings);
    let profile = [(1.7, 0.0), (1.6, 0.6), (0.9, 1.3), (0.5, 1.7), (0.48, 2.3)]
        .map(|(radius, height)| Vec2::new(radius, height));
    bust.lathe(Vec3::ZERO, &profile, around);
    generator.add("bust", polished(0.56, 0.35, 0.26, 0.5), &bust)?;
    floor.level(Vec2::splat(14.0), 0.0);
    generator.add("ground", matt(0.42, 0.43, 0.45), &floor)?;
    let mut strands = [(); 3].map(|()| Shapes::new());
    for strand in 0..generator.count(STRANDS) {
        // From the upper half of the head, which leans back from the face.
        let lift = generator.between(-0.1, 1.0).asin();
        let out = Quat::from_rotation_x(-0.6) * on_sphere(generator.between(0.0, TAU), lift);
        let stray = generator.within(Vec3::NEG_ONE, Vec3::ONE) * 0.3;
        let blown = (WIND + stray).normalize_or(Vec3::X);
        // Where the wind meets the head, hair lies along it.
        let combed = (blown - out * blown.dot(out).min(0.0)).normalize_or(Vec3::X);
        let side = combed.cross(out).normalize_or(combed.any_orthonormal_vector())
            * generator.between(0.0015, 0.0035);
        let length = generator.between(0.9, 2.2);
        let root = HEAD + out * 0.98;
        let middle = root + (combed + out * 0.4) * (length * 0.5);
        let end = root + (combed * 0.8 + blown * 0.2 + Vec3::NEG_Y * 0.2) * length;
        strands[strand % 3].surface(1, 2, false, |u, v| {
            let bent = root.lerp(middle, v).lerp(middle.lerp(end, v), v);
            bent + side * ((2.0 * u - 1.0) * (1.0 - v))
        });
    }
    generator.add_each("hair", &shades, &strands)?;
    let keys = vec![
        key([-3.6, 3.7, 4.4], [0.5, 2.8, -0.3], 42.0),
        key([1.6, 4.6, 5.2], [0.5, 2.7, -0.3], 42.0),
        key([5.4, 3.4, 2.2], [0.6, 2.6, -0.4], 42.0),
        key([-2.6, 4.4, -4.6], [0.4, 2.7, -0.4], 42.0),
    ];
    let sky = sunny([0.25, 0.42, 0.78], [0.72, 0.8, 0.9], [-0.4, 0.75, 0.5], [3.4, 3.0, 2.4]);
    Ok(LightAndPath { sky, keys })
}

/// A yard between walls: cables sag from post to post, every eighth a bundle of six wound about one.
pub(super) fn cables(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let paving = generator.materials([matt(0.46, 0.43, 0.4), matt(0.36, 0.34, 0.33)]);
    let coats = generator.materials([
        polished(0.03, 0.03, 0.035, 0.4),
        metal(0.9, 0.5, 0.34, 0.3),
        polished(0.5, 0.07, 0.05, 0.4),
    ]);
    let tiles = [generator.segments(24), generator.segments(14)];
    let step = Vec2::new(2.0 * YARD.x / tiles[0] as f32, 2.0 * YARD.z / tiles[1] as f32);
    generator.add_each("paving", &paving, &chequered(Vec2::new(-YARD.x, -YARD.z), tiles, step, 0.01))?;
    let mut walls = Shapes::new();
    let (low, high) = (YARD * Vec3::new(-1.0, 0.0, -1.0), YARD);
    walls.cuboid(low - Vec3::Z * 0.4, high.with_z(low.z));
    walls.cuboid(low.with_z(high.z), high + Vec3::Z * 0.4);
    walls.cuboid(low.with_x(high.x), high + Vec3::X * 0.4);
    generator.add("walls", matt(0.5, 0.26, 0.19), &walls)?;
    let (mut posts, mut lamps, mut arms) = (Shapes::new(), Shapes::new(), Vec::new());
    let (around, rings) = (generator.segments(10), generator.segments(6));
    for (row, column) in (0..20).map(|post| (post / 4, post % 4)) {
        let foot = Vec3::new(row as f32 * 11.0 - 22.0, 0.0, column as f32 * 8.0 - 12.0)
            + generator.within(Vec3::new(-1.5, 0.0, -1.5), Vec3::new(1.5, 0.0, 1.5));
        let top = foot + Vec3::Y * generator.between(5.5, 8.5);
        let arm = on_circle(generator.between(0.0, TAU), 1.2, 0.0);
        posts.rod(foot, top + Vec3::Y * 0.3, 0.11, 8);
        posts.rod(top - arm, top + arm, 0.05, 6);
        lamps.sphere(top + arm - Vec3::Y * 0.25, 0.17, around, rings);
        arms.push((top, arm));
    }
    generator.add("posts", matt(0.3, 0.2, 0.13), &posts)?;
    generator.add("lamps", glow(30.0, 22.0, 13.0), &lamps)?;
    let mut cables = [(); 3].map(|()| Shapes::new());
    for line in 0..generator.count(LINES) {
        let first = generator.below(arms.len());
        let second = (first + 1 + generator.below(arms.len() - 1)) % arms.len();
        let ends = [first, second].map(|post| arms[post].0 + arms[post].1 * generator.between(-1.0, 1.0));
        let count = if line % 8 == 0 { 7 } else { 1 };
        let coat = generator.below(cables.len());
        cable(generator, &mut cables[coat], ends, count);
    }
    generator.add_each("cables", &coats, &cables)?;
    let keys = vec![
        key([-19.0, 1.7, 8.0], [2.0, 5.4, -2.0], 62.0),
        key([-5.6, 4.0, 8.4], [6.0, 6.0, -4.0], 60.0),
        key([5.5, 7.5, 0.0], [-8.0, 4.5, 1.0], 62.0),
        key([17.0, 2.0, -8.0], [-4.0, 5.6, 2.0], 60.0),
    ];
    let sky = sunny([0.25, 0.42, 0.78], [0.72, 0.8, 0.9], [-0.45, 0.75, 0.3], [2.9, 2.6, 2.1]);
    Ok(LightAndPath { sky, keys })
}

/// A cable between two ends, or `count` of them wound about the first; it stays off the ground.
fn cable(generator: &mut Generator, shapes: &mut Shapes, [from, to]: [Vec3; 2], count: usize) {
    let headroom = from.y.min(to.y) - 2.5;
    let sag = (from.distance(to) * generator.between(0.03, 0.14)).min(headroom);
    let (radius, turns) = (generator.between(0.008, 0.022), generator.between(1.0, 3.0));
    let across = (to - from).cross(Vec3::Y).normalize_or(Vec3::X);
    for strand in 0..count {
        let reach = if strand == 0 { 0.0 } else { 2.1 * radius };
        let path: [Vec3; PIECES + 1] = std::array::from_fn(|point| {
            let along = point as f32 / PIECES as f32;
            let (sin, cos) = (TAU * (strand as f32 / 6.0 + turns * along)).sin_cos();
            let hang = 4.0 * sag * along * (1.0 - along);
            from.lerp(to, along) - Vec3::Y * hang + (across * cos + Vec3::Y * sin) * reach
        });
        shapes.tube(&path, radius, 4);
    }
}

/// A scaffold of standards, ledgers, transoms and braces with planks on it, turned against the axes.
pub(super) fn scaffold(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let turn = Mat4::from_rotation_y(TURN);
    let last = IVec3::new(generator.segments(36) as i32, generator.segments(16) as i32, 3);
    let step = FRAME / last.as_vec3();
    let place = |generator: &mut Generator, joint: IVec3| {
        CORNER + joint.as_vec3() * step + generator.within(Vec3::NEG_ONE, Vec3::ONE) * STRAY
    };
    let (mut poles, mut braces, mut planks) = (Shapes::new(), Shapes::new(), Shapes::new());
    let per_level = (last.x + 1) * (last.z + 1);
    for number in 0..per_level * (last.y + 1) {
        let (y, within) = (number / per_level, number % per_level);
        let joint = IVec3::new(within / (last.z + 1), y, within % (last.z + 1));
        for (way, is_brace) in POLES {
            let other = joint + way;
            let is_there = other.cmpge(IVec3::ZERO).all() && other.cmple(last).all();
            if is_there && (!is_brace || generator.chance(0.7)) {
                let (from, to) = (place(generator, joint), place(generator, other));
                let shapes = if is_brace { &mut braces } else { &mut poles };
                shapes.rod(from, to, 0.025, 6);
            }
        }
        if y > 0 && joint.x + 2 <= last.x && joint.z < last.z && generator.chance(0.5) {
            let low = place(generator, joint) + Vec3::new(0.0, 0.1, generator.between(0.1, 0.9));
            planks.cuboid(low, low + Vec3::new(2.0 * step.x, 0.04, 0.28));
        }
    }
    let (mut walls, mut windows, mut ground) = (Shapes::new(), Shapes::new(), Shapes::new());
    walls.cuboid(Vec3::new(-32.0, 0.0, -1.0), Vec3::new(32.0, 29.0, 0.0));
    for (column, storey) in (0..36).map(|window| (window / 4, window % 4)) {
        let low = Vec3::new(column as f32 * 6.6 - 27.4, storey as f32 * 6.8 + 2.0, 0.0);
        windows.cuboid(low, low + Vec3::new(2.0, 3.2, 0.06));
    }
    ground.level(Vec2::splat(60.0), 0.0);
    let mut lamps = Shapes::new();
    for _ in 0..generator.count(40) {
        lamps.sphere(CORNER + generator.within(Vec3::ZERO, FRAME), 0.12, 8, 6);
    }
    for (name, material, mut shapes) in [
        ("poles", steel(), poles),
        ("braces", polished(0.75, 0.4, 0.06, 0.4), braces),
        ("planks", matt(0.5, 0.36, 0.21), planks),
        ("wall", matt(0.68, 0.62, 0.52), walls),
        ("windows", polished(0.05, 0.06, 0.08, 0.05), windows),
        ("ground", matt(0.34, 0.32, 0.3), ground),
        ("lamps", glow(30.0, 27.0, 22.0), lamps),
    ] {
        let material = generator.material(material);
        shapes.part.transform(&turn);
        generator.add(name, material, &shapes)?;
    }
    let turned = |at: [f32; 3]| turn.transform_point3(Vec3::from_array(at)).to_array();
    let view = |eye: [f32; 3], target: [f32; 3]| key(turned(eye), turned(target), 58.0);
    let keys = vec![
        view([-16.0, 1.7, 20.0], [2.0, 11.0, 2.0]),
        view([6.0, 6.0, 14.0], [-4.0, 12.0, 1.0]),
        view([22.0, 1.7, 12.0], [4.0, 10.0, 2.0]),
        view([34.0, 14.0, 9.0], [8.0, 11.0, 1.0]),
    ];
    let sky = sunny([0.25, 0.42, 0.78], [0.72, 0.8, 0.9], [0.2, 0.7, 0.75], [2.9, 2.6, 2.1]);
    Ok(LightAndPath { sky, keys })
}

//! Trees: spruces of drooping whorls, and broad-leaved trees that branch again and again.

use std::f32::consts::TAU;

use glam::{Quat, Vec3};

use crate::builtin::palette::{matt, polished};
use crate::{SceneError, builtin::generator::Generator, part::Part, shapes::Shapes};

/// All trees, as objects; kinds that are common stand in the list more than once.
pub(super) fn species(generator: &mut Generator) -> Result<Vec<u32>, SceneError> {
    let bark = generator.material(matt(0.13, 0.085, 0.055));
    let white_bark = generator.material(polished(0.68, 0.66, 0.6, 0.7));
    let needles = [[0.035, 0.085, 0.03], [0.05, 0.1, 0.045], [0.03, 0.075, 0.042]];
    let oak_leaves = [[0.1, 0.19, 0.035], [0.15, 0.21, 0.04], [0.21, 0.19, 0.03]];
    let birch_leaves = [[0.27, 0.3, 0.06], [0.38, 0.31, 0.05]];
    let mut all = Vec::new();
    for [red, green, blue] in needles {
        let leaf = generator.material(matt(red, green, blue));
        let object = spruce(generator, bark, leaf)?;
        all.extend([object; 2]);
    }
    for [red, green, blue] in oak_leaves {
        let leaf = generator.material(matt(red, green, blue));
        all.push(broad(generator, &OAK, bark, leaf)?);
    }
    for [red, green, blue] in birch_leaves {
        let leaf = generator.material(matt(red, green, blue));
        all.push(broad(generator, &BIRCH, white_bark, leaf)?);
    }
    Ok(all)
}

/// A leaf or twig: two triangles, folded a little along its spine.
pub(super) fn leaf(part: &mut Part, foot: Vec3, along: Vec3, across: Vec3, outward: Vec3) {
    let first = part.positions.len() as u32;
    let middle = foot + along * 0.45;
    part.positions.extend([foot, middle + across, foot + along, middle - across]);
    // Lit like the crown's surface rather than one by one, a crown looks full and soft.
    let normal = (along.cross(across).normalize_or(Vec3::Y) * 0.35 + outward).normalize_or(Vec3::Y);
    part.normals.extend([normal; 4]);
    part.indices.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
}

/// A direction of even distribution.
fn anywhere(generator: &mut Generator) -> Vec3 {
    let (z, angle) = (generator.between(-1.0, 1.0), generator.between(0.0, TAU));
    let (sin, cos) = angle.sin_cos();
    let out = (1.0f32 - z * z).sqrt();
    Vec3::new(out * cos, z, out * sin)
}

fn spruce(generator: &mut Generator, bark: u32, needle: u32) -> Result<u32, SceneError> {
    generator.assembler.begin_object();
    let height = generator.between(11.0, 15.0);
    let mut trunk = Shapes::new();
    let around = generator.segments(9);
    let rows = generator.segments(8);
    trunk.surface(around, rows, true, |u, v| {
        let (sin, cos) = (TAU * u).sin_cos();
        let radius = 0.24 * (1.0 - v).powf(0.8) + 0.015 + 0.14 * (-v * 30.0).exp();
        Vec3::new(sin * radius, v * height - 0.3, cos * radius)
    });
    generator.add("spruce trunk", bark, &trunk)?;
    let mut green = Part::default();
    let whorls = generator.segments(26);
    for whorl in 0..whorls {
        let share = (whorl as f32 + 0.5) / whorls as f32;
        let (y, reach) = (height * (0.1 + 0.88 * share), (1.0 - share).powf(0.85) * 2.9 + 0.18);
        let branches = 5 + (4.0 * (1.0 - share)) as usize;
        let begin = generator.between(0.0, TAU);
        for branch in 0..branches {
            let angle = begin + TAU * (branch as f32 + generator.between(-0.2, 0.2)) / branches as f32;
            let length = reach * generator.between(0.8, 1.12);
            let droop = generator.between(0.28, 0.5) * (1.2 - share);
            bough(generator, &mut green, Vec3::Y * y, angle, length, droop);
        }
    }
    generator.add_part("spruce needles", needle, &green)?;
    Ok(generator.assembler.end_object())
}

/// A bough of a spruce: twigs to both sides of a hanging spine, longest in the middle.
fn bough(generator: &mut Generator, green: &mut Part, root: Vec3, angle: f32, length: f32, droop: f32) {
    let (sin, cos) = angle.sin_cos();
    let (out, side) = (Vec3::new(sin, 0.0, cos), Vec3::new(cos, 0.0, -sin));
    let at = |share: f32| {
        root + out * (length * share) + Vec3::Y * length * (0.25 * share * share - droop * share)
    };
    let twigs = generator.segments(12);
    for twig in 0..twigs {
        let share = (twig as f32 + 0.6) / twigs as f32;
        let (foot, size) = (at(share), length * (0.1 + 0.3 * (1.0 - (2.0 * share - 0.75).powi(2)).max(0.0)));
        let upward = (Vec3::Y + out * 0.7).normalize();
        for way in [-1.0, 1.0] {
            let along = (out * 0.75 + side * (way * generator.between(0.6, 1.0))
                - Vec3::Y * generator.between(0.1, 0.45))
            .normalize_or(out)
                * (size * 0.8);
            leaf(green, foot, along, along.cross(Vec3::Y).normalize_or(side) * (0.075 + 0.03 * size), upward);
        }
    }
}

/// The shape of a broad-leaved tree.
struct Habit {
    height: [f32; 2],
    trunk_radius: f32,
    /// Share of the height below the first branch.
    bare: f32,
    /// Angle by which branches bend away from their parents.
    spread: f32,
    /// Length of a branch to the one it grows from.
    shorter: f32,
    /// Levels of branches.
    levels: u32,
    leaf: f32,
    leaves_a_twig: usize,
}

const OAK: Habit = Habit {
    height: [8.5, 10.5],
    trunk_radius: 0.36,
    bare: 0.24,
    spread: 0.95,
    shorter: 0.68,
    levels: 4,
    leaf: 0.24,
    leaves_a_twig: 28,
};

const BIRCH: Habit = Habit {
    height: [9.5, 12.5],
    trunk_radius: 0.16,
    bare: 0.28,
    spread: 0.6,
    shorter: 0.62,
    levels: 4,
    leaf: 0.17,
    leaves_a_twig: 30,
};

fn broad(generator: &mut Generator, habit: &Habit, bark: u32, green: u32) -> Result<u32, SceneError> {
    generator.assembler.begin_object();
    let height = generator.between(habit.height[0], habit.height[1]);
    let (mut wood, mut leaves) = (Shapes::new(), Part::default());
    let middle = Vec3::Y * height * 0.62;
    let trunk = Branch {
        foot: Vec3::NEG_Y * 0.3,
        direction: Vec3::Y,
        length: height * (habit.bare + 0.3),
        radius: habit.trunk_radius,
        level: 0,
    };
    grow(generator, habit, &trunk, middle, &mut wood, &mut leaves);
    generator.add("wood", bark, &wood)?;
    generator.add_part("leaves", green, &leaves)?;
    Ok(generator.assembler.end_object())
}

/// A branch on its way.
struct Branch {
    foot: Vec3,
    direction: Vec3,
    length: f32,
    radius: f32,
    level: u32,
}

/// Grows a branch and all that springs from it. `middle` is the crown's, which leaves look away from.
fn grow(
    generator: &mut Generator,
    habit: &Habit,
    branch: &Branch,
    middle: Vec3,
    wood: &mut Shapes,
    leaves: &mut Part,
) {
    let steps = 4;
    let (mut at, mut direction, mut path) = (branch.foot, branch.direction, vec![branch.foot]);
    for _ in 0..steps {
        let wander = anywhere(generator) * if branch.level == 0 { 0.1 } else { 0.24 };
        direction = (direction + wander + Vec3::Y * 0.07).normalize_or(Vec3::Y);
        at += direction * (branch.length / steps as f32);
        path.push(at);
    }
    let segments =
        generator.segments(if branch.level == 0 { 10 } else { 5 }).max(if branch.level > 1 { 3 } else { 4 });
    if branch.level + 1 < habit.levels {
        tapered(wood, &path, branch.radius, branch.radius * 0.55, segments);
    }
    let children = if branch.level == 0 { 7 } else { 4 };
    if branch.level + 1 == habit.levels {
        crown(generator, habit, &path, middle, leaves);
        return;
    }
    let begin = generator.between(0.0, TAU);
    for child in 0..children {
        let from = if branch.level == 0 { habit.bare / (habit.bare + 0.3) } else { 0.35 };
        let share = from + (1.0 - from) * (child as f32 + 0.5) / children as f32;
        let place = share * steps as f32;
        let index = (place as usize).min(steps - 1);
        let foot = path[index].lerp(path[index + 1], place - index as f32);
        let side = direction.any_orthonormal_vector();
        let around = Quat::from_axis_angle(direction, begin + child as f32 * 2.4) * side;
        // The topmost goes straight on.
        let bend = if child + 1 == children { 0.25 } else { habit.spread * generator.between(0.75, 1.2) };
        let next = Branch {
            foot,
            direction: (direction + around * bend).normalize_or(Vec3::Y),
            length: branch.length * habit.shorter * generator.between(0.8, 1.15) * (1.15 - 0.4 * share),
            radius: branch.radius * 0.5 * (1.1 - 0.4 * share),
            level: branch.level + 1,
        };
        grow(generator, habit, &next, middle, wood, leaves);
    }
}

/// A bar that becomes thinner.
fn tapered(wood: &mut Shapes, path: &[Vec3], from: f32, to: f32, segments: usize) {
    let rows = path.len() - 1;
    let along = (path[rows] - path[0]).normalize_or(Vec3::Y);
    let side = along.any_orthonormal_vector();
    let other = along.cross(side);
    wood.surface(segments, rows, true, |u, v| {
        let index = (v * rows as f32).round() as usize;
        let (sin, cos) = (TAU * u).sin_cos();
        path[index] + (side * cos + other * sin) * (from + (to - from) * v)
    });
}

/// Leaves around the last twigs.
fn crown(generator: &mut Generator, habit: &Habit, path: &[Vec3], middle: Vec3, leaves: &mut Part) {
    let count = (habit.leaves_a_twig as f32 * generator.options.detail.sqrt()).ceil() as usize;
    // Fewer leaves are larger, so that the crown stays as dense.
    let size = habit.leaf * (habit.leaves_a_twig as f32 / count as f32).sqrt().min(3.0);
    for _ in 0..count {
        let index = generator.below(path.len() - 1);
        let on_twig = path[index].lerp(path[index + 1], generator.between(0.0, 1.0));
        let foot = on_twig + anywhere(generator) * generator.between(0.05, 0.42);
        let outward = ((foot - middle) * Vec3::new(1.0, 1.3, 1.0)).normalize_or(Vec3::Y);
        let along = (anywhere(generator) + outward * 0.6).normalize_or(outward)
            * (size * generator.between(0.75, 1.3));
        let across =
            along.cross(anywhere(generator)).normalize_or(along.any_orthonormal_vector()) * (size * 0.42);
        leaf(leaves, foot, along, across, outward);
    }
}

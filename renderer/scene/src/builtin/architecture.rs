//! Building parts: walls with arched openings, columns, coffers, lattices.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};

use crate::shapes::Shapes;

/// A wall's lower left corner, directions to the right and to the front, and thickness behind.
#[derive(Clone, Copy)]
pub(super) struct WallPlane {
    pub(super) corner: Vec3,
    pub(super) right: Vec3,
    pub(super) front: Vec3,
    pub(super) thickness: f32,
}

impl WallPlane {
    fn at(&self, x: f32, y: f32, depth: f32) -> Vec3 {
        self.corner + self.right * x + Vec3::Y * y - self.front * depth
    }

    /// A rectangle on the front and on the back.
    fn both_faces(&self, shapes: &mut Shapes, low: [Vec2; 2], high: [Vec2; 2]) {
        let front = |p: Vec2| self.at(p.x, p.y, 0.0);
        let back = |p: Vec2| self.at(p.x, p.y, self.thickness);
        shapes.quad(front(low[0]), front(low[1]), front(high[1]), front(high[0]));
        shapes.quad(back(low[1]), back(low[0]), back(high[0]), back(high[1]));
    }
}

/// An arched opening: its middle, half its width, where it begins and where its round part begins.
#[derive(Clone, Copy)]
pub(super) struct Opening {
    pub(super) middle: f32,
    pub(super) half_width: f32,
    pub(super) sill: f32,
    pub(super) spring: f32,
}

/// A piece of wall of `size` with one arched opening that fits; the outer narrow sides are open.
pub(super) fn arched_wall(
    shapes: &mut Shapes,
    plane: &WallPlane,
    size: Vec2,
    opening: &Opening,
    segments: usize,
) {
    let (left, right) = (opening.middle - opening.half_width, opening.middle + opening.half_width);
    let p = Vec2::new;
    plane.both_faces(shapes, [p(0.0, 0.0), p(left, 0.0)], [p(0.0, size.y), p(left, size.y)]);
    plane.both_faces(shapes, [p(right, 0.0), p(size.x, 0.0)], [p(right, size.y), p(size.x, size.y)]);
    let (sill, spring) = (opening.sill, opening.spring);
    let deep = plane.thickness;
    if sill > 0.0 {
        plane.both_faces(shapes, [p(left, 0.0), p(right, 0.0)], [p(left, sill), p(right, sill)]);
        let at = |x, depth| plane.at(x, sill, depth);
        shapes.quad(at(left, 0.0), at(right, 0.0), at(right, deep), at(left, deep));
    }
    if spring > sill {
        // The jambs look at each other.
        let jamb = |x: f32, from: f32, to: f32| {
            [
                plane.at(x, sill, from),
                plane.at(x, sill, to),
                plane.at(x, spring, to),
                plane.at(x, spring, from),
            ]
        };
        let [[a, b, c, d], [e, f, g, h]] = [jamb(left, 0.0, deep), jamb(right, deep, 0.0)];
        shapes.quad(a, b, c, d);
        shapes.quad(e, f, g, h);
    }
    let arc = |index: usize| {
        let (sin, cos) = (PI * (1.0 - index as f32 / segments as f32)).sin_cos();
        p(opening.middle + opening.half_width * cos, spring + opening.half_width * sin)
    };
    for index in 0..segments {
        let (from, to) = (arc(index), arc(index + 1));
        plane.both_faces(shapes, [from, to], [p(from.x, size.y), p(to.x, size.y)]);
    }
    shapes.surface(segments, 1, false, |u, v| {
        let (sin, cos) = (PI * (1.0 - u)).sin_cos();
        let (x, y) = (opening.middle + opening.half_width * cos, spring + opening.half_width * sin);
        plane.at(x, y, deep * (1.0 - v))
    });
}

/// A moulding that follows the arch of an opening on the front of a wall.
pub(super) fn archivolt(
    shapes: &mut Shapes,
    plane: &WallPlane,
    opening: &Opening,
    width: f32,
    segments: usize,
) {
    let profile = [
        (0.0, 0.0),
        (0.0, 0.07),
        (0.25, 0.1),
        (0.35, 0.06),
        (0.6, 0.06),
        (0.7, 0.13),
        (1.0, 0.09),
        (1.0, 0.0),
    ];
    let section: Vec<Vec2> = profile.iter().map(|(out, up)| Vec2::new(out * width, *up)).collect();
    let frames: Vec<(Vec3, Vec3, Vec3)> = (0..=segments)
        .map(|index| {
            let (sin, cos) = (PI * index as f32 / segments as f32).sin_cos();
            let outward = plane.right * cos + Vec3::Y * sin;
            let rim = plane.at(opening.middle, opening.spring, 0.0) + outward * opening.half_width;
            (rim, outward, plane.front)
        })
        .collect();
    // Walked from right to left, outward times front points backwards, so the section is turned round.
    let mut section = section;
    section.reverse();
    shapes.sweep(&section, &frames);
}

/// A lattice of thin square bars in a rectangular or arched opening.
pub(super) fn lattice(
    shapes: &mut Shapes,
    plane: &WallPlane,
    opening: &Opening,
    columns: usize,
    thickness: f32,
) {
    let half = thickness * 0.5;
    let middle = plane.thickness * 0.5;
    let mut bar = |from: Vec3, to: Vec3, side: Vec3| {
        let section =
            [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| Vec2::new(x, y));
        let along = (to - from).normalize_or(Vec3::Y);
        let up = along.cross(side);
        shapes.sweep(&section, &[(from, side, up), (to, side, up)]);
    };
    let step = 2.0 * opening.half_width / columns as f32;
    for column in 1..columns {
        let offset = -opening.half_width + column as f32 * step;
        let rise = (opening.half_width.powi(2) - offset * offset).max(0.0).sqrt();
        let x = opening.middle + offset;
        bar(plane.at(x, opening.sill, middle), plane.at(x, opening.spring + rise, middle), plane.right);
    }
    let rows = ((opening.spring - opening.sill + opening.half_width) / step) as usize;
    for row in 1..=rows {
        let y = opening.sill + row as f32 * step;
        let above = (y - opening.spring).max(0.0);
        let reach = (opening.half_width.powi(2) - above * above).max(0.0).sqrt();
        if reach > step * 0.25 {
            bar(
                plane.at(opening.middle - reach, y, middle),
                plane.at(opening.middle + reach, y, middle),
                Vec3::Y,
            );
        }
    }
}

/// A fluted column of a height, standing on a round base and carrying a capital with a square slab.
pub(super) fn column(shapes: &mut Shapes, foot: Vec3, height: f32, radius: f32, around: usize, rows: usize) {
    let p = |r: f32, y: f32| Vec2::new(r * radius, y * radius);
    let slab = |shapes: &mut Shapes, y: f32, thick: f32, half: f32| {
        let half = half * radius;
        shapes.cuboid(foot + Vec3::new(-half, y, -half), foot + Vec3::new(half, y + thick, half));
    };
    slab(shapes, 0.0, 0.3 * radius, 1.45);
    let ring = |middle: f32, bulge: f32, low: f32, high: f32, points: usize| -> Vec<Vec2> {
        (0..=points)
            .map(|index| {
                let angle = PI * index as f32 / points as f32;
                p(middle + bulge * angle.sin(), low + (high - low) * (1.0 - angle.cos()) * 0.5)
            })
            .collect()
    };
    let points = (rows / 2).max(3);
    let base = foot + Vec3::Y * 0.3 * radius;
    shapes.lathe(base, &ring(1.22, 0.2, 0.0, 0.3, points), around);
    shapes.lathe(base, &ring(1.14, -0.06, 0.3, 0.45, points), around);
    shapes.lathe(base, &ring(1.08, 0.13, 0.45, 0.65, points), around);
    let (low, high) = (foot.y + 0.95 * radius, foot.y + height - 1.25 * radius);
    // Twenty flutes; the shaft swells a little below its middle and narrows upward.
    shapes.surface(around * 2, rows, true, |u, v| {
        let flute = (10.0 * TAU * u).sin().abs();
        let swell = 1.0 - 0.14 * v * v + 0.02 * (PI * v).sin();
        let ends = (v * (1.0 - v) * 60.0).min(1.0);
        let r = radius * swell * (0.94 + 0.06 * (1.0 - ends) + 0.06 * ends * (1.0 - flute));
        let (sin, cos) = (TAU * u).sin_cos();
        Vec3::new(foot.x + sin * r, low + (high - low) * v, foot.z + cos * r)
    });
    let neck = Vec3::new(foot.x, high, foot.z);
    shapes.lathe(neck, &ring(0.88, 0.1, 0.0, 0.18, points), around);
    let bell: Vec<Vec2> = (0..=points)
        .map(|index| {
            let t = index as f32 / points as f32;
            p(0.86 + 0.5 * t * t, 0.18 + 0.72 * t)
        })
        .collect();
    shapes.lathe(neck, &bell, around);
    slab(shapes, height - 0.35 * radius, 0.35 * radius, 1.5);
}

/// A floor of bevelled tiles in two colours by turns, up to a height of 0, with half a `gap` around each.
pub(super) fn chequered(corner: Vec2, [columns, rows]: [usize; 2], step: Vec2, gap: f32) -> [Shapes; 2] {
    let mut tiles = [Shapes::new(), Shapes::new()];
    for column in 0..columns {
        for row in 0..rows {
            let low = Vec3::new(corner.x + column as f32 * step.x, -0.1, corner.y + row as f32 * step.y);
            let (from, to) = (Vec3::new(gap, 0.0, gap), Vec3::new(step.x - gap, 0.1, step.y - gap));
            tiles[(column + row) % 2].bevelled_slab(low + from, low + to, gap);
        }
    }
    tiles
}

/// A ceiling panel that faces down, stepped upward in three frames, with a turned rosette in its middle.
pub(super) fn coffer(shapes: &mut Shapes, middle: Vec3, half: Vec2, depth: f32, around: usize, rings: usize) {
    let rectangle = |shrink: f32, y: f32| {
        let (x, z) = (half.x * shrink, half.y * shrink);
        [(-x, -z), (x, -z), (x, z), (-x, z)].map(|(x, z)| middle + Vec3::new(x, y, z))
    };
    let frames = [(1.0, 0.0), (0.86, 0.0), (0.86, 0.4), (0.72, 0.4), (0.72, 0.75), (0.6, 0.75), (0.6, 1.0)];
    for pair in frames.windows(2) {
        let (outer, inner) =
            (rectangle(pair[0].0, pair[0].1 * depth), rectangle(pair[1].0, pair[1].1 * depth));
        for side in 0..4 {
            let next = (side + 1) % 4;
            shapes.quad(outer[side], outer[next], inner[next], inner[side]);
        }
    }
    let [a, b, c, d] = rectangle(0.6, depth);
    shapes.quad(a, b, c, d);
    let size = half.min_element() * 0.42;
    // Eight petals around a knob; it hangs, so its profile runs from the ceiling's rim down to the knob.
    shapes.surface(around, rings, true, |u, v| {
        let (sin, cos) = (-TAU * u).sin_cos();
        let petal = 0.78 + 0.22 * (8.0 * TAU * u).cos().abs();
        let reach = size * (1.0 - v) * (petal + (1.0 - petal) * v);
        let drop = depth * 0.45 * (v * (1.6 - 0.6 * v) - 0.25 * (PI * v * 2.0).sin().max(0.0));
        middle + Vec3::new(sin * reach, depth - drop, cos * reach)
    });
}

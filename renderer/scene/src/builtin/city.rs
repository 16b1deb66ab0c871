//! Blocks of towers in the evening sun: deep windows, machinery on roofs, streets with cars and trees.

use std::f32::consts::PI;

use glam::{Vec2, Vec3};

use super::generator::{Generator, LightAndPath, key, sunny};
use super::noise::at_cell;
use super::palette::{glow, matt, metal, polished, steel};
use crate::shapes::{Shapes, on_sphere};
use crate::{Material, SceneError};

/// Blocks along one side at full detail.
const BLOCKS: f32 = 5.0;
/// From one block to the next, metres.
const PITCH: f32 = 64.0;
/// Width of a street with its pavements.
const STREET: f32 = 16.0;
/// Height of a storey.
const STOREY: f32 = 3.6;

/// Materials of the city, registered once.
struct Kit {
    walls: Vec<u32>,
    pane: u32,
    lit_panes: [u32; 2],
    roof: u32,
    pavement: u32,
    asphalt: u32,
    paint: u32,
    steel: u32,
    lamp: u32,
    trunk: u32,
    leaves: u32,
    cars: Vec<u32>,
}

pub(super) fn build(generator: &mut Generator) -> Result<LightAndPath, SceneError> {
    let kit = kit(generator);
    let blocks = ((BLOCKS * generator.options.detail.sqrt()).round() as usize).max(1);
    let half = blocks as f32 * PITCH * 0.5;
    streets(generator, &kit, blocks, half)?;
    for column in 0..blocks {
        for row in 0..blocks {
            let corner = Vec3::new(-half + column as f32 * PITCH, 0.0, -half + row as f32 * PITCH);
            block(generator, &kit, corner, half)?;
        }
    }
    let at = |x: f32, y: f32, z: f32| [x * half, y, z * half];
    let sky = sunny([0.16, 0.28, 0.6], [0.7, 0.52, 0.42], [-0.72, 0.34, 0.52], [4.6, 3.1, 1.9]);
    let keys = vec![
        key(at(-0.92, 92.0, 0.98), at(0.1, 20.0, -0.1), 46.0),
        key(at(-0.4, 60.0, 0.9), at(0.1, 24.0, 0.0), 48.0),
        key(at(0.2, 78.0, 0.75), at(0.0, 20.0, -0.1), 50.0),
        key(at(0.8, 96.0, 0.5), at(0.0, 24.0, -0.1), 48.0),
        key(at(0.9, 84.0, -0.3), at(0.0, 30.0, 0.1), 48.0),
        key(at(0.35, 100.0, -0.8), at(0.0, 24.0, 0.0), 50.0),
    ];
    Ok(LightAndPath { sky, keys })
}

fn kit(generator: &mut Generator) -> Kit {
    let walls =
        [(0.62, 0.55, 0.46), (0.48, 0.22, 0.15), (0.55, 0.56, 0.58), (0.72, 0.68, 0.6), (0.3, 0.32, 0.36)];
    let cars =
        [(0.6, 0.05, 0.04), (0.85, 0.85, 0.85), (0.04, 0.05, 0.06), (0.06, 0.15, 0.4), (0.8, 0.55, 0.05)];
    Kit {
        walls: walls.iter().map(|(r, g, b)| generator.material(matt(*r, *g, *b))).collect(),
        pane: generator.material(Material { metallic: 0.6, ..polished(0.25, 0.32, 0.38, 0.05) }),
        lit_panes: [generator.material(glow(3.2, 2.1, 1.0)), generator.material(glow(1.6, 1.7, 1.9))],
        roof: generator.material(matt(0.24, 0.23, 0.22)),
        pavement: generator.material(matt(0.42, 0.41, 0.4)),
        asphalt: generator.material(polished(0.07, 0.07, 0.075, 0.7)),
        paint: generator.material(matt(0.75, 0.75, 0.72)),
        steel: generator.material(steel()),
        lamp: generator.material(glow(60.0, 42.0, 22.0)),
        trunk: generator.material(matt(0.17, 0.1, 0.06)),
        leaves: generator.material(matt(0.12, 0.24, 0.06)),
        cars: cars.iter().map(|(r, g, b)| generator.material(metal(*r, *g, *b, 0.25))).collect(),
    }
}

fn streets(generator: &mut Generator, kit: &Kit, blocks: usize, half: f32) -> Result<(), SceneError> {
    let mut road = Shapes::new();
    road.level(Vec2::splat(half + STREET), 0.0);
    generator.add("road", kit.asphalt, &road)?;
    let mut marks = Shapes::new();
    for line in 0..=blocks {
        let middle = -half + line as f32 * PITCH;
        let mut along = -half;
        while along < half {
            let (low, high) =
                (Vec3::new(middle - 0.1, 0.0, along), Vec3::new(middle + 0.1, 0.015, along + 2.4));
            marks.open_cuboid(low, high, false);
            marks.open_cuboid(Vec3::new(low.z, low.y, low.x), Vec3::new(high.z, high.y, high.x), false);
            along += 6.4;
        }
    }
    generator.add("road marks", kit.paint, &marks)
}

/// Four or fewer buildings on a pavement, or a park.
fn block(generator: &mut Generator, kit: &Kit, corner: Vec3, half: f32) -> Result<(), SceneError> {
    let inset = STREET * 0.5 - 3.0;
    let (low, high) =
        (corner + Vec3::new(inset, 0.0, inset), corner + Vec3::new(PITCH - inset, 0.16, PITCH - inset));
    let mut pavement = Shapes::new();
    pavement.bevelled_slab(low, high, 0.05);
    generator.add("pavement", kit.pavement, &pavement)?;
    furniture(generator, kit, low, high)?;
    let middle = corner + Vec3::new(PITCH, 0.0, PITCH) * 0.5;
    // Towers grow towards the middle of the city.
    let central = 1.0 - (Vec2::new(middle.x, middle.z).length() / half.max(PITCH)).min(1.0);
    if generator.chance(0.1) {
        return park(generator, kit, low, high);
    }
    let room = PITCH - 2.0 * (STREET * 0.5 + 0.5);
    let start = corner + Vec3::new(1.0, 0.0, 1.0) * (STREET * 0.5 + 0.5) + Vec3::Y * 0.16;
    let cut = generator.between(0.4, 0.6) * room;
    for (x, width) in [(0.0, cut), (cut, room - cut)] {
        let cut = generator.between(0.4, 0.6) * room;
        for (z, depth) in [(0.0, cut), (cut, room - cut)] {
            let lot = start + Vec3::new(x + 0.8, 0.0, z + 0.8);
            let size = Vec2::new(width - 1.6, depth - 1.6);
            let storeys =
                3.0 + generator.between(0.0, 5.0) + central * central * generator.between(4.0, 22.0);
            building(generator, kit, lot, size, storeys as usize)?;
        }
    }
    Ok(())
}

/// A tower that steps back once or twice on its way up.
fn building(
    generator: &mut Generator,
    kit: &Kit,
    lot: Vec3,
    size: Vec2,
    storeys: usize,
) -> Result<(), SceneError> {
    let wall = kit.walls[generator.below(kit.walls.len())];
    let (mut walls, mut roofs) = (Shapes::new(), Shapes::new());
    let mut panes = [Shapes::new(), Shapes::new(), Shapes::new()];
    let (mut corner, mut size, mut left) = (lot, size, storeys);
    let bay = generator.between(3.0, 4.4);
    let share = Vec2::new(generator.between(0.45, 0.75), generator.between(0.5, 0.72));
    while left > 0 {
        let floors = if left > 7 { left * 2 / 3 } else { left };
        let height = floors as f32 * STOREY;
        facades(generator, &mut walls, &mut panes, corner, size, floors, bay, share);
        let top = corner + Vec3::Y * height;
        roofs.open_cuboid(top, top + Vec3::new(size.x, 0.05, size.y), false);
        parapet(&mut walls, top, size);
        left -= floors;
        if left == 0 {
            rooftop(generator, &mut roofs, top, size);
        }
        let back = Vec2::new(generator.between(0.1, 0.18), generator.between(0.1, 0.18)) * size;
        corner = top + Vec3::new(back.x, 0.0, back.y);
        size -= back * 2.0;
    }
    generator.add("building", wall, &walls)?;
    generator.add("roof", kit.roof, &roofs)?;
    generator.add("panes", kit.pane, &panes[0])?;
    generator.add("lit panes", kit.lit_panes[0], &panes[1])?;
    generator.add("lit panes", kit.lit_panes[1], &panes[2])
}

/// The four sides of a storeyed block, a grid of windows each.
#[allow(clippy::too_many_arguments, reason = "one call site; the arguments are the drawing of one block")]
fn facades(
    generator: &mut Generator,
    walls: &mut Shapes,
    panes: &mut [Shapes; 3],
    corner: Vec3,
    size: Vec2,
    floors: usize,
    bay: f32,
    share: Vec2,
) {
    let (x, z) = (Vec3::X, Vec3::Z);
    let sides = [
        (corner + z * size.y, x, z, size.x),
        (corner + x * size.x + z * size.y, -z, x, size.y),
        (corner + x * size.x, -x, -z, size.x),
        (corner, z, -x, size.y),
    ];
    let seed = generator.options.seed;
    for (origin, right, front, width) in sides {
        let columns = ((width / bay) as usize).max(1);
        let step = width / columns as f32;
        for floor in 0..floors {
            for column in 0..columns {
                let cell = origin + right * (column as f32 * step) + Vec3::Y * (floor as f32 * STOREY);
                let dice =
                    at_cell(seed + 3, (cell.x * 8.0) as i64, (cell.y * 8.0) as i64, (cell.z * 8.0) as i64);
                let kind = if dice < 0.1 {
                    1
                } else if dice < 0.15 {
                    2
                } else {
                    0
                };
                window(walls, &mut panes[kind], cell, right, front, Vec2::new(step, STOREY), share);
            }
        }
    }
}

/// A piece of wall with a recessed window and a sill: 36 triangles.
fn window(
    walls: &mut Shapes,
    pane: &mut Shapes,
    cell: Vec3,
    right: Vec3,
    front: Vec3,
    size: Vec2,
    share: Vec2,
) {
    const DEEP: f32 = 0.35;
    let margin = size * (Vec2::ONE - share) * 0.5;
    let at = |x: f32, y: f32, deep: f32| cell + right * x + Vec3::Y * y - front * deep;
    let outer = [(0.0, 0.0), (size.x, 0.0), (size.x, size.y), (0.0, size.y)];
    let (low, high) = (margin, size - margin);
    let inner = [(low.x, low.y), (high.x, low.y), (high.x, high.y), (low.x, high.y)];
    for side in 0..4 {
        let next = (side + 1) % 4;
        let [(ox, oy), (px, py)] = [outer[side], outer[next]];
        let [(ix, iy), (jx, jy)] = [inner[side], inner[next]];
        walls.quad(at(ox, oy, 0.0), at(px, py, 0.0), at(jx, jy, 0.0), at(ix, iy, 0.0));
        walls.quad(at(ix, iy, 0.0), at(jx, jy, 0.0), at(jx, jy, DEEP), at(ix, iy, DEEP));
    }
    pane.rectangle(low, high, |x, y| at(x, y, DEEP));
    let ledge = |x: f32, y: f32, out: f32| at(x, low.y + y, -out);
    let (l, r) = (low.x - 0.1, high.x + 0.1);
    walls.quad(ledge(l, -0.12, 0.12), ledge(r, -0.12, 0.12), ledge(r, 0.0, 0.12), ledge(l, 0.0, 0.12));
    walls.quad(ledge(l, 0.0, 0.12), ledge(r, 0.0, 0.12), ledge(r, 0.0, 0.0), ledge(l, 0.0, 0.0));
    walls.quad(ledge(l, -0.12, 0.0), ledge(r, -0.12, 0.0), ledge(r, -0.12, 0.12), ledge(l, -0.12, 0.12));
    // One mullion and one transom before the pane.
    let (x, y) = ((low.x + high.x) * 0.5, (low.y + high.y) * 0.5);
    let deep = DEEP - 0.04;
    let before = |x: f32, y: f32| at(x, y, deep);
    walls.rectangle(Vec2::new(x - 0.04, low.y), Vec2::new(x + 0.04, high.y), before);
    walls.rectangle(Vec2::new(low.x, y - 0.03), Vec2::new(high.x, y + 0.03), before);
}

fn parapet(walls: &mut Shapes, top: Vec3, size: Vec2) {
    let (thick, high) = (0.3, 0.9);
    for z in [0.0, size.y - thick] {
        walls.open_cuboid(top + Vec3::new(0.0, 0.0, z), top + Vec3::new(size.x, high, z + thick), false);
    }
    for x in [0.0, size.x - thick] {
        walls.open_cuboid(
            top + Vec3::new(x, 0.0, thick),
            top + Vec3::new(x + thick, high, size.y - thick),
            false,
        );
    }
}

/// Machine boxes, a water tank on legs, an aerial.
fn rooftop(generator: &mut Generator, shapes: &mut Shapes, top: Vec3, size: Vec2) {
    for _ in 0..2 + generator.below(4) {
        let at = top
            + Vec3::new(generator.between(0.15, 0.7) * size.x, 0.0, generator.between(0.15, 0.7) * size.y);
        let extent = generator.within(Vec3::new(1.2, 0.8, 1.2), Vec3::new(3.0, 2.4, 3.0));
        shapes.open_cuboid(at, at + extent, false);
    }
    let at = top + Vec3::new(generator.between(0.3, 0.7) * size.x, 0.0, generator.between(0.3, 0.7) * size.y);
    if generator.chance(0.5) {
        for (x, z) in [(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)] {
            let foot = at + Vec3::new(x, 0.0, z);
            shapes.rod(foot, foot + Vec3::Y * 2.4, 0.08, 5);
        }
        let tank =
            [(1.3, 2.4), (1.3, 2.4), (1.3, 4.8), (1.3, 4.8), (0.02, 5.8)].map(|(r, y)| Vec2::new(r, y));
        shapes.lathe(at, &tank, 16);
        shapes.disc(at + Vec3::Y * 2.4, 1.3, 16);
    } else {
        shapes.rod(at, at + Vec3::Y * generator.between(5.0, 14.0), 0.06, 5);
    }
}

/// Lamps, trees and parked cars along the kerb.
fn furniture(generator: &mut Generator, kit: &Kit, low: Vec3, high: Vec3) -> Result<(), SceneError> {
    let (mut posts, mut bulbs, mut trunks, mut crowns) =
        (Shapes::new(), Shapes::new(), Shapes::new(), Shapes::new());
    let y = high.y;
    let length = high.x - low.x;
    for side in 0..4 {
        let place = |along: f32, inward: f32| match side {
            0 => Vec3::new(low.x + along, y, low.z + inward),
            1 => Vec3::new(high.x - inward, y, low.z + along),
            2 => Vec3::new(high.x - along, y, high.z - inward),
            _ => Vec3::new(low.x + inward, y, high.z - along),
        };
        for lamp in 0..3 {
            let foot = place((lamp as f32 + 0.5) * length / 3.0, 0.5);
            let outward = foot - place((lamp as f32 + 0.5) * length / 3.0, 1.5);
            let head = foot + Vec3::Y * 5.4 + outward * 1.3;
            posts.tube(&[foot, foot + Vec3::Y * 4.6, foot + Vec3::Y * 5.3 + outward * 0.4, head], 0.07, 6);
            bulbs.sphere(head - Vec3::Y * 0.1, 0.18, 8, 5);
        }
        for tree in 0..4 {
            if generator.chance(0.75) {
                let foot = place((tree as f32 + 0.25) * length / 4.0, 1.2);
                plant(generator, &mut trunks, &mut crowns, foot);
            }
        }
        for slot in 0..5 {
            if generator.chance(0.45) {
                let along = (slot as f32 + 0.5) * length / 5.0;
                let (from, to) = (place(along - 2.1, -1.2), place(along + 2.1, -1.2));
                car(generator, kit, from.with_y(0.0), to.with_y(0.0))?;
            }
        }
    }
    generator.add("lamp posts", kit.steel, &posts)?;
    generator.add("street lamps", kit.lamp, &bulbs)?;
    generator.add("trunks", kit.trunk, &trunks)?;
    generator.add("crowns", kit.leaves, &crowns)
}

fn plant(generator: &mut Generator, trunks: &mut Shapes, crowns: &mut Shapes, foot: Vec3) {
    let height = generator.between(2.2, 3.4);
    trunks.rod(foot, foot + Vec3::Y * height, 0.14, 6);
    let (middle, radius) = (foot + Vec3::Y * (height + 1.0), generator.between(1.2, 1.9));
    let phase = generator.between(0.0, 6.0);
    crowns.surface(12, 8, true, |u, v| {
        let bumps = 1.0 + 0.16 * (u * 31.4 + v * 9.0 + phase).sin() * (v * 17.0 + phase).cos();
        let out = on_sphere(2.0 * PI * u, PI * (v - 0.5)) * Vec3::new(1.0, 1.15, 1.0);
        middle + out * (radius * bumps)
    });
}

/// A car between two ends, from rear to front.
fn car(generator: &mut Generator, kit: &Kit, rear: Vec3, front: Vec3) -> Result<(), SceneError> {
    let along = (front - rear) / 8.0;
    let side = Vec3::Y.cross(along).normalize_or(Vec3::X);
    let outline =
        [(0.0, 0.35), (8.0, 0.35), (8.0, 0.75), (6.3, 0.9), (5.0, 1.4), (2.2, 1.42), (0.9, 0.95), (0.0, 0.9)];
    let section: Vec<Vec2> = outline.iter().map(|(x, y)| Vec2::new(*x, *y)).collect();
    let mut body = Shapes::new();
    let frame = |offset: f32| (rear + side * offset, along, Vec3::Y);
    // The body is its side view, drawn across its width, with the two sides closed.
    body.sweep(&section, &[frame(0.85), frame(-0.85)]);
    for offset in [-0.85, 0.85] {
        let corners: Vec<Vec3> =
            section.iter().map(|p| rear + side * offset + along * p.x + Vec3::Y * p.y).collect();
        for pair in corners[1..].windows(2) {
            if offset > 0.0 {
                body.triangle(corners[0], pair[1], pair[0]);
            } else {
                body.triangle(corners[0], pair[0], pair[1]);
            }
        }
    }
    generator.add(
        "car",
        kit.cars[(rear.x.abs() * 7.0 + rear.z.abs() * 3.0) as usize % kit.cars.len()],
        &body,
    )?;
    let mut wheels = Shapes::new();
    for x in [1.5, 6.4] {
        for offset in [-0.8, 0.62] {
            let hub = rear + along * x + Vec3::Y * 0.33 + side * offset;
            wheels.rod(hub, hub + side * 0.18, 0.33, 10);
        }
    }
    generator.add("wheels", kit.asphalt, &wheels)
}

/// A lawn with trees.
fn park(generator: &mut Generator, kit: &Kit, low: Vec3, high: Vec3) -> Result<(), SceneError> {
    let mut grass = Shapes::new();
    let inset = Vec3::new(4.0, 0.0, 4.0);
    grass.bevelled_slab(low + inset, high - inset + Vec3::Y * 0.12, 0.08);
    generator.add("lawn", matt(0.16, 0.3, 0.08), &grass)?;
    let (mut trunks, mut crowns) = (Shapes::new(), Shapes::new());
    for _ in 0..40 {
        let foot = Vec3::new(
            generator.between(low.x + 7.0, high.x - 7.0),
            high.y + 0.12,
            generator.between(low.z + 7.0, high.z - 7.0),
        );
        plant(generator, &mut trunks, &mut crowns, foot);
    }
    generator.add("trunks", kit.trunk, &trunks)?;
    generator.add("crowns", kit.leaves, &crowns)
}

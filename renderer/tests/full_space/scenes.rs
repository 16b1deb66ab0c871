//! Small scenes of every kind: flat, of instances, with masks, and all in motion.

use std::{path::Path, sync::Arc};

use glam::{Affine3A, Quat, Vec2, Vec3, Vec3A};
use treewright_accel::{Card, Instance, Mask, Wrap};
use treewright_scene::assemble::{Assembler, Lighting};
use treewright_scene::{Material, Scene, Sky, framing::CameraPose, part::Part, shapes::Shapes};

/// The scene that a structure is built over.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kind {
    instanced: bool,
    masked: bool,
    moving: bool,
}

impl Kind {
    /// All but one of everything.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        (0..7).map(|kind| Self { instanced: kind & 1 != 0, masked: kind & 2 != 0, moving: kind & 4 != 0 })
    }

    /// The scene, and for one that moves its state a moment later.
    pub(crate) fn scenes(self) -> Vec<Arc<Scene>> {
        let room = room(self.instanced);
        let scene = if self.masked { masked(room) } else { room };
        let later = self.moving.then(|| Arc::new(later(&scene)));
        [Arc::new(scene)].into_iter().chain(later).collect()
    }
}

/// A room with a lamp, shiny balls behind panes of glass, and an object that nothing places.
fn room(instanced: bool) -> Scene {
    let mut assembler = Assembler::new("room", Path::new("room"));
    let wall = assembler.material(Material::default());
    let shiny = assembler.material(Material { metallic: 1.0, roughness: 0.3, ..Material::default() });
    let glass = assembler.material(Material { transmission: 0.9, roughness: 0.0, ..Material::default() });
    let light = assembler.material(Material { emission: Vec3::new(6.0, 5.0, 3.0), ..Material::default() });
    let (mut ball, mut bulb, mut pane) = (Shapes::new(), Shapes::new(), Shapes::new());
    ball.sphere(Vec3::new(0.0, 0.6, 0.0), 0.6, 12, 8);
    bulb.cuboid(Vec3::new(-0.2, 1.3, -0.3), Vec3::new(0.3, 1.4, 0.3));
    let corner = |x: f32, y: f32| Vec3::new(x, y, 0.9);
    pane.quad(corner(-0.4, 0.0), corner(0.4, 0.0), corner(0.4, 1.2), corner(-0.4, 1.2));
    assembler.mesh("room", wall, &walls()).expect("the mesh is sound");
    if instanced {
        assembler.begin_object();
    }
    assembler.mesh("ball", shiny, &ball.part).expect("the mesh is sound");
    assembler.mesh("bulb", light, &bulb.part).expect("the mesh is sound");
    assembler.mesh("pane", glass, &pane.part).expect("the mesh is sound");
    if instanced {
        let lamp = assembler.end_object();
        place_around(&mut assembler, lamp, 5);
        assembler.begin_object();
        assembler.mesh("nowhere", wall, &ball.part).expect("the mesh is sound");
        assembler.end_object();
    }
    assembler.finish(Lighting::Given(Sky::BLACK), vec![view()]).expect("the scene is sound")
}

pub(crate) fn walls() -> Part {
    let mut room = Shapes::new();
    room.cuboid(Vec3::new(-4.0, 0.0, -4.0), Vec3::new(4.0, 4.0, 4.0));
    room.part.indices.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    room.part.normals.iter_mut().for_each(|normal| *normal = -*normal);
    room.part
}

/// Places an object in a circle, turned, squeezed and mirrored.
pub(crate) fn place_around(assembler: &mut Assembler, object: u32, count: u32) {
    for number in 0..count {
        let angle = number as f32;
        let mirror = if number % 2 == 0 { 1.0 } else { -1.0 };
        assembler.place(
            object,
            Affine3A::from_scale_rotation_translation(
                Vec3::new(mirror * (0.6 + 0.1 * angle), 1.2, 0.7),
                Quat::from_rotation_y(angle) * Quat::from_rotation_x(0.3),
                Vec3::new(2.5 * angle.cos(), 0.4, 2.5 * angle.sin()),
            ),
        );
    }
}

/// From one wall to the other.
pub(crate) fn view() -> CameraPose {
    CameraPose {
        position: Vec3::new(0.0, 2.6, 3.8),
        forward: Vec3::new(0.0, -0.35, -1.0),
        up: Vec3::Y,
        vertical_fov_deg: 65.0,
        framed_aspect: None,
        distance: None,
    }
}

/// The scene with holes in every other triangle.
fn masked(scene: Scene) -> Scene {
    let alpha: Vec<u8> = (0..64)
        .map(|pixel: u32| if (pixel % 8 / 2 + pixel / 16).is_multiple_of(2) { 255 } else { 0 })
        .collect();
    let mask = Mask::new(8, 8, alpha.into(), 0.5, [Wrap::Repeat, Wrap::Mirror]).expect("it has its pixels");
    let corners = [Vec2::ZERO, Vec2::new(2.5, 0.0), Vec2::new(0.0, 2.5)];
    let every_other = (0..scene.triangles.len() as u32).filter(|triangle| triangle.is_multiple_of(2));
    let cards = every_other.map(|triangle| (triangle, Card { mask: 0, corners }));
    let triangles = (*scene.triangles).clone().masked(vec![mask], cards).expect("triangles and mask exist");
    Scene { triangles: Arc::new(triangles), ..scene }
}

/// Everything waved to and fro, and each instance turned by an angle of its own.
fn later(scene: &Scene) -> Scene {
    let moved = scene.triangles.positions().iter().map(|position| {
        *position + Vec3A::new(0.2 * (3.0 * position.y).sin(), 0.0, 0.1 * (2.0 * position.x).cos())
    });
    let triangles = scene.triangles.moved(moved.collect()).expect("the scene is sound");
    let instances = scene.instances.as_ref().map(|instances| {
        let turned = |(number, one): (u8, &Instance)| {
            Affine3A::from_rotation_y(0.05 * f32::from(number)) * one.to_world
        };
        let places = (0..).zip(instances.placed()).map(turned);
        Arc::new(instances.moved(places).expect("turned ones can be inverted"))
    });
    Scene { triangles: Arc::new(triangles), instances, ..scene.clone() }
}

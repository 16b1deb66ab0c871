//! Geometry as rays meet it: every triangle where its instances place it.
//!
//! A scene without instances is met as it is. A scene with instances is not flattened: each question computes
//! the placed triangles that it needs, and keeps none.

use std::ops::Range;

use glam::{Vec3, Vec3A};
use treewright_accel::{Instance, Instances, NO_INSTANCE, Triangles};

use super::{Bounds, Mesh, Scene};

/// Triangles and where they stand.
#[derive(Clone, Copy, Debug)]
pub struct Placed<'a> {
    triangles: &'a Triangles,
    instances: Option<&'a Instances>,
}

impl<'a> Placed<'a> {
    /// Triangles in world space.
    pub fn flat(triangles: &'a Triangles) -> Self {
        Self { triangles, instances: None }
    }

    /// Triangles in world space, or with instances in the objects' spaces.
    pub fn new(triangles: &'a Triangles, instances: Option<&'a Instances>) -> Self {
        Self { triangles, instances }
    }

    /// All triangles, whether placed or not.
    pub fn triangles(&self) -> &'a Triangles {
        self.triangles
    }

    /// Where they stand, if not in the world itself.
    pub fn instances(&self) -> Option<&'a Instances> {
        self.instances
    }

    /// Triangles as rays meet them: those of every instance counted.
    pub fn count(&self) -> u64 {
        self.instances.map_or(self.triangles.len() as u64, Instances::placed_triangles)
    }

    /// The corners of a triangle in the world, as it is met in an instance ([`NO_INSTANCE`] for none).
    #[inline]
    pub fn corners(&self, triangle: u32, instance: u32) -> [Vec3A; 3] {
        let corners = self.triangles.corners(triangle as usize);
        match self.instances.and_then(|instances| instances.placed().get(instance as usize)) {
            Some(instance) => corners.map(|corner| instance.to_world.transform_point3a(corner)),
            None => corners,
        }
    }

    /// The box around every placed triangle; a point at the origin when there is none.
    pub fn bounds(&self) -> Bounds {
        let Some(instances) = self.instances else { return Bounds::of(self.triangles) };
        let boxes = self.object_boxes();
        let mut bounds = Bounds::NOTHING;
        for (number, instance) in instances.placed().iter().enumerate() {
            // Only an instance whose transformed box sticks out can have a triangle that does.
            let about = boxes[instance.object as usize].transformed(&instance.to_world);
            if bounds.union(&about) == bounds {
                continue;
            }
            for triangle in instances.objects()[instance.object as usize].clone() {
                for corner in self.corners(triangle, number as u32).map(Vec3::from) {
                    bounds = bounds.union(&Bounds { min: corner, max: corner });
                }
            }
        }
        if bounds.min.x > bounds.max.x { Bounds { min: Vec3::ZERO, max: Vec3::ZERO } } else { bounds }
    }

    /// The box around each object in its own space; nothing around an empty one.
    pub(crate) fn object_boxes(&self) -> Vec<Bounds> {
        let objects = self.instances.map_or(&[][..], Instances::objects);
        objects.iter().map(|range| self.box_of(range)).collect()
    }

    fn box_of(&self, range: &Range<u32>) -> Bounds {
        if range.is_empty() {
            return Bounds::NOTHING;
        }
        Bounds::of(&self.triangles.part(range.start as usize..range.end as usize))
    }
}

impl Scene {
    /// Its triangles and where they stand.
    pub fn placed(&self) -> Placed<'_> {
        Placed::new(&self.triangles, self.instances.as_deref())
    }

    /// The box around all that rays can meet.
    pub fn bounds(&self) -> Bounds {
        self.placed().bounds()
    }

    /// An instance by the number a hit carries; nothing for [`NO_INSTANCE`].
    #[inline]
    pub fn instance(&self, number: u32) -> Option<&Instance> {
        self.instances.as_ref()?.placed().get(number as usize)
    }

    /// Every mesh with its instance, instance by instance; once with [`NO_INSTANCE`] without instances.
    pub fn placed_meshes(&self) -> impl Iterator<Item = (&Mesh, u32)> {
        let instances = self.instances.as_deref();
        let flat = if instances.is_none() { &self.meshes[..] } else { &[] };
        let placed = instances.map_or(&[][..], Instances::placed).iter().enumerate();
        let of_instance = placed.flat_map(move |(number, instance)| {
            let range =
                instances.map_or(0..0, |instances| instances.objects()[instance.object as usize].clone());
            self.meshes_of(&range).iter().map(move |mesh| (mesh, number as u32))
        });
        flat.iter().map(|mesh| (mesh, NO_INSTANCE)).chain(of_instance)
    }

    fn meshes_of(&self, range: &Range<u32>) -> &[Mesh] {
        let first = self.meshes.partition_point(|mesh| mesh.first_triangle < range.start);
        let end = self.meshes.partition_point(|mesh| mesh.first_triangle < range.end);
        &self.meshes[first..end.max(first)]
    }
}

#[cfg(test)]
mod tests {
    use std::{path::Path, sync::Arc};

    use glam::{Affine3A, Quat};
    use proptest::prelude::*;

    use super::*;
    use crate::assemble::{Assembler, Lighting};
    use crate::{Material, shapes::Shapes};

    /// A sphere and a box as objects of their own, placed as given.
    fn scene(placed: &[(u32, Affine3A)]) -> Scene {
        let mut assembler = Assembler::new("test", Path::new("test"));
        let matt = assembler.material(Material::default());
        let (mut ball, mut block) = (Shapes::new(), Shapes::new());
        ball.sphere(Vec3::new(0.2, 0.1, 0.0), 1.0, 12, 6);
        block.cuboid(Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0));
        assembler.mesh("ball", matt, &ball.part).unwrap();
        assembler.mesh("block", matt, &block.part).unwrap();
        let mut scene = assembler.finish(Lighting::Automatic, vec![]).unwrap();
        let (end, all) = (scene.meshes[1].first_triangle, scene.triangles.len() as u32);
        let instances = Instances::new(all as usize, vec![0..end, end..all, end..end], placed.to_vec());
        scene.instances = Some(Arc::new(instances.unwrap()));
        scene
    }

    #[test]
    fn meshes_are_counted_where_they_stand() {
        let at = |x: f32| Affine3A::from_translation(Vec3::X * x);
        let scene = scene(&[(1, at(0.0)), (0, at(5.0)), (1, at(9.0)), (2, at(2.0))]);
        let met: Vec<_> =
            scene.placed_meshes().map(|(mesh, instance)| (mesh.name.as_str(), instance)).collect();
        assert_eq!(met, [("block", 0), ("ball", 1), ("block", 2)]);
        let count: u32 = scene.placed_meshes().map(|(mesh, _)| mesh.triangle_count).sum();
        assert_eq!(scene.placed().count(), u64::from(count));
        assert!(scene.bounds().max.x == 10.0 && scene.bounds().min.x == 0.0);
        assert_eq!(scene.placed().corners(0, 1)[0], scene.triangles.corners(0)[0] + Vec3A::X * 5.0);
    }

    proptest! {
        #[test]
        fn the_box_is_that_of_all_placed_corners(
            moves in proptest::collection::vec((0u32..3, prop::array::uniform3(-9.0f32..9.0), 0.0f32..6.0, 0.2f32..3.0), 1..8),
        ) {
            let placed: Vec<_> = moves
                .into_iter()
                .map(|(object, at, turn, scale)| {
                    let by = Affine3A::from_scale_rotation_translation(
                        Vec3::new(scale, 1.0, -scale),
                        Quat::from_rotation_y(turn) * Quat::from_rotation_x(turn * 0.7),
                        Vec3::from_array(at),
                    );
                    (object, by)
                })
                .collect();
            let scene = scene(&placed);
            let mut expected = Bounds::NOTHING;
            for (mesh, instance) in scene.placed_meshes() {
                for triangle in mesh.first_triangle..mesh.first_triangle + mesh.triangle_count {
                    for corner in scene.placed().corners(triangle, instance).map(Vec3::from) {
                        expected = expected.union(&Bounds { min: corner, max: corner });
                    }
                }
            }
            let bounds = scene.bounds();
            if expected.min.x <= expected.max.x {
                prop_assert_eq!(bounds, expected);
            } else {
                prop_assert_eq!(bounds.diagonal(), 0.0);
            }
        }
    }
}

//! Rays into placed objects: the leaves of the upper level of two.
//!
//! A ray is taken into the object's space and given to the object's own kernels. Its direction is not
//! normalised there, so that distances are equal in both spaces and the nearest hit so far ends the walks of
//! both levels. A packet stays together: all its rays are taken over at once and go on as a packet below.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use std::marker::PhantomData;

use super::lanes::{Lanes, Stored};
use super::packet::bundle::{Bundle, Hits, each_lane};
use super::{Kernels, LevelClosest, LevelOccluded, kernel::Leaves, packet::PacketLeaves};
use crate::geometry::{Hit, NO_TRIANGLE, Ray};
use crate::layout::{NodeRef, PlacedPart, Root};

/// An object's tree.
#[derive(Clone, Debug)]
pub(crate) struct Object {
    pub(crate) root: Root,
    /// Number of its first triangle.
    pub(crate) first: u32,
}

/// The level below: trees of one kind.
#[derive(Debug)]
pub(crate) struct Lower {
    pub(crate) objects: Vec<Object>,
    pub(crate) kernels: Kernels,
}

/// The ray in a space given by rows of three factors and a translation, as [`Bundle::moved`] does.
#[inline(always)]
pub(crate) fn moved(ray: &Ray, rows: &[[f32; 4]; 3], t_max: f32) -> Ray {
    let turned = |[x, y, z, _]: [f32; 4], v: glam::Vec3| v.x * x + v.y * y + v.z * z;
    let origin = |row: [f32; 4]| turned(row, ray.origin) + row[3];
    let [a, b, c] = *rows;
    Ray {
        origin: glam::Vec3::new(origin(a), origin(b), origin(c)),
        direction: glam::Vec3::new(
            turned(a, ray.direction),
            turned(b, ray.direction),
            turned(c, ray.direction),
        ),
        t_min: ray.t_min,
        t_max,
    }
}

/// One ray in leaves of placed parts.
#[derive(Clone, Copy)]
pub(crate) struct PlacedLeaves<'a> {
    pub(crate) lower: &'a Lower,
    pub(crate) ray: &'a Ray,
}

impl Leaves for PlacedLeaves<'_> {
    #[inline(always)]
    unsafe fn closest(&self, leaf: NodeRef, hit: &mut Hit) {
        for part in leaf.items::<PlacedPart>() {
            let object = &self.lower.objects[part.object as usize];
            let mut found = Hit::none(hit.t);
            let ray = moved(self.ray, &part.to_object, hit.t);
            (self.lower.kernels.closest)(&object.root, part.node, &ray, &mut found);
            if found.triangle != NO_TRIANGLE {
                *hit = Hit { triangle: object.first + found.triangle, instance: part.instance, ..found };
            }
        }
    }

    #[inline(always)]
    unsafe fn any(&self, leaf: NodeRef, t_max: f32) -> bool {
        leaf.items::<PlacedPart>().iter().any(|part| {
            let object = &self.lower.objects[part.object as usize];
            let ray = moved(self.ray, &part.to_object, t_max);
            // SAFETY: the caller vouches for the leaf, and the kernels are those of the objects' trees.
            unsafe { (self.lower.kernels.occluded)(&object.root, part.node, &ray) }
        })
    }
}

/// An upper level, and its single-ray queries.
#[derive(Clone, Copy)]
pub(crate) struct LevelTree<'a> {
    pub(crate) root: &'a Root,
    pub(crate) lower: &'a Lower,
    pub(crate) closest: LevelClosest,
    pub(crate) occluded: LevelOccluded,
}

pub(crate) struct PacketPlacedLeaves<'a, L> {
    lower: &'a Lower,
    lanes: PhantomData<L>,
}

impl<'a, L: Lanes> PacketLeaves for PacketPlacedLeaves<'a, L> {
    type Rays = L;
    type Tree = LevelTree<'a>;

    #[inline(always)]
    unsafe fn new(tree: LevelTree<'a>, _rays: &Bundle) -> Self {
        Self { lower: tree.lower, lanes: PhantomData }
    }

    #[inline(always)]
    unsafe fn closest(&self, rays: &Bundle, leaf: NodeRef, active: u32, hits: &mut Hits) {
        let Lower { objects, kernels } = self.lower;
        for part in leaf.items::<PlacedPart>() {
            let object = &objects[part.object as usize];
            let before = hits.ends::<L>();
            let rays = rays.moved::<L>(&part.to_object);
            (kernels.packet_closest)(&object.root, part.node, kernels.closest, &rays, active, hits);
            each_lane(L::bits(hits.ends::<L>().less(before)) & active, |lane| {
                hits.triangles[lane] += object.first;
                hits.instances[lane] = part.instance;
            });
        }
    }

    #[inline(always)]
    unsafe fn any(&self, rays: &Bundle, leaf: NodeRef, active: u32, ends: &Stored) -> u32 {
        let Lower { objects, kernels } = self.lower;
        let mut open = active;
        for part in leaf.items::<PlacedPart>() {
            let root = &objects[part.object as usize].root;
            let rays = rays.moved::<L>(&part.to_object);
            open &= !(kernels.packet_occluded)(root, part.node, kernels.occluded, &rays, open, ends);
        }
        active & !open
    }

    #[inline(always)]
    unsafe fn closest_alone(tree: LevelTree<'a>, node: NodeRef, ray: &Ray, hit: &mut Hit) {
        (tree.closest)(tree.root, tree.lower, node, ray, hit);
    }

    #[inline(always)]
    unsafe fn any_alone(tree: LevelTree<'a>, node: NodeRef, ray: &Ray) -> bool {
        (tree.occluded)(tree.root, tree.lower, node, ray)
    }
}

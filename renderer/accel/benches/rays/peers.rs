//! The crate `obvhs` as its documentation advises: a binary tree and a compressed eight-wide one, no packets.

use std::time::Duration;

use glam::Vec3A;
use obvhs::{
    BvhBuildParams, bvh2::Bvh2, bvh2::builder::build_bvh2_from_tris, cwbvh::CwBvh,
    cwbvh::builder::build_cwbvh_from_tris, ray::RayHit, triangle::Triangle,
};
use treewright_accel::{Hit, Intersector, NO_INSTANCE, Ray, Triangles};

/// Trees of the crate `obvhs` over triangles in the order of its leaves.
pub(crate) struct Obvhs<T> {
    tree: T,
    ordered: Vec<Triangle>,
    numbers: Vec<u32>,
}

/// Makes a tree of `obvhs` with its slowest and best preset.
macro_rules! obvhs {
    ($tree:ty, $build:path) => {
        impl Obvhs<$tree> {
            pub(crate) fn build(triangles: &Triangles) -> Self {
                let all: Vec<Triangle> = (0..triangles.len())
                    .map(|number| {
                        let [v0, v1, v2] = triangles.corners(number);
                        Triangle { v0, v1, v2 }
                    })
                    .collect();
                let tree = $build(&all, BvhBuildParams::slow_build(), &mut Duration::default());
                let numbers = tree.primitive_indices.clone();
                let ordered = numbers.iter().map(|&number| all[number as usize]).collect();
                Self { tree, ordered, numbers }
            }
        }

        impl Intersector for Obvhs<$tree> {
            fn closest(&self, ray: &Ray) -> Option<Hit> {
                let query = to_obvhs(ray);
                let mut hit = RayHit::none();
                self.tree.ray_traverse(query, &mut hit, |ray, place| self.ordered[place].intersect(ray));
                (hit.primitive_id != obvhs::ray::INVALID_ID).then(|| Hit {
                    t: hit.t,
                    // The crate computes them only on request.
                    u: 0.0,
                    v: 0.0,
                    triangle: self.numbers[hit.primitive_id as usize],
                    instance: NO_INSTANCE,
                })
            }

            fn occluded(&self, ray: &Ray) -> bool {
                !self.tree.ray_traverse_miss(to_obvhs(ray), |ray, place| self.ordered[place].intersect(ray))
            }
        }
    };
}

obvhs!(Bvh2, build_bvh2_from_tris);
obvhs!(CwBvh, build_cwbvh_from_tris);

fn to_obvhs(ray: &Ray) -> obvhs::ray::Ray {
    obvhs::ray::Ray::new(Vec3A::from(ray.origin), Vec3A::from(ray.direction), ray.t_min, ray.t_max)
}

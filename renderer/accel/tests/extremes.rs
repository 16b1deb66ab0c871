//! Extreme geometry and rays, over every back end: see `docs/measurements/extreme-geometry.md`.

use std::sync::Arc;

use glam::{Quat, Vec3, Vec3A};
use rand::RngExt;
use treewright_accel::{
    BuildChoice, BuildError, GeometryError, Intersector, Ray, TreeParameters, Triangles, build,
};

mod scenes;

use scenes::back_ends::{self, device, each};
use scenes::verdict::{Verdict, check};

/// Rays from a sphere around a point towards points near it.
fn towards(center: Vec3, from: f32, near: f32, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = scenes::random(seed);
    let ray = |_| {
        let origin = center + scenes::on_sphere(&mut random) * from;
        let target = center + Vec3::from(scenes::in_cube(&mut random)) * near;
        Ray { origin, direction: (target - origin).normalize_or(Vec3::X), t_min: 0.0, t_max: f32::INFINITY }
    };
    (0..count).map(ray).collect()
}

/// Needles of length 2 and width 2e-6, turned every way. `begin` says which corner comes first.
fn needles(begin: usize) -> Arc<Triangles> {
    let mut random = scenes::random(81);
    let needles = (0..300).map(|_| {
        let rotation = Quat::from_axis_angle(scenes::on_sphere(&mut random), random.random_range(0.0..6.3));
        let at = Vec3::from(scenes::in_cube(&mut random));
        let corners = [Vec3::X, Vec3::new(1.0, 2e-6, 0.0), Vec3::NEG_X].map(|corner| at + rotation * corner);
        std::array::from_fn(|corner| Vec3A::from(corners[(begin + corner) % 3]))
    });
    let needles: Vec<[Vec3A; 3]> = needles.collect();
    let ordinary = scenes::soup(200, 0.3, 82);
    scenes::separate(needles.into_iter().chain((0..ordinary.len()).map(|number| ordinary.corners(number))))
}

#[test]
fn needles_of_aspect_a_million() {
    for begin in 0..3 {
        let triangles = needles(begin);
        let mut rays = towards(Vec3::ZERO, 4.0, 1.0, 300, 83);
        // At points of the needles themselves.
        let mut random = scenes::random(84);
        rays.extend((0..100).map(|needle| {
            let [a, b, c] = triangles.corners(needle);
            let target = Vec3::from(a + (b - a) * 0.4 + (c - a) * 0.3);
            let origin = target + scenes::on_sphere(&mut random) * 2.0;
            Ray { origin, direction: target - origin, t_min: 0.0, t_max: f32::INFINITY }
        }));
        check("needles", &triangles, &rays, 20);
    }
}

#[test]
fn no_triangle_at_all() {
    check("nothing", &Arc::default(), &scenes::rays(20, 14), 0);
}

#[test]
fn all_triangles_coincide() {
    let one = [Vec3A::new(-1.0, -1.0, 0.1), Vec3A::new(1.0, -1.0, 0.2), Vec3A::new(0.0, 1.0, 0.0)];
    check("coincident", &scenes::separate(vec![one; 1000]), &towards(Vec3::ZERO, 3.0, 1.0, 200, 85), 90);
}

#[test]
fn all_centroids_coincide() {
    let mut random = scenes::random(86);
    let triangles = scenes::separate((0..400).map(|_| {
        let (a, b) = (scenes::in_cube(&mut random), scenes::in_cube(&mut random));
        [a, b, -(a + b)]
    }));
    check("concentric", &triangles, &towards(Vec3::ZERO, 4.0, 1.0, 300, 87), 90);
}

#[test]
fn triangles_without_area_are_not_there() {
    let mut random = scenes::random(88);
    let flat = (0..300).flat_map(|_| {
        let (a, b) = (scenes::in_cube(&mut random), scenes::in_cube(&mut random));
        [[a; 3], [a, b, a], [a, b, b], [a, a, b], [a, b, (a + b) * 0.5]]
    });
    let flat: Vec<[Vec3A; 3]> = flat.collect();
    let real = scenes::soup(100, 0.5, 89);
    let triangles =
        scenes::separate(flat.into_iter().chain((0..real.len()).map(|number| real.corners(number))));
    check("without area", &triangles, &towards(Vec3::ZERO, 3.0, 1.0, 300, 90), 90);
}

#[test]
fn vertices_that_are_no_numbers_or_too_large_are_refused() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e15, -3e38] {
        for axis in 0..3 {
            let mut corners = vec![Vec3A::ZERO, Vec3A::X, Vec3A::Y];
            corners[1][axis] = bad;
            let refused = Triangles::new(corners, vec![[0, 1, 2]]).expect_err("it cannot be met");
            assert_eq!(refused, GeometryError::BadCoordinate(1));
        }
    }
}

/// A scene of ordinary shape, scaled and moved.
fn placed(scale: f32, offset: Vec3) -> Arc<Triangles> {
    let soup = scenes::soup(300, 0.3, 91);
    let place = |corner: Vec3A| corner * scale + Vec3A::from(offset);
    scenes::separate((0..soup.len()).map(|number| soup.corners(number).map(place)))
}

#[test]
fn small_and_large_coordinates() {
    for scale in [1e-6, 1e-3, 1e4, 1e8, 5e11] {
        check(
            &format!("scale {scale:e}"),
            &placed(scale, Vec3::ZERO),
            &towards(Vec3::ZERO, 3.0 * scale, scale, 200, 92),
            90,
        );
    }
}

#[test]
fn tiny_coordinates_give_no_hit_or_a_right_one() {
    for scale in [1e-8, 1e-12, 1e-15, 1e-20, 1e-30, 1e-38] {
        let triangles = placed(scale, Vec3::ZERO);
        let rays = towards(Vec3::ZERO, 3.0 * scale, scale, 100, 93);
        let verdicts: Vec<Verdict> = rays.iter().map(|ray| Verdict::of(&triangles, ray)).collect();
        each(&triangles, |what, structure| {
            for (ray, verdict) in rays.iter().zip(&verdicts) {
                let found = structure.closest(ray);
                // Native watertight scenes answer with weights of 0 from 1e-8, a distance of 0 below 1e-12.
                let objection =
                    found.filter(|hit| hit.t > 0.0).and_then(|_| verdict.placement_objection(found));
                assert_eq!(objection, None, "scale {scale:e}, {what}: {ray:?} gave {found:?}");
            }
        });
    }
}

#[test]
fn far_from_the_origin() {
    for offset in [1e3, 1e5, 1e7] {
        let center = Vec3::new(offset, -offset, offset);
        // At 1e7 numbers are 1 apart: nothing of detail 1e-2 is left, the rest is met rightly.
        for scale in [1e-2, 1.0, 1e3] {
            let rays = towards(center, 3.0 * scale + 10.0, scale, 100, 94);
            check(&format!("{scale} at {offset:e}"), &placed(scale, center), &rays, 0);
        }
        check(
            &format!("{offset:e}"),
            &placed(offset, center),
            &towards(center, 3.0 * offset, offset, 100, 95),
            90,
        );
    }
}

#[test]
fn too_little_depth_is_infeasible_or_a_right_tree() {
    let triangles = scenes::soup(20_000, 0.01, 96);
    let mut infeasible = 0;
    for parameters in back_ends::trees() {
        let shallow = TreeParameters { max_depth: 9, min_leaf_size: 1, max_leaf_size: 1, ..parameters };
        match build(&device(), &triangles, &BuildChoice::Tree(shallow)) {
            Ok(treewright_accel::Structure::Tree(tree)) => {
                tree.validate().unwrap_or_else(|fault| panic!("{shallow:?}: {fault}"));
            }
            Ok(other) => panic!("{shallow:?} gave {other:?}"),
            Err(error) => {
                assert_eq!(error, BuildError::DepthLimit(9), "{shallow:?}");
                assert!(error.is_infeasible());
                infeasible += 1;
            }
        }
    }
    assert!(infeasible > 0, "2^9 leaves are too few");
}

#[test]
fn costs_at_their_limits_build_right_trees() {
    let triangles = scenes::soup(800, 0.1, 98);
    let rays = scenes::rays(100, 99);
    let verdicts: Vec<Verdict> = rays.iter().map(|ray| Verdict::of(&triangles, ray)).collect();
    for parameters in back_ends::trees() {
        for (traversal_cost, intersection_cost) in
            [(0.0, 1.0), (0.0, 10.0), (10.0, f32::MIN_POSITIVE), (10.0, 10.0), (0.0, f32::MIN_POSITIVE)]
        {
            let extreme = TreeParameters { traversal_cost, intersection_cost, ..parameters };
            match build(&device(), &triangles, &BuildChoice::Tree(extreme)) {
                Ok(structure) => {
                    for (ray, verdict) in rays.iter().zip(&verdicts) {
                        assert_eq!(verdict.objection(structure.closest(ray)), None, "{extreme:?}, {ray:?}");
                    }
                }
                Err(error) => assert!(error.is_infeasible(), "{extreme:?}: {error}"),
            }
        }
        let free = TreeParameters { intersection_cost: 0.0, ..parameters };
        assert!(
            build(&device(), &triangles, &BuildChoice::Tree(free)).is_err(),
            "a cost of nothing for a test"
        );
    }
}

#[test]
fn rays_along_axes_and_from_surfaces() {
    let triangles = scenes::city(6, 100);
    let mut random = scenes::random(101);
    let mut rays = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        for sign in [1.0, -1.0] {
            for tilt in [0.0, -0.0, 1e-30, 1e-7] {
                let direction = axis * sign + (Vec3::ONE - axis) * tilt;
                let origin = Vec3::from(scenes::in_cube(&mut random)) - axis * sign * 2.0;
                rays.push(Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY });
            }
        }
    }
    for number in 0..200 {
        let [a, b, c] = triangles.corners(number * 7 % triangles.len());
        let origin = Vec3::from(a + (b - a) * 0.3 + (c - a) * 0.3);
        let direction = scenes::on_sphere(&mut random);
        rays.push(Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY });
        rays.push(Ray { origin, direction, t_min: 1e-3, t_max: 1.0 });
    }
    check("axes and surfaces", &triangles, &rays, 60);
}

#[test]
fn rays_that_are_none_miss() {
    let triangles = scenes::soup(200, 0.5, 102);
    let good =
        Ray { origin: Vec3::new(0.1, 0.2, 3.0), direction: Vec3::NEG_Z, t_min: 0.0, t_max: f32::INFINITY };
    let rays = scenes::invalid(good);
    each(&triangles, |what, structure| {
        for ray in &rays {
            assert_eq!(structure.closest(ray), None, "{what}, {ray:?}");
            assert!(!structure.occluded(ray), "{what}, {ray:?}");
        }
    });
}

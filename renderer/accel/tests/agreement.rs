//! Every back end gives the answer of the brute-force oracle, on kind and on nasty scenes.

use std::sync::Arc;

use glam::{Vec3, Vec3A};
use rand::RngExt;
use treewright_accel::{
    BruteForce, BuildChoice, Builder, Collapse, Hit, Intersector, NativeOptions, Quality, Ray, Structure,
    TreeParameters, Triangles, build,
};

mod scenes;

use scenes::back_ends::{self, device, each_isa, tree};

/// Every kind of node, of block and of test, and every builder.
fn parameters() -> Vec<TreeParameters> {
    let plain = TreeParameters { max_depth: 64, max_leaf_size: 20, ..TreeParameters::default() };
    let mut all = back_ends::tree_kinds(plain);
    // The optimal collapse of every width and builder, with more and less reinsertion.
    let mut number = 0;
    for branching_factor in [2, 4, 8, 16] {
        for quality in [Quality::Morton, Quality::Sah, Quality::SahSplit] {
            for reinsertion_passes in [0, 1, 5] {
                number += 1;
                all.push(TreeParameters {
                    quality,
                    branching_factor,
                    collapse: Collapse::Optimal,
                    reinsertion_passes,
                    block_width: if number % 5 < 3 { 4 } else { 8 },
                    max_depth: 64,
                    min_leaf_size: 1 + number % 3,
                    max_leaf_size: 12,
                    sah_block_size: 4,
                    robust: number % 4 == 0,
                    ..TreeParameters::default()
                });
            }
        }
    }
    // Our own builder with every radius: as it is, and optimised.
    for (number, search_radius) in [4, 8, 16, 32].into_iter().enumerate() {
        for collapse in [Collapse::Builder, Collapse::Optimal] {
            for branching_factor in [2, 4, 8] {
                all.push(TreeParameters {
                    builder: Builder::Ploc,
                    search_radius,
                    cluster_size: 1 << number,
                    branching_factor,
                    collapse,
                    reinsertion_passes: number as u32,
                    block_width: if number % 2 == 0 { 8 } else { 4 },
                    max_depth: 64,
                    min_leaf_size: 1 + number as u32,
                    max_leaf_size: 12,
                    sah_block_size: 4,
                    robust: number == 1,
                    ..TreeParameters::default()
                });
            }
        }
    }
    for branching_factor in [2, 4, 8] {
        for quality in [Quality::Morton, Quality::Sah, Quality::SahSplit] {
            for robust in [false, true] {
                let sizes = if quality == Quality::Sah { (1, 32) } else { (2, 6) };
                all.push(TreeParameters {
                    quality,
                    branching_factor,
                    max_depth: 64,
                    min_leaf_size: sizes.0,
                    max_leaf_size: sizes.1,
                    robust,
                    ..TreeParameters::default()
                });
            }
        }
    }
    all
}

/// Whether rounding of coordinates may decide about the ray.
fn is_close_call(triangles: &Triangles, ray: &Ray, hit: &Hit) -> bool {
    scenes::passes_closely(triangles.corners(hit.triangle as usize), ray, hit, 4e-6, 1e-5)
}

/// Compares one answer with the oracle's. Returns whether they agree outright.
fn agree(triangles: &Triangles, ray: &Ray, expected: Option<Hit>, found: Option<Hit>, what: &str) -> bool {
    match (expected, found) {
        (Some(expected), Some(found)) if scenes::same_distance(Some(expected), Some(found), 2e-4) => {
            if expected.triangle == found.triangle && !is_close_call(triangles, ray, &expected) {
                let [a, b, c] = triangles.corners(found.triangle as usize);
                let at = Vec3::from(a + (b - a) * found.u + (c - a) * found.v);
                let along = ray.origin + ray.direction * found.t;
                assert!(
                    at.distance(along) < 1e-3,
                    "{what}: the weights of {found:?} lead to {at}, the ray to {along}"
                );
            }
            true
        }
        (None, None) => true,
        _ => {
            let close =
                [expected, found].into_iter().flatten().any(|hit| is_close_call(triangles, ray, &hit));
            assert!(close, "{what}: {ray:?} should give {expected:?}, gave {found:?}");
            false
        }
    }
}

/// Every back end over one scene. Close calls may differ, but only few.
fn all_agree(name: &str, triangles: &Arc<Triangles>, rays: &[Ray]) {
    let oracle = BruteForce::new(triangles);
    let expected: Vec<Option<Hit>> = rays.iter().map(|ray| oracle.closest(ray)).collect();
    let check = |what: &str, structure: &dyn Intersector| {
        let mut agreed = 0;
        for (ray, &expected) in rays.iter().zip(&expected) {
            let found = structure.closest(ray);
            agreed += usize::from(agree(triangles, ray, expected, found, what));
            let any = structure.occluded(ray);
            if any != found.is_some() {
                let hit =
                    found.or(expected).unwrap_or_else(|| panic!("{what}: {ray:?} is occluded by nothing"));
                assert!(
                    is_close_call(triangles, ray, &hit),
                    "{what}: {ray:?} occluded {any}, closest {found:?}"
                );
            }
        }
        let missed = rays.len() - agreed;
        assert!(missed * 100 <= rays.len(), "{what}: {missed} of {} rays are close calls", rays.len());
    };
    for parameters in parameters() {
        let tree = tree(triangles, &parameters);
        tree.validate().unwrap_or_else(|fault| panic!("{name}, {parameters:?}: {fault}"));
        each_isa(tree, |isa, tree| check(&format!("{name}, {isa:?}, {parameters:?}"), tree));
    }
    for options in back_ends::native_kinds() {
        let native = build(&device(), triangles, &BuildChoice::Native(options)).expect("it builds");
        check(&format!("{name}, {options:?}"), &native);
    }
}

#[test]
fn random_triangles() {
    all_agree("small", &scenes::soup(600, 0.1, 1), &scenes::rays(600, 2));
    all_agree("large", &scenes::soup(300, 1.0, 3), &scenes::rays(600, 4));
}

#[test]
fn a_connected_surface() {
    all_agree("hills", &scenes::hills(20), &scenes::rays(600, 5));
}

#[test]
fn needles() {
    all_agree("needles", &scenes::needles(300, 6), &scenes::rays(600, 7));
}

#[test]
fn boxes_along_the_axes() {
    all_agree("city", &scenes::city(5, 8), &scenes::rays(600, 9));
}

#[test]
fn everything_in_one_plane() {
    all_agree("flat", &scenes::surface(16, |_, _| 0.25), &scenes::rays(600, 10));
}

#[test]
fn triangles_on_top_of_each_other() {
    let one = [Vec3A::new(-1.0, -1.0, 0.1), Vec3A::new(1.0, -1.0, 0.2), Vec3A::new(0.0, 1.0, 0.0)];
    all_agree("coincident", &scenes::separate(vec![one; 100]), &scenes::rays(300, 11));
}

#[test]
fn one_triangle() {
    let one = [Vec3A::new(-1.0, -1.0, 0.0), Vec3A::new(1.0, -1.0, 0.3), Vec3A::new(0.0, 1.0, 0.0)];
    all_agree("one", &scenes::separate([one]), &scenes::rays(300, 12));
}

#[test]
fn triangles_without_area_are_never_hit() {
    let (a, b) = (Vec3A::new(-0.5, 0.2, 0.1), Vec3A::new(0.7, -0.3, 0.4));
    let real = [Vec3A::new(-1.0, -1.0, 0.0), Vec3A::new(1.0, -1.0, 0.0), Vec3A::new(0.0, 1.0, 0.0)];
    let triangles = scenes::separate([[a; 3], [a, b, a], [a, b, (a + b) * 0.5], real, [b; 3]]);
    all_agree("degenerate", &triangles, &scenes::rays(300, 13));
}

#[test]
fn no_triangle_at_all() {
    let nothing = Arc::new(Triangles::default());
    for choice in parameters().into_iter().map(BuildChoice::Tree).chain([
        BuildChoice::Native(NativeOptions::default()),
        BuildChoice::Tree(TreeParameters { compact: true, ..TreeParameters::default() }),
        BuildChoice::BruteForce,
    ]) {
        let structure = build(&device(), &nothing, &choice).expect("it builds");
        for ray in scenes::rays(20, 14) {
            assert_eq!(structure.closest(&ray), None);
            assert!(!structure.occluded(&ray));
        }
        if let Structure::Tree(tree) = &structure {
            tree.validate().expect("an empty tree is a valid tree");
            assert_eq!(tree.statistics().triangle_references, 0);
        }
    }
}

/// Rays that run along axes, and rays with broken components.
#[test]
fn odd_rays() {
    let triangles = scenes::city(6, 15);
    let oracle = BruteForce::new(&triangles);
    let mut random = scenes::random(16);
    let mut straight = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1.0, 0.0, -1.0), Vec3::new(0.0, -1.0, 1e-30)] {
        for sign in [1.0, -1.0] {
            for _ in 0..20 {
                let origin = Vec3::from(scenes::in_cube(&mut random)) - axis * sign * 2.0;
                straight.push(Ray { origin, direction: axis * sign, t_min: 0.0, t_max: f32::INFINITY });
            }
        }
    }
    let good =
        Ray { origin: Vec3::new(0.1, 2.0, 0.1), direction: Vec3::NEG_Y, t_min: 0.0, t_max: f32::INFINITY };
    let broken = scenes::invalid(good);
    let huge =
        [1e30, f32::MAX].map(|size| Ray { origin: Vec3::splat(size), direction: Vec3::splat(-size), ..good });
    assert!(oracle.closest(&good).is_some());
    let native = NativeOptions::default();
    let choices = parameters().into_iter().map(BuildChoice::Tree).chain([BuildChoice::Native(native)]);
    for choice in choices {
        let structure = build(&device(), &triangles, &choice).expect("it builds");
        for ray in &straight {
            agree(&triangles, ray, oracle.closest(ray), structure.closest(ray), &format!("{choice:?}"));
        }
        for ray in &broken {
            assert_eq!(structure.closest(ray), None, "{choice:?}, {ray:?}");
            assert!(!structure.occluded(ray), "{choice:?}, {ray:?}");
        }
        for ray in &huge {
            // Any answer will do, so long as one is given.
            let _ = (structure.closest(ray), structure.occluded(ray));
        }
    }
}

/// Through a closed surface no ray may slip: not between triangles, not through corners.
#[test]
fn robust_trees_are_watertight() {
    let triangles = scenes::surface(12, |x, z| 0.3 * (5.0 * x + 3.0 * z).sin());
    let mut random = scenes::random(17);
    // Aimed from above exactly at corners and at points of edges, away from the rim.
    let rays: Vec<Ray> = (0..4000)
        .map(|_| {
            let [a, b, _] = loop {
                let corners = triangles.corners(random.random_range(0..triangles.len()));
                if corners.iter().all(|corner| corner.x.abs().max(corner.z.abs()) < 0.95) {
                    break corners;
                }
            };
            let share = if random.random_bool(0.3) { 0.0 } else { random.random_range(0.0..1.0) };
            let target = Vec3::from(a + (b - a) * share);
            // From near and far: the farther, the coarser the translated corners.
            let distance = random.random_range(0.2f32..4.0).exp2().exp2();
            let aside = Vec3::new(random.random_range(-0.3..0.3), 1.0, random.random_range(-0.3..0.3));
            let origin = aside * distance;
            Ray { origin, direction: target - origin, t_min: 0.0, t_max: f32::INFINITY }
        })
        .collect();
    for parameters in parameters().into_iter().filter(|parameters| parameters.robust) {
        each_isa(tree(&triangles, &parameters), |isa, tree| {
            for ray in &rays {
                assert!(tree.closest(ray).is_some(), "{isa:?}, {parameters:?}: {ray:?} slips through");
                assert!(tree.occluded(ray), "{isa:?}, {parameters:?}: {ray:?} slips through");
            }
        });
    }
}

/// The origin lies beside the long edge by less than single precision can resolve in its products.
#[test]
fn robust_trees_decide_close_edges_in_double_precision() {
    let (b, c) = (Vec3A::new(1.0 + f32::EPSILON, 1.0, 0.0), Vec3A::new(-1.0, f32::EPSILON / 2.0 - 1.0, 0.0));
    let ray = Ray { origin: Vec3::NEG_Z, direction: Vec3::Z, t_min: 0.0, t_max: f32::INFINITY };
    for (a, inside) in [(Vec3A::new(-1.0, 1.0, 0.0), true), (Vec3A::new(1.0, -1.0, 0.0), false)] {
        let triangles = scenes::separate([[a, b, c]]);
        assert_eq!(BruteForce::new(&triangles).occluded(&ray), inside);
        let robust = TreeParameters { robust: true, ..TreeParameters::default() };
        each_isa(tree(&triangles, &robust), |isa, tree| {
            assert_eq!(tree.closest(&ray).is_some(), inside, "{isa:?}");
            assert_eq!(tree.occluded(&ray), inside, "{isa:?}");
        });
    }
}

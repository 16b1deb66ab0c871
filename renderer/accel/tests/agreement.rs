//! Trees of every builder give right answers, on kind and on nasty scenes.

use std::sync::Arc;

use glam::{Vec3, Vec3A};
use rand::RngExt;
use treewright_accel::{
    BruteForce, BuildChoice, Builder, Collapse, Intersector, Quality, Ray, TreeParameters, Triangles, build,
};

mod scenes;

use scenes::back_ends::{self, device, each_isa, tree};
use scenes::verdict::{hold, verdicts};

/// Every kind of node, of block and of test, and every builder.
fn parameters() -> Vec<TreeParameters> {
    let mut all = back_ends::trees();
    // The optimal collapse of every width and builder, and our own builder with every radius, with more and
    // less reinsertion.
    let qualities = [Quality::Morton, Quality::Sah, Quality::SahSplit, Quality::Sah];
    for (number, quality) in (0..).zip(qualities) {
        for builder in [Builder::Embree, Builder::Ploc] {
            all.push(TreeParameters {
                quality,
                branching_factor: 2 << number,
                collapse: Collapse::Optimal,
                builder,
                search_radius: 4 << number,
                cluster_size: 1 << number,
                reinsertion_passes: 2 * number,
                block_width: if number % 2 == 0 { 8 } else { 4 },
                max_depth: 64,
                min_leaf_size: 1 + number,
                max_leaf_size: 12,
                sah_block_size: 4,
                robust: number == 1,
                ..TreeParameters::default()
            });
        }
    }
    all
}

/// Asks every kind of tree, and native scenes, about every ray.
fn all_agree(name: &str, triangles: &Arc<Triangles>, rays: &[Ray]) {
    let verdicts = verdicts(name, triangles, rays, 50);
    for parameters in parameters() {
        let tree = tree(triangles, &parameters);
        tree.validate().unwrap_or_else(|fault| panic!("{name}, {parameters:?}: {fault}"));
        each_isa(tree, |isa, tree| hold(&format!("{name}, {isa:?}, {parameters:?}"), tree, rays, &verdicts));
    }
    for options in back_ends::native_kinds() {
        let native = build(&device(), triangles, &BuildChoice::Native(options)).expect("it builds");
        hold(&format!("{name}, {options:?}"), &native, rays, &verdicts);
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
fn one_triangle() {
    let one = [Vec3A::new(-1.0, -1.0, 0.0), Vec3A::new(1.0, -1.0, 0.3), Vec3A::new(0.0, 1.0, 0.0)];
    all_agree("one", &scenes::separate([one]), &scenes::rays(300, 12));
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

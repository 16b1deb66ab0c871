//! Trees of every builder give right answers, on kind and on nasty scenes.

use glam::{Vec3, Vec3A};
use rand::RngExt;
use treewright_accel::{BruteForce, Intersector, Ray, TreeParameters};

mod scenes;

use scenes::back_ends::{all_trees, each_isa, tree};
use scenes::verdict::check;

#[test]
fn ordinary_scenes() {
    let one = [Vec3A::new(-1.0, -1.0, 0.0), Vec3A::new(1.0, -1.0, 0.3), Vec3A::new(0.0, 1.0, 0.0)];
    let scenes = [
        ("small random triangles", scenes::soup(600, 0.1, 1), scenes::rays(600, 2)),
        ("large random triangles", scenes::soup(300, 1.0, 3), scenes::rays(600, 4)),
        ("a connected surface", scenes::hills(20), scenes::rays(600, 5)),
        ("needles", scenes::needles(300, 6), scenes::rays(600, 7)),
        ("boxes along the axes", scenes::city(5, 8), scenes::rays(600, 9)),
        ("everything in one plane", scenes::surface(16, |_, _| 0.25), scenes::rays(600, 10)),
        ("one triangle", scenes::separate([one]), scenes::rays(300, 12)),
    ];
    for (name, triangles, rays) in scenes {
        check(name, &triangles, &rays, 50);
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
    for parameters in all_trees().into_iter().filter(|parameters| parameters.robust) {
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

//! After every step of a motion, an updated structure gives the answers of the oracle.

use std::sync::Arc;

use glam::{Affine3A, Quat, Vec3, Vec3A};
use treewright_accel::{
    BruteForce, BuildChoice, BuildError, Hit, Instances, Intersector, Isa, NativeOptions, NativeQuality,
    Quality, Ray, Structure, TreeParameters, Triangles, Update, build, build_instanced,
};

mod scenes;

use scenes::back_ends::{device, tree, wide_trees};

const UPDATES: [Update; 4] = [
    Update::Refit,
    Update::Partial { rebuild_threshold: 1.0 },
    Update::Partial { rebuild_threshold: 1.3 },
    Update::Rebuild,
];

/// Something that moves: where a vertex, given with its number, is at a moment from 0 to 1.
type Motion = fn(usize, Vec3A, f32) -> Vec3A;

/// A wave runs through everything.
fn wave(_: usize, at: Vec3A, moment: f32) -> Vec3A {
    at + Vec3A::Y * (0.4 * (3.0 * at.x + 9.0 * moment).sin())
}

/// Every other block of vertices turns about the vertical, so that neighbours drift apart.
fn turn(number: usize, at: Vec3A, moment: f32) -> Vec3A {
    let turned = Affine3A::from_rotation_y(2.0 * moment).transform_point3a(at);
    if (number / 96).is_multiple_of(2) { turned } else { at }
}

/// Everything falls into a point.
fn collapse(_: usize, at: Vec3A, moment: f32) -> Vec3A {
    at * (1.0 - moment) + Vec3A::splat(0.1) * moment
}

fn moved(triangles: &Triangles, motion: Motion, moment: f32) -> Arc<Triangles> {
    let positions = triangles.positions().iter().enumerate();
    let positions = positions.map(|(number, &at)| motion(number, at, moment)).collect();
    let moved = triangles.moved(positions).expect("the motion stays in range");
    // In memory of their own, indices too, as of a scene that is generated again at every moment.
    Arc::new(Triangles::new(moved.positions().to_vec(), moved.indices().to_vec()).expect("they were sound"))
}

fn choices() -> Vec<BuildChoice> {
    let mut all = vec![BuildChoice::BruteForce];
    all.extend(wide_trees(&[
        (Quality::Morton, false, 4),
        (Quality::Sah, true, 8),
        (Quality::SahSplit, false, 4),
    ]));
    for (quality, robust) in
        [(NativeQuality::Low, false), (NativeQuality::Medium, true), (NativeQuality::High, false)]
    {
        all.push(BuildChoice::Native(NativeOptions { quality, robust, ..NativeOptions::default() }));
    }
    all
}

/// Compares a structure with the oracle over world-space corners.
fn agree(
    what: &str,
    structure: &Structure,
    oracle: &BruteForce,
    corners: &dyn Fn(&Hit) -> [Vec3A; 3],
    rays: &[Ray],
) {
    let mut close_calls = 0;
    for ray in rays {
        let (expected, found) = (oracle.closest(ray), structure.closest(ray));
        let same = scenes::same_distance(expected, found, 2e-4);
        if !same || structure.occluded(ray) != found.is_some() {
            let close =
                [expected, found].iter().flatten().any(|hit| scenes::is_close_call(corners(hit), ray, hit));
            assert!(close, "{what}: {ray:?} should give {expected:?}, gave {found:?}");
            close_calls += 1;
        }
    }
    assert!(
        close_calls * 30 <= rays.len(),
        "{what}: {close_calls} of {} answers are close calls",
        rays.len()
    );
}

fn validate(what: &str, structure: &Structure) {
    let sound = match structure {
        Structure::Tree(tree) => tree.validate(),
        Structure::TwoLevel(two_level) => two_level.validate(),
        _ => Ok(()),
    };
    sound.unwrap_or_else(|fault| panic!("{what}: {fault}"));
}

fn follows(name: &str, triangles: &Arc<Triangles>, motion: Motion) {
    let device = device();
    let rays = scenes::rays(120, 3);
    for choice in choices() {
        for update in UPDATES {
            let mut structure = build(&device, triangles, &choice).expect("it builds");
            for step in 1..=3 {
                let now = moved(triangles, motion, step as f32 / 3.0);
                let what = format!("{name}, {choice:?}, {update:?}, step {step}");
                structure
                    .update(&device, &now, None, update)
                    .unwrap_or_else(|error| panic!("{what}: {error}"));
                validate(&what, &structure);
                let corners = |hit: &Hit| now.corners(hit.triangle as usize);
                agree(&what, &structure, &BruteForce::new(&now), &corners, &rays);
            }
        }
    }
}

#[test]
fn a_deforming_surface() {
    follows("hills", &scenes::hills(40), wave);
}

#[test]
fn parts_that_drift_apart() {
    follows("soup", &scenes::soup(2500, 0.15, 1), turn);
}

#[test]
fn everything_into_a_point() {
    follows("collapse", &scenes::soup(700, 0.3, 2), collapse);
}

#[test]
fn one_triangle_and_none() {
    let one = [Vec3A::new(-1.0, -1.0, 0.0), Vec3A::new(1.0, -1.0, 0.3), Vec3A::new(0.0, 1.0, 0.0)];
    follows("one", &scenes::separate([one]), wave);
    follows("none", &Arc::new(Triangles::default()), wave);
}

#[test]
fn the_choice_of_kernels_survives() {
    let device = device();
    let triangles = scenes::soup(2500, 0.15, 1);
    for update in UPDATES {
        let tree = tree(&triangles, &TreeParameters { max_depth: 64, ..TreeParameters::default() });
        let mut structure = Structure::Tree(tree.with_isa(Isa::Scalar).expect("it is always there"));
        structure.update(&device, &moved(&triangles, turn, 0.9), None, update).expect("it follows");
        assert!(matches!(&structure, Structure::Tree(tree) if tree.isa() == Isa::Scalar), "{update:?}");
    }
}

/// Rebuilding parts restores the cost that refitting lost, and leaves good parts alone.
#[test]
fn a_partial_update_keeps_the_tree_good() {
    let device = device();
    let triangles = scenes::soup(6000, 0.05, 1);
    let choice =
        BuildChoice::Tree(TreeParameters { branching_factor: 4, max_depth: 64, ..TreeParameters::default() });
    let cost = |update: Update| {
        let mut structure = build(&device, &triangles, &choice).expect("it builds");
        for step in 1..=4 {
            structure
                .update(&device, &moved(&triangles, turn, step as f32 / 4.0), None, update)
                .expect("it follows");
        }
        structure.statistics().tree.expect("it is a tree of ours").sah_cost
    };
    let (rebuilt, refitted) = (cost(Update::Rebuild), cost(Update::Refit));
    let partial = cost(Update::partial(1.2));
    assert!(refitted > 2.0 * rebuilt, "the motion is a hard one: {refitted} against {rebuilt}");
    assert!(partial < 1.3 * rebuilt, "{partial} against {rebuilt} rebuilt and {refitted} refitted");
}

#[test]
fn instances_walk() {
    let device = device();
    let triangles = scenes::soup(1000, 0.2, 7);
    let walker = |number: u32, moment: f32| {
        let way = Quat::from_rotation_y(0.8 * number as f32 + moment * ((number % 5) as f32 - 2.0));
        let at = way * Vec3::X * (0.2 + 0.1 * (number % 9) as f32) + Vec3::Y * (0.02 * number as f32 - 0.5);
        Affine3A::from_scale_rotation_translation(Vec3::new(0.2, -0.15, 0.2), way, at)
    };
    let placed = (0..48).map(|number| (number % 2, walker(number, 0.0)));
    let instances = Instances::new(triangles.len(), vec![0..600, 600..1000], placed).expect("valid");
    let instances = Arc::new(instances);
    let rays = scenes::rays(120, 8);
    for choice in choices() {
        for update in UPDATES {
            let mut structure = build_instanced(&device, &triangles, &instances, &choice).expect("it builds");
            for step in 1..=3 {
                let places = (0..48).map(|number| walker(number, step as f32 / 3.0));
                let instances = Arc::new(instances.moved(places).expect("valid"));
                // In the last step the objects change as well.
                let now = if step < 3 { Arc::clone(&triangles) } else { moved(&triangles, wave, 0.5) };
                let what = format!("{choice:?}, {update:?}, step {step}");
                structure
                    .update(&device, &now, Some(&instances), update)
                    .unwrap_or_else(|error| panic!("{what}: {error}"));
                validate(&what, &structure);
                let corners = |hit: &Hit| {
                    let to_world = &instances.placed()[hit.instance as usize].to_world;
                    now.corners(hit.triangle as usize).map(|corner| to_world.transform_point3a(corner))
                };
                agree(&what, &structure, &BruteForce::instanced(&now, &instances), &corners, &rays);
            }
        }
    }
}

#[test]
fn mistakes_are_named() {
    let device = device();
    let triangles = scenes::hills(6);
    let other = scenes::hills(7);
    for choice in choices() {
        let mut structure = build(&device, &triangles, &choice).expect("it builds");
        let error = structure.update(&device, &other, None, Update::Refit).expect_err("it is refused");
        assert!(matches!(error, BuildError::OtherTriangles { .. }), "{choice:?}: {error}");
        let nothing = Arc::new(Instances::new(0, Vec::new(), []).expect("valid"));
        let error = structure.update(&device, &triangles, Some(&nothing), Update::Refit);
        assert_eq!(error, Err(BuildError::OtherInstances), "{choice:?}");
    }
    for rebuild_threshold in [0.9, 5.0, f32::NAN] {
        let error = Update::partial(rebuild_threshold).check().expect_err("it is refused");
        assert!(error.to_string().contains("rebuild_threshold"));
    }
}

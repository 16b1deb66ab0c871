//! Every configuration of a tuner gives a right tree or a clear refusal, never a crash.

use std::sync::Arc;

use glam::Vec3A;
use proptest::prelude::*;
use treewright_accel::{
    BruteForce, BuildChoice, BuildError, Builder, Collapse, Hit, Intersector, Quality, Ray, Structure,
    TreeParameters, Triangles, build,
};

mod scenes;

use scenes::back_ends::{device, tree};

/// Any configuration of our own trees.
fn configuration() -> impl Strategy<Value = TreeParameters> {
    let shape = (
        prop::sample::select(vec![Quality::Morton, Quality::Sah, Quality::SahSplit]),
        prop::sample::select(vec![2u32, 4, 8, 16]),
        9u32..=64,
        prop::sample::select(vec![1u32, 2, 4, 8, 16, 32]),
        (1u32..=32).prop_flat_map(|max| (1..=max, Just(max))),
    );
    let rest = (0.0f32..=10.0, 0.001f32..=10.0, any::<bool>(), prop::bool::weighted(0.1), any::<bool>());
    let layout = (
        prop::sample::select(vec![4u32, 8]),
        prop::sample::select(vec![Collapse::Builder, Collapse::Optimal]),
        0u32..=16,
        1.0f32..=2.0,
    );
    let own = (prop::sample::select(vec![Builder::Embree, Builder::Ploc]), (1u32..=32, 1u32..=8));
    (shape, rest, layout, own).prop_map(
        |(
            (quality, branching_factor, max_depth, sah_block_size, (min_leaf_size, max_leaf_size)),
            rest,
            (block_width, collapse, reinsertion_passes, split_budget),
            (builder, (search_radius, cluster_size)),
        )| {
            let (traversal_cost, intersection_cost, static_scene, compact, robust) = rest;
            TreeParameters {
                quality,
                branching_factor,
                max_depth,
                sah_block_size,
                min_leaf_size,
                max_leaf_size,
                traversal_cost,
                intersection_cost,
                static_scene,
                compact,
                robust,
                block_width,
                // Only the optimal collapse makes nodes of sixteen.
                collapse: if branching_factor == 16 { Collapse::Optimal } else { collapse },
                reinsertion_passes,
                split_budget,
                builder,
                search_radius,
                cluster_size,
            }
        },
    )
}

struct Case {
    triangles: Arc<Triangles>,
    rays: Vec<Ray>,
    expected: Vec<Option<Hit>>,
}

impl Case {
    fn new(triangles: Arc<Triangles>, seed: u64) -> Self {
        let rays = scenes::rays(200, seed);
        let oracle = BruteForce::new(&triangles);
        let expected = rays.iter().map(|ray| oracle.closest(ray)).collect();
        Self { triangles, rays, expected }
    }

    fn check(&self, parameters: &TreeParameters) {
        let structure = match build(&device(), &self.triangles, &BuildChoice::Tree(*parameters)) {
            Ok(structure) => structure,
            Err(error) => {
                assert!(error.is_infeasible(), "{parameters:?}: {error}");
                return;
            }
        };
        if let Structure::Tree(tree) = &structure {
            tree.validate().unwrap_or_else(|fault| panic!("{parameters:?}: {fault}"));
            let statistics = tree.statistics();
            assert!(statistics.triangle_references >= self.triangles.len());
            assert!(statistics.depth <= parameters.max_depth);
            assert_eq!(statistics.bytes > 0, !self.triangles.is_empty());
            assert!(
                statistics.sah_cost.is_finite() && (statistics.sah_cost > 0.0) != self.triangles.is_empty()
            );
        }
        let differs = |(ray, expected): &(&Ray, &Option<Hit>)| {
            !scenes::same_distance(**expected, structure.closest(ray), 2e-4)
        };
        let wrong = self.rays.iter().zip(&self.expected).filter(differs).count();
        assert!(wrong <= 1, "{parameters:?}: {wrong} rays disagree");
    }
}

/// Checks `cases` values of a strategy, equal in every run.
fn each<S: Strategy>(cases: u32, values: &S, check: impl Fn(S::Value)) {
    let settings = ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() };
    let mut runner = proptest::test_runner::TestRunner::new_with_rng(
        settings,
        proptest::test_runner::TestRng::deterministic_rng(proptest::test_runner::RngAlgorithm::ChaCha),
    );
    let outcome = runner.run(values, |value| {
        check(value);
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{error}"));
}

#[test]
fn random_configurations_over_two_scenes() {
    let cases = [Case::new(scenes::soup(3000, 0.05, 21), 22), Case::new(scenes::city(12, 23), 24)];
    each(64, &configuration(), |parameters| cases.iter().for_each(|case| case.check(&parameters)));
}

/// None to a few triangles of every kind: real ones, needles, points, copies of each other, all in one plane.
fn few_triangles() -> impl Strategy<Value = Arc<Triangles>> {
    let coordinate = || prop_oneof![3 => -1.0f32..1.0, 1 => prop::sample::select(vec![-0.5f32, 0.0, 0.25])];
    let corner = || prop::array::uniform3(coordinate()).prop_map(Vec3A::from_array);
    let one = prop::array::uniform3(corner());
    let copies = prop_oneof![3 => Just(1usize), 1 => 2usize..40];
    let flat = prop::bool::weighted(0.2);
    (prop::collection::vec((one, copies), 0..40), flat).prop_map(|(some, flat)| {
        let flatten = |corner: Vec3A| if flat { corner.with_y(0.125) } else { corner };
        scenes::separate(
            some.into_iter().flat_map(|(corners, copies)| std::iter::repeat_n(corners.map(flatten), copies)),
        )
    })
}

#[test]
fn random_configurations_over_random_triangles() {
    each(256, &(few_triangles(), configuration()), |(triangles, parameters)| {
        Case::new(triangles, 29).check(&parameters);
    });
}

/// Builds are deterministic wherever Embree's own builders are: equal trees every time, to the last bit.
#[test]
fn builds_can_be_repeated() {
    let triangles = scenes::soup(20_000, 0.05, 31);
    for quality in [Quality::Morton, Quality::Sah] {
        let parameters = TreeParameters {
            quality,
            branching_factor: 8,
            max_depth: 64,
            collapse: Collapse::Optimal,
            reinsertion_passes: 6,
            ..TreeParameters::default()
        };
        let built = || tree(&triangles, &parameters).statistics();
        let first = built();
        for _ in 0..3 {
            assert_eq!(built(), first, "{quality:?}");
        }
    }
}

#[test]
fn reinsertion_and_the_optimal_collapse_make_trees_cheaper() {
    let triangles = scenes::soup(20_000, 0.05, 32);
    let cost = |collapse, reinsertion_passes| {
        let parameters = TreeParameters {
            branching_factor: 8,
            max_depth: 64,
            collapse,
            reinsertion_passes,
            ..TreeParameters::default()
        };
        tree(&triangles, &parameters).statistics().sah_cost
    };
    let builders = cost(Collapse::Builder, 0);
    let (collapsed, improved) = (cost(Collapse::Optimal, 0), cost(Collapse::Optimal, 8));
    assert!(collapsed < builders && improved < 0.99 * collapsed, "{builders}, {collapsed}, {improved}");
}

#[test]
fn invalid_parameters_are_refused_before_anything_is_built() {
    let triangles = scenes::soup(10, 0.1, 28);
    let wrong = TreeParameters { branching_factor: 16, ..TreeParameters::default() };
    let error = build(&device(), &triangles, &BuildChoice::Tree(wrong)).expect_err("16 is no width");
    assert!(matches!(error, BuildError::InvalidParameters { parameter: "branching_factor", .. }), "{error}");
    assert!(!error.is_infeasible());
}

#[test]
fn limits_on_leaves_act() {
    let triangles = scenes::hills(60);
    let of_sizes = |min_leaf_size, max_leaf_size| {
        let parameters =
            TreeParameters { min_leaf_size, max_leaf_size, max_depth: 64, ..TreeParameters::default() };
        tree(&triangles, &parameters).statistics()
    };
    let (single, coarse) = (of_sizes(1, 1), of_sizes(16, 32));
    assert_eq!(single.leaves, triangles.len());
    assert!(
        coarse.leaves * 5 < single.leaves && coarse.bytes < single.bytes,
        "{coarse:?} against {single:?}"
    );
}

#[test]
fn compact_is_embrees_own_and_smaller() {
    let triangles = scenes::hills(100);
    let compact = TreeParameters { compact: true, ..TreeParameters::default() };
    let structure = build(&device(), &triangles, &BuildChoice::Tree(compact)).expect("it builds");
    assert!(matches!(structure, Structure::Native(_)));
    assert!(structure.statistics().tree.is_none());
}

#[test]
fn builds_run_side_by_side() {
    std::thread::scope(|scope| {
        for thread in 0..2u64 {
            scope.spawn(move || {
                let case = Case::new(scenes::soup(4000, 0.05, 30 + thread), 40 + thread);
                for round in 0..6u32 {
                    let quality = [Quality::Morton, Quality::Sah, Quality::SahSplit][round as usize % 3];
                    let parameters = TreeParameters {
                        quality,
                        branching_factor: 2 << (round % 3),
                        max_depth: 64,
                        ..TreeParameters::default()
                    };
                    case.check(&parameters);
                    // One thread's failures must not leak into the other's builds.
                    let shallow = TreeParameters {
                        max_depth: 9,
                        max_leaf_size: 1,
                        quality: Quality::Sah,
                        ..parameters
                    };
                    case.check(&shallow);
                }
            });
        }
    });
}

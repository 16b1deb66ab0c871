//! Triangles with masks: every back end meets them where they are solid and nowhere else, as the oracle does.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use rand::RngExt;
use treewright_accel::{
    BruteForce, BuildChoice, Card, Hit, Intersector, Mask, NativeOptions, Packets, Ray, TreeParameters,
    Triangles, Update, Wrap, build,
};

mod scenes;

use scenes::back_ends::{self, device};

/// Rays that rounding may decide about, in a hundred.
const CLOSE_CALLS_PERCENT: usize = 1;

/// Blots and holes, in three ways to go on and of three sizes.
fn masks() -> Vec<Mask> {
    let mask = |(number, wrap): (u32, Wrap)| {
        let (width, height) = (5 + 8 * number, 7 + 3 * number);
        let mut random = scenes::random(u64::from(number));
        let alpha = (0..width * height).map(|_| if random.random_bool(0.5) { 255 } else { 0 }).collect();
        Mask::new(width, height, alpha, 0.5, [wrap, Wrap::Repeat]).expect("it has its pixels")
    };
    (0..).zip([Wrap::Repeat, Wrap::Mirror, Wrap::Clamp]).map(mask).collect()
}

/// These triangles with masks on three of four of them.
fn masked(triangles: &Triangles, seed: u64) -> Arc<Triangles> {
    let mut random = scenes::random(seed);
    let mut place = || Vec2::new(random.random_range(-1.5..2.5), random.random_range(-1.5..2.5));
    let cards: Vec<(u32, Card)> = (0..triangles.len() as u32)
        .filter(|triangle| !triangle.is_multiple_of(4))
        .map(|triangle| (triangle, Card { mask: triangle % 3, corners: [place(), place(), place()] }))
        .collect();
    Arc::new(triangles.clone().masked(masks(), cards).expect("triangles and masks exist"))
}

/// All triangles with a mask that is solid nowhere, or everywhere.
fn uniform(triangles: &Triangles, alpha: u8) -> Arc<Triangles> {
    let mask = Mask::new(1, 1, vec![alpha].into(), 0.5, [Wrap::Repeat; 2]).expect("one pixel");
    let cards =
        (0..triangles.len() as u32).map(|triangle| (triangle, Card { mask: 0, corners: [Vec2::ZERO; 3] }));
    Arc::new(triangles.clone().masked(vec![mask], cards).expect("triangles and masks exist"))
}

fn same(expected: Option<Hit>, found: Option<Hit>) -> bool {
    let instance = |hit: Hit| hit.instance;
    scenes::same_distance(expected, found, 2e-4) && expected.map(instance) == found.map(instance)
}

/// Single rays and packets of all kinds.
fn check(what: &str, structure: &dyn Intersector, rays: &[Ray], expected: &[Option<Hit>]) {
    let limit = rays.len() * CLOSE_CALLS_PERCENT / 100;
    for packets in Packets::ALL {
        let (hits, occluded) = back_ends::packed(structure, packets, rays);
        let wrong = expected.iter().zip(&hits).filter(|(expected, hit)| !same(**expected, **hit)).count();
        assert!(wrong <= limit, "{what}, {packets:?}: {wrong} nearest hits differ");
        let wrong =
            expected.iter().zip(&occluded).filter(|(expected, any)| expected.is_some() != **any).count();
        assert!(wrong <= limit, "{what}, {packets:?}: {wrong} answers to any hit differ");
    }
}

fn hits(oracle: &BruteForce, rays: &[Ray]) -> Vec<Option<Hit>> {
    rays.iter().map(|ray| oracle.closest(ray)).collect()
}

fn all_agree(name: &str, triangles: &Arc<Triangles>, rays: &[Ray]) {
    let expected = hits(&BruteForce::new(triangles), rays);
    back_ends::each(triangles, |what, structure| {
        check(&format!("{name}, {what}"), structure, rays, &expected)
    });
}

#[test]
fn every_back_end_sees_through_the_same_holes() {
    let solid = scenes::soup(300, 1.0, 1);
    let triangles = masked(&solid, 2);
    // Half of them from one point, as packets like it.
    let mut rays = scenes::rays(600, 3);
    rays.iter_mut().take(300).for_each(|ray| ray.origin = Vec3::new(0.0, 0.2, 3.0));
    let through = hits(&BruteForce::new(&solid), &rays)
        .iter()
        .zip(hits(&BruteForce::new(&triangles), &rays))
        .filter(|(solid, masked)| !same(**solid, *masked))
        .count();
    assert!((50..500).contains(&through), "{through} of {} rays go through a hole", rays.len());
    all_agree("soup", &triangles, &rays);
    all_agree("hills", &masked(&scenes::hills(10), 4), &scenes::rays(300, 5));
}

#[test]
fn a_mask_that_is_solid_nowhere_leaves_nothing_and_one_that_is_everywhere_changes_nothing() {
    let solid = scenes::soup(120, 0.6, 6);
    let rays = scenes::rays(200, 7);
    back_ends::each(&uniform(&solid, 0), |what, structure| {
        check(what, structure, &rays, &vec![None; rays.len()])
    });
    let expected = hits(&BruteForce::new(&solid), &rays);
    assert!(expected.iter().flatten().count() > 50);
    back_ends::each(&uniform(&solid, 255), |what, structure| check(what, structure, &rays, &expected));
}

#[test]
fn masks_lose_and_gain_nothing_by_an_update() {
    let solid = scenes::soup(200, 0.5, 11);
    let rays = scenes::rays(200, 12);
    for choice in
        [BuildChoice::Tree(TreeParameters::default()), BuildChoice::Native(NativeOptions::default())]
    {
        for update in [Update::Refit, Update::Rebuild] {
            let mut structure = build(&device(), &solid, &choice).expect("it builds");
            for next in [masked(&solid, 13), Arc::clone(&solid), uniform(&solid, 0)] {
                structure.update(&device(), &next, None, update).expect("it follows");
                structure.update(&device(), &next, None, update).expect("it follows");
                check(&format!("{choice:?}"), &structure, &rays, &hits(&BruteForce::new(&next), &rays));
            }
        }
    }
}

//! Random configurations over random scenes: no crash, no wrong hit, and failures that say they are
//! infeasible.
//!
//! `cargo run --release -p treewright-accel --example stress [COUNT] [SEED] [TRIANGLES]`
//!
//! Ten scenes (soups, surfaces, cities, needles, degenerate ones) of at most TRIANGLES triangles. Each
//! configuration is built over one of them and traced by every instruction set and packing. As in the tests,
//! answers must be right within the error of single precision. Small counts run under valgrind. Ends with an
//! error after any fault.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::Vec3A;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use treewright_accel::{
    BuildChoice, BuildError, Builder, Collapse, Device, Hit, Intersector, Isa, NativeAcceleration,
    NativeOptions, NativeQuality, Packets, Quality, Ray, Structure, TreeParameters, Triangles, build,
};

#[path = "../tests/scenes/mod.rs"]
mod scenes;
#[path = "../tests/scenes/verdict.rs"]
mod verdict;

use verdict::Verdict;

/// Rays a scene.
const RAYS: usize = 60;

struct Case {
    triangles: Arc<Triangles>,
    rays: Vec<Ray>,
    verdicts: Vec<Verdict>,
}

fn cases(most: usize, seed: u64) -> Vec<Case> {
    let mut random = scenes::random(seed);
    let one = [Vec3A::new(-1.0, -1.0, 0.1), Vec3A::new(1.0, -1.0, 0.2), Vec3A::new(0.0, 1.0, 0.0)];
    let side = |triangles: usize| (triangles as f64).sqrt() as u32;
    let degenerate = (0..most / 2).map(|number| {
        let at = scenes::in_cube(&mut random);
        let next = if number % 2 == 0 { at } else { at + scenes::in_cube(&mut random) * 0.2 };
        [at, next, -at]
    });
    let degenerate: Vec<[Vec3A; 3]> = degenerate.collect();
    let all = [
        scenes::soup(most, 0.1, seed),
        scenes::soup(most / 2, 1.0, seed + 1),
        scenes::hills(side(most / 2)),
        scenes::city(side(most / 12), seed + 2),
        scenes::needles(most / 2, seed + 3),
        scenes::surface(side(most / 2), |_, _| 0.25),
        scenes::separate(vec![one; most / 4]),
        scenes::separate(degenerate),
        scenes::separate([one]),
        Arc::new(Triangles::default()),
    ];
    let with_rays = |(number, triangles): (usize, Arc<Triangles>)| {
        let rays = scenes::rays(RAYS, seed + 100 + number as u64);
        let verdicts = rays.iter().map(|ray| Verdict::of(&triangles, ray)).collect();
        Case { triangles, rays, verdicts }
    };
    all.into_iter().enumerate().map(with_rays).collect()
}

fn one_of<T: Copy>(random: &mut ChaCha8Rng, all: &[T]) -> T {
    all[random.random_range(0..all.len())]
}

/// Any configuration, now and then one out of range.
fn configuration(random: &mut ChaCha8Rng) -> BuildChoice {
    if random.random_bool(0.3) {
        return BuildChoice::Native(NativeOptions {
            quality: one_of(random, &[NativeQuality::Low, NativeQuality::Medium, NativeQuality::High]),
            compact: random.random_bool(0.3),
            dynamic: random.random_bool(0.3),
            robust: random.random_bool(0.3),
            acceleration: one_of(random, &NativeAcceleration::ALL),
            split_budget: random.random_range(0.9..4.1),
            presplit: random.random_bool(0.3),
        });
    }
    let max_leaf_size = random.random_range(1..=32);
    let least = u32::from(random.random_bool(0.95));
    let collapse = one_of(random, &[Collapse::Builder, Collapse::Optimal]);
    BuildChoice::Tree(TreeParameters {
        quality: one_of(random, &[Quality::Morton, Quality::Sah, Quality::SahSplit]),
        branching_factor: one_of(random, &[2, 4, 8, 8, 16]),
        max_depth: random.random_range(8..=64),
        sah_block_size: one_of(random, &[1, 2, 4, 8, 16, 32]),
        min_leaf_size: random.random_range(least..=max_leaf_size),
        max_leaf_size,
        traversal_cost: random.random_range(0.0..=10.0),
        intersection_cost: random.random_range(0.0..=10.0),
        static_scene: random.random_bool(0.5),
        compact: random.random_bool(0.05),
        robust: random.random_bool(0.5),
        block_width: one_of(random, &[4, 8]),
        collapse,
        reinsertion_passes: random.random_range(0..=4),
        split_budget: random.random_range(1.0..=2.0),
        builder: one_of(random, &[Builder::Embree, Builder::Ploc]),
        search_radius: random.random_range(1..=32),
        cluster_size: random.random_range(1..=8),
        ..TreeParameters::default()
    })
}

/// Asks everything in every packing; the objections.
fn question(case: &Case, structure: &dyn Intersector) -> Vec<String> {
    let mut objections = Vec::new();
    let mut hits: Vec<Option<Hit>> = vec![None; case.rays.len()];
    let mut occluded = vec![false; case.rays.len()];
    for packets in Packets::ALL {
        structure.closest_each(packets, &case.rays, &mut hits);
        structure.occluded_each(packets, &case.rays, &mut occluded);
        for (number, verdict) in case.verdicts.iter().enumerate() {
            let wrong =
                verdict.objection(hits[number]).or_else(|| verdict.occlusion_objection(occluded[number]));
            objections.extend(wrong.map(|wrong| format!("{packets:?}, {:?}: {wrong}", case.rays[number])));
        }
    }
    objections
}

/// Builds a structure and queries it. Returns its outcome and the objections to it.
fn run(device: &Device, case: &Case, choice: &BuildChoice) -> (String, Vec<String>) {
    match build(device, &case.triangles, choice) {
        Ok(Structure::Tree(mut tree)) => {
            let mut objections: Vec<String> =
                tree.validate().err().map(|fault| fault.to_string()).into_iter().collect();
            for isa in Isa::ALL.into_iter().filter(|isa| isa.is_available()) {
                tree = tree.with_isa(isa).expect("it is available");
                objections.extend(question(case, &tree));
            }
            ("tree".into(), objections)
        }
        Ok(structure) => ("native scene".into(), question(case, &structure)),
        Err(BuildError::DepthLimit { .. }) => ("infeasible: depth limit".into(), Vec::new()),
        Err(error) if error.is_infeasible() => (format!("infeasible: {error}"), Vec::new()),
        Err(BuildError::InvalidParameters { parameter, .. }) => (format!("refused: {parameter}"), Vec::new()),
        Err(error) => ("failed".into(), vec![error.to_string()]),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|argument| argument.parse::<u64>());
    let mut next = |otherwise| arguments.next().unwrap_or(Ok(otherwise));
    let (count, seed, most) = (next(10_000)?, next(1)?, next(2000)?);
    let device = Device::open(0)?;
    let cases = cases(usize::try_from(most)?, seed);
    let mut random = scenes::random(seed);
    let mut outcomes = BTreeMap::<String, u64>::new();
    let mut wrong = 0;
    for scene in (0..cases.len()).cycle().take(usize::try_from(count)?) {
        let choice = configuration(&mut random);
        let (outcome, objections) = run(&device, &cases[scene], &choice);
        *outcomes.entry(outcome).or_default() += 1;
        if let Some(first) = objections.first() {
            wrong += 1;
            eprintln!("{choice:?} over scene {scene}: {} objections, first: {first}", objections.len());
        }
    }
    for (outcome, times) in &outcomes {
        println!("{times:>8} {outcome}");
    }
    println!("{wrong:>8} wrong");
    if wrong > 0 { Err(format!("{wrong} of {count} configurations were wrong").into()) } else { Ok(()) }
}

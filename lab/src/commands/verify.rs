//! `treewright-lab verify`: all accelerators give the same hits and the same pictures.
//!
//! Hits are compared ray by ray with the brute-force oracle, on rays from the camera and between random
//! points of the scene's bounds. Kernels may choose different triangles where triangles coincide or touch. So
//! only hit or miss and the distance must agree.

use std::sync::atomic::{AtomicUsize, Ordering};

use clap::Args;
use glam::Vec3;
use rayon::prelude::*;
use serde::Serialize;
use treewright_accel::{BuildChoice, Hit, Intersector, NativeQuality, Ray, Visitor};

use super::bar;
use treewright_render_cli::arguments::{
    CameraArguments, FrameArguments, SceneArguments, Size, SpaceArguments,
};
use treewright_render_cli::error::CliError;
use treewright_render_cli::output;
use treewright_renderer::film::Film;
use treewright_renderer::integrator::Lens;
use treewright_renderer::integrator::random::PathRandom;
use treewright_renderer::limits::VERIFY_RAYS_MAX;
use treewright_renderer::space::{self, Choice, Premises, Preset, TuningSpace};
use treewright_renderer::tuning::objective::Objective;
use treewright_scene::{Camera, Scene};

/// Two distances agree when they differ by at most this share of the larger one, or of the scene's diagonal
/// where both are small: single precision through different formulas.
const DISTANCE_TOLERANCE: f32 = 1e-4;

/// The tolerance where both name the same triangle: for needles seen nearly along their plane the formulas'
/// roundings differ by more.
const SAME_TRIANGLE_TOLERANCE: f32 = 1e-2;

/// Largest share of rays that may disagree: rays through an edge or a corner can slip past either way.
const DISAGREEING_RAYS_MAX: f64 = 1e-3;

/// Largest mean relative difference of two pictures.
const PICTURE_DIFFERENCE_MAX: f64 = 1e-3;

/// A spread of the full space: both back ends, every node width, builder, order, format, and packets.
const SPREAD: [&str; 11] = [
    "native_quality=high",
    "native_split_budget=2,native_presplit=true",
    "native_layout=qbvh8_triangle4",
    "native_layout=compact,tile=8,tile_order=morton",
    "primary=eight_coherent,first_shadow=sixteen,bounce=sixteen,shadow=eight,sort=octant_morton",
    "quality=1,branching_factor=2,max_depth=64",
    "quality=2,staged=false",
    "quality=3,branching_factor=4,max_leaf_size=8,split_budget=2",
    "block_width=8,order=depth_first",
    "collapse=optimal,reinsertion_passes=2,order=van_emde_boas",
    "node_width=16,format=quantised,order=treelets,block_width=8",
];

/// Arguments of `verify`.
#[derive(Args, Clone, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    camera: CameraArguments,
    #[command(flatten)]
    frame: FrameArguments,

    #[command(flatten)]
    space: SpaceArguments,

    /// Another configuration, as for `image`; can be repeated.
    #[arg(long, value_name = "NAME=VALUE,…")]
    config: Vec<String>,

    /// Number of rays to compare with the oracle.
    #[arg(long, value_name = "N", default_value_t = 10_000, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(VERIFY_RAYS_MAX)))]
    rays: u32,

    /// Size of the pictures that are compared, in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "160x120")]
    size: Size,

    /// Samples per pixel of these pictures.
    #[arg(long, value_name = "N", default_value_t = 4, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=1024))]
    spp: u32,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The result of one accelerator.
#[derive(Debug, Serialize)]
struct Verdict {
    name: String,
    /// Rays that hit something, of all.
    hits: usize,
    /// Rays that hit something in one accelerator only, or at another distance.
    wrong_closest: usize,
    /// Rays whose any-hit answer differs.
    wrong_occluded: usize,
    /// Against the first accelerator's picture.
    picture_difference: f64,
    /// Hits of all rays of the picture.
    picture_hits: u64,
    agrees: bool,
    failure: Option<String>,
}

#[derive(Debug, Serialize)]
struct VerificationResults {
    scene: String,
    /// As rays meet them.
    triangles: u64,
    rays: usize,
    oracle_hits: usize,
    accelerators: Vec<Verdict>,
    agrees: bool,
}

/// Verifies and prints; fails when anything disagrees.
pub(super) fn run(arguments: &Arguments) -> Result<(), CliError> {
    let accelerators = accelerators(arguments.space, &arguments.config, arguments.frame.threads)?;
    let scene = arguments.scene.load()?;
    let camera = arguments.camera.find(&scene)?;
    let renderer = arguments.frame.renderer(&scene)?;
    let rays = rays(&scene, &camera, arguments.rays, arguments.frame.seed);
    let oracle = renderer.build(&BuildChoice::BruteForce)?.0;
    let bar = bar(arguments.json, rays.len() as u64, "rays asked of the oracle");
    let (done, step) = (AtomicUsize::new(0), 64);
    let answers: Vec<Answer> = renderer.install(|| {
        let answer = |chunk: &[Ray]| {
            let answers = oracle.visit(Ask { rays: chunk });
            bar.set_position((done.fetch_add(chunk.len(), Ordering::Relaxed) + chunk.len()) as u64);
            answers
        };
        rays.par_chunks(step).flat_map_iter(answer).collect()
    });
    bar.finish_and_clear();

    let view = arguments.frame.view(camera);
    let diagonal = scene.bounds().diagonal();
    let mut first_picture = None;
    let mut verdicts = Vec::new();
    for (name, choice) in accelerators {
        let structure = match renderer.build(&choice.build) {
            Ok((structure, _)) => structure,
            // A depth limit is a finding of the tuner and says nothing about hits.
            Err(error) => {
                let failure = Some(error.to_string());
                verdicts.push(Verdict { failure, ..Verdict::unmeasured(name, error.is_infeasible()) });
                continue;
            }
        };
        let found: Vec<Answer> = renderer.install(|| {
            rays.par_chunks(step).flat_map_iter(|chunk| structure.visit(Ask { rays: chunk })).collect()
        });
        let mut film = Film::new(arguments.size.width, arguments.size.height);
        let mut picture_hits = 0;
        for _ in 0..arguments.spp {
            picture_hits += renderer.render_with(&structure, &view, &choice.render, &mut film).1.hits;
        }
        let picture = film.picture();
        let picture_difference =
            first_picture.get_or_insert_with(|| picture.clone()).mean_relative_difference(&picture);
        let pairs = || answers.iter().zip(&found);
        let wrong_closest = pairs().filter(|(a, b)| !same_hit(a.closest, b.closest, diagonal)).count();
        let wrong_occluded = pairs().filter(|(a, b)| a.occluded != b.occluded).count();
        let tolerated = (DISAGREEING_RAYS_MAX * rays.len() as f64) as usize;
        verdicts.push(Verdict {
            name,
            hits: found.iter().filter(|answer| answer.closest.is_some()).count(),
            wrong_closest,
            wrong_occluded,
            picture_difference,
            picture_hits,
            agrees: wrong_closest <= tolerated
                && wrong_occluded <= tolerated
                && picture_difference < PICTURE_DIFFERENCE_MAX,
            failure: None,
        });
    }
    let results = VerificationResults {
        scene: scene.name.clone(),
        triangles: scene.placed().count(),
        rays: rays.len(),
        oracle_hits: answers.iter().filter(|answer| answer.closest.is_some()).count(),
        agrees: verdicts.iter().all(|verdict| verdict.agrees),
        accelerators: verdicts,
    };
    print(&results, arguments.json)
}

impl Verdict {
    fn unmeasured(name: String, agrees: bool) -> Self {
        Self {
            name,
            hits: 0,
            wrong_closest: 0,
            wrong_occluded: 0,
            picture_difference: 0.0,
            picture_hits: 0,
            agrees,
            failure: None,
        }
    }
}

fn print(results: &VerificationResults, json: bool) -> Result<(), CliError> {
    if json {
        output::json(results)?;
    } else {
        println!(
            "{}: {} triangles, {} rays, {} of them hit by brute force\n",
            results.scene, results.triangles, results.rays, results.oracle_hits
        );
        let mut table = output::table(&[
            "accelerator",
            "hits",
            "wrong nearest",
            "wrong any",
            "picture differs by",
            "agrees",
        ]);
        for one in &results.accelerators {
            let verdict = if one.agrees { "yes" } else { "NO" };
            match &one.failure {
                Some(failure) => table.add_row([one.name.as_str(), failure, "", "", "", verdict]),
                None => table.add_row([
                    one.name.clone(),
                    one.hits.to_string(),
                    one.wrong_closest.to_string(),
                    one.wrong_occluded.to_string(),
                    format!("{:.5} %", one.picture_difference * 100.0),
                    verdict.to_owned(),
                ]),
            };
        }
        println!("{table}");
    }
    if results.agrees {
        Ok(())
    } else {
        Err(CliError::Failed("the accelerators do not agree; see the table".to_owned()))
    }
}

/// The accelerators to compare: native ones, and a spread of tunable ones and of ways to render.
fn accelerators(
    space: SpaceArguments,
    more: &[String],
    threads: usize,
) -> Result<Vec<(String, Choice)>, CliError> {
    let mut all = vec![
        ("native medium".to_owned(), Choice::native(NativeQuality::Medium)),
        ("native low".to_owned(), Choice::native(NativeQuality::Low)),
        ("native high".to_owned(), Choice::native(NativeQuality::High)),
        ("paper default".to_owned(), Choice::paper_default()),
    ];
    let full = TuningSpace::new(Preset::Full, &Premises::all());
    for text in SPREAD {
        all.push((text.to_owned(), full.choice(&space::parse(text)?)?));
    }
    let robust = TuningSpace::new(Preset::Full, &Premises { robust: true, ..Premises::all() });
    for text in ["backend=native", "backend=tunable"] {
        all.push((format!("robust, {text}"), robust.choice(&space::parse(text)?)?));
    }
    let space = space.whole(Objective::Render, threads)?;
    for text in more {
        all.push((text.clone(), space.choice(&space::parse(text)?)?));
    }
    Ok(all)
}

#[derive(Clone, Copy, Debug)]
struct Answer {
    closest: Option<Hit>,
    occluded: bool,
}

struct Ask<'a> {
    rays: &'a [Ray],
}

impl Visitor for Ask<'_> {
    type Output = Vec<Answer>;

    fn visit<I: Intersector>(self, intersector: &I) -> Vec<Answer> {
        self.rays
            .iter()
            .map(|ray| Answer { closest: intersector.closest(ray), occluded: intersector.occluded(ray) })
            .collect()
    }
}

/// Half of the rays start at the camera, half between random points of the scene's bounds; every other one of
/// these has an end.
fn rays(scene: &Scene, camera: &Camera, count: u32, seed: u64) -> Vec<Ray> {
    let bounds = scene.bounds();
    let (low, high) = (bounds.min, bounds.max);
    let lens = Lens::new(camera, 1, 1);
    (0..count)
        .map(|number| {
            let random = PathRandom::new(seed, number, u32::MAX);
            if number % 2 == 0 {
                return lens.ray(0, 0, random.pair(0));
            }
            let point = |place| {
                let ([x, y], z) = (random.pair(place), random.single(place + 1));
                low + (high - low) * Vec3::new(x, y, z)
            };
            let (origin, target) = (point(1), point(3));
            let t_max = if number % 4 == 1 { 1.0 } else { f32::INFINITY };
            Ray { origin, direction: target - origin, t_min: 0.0, t_max }
        })
        .collect()
}

fn same_hit(a: Option<Hit>, b: Option<Hit>, diagonal: f32) -> bool {
    match (a, b) {
        (None, None) => true,
        (Some(a), Some(b)) => {
            let larger = a.t.max(b.t).max(diagonal * f32::EPSILON);
            let tolerance = if (a.triangle, a.instance) == (b.triangle, b.instance) {
                SAME_TRIANGLE_TOLERANCE
            } else {
                DISTANCE_TOLERANCE
            };
            (a.t - b.t).abs() <= tolerance * larger
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use treewright_accel::NO_INSTANCE;

    use super::*;

    #[test]
    fn distances_agree_within_single_precision() {
        let on = |triangle: u32, t: f32| Some(Hit { t, u: 0.0, v: 0.0, triangle, instance: NO_INSTANCE });
        let at = |t: f32| on(0, t);
        assert!(same_hit(None, None, 1.0));
        assert!(same_hit(at(100.0), at(100.001), 1.0));
        assert!(!same_hit(at(100.0), at(102.0), 1.0));
        assert!(same_hit(at(100.0), at(100.5), 1.0) && !same_hit(at(100.0), on(1, 100.5), 1.0));
        assert!(!same_hit(at(1.0), None, 1.0));
        assert!(same_hit(at(0.0), at(1e-9), 100.0));
    }

    #[test]
    fn every_structure_of_the_spread_is_sound() {
        let full = SpaceArguments { space: Preset::Full, robust: false };
        assert!(accelerators(full, &[], 1).is_ok_and(|all| all.len() == 4 + SPREAD.len() + 2));
        assert!(accelerators(full, &["colour=1".to_owned()], 1).is_err());
        let paper = SpaceArguments { space: Preset::Paper, ..full };
        assert!(accelerators(paper, &["compact=true".to_owned()], 1).is_ok());
    }
}

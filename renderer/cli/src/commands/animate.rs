//! `treewright-render animate`: ways to follow a moving scene, frame by frame and interleaved.
//!
//! Each way keeps a structure of its own. In every frame all of them are brought to the scene's new moment
//! and rendered with, one after the other and beginning with another one each time. Results are ratios within
//! frames. The first frame builds and is not counted.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use treewright_accel::{Structure, Update};

use crate::arguments::{StructureArguments, ViewArguments};
use crate::error::{CliError, write_file};
use crate::interrupt::Interrupt;
use crate::output;
use treewright_renderer::film::Film;
use treewright_renderer::frame::FrameTimes;
use treewright_renderer::limits::ITERATIONS_MAX;
use treewright_renderer::statistics::Summary;

/// Thresholds of the partial updates that are compared.
const THRESHOLDS: [f32; 2] = [1.15, Update::REBUILD_THRESHOLD];

/// Arguments of `animate`.
#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    structure: StructureArguments,

    /// Number of frames to measure.
    #[arg(long, value_name = "N", default_value_t = 48, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ITERATIONS_MAX)))]
    frames: u32,

    /// Number of cycles of the scene in that time.
    #[arg(long, value_name = "N", default_value_t = 1.0)]
    rounds: f32,

    /// Write every frame as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// The result of one way.
#[derive(Debug, Serialize)]
struct Follower {
    update: Update,
    frames: Vec<FrameTimes>,
    /// Expected cost of a ray in the last frame, for trees of ours.
    sah_cost: Option<f64>,
    /// Whole frames against rebuilding, pair by pair: above 1 is faster.
    speedup: Summary,
    /// Pictures of all frames agree with those of the rebuilt structure, up to this difference.
    picture_difference: f64,
    #[serde(skip)]
    structure: Option<Structure>,
}

#[derive(Debug, Serialize)]
struct AnimationResults<'a> {
    scene: &'a str,
    triangles: usize,
    size: [u32; 2],
    threads: usize,
    rounds: f32,
    followers: &'a [Follower],
}

/// Measures and prints.
pub(crate) fn run(arguments: &Arguments) -> Result<(), CliError> {
    let moving = arguments.view.scene.moving()?;
    let mut scene = moving.at(arguments.view.scene.time)?;
    let mut renderer = arguments.view.frame.renderer(&scene)?;
    let choice = arguments.structure.choice()?;
    let view = arguments.view.frame.view(arguments.view.camera.find(&scene)?);
    let mut film = Film::new(arguments.view.size.width, arguments.view.size.height);
    let partial = THRESHOLDS.map(Update::partial);
    let mut followers = Vec::new();
    for update in [Update::Rebuild, Update::Refit].into_iter().chain(partial) {
        let structure = Some(renderer.build(&choice.build)?.0);
        let speedup = Summary::default();
        followers.push(Follower {
            update,
            frames: vec![],
            sah_cost: None,
            speedup,
            picture_difference: 0.0,
            structure,
        });
    }
    let interrupt = Interrupt::listen();
    let bar = output::bar(u64::from(arguments.frames), "frames");
    // The first round warms caches and clocks, and lets updates make their preparations.
    for frame in 0..=arguments.frames {
        let moment = arguments.rounds * frame as f32 / arguments.frames as f32;
        scene = moving.at(arguments.view.scene.time + moment)?;
        renderer.set_scene(scene.clone());
        let mut pictures = vec![None; followers.len()];
        for turn in 0..followers.len() {
            let index = (frame as usize + turn) % followers.len();
            let follower = &mut followers[index];
            let Some(structure) = &mut follower.structure else {
                continue;
            };
            let build_ms = renderer.follow(structure, follower.update)?;
            film.clear();
            let (render_ms, _) = renderer.render_with(structure, &view, &choice.render, &mut film);
            if frame > 0 {
                follower.frames.push(FrameTimes::of(build_ms, render_ms));
            }
            pictures[index] = Some(film.picture());
        }
        if let Some(Some(first)) = pictures.first() {
            for (follower, picture) in followers.iter_mut().zip(pictures.iter().flatten()) {
                let difference = first.mean_relative_difference(picture);
                follower.picture_difference = follower.picture_difference.max(difference);
            }
        }
        bar.inc(1);
        if interrupt.requested() {
            break;
        }
    }
    bar.finish_and_clear();
    let total = |frame: &FrameTimes| frame.build_ms + frame.render_ms;
    let totals: Vec<Vec<f64>> =
        followers.iter().map(|follower| follower.frames.iter().map(total).collect()).collect();
    for (follower, own) in followers.iter_mut().zip(&totals) {
        follower.speedup = Summary::of_ratios(&totals[0], own);
        let shape = follower.structure.as_ref().and_then(|structure| structure.statistics().tree);
        follower.sah_cost = shape.map(|shape| shape.sah_cost);
    }
    println!(
        "{}: {} triangles, {}, {} threads, {} frames over {} rounds\n",
        scene.name,
        scene.triangles.len(),
        arguments.view.size,
        renderer.threads(),
        followers[0].frames.len(),
        arguments.rounds
    );
    println!("{}", table(&followers));
    if let Some(path) = &arguments.json {
        let results = AnimationResults {
            scene: &scene.name,
            triangles: scene.triangles.len(),
            size: [arguments.view.size.width, arguments.view.size.height],
            threads: renderer.threads(),
            rounds: arguments.rounds,
            followers: &followers,
        };
        write_file(path, output::to_json(&results)?.as_bytes())?;
    }
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

fn table(followers: &[Follower]) -> comfy_table::Table {
    let mut table = output::table(&[
        "way to follow",
        "build ms",
        "render ms",
        "speed-up over rebuild",
        "quartiles",
        "cost at the end",
        "picture differs by",
    ]);
    for follower in followers {
        let name = match follower.update {
            Update::Rebuild => "rebuild".to_owned(),
            Update::Refit => "refit".to_owned(),
            Update::Partial { rebuild_threshold } => format!("partial, {rebuild_threshold}"),
        };
        let median = |of: fn(&FrameTimes) -> f64| {
            Summary::of(&follower.frames.iter().map(of).collect::<Vec<_>>()).median
        };
        let speedup = follower.speedup;
        table.add_row([
            name,
            format!("{:.2}", median(|frame| frame.build_ms)),
            format!("{:.1}", median(|frame| frame.render_ms)),
            format!("{:.2} ×", speedup.median),
            format!("{:.2} – {:.2}", speedup.lower_quartile, speedup.upper_quartile),
            follower.sah_cost.map_or_else(String::new, |cost| format!("{cost:.1}")),
            format!("{:.5} %", follower.picture_difference * 100.0),
        ]);
    }
    table
}

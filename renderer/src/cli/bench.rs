//! `treewright-render bench`: named structures, measured interleaved.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;

use super::arguments::{CameraArguments, FrameArguments, SceneArguments, Size, SpaceArguments};
use super::error::{CliError, write_file};
use super::interrupt::Interrupt;
use super::output;
use crate::limits::{CONTENDERS_MAX, ROUNDS_MAX};
use crate::measure::{Conditions, Standing, interleaved, standings};
use crate::space;
use crate::tuning::objective::Objective;
use crate::tuning::verdict::{contender, peers};

/// Arguments of `bench`.
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

    /// A further configuration, as for `image`; may be given several times.
    #[arg(long, value_name = "NAME=VALUE,…")]
    config: Vec<String>,

    /// Pixels across and down.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    size: Size,

    /// How often each structure is measured.
    #[arg(long, value_name = "N", default_value_t = 21, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// What a frame is: with a thousandth of its build (`render`), or with a whole one (`total`).
    #[arg(long, value_enum, default_value_t = Objective::Render)]
    objective: Objective,

    /// Write the results to a file as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

/// What `bench --json` writes.
#[derive(Debug, Serialize)]
struct Results<'a> {
    scene: &'a str,
    triangles: usize,
    size: [u32; 2],
    threads: usize,
    rounds: u32,
    objective: Objective,
    standings: &'a [Standing],
}

/// Measures and prints.
pub(super) fn run(arguments: &Arguments) -> Result<(), CliError> {
    let scene = arguments.scene.load()?;
    let mut contenders = peers(&arguments.space.of(&scene, arguments.objective, arguments.frame.threads)?);
    let space = arguments.space.whole(arguments.objective, arguments.frame.threads)?;
    for text in &arguments.config {
        contenders.push(contender(text, &space, &space::parse(text)?)?);
    }
    if contenders.len() > CONTENDERS_MAX {
        return Err(CliError::Usage(format!(
            "{} structures are more than the limit of {CONTENDERS_MAX}",
            contenders.len()
        )));
    }
    let camera = arguments.camera.find(&scene)?;
    let renderer = arguments.frame.renderer(&scene)?;
    let conditions = Conditions {
        view: arguments.frame.view(camera),
        width: arguments.size.width,
        height: arguments.size.height,
        rounds: arguments.rounds,
        frames_per_build: arguments.objective.frames_per_build(),
    };
    let interrupt = Interrupt::listen();
    let bar = output::bar(u64::from(arguments.rounds) + 1, "rounds");
    let measured = interleaved(&renderer, &contenders, &conditions, || {
        bar.inc(1);
        !interrupt.requested()
    });
    bar.finish_and_clear();
    let standings = standings(&measured, arguments.objective.frames_per_build());
    println!(
        "{}: {} triangles, {}, {} threads, {} rounds\n",
        scene.name,
        scene.triangles.len(),
        arguments.size,
        renderer.threads(),
        arguments.rounds
    );
    println!("{}", output::standings(&standings));
    if let Some(path) = &arguments.json {
        let results = Results {
            scene: &scene.name,
            triangles: scene.triangles.len(),
            size: [arguments.size.width, arguments.size.height],
            threads: renderer.threads(),
            rounds: arguments.rounds,
            objective: arguments.objective,
            standings: &standings,
        };
        write_file(path, output::to_json(&results)?.as_bytes())?;
    }
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

//! `treewright-render rays`: the rays of one frame, recorded for `cargo bench -p treewright-accel`.

use std::io::{BufWriter, Write};
use std::{fs::File, path::PathBuf};

use clap::Args;
use treewright_accel::{BuildChoice, Device, NativeOptions, build};

use crate::arguments::{CameraArguments, SceneArguments, Size};
use crate::error::{CliError, Result};
use treewright_renderer::integrator::{Prepared, View};
use treewright_renderer::{film::Film, limits::BOUNCES_MAX, recorder::record};

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    camera: CameraArguments,

    /// Random seed.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Maximum number of bounces of a path.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=i64::from(BOUNCES_MAX)))]
    bounces: u32,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    size: Size,

    /// Output file, preferably ending in `.rays`.
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
}

/// Renders one sample a pixel on one thread and writes its rays.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let unwritable = |error: std::io::Error| {
        CliError::Failed(format!("{} cannot be written: {error}", arguments.out.display()))
    };
    let scene = arguments.scene.load()?;
    if scene.instances.is_some() {
        let cause = "its triangles are placed by instances, and a recording holds plain triangles only: try --flatten";
        return Err(CliError::Failed(format!("the rays of {} cannot be recorded: {cause}", scene.name)));
    }
    let camera = arguments.camera.find(&scene)?;
    let choice = BuildChoice::Native(NativeOptions::default());
    let structure = build(&Device::open(0)?, &scene.triangles, &choice)?;
    let view = View { camera, seed: arguments.seed, bounces: arguments.bounces };
    let mut film = Film::new(arguments.size.0);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .map_err(|error| CliError::Failed(format!("a thread for recording cannot be started: {error}")))?;
    let prepared = Prepared::new(scene.clone());
    let recording = pool.install(|| record(&prepared, &structure, &view, &mut film));
    let mut file = BufWriter::new(File::create(&arguments.out).map_err(unwritable)?);
    let written = serde_json::to_writer(&mut file, &recording).map_err(std::io::Error::from);
    written.and_then(|()| file.flush()).map_err(unwritable)?;
    println!("{}: {} triangles", scene.name, scene.triangles.len());
    for set in &recording.sets {
        println!("{:>9} {}", set.rays.len(), set.class.name());
    }
    if scene.triangles.has_masks() {
        println!("note: a recording holds no masks, so what replays it meets cut-out triangles everywhere");
    }
    println!("wrote {}", arguments.out.display());
    Ok(())
}

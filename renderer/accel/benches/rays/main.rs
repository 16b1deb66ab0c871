//! The speed of the acceleration structures: million rays a second and build milliseconds, side by side.
//!
//! `cargo bench -p treewright-accel -- --rounds 21 --json rays.json`
//!
//! `TREEWRIGHT_RAYS` names recordings (files or folders, separated as in `PATH`) that
//! `treewright-render rays` has made of frames. Every round runs every structure once on every set of rays,
//! and a ratio is taken within a round, so that a slow spell of the machine hits both sides. Nothing is timed
//! before its answers have been compared ray by ray with native Embree's, and those of native Embree with
//! brute force. `tools/tinybvh.sh` compiles one more peer.

mod answers;
mod bandwidth;
mod contenders;
mod measure;
mod overview;
mod peers;
mod summary;
mod tinybvh;

use std::error::Error;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use clap::Parser;
use treewright_accel::recording::Recording;
use treewright_accel::{Device, Isa, set_flush_denormals};

use bandwidth::Bandwidth;
use summary::{Results, SceneResults};

/// Names the recordings.
const RECORDINGS: &str = "TREEWRIGHT_RAYS";

/// Measures acceleration structures on recorded rays.
#[derive(Debug, Parser)]
#[command(name = "rays")]
struct Arguments {
    /// How often each structure traces each set of rays.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rounds: u32,

    /// How often each structure is built.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    builds: u32,

    /// Only scenes whose name contains this.
    #[arg(long, value_name = "TEXT", default_value = "")]
    scene: String,

    /// Only structures whose name contains one of these; native medium is always there.
    #[arg(long, value_name = "TEXT,…", value_delimiter = ',', default_value = "")]
    structure: Vec<String>,

    /// Threads that trace: one, all cores, or first one and then all.
    #[arg(long, value_name = "N", value_enum, default_value = "both")]
    threads: measure::Threads,

    /// Threads that Embree builds with; 0 is one a core.
    #[arg(long, value_name = "N", default_value_t = 0)]
    build_threads: usize,

    /// Write everything to a file as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Handed over by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments = Arguments::parse();
    set_flush_denormals();
    let device = Device::open(arguments.build_threads)?;
    let mut results = Results {
        embree: device.version(),
        instruction_set: format!("{:?}", Isa::detect()),
        build_threads: arguments.build_threads,
        rounds: arguments.rounds,
        builds: arguments.builds,
        bandwidth: arguments
            .threads
            .counts()
            .into_iter()
            .map(Bandwidth::measure)
            .collect::<Result<_, _>>()?,
        scenes: Vec::new(),
    };
    for path in recordings(&arguments.scene)? {
        let (name, recording) = (name(&path), read(&path)?);
        let contenders = contenders::build_all(&device, &recording, &arguments.structure, arguments.builds)?;
        let expected = answers::check(&name, &recording, &contenders)?;
        let visits = contenders::visits(&device, &recording)?;
        for threads in arguments.threads.counts() {
            let rows = measure::measure(&recording, &contenders, threads, arguments.rounds)?;
            let scene = SceneResults::new(&name, &recording, (&expected, &visits), threads, rows);
            println!("{scene}\n");
            results.scenes.push(scene);
        }
    }
    for (threads, bandwidth) in arguments.threads.counts().into_iter().zip(&results.bandwidth) {
        println!("{bandwidth}");
        println!("{}\n", overview::Overview::new(&results.scenes, threads));
    }
    if results.scenes.is_empty() {
        return Err(format!("no scene's name contains {:?}", arguments.scene).into());
    }
    if let Some(path) = &arguments.json {
        std::fs::write(path, serde_json::to_string_pretty(&results)?)
            .map_err(|error| format!("{} cannot be written: {error}", path.display()))?;
    }
    Ok(())
}

/// The name of a recording's scene.
fn name(path: &Path) -> String {
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The recordings to measure: files as they are, folders for the files in them that end in `.rays`.
fn recordings(filter: &str) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let mut files = Vec::new();
    let places = std::env::var_os(RECORDINGS).unwrap_or_default();
    for place in std::env::split_paths(&places).filter(|place| !place.as_os_str().is_empty()) {
        if !place.is_dir() {
            files.push(place);
            continue;
        }
        let entries = std::fs::read_dir(&place)
            .map_err(|error| format!("{} cannot be listed: {error}", place.display()))?;
        for entry in entries {
            let path = entry?.path();
            if path.extension().is_some_and(|ending| ending == "rays") {
                files.push(path);
            }
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(
            format!("{RECORDINGS} names no recording: make some with `treewright-render rays`").into()
        );
    }
    files.retain(|path| name(path).contains(filter));
    Ok(files)
}

fn read(path: &Path) -> Result<Recording, Box<dyn Error>> {
    let with_path = |cause: &dyn std::fmt::Display| format!("{}: {cause}", path.display());
    let file = File::open(path).map_err(|error| with_path(&error))?;
    Ok(Recording::read(BufReader::new(file)).map_err(|error| with_path(&error))?)
}

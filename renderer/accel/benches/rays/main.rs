//! The speed of the acceleration structures on recorded rays, side by side: the tables of
//! docs/measurements/rays.md and cost-of-a-ray.md.
//!
//! `cargo bench -p treewright-accel -- --rounds 21 $PWD/*.rays`
//!
//! The files are recordings by `treewright-render rays`. Every round runs every structure once on a set of
//! rays. Answers are first compared ray by ray with native Embree's. `tools/tinybvh.sh` compiles one more
//! peer.

mod answers;
mod bandwidth;
mod contenders;
mod measure;
mod overview;
mod peers;
mod tinybvh;

use std::path::{Path, PathBuf};
use std::{error::Error, fs::File, io::BufReader};

use clap::Parser;
use treewright_accel::{Device, Isa, recording::Recording, set_flush_denormals};

use overview::Scene;

/// Measures acceleration structures on recorded rays.
#[derive(Debug, Parser)]
#[command(name = "rays")]
struct Arguments {
    /// Recordings. Cargo changes the folder, so name them from the root on.
    #[arg(value_name = "FILE", required = true)]
    recordings: Vec<PathBuf>,

    /// How often each structure traces each set of rays.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rounds: u32,

    /// Numbers of threads that trace, one after the other. Default: one, and then one a core.
    #[arg(long, value_name = "N,…", value_delimiter = ',')]
    threads: Vec<usize>,

    /// Handed over by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = Arguments::parse();
    if arguments.threads.is_empty() {
        arguments.threads = vec![1, std::thread::available_parallelism().map_or(1, usize::from)];
        arguments.threads.dedup();
    }
    set_flush_denormals();
    let device = Device::open(0)?;
    println!("Embree {:?}, {:?}, {} rounds", device.version(), Isa::detect(), arguments.rounds);
    let mut scenes = Vec::new();
    for path in &arguments.recordings {
        let of_file = |cause: &dyn std::fmt::Display| format!("{}: {cause}", path.display());
        let recording = read(path).map_err(|error| of_file(&error))?;
        let contenders = contenders::build_all(&device, &recording.triangles)?;
        answers::check(&recording, &contenders).map_err(|error| of_file(&error))?;
        let visits = contenders::visits(&device, &recording)?;
        for &threads in &arguments.threads {
            let speeds = measure::measure(&recording, &contenders, threads, arguments.rounds)?;
            scenes.push(Scene { threads, visits: visits.clone(), speeds });
        }
        println!("{}: {} triangles", path.display(), recording.triangles.len());
    }
    for &threads in &arguments.threads {
        println!("\n{threads} threads, {}", bandwidth::measured(threads)?);
        println!("{}", overview::table(&scenes, threads));
    }
    Ok(())
}

fn read(path: &Path) -> Result<Recording, Box<dyn Error>> {
    Ok(serde_json::from_reader(BufReader::new(File::open(path)?))?)
}

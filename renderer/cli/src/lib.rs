//! The program `treewright-render`: what it understands, and which exit codes it ends with.
//!
//! | module | what it holds |
//! |---|---|
//! | `commands` | one file for each command |
//! | `arguments`, `narrowing`, `server` | groups of arguments that several commands share, also those of `treewright-lab` |
//! | `output`, `error`, `interrupt` | tables and progress, exit codes, Ctrl-C |
//! | `report` | the page that `tune --report` writes |
//! | `laboratory` | commands that the program `treewright-lab` carries out |

pub mod arguments;
mod commands;
pub mod error;
pub mod interrupt;
mod laboratory;
pub mod narrowing;
pub mod output;
pub mod report;
pub mod server;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tracing_subscriber::EnvFilter;

use commands::{animate, bench, best, image, info, play, rays, sample, tune};
use error::CliError;

const EXAMPLES: &str = "\
Examples:
  treewright-render scenes
  treewright-render image --scene builtin:hall --spp 64 -o hall.png
  treewright-render image --scene sponza.glb --config quality=3,branching_factor=8 -o sponza.exr
  treewright-render tune --scene builtin:hall --iterations 80 --report hall.html
  treewright-render sample --scene builtin:hall --scene sponza.glb --cameras 10 --samples 1000 --space paper
  treewright-render play --scene builtin:hall --frames 50 --compare
  treewright-render bench --scene builtin:city --rounds 15
  treewright-render ablate --scene builtin:city --config-file best.json --report ablation.html
  treewright-render verify --scene bmw.ply --rays 10000

The commands from leave-out on are those of the program treewright-lab, which must lie in the same folder.

Exit codes:
  0  done
  1  the operation failed
  2  the command line makes no sense
  3  the daemon cannot be reached
  130  stopped by Ctrl-C";

/// A path tracer whose acceleration structure is tuned by a service while it renders.
#[derive(Debug, Parser)]
#[command(name = "treewright-render", version, after_help = EXAMPLES, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render one picture.
    Image(image::Arguments),
    /// Tell what a scene consists of.
    Info(info::InfoArguments),
    /// List the built-in scenes.
    Scenes(info::ListArguments),
    /// Show the parameters that can be tuned.
    Spaces(info::SpacesArguments),
    /// Tune the acceleration structure with the daemon's help while frames are rendered.
    Tune(Box<tune::Arguments>),
    /// Measure random configurations and record them as trials, for `treewright analyze`.
    Sample(Box<sample::Arguments>),
    /// Tell what the service holds for the best in a scene and view, as JSON.
    Best(Box<best::Arguments>),
    /// Fly along the camera path with the daemon's answers, frame by frame.
    Play(Box<play::Arguments>),
    /// Measure ways to follow a moving scene against each other: rebuild, refit, rebuild in part.
    Animate(animate::Arguments),
    /// Measure acceleration structures against each other.
    Bench(bench::Arguments),
    /// Record the rays of a frame for the benchmark of the acceleration structures.
    Rays(rays::Arguments),
    /// Measure what it saves to leave out what a scene does not need.
    LeaveOut(laboratory::Arguments),
    /// Measure what the service is worth on scenes it has never seen.
    LeaveSceneOut(laboratory::Arguments),
    /// Compare errors over time: whose picture is good enough first, builds and tuning included.
    Converge(laboratory::Arguments),
    /// Repeat the paper's evaluation: record searches along camera paths, then judge predictors by the record.
    Evaluate(laboratory::Arguments),
    /// Write what an evaluation says as one page, with every figure and the numbers behind it.
    Report(laboratory::Arguments),
    /// Take a tuned configuration apart: which parameter brought what.
    Ablate(laboratory::Arguments),
    /// Check that all acceleration structures give the same hits and pictures.
    Verify(laboratory::Arguments),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    carry_out("treewright-render", || run(&Cli::parse().command))
}

/// Carries out what the command line asks a program for. Warnings of libraries go to standard error as far as
/// `TREEWRIGHT_LOG` lets them, the reason of a failure in any case. Freed memory is kept for the next tree.
pub fn carry_out(program: &str, run: impl FnOnce() -> Result<(), CliError>) -> ExitCode {
    // Where the C library does not know how, builds are slower and nothing else changes.
    let _ = treewright_accel::keep_freed_memory();
    let filter = EnvFilter::try_from_env("TREEWRIGHT_LOG").unwrap_or_else(|_| EnvFilter::new("error"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{program}: {error}");
            error.exit_code()
        }
    }
}

fn run(command: &Command) -> Result<(), CliError> {
    match command {
        Command::Image(arguments) => image::run(arguments),
        Command::Info(arguments) => info::info(arguments),
        Command::Scenes(arguments) => info::scenes(arguments),
        Command::Spaces(arguments) => info::spaces(arguments),
        Command::Tune(arguments) => tune::run(arguments),
        Command::Sample(arguments) => sample::run(arguments),
        Command::Best(arguments) => best::run(arguments),
        Command::Play(arguments) => play::run(arguments),
        Command::Animate(arguments) => animate::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Rays(arguments) => rays::run(arguments),
        Command::LeaveOut(arguments) => laboratory::run("leave-out", arguments),
        Command::LeaveSceneOut(arguments) => laboratory::run("leave-scene-out", arguments),
        Command::Converge(arguments) => laboratory::run("converge", arguments),
        Command::Evaluate(arguments) => laboratory::run("evaluate", arguments),
        Command::Report(arguments) => laboratory::run("report", arguments),
        Command::Ablate(arguments) => laboratory::run("ablate", arguments),
        Command::Verify(arguments) => laboratory::run("verify", arguments),
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }
}

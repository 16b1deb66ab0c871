//! The program `treewright-render`: what it understands, and which exit codes it ends with.

mod ablate;
mod animate;
mod arguments;
mod bench;
mod converge;
mod converge_entrants;
mod converge_output;
mod error;
mod image;
mod info;
mod interrupt;
mod leave_out;
mod output;
mod play;
mod rays;
mod server;
mod tune;
mod tune_output;
mod verify;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tracing_subscriber::EnvFilter;

use error::CliError;

const EXAMPLES: &str = "\
Examples:
  treewright-render scenes
  treewright-render image --scene builtin:hall --spp 64 -o hall.png
  treewright-render image --scene sponza.glb --config quality=3,branching_factor=8 -o sponza.exr
  treewright-render tune --scene builtin:hall --iterations 80 --report hall.html
  treewright-render play --scene builtin:hall --frames 50 --compare
  treewright-render bench --scene builtin:city --rounds 15
  treewright-render leave-out --scene builtin:model
  treewright-render converge --scene builtin:hall --report converge.html
  treewright-render ablate --scene builtin:city --config-file best.json --report ablation.html
  treewright-render verify --scene bmw.ply --rays 10000

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
    /// Fly along the camera path with the daemon's answers, frame by frame.
    Play(Box<play::Arguments>),
    /// Measure ways to follow a moving scene against each other: rebuild, refit, rebuild in part.
    Animate(animate::Arguments),
    /// Measure acceleration structures against each other.
    Bench(bench::Arguments),
    /// Record the rays of a frame for the benchmark of the acceleration structures.
    Rays(rays::Arguments),
    /// Measure what it saves to leave out what a scene does not need.
    LeaveOut(leave_out::Arguments),
    /// Compare errors over time: whose picture is good enough first, builds and tuning included.
    Converge(Box<converge::Arguments>),
    /// Take a tuned configuration apart: which parameter brought what.
    Ablate(ablate::Arguments),
    /// Check that all acceleration structures give the same hits and pictures.
    Verify(verify::Arguments),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    let filter = EnvFilter::try_from_env("TREEWRIGHT_LOG").unwrap_or_else(|_| EnvFilter::new("error"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match run(&Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("treewright-render: {error}");
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
        Command::Play(arguments) => play::run(arguments),
        Command::Animate(arguments) => animate::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Rays(arguments) => rays::run(arguments),
        Command::LeaveOut(arguments) => leave_out::run(arguments),
        Command::Converge(arguments) => converge::run(arguments),
        Command::Ablate(arguments) => ablate::run(arguments),
        Command::Verify(arguments) => verify::run(arguments),
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

//! The program `treewright-render`: its command line and its exit codes.
//!
//! | module | holds |
//! |---|---|
//! | `commands` | one file for each command |
//! | `arguments`, `narrowing`, `server` | groups of arguments that several commands share, also those of `treewright-lab` |
//! | `scene_arguments`, `episode_arguments`, `names` | the parts of these groups |
//! | `output`, `error`, `interrupt` | tables and progress, exit codes, Ctrl-C |
//! | `manual` | manual pages and completions |
//! | `report` | the page that `tune --report` writes |
//! | `laboratory` | commands that the program `treewright-lab` carries out |

pub mod arguments;
mod commands;
mod episode_arguments;
pub mod error;
pub mod interrupt;
mod laboratory;
pub mod manual;
mod names;
pub mod narrowing;
pub mod output;
pub mod report;
mod scene_arguments;
pub mod server;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use tracing::level_filters::LevelFilter;
use tracing_subscriber::{
    Layer as _, filter::Targets, layer::SubscriberExt as _, util::SubscriberInitExt as _,
};
use treewright_accel::Isa;

pub use treewright_client::parse_arguments;

use commands::{bench, best, image, info, play, rays, rounds, sample, tune};
use error::{CliError, Result};
use manual::ManualCommand;

const EXAMPLES: &str = "\
Examples:
  treewright-render scenes
  treewright-render image --scene builtin:hall --spp 64 -o hall.png
  treewright-render image --scene sponza.glb --config quality=3,branching_factor=8 -o sponza.exr
  treewright-render tune --scene builtin:hall --iterations 80 --report hall.html
  treewright-render sample --scene builtin:hall --cameras 10 --samples 1000 --space paper
  treewright-render play --scene builtin:hall --frames 50 --compare
  treewright-render bench --scene builtin:city --rounds 15
  treewright-render converge --scene builtin:hall --json hall.json

The commands from leave-scene-out on are those of the program treewright-lab, which must lie in this program's folder.

Environment:
  TREEWRIGHT_ISA  widest instruction set to use: sse2, avx2 or avx512. Default: the processor's best
  TREEWRIGHT_LOG  what is written to standard error, for example info

Exit codes:
  0  done
  1  the operation failed
  2  wrong usage
  3  the daemon cannot be reached
  130  stopped by Ctrl-C";

/// A path tracer whose acceleration structure is tuned by a daemon while it renders.
#[derive(Debug, Parser)]
#[command(name = "treewright-render", version, after_help = EXAMPLES, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Render a picture.
    Image(image::Arguments),
    /// Show what a scene contains.
    Info(info::InfoArguments),
    /// List the built-in scenes.
    Scenes(info::ListArguments),
    /// Show the parameters that can be tuned.
    Spaces(info::SpacesArguments),
    /// Tune the acceleration structure for a scene.
    Tune(Box<tune::Arguments>),
    /// Run rounds that another process asks for on standard input.
    #[command(hide = true)]
    Rounds(Box<tune::Arguments>),
    /// Measure random configurations and record them as trials, for `treewright analyze`.
    Sample(Box<sample::Arguments>),
    /// Print the best known configuration for a scene and view, as JSON.
    Best(Box<best::Arguments>),
    /// Fly along the camera path, with a configuration from the daemon for each frame.
    Play(Box<play::Arguments>),
    /// Compare acceleration structures.
    Bench(bench::Arguments),
    /// Record the rays of a frame, for benchmarks of acceleration structures.
    Rays(rays::Arguments),
    #[command(flatten)]
    Manual(ManualCommand),
    /// Measure the service on scenes it has never seen.
    LeaveSceneOut(laboratory::Arguments),
    /// Compare error over time: which picture is good enough first, builds and tuning included.
    Converge(laboratory::Arguments),
    /// Repeat the paper's evaluation: record searches along camera paths, then judge predictors by the
    /// record.
    Evaluate(laboratory::Arguments),
    /// Write the results of an evaluation as one page, with figures and numbers.
    Report(laboratory::Arguments),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    carry_out("treewright-render", || run(&parse_arguments::<Cli>().command))
}

/// Carries out what the command line asks a program for. Warnings go to standard error as `TREEWRIGHT_LOG`
/// lets them. Freed memory is kept for the next tree. `TREEWRIGHT_ISA` names the widest instruction set.
pub fn carry_out(program: &str, run: impl FnOnce() -> Result<()>) -> ExitCode {
    end_with_the_reader();
    // Where the C library does not know how, builds are slower and nothing else changes.
    let _ = treewright_accel::keep_freed_memory();
    let filter = std::env::var("TREEWRIGHT_LOG").ok().filter(|text| !text.is_empty());
    let filter = filter.and_then(|text| text.parse::<Targets>().ok());
    let filter = filter.unwrap_or_else(|| Targets::new().with_default(LevelFilter::ERROR));
    let log = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    tracing_subscriber::registry().with(log.with_filter(filter)).init();
    match limit_instruction_set().and_then(|()| run()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{program}: {error}");
            error.exit_code()
        }
    }
}

/// The exit code that a shell reports for a program which the signal of a closed pipe (13) has ended.
const ENDED_WITH_ITS_READER: i32 = 128 + 13;

/// Ends the program quietly when the reader of its output has seen enough, like `head`.
fn end_with_the_reader() {
    let usual = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        let message = panic.payload().downcast_ref::<String>();
        if message.is_some_and(|message| message.starts_with("failed printing to stdout: Broken pipe")) {
            std::process::exit(ENDED_WITH_ITS_READER);
        }
        usual(panic);
    }));
}

/// Keeps to the instruction set that the environment names.
fn limit_instruction_set() -> Result<()> {
    let name = std::env::var("TREEWRIGHT_ISA").unwrap_or_default();
    if name.is_empty() {
        return Ok(());
    }
    let isa = Isa::ALL.into_iter().find(|isa| isa.name() == name).ok_or_else(|| {
        let known: Vec<&str> = Isa::ALL.into_iter().map(Isa::name).collect();
        CliError::Usage(format!("TREEWRIGHT_ISA is {name:?}; it is one of {}", known.join(", ")))
    })?;
    match isa.limit() {
        true => Ok(()),
        false => Err(CliError::Failed(format!(
            "TREEWRIGHT_ISA is {name}, for which this processor or this program has no kernels; `make build` compiles them all"
        ))),
    }
}

fn run(command: &Command) -> Result<()> {
    match command {
        Command::Image(arguments) => image::run(arguments),
        Command::Info(arguments) => info::info(arguments),
        Command::Scenes(arguments) => info::scenes(arguments),
        Command::Spaces(arguments) => info::spaces(arguments),
        Command::Tune(arguments) => tune::run(arguments),
        Command::Rounds(arguments) => rounds::run(arguments),
        Command::Sample(arguments) => sample::run(arguments),
        Command::Best(arguments) => best::run(arguments),
        Command::Play(arguments) => play::run(arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Rays(arguments) => rays::run(arguments),
        Command::Manual(command) => command.run(<Cli as clap::CommandFactory>::command()),
        Command::LeaveSceneOut(arguments) => laboratory::run("leave-scene-out", arguments),
        Command::Converge(arguments) => laboratory::run("converge", arguments),
        Command::Evaluate(arguments) => laboratory::run("evaluate", arguments),
        Command::Report(arguments) => laboratory::run("report", arguments),
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

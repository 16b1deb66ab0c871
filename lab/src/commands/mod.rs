//! The command line of `treewright-lab`. Exit codes are those of `treewright-render`.

mod converge;
mod converge_entrants;
mod converge_output;
mod evaluate;
mod evaluate_parameters;
mod evaluate_setup;
mod fleet;
mod leave_scene_out;
mod verify_answers;

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use treewright_render_cli::{carry_out, error::Result, manual::ManualCommand, output, parse_arguments};

const EXAMPLES: &str = "\
Examples:
  treewright-lab leave-scene-out --book scenes.json
  treewright-lab fleet --record fleet.jsonl
  treewright-lab evaluate record --record paper.jsonl --only gallery,voxels --cameras 20
  treewright-lab evaluate verify --record paper.jsonl --only gallery,voxels
  treewright-lab evaluate parameters --record paper.jsonl --only gallery --cameras 20
  treewright-lab report --record paper.jsonl --out evaluation
  treewright-lab converge --scene builtin:hall --json hall.json

Environment:
  TREEWRIGHT_ISA  widest instruction set to use: sse2, avx2 or avx512. Default: the processor's best
  TREEWRIGHT_LOG  what is written to standard error, for example info

Exit codes:
  0  done
  1  the operation failed
  2  wrong usage
  3  the daemon cannot be reached
  130  stopped by Ctrl-C";

/// Measurements behind Treewright's claims. `treewright-render` runs these commands through this program.
#[derive(Debug, Parser)]
#[command(name = "treewright-lab", version, after_help = EXAMPLES, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Measure the service on scenes it has never seen.
    LeaveSceneOut(leave_scene_out::Arguments),
    /// Measure what a machine gains from its own measurements, from its group's, and from the fleet's.
    #[command(long_about = fleet::LONG_ABOUT, after_help = fleet::EXAMPLES)]
    Fleet(Box<fleet::Arguments>),
    /// Compare error over time: which picture is good enough first, builds and tuning included.
    Converge(Box<converge::Arguments>),
    /// Repeat the paper's evaluation: record searches along camera paths, then judge predictors by the
    /// record.
    #[command(subcommand)]
    Evaluate(Box<evaluate::Command>),
    /// Write the results of an evaluation as one page, with figures and numbers.
    Report(verify_answers::ReportArguments),
    #[command(flatten)]
    Manual(ManualCommand),
}

/// Runs the program with the process's arguments.
pub fn main() -> ExitCode {
    carry_out("treewright-lab", || run(&parse_arguments::<Cli>().command))
}

fn run(command: &Command) -> Result<()> {
    match command {
        Command::LeaveSceneOut(arguments) => leave_scene_out::run(arguments),
        Command::Fleet(arguments) => fleet::run(arguments),
        Command::Converge(arguments) => converge::run(arguments),
        Command::Evaluate(command) => evaluate::run(command),
        Command::Report(arguments) => verify_answers::report(arguments),
        Command::Manual(command) => command.run(<Cli as clap::CommandFactory>::command()),
    }
}

/// A bar on standard error, hidden where standard output belongs to a program.
fn bar(is_hidden: bool, length: u64, unit: &'static str) -> indicatif::ProgressBar {
    if is_hidden { indicatif::ProgressBar::hidden() } else { output::bar(length, unit) }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_help_of_fleet_teaches_and_keeps_what_the_program_calls_itself_with() {
        let mut cli = Cli::command();
        let help = cli.render_long_help().to_string();
        assert!(help.contains("Examples:") && help.contains("Exit codes:"), "{help}");
        let fleet = cli.find_subcommand_mut("fleet").expect("it is a command");
        let help = fleet.render_long_help().to_string();
        assert!(help.contains("Each scene is then unseen once") && help.contains("--report fleet.jsonl"));
        assert!(!help.contains("--node"));
    }
}

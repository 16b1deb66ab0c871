//! `simulate`: worlds from seeds, one after the other, until there were enough steps or one has a violation.

use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use indicatif::{ProgressBar, ProgressStyle};
use treewright_simulation::{Bug, Counts, Plan, run};

/// Runs the real service in simulated worlds in which messages are lost, disks fail and machines crash, and
/// checks after every step that nothing acknowledged is lost, no trial is handed to two clients, budgets are
/// kept, every call is answered and the service comes back by itself.
///
/// Prints a JSON object. Exit code 1 when something was wrong: the seed is shown, and
/// `--seed SEED --worlds 1` runs that world again.
#[derive(Debug, Parser)]
struct Arguments {
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    seed: u64,

    /// Events in each world.
    #[arg(long, default_value_t = 20_000)]
    steps: u64,

    /// Number of worlds; each has the next seed.
    #[arg(long, default_value_t = 100)]
    worlds: u64,

    /// Go on for this number of minutes instead.
    #[arg(long)]
    minutes: Option<f64>,

    /// Plant a defect, to see it found.
    #[arg(long, value_enum)]
    plant: Option<Bug>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let begin = Instant::now();
    let bar = ProgressBar::new(arguments.worlds).with_style(
        ProgressStyle::with_template("{elapsed} {bar:30} {pos} worlds, {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let (mut steps, mut simulated_ms, mut worlds) = (0, 0, 0);
    let mut counts = Counts::default();
    let mut found = None;
    loop {
        let enough = match arguments.minutes {
            Some(minutes) => begin.elapsed().as_secs_f64() > 60.0 * minutes,
            None => worlds >= arguments.worlds,
        };
        if enough {
            break;
        }
        let outcome = run(Plan::of(arguments.seed + worlds, arguments.steps, arguments.plant));
        worlds += 1;
        steps += outcome.steps;
        simulated_ms += outcome.simulated_ms;
        counts.add(&outcome.counts);
        bar.set_position(worlds);
        bar.set_message(format!("{:.1} million steps", steps as f64 / 1e6));
        if !outcome.violations.is_empty() {
            found = Some(outcome);
            break;
        }
    }
    bar.finish_and_clear();
    let is_well = found.is_none();
    let report = serde_json::json!({
        "worlds": worlds,
        "steps": steps,
        "simulated_hours": simulated_ms as f64 / 3.6e6,
        "wall_s": begin.elapsed().as_secs_f64(),
        "counts": counts,
        "found": found,
    });
    println!("{report:#}");
    if is_well { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

//! `treewright-lab fleet`: a predictor for each node, for each group and for the fleet.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Args;
use serde::Serialize;
use treewright_render_cli::error::{CliError, Result, check_folder};
use treewright_render_cli::{arguments::Size, interrupt::Interrupt, output, server::machine};
use treewright_renderer::limits::{ROUNDS_MAX, THREADS_MAX};

use super::evaluate_setup::{SceneArguments, take_all};
use crate::converge::bootstrap::{Interval, in_words};
use crate::fleet::judge::{Row, rows};
use crate::fleet::machines::Machine;
use crate::fleet::measure::{Node, OWN_SEARCH};
use crate::fleet::record::{At, Conditions, Line, Record};
use crate::json_lines;
use crate::leave_scene_out::steps::Stage;
use crate::leave_scene_out::suite::Entry;

/// Built-in scenes: some ten to fifty thousand triangles each.
const BUILT_IN: [&str; 6] = [
    "hall=builtin:hall:0.1:7",
    "voxels=builtin:voxels:0.05:7",
    "gallery=builtin:gallery:0.15:7",
    "statue=builtin:statue:0.03:7",
    "city=builtin:city:0.06:7",
    "sea=builtin:sea:0.15:7",
];

/// Trials of a machine in each scene that its predictors will know.
const FRAMES: u32 = 24;
/// Trials in an unseen scene before the answer is frozen.
const FIRST_FRAMES: u32 = 8;
/// The environment's name for the instruction set that a process is kept to.
const ISA: &str = "TREEWRIGHT_ISA";

pub(super) const LONG_ABOUT: &str = "\
Measure what a machine gains from its own measurements, from its group's, and from the fleet's.

Machines are emulated on this one: each combination of --isa, --threads and --size is a machine, and runs in a
process of its own. Machines with one instruction set are a group.

1. Each machine searches each scene for 24 frames, by a daemon that knows nothing else.
2. Each scene is then unseen once. Of the other scenes a predictor knows nothing, what the machine measured
   itself (node), what its group measured, or what the whole fleet measured. It answers for the unseen scene
   before the first frame there, and once more, frozen, after eight frames.
3. These answers, the recommended configuration, native Embree's default, and what the machine's own search
   found in the scene are measured in interleaved rounds.

The table shows geometric means of speed-ups with intervals of 95 %, drawn by resampling scenes; more scenes
make them narrower. \"over less\" compares each predictor with the one that knows less: node with nothing,
group with node, fleet with group.

Ctrl-C stops; this command goes on from there. Four machines (--threads 2) took seven minutes on two
cores, and the default has eight. Needs treewrightd in the folder of this program.";

pub(super) const EXAMPLES: &str = "\
Examples:
  treewright-lab fleet --record fleet.jsonl
  treewright-lab fleet --record small.jsonl --only hall,sea --isa sse2,avx2,avx512 --threads 1
  treewright-lab fleet --record long.jsonl --rounds 31
  treewright-lab fleet --report fleet.jsonl --json";

#[derive(Args, Clone, Debug)]
pub(super) struct Arguments {
    /// File that keeps all measurements, as JSON Lines. A new run continues where the last one stopped.
    #[arg(long, value_name = "FILE.jsonl", required_unless_present = "report")]
    record: Option<PathBuf>,

    /// Measure nothing and print the table of this record.
    #[arg(long, value_name = "FILE.jsonl", conflicts_with = "record")]
    report: Option<PathBuf>,

    /// Print JSON.
    #[arg(long)]
    json: bool,

    /// Widest instruction sets of the machines, of those that this processor has.
    #[arg(long, value_name = "ISA,…", value_delimiter = ',', value_parser = ["sse2", "avx2", "avx512"], default_values = ["sse2", "avx2"])]
    isa: Vec<String>,

    /// Render threads of the machines.
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = clap::value_parser!(u64).range(1..=THREADS_MAX as u64), default_values = ["1", "2"])]
    threads: Vec<u64>,

    /// Sizes of the machines' pictures.
    #[arg(long, value_name = "WIDTHxHEIGHT,…", value_delimiter = ',', default_values = ["96x72", "256x192"])]
    size: Vec<Size>,

    #[command(flatten)]
    scenes: SceneArguments,

    /// How often each answer is measured.
    #[arg(long, value_name = "N", default_value_t = 11, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Be this machine of the fleet, and take this step: what the program calls itself with.
    #[arg(long, hide = true, num_args = 2, value_names = ["MACHINE", "STEP"], requires = "record")]
    node: Option<Vec<String>>,
}

#[derive(Debug, Serialize)]
struct FleetResults<'a> {
    conditions: &'a Conditions,
    /// Searches and examinations beside which the machine had other work.
    disturbed: usize,
    rows: Vec<Row>,
}

/// Takes the measurements that the record lacks, and prints the table.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let record = match (&arguments.record, &arguments.report) {
        (Some(path), _) => {
            check_folder(path)?;
            let entries = arguments.entries()?;
            let record = Record::open(path, &arguments.conditions(&entries))?;
            if let Some([name, step]) = arguments.node.as_deref() {
                return be_node(path, &record, &entries, name, step == SEARCH);
            }
            measure(&record)?;
            Record::read(path)?
        }
        (None, Some(path)) => Record::read(path)?,
        (None, None) => return Err(CliError::Usage("--record or --report is needed".to_owned())),
    };
    let searches = record.searches.iter().filter(|one| one.measured.disturbed).count();
    let disturbed = searches + record.answers.iter().filter(|one| one.measured.disturbed).count();
    let results = FleetResults { conditions: &record.conditions, disturbed, rows: rows(&record) };
    if arguments.json { output::json(&results) } else { print(&results) }
}

impl Arguments {
    fn entries(&self) -> Result<Vec<Entry>> {
        let entries = self.scenes.beside_named(&BUILT_IN)?;
        if entries.len() < 2 {
            return Err(CliError::Usage("one scene is unseen and others are known: name two".to_owned()));
        }
        Ok(entries)
    }

    fn conditions(&self, entries: &[Entry]) -> Conditions {
        let threads: Vec<usize> =
            self.threads.iter().map(|&threads| usize::try_from(threads).unwrap_or(THREADS_MAX)).collect();
        let mut processor = machine();
        // Of these each machine has its own.
        (processor.isa, processor.threads) = (String::new(), 0);
        Conditions {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            processor,
            machines: Machine::all(&self.isa, &threads, &self.size),
            scenes: entries.iter().map(ToString::to_string).collect(),
            frames: FRAMES,
            first_frames: FIRST_FRAMES,
            rounds: self.rounds,
        }
    }
}

const SEARCH: &str = "search";
const EXAMINE: &str = "examine";

/// Calls this program once for each machine and step: an instruction set is that of a process.
fn measure(record: &Record) -> Result<()> {
    let interrupt = Interrupt::listen();
    let machines = &record.conditions.machines;
    let failed = |error: std::io::Error| CliError::Failed(format!("this program does not start: {error}"));
    let program = std::env::current_exe().map_err(failed)?;
    let steps = [SEARCH, EXAMINE].into_iter();
    let steps: Vec<(&str, &Machine)> =
        steps.flat_map(|step| machines.iter().map(move |machine| (step, machine))).collect();
    take_all(steps, None, |(step, machine)| {
        let mut command = Command::new(&program);
        command.args(std::env::args_os().skip(1)).args(["--node", &machine.to_string(), step]);
        let ended = command.env(ISA, &machine.isa).status().map_err(failed)?;
        if interrupt.requested() {
            return Err(CliError::Interrupted);
        }
        if !ended.success() {
            return Err(CliError::Failed(format!("{step} on {machine} failed: {ended}")));
        }
        Ok(format!("{step} on {machine}"))
    })
}

/// One step of one machine in all scenes where it is missing.
fn be_node(path: &Path, record: &Record, entries: &[Entry], name: &str, is_search: bool) -> Result<()> {
    let conditions = &record.conditions;
    let machine = conditions.machines.iter().find(|machine| machine.to_string() == name);
    let machine = machine.ok_or_else(|| CliError::Usage(format!("no machine is called {name}")))?;
    let node = Node { machine, conditions };
    let interrupt = Interrupt::listen();
    for entry in entries {
        let scene = &entry.name;
        let is_done = if is_search {
            record.searches.iter().any(|one| one.is_of(machine, scene))
        } else {
            record.answers.iter().any(|one| one.is_of(machine, scene))
        };
        if is_done {
            continue;
        }
        eprintln!("  {} {scene}", if is_search { SEARCH } else { EXAMINE });
        let mut stage = Stage::new(scene, &entry.load()?, machine.context(), interrupt)?;
        let line = if is_search {
            Line::Search(At::of(machine, scene, node.search(&mut stage)?))
        } else {
            Line::Answers(At::of(machine, scene, node.examine(&mut stage, scene, record)?))
        };
        // A measurement that was stopped halfway is not kept.
        if interrupt.requested() {
            return Err(CliError::Interrupted);
        }
        json_lines::add(path, &line)?;
    }
    Ok(())
}

fn print(results: &FleetResults) -> Result<()> {
    let Conditions { processor, machines, scenes, frames, first_frames, rounds, .. } = results.conditions;
    println!(
        "{}: {} machines, {} scenes; searches of {frames} frames, answers after 0 and {first_frames} frames in \
         {rounds} rounds; {} measurements beside other work",
        processor.cpu_model,
        machines.len(),
        scenes.len(),
        results.disturbed
    );
    let text = |interval: Option<Interval>| in_words(interval, 3);
    for rows in results.rows.chunk_by(|a, b| a.group == b.group) {
        let group = rows.first().and_then(|row| row.group.as_ref());
        println!("\n{}", group.map_or_else(|| "all machines".to_owned(), |group| format!("group {group}")));
        let mut table = output::table(&[
            "predictor knows",
            "frames",
            "answers",
            "over recommended",
            "over native default",
            "over less",
            "over own search",
        ]);
        for row in rows {
            table.add_row([
                row.knows.map_or_else(|| OWN_SEARCH.to_string(), |level| format!("{level:?}").to_lowercase()),
                row.frames.to_string(),
                row.answers.to_string(),
                text(row.over_recommended),
                text(row.over_native),
                text(row.over_less),
                text(row.over_search),
            ]);
        }
        println!("{table}");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Alone {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn parsed(words: &str) -> Arguments {
        Alone::try_parse_from(words.split(' ')).expect("it is a command line").arguments
    }

    #[test]
    fn the_default_fleet_has_two_groups_and_all_scenes() {
        let arguments = parsed("fleet --record a.jsonl");
        let entries = arguments.entries().expect("built-in scenes");
        let conditions = arguments.conditions(&entries);
        assert_eq!((conditions.machines.len(), conditions.scenes.len()), (8, BUILT_IN.len()));
        assert_eq!(conditions.scenes[0], "hall=builtin:hall:0.1:7");
        assert!(parsed("fleet --record a.jsonl --only hall").entries().is_err(), "nothing would be known");
    }
}

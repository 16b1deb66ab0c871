//! `treewright-lab leave-scene-out`: the gain from the service on scenes that it has never seen.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use serde::Serialize;
use treewright_accel::Device;
use treewright_render_cli::arguments::objective;
use treewright_render_cli::error::{CliError, write_file};
use treewright_render_cli::interrupt::Interrupt;
use treewright_render_cli::output;
use treewright_render_cli::server::machine;
use treewright_renderer::limits::ROUNDS_MAX;
use treewright_renderer::statistics::Ratio;
use treewright_renderer::tuning::objective::Objective;

use super::evaluate_setup::SceneArguments;
use crate::leave_scene_out::book::{Book, OpenBook, RecordedRounds, SceneFacts};
use crate::leave_scene_out::judge::{self, ALONE, CANDIDATES, FINAL, LEFT_OUT, Overall, Row, key};
use crate::leave_scene_out::steps::{CHECKPOINTS, Stage};
use crate::leave_scene_out::suite::{Context, built_in};

/// Steps of the measurement, each of which needs those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
enum Step {
    /// A separate search on every scene.
    Alone,
    /// Hand-written configurations and the winner of each scene, side by side on every scene.
    Candidates,
    /// Searches by a service that knows all scenes except this one.
    LeftOut,
    /// Their answers against all others, in new rounds.
    Final,
}

impl Step {
    /// Under which it is in the book.
    fn kind(self) -> &'static str {
        match self {
            Self::Candidates => CANDIDATES,
            Self::Alone => ALONE,
            Self::LeftOut => LEFT_OUT,
            Self::Final => FINAL,
        }
    }
}

/// Arguments of `leave-scene-out`.
#[derive(Args, Clone, Debug)]
pub(super) struct Arguments {
    /// File that keeps all measurements, as JSON; the table is written next to it as .md. A new run continues
    /// where the last one stopped.
    #[arg(long, value_name = "FILE.json")]
    book: PathBuf,

    #[command(flatten)]
    scenes: SceneArguments,

    /// What to minimise.
    #[arg(long, value_parser = objective(), value_delimiter = ',', default_values = ["render", "total"])]
    objective: Vec<Objective>,

    /// Thread counts and picture sizes.
    #[arg(long, value_name = "THREADS@WIDTHxHEIGHT,…", value_delimiter = ',', default_value = "2@320x240")]
    context: Vec<Context>,

    /// Run only these steps.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [Step::Alone, Step::Candidates, Step::LeftOut, Step::Final])]
    steps: Vec<Step>,

    /// Trials per search.
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..=1000))]
    iterations: u32,

    /// Rounds of candidates.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Final rounds.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    final_rounds: u32,

    /// Start no step after this many seconds.
    #[arg(long, value_name = "S")]
    seconds: Option<u64>,

    /// Only write the table, from existing measurements.
    #[arg(long)]
    table_only: bool,
}

/// The results printed beside the book.
#[derive(Debug, Serialize)]
struct Judged {
    rows: Vec<Row>,
}

/// Takes the measurements that the book lacks, and writes the table.
pub(super) fn run(arguments: &Arguments) -> Result<(), CliError> {
    let threads = arguments.context.first().map_or(0, |context| context.threads);
    if arguments.context.iter().any(|context| context.threads != threads) {
        return Err(CliError::Usage(
            "a process has one number of render threads; measure other numbers by further runs with the same book"
                .to_owned(),
        ));
    }
    let (major, minor, patch) = Device::open(threads)?.version();
    let machine = machine()
        .software("treewright-lab", env!("CARGO_PKG_VERSION"))
        .software("embree", format!("{major}.{minor}.{patch}"));
    let mut open = OpenBook::open(&arguments.book, machine)?;
    if !arguments.table_only {
        measure(arguments, &mut open)?;
    }
    let rows = judge::rows(&open.book, &arguments.objective);
    let text = table(&open.book, &rows, &arguments.objective);
    print!("{text}");
    write_file(&arguments.book.with_extension("md"), text.as_bytes())?;
    write_file(&arguments.book.with_extension("judged.json"), output::to_json(&Judged { rows })?.as_bytes())
}

fn measure(arguments: &Arguments, open: &mut OpenBook) -> Result<(), CliError> {
    let entries = arguments.scenes.beside(built_in())?;
    let interrupt = Interrupt::listen();
    let begin = Instant::now();
    let limit = arguments.seconds.map(Duration::from_secs);
    for context in &arguments.context {
        for step in &arguments.steps {
            for entry in &entries {
                if !is_missing(arguments, &open.book, *step, &entry.name, *context) {
                    continue;
                }
                if limit.is_some_and(|limit| begin.elapsed() >= limit) {
                    eprintln!("the time is up; the same command goes on from here");
                    return Ok(());
                }
                let scene = entry.load()?;
                let facts =
                    SceneFacts { triangles: scene.placed().count(), instanced: scene.instances.is_some() };
                open.book.scenes.insert(entry.name.clone(), facts);
                let mut stage = Stage::new(&entry.name, &scene, *context, interrupt)?;
                take(arguments, open, &mut stage, *step, &entry.name, *context)?;
                if interrupt.requested() {
                    return Err(CliError::Interrupted);
                }
                open.save()?;
                eprintln!("{step:?} {} {context}: {:.0} s so far", entry.name, begin.elapsed().as_secs_f64());
            }
        }
    }
    Ok(())
}

/// Whether a step has not been taken yet for a scene.
fn is_missing(arguments: &Arguments, book: &Book, step: Step, scene: &str, context: Context) -> bool {
    let context = context.to_string();
    arguments
        .objective
        .iter()
        .any(|objective| !is_taken(book, step, &key(step.kind(), *objective, scene, &context)))
}

fn is_taken(book: &Book, step: Step, name: &str) -> bool {
    match step {
        Step::Alone | Step::LeftOut => book.searches.contains_key(name),
        Step::Candidates | Step::Final => book.rounds.contains_key(name),
    }
}

fn take(
    arguments: &Arguments,
    open: &mut OpenBook,
    stage: &mut Stage,
    step: Step,
    scene: &str,
    context: Context,
) -> Result<(), CliError> {
    let context = context.to_string();
    for objective in &arguments.objective {
        let name = key(step.kind(), *objective, scene, &context);
        if is_taken(&open.book, step, &name) {
            continue;
        }
        match step {
            Step::Candidates => {
                let rounds = stage.candidates(&open.book, *objective, arguments.rounds)?;
                keep(open, stage, name, rounds);
            }
            Step::Alone | Step::LeftOut => {
                let others = step == Step::LeftOut;
                let found = stage.search(&open.book, *objective, arguments.iterations, others)?;
                open.book.searches.insert(name, found);
            }
            Step::Final => match stage.finals(&open.book, *objective, arguments.final_rounds)? {
                Some(rounds) => keep(open, stage, name, rounds),
                None => eprintln!("{scene}: the steps before the final one are missing"),
            },
        }
    }
    Ok(())
}

/// Rounds that were stopped halfway are not kept.
fn keep(open: &mut OpenBook, stage: &Stage, name: String, rounds: RecordedRounds) {
    if !stage.interrupt.requested() {
        open.book.rounds.insert(name, rounds);
    }
}

/// The tables, as Markdown.
fn table(book: &Book, rows: &[Row], objectives: &[Objective]) -> String {
    let mut text = String::new();
    let software: Vec<String> =
        book.machine.software.iter().map(|(name, version)| format!("{name} {version}")).collect();
    let _ = writeln!(
        text,
        "Machine: {}, {}; {}.\n",
        book.machine.cpu_model,
        book.machine.isa,
        software.join(", ")
    );
    for objective in objectives {
        let own: Vec<&Row> = rows.iter().filter(|row| row.objective == *objective).collect();
        if own.is_empty() {
            continue;
        }
        let _ = writeln!(text, "## {} time\n", objective.name());
        let frames: Vec<u32> = std::iter::once(0).chain(CHECKPOINTS).collect();
        let columns: Vec<String> = frames.iter().map(|frames| format!("after {frames}")).collect();
        let _ = writeln!(
            text,
            "Speed of the service's answer over the best fixed configuration of the other scenes; in brackets with 60 frames \
             the interval of 95 %.\n\n| scene | context | triangles | {} | over native used well | of the roofline | fixed over native used well |\n|{}",
            columns.join(" | "),
            "---|".repeat(columns.len() + 6),
        );
        for row in &own {
            let triangles = book.scenes.get(&row.scene).map_or(0, |facts| facts.triangles);
            let cells: Vec<String> = frames
                .iter()
                .map(|frames| match row.over_fixed.get(frames) {
                    Some(ratio) if *frames == 60 => ratio.to_string(),
                    Some(ratio) => format!("{:.2}", ratio.median),
                    None => "–".to_owned(),
                })
                .collect();
            let last = row.over_used_well.values().next_back().map_or(0.0, |ratio| ratio.median);
            let roof = row.of_roofline.values().next_back().copied().unwrap_or(0.0);
            let _ = writeln!(
                text,
                "| {}{} | {} | {triangles} | {} | {last:.2} | {roof:.2} | {:.2} |",
                row.scene,
                if row.disturbed { " (disturbed)" } else { "" },
                row.context,
                cells.join(" | "),
                row.fixed_over_used_well.median,
            );
        }
        let _ = writeln!(
            text,
            "\n| | context | native default, ms | native used well, ms | best fixed of the other scenes, ms | tuned, ms | over native default | over native used well | over best fixed |\n|{}",
            "---|".repeat(9),
        );
        for row in &own {
            let [native, used_well, fixed, last] = row.frame_ms;
            let over = |ratios: &std::collections::BTreeMap<u32, Ratio>| {
                ratios.values().next_back().map_or_else(String::new, Ratio::to_string)
            };
            let _ = writeln!(
                text,
                "| {} | {} | {native:.1} | {used_well:.1} ({}) | {fixed:.1} | {last:.1} | {} | {} | {} |",
                row.scene,
                row.context,
                row.native_quality,
                row.over_default,
                over(&row.over_used_well),
                over(&row.over_fixed),
            );
        }
        let _ = writeln!(
            text,
            "\n| over all {} | median | least | geometric mean |\n|---|---|---|---|",
            own.len()
        );
        let mut line = |name: String, overall: Overall| {
            let Overall { median, least, mean, .. } = overall;
            let _ = writeln!(text, "| {name} | {median:.3} | {least:.3} | {mean:.3} |");
        };
        for frames in &frames {
            let ratios = own.iter().filter_map(|row| row.over_fixed.get(frames)).map(|ratio| ratio.median);
            line(format!("after {frames} frames over the best fixed of the others"), Overall::of(ratios));
        }
        for frames in &frames {
            let ratios =
                own.iter().filter_map(|row| row.over_used_well.get(frames)).map(|ratio| ratio.median);
            line(format!("after {frames} frames over native used well"), Overall::of(ratios));
        }
        for frames in &frames {
            let shares = own.iter().filter_map(|row| row.of_roofline.get(frames)).copied();
            line(format!("after {frames} frames, share of the roofline's speed"), Overall::of(shares));
        }
        line(
            "best fixed of the others over native default".to_owned(),
            Overall::of(own.iter().map(|row| row.fixed_over_default.median)),
        );
        line(
            "best fixed of the others over native used well".to_owned(),
            Overall::of(own.iter().map(|row| row.fixed_over_used_well.median)),
        );
        text.push('\n');
    }
    for objective in objectives {
        text.push_str(&fixed_table(book, *objective));
    }
    text
}

/// The candidates for the best fixed configuration over all scenes of the first context.
fn fixed_table(book: &Book, objective: Objective) -> String {
    let mut text = String::new();
    let contexts: std::collections::BTreeSet<&str> = book
        .rounds
        .keys()
        .filter(|name| name.starts_with(CANDIDATES))
        .filter_map(|name| name.rsplit(' ').next())
        .collect();
    for context in contexts {
        for (class, instanced) in [("flat", false), ("instanced", true)] {
            let scenes: Vec<_> = book
                .scenes
                .iter()
                .filter(|(_, facts)| facts.instanced == instanced)
                .filter_map(|(scene, _)| {
                    let rounds = book.rounds.get(&key(CANDIDATES, objective, scene, context))?;
                    Some(judge::relative_costs(rounds, objective.frames_per_build()))
                })
                .collect();
            let all = judge::fixed(&scenes, &std::collections::BTreeSet::new());
            if all.is_empty() {
                continue;
            }
            let _ = writeln!(
                text,
                "Fixed configurations, {} time, {} {class} scenes, {context}: speed over native default, geometric mean and least.\n\n| | mean | least |\n|---|---|---|",
                objective.name(),
                scenes.len(),
            );
            for one in all.iter().take(12) {
                let _ = writeln!(
                    text,
                    "| `{}` | {:.3} | {:.3} |",
                    one.configuration,
                    1.0 / one.mean_cost,
                    1.0 / one.worst
                );
            }
            text.push('\n');
        }
    }
    text
}

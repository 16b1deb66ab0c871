//! `treewright-lab leave-scene-out`: the gain from the service on scenes that it has never seen.

use std::{path::PathBuf, time::Instant};

use clap::Args;
use serde::Serialize;
use treewright_client::Configuration;
use treewright_render_cli::error::{CliError, Result, write_file};
use treewright_render_cli::{interrupt::Interrupt, output, server::machine};
use treewright_renderer::statistics::{Ratio, Summary};
use treewright_renderer::tuning::safety::{DEAR_ABOVE, Safety};
use treewright_renderer::{limits::ROUNDS_MAX, tuning::objective::Objective, tuning::who::NATIVE_DEFAULT};

use super::evaluate_setup::{SceneArguments, with_versions};
use crate::leave_scene_out::book::{Book, OpenBook, RecordedRounds, SceneFacts};
use crate::leave_scene_out::judge::{self, ALONE, CANDIDATES, FINAL, LEFT_OUT, Overall, Row, key};
use crate::leave_scene_out::steps::{CHECKPOINTS, Stage, first_answer};
use crate::leave_scene_out::suite::{Context, built_in};

const ITERATIONS: u32 = 60;

/// Steps of the measurement, each of which needs those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    const ALL: [Self; 4] = [Self::Alone, Self::Candidates, Self::LeftOut, Self::Final];

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
    /// File that keeps all measurements, as JSON; what they come to is written next to it, as .judged.json. A
    /// new run continues where the last one stopped.
    #[arg(long, value_name = "FILE.json")]
    book: PathBuf,

    #[command(flatten)]
    scenes: SceneArguments,

    /// Number of render threads and size of pictures. Further runs with that book measure others.
    #[arg(long, value_name = "THREADS@WIDTHxHEIGHT", default_value = "2@320x240")]
    context: Context,

    /// Only this objective. Default: both.
    #[arg(long, value_parser = Objective::ALL.map(Objective::name))]
    objective: Option<String>,

    /// Rounds of candidates.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Final rounds.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    final_rounds: u32,

    /// Measures nothing: asks the service for its first answer to every recorded scene, taught by the others
    /// of the book, and prints what that ran at beside the candidates.
    #[arg(long)]
    first_answers: bool,
}

#[derive(Debug, Serialize)]
struct Judged {
    rows: Vec<Row>,
}

/// Takes the measurements that the book lacks, and judges all.
pub(super) fn run(arguments: &Arguments) -> Result<()> {
    let machine = with_versions(machine(), arguments.context.threads)?;
    let mut open = OpenBook::open(&arguments.book, machine)?;
    if arguments.first_answers {
        return first_answers(&open.book, arguments.context);
    }
    measure(arguments, &mut open)?;
    let rows = judge::rows(&open.book, &Objective::ALL);
    print(&rows);
    write_file(&arguments.book.with_extension("judged.json"), output::to_json(&Judged { rows })?.as_bytes())
}

fn measure(arguments: &Arguments, open: &mut OpenBook) -> Result<()> {
    let entries = arguments.scenes.beside(built_in())?;
    let interrupt = Interrupt::listen();
    let begin = Instant::now();
    let context = arguments.context;
    for step in Step::ALL {
        for entry in &entries {
            let name = |objective| key(step.kind(), objective, &entry.name, &context.to_string());
            let is_wanted =
                |one: &Objective| arguments.objective.as_ref().is_none_or(|name| name == one.name());
            let is_missing = |one: &Objective| is_wanted(one) && !is_taken(&open.book, step, &name(*one));
            let missing: Vec<Objective> = Objective::ALL.into_iter().filter(is_missing).collect();
            if missing.is_empty() {
                continue;
            }
            let scene = entry.load()?;
            let facts =
                SceneFacts { triangles: scene.placed().count(), instanced: scene.instances.is_some() };
            open.book.scenes.insert(entry.name.clone(), facts);
            let mut stage = Stage::new(&entry.name, &scene, context, interrupt)?;
            for objective in missing {
                take(arguments, open, &mut stage, step, objective, name(objective))?;
            }
            if interrupt.requested() {
                return Err(CliError::Interrupted);
            }
            open.save()?;
            eprintln!("{step:?} {} {context}: {:.0} s so far", entry.name, begin.elapsed().as_secs_f64());
        }
    }
    Ok(())
}

/// Prints what the service answers now where it has measured nothing, by the recorded rounds of candidates.
fn first_answers(book: &Book, context: Context) -> Result<()> {
    let mut table =
        output::table(&["objective", "scene", "over best fixed", "over used well", "answer", "reason"]);
    for objective in Objective::ALL {
        for scene in book.scenes.keys() {
            let name = |kind| key(kind, objective, scene, &context.to_string());
            let Some(rounds) = book.rounds.get(&name(CANDIDATES)) else { continue };
            let Some(answer) = first_answer(book, objective, scene, context)? else { continue };
            let costs = judge::relative_costs(rounds, objective.frames_per_build());
            let cost = |configuration: &Configuration| costs.get(configuration).copied();
            let own = cost(&answer.configuration);
            let fixed = judge::fixed_of_others(book, objective, scene, &context.to_string());
            let fixed = fixed.and_then(|fixed| cost(&fixed));
            let used_well = judge::used_well(rounds, objective.frames_per_build());
            let native = rounds.find(&NATIVE_DEFAULT).map(|one| one.frame_ms(objective.frames_per_build()));
            let pair = used_well.zip(native);
            let used_well = pair.map(|((_, well_ms), native_ms)| Ratio::of(&well_ms, &native_ms).median);
            let over = |other: Option<f64>| match (own, other) {
                (Some(own), Some(other)) => format!("{:.3}", other / own),
                _ => "not measured".to_owned(),
            };
            table.add_row([
                objective.name().to_owned(),
                scene.clone(),
                over(fixed),
                over(used_well),
                answer.configuration.to_string(),
                answer.reason.summary,
            ]);
        }
    }
    println!("{table}");
    Ok(())
}

fn is_taken(book: &Book, step: Step, name: &str) -> bool {
    match step {
        Step::Alone | Step::LeftOut => book.searches.contains_key(name),
        Step::Candidates | Step::Final => book.rounds.contains_key(name),
    }
}

/// Takes a step for an objective; `name` is what the book calls it.
fn take(
    arguments: &Arguments,
    open: &mut OpenBook,
    stage: &mut Stage,
    step: Step,
    objective: Objective,
    name: String,
) -> Result<()> {
    match step {
        Step::Candidates => {
            let rounds = stage.candidates(&open.book, objective, arguments.rounds)?;
            keep(open, stage, name, rounds);
        }
        Step::Alone | Step::LeftOut => {
            let others = step == Step::LeftOut;
            let found = stage.search(&open.book, objective, ITERATIONS, others)?;
            open.book.searches.insert(name, found);
        }
        Step::Final => match stage.finals(&open.book, objective, arguments.final_rounds)? {
            Some(rounds) => keep(open, stage, name, rounds),
            None => eprintln!("{name}: the steps before the final one are missing"),
        },
    }
    Ok(())
}

/// Rounds that were stopped halfway are not kept.
fn keep(open: &mut OpenBook, stage: &Stage, name: String, rounds: RecordedRounds) {
    if !stage.interrupt.requested() {
        open.book.rounds.insert(name, rounds);
    }
}

fn print(rows: &[Row]) {
    for objective in Objective::ALL {
        let own: Vec<&Row> = rows.iter().filter(|row| row.objective == objective).collect();
        if own.is_empty() {
            continue;
        }
        println!("{} time, {} scenes", objective.name(), own.len());
        let mut table = output::table(&["speed of the answer", "median", "least", "geometric mean"]);
        let mut line = |name: String, values: Vec<f64>| {
            let Overall { median, least, mean } = Overall::of(values.into_iter());
            table.add_row([name, format!("{median:.3}"), format!("{least:.3}"), format!("{mean:.3}")]);
        };
        for frames in std::iter::once(0).chain(CHECKPOINTS) {
            let after = |what: &str| format!("after {frames} frames over {what}");
            let over_fixed = own.iter().filter_map(|row| Some(row.over_fixed.get(&frames)?.median));
            line(after("the best fixed of the others"), over_fixed.collect());
            let over_used_well = own.iter().filter_map(|row| Some(row.over_used_well.get(&frames)?.median));
            line(after("native used well"), over_used_well.collect());
            let of_roofline = own.iter().filter_map(|row| row.of_roofline.get(&frames).copied());
            line(after("the fastest that ran"), of_roofline.collect());
        }
        let ceilings = own.iter().filter_map(|row| row.ceiling());
        line("the fastest that ran over the best fixed of the others".to_owned(), ceilings.collect());
        println!("{table}");
        if let Some(words) = dear_frames(&own) {
            println!("{words}");
        }
    }
}

/// Which frames of the searches cost more than the recommended start, over all scenes.
fn dear_frames(rows: &[&Row]) -> Option<String> {
    let all: Vec<Safety> = rows.iter().filter_map(|row| row.safety).collect();
    let most = |of: fn(&Safety) -> f64| all.iter().map(of).fold(0.0, f64::max);
    let shares: Vec<f64> = all.iter().map(Safety::share).collect();
    (!all.is_empty()).then(|| {
        format!(
            "frames of a search above {DEAR_ABOVE} times the recommended start: {:.0} % (median of the scenes), {:.0} % at \
             most; the dearest {:.2} times",
            100.0 * Summary::of(&shares).median,
            100.0 * most(Safety::share),
            most(|safety| safety.worst),
        )
    })
}

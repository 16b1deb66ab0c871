//! `treewright-render bench`: named ways to render, measured interleaved.
//!
//! In every round all contenders build and render, so that one run serves both objectives: with a whole build
//! in each frame, and with a thousandth of one.

use std::path::PathBuf;

use clap::Args;
use comfy_table::Table;
use serde::Serialize;
use treewright_client::Configuration;

use crate::arguments::{NamedConfiguration, SpaceArguments, ViewArguments, note_retired, read_configuration};
use crate::error::{CliError, Result, write_file};
use crate::{interrupt::Interrupt, output};
use treewright_renderer::disturbance::{Disturbance, Watch};
use treewright_renderer::limits::{CONTENDERS_MAX, ROUNDS_MAX};
use treewright_renderer::measure::{
    Conditions, Contender, Measured, Standing, Yardstick, delay_note, interleaved, standings,
};
use treewright_renderer::space::{self, Choice, Premises, Preset, TuningSpace};
use treewright_renderer::tuning::verdict::{contender, keep_best_native, natives, used_well};
use treewright_renderer::{
    frame::FrameTimes, statistics::Summary, tuning::objective::Objective, tuning::who::Who,
};
use treewright_scene::Scene;

#[derive(Args, Clone, Debug)]
pub(crate) struct Arguments {
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    space: SpaceArguments,

    /// Another configuration, as for `image`; can be repeated.
    #[arg(long, value_name = "NAME=VALUE,…")]
    config: Vec<String>,

    /// Another configuration from a JSON file, with its name and space, e.g. `tuned=full:best.json`; can be
    /// repeated.
    #[arg(long, value_name = "NAME=SPACE:FILE")]
    contender: Vec<NamedConfiguration>,

    /// Measure only these, e.g. "native Embree default,native used well,tuned". Native used well counts the
    /// default only where that runs, too. Default: all.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,

    /// Number of measurements of each.
    #[arg(long, value_name = "N", default_value_t = 21, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
struct BenchResults<'a> {
    scene: &'a str,
    triangles: usize,
    size: [u32; 2],
    threads: usize,
    /// Those that were run: fewer than asked for where it was interrupted.
    rounds: usize,
    disturbance: Disturbance,
    choices: Vec<NamedChoice<'a>>,
    builds: Vec<Builds<'a>>,
    /// With a thousandth of a build in each frame.
    render: Vec<Standing>,
    /// With a whole one.
    total: Vec<Standing>,
}

#[derive(Debug, Serialize)]
struct NamedChoice<'a> {
    name: &'a Who,
    choice: Choice,
}

/// The builds of a contender: medians over the rounds.
#[derive(Debug, PartialEq, Serialize)]
struct Builds<'a> {
    name: &'a Who,
    /// By the clock on the wall.
    build_ms: f64,
    /// Processor time of all threads together.
    build_cpu_ms: f64,
    /// Share of the render threads' time, 0 to 1, in which they neither ran nor waited for a processor. A
    /// thread that spins while it waits for another one runs.
    idle_share: f64,
}

impl<'a> Builds<'a> {
    /// `None` where no build was measured.
    fn of(one: &'a Measured, threads: usize) -> Option<Self> {
        let median = |of: &dyn Fn(&FrameTimes) -> Option<f64>| {
            let values: Vec<f64> = one.frames.iter().filter_map(of).collect();
            (!values.is_empty()).then(|| Summary::of(&values).median)
        };
        let idle_share = |times: &FrameTimes| {
            // Threads that do not render are counted as well, and may add a little.
            Some((1.0 - times.build_cpu_ms? / (threads as f64 * times.undelayed().build_ms)).max(0.0))
        };
        Some(Self {
            name: &one.who,
            build_ms: median(&|times| Some(times.build_ms))?,
            build_cpu_ms: median(&|times| times.build_cpu_ms)?,
            idle_share: median(&idle_share)?,
        })
    }
}

fn own(name: &str, space: &TuningSpace, configuration: &Configuration) -> Result<Contender> {
    let own = contender(Who::Named(name.to_owned().into()), space, configuration)?;
    note_retired(space, configuration);
    Ok(own)
}

/// Everybody who takes part: native Embree, the best fixed configurations, and those of the user's.
fn contenders(arguments: &Arguments, scene: &Scene) -> Result<Vec<Contender>> {
    let premises = |each_frame| Premises {
        builds_each_frame: each_frame,
        ..arguments.space.premises(scene, Objective::Render)
    };
    let mut contenders = natives().to_vec();
    contenders.extend(
        used_well(&TuningSpace::new(Preset::Full, &premises(false))).into_iter().map(|rival| rival.contender),
    );
    for objective in OBJECTIVES {
        let full = TuningSpace::new(Preset::Full, &premises(objective.builds_each_frame()));
        contenders.push(Contender { who: Who::BestFixedFor(objective), choice: full.default_choice() });
    }
    let space = arguments.space.whole(Objective::Render)?;
    for text in &arguments.config {
        contenders.push(own(text, &space, &space::parse(text)?)?);
    }
    for NamedConfiguration { name, preset, path } in &arguments.contender {
        let space = TuningSpace::new(*preset, &premises(false));
        contenders.push(own(name, &space, &read_configuration(path)?)?);
    }
    select(&mut contenders, &arguments.only)?;
    Ok(contenders)
}

pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let scene = arguments.view.scene.load()?;
    let contenders = contenders(arguments, &scene)?;
    let camera = arguments.view.camera.find(&scene)?;
    let mut renderer = arguments.view.frame.renderer(&scene)?;
    let conditions = Conditions {
        view: arguments.view.frame.view(camera),
        size: arguments.view.size.0,
        rounds: arguments.rounds,
        frames_per_build: 1,
        yardstick: Yardstick::Frame,
    };
    let interrupt = Interrupt::listen();
    let watch = Watch::begin();
    let bar = output::bar(u64::from(arguments.rounds) + 1, "rounds");
    let measured = interleaved(&mut renderer, &contenders, &conditions, || {
        bar.inc(1);
        !interrupt.requested()
    });
    bar.finish_and_clear();
    let rank = |objective| ranked(&measured, objective);
    let (render, total) = (rank(Objective::Render), rank(Objective::Total));
    println!(
        "{}: {} triangles, {}, {} threads, {} rounds\n",
        scene.name,
        scene.triangles.len(),
        arguments.view.size,
        renderer.threads(),
        rounds(&measured),
    );
    println!("A frame with a thousandth of its build:\n{}\n", output::standings(&render, "frame ms"));
    println!("A frame with a whole build:\n{}\n", output::standings(&total, "build + render ms"));
    let builds: Vec<Builds<'_>> =
        measured.iter().filter_map(|one| Builds::of(one, renderer.threads())).collect();
    println!("Builds:\n{}", builds_table(&builds));
    let disturbance =
        watch.end(renderer.threads(), &total.first().map_or_else(Vec::new, |one| one.rounds_ms.clone()));
    for note in disturbance.description().into_iter().chain(delay_note(&total)) {
        println!("note: {note}");
    }
    if let Some(path) = &arguments.json {
        let choices = contenders.iter().map(|one| NamedChoice { name: &one.who, choice: one.choice });
        let results = BenchResults {
            scene: &scene.name,
            triangles: scene.triangles.len(),
            size: arguments.view.size.0,
            threads: renderer.threads(),
            rounds: rounds(&measured),
            disturbance,
            choices: choices.collect(),
            builds,
            render,
            total,
        };
        write_file(path, output::to_json(&results)?.as_bytes())?;
    }
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

fn builds_table(builds: &[Builds<'_>]) -> Table {
    let mut table = output::table(&["structure", "build ms", "processor ms", "threads idle"]);
    for one in builds {
        table.add_row([
            one.name.to_string(),
            format!("{:.1}", one.build_ms),
            format!("{:.1}", one.build_cpu_ms),
            format!("{:.0} %", 1e2 * one.idle_share),
        ]);
    }
    table
}

/// The objectives for which frames of one run of rounds are shown.
const OBJECTIVES: [Objective; 2] = [Objective::Render, Objective::Total];

/// The standings for an objective, with the best native use and its own best fixed configuration.
fn ranked(measured: &[Measured], objective: Objective) -> Vec<Standing> {
    let mut standings = keep_best_native(standings(measured, objective.frames_per_build()));
    for one in &mut standings {
        if one.who == Who::BestFixedFor(objective) {
            one.who = Who::BestFixed;
        }
    }
    standings
}

/// Keeps those that are asked for, in the order in which they stand.
fn select(contenders: &mut Vec<Contender>, only: &[String]) -> Result<()> {
    // Of native used well there are several ways, of the best fixed one several objectives.
    let is_meant = |one: &Contender, name: &str| {
        one.who.to_string().strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with(' '))
    };
    if let Some(unknown) = only.iter().find(|name| !contenders.iter().any(|one| is_meant(one, name))) {
        let known: Vec<String> = contenders.iter().map(|one| one.who.to_string()).collect();
        return Err(CliError::Usage(format!(
            "nobody is called \"{unknown}\"; there are {}",
            known.join(", ")
        )));
    }
    if !only.is_empty() {
        contenders.retain(|one| only.iter().any(|name| is_meant(one, name)));
    }
    if contenders.len() > CONTENDERS_MAX {
        return Err(CliError::Usage(format!(
            "{} structures are more than the limit of {CONTENDERS_MAX}",
            contenders.len()
        )));
    }
    Ok(())
}

fn rounds(measured: &[Measured]) -> usize {
    measured.iter().filter(|one| one.failure.is_none()).map(|one| one.frames.len()).min().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_idle_where_they_neither_run_nor_wait() {
        let build = |build_cpu_ms, build_delay_ms| FrameTimes {
            build_cpu_ms: Some(build_cpu_ms),
            build_delay_ms: Some(build_delay_ms),
            ..FrameTimes::of(10.0, 1.0)
        };
        let idle_share = |times| {
            let one = Measured { frames: vec![times], ..Measured::default() };
            Builds::of(&one, 2).expect("it was built").idle_share
        };
        assert_eq!(idle_share(build(20.0, 0.0)), 0.0, "both threads ran all the time");
        assert_eq!(idle_share(build(20.5, 0.0)), 0.0, "so did a third one, for a moment");
        assert_eq!(idle_share(build(10.0, 0.0)), 0.5, "one of them did");
        assert_eq!(idle_share(build(10.0, 10.0)), 0.0, "both had work, and one place");
        assert_eq!(Builds::of(&Measured::default(), 2), None);
    }
}

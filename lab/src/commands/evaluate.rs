//! `treewright-lab evaluate`: the paper's section 7, with recording and judging as separate commands.

use std::sync::Arc;

use clap::{Args, Subcommand};
use treewright_render_cli::{error::CliError, error::Result, interrupt::Interrupt};
use treewright_renderer::{limits::ROUNDS_MAX, tuning::objective::Objective};

use super::evaluate_parameters as parameters;
use super::evaluate_parameters::ParametersArguments;
use super::evaluate_setup::{ConditionArguments, add_found, space, take_all};
use super::verify_answers as verify;
use super::verify_answers::VerifyArguments;
use crate::evaluation::fixed;
use crate::evaluation::measure::{Stage, spread};
use crate::evaluation::record::{GroupKind, Line, METHOD, Place};

/// The command.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Render: run searches at every camera, and measure fixed configurations.
    Record(RecordArguments),
    /// Render: measure the predictors' answers next to the searches' results.
    Verify(VerifyArguments),
    /// Render: what the parameters do (the paper's section 4): a few searched alone, splitting by frame size,
    /// and a cylinder of needles that turns through each scene.
    Parameters(ParametersArguments),
}

#[derive(Args, Clone, Debug)]
pub(super) struct RecordArguments {
    #[command(flatten)]
    under: ConditionArguments,

    /// Record only this many cameras, spread over the path; the others can follow later. Default: all.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    first: Option<u32>,

    /// Rounds for measuring fixed configurations.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,
}

pub(super) fn run(command: &Command) -> Result<()> {
    match command {
        Command::Record(arguments) => record(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Parameters(arguments) => parameters::run(arguments),
    }
}

/// Work that is missing: which scene, which camera, and what.
struct Missing {
    stage: usize,
    camera: u32,
    /// A search, or the fixed configurations.
    search: Option<Objective>,
}

fn record(arguments: &RecordArguments) -> Result<()> {
    let under = &arguments.under;
    let entries = under.scenes.entries()?;
    let (conditions, mut open) = under.open()?;
    let space = Arc::new(space(&conditions));
    let mut missing = Vec::new();
    // Camera by camera over all scenes: whenever a run stops, all scenes are equally far.
    let places: Vec<u32> =
        spread(under.cameras).into_iter().take(arguments.first.unwrap_or(u32::MAX) as usize).collect();
    for camera in &places {
        // The best of each search is measured again beside the fixed ones.
        for search in Objective::ALL.map(Some).into_iter().chain([None]) {
            missing.extend((0..entries.len()).map(|stage| Missing { stage, camera: *camera, search }));
        }
    }
    missing.retain(|one| {
        let place = Place { scene: entries[one.stage].name.clone(), camera: one.camera };
        match one.search {
            Some(objective) => !open.record.has_search(objective, &place),
            None => !open.record.groups.contains_key(&(GroupKind::Fixed, place)),
        }
    });
    eprintln!("{} measurements are missing in {}", missing.len(), under.record.display());
    let interrupt = Interrupt::listen();
    let mut stages: Vec<Option<Stage>> = entries.iter().map(|_| None).collect();
    let fixed = fixed::candidates(&space)?;
    take_all(missing, under.seconds, |one| {
        let entry = &entries[one.stage];
        let stage = match &mut stages[one.stage] {
            Some(stage) => stage,
            empty => empty.insert(Stage::new(&entry.name, &entry.load()?, &space, &open.record)?),
        };
        let go_on = || !interrupt.requested();
        let (line, what) = match one.search {
            Some(objective) => {
                let search = stage.search(one.camera, objective, go_on)?;
                (search.map(Line::Search), format!("{} for {} time", METHOD.name(), objective.name()))
            }
            None => {
                let mut all = fixed.clone();
                add_found(&open.record, &stage.place(one.camera), &[], &mut all);
                let group = stage.group(GroupKind::Fixed, one.camera, &all, arguments.rounds, go_on);
                (group.map(Line::Group), "fixed configurations".to_owned())
            }
        };
        open.add(line.ok_or(CliError::Interrupted)?)?;
        Ok(format!("{} camera {}: {what}", entry.name, one.camera))
    })
}

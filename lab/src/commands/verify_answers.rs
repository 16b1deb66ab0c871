//! `evaluate verify` and `report`: measures predictors' answers to a record, and compares them with searches.

use std::collections::{BTreeMap, BTreeSet};
use std::{path::PathBuf, sync::Arc};

use clap::Args;
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use treewright_client::Configuration;
use treewright_render_cli::error::{CliError, Result, write_file};
use treewright_render_cli::{interrupt::Interrupt, output};
use treewright_renderer::{limits::ROUNDS_MAX, space::TuningSpace, tuning::objective::Objective};

use super::evaluate_setup::{SceneArguments, add_found, space, take_all};
use crate::evaluation::answers::{Answers, School};
use crate::evaluation::folds::{Fold, folds};
use crate::evaluation::judge::{Verdict, best_fixed, judge};
use crate::evaluation::measure::{MILESTONES, Stage};
use crate::evaluation::page::{Report, html, tables};
use crate::evaluation::record::{GroupKind, Line, METHOD, OpenRecord, Place, Record, Search};
use crate::{evaluation::summary::standings, leave_scene_out::suite::Entry};

const FOLD_SEED: u64 = 1;

/// How cameras are parted, equally in both commands.
#[derive(Args, Clone, Debug)]
pub(super) struct FoldArguments {
    /// The record.
    #[arg(long, value_name = "FILE.jsonl")]
    record: PathBuf,

    /// Random splits of the cameras into training and test sets.
    #[arg(long, value_name = "N", default_value_t = 15, value_parser = clap::value_parser!(u32).range(1..=1000))]
    folds: u32,
}

#[derive(Args, Clone, Debug)]
pub(super) struct VerifyArguments {
    #[command(flatten)]
    folds: FoldArguments,

    #[command(flatten)]
    scenes: SceneArguments,

    /// Rounds for measuring answers.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,
}

#[derive(Args, Clone, Debug)]
pub(super) struct ReportArguments {
    #[command(flatten)]
    folds: FoldArguments,

    /// Folder for the page and its numbers.
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

/// A record with everything that can be computed from it.
struct Examined {
    record: Record,
    space: TuningSpace,
    /// Places where every objective was searched and the fixed configurations were measured.
    complete: BTreeSet<Place>,
    objectives: Vec<Objective>,
    by_objective: Vec<Vec<(Fold, Answers)>>,
}

impl Examined {
    fn new(arguments: &FoldArguments) -> Result<Self> {
        let mut record = Record::read(&arguments.record)?;
        record.searches.retain(|search| search.method == METHOD.name());
        let space = space(&record.conditions);
        let objectives: Vec<Objective> = Objective::ALL
            .into_iter()
            .filter(|objective| record.searches.iter().any(|search| search.objective == objective.name()))
            .collect();
        let complete = complete(&record, &objectives);
        if complete.is_empty() {
            return Err(CliError::Failed(format!(
                "{} has no camera yet that is complete; `evaluate record` goes on with it",
                arguments.record.display()
            )));
        }
        let parted = folds(&complete, arguments.folds, FOLD_SEED);
        let mut by_objective = Vec::new();
        for objective in &objectives {
            let searches = searches(&record, *objective, &complete);
            let school = School::new(space.space(), *objective, searches)?;
            let answered: Result<Vec<_>> =
                parted.par_iter().map(|fold| Ok((fold.clone(), school.answers(fold)?))).collect();
            by_objective.push(answered?);
        }
        Ok(Self { record, space, complete, objectives, by_objective })
    }

    /// The configurations to measure at a place: default, best fixed ones, answers, and searches' best.
    fn wanted(&self) -> BTreeMap<&Place, Vec<Configuration>> {
        let mut answers: BTreeMap<&Place, BTreeSet<Configuration>> = BTreeMap::new();
        for (objective, answered) in self.objectives.iter().zip(&self.by_objective) {
            for (fold, own) in answered {
                let fixed = best_fixed(&self.record, *objective, &fold.teach);
                for place in &fold.examine {
                    answers.entry(place).or_default().extend(fixed.clone());
                }
                for ((place, _), answer) in own {
                    answers.entry(place).or_default().insert(answer.clone());
                }
            }
        }
        let default = self.space.default_configuration();
        let places = self.complete.iter().map(|place| {
            let mut all = vec![default.clone()];
            all.extend(answers.remove(place).unwrap_or_default().into_iter().filter(|one| *one != default));
            add_found(&self.record, place, &MILESTONES, &mut all);
            (place, all)
        });
        places.collect()
    }
}

fn searches<'a>(
    record: &'a Record,
    objective: Objective,
    places: &'a BTreeSet<Place>,
) -> impl Iterator<Item = &'a Search> {
    let own = record.searches.iter().filter(move |search| search.objective == objective.name());
    own.filter(|search| places.contains(&search.place))
}

fn complete(record: &Record, objectives: &[Objective]) -> BTreeSet<Place> {
    let searched = |place: &Place, objective: &Objective| {
        record.searches.iter().any(|one| one.place == *place && one.objective == objective.name())
    };
    let places = record.searches.iter().map(|search| search.place.clone());
    places
        .filter(|place| objectives.iter().all(|objective| searched(place, objective)))
        .filter(|place| record.groups.contains_key(&(GroupKind::Fixed, place.clone())))
        .collect()
}

/// Measures the compared configurations of a place again, unless they were measured in shared rounds.
pub(super) fn run(arguments: &VerifyArguments) -> Result<()> {
    let examined = Examined::new(&arguments.folds)?;
    let entries = arguments.scenes.entries()?;
    let mut open = OpenRecord::open(&arguments.folds.record, &examined.record.conditions)?;
    // Scene by scene, as places are sorted.
    let mut missing: Vec<(&Place, Vec<Configuration>)> = Vec::new();
    for (place, mut all) in examined.wanted() {
        add_found(&open.record, place, &[], &mut all);
        let group = open.record.groups.get(&(GroupKind::Answers, place.clone()));
        if !all.iter().all(|one| group.is_some_and(|group| group.member(one).is_some())) {
            missing.push((place, all));
        }
    }
    eprintln!("what is compared at {} cameras is not measured in shared rounds yet", missing.len());
    let (interrupt, space) = (Interrupt::listen(), Arc::new(examined.space.clone()));
    let mut loaded: Option<Stage> = None;
    take_all(missing, None, |(place, configurations)| {
        let scene = place.scene.as_str();
        let same = loaded.take().filter(|stage| stage.name == scene);
        let stage = loaded.insert(match same {
            Some(same) => same,
            None => Stage::new(scene, &find(&entries, scene)?.load()?, &space, &open.record)?,
        });
        let go_on = || !interrupt.requested();
        let group = stage.group(GroupKind::Answers, place.camera, &configurations, arguments.rounds, go_on);
        open.add(Line::Group(group.ok_or(CliError::Interrupted)?))?;
        Ok(format!("{scene} camera {}: {} configurations", place.camera, configurations.len()))
    })
}

fn find<'a>(entries: &'a [Entry], scene: &str) -> Result<&'a Entry> {
    entries.iter().find(|entry| entry.name == scene).ok_or_else(|| {
        CliError::Usage(format!("the record has a scene {scene}; say where it is with --scene {scene}=PATH"))
    })
}

/// Judges a record and writes the page and its numbers.
pub(super) fn report(arguments: &ReportArguments) -> Result<()> {
    let examined = Examined::new(&arguments.folds)?;
    let mut verdicts: Vec<Verdict> = Vec::new();
    for (objective, answered) in examined.objectives.iter().zip(&examined.by_objective) {
        let searches = searches(&examined.record, *objective, &examined.complete);
        let searches = searches.map(|search| (search.place.clone(), search)).collect();
        verdicts.push(judge(&examined.record, *objective, &searches, answered)?);
    }
    let report = Report {
        record: &examined.record,
        space: &examined.space,
        complete: examined.complete.len(),
        verdicts: &verdicts,
    };
    let failed = |error: std::io::Error| CliError::Failed(format!("{}: {error}", arguments.out.display()));
    std::fs::create_dir_all(&arguments.out).map_err(failed)?;
    for (name, text) in tables(&report) {
        write_file(&arguments.out.join(name), text.as_bytes())?;
    }
    let all: Vec<_> = verdicts.iter().flat_map(standings).collect();
    write_file(&arguments.out.join("evaluation.json"), output::to_json(&all)?.as_bytes())?;
    write_file(&arguments.out.join("report.html"), html(&report).as_bytes())?;
    for sentence in report.warnings().into_iter().chain(report.words()) {
        println!("{sentence}");
    }
    Ok(())
}

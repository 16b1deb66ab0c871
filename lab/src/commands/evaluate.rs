//! `treewright-lab evaluate`: the paper's section 7, recorded and judged apart.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::{Args, Subcommand};
use treewright_accel::Device;
use treewright_client::{Configuration, detect_fingerprint};
use treewright_core::policy::SearchMethod;
use treewright_render_cli::arguments::{Size, objective};
use treewright_render_cli::error::{CliError, check_folder};
use treewright_render_cli::interrupt::Interrupt;
use treewright_renderer::limits::{BOUNCES_MAX, ITERATIONS_MAX, ROUNDS_MAX, THREADS_MAX};
use treewright_renderer::space::{Premises, Preset, TuningSpace};
use treewright_renderer::tuning::objective::Objective;

use super::evaluate_parameters as parameters;
pub(super) use super::evaluate_parameters::ParametersArguments;
use super::verify_answers as verify;
pub(super) use super::verify_answers::{JudgeArguments, VerifyArguments};
use crate::evaluation::fixed;
use crate::evaluation::measure::{Stage, best, spread};
use crate::evaluation::record::{Clock, Conditions, GroupKind, Line, OpenRecord, Place};
use crate::leave_scene_out::suite::Entry;

/// Scenes of this program that stand in for those of the paper that cannot be had, in about their sizes.
const BUILT_IN: [&str; 2] = ["gallery=builtin:gallery:1:7", "voxels=builtin:voxels:0.6:7"];

/// What to do.
#[derive(Debug, Subcommand)]
pub(super) enum Command {
    /// Render: run searches at every camera, and measure fixed configurations.
    Record(RecordArguments),
    /// Render: measure the predictors' answers next to the searches' results.
    Verify(VerifyArguments),
    /// Render: what the parameters do (the paper's section 4): a few searched alone, splitting by frame size, and a
    /// cylinder of needles that turns through each scene.
    Parameters(ParametersArguments),
    /// Compute: compare every answer with search, roofline, default and best fixed configuration.
    Judge(JudgeArguments),
}

/// Where the record is, and under which conditions it is made.
#[derive(Args, Clone, Debug)]
pub(super) struct ConditionArguments {
    /// The record, as JSON Lines. A new run continues where the last one stopped, even after `kill -9`.
    #[arg(long, value_name = "FILE.jsonl")]
    pub(super) record: PathBuf,

    #[command(flatten)]
    pub(super) scenes: SceneArguments,

    /// Iterations per search, each of which builds and renders.
    #[arg(long, value_name = "N", default_value_t = 80, value_parser = clap::value_parser!(u32).range(2..=i64::from(ITERATIONS_MAX)))]
    iterations: u32,

    /// Cameras along each scene's path.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(5..=1000))]
    cameras: u32,

    /// Render threads; 0 for one per core.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=THREADS_MAX as u64))]
    threads: u64,

    /// Size in pixels.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "320x240")]
    size: Size,

    /// Maximum number of bounces of a path.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(0..=i64::from(BOUNCES_MAX)))]
    bounces: u32,

    /// Clock for the searches.
    #[arg(long, value_enum, default_value = "wall")]
    clock: Clock,

    /// Parameters: the paper's eleven, or all.
    #[arg(long, value_name = "paper|full", value_parser = ["paper", "full"], default_value = "paper")]
    space: String,

    /// Seed of the searches.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Start no measurement after this many seconds.
    #[arg(long, value_name = "S")]
    pub(super) seconds: Option<u64>,
}

/// Arguments of `evaluate record`.
#[derive(Args, Clone, Debug)]
pub(super) struct RecordArguments {
    #[command(flatten)]
    under: ConditionArguments,

    /// What searches minimise: render time, or build and render time.
    #[arg(long, value_parser = objective(), value_delimiter = ',', default_values = ["render", "total"])]
    objective: Vec<Objective>,

    /// Searches: `nelder_mead` is the paper's, after Chang; the others are those of `treewright policy
    /// --search`.
    #[arg(long, value_name = "NAME,…", value_parser = search_method, value_delimiter = ',', default_value = "nelder_mead")]
    search: Vec<SearchMethod>,

    /// Record only this many cameras, spread over the path; the others can follow later. Default: all.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    first: Option<u32>,

    /// Rounds for measuring fixed configurations.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,
}

/// Which scenes.
#[derive(Args, Clone, Debug)]
pub(super) struct SceneArguments {
    /// Another scene, NAME=PATH or NAME=builtin:SCENE:DETAIL:SEED; can be repeated.
    #[arg(long, value_name = "NAME=PATH")]
    scene: Vec<Entry>,

    /// Only these scenes. Default: the built-in scenes and those of --scene.
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    only: Vec<String>,
}

impl SceneArguments {
    pub(super) fn entries(&self) -> Result<Vec<Entry>, CliError> {
        let mut all: Vec<Entry> = BUILT_IN
            .iter()
            .map(|text| text.parse())
            .collect::<Result<_, String>>()
            .map_err(CliError::Usage)?;
        all.extend(self.scene.iter().cloned());
        if let Some(unknown) = self.only.iter().find(|name| all.iter().all(|entry| entry.name != **name)) {
            return Err(CliError::Usage(format!("no scene is called {unknown}; see --scene")));
        }
        all.retain(|entry| self.only.is_empty() || self.only.contains(&entry.name));
        Ok(all)
    }
}

fn search_method(text: &str) -> Result<SearchMethod, String> {
    let known =
        [SearchMethod::NelderMead, SearchMethod::LatinHypercube, SearchMethod::Random, SearchMethod::Model];
    known.into_iter().find(|method| method.name() == text.replace('-', "_")).ok_or_else(|| {
        format!("there is no search {text}; there are {}", known.map(SearchMethod::name).join(", "))
    })
}

/// Does what is asked for.
pub(super) fn run(command: &Command) -> Result<(), CliError> {
    match command {
        Command::Record(arguments) => record(arguments),
        Command::Verify(arguments) => verify::run(arguments),
        Command::Parameters(arguments) => parameters::run(arguments),
        Command::Judge(arguments) => verify::judge(arguments, false),
    }
}

/// How far a run is, and when it ends.
pub(super) struct Progress {
    begin: Instant,
    limit: Option<Duration>,
    done: usize,
    all: usize,
}

impl Progress {
    pub(super) fn new(all: usize, seconds: Option<u64>) -> Self {
        Self { begin: Instant::now(), limit: seconds.map(Duration::from_secs), done: 0, all }
    }

    pub(super) fn is_over(&self) -> bool {
        self.limit.is_some_and(|limit| self.begin.elapsed() >= limit)
    }

    pub(super) fn step(&mut self, what: &str) {
        self.done += 1;
        let spent = self.begin.elapsed().as_secs_f64();
        let left = spent / self.done as f64 * (self.all - self.done) as f64;
        eprintln!("{}/{} {what}; about {:.0} min left", self.done, self.all, left / 60.0);
    }
}

/// Work that is missing: which scene, which camera, and what.
struct Missing {
    stage: usize,
    camera: u32,
    /// A search, or the fixed configurations.
    search: Option<(Objective, SearchMethod)>,
}

fn record(arguments: &RecordArguments) -> Result<(), CliError> {
    let under = &arguments.under;
    let entries = under.scenes.entries()?;
    let (conditions, mut open) = under.open()?;
    let space = Arc::new(space(&conditions));
    let mut missing = Vec::new();
    // Camera by camera over all scenes: whenever a run stops, all scenes are equally far.
    let places: Vec<u32> =
        spread(under.cameras).into_iter().take(arguments.first.unwrap_or(u32::MAX) as usize).collect();
    for camera in &places {
        let searches = arguments
            .objective
            .iter()
            .flat_map(|objective| arguments.search.iter().map(move |method| Some((*objective, *method))));
        // The best of each search is measured again beside the fixed ones.
        for search in searches.chain([None]) {
            missing.extend((0..entries.len()).map(|stage| Missing { stage, camera: *camera, search }));
        }
    }
    missing.retain(|one| {
        let place = Place { scene: entries[one.stage].name.clone(), camera: one.camera };
        match one.search {
            Some((objective, method)) => !open.record.has_search(objective, method.name(), &place),
            None => !open.record.groups.contains_key(&(GroupKind::Fixed, place)),
        }
    });
    eprintln!("{} measurements are missing in {}", missing.len(), under.record.display());
    let interrupt = Interrupt::listen();
    let mut progress = Progress::new(missing.len(), under.seconds);
    let mut stages: Vec<Option<Stage>> = entries.iter().map(|_| None).collect();
    let fixed = fixed::candidates(&space)?;
    for one in missing {
        if progress.is_over() {
            eprintln!("the time is up; the same command goes on from here");
            return Ok(());
        }
        let entry = &entries[one.stage];
        let stage = match &mut stages[one.stage] {
            Some(stage) => stage,
            empty => empty.insert(Stage::new(&entry.name, &entry.load()?, &space, &conditions)?),
        };
        let go_on = || !interrupt.requested();
        let line = match one.search {
            Some((objective, method)) => {
                stage.search(one.camera, objective, method, go_on)?.map(Line::Search)
            }
            None => {
                let mut all = fixed.clone();
                add_best(&open, &stage.place(one.camera), &mut all);
                stage.group(GroupKind::Fixed, one.camera, &all, arguments.rounds, go_on).map(Line::Group)
            }
        };
        let Some(line) = line else {
            return Err(CliError::Interrupted);
        };
        open.add(line)?;
        let what = match one.search {
            Some((objective, method)) => format!("{} for {} time", method.name(), objective.name()),
            None => "fixed configurations".to_owned(),
        };
        progress.step(&format!("{} camera {}: {what}", entry.name, one.camera));
    }
    Ok(())
}

/// The space of a record.
pub(super) fn space(conditions: &Conditions) -> TuningSpace {
    let preset = if conditions.space == "paper" { Preset::Paper } else { Preset::Full };
    let threads = conditions.threads;
    let premises =
        Premises { builds_each_frame: false, robust: false, animated: false, instanced: false, threads };
    TuningSpace::new(preset, &premises)
}

/// Adds what each search at a place found, unless it is there.
pub(super) fn add_best(open: &OpenRecord, place: &Place, all: &mut Vec<Configuration>) {
    let clock = open.record.conditions.clock;
    for search in open.record.searches.iter().filter(|search| search.place == *place) {
        let objective = Objective::ALL.into_iter().find(|objective| objective.name() == search.objective);
        let found = objective.and_then(|objective| best(search, objective, clock));
        if let Some((found, _)) = found.filter(|(found, _)| !all.contains(&found.configuration)) {
            all.push(found.configuration.clone());
        }
    }
}

impl ConditionArguments {
    /// The record and the conditions under which it is gone on with.
    pub(super) fn open(&self) -> Result<(Conditions, OpenRecord), CliError> {
        check_folder(&self.record)?;
        let conditions = self.conditions()?;
        let open = OpenRecord::open(&self.record, &conditions)?;
        Ok((conditions, open))
    }

    fn conditions(&self) -> Result<Conditions, CliError> {
        let threads = usize::try_from(self.threads).unwrap_or(THREADS_MAX);
        let (major, minor, patch) = Device::open(threads)?.version();
        let machine = detect_fingerprint()
            .software("treewright-lab", env!("CARGO_PKG_VERSION"))
            .software("embree", format!("{major}.{minor}.{patch}"));
        Ok(Conditions {
            version: Conditions::VERSION,
            machine,
            threads,
            size: [self.size.width, self.size.height],
            bounces: self.bounces,
            clock: self.clock,
            iterations: self.iterations,
            cameras: self.cameras,
            seed: self.seed,
            space: self.space.clone(),
        })
    }
}

//! `evaluate parameters`: the paper's section 4, measured into the record of section 7.

use std::sync::Arc;

use clap::{Args, ValueEnum};
use treewright_client::Configuration;
use treewright_render_cli::{error::CliError, error::Result, interrupt::Interrupt};
use treewright_renderer::{limits::ROUNDS_MAX, space::TuningSpace, tuning::objective::Objective};
use treewright_scene::Scene;

use super::evaluate_setup::{ConditionArguments, space, take_all};
use crate::evaluation::measure::Stage;
use crate::evaluation::parts::{PARTS, Part, compared, pair};
use crate::evaluation::record::{GroupKind, Line, OpenRecord, Pair, PartSearch, Place, Versus};

/// Needles of the cylinder, two triangles each: as many as in the built-in scene of that name.
const NEEDLES: usize = 3_000;
/// The camera of a path from which everything here is seen: the first.
const CAMERA: u32 = 0;
/// The objective of the searches over a few parameters.
const OBJECTIVE: Objective = Objective::Render;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Experiment {
    /// Searches over a few parameters, the others at their recommended values (4.2, Figures 6 to 8).
    Parts,
    /// Without and with splitting at several frame sizes (4.1).
    Splitting,
    /// Without and with splitting while a cylinder of needles turns through the scene (4.3, Figure 9).
    Needles,
}

#[derive(Args, Clone, Debug)]
pub(super) struct ParametersArguments {
    #[command(flatten)]
    under: ConditionArguments,

    /// Experiments to measure.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["parts", "splitting", "needles"])]
    experiment: Vec<Experiment>,

    /// Searches over each few parameters, each with points of its own.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1000))]
    runs: u32,

    /// Rounds in which builds are compared: without and with splitting, and what searches over a few
    /// parameters came to with the default. Fewer than six tell no interval.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(3..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Heights of frames at which splitting is compared, in pixels; four across to three down.
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_values_t = [120, 240, 480, 720, 1080], value_parser = clap::value_parser!(u32).range(24..=4320))]
    heights: Vec<u32>,

    /// Angles of a round at which the cylinder stands.
    #[arg(long, value_name = "N", default_value_t = 36, value_parser = clap::value_parser!(u32).range(4..=720))]
    angles: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Task {
    Part(Part, u32),
    /// The results of the searches over parts, and the default, again in shared rounds, each with a fresh
    /// build.
    Parts,
    Pair(Versus),
}

/// Takes the measurements that the record lacks.
pub(super) fn run(arguments: &ParametersArguments) -> Result<()> {
    let entries = arguments.under.scenes.entries()?;
    let (conditions, open) = arguments.under.open()?;
    let whole = Arc::new(space(&conditions));
    let mut bench = Bench { arguments, open, whole };
    let tasks = tasks(arguments);
    // Task by task over all scenes: whenever a run stops, all scenes are equally far.
    let mut missing: Vec<(usize, Task)> =
        tasks.iter().flat_map(|task| (0..entries.len()).map(move |scene| (scene, *task))).collect();
    missing.retain(|(scene, task)| !bench.is_there(&entries[*scene].name, *task));
    eprintln!("{} measurements are missing in {}", missing.len(), arguments.under.record.display());
    let interrupt = Interrupt::listen();
    let go_on = || !interrupt.requested();
    let mut scenes: Vec<Option<Arc<Scene>>> = vec![None; entries.len()];
    take_all(missing, arguments.under.seconds, |(scene, task)| {
        let (name, loaded) = (&entries[scene].name, &mut scenes[scene]);
        let scene = match loaded {
            Some(scene) => scene,
            empty => empty.insert(entries[scene].load()?),
        };
        let line = bench.measure(name, scene, task, go_on)?;
        bench.open.add(line.ok_or(CliError::Interrupted)?)?;
        Ok(format!("{name}: {}", describe(task)))
    })
}

fn tasks(arguments: &ParametersArguments) -> Vec<Task> {
    let asked = |experiment| arguments.experiment.contains(&experiment);
    let mut all = Vec::new();
    if asked(Experiment::Splitting) {
        all.extend(arguments.heights.iter().map(|height| Task::Pair(Versus::Height(*height))));
    }
    if asked(Experiment::Parts) {
        all.extend(
            (0..arguments.runs).flat_map(|run| PARTS.into_iter().map(move |part| Task::Part(part, run))),
        );
        all.push(Task::Parts);
    }
    if asked(Experiment::Needles) {
        let angles = arguments.angles;
        all.extend((0..angles).map(|angle| Task::Pair(Versus::Needles { angle, angles })));
    }
    all
}

fn describe(task: Task) -> String {
    match task {
        Task::Part(part, run) => format!("{}, run {}", part.name, run + 1),
        Task::Parts => "what the searches over parts came to, in shared rounds".to_owned(),
        Task::Pair(Versus::Height(height)) => format!("without and with splitting at {height} pixels down"),
        Task::Pair(Versus::Needles { angle, angles }) => {
            format!("without and with splitting beside needles, angle {} of {angles}", angle + 1)
        }
    }
}

fn place(scene: &str) -> Place {
    Place { scene: scene.to_owned(), camera: CAMERA }
}

struct Bench<'a> {
    arguments: &'a ParametersArguments,
    open: OpenRecord,
    whole: Arc<TuningSpace>,
}

impl Bench<'_> {
    fn is_there(&self, scene: &str, task: Task) -> bool {
        let record = &self.open.record;
        match task {
            Task::Part(part, run) => record.parts.iter().any(|one| {
                (one.part.as_str(), one.run, one.search.place.scene.as_str()) == (part.name, run, scene)
                    && one.search.objective == OBJECTIVE.name()
            }),
            Task::Parts => {
                let searches = tasks(self.arguments);
                let mut searches = searches.into_iter().filter(|task| matches!(task, Task::Part(..)));
                let group = record.groups.get(&(GroupKind::Parts, place(scene)));
                let holds = |one: &Configuration| group.is_some_and(|group| group.member(one).is_some());
                searches.all(|task| self.is_there(scene, task))
                    && compared(record, &self.whole, scene).is_ok_and(|all| all.iter().all(holds))
            }
            Task::Pair(versus) => record.pairs.contains_key(&(scene.to_owned(), versus)),
        }
    }

    /// Measures a task in a scene; `None` when it was stopped.
    fn measure(
        &self,
        name: &str,
        scene: &Arc<Scene>,
        task: Task,
        go_on: impl FnMut() -> bool,
    ) -> Result<Option<Line>> {
        let (whole, record, rounds) = (&self.whole, &self.open.record, self.arguments.rounds);
        let space = match task {
            Task::Part(part, _) => Arc::new(part.space(whole)?),
            Task::Parts | Task::Pair(_) => Arc::clone(whole),
        };
        let mut stage = Stage::new(name, scene, &space, record)?;
        Ok(match task {
            Task::Part(part, run) => {
                stage.set_seed(record.conditions.seed.wrapping_add(u64::from(run)));
                let found = stage.search(CAMERA, OBJECTIVE, go_on)?;
                found.map(|search| Line::Part(PartSearch { part: part.name.to_owned(), run, search }))
            }
            Task::Parts => {
                let all = compared(record, whole, name)?;
                stage.group(GroupKind::Parts, CAMERA, &all, rounds, go_on).map(Line::Group)
            }
            Task::Pair(versus) => {
                match versus {
                    Versus::Height(height) => stage.resize([height * 4 / 3, height]),
                    Versus::Needles { angle, angles } => {
                        stage.set_scene(scene.with_needles(angle as f32 / angles as f32, NEEDLES)?);
                    }
                }
                let group = stage.group(GroupKind::Pair, CAMERA, &pair(whole)?, rounds, go_on);
                group.map(|group| Line::Pair(Pair { versus, group }))
            }
        })
    }
}

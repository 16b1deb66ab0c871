//! `treewright-lab converge`: error over wall time of several configurations.

use std::path::PathBuf;

use clap::Args;

use super::converge_entrants::EntrantArguments;
use super::{bar, converge_output};
use crate::converge::curve::{ComparisonPlan, compare};
use crate::converge::equal_error::{BASELINES, equal_error};
use crate::converge::reference::{Reference, TRUSTED_FROM};
use crate::converge::results::{ComparisonResults, ContenderResult, ReferenceFacts};
use crate::{converge::metrics::Yardstick, geometry::geometry_hash};
use treewright_render_cli::arguments::ViewArguments;
use treewright_render_cli::error::{CliError, Result, check_folder, write_file};
use treewright_render_cli::{interrupt::Interrupt, output, server::machine};
use treewright_renderer::limits::{CONTENDERS_MAX, RUNS_MAX, SAMPLES_MAX, SECONDS_MAX};
use treewright_renderer::space::{Premises, Preset, TuningSpace};
use treewright_renderer::{frame::Renderer, integrator::View, tuning::results::SceneFacts};

const MORE_HELP: &str = "\
A reference is rendered first, with very many samples; it stands for the truth. \
Then all contenders render one view progressively, taking turns frame by frame. Their clocks count \
builds and frames, and for tuned configurations also the tuning; they stand still while pictures are \
compared with the reference. Each of --runs starts over with other random numbers.

How to read the result:
  sooner    a baseline's time to an error over the contender's
  [ , ]     95 % interval over the runs; five runs are a good start

Read a curve down to twice the reference's own error: more --reference-spp lower that.

Examples:
  treewright-render converge --scene builtin:hall --json hall.json
  treewright-render tune --scene builtin:city --json tuned.json
  treewright-render converge --scene builtin:city --tuned tuned.json";

#[derive(Args, Clone, Debug)]
#[command(after_help = MORE_HELP)]
pub(super) struct Arguments {
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    entrants: EntrantArguments,

    /// Independent runs; intervals need at least two.
    #[arg(long, value_name = "N", default_value_t = 5, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(RUNS_MAX)))]
    runs: u32,

    /// Seconds of building and rendering for each contender in each run.
    #[arg(long, value_name = "S", default_value_t = 10.0, allow_negative_numbers = true, value_parser = seconds)]
    seconds: f64,

    /// Maximum samples per pixel; a run ends there even if time is left.
    #[arg(long, value_name = "N", default_value_t = SAMPLES_MAX, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(SAMPLES_MAX)))]
    spp: u32,

    /// Samples per pixel of the reference.
    #[arg(long, value_name = "N", default_value_t = 2048, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(2..=i64::from(SAMPLES_MAX)))]
    reference_spp: u32,

    /// Write everything as JSON; `-` prints it instead of the tables.
    #[arg(long, value_name = "FILE|-")]
    json: Option<PathBuf>,
}

impl Arguments {
    /// Whether standard output belongs to JSON.
    fn prints_json(&self) -> bool {
        self.json.as_ref().is_some_and(|path| path.as_os_str() == "-")
    }

    fn check_file(&self) -> Result<()> {
        let json = self.json.as_ref().filter(|_| !self.prints_json());
        json.map_or(Ok(()), |path| check_folder(path))
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<()> {
    arguments.check_file()?;
    let entrants = arguments.entrants.read()?;
    let scene = arguments.view.scene.load()?;
    let camera = arguments.view.camera.find(&scene)?;
    let view = arguments.view.frame.view(camera);
    let mut renderer = arguments.view.frame.renderer(&scene)?;
    let interrupt = Interrupt::listen();
    if entrants.len() > CONTENDERS_MAX {
        return Err(CliError::Usage(format!(
            "{} configurations are more than the limit of {CONTENDERS_MAX}",
            entrants.len()
        )));
    }

    let reference = reference(arguments, &renderer, &view, interrupt)?;
    let yardstick = Yardstick::new(reference.picture());
    let floor = reference.floor(&yardstick);

    let plan = ComparisonPlan {
        view,
        runs: arguments.runs,
        budget_ms: arguments.seconds * 1e3,
        samples_max: arguments.spp,
    };
    let bar = bar(arguments.prints_json(), u64::from(arguments.runs) * 100, "% of a run");
    let curves = compare(&mut renderer, &entrants, &plan, &yardstick, |progress| {
        bar.set_position(u64::from(progress.run) * 100 + (progress.share * 100.0) as u64);
        !interrupt.requested()
    });
    bar.finish_and_clear();
    if curves.iter().all(|curve| curve.runs.is_empty()) {
        let failure = curves.into_iter().find_map(|curve| curve.failure);
        return Err(failure.map_or(CliError::Interrupted, CliError::Failed));
    }

    let results = ComparisonResults {
        scene: SceneFacts::of(&scene, &renderer),
        size: arguments.view.size.0,
        bounces: view.bounces,
        machine: machine().threads(u32::try_from(renderer.threads()).unwrap_or(u32::MAX)),
        embree: renderer.embree_version(),
        budget_ms: plan.budget_ms,
        reference: ReferenceFacts {
            samples: reference.samples(),
            scene_hash: geometry_hash(&scene),
            relative_mse: floor,
            trusted_from: floor * TRUSTED_FROM,
        },
        equal_error: equal_error(&curves, &BASELINES),
        contenders: curves
            .into_iter()
            .zip(entrants)
            .map(|(curve, entrant)| ContenderResult::new(curve, entrant))
            .collect(),
    };
    write(arguments, &results)?;
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

fn reference(
    arguments: &Arguments,
    renderer: &Renderer,
    view: &View,
    interrupt: Interrupt,
) -> Result<Reference> {
    // No contender's clock runs, so the fastest way that is known without measuring will do.
    let choice = TuningSpace::new(Preset::Full, &Premises::all()).default_choice();
    let (structure, _) = renderer.build(&choice.build)?;
    let (size, samples) = (arguments.view.size.0, arguments.reference_spp);
    let bar =
        bar(arguments.prints_json(), u64::from(samples.div_ceil(2)), "pairs of the reference's samples");
    let options = &choice.render;
    let found = Reference::rendered(renderer, &structure, view, options, size, samples, || {
        bar.inc(1);
        !interrupt.requested()
    });
    bar.finish_and_clear();
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(found) }
}

fn write(arguments: &Arguments, results: &ComparisonResults) -> Result<()> {
    if arguments.prints_json() {
        return output::json(results);
    }
    converge_output::print(results);
    if let Some(path) = &arguments.json {
        write_file(path, output::to_json(results)?.as_bytes())?;
        println!("wrote {}", path.display());
    }
    Ok(())
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= SECONDS_MAX => Ok(seconds),
        _ => Err(format!("it must be a number of seconds above 0 and up to {SECONDS_MAX}")),
    }
}

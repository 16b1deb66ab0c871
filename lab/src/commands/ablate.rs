//! `treewright-lab ablate`: the gain of each parameter of a winner.

use std::path::PathBuf;

use clap::Args;

use crate::ablation::report::{self as page, Ablation, Row};
use crate::ablation::{deviations, plain_configuration};
use treewright_render_cli::arguments::{SpaceArguments, ViewArguments, objective, read_configuration};
use treewright_render_cli::error::{CliError, write_file};
use treewright_render_cli::interrupt::Interrupt;
use treewright_render_cli::output;
use treewright_renderer::limits::{CONTENDERS_MAX, ROUNDS_MAX};
use treewright_renderer::measure::{Conditions, Yardstick, interleaved, standings};
use treewright_renderer::space::Preset;
use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::objective::Objective;
use treewright_renderer::tuning::verdict::contender;
use treewright_renderer::tuning::who::{NATIVE_DEFAULT, Who};

/// Arguments of `ablate`.
#[derive(Args, Clone, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    view: ViewArguments,

    /// The tuned configuration: a JSON file with parameters of the full space, as written by `tune --json`
    /// and `treewright-render best`.
    #[arg(long, value_name = "FILE")]
    config_file: PathBuf,

    /// Watertight intersection, for all configurations.
    #[arg(long)]
    robust: bool,

    /// What to minimise.
    #[arg(long, value_parser = objective(), default_value = Objective::Render.name())]
    objective: Objective,

    /// Number of measurements of each.
    #[arg(long, value_name = "N", default_value_t = 21, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,

    /// Write a web page with a chart.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

/// Measures and prints.
pub(super) fn run(arguments: &Arguments) -> Result<(), CliError> {
    let winner = read_configuration(&arguments.config_file)?;
    let scene = arguments.view.scene.load()?;
    let space = SpaceArguments { space: Preset::Full, robust: arguments.robust };
    let space = space.whole(arguments.objective, arguments.view.frame.threads)?;
    let winner = space.complete(&winner)?;
    let deviations = deviations(space.space(), &winner);
    let mut contenders = vec![
        contender(NATIVE_DEFAULT, &space, &plain_configuration(space.space()))?,
        contender(Who::Tuned, &space, &winner)?,
    ];
    for one in &deviations {
        for (how, configuration) in [("without", &one.without), ("only", &one.alone)] {
            let who = Who::Named(format!("{how} {}", one.name).into());
            contenders.push(contender(who, &space, configuration)?);
        }
    }
    if contenders.len() > CONTENDERS_MAX {
        return Err(CliError::Usage(format!(
            "{} deviations are more than the limit of {}",
            deviations.len(),
            CONTENDERS_MAX / 2 - 1
        )));
    }
    let camera = arguments.view.camera.find(&scene)?;
    let mut renderer = arguments.view.frame.renderer(&scene)?;
    let conditions = Conditions {
        view: arguments.view.frame.view(camera),
        width: arguments.view.size.width,
        height: arguments.view.size.height,
        rounds: arguments.rounds,
        frames_per_build: arguments.objective.frames_per_build(),
        yardstick: Yardstick::Frame,
    };
    let interrupt = Interrupt::listen();
    let bar = output::bar(u64::from(arguments.rounds) + 1, "rounds");
    let measured = interleaved(&mut renderer, &contenders, &conditions, || {
        bar.inc(1);
        !interrupt.requested()
    });
    bar.finish_and_clear();
    let standings = standings(&measured, conditions.frames_per_build);
    let pairs = standings.get(2..).unwrap_or_default().chunks_exact(2);
    let rows = deviations.iter().zip(pairs).map(|(deviation, pair)| Row {
        name: deviation.name.clone(),
        value: deviation.value.to_string(),
        plain: deviation.plain.to_string(),
        kept: standings[1].speedup_over(&pair[0]),
        alone: pair[1].speedup_over(&standings[0]),
        failure: pair.iter().find_map(|one| one.failure.clone()),
    });
    let ablation = Ablation {
        scene: scene.name.clone(),
        size: [arguments.view.size.width, arguments.view.size.height],
        threads: renderer.threads(),
        objective: arguments.objective,
        rounds: standings[0].frame_ms.count,
        baseline_ms: standings[0].frame_ms,
        tuned_ms: standings[1].frame_ms,
        speedup: standings[1].speedup,
        tuned: winner,
        rows: rows.collect(),
    };
    print(&ablation);
    if let Some(path) = &arguments.json {
        write_file(path, output::to_json(&ablation)?.as_bytes())?;
    }
    if let Some(path) = &arguments.report {
        let html = page::html(&ablation).map_err(|error| CliError::Failed(error.to_string()))?;
        write_file(path, html.as_bytes())?;
        println!("wrote {}", path.display());
    }
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

fn print(ablation: &Ablation) {
    println!(
        "{}, {} × {}, {} threads, {} rounds: {NATIVE_DEFAULT} {:.1} ms, {} {:.1} ms, {:.2} × as fast\n",
        ablation.scene,
        ablation.size[0],
        ablation.size[1],
        ablation.threads,
        ablation.rounds,
        ablation.baseline_ms.median,
        Who::Tuned,
        ablation.tuned_ms.median,
        ablation.speedup.median,
    );
    let mut table = output::table(&[
        "parameter",
        "tuned",
        "plain",
        "gain beside the others",
        "quartiles",
        "gain alone",
        "quartiles",
    ]);
    let gain = |ratio: &Summary| format!("{:.2} ×", ratio.median);
    let spread = |ratio: &Summary| format!("{:.2} – {:.2}", ratio.lower_quartile, ratio.upper_quartile);
    for row in &ablation.rows {
        if let Some(failure) = &row.failure {
            table.add_row([&row.name, &row.value, &row.plain, failure]);
            continue;
        }
        table.add_row([
            row.name.clone(),
            row.value.clone(),
            row.plain.clone(),
            gain(&row.kept),
            spread(&row.kept),
            gain(&row.alone),
            spread(&row.alone),
        ]);
    }
    println!("{table}");
}

//! `treewright-lab leave-out`: the time saved by leaving out work that a scene does not need.
//!
//! Each thing left out is put back on its own, and at last all at once. All variants render the same frame on
//! the same structure, one after the other in each round, beginning with another one each time; told are the
//! ratios within rounds. Pictures must be identical bit for bit.

use clap::Args;
use serde::Serialize;

use super::bar;

use treewright_render_cli::arguments::{StructureArguments, ViewArguments};
use treewright_render_cli::error::CliError;
use treewright_render_cli::interrupt::Interrupt;
use treewright_render_cli::output;
use treewright_renderer::film::{Film, Picture};
use treewright_renderer::integrator::Needs;
use treewright_renderer::limits::ROUNDS_MAX;
use treewright_renderer::space::Choice;
use treewright_renderer::statistics::Summary;

/// Arguments of `leave-out`.
#[derive(Args, Clone, Debug)]
pub(super) struct Arguments {
    #[command(flatten)]
    view: ViewArguments,
    #[command(flatten)]
    structure: StructureArguments,

    /// Number of measurements of each variant.
    #[arg(long, value_name = "N", default_value_t = 21, allow_negative_numbers = true, value_parser = clap::value_parser!(u32).range(1..=i64::from(ROUNDS_MAX)))]
    rounds: u32,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The output of `leave-out --json`.
#[derive(Debug, Serialize)]
struct LeaveOutResults {
    scene: String,
    triangles: usize,
    size: [u32; 2],
    threads: usize,
    rounds: u32,
    choice: Choice,
    needs: Needs,
    /// Of the kernel that leaves out all it can.
    render_ms: Summary,
    /// One thing each, and everything at the end.
    put_back: Vec<PutBack>,
}

/// Something put back.
#[derive(Debug, Serialize)]
struct PutBack {
    what: &'static str,
    why: &'static str,
    render_ms: Summary,
    /// Its render time over that without it, pair by pair.
    saving: Summary,
    /// Whether the picture is the same bit for bit.
    identical: bool,
}

/// A shading kernel and its times.
struct Variant {
    what: &'static str,
    why: &'static str,
    needs: Needs,
    render_ms: Vec<f64>,
    picture: Option<Picture>,
}

impl Variant {
    fn new(what: &'static str, why: &'static str, needs: Needs) -> Self {
        Self { what, why, needs, render_ms: Vec::new(), picture: None }
    }
}

/// Measures and prints; fails when a picture changes.
pub(super) fn run(arguments: &Arguments) -> Result<(), CliError> {
    let choice = arguments.structure.choice(arguments.view.frame.threads)?;
    let scene = arguments.view.scene.load()?;
    let view = arguments.view.frame.view(arguments.view.camera.find(&scene)?);
    let renderer = arguments.view.frame.renderer(&scene)?;
    let (structure, _) = renderer.build(&choice.build)?;
    let least = renderer.needs();
    let mut variants = vec![Variant::new("", "", least)];
    variants.extend(least.omissions().iter().map(|one| Variant::new(one.what, one.why, one.put_back)));
    variants.push(Variant::new("everything", "the kernel that renders any scene", Needs::ALL));

    let mut film = Film::new(arguments.view.size.width, arguments.view.size.height);
    let interrupt = Interrupt::listen();
    let rounds = arguments.rounds as usize;
    let bar = bar(arguments.json, rounds as u64 + 1, "rounds");
    for round in 0..=rounds {
        if interrupt.requested() {
            break;
        }
        for turn in 0..variants.len() {
            let index = (round + turn) % variants.len();
            let variant = &mut variants[index];
            film.clear();
            let (render_ms, _) =
                renderer.render_needing(variant.needs, &structure, &view, &choice.render, &mut film);
            // The first round warms caches and clocks and shows the pictures.
            if round == 0 {
                variant.picture = Some(film.picture());
            } else {
                variant.render_ms.push(render_ms);
            }
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let [first, others @ ..] = &variants[..] else {
        return Ok(());
    };
    let results = LeaveOutResults {
        scene: scene.name.clone(),
        triangles: scene.triangles.len(),
        size: [arguments.view.size.width, arguments.view.size.height],
        threads: renderer.threads(),
        rounds: arguments.rounds,
        choice,
        needs: least,
        render_ms: Summary::of(&first.render_ms),
        put_back: others
            .iter()
            .map(|one| PutBack {
                what: one.what,
                why: one.why,
                render_ms: Summary::of(&one.render_ms),
                saving: Summary::of_ratios(&one.render_ms, &first.render_ms),
                identical: one.picture == first.picture,
            })
            .collect(),
    };
    if arguments.json {
        output::json(&results)?;
    } else {
        print(&results);
    }
    if results.put_back.iter().any(|one| !one.identical) {
        return Err(CliError::Failed("a picture depends on what is left out".to_owned()));
    }
    if interrupt.requested() { Err(CliError::Interrupted) } else { Ok(()) }
}

fn print(results: &LeaveOutResults) {
    println!(
        "{}: {} triangles, {}x{}, {} threads, {} rounds; {:.1} ms a frame with all of this left out:\n",
        results.scene,
        results.triangles,
        results.size[0],
        results.size[1],
        results.threads,
        results.rounds,
        results.render_ms.median,
    );
    let mut table = output::table(&["put back", "render ms", "time", "quartiles", "picture"]);
    for one in &results.put_back {
        table.add_row([
            one.what.to_owned(),
            format!("{:.1}", one.render_ms.median),
            format!("{:.3} ×", one.saving.median),
            format!("{:.3} – {:.3}", one.saving.lower_quartile, one.saving.upper_quartile),
            if one.identical { "identical" } else { "DIFFERENT" }.to_owned(),
        ]);
    }
    println!("{table}");
    for one in &results.put_back {
        println!("{}: {}", one.what, one.why);
    }
}

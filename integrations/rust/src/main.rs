//! An example: the builders of the crates `obvhs`, `bvh` and `tinybvh-rs`, tuned per mesh and use by a
//! Treewright daemon.
//!
//! `treewright-builders --trials 60 --rays 10000,1000000 [--library obvhs] [SCENE.ply …]`
//!
//! A mesh is one state with each number of rays that its tree has to serve: that number decides how long a
//! build may take. Cost is build plus rays, in milliseconds of processor time. Without `--library` the choice
//! of the library is tuned, too. With `--rounds` the tuned configuration is then measured against every
//! preset, in turns within each round. Lines of JSON go to standard output.

mod library;
mod mesh;

use std::path::PathBuf;
use std::time::Duration;

use clap::Parser;
use glam::DVec3;
use serde_json::json;
use treewright_client::blocking::{Client, Study};
use treewright_client::{
    ClientError, Configuration, Indicators, Measurements, Options, Outcome, Scale, StudySpec,
};
use treewright_indicators::{Accumulator, IndicatorScale, SCHEMA, Surface, View};

use library::{LIBRARIES, Library, fixed, space};
use mesh::Mesh;

/// The arguments of the example.
#[derive(Debug, Parser)]
struct Arguments {
    /// Address of the daemon.
    #[arg(long, default_value = "http://127.0.0.1:50611")]
    url: String,
    /// Trials per mesh and number of rays; the presets are the first of them.
    #[arg(long, default_value_t = 60)]
    trials: usize,
    /// Rays that a tree serves.
    #[arg(long, value_delimiter = ',', default_values_t = [10_000, 300_000])]
    rays: Vec<u32>,
    /// The libraries to choose from; without any, all that were compiled in (`tinybvh` by the feature of this
    /// name).
    #[arg(long = "library", value_delimiter = ',', value_parser = library::named)]
    libraries: Vec<Library>,
    /// Rounds of the comparison with the presets.
    #[arg(long, default_value_t = 0)]
    rounds: usize,
    /// Meshes: binary PLY of triangles, as integrations/scenes.py writes them. Two are generated without any.
    scenes: Vec<PathBuf>,
}

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments = Arguments::parse();
    if arguments.libraries.is_empty() {
        arguments.libraries = LIBRARIES.to_vec();
    }
    let meshes = if arguments.scenes.is_empty() {
        vec![mesh::field(), mesh::needles()]
    } else {
        arguments.scenes.iter().map(|path| mesh::read(path)).collect::<Result<_, _>>()?
    };
    let options = Options::new().client_id("builders-example").deadline(Duration::from_secs(60));
    let client = Client::connect(&arguments.url, options)?;
    let name = arguments.libraries.iter().map(|one| format!("-{}", one.name)).collect::<String>();
    let study = client.study(&format!("builders{name}"), spec(&arguments.libraries)?)?;
    for mesh in &meshes {
        for &rays in &arguments.rays {
            tune(&arguments, &client, &study, mesh, rays)?;
        }
    }
    Ok(())
}

/// The parameters, the indicators of the input, and the objective.
fn spec(libraries: &[Library]) -> Result<StudySpec, ClientError> {
    let mut builder = StudySpec::builder(space(libraries)?).indicator("rays", 0.0..=1e9, Scale::Log);
    for one in SCHEMA {
        let scale = if one.scale == IndicatorScale::Log { Scale::Log } else { Scale::Linear };
        builder = builder.indicator(one.name, one.min..=one.max, scale);
    }
    Ok(builder.minimise("build_ms", 1.0).minimise("rays_ms", 1.0).build()?)
}

/// The seventeen indicators, and how many rays there are.
fn describe(mesh: &Mesh, rays: u32) -> Indicators {
    let (min, max) = mesh.bounds();
    let mut all = Accumulator::new(min.as_dvec3(), max.as_dvec3());
    let corners = mesh.triangles.iter().map(|one| [one.v0, one.v1, one.v2].map(|corner| corner.as_dvec3()));
    all.mesh(Surface { diffuse_share: 1.0, emits: false }, corners);
    let center = (min.as_dvec3() + max.as_dvec3()) * 0.5;
    let view = View { position: center, target: center + DVec3::X, vertical_fov_deg: 180.0 };
    let values = all.finish(0).with_camera(&view).values();
    values.into_iter().collect::<Indicators>().with("rays", f64::from(rays))
}

/// Measures configurations on one mesh with one number of rays, and remembers what each took.
struct Bench<'a> {
    mesh: &'a Mesh,
    rays: u32,
    costs_ms: Vec<f64>,
}

impl Bench<'_> {
    fn measure(&mut self, configuration: &Configuration) -> Result<Measurements, Failure> {
        let cost = library::run(configuration, self.mesh, self.rays)?;
        self.costs_ms.push(cost.build_ms + cost.rays_ms);
        Ok([("build_ms", cost.build_ms), ("rays_ms", cost.rays_ms)].into())
    }

    /// A trial of a configuration of our own choice.
    fn try_out(&mut self, study: &Study, input: &Indicators, choice: &Configuration) -> Result<(), Failure> {
        let trial = study.trial_of(input, choice)?;
        let measured = self.measure(trial.configuration())?;
        Ok(trial.report(measured, Outcome::Ok)?)
    }
}

fn tune(
    arguments: &Arguments,
    client: &Client,
    study: &Study,
    mesh: &Mesh,
    rays: u32,
) -> Result<(), Failure> {
    let input = describe(mesh, rays);
    let mut bench = Bench { mesh, rays, costs_ms: Vec::new() };
    // The libraries' own presets come first: the search goes on from there.
    let presets = fixed(&arguments.libraries);
    for (_, preset) in presets.iter().take(arguments.trials) {
        bench.try_out(study, &input, preset)?;
    }
    let ranking = presets.iter().zip(&bench.costs_ms).min_by(|a, b| a.1.total_cmp(b.1));
    let best_preset = ranking.map(|((_, preset), _)| preset);
    // The last quarter separates merit from luck: the best so far and the best preset in turns.
    let pairs = (arguments.trials / 8).min(arguments.trials.saturating_sub(presets.len()) / 2);
    let (mut tuner, mut previous) = (study.tuner(), None);
    for _trial in presets.len() + 2 * pairs..arguments.trials {
        let suggestion = tuner.next(&input, previous.take());
        let measured = bench.measure(suggestion.configuration())?;
        previous = Some(suggestion.finished(measured, Outcome::Ok)?);
    }
    drop(previous);
    for _pair in 0..pairs {
        client.flush(Duration::from_secs(20))?;
        bench.try_out(study, &input, &study.best(&input)?.configuration)?;
        if let Some(preset) = best_preset {
            bench.try_out(study, &input, preset)?;
        }
    }
    client.flush(Duration::from_secs(20))?;
    let best = study.best(&input)?;
    let mut line = json!({
        "scene": mesh.name, "triangles": mesh.triangles.len(), "use": format!("{rays} rays"), "trial_costs": bench.costs_ms,
        "tuned": best.configuration,
    });
    if arguments.rounds > 0 {
        let (tuned, fixed) = compare(arguments, &best.configuration, mesh, rays)?;
        (line["tuned_costs"], line["fixed"]) = (tuned, fixed);
    }
    println!("{line}");
    Ok(())
}

/// Costs of the tuned configuration and of each preset, in turns within each round, and by how many hits each
/// preset differs.
fn compare(
    arguments: &Arguments,
    tuned: &Configuration,
    mesh: &Mesh,
    rays: u32,
) -> Result<(serde_json::Value, serde_json::Value), Failure> {
    let mut all = vec![("tuned".to_owned(), tuned.clone())];
    all.extend(fixed(&arguments.libraries));
    let (mut costs, mut hits) = (vec![Vec::new(); all.len()], vec![0; all.len()]);
    for round in 0..arguments.rounds {
        // Each comes first once, and they run forwards and backwards.
        let mut turns: Vec<usize> = (0..all.len()).collect();
        turns.rotate_left(round % all.len());
        if round % 2 == 1 {
            turns.reverse();
        }
        for turn in turns {
            // Earlier runs leave their mark on caches and memory, so the first run of each does not count.
            library::run(&all[turn].1, mesh, rays)?;
            let cost = library::run(&all[turn].1, mesh, rays)?;
            costs[turn].push(cost.build_ms + cost.rays_ms);
            hits[turn] = cost.hits;
        }
    }
    let row = |each: usize| json!({ "configuration": all[each].0, "costs": costs[each], "differs": hits[0].abs_diff(hits[each]) });
    Ok((json!(costs[0]), (1..all.len()).map(row).collect()))
}

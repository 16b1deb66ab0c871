//! An example: the builders of the crate `obvhs`, tuned per mesh and use by a Treewright daemon.
//!
//! `treewright-builders --trials 60 --rays 10000,1000000 [SCENE.ply …]`
//!
//! A mesh is one state with each number of rays that its tree has to serve: that number decides how long a build may take. Cost is
//! build plus rays, in milliseconds of processor time. With `--rounds` the tuned
//! configuration is then measured against every preset of the crate, in turns within each round. Lines of JSON go to standard output.

mod mesh;
mod structure;

use std::path::PathBuf;
use std::time::Duration;

use clap::Parser;
use glam::DVec3;
use serde_json::json;
use treewright_client::blocking::{Client, Study};
use treewright_client::{ClientError, Configuration, Indicators, Options, Outcome, Scale, StudySpec};
use treewright_indicators::{Accumulator, IndicatorScale, SCHEMA, Surface, View};

use mesh::Mesh;
use structure::{PRESETS, configuration_of, space};

/// What the example is told.
#[derive(Debug, Parser)]
struct Arguments {
    /// Address of the daemon.
    #[arg(long, default_value = "http://127.0.0.1:50611")]
    url: String,
    /// Trials per mesh and number of rays.
    #[arg(long, default_value_t = 60)]
    trials: u32,
    /// Rays that a tree serves.
    #[arg(long, value_delimiter = ',', default_values_t = [10_000, 300_000])]
    rays: Vec<u32>,
    /// Rounds of the comparison with the presets.
    #[arg(long, default_value_t = 0)]
    rounds: usize,
    /// Meshes: binary PLY of triangles, as integrations/scenes.py writes them. Two are generated without any.
    scenes: Vec<PathBuf>,
}

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    let meshes = if arguments.scenes.is_empty() {
        vec![mesh::field(), mesh::needles()]
    } else {
        arguments.scenes.iter().map(|path| mesh::read(path)).collect::<Result<_, _>>()?
    };
    let options = Options::new().client_id("builders-example").deadline(Duration::from_secs(1));
    let client = Client::connect(&arguments.url, options)?;
    let study = client.study("builders-example", spec()?)?;
    for mesh in &meshes {
        for &rays in &arguments.rays {
            tune(&arguments, &client, &study, mesh, rays)?;
        }
    }
    Ok(())
}

/// What is tuned, what describes the input, and what is to become small.
fn spec() -> Result<StudySpec, ClientError> {
    let mut builder = StudySpec::builder(space()?).indicator("rays", 0.0..=1e9, Scale::Log);
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

fn tune(
    arguments: &Arguments,
    client: &Client,
    study: &Study,
    mesh: &Mesh,
    rays: u32,
) -> Result<(), Failure> {
    let input = describe(mesh, rays);
    let mut tuner = study.tuner();
    let (mut previous, mut costs) = (None, Vec::new());
    for _trial in 0..arguments.trials {
        let suggestion = tuner.next(&input, previous.take());
        let cost = structure::run(suggestion.configuration(), mesh, rays)?;
        costs.push(cost.build_ms + cost.rays_ms);
        let measured = [("build_ms", cost.build_ms), ("rays_ms", cost.rays_ms)].into();
        previous = Some(suggestion.finished(measured, Outcome::Ok)?);
    }
    drop(previous);
    client.flush(Duration::from_secs(20))?;
    let best = study.best(&input)?;
    let mut line = json!({
        "scene": mesh.name, "triangles": mesh.triangles.len(), "use": format!("{rays} rays"), "trial_costs": costs,
        "tuned": best.configuration,
    });
    if arguments.rounds > 0 {
        let (tuned, fixed) = compare(&best.configuration, mesh, rays, arguments.rounds)?;
        (line["tuned_costs"], line["fixed"]) = (tuned, fixed);
    }
    println!("{line}");
    Ok(())
}

/// Costs of the tuned configuration and of each preset, in turns within each round, and by how many hits each preset differs.
fn compare(
    tuned: &Configuration,
    mesh: &Mesh,
    rays: u32,
    rounds: usize,
) -> Result<(serde_json::Value, serde_json::Value), Failure> {
    let mut all = vec![("tuned".to_owned(), tuned.clone())];
    for layout in ["cwbvh", "bvh2"] {
        all.extend(
            PRESETS
                .iter()
                .map(|(name, preset)| (format!("{layout} {name}"), configuration_of(layout, preset))),
        );
    }
    let (mut costs, mut hits) = (vec![Vec::new(); all.len()], vec![0; all.len()]);
    for round in 0..rounds {
        for each in 0..all.len() {
            // In another order each time, for what ran before leaves its mark; their number is a prime.
            let turn = (each * (1 + round % (all.len() - 1)) + round) % all.len();
            let cost = structure::run(&all[turn].1, mesh, rays)?;
            costs[turn].push(cost.build_ms + cost.rays_ms);
            hits[turn] = cost.hits;
        }
    }
    let row = |each: usize| json!({ "configuration": all[each].0, "costs": costs[each], "differs": hits[0].abs_diff(hits[each]) });
    Ok((json!(costs[0]), (1..all.len()).map(row).collect()))
}

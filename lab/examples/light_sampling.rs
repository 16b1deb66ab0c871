//! What ways of looking for light are worth: the time until a picture has an error of a tenth, in paired
//! rounds.
//!
//! `cargo run --release -p treewright-lab --example light_sampling -- [--rounds N] [--winners FOLDER]
//! SCENE...` Scenes are files or `builtin:NAME`. Without winners each lever is turned alone. With a folder of
//! files that `treewright-render tune --objective error --json FOLDER/SCENE.json` wrote, every scene's winner
//! runs on every scene, and each is compared with the one way that is best on all scenes but its own.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use treewright_renderer::frame::Renderer;
use treewright_renderer::integrator::View;
use treewright_renderer::light_sampling::{LightSampling, SkyChoice};
use treewright_renderer::measure::{Conditions, Contender, Standing, interleaved, standings};
use treewright_renderer::space::{Choice, Premises, Preset, TuningSpace, parse};
use treewright_renderer::statistics::{Ratio, Summary};
use treewright_scene::{Scene, SceneError, builtin, load};

type Failure = Box<dyn std::error::Error>;

/// What a run is asked for.
struct Arguments {
    rounds: u32,
    winners: Option<PathBuf>,
    scenes: Vec<String>,
}

fn arguments() -> Result<Arguments, Failure> {
    let mut all = std::env::args().skip(1);
    let mut arguments = Arguments { rounds: 7, winners: None, scenes: Vec::new() };
    while let Some(argument) = all.next() {
        match argument.as_str() {
            "--rounds" => arguments.rounds = all.next().ok_or("--rounds wants a number")?.parse()?,
            "--winners" => arguments.winners = Some(all.next().ok_or("--winners wants a folder")?.into()),
            _ => arguments.scenes.push(argument),
        }
    }
    Ok(arguments)
}

/// Each lever alone, beside the renderer's constants.
fn levers() -> Vec<(String, LightSampling)> {
    let start = LightSampling::default();
    let sky = LightSampling { sky: SkyChoice::Learnt, sky_share: 0.3, ..start };
    let all = [
        ("constants", start),
        ("candidates 1", LightSampling { candidates: 1, ..start }),
        ("candidates 4", LightSampling { candidates: 4, ..start }),
        ("candidates 16", LightSampling { candidates: 16, ..start }),
        ("lamp weight 4", LightSampling { lamp_weight: 4.0, ..start }),
        ("candidates 16, weight 64", LightSampling { candidates: 16, lamp_weight: 64.0, ..start }),
        ("sun 0.2", LightSampling { sun_share: 0.2, ..start }),
        ("sun 0.8", LightSampling { sun_share: 0.8, ..start }),
        ("sky learnt, 0.3", sky),
        ("sky and shares learnt", LightSampling { learnt_shares: true, ..sky }),
        ("shadow roulette 0.1", LightSampling { shadow_roulette: 0.1, ..start }),
        ("path roulette 0.2", LightSampling { path_roulette: 0.2, ..start }),
    ];
    all.map(|(name, way)| (name.to_owned(), way)).to_vec()
}

fn stem(scene: &str) -> String {
    let path = Path::new(scene.trim_start_matches("builtin:"));
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// The renderer's constants, the recommended way, and each scene's winner.
fn winners(folder: &Path, scenes: &[String]) -> Result<Vec<(String, LightSampling)>, Failure> {
    let space = TuningSpace::new(Preset::Light, &Premises::all());
    let mut all = vec![
        ("constants".to_owned(), LightSampling::default()),
        ("recommended".to_owned(), space.default_choice().light),
    ];
    for name in scenes.iter().map(|scene| stem(scene)) {
        let results: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(folder.join(format!("{name}.json")))?)?;
        let tuned = results["tuned"].as_object().ok_or("a file without a configuration")?;
        let text: Vec<String> = tuned
            .iter()
            .map(|(name, value)| {
                format!("{name}={}", value.as_str().map_or_else(|| value.to_string(), str::to_owned))
            })
            .collect();
        all.push((name, space.choice(&parse(&text.join(","))?)?.light));
    }
    Ok(all)
}

fn scene(name: &str) -> Result<Scene, SceneError> {
    match name.strip_prefix("builtin:") {
        Some(name) => builtin::build(name, &builtin::Options::default()),
        None => load(name),
    }
}

/// Everybody on a scene.
fn measured(name: &str, ways: &[(String, LightSampling)], rounds: u32) -> Result<Vec<Standing>, Failure> {
    let scene = Arc::new(scene(name)?);
    let premises = Premises { instanced: scene.instances.is_some(), animated: false, ..Premises::all() };
    let base = TuningSpace::new(Preset::Full, &premises).default_choice();
    let mut renderer = Renderer::new(Arc::clone(&scene), 0)?;
    let view = View { camera: scene.cameras[0], seed: 1000, bounces: 3 };
    let contender = |(name, light): &(String, LightSampling)| {
        let choice = Choice { light: *light, ..base };
        Contender { name: name.clone(), choice }
    };
    let contenders: Vec<Contender> = ways.iter().map(contender).collect();
    let conditions =
        Conditions { view, width: 320, height: 240, rounds, frames_per_build: 1000, noise: true };
    Ok(standings(&interleaved(&mut renderer, &contenders, &conditions, || true), conditions.frames_per_build))
}

/// How many times as fast, round by round in the geometric mean.
fn speed(one: &Standing, other: &Standing) -> f64 {
    let ratios = other.undelayed_ms.iter().zip(&one.undelayed_ms).map(|(other, one)| (other / one).ln());
    (ratios.sum::<f64>() / one.undelayed_ms.len() as f64).exp()
}

fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.ln()).sum::<f64>() / values.len().max(1) as f64).exp()
}

/// The number of the way that is best in the mean over all scenes but one, its own winner left out.
fn best_fixed(tables: &[Vec<Standing>], without: usize) -> usize {
    let others = |way: usize| {
        let ratios = tables.iter().enumerate().filter(|(scene, _)| *scene != without);
        geometric_mean(&ratios.map(|(_, table)| speed(&table[way], &table[0])).collect::<Vec<_>>())
    };
    let ways = (0..tables[0].len()).filter(|way| *way != without + 2);
    ways.max_by(|a, b| others(*a).total_cmp(&others(*b))).unwrap_or(0)
}

fn main() -> Result<(), Failure> {
    let Arguments { rounds, winners: folder, scenes } = arguments()?;
    let ways = folder.as_ref().map_or_else(|| Ok(levers()), |folder| winners(folder, &scenes))?;
    let mut tables = Vec::new();
    for name in &scenes {
        let table = measured(name, &ways, rounds)?;
        println!("{name}");
        for one in &table {
            println!("  {:24} {:10.0} ms  {}", one.name, one.frame_ms.median, one.gain_over(&table[0]));
        }
        tables.push(table);
    }
    if folder.is_none() {
        return Ok(());
    }
    println!("scene, own winner over the constants, over the best fixed way of the others, roofline over it");
    let (mut over_constants, mut over_fixed, mut rooflines) = (Vec::new(), Vec::new(), Vec::new());
    for (number, (name, table)) in scenes.iter().zip(&tables).enumerate() {
        let (own, fixed) = (&table[number + 2], &table[best_fixed(&tables, number)]);
        let roofline = table.iter().map(|one| speed(one, fixed)).fold(0.0, f64::max);
        let shown: [Ratio; 2] = [own.gain_over(&table[0]), own.gain_over(fixed)];
        println!("{:24} {}   {} ({})   {roofline:.2}", stem(name), shown[0], shown[1], fixed.name);
        over_constants.push(shown[0].median);
        over_fixed.push(shown[1].median);
        rooflines.push(roofline);
    }
    for (title, values) in [
        ("constants", over_constants),
        ("best fixed of the others", over_fixed),
        ("roofline over it", rooflines),
    ] {
        let (mean, median) = (geometric_mean(&values), Summary::of(&values).median);
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        println!("{title}: geometric mean {mean:.3}, median {median:.3}, least {least:.3}");
    }
    Ok(())
}

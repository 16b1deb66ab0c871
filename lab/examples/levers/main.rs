//! The gain of choosing a lever's way for each scene, in paired rounds. Levers: ways to sample light, by the
//! time to an error of a tenth, ways to follow motion, by the mean frame of an episode, and trees that serve
//! some frames, by the time of whole sessions (see `sessions`).
//!
//! `cargo run --release -p treewright-lab --example levers -- --lever light|follow|sessions [--rounds N]
//! [--width N] [--frames N] [--winners FOLDER] [--session-frames N] [--trials N] [--weigh-gain] WORLD...`
//! A world is a file or `builtin:NAME`; for `follow` a motion (`itself` for scenes that move by themselves)
//! and cycles in an episode stand behind it, as in `builtin:city@sway@0.25`. Without winners a few ways to
//! follow are compared. With a folder of files that `treewright-render tune --objective error|motion --json`
//! wrote, named like the worlds (`city-sway-0.25.json`), every world's winner runs in every world, and each
//! is compared with the one way that is best in all worlds of other scenes.

mod sessions;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Parser, ValueEnum};
use treewright_lab::converge::bootstrap::{in_words, interval};
use treewright_render_cli::arguments::{SceneArguments, read_configuration};
use treewright_renderer::frame::Renderer;
use treewright_renderer::integrator::View;
use treewright_renderer::measure::{Conditions, Contender, Standing, Yardstick, interleaved, standings};
use treewright_renderer::space::{Choice, Premises, Preset, TuningSpace, parse};
use treewright_renderer::statistics::{Ratio, Summary};
use treewright_renderer::tuning::who::Who;
use treewright_scene::Scene;
use treewright_scene::motion::Motion;

type Failure = Box<dyn std::error::Error>;

/// Ways to follow that are compared by hand; other values are the recommended ones.
const FOLLOW: [(&str, &str); 13] = [
    ("quick, rebuilt", "tree=quick,period=1"),
    ("quick, 1.15", "tree=quick,repair_above=1.15"),
    ("quick, 1.3", "tree=quick,repair_above=1.3"),
    ("quick, 4", "tree=quick,repair_above=4"),
    ("middle, 1.15", "tree=middle,repair_above=1.15"),
    ("middle, 2", "tree=middle,repair_above=2"),
    ("good, 1.3", "tree=good,repair_above=1.3"),
    ("good, 4", "tree=good,repair_above=4"),
    ("native low, rebuilt", "tree=native_low,period=1"),
    ("native low, fitted", "tree=native_low"),
    ("native medium, rebuilt", "tree=native_medium,period=1"),
    ("native medium, fitted", "tree=native_medium"),
    ("native medium, every 8", "tree=native_medium,period=8"),
];

/// Which lever.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Lever {
    Light,
    Follow,
    Sessions,
}

/// Measures the gain of choosing a lever's way for each scene.
#[derive(Parser)]
struct Arguments {
    #[arg(long, value_enum, default_value = "light")]
    lever: Lever,
    #[arg(long, default_value_t = 7)]
    rounds: u32,
    /// Pixels across, four to three down.
    #[arg(long, default_value_t = 320)]
    width: u32,
    /// Frames of an episode.
    #[arg(long, default_value_t = 24)]
    frames: u32,
    /// Folder of the results of `treewright-render tune --json`, named like the worlds.
    #[arg(long)]
    winners: Option<PathBuf>,
    /// Frames of a session, for `sessions`.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    session_frames: u32,
    /// Trials of a state's search in a session; the service's own default is 80.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=1000))]
    trials: u32,
    /// The service explores in a session only where the expected gain pays for it.
    #[arg(long)]
    weigh_gain: bool,
    /// Each a scene, for `follow` with its motion and cycles, as `builtin:city@sway@0.25`.
    worlds: Vec<String>,
}

impl Arguments {
    /// Pixels across and down.
    fn size(&self) -> [u32; 2] {
        [self.width, self.width / 4 * 3]
    }
}

/// A scene, and how it moves.
struct World {
    /// Of its file of results.
    name: String,
    /// Of the scene alone.
    scene: String,
    moments: Vec<Arc<Scene>>,
}

fn stem(scene: &str) -> String {
    let path = Path::new(scene.trim_start_matches("builtin:"));
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// As it is written in the arguments: what the name of its results is, its scene, motion and cycles.
fn parts(world: &str) -> (String, String, Option<&str>, f32) {
    let mut parts = world.split('@');
    let scene = parts.next().unwrap_or_default();
    let (motion, cycles) = (parts.next(), parts.next());
    let words = std::iter::once(stem(scene)).chain(motion.into_iter().chain(cycles).map(str::to_owned));
    let name = words.collect::<Vec<_>>().join("-");
    (name, scene.to_owned(), motion, cycles.and_then(|text| text.parse().ok()).unwrap_or(0.25))
}

fn world(written: &str, frames: u32) -> Result<World, Failure> {
    let (name, scene, motion, cycles) = parts(written);
    let moment = |frame: u32| cycles * frame as f32 / frames as f32;
    let mut arguments = SceneArguments::plain(scene.clone(), 1.0, None, 0.0);
    let moments = match motion {
        None => vec![arguments.load()?],
        Some(motion) => {
            if motion != "itself" {
                let known = Motion::ALL.into_iter().find(|known| known.name() == motion);
                arguments.motion = Some(known.ok_or("no such motion")?);
            }
            let moving = arguments.moving()?;
            (0..frames).map(|frame| moving.at(moment(frame))).collect::<Result<_, _>>()?
        }
    };
    Ok(World { name, scene, moments })
}

/// Named ways, each a configuration; the first is the baseline of the others.
fn ways(arguments: &Arguments, space: &TuningSpace) -> Result<Vec<(String, Choice)>, Failure> {
    let recommended = space.default_choice();
    // The renderer's own defaults: the recommended tree with light by constants, and a quick tree for each
    // frame.
    let plain = if arguments.lever == Lever::Light {
        Choice { light: Default::default(), ..recommended }
    } else {
        space.choice(&parse("tree=quick,period=1")?)?
    };
    let mut all = vec![("untuned".to_owned(), plain), ("recommended".to_owned(), recommended)];
    match &arguments.winners {
        None if arguments.lever == Lever::Light => return Err("--lever light wants --winners".into()),
        None => {
            for (name, text) in FOLLOW {
                all.push((name.to_owned(), space.choice(&parse(text)?)?));
            }
        }
        Some(folder) => {
            for name in arguments.worlds.iter().map(|world| parts(world).0) {
                let tuned = read_configuration(&folder.join(format!("{name}.json")))?;
                all.push((name, space.choice(&tuned)?));
            }
        }
    }
    Ok(all)
}

fn view(scene: &Scene) -> View {
    View { camera: scene.cameras[0], seed: 1000, bounces: 3 }
}

/// All ways in one world.
fn measured(
    world: &World,
    ways: &[(String, Choice)],
    arguments: &Arguments,
) -> Result<Vec<Standing>, Failure> {
    let scene = &world.moments[0];
    let mut renderer = Renderer::new(Arc::clone(scene), 0)?;
    let (frames_per_build, yardstick) = if arguments.lever == Lever::Light {
        (1000, Yardstick::Noise)
    } else {
        renderer.set_episode(&world.moments);
        (1, Yardstick::Episode)
    };
    let view = view(scene);
    let named = |name: &String| Who::Named(name.clone().into());
    let contender = |(name, choice): &(String, Choice)| Contender { who: named(name), choice: *choice };
    let contenders: Vec<Contender> = ways.iter().map(contender).collect();
    let [width, height] = arguments.size();
    let rounds = arguments.rounds;
    let conditions = Conditions { view, width, height, rounds, frames_per_build, yardstick };
    Ok(standings(&interleaved(&mut renderer, &contenders, &conditions, || true), frames_per_build))
}

/// Speed of `one` over `other`, round by round in the geometric mean; nothing for ways that did not run.
fn speed(one: &Standing, other: &Standing) -> f64 {
    let ratios = other.undelayed_ms.iter().zip(&one.undelayed_ms).map(|(other, one)| (other / one).ln());
    if one.undelayed_ms.is_empty() {
        0.0
    } else {
        (ratios.sum::<f64>() / one.undelayed_ms.len() as f64).exp()
    }
}

fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.ln()).sum::<f64>() / values.len().max(1) as f64).exp()
}

/// The number of the way that is best in the mean over all worlds of other scenes. Winners of worlds of that
/// scene do not take part: a winner's number is its world's, behind the two ways that everybody has.
fn best_fixed(tables: &[Vec<Standing>], scenes: &[String], of: usize, are_winners: bool) -> usize {
    let is_other = |world: usize| scenes[world] != scenes[of];
    let others = |way: usize| {
        let ratios = tables.iter().enumerate().filter(|(world, _)| is_other(*world));
        geometric_mean(&ratios.map(|(_, table)| speed(&table[way], &table[0])).collect::<Vec<_>>())
    };
    let takes_part = |way: &usize| !are_winners || *way < 2 || is_other(*way - 2);
    let ways = (0..tables[0].len()).filter(takes_part);
    ways.max_by(|a, b| others(*a).total_cmp(&others(*b))).unwrap_or(0)
}

/// One line on some ratios, with intervals by drawing scenes: worlds of one scene are no independent cases.
fn in_summary(title: &str, values: &[f64], scenes: &[String]) {
    let of_scene = |scene: &String| {
        let own = scenes.iter().zip(values).filter(|(other, _)| *other == scene);
        own.map(|(_, value)| *value).collect::<Vec<_>>()
    };
    let clusters: Vec<_> = scenes.iter().collect::<BTreeSet<_>>().into_iter().map(of_scene).collect();
    let drawn_values =
        |drawn: &[usize]| drawn.iter().flat_map(|at| clusters[*at].clone()).collect::<Vec<_>>();
    let mean = interval(clusters.len(), |drawn| Some(geometric_mean(&drawn_values(drawn))));
    let median = interval(clusters.len(), |drawn| Some(Summary::of(&drawn_values(drawn)).median));
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let (mean, median) = (in_words(mean, 3), in_words(median, 3));
    println!("{title}: geometric mean {mean}, median {median}, least {least:.3}");
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    if arguments.lever == Lever::Sessions {
        return sessions::run(&arguments);
    }
    let preset = if arguments.lever == Lever::Light { Preset::Light } else { Preset::Follow };
    let space = TuningSpace::new(preset, &Premises::all());
    let ways = ways(&arguments, &space)?;
    let (mut tables, mut scenes, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for written in &arguments.worlds {
        let world = world(written, arguments.frames)?;
        let table = measured(&world, &ways, &arguments)?;
        println!("{}", world.name);
        for one in &table {
            let (build, render) = (one.build_ms.median, one.render_ms.median);
            println!("  {:24} {build:8.2} + {render:8.2} ms  {}", one.who, one.gain_over(&table[0]));
        }
        tables.push(table);
        scenes.push(world.scene);
        names.push(world.name);
    }
    println!("world, own way over the untuned, over the best fixed way of other scenes, ceiling over it");
    let (mut over_untuned, mut over_fixed, mut ceilings) = (Vec::new(), Vec::new(), Vec::new());
    for (number, (name, table)) in names.iter().zip(&tables).enumerate() {
        let fixed = &table[best_fixed(&tables, &scenes, number, arguments.winners.is_some())];
        let best = table.iter().max_by(|a, b| speed(a, &table[0]).total_cmp(&speed(b, &table[0])));
        let own = if arguments.winners.is_some() { &table[number + 2] } else { best.unwrap_or(fixed) };
        let ceiling = best.map_or(1.0, |best| speed(best, fixed));
        let shown: [Ratio; 2] = [own.gain_over(&table[0]), own.gain_over(fixed)];
        println!("{name:24} {}   {} ({} over {})   {ceiling:.2}", shown[0], shown[1], own.who, fixed.who);
        over_untuned.push(shown[0].median);
        over_fixed.push(shown[1].median);
        ceilings.push(ceiling);
    }
    for (title, values) in [
        ("over the untuned", over_untuned),
        ("over the best fixed of other scenes", over_fixed),
        ("ceiling over it", ceilings),
    ] {
        in_summary(title, &values, &scenes);
    }
    Ok(())
}

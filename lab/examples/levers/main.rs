//! The gain of choosing a lever's way for each scene, in paired rounds: ways to sample light, ways to follow
//! motion, and trees that serve some frames (see `sessions` and `swap`).
//!
//! `cargo run --release -p treewright-lab --example levers -- --lever light|follow|sessions|swap [--rounds N]
//! [--width N] [--frames N] [--each] [--winners FOLDER] [--session-frames N] [--trials N] [--weigh-gain]
//! [--record FILE] [--add FILE]... WORLD...`
//! A world is a file or `builtin:NAME`; for `follow` a motion (`itself` for scenes that move by themselves)
//! and cycles in an episode stand behind it, as in `builtin:city@sway@0.25`. Another width of pictures,
//! number of threads, or number of triangles makes a world of its own, as in
//! `builtin:city@sway@0.25@160px@1t@x0.5`. All are loaded once before anything is measured, so that a wrong
//! name does not end a long run.
//!
//! Without winners a few ways to follow are compared. With `--each` one parameter at a time is changed from
//! the recommended way, and a second table has what each is worth alone. With a folder of files that
//! `treewright-render tune --objective error|motion --json` wrote, named like the worlds
//! (`city-sway-0.25.json`), every winner runs in every world, and each is compared with the one way that is
//! best in all worlds of other scenes.
//!
//! A campaign can be split, and goes on where it was broken off. Each world's rows are printed, and written
//! to `--record`, as soon as they are there. Worlds that this file or one of `--add` holds are not measured
//! again, and the tables at the end are of all of them.

mod record;
mod sessions;
mod swap;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Parser, ValueEnum};
use serde::{Deserialize, Serialize};
use treewright_lab::converge::bootstrap::{in_words, interval};
use treewright_lab::ways::{
    COLUMNS, EACH_OF_FOLLOW, EACH_OF_LIGHT, Gains, WayTimes, Ways, WorldRow, geometric_mean, named_by_lever,
};
use treewright_lab::worlds::{WIDTH_MIN, World, WrittenWorld};
use treewright_render_cli::arguments::read_configuration;
use treewright_render_cli::output;
use treewright_renderer::frame::Renderer;
use treewright_renderer::integrator::View;
use treewright_renderer::limits::{EPISODE_FRAMES_MAX, ROUNDS_MAX, SIZE_MAX};
use treewright_renderer::measure::{Conditions, Contender, Standing, Yardstick, interleaved, standings};
use treewright_renderer::space::{Choice, LightKinds, Premises, Preset, TuningSpace, parse};
use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::who::Who;
use treewright_scene::Scene;

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
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Lever {
    Light,
    Follow,
    Sessions,
    Swap,
}

/// Measures the gain of choosing a lever's way for each scene.
#[derive(Parser)]
struct Arguments {
    #[arg(long, value_enum, default_value = "light")]
    lever: Lever,
    /// Half of them choose, and the others judge.
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(2..=i64::from(ROUNDS_MAX)))]
    rounds: u32,
    /// Pixels across, four to three down; a world may say otherwise.
    #[arg(long, default_value_t = 320, value_parser = clap::value_parser!(u32).range(i64::from(WIDTH_MIN)..=i64::from(SIZE_MAX)))]
    width: u32,
    /// Frames of an episode.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(2..=i64::from(EPISODE_FRAMES_MAX)))]
    frames: u32,
    /// Changes one parameter at a time.
    #[arg(long)]
    each: bool,
    /// Folder of the results of `treewright-render tune --json`, named like the worlds.
    #[arg(long, conflicts_with = "each")]
    winners: Option<PathBuf>,
    /// Frames of a session, for `sessions` and `swap`.
    #[arg(long, default_value_t = 1024, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    session_frames: u32,
    /// Trials of a state's search in a session; the service's own default is 80.
    #[arg(long, default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=1000))]
    trials: u32,
    /// The service explores in a session only where the expected gain pays for it.
    #[arg(long)]
    weigh_gain: bool,
    /// Writes each world's rows to this file as soon as they are there. Those that it has are not measured
    /// again.
    #[arg(long, value_name = "FILE")]
    record: Option<PathBuf>,
    /// Adds the rows of such a file of another run; may be given several times.
    #[arg(long, value_name = "FILE")]
    add: Vec<PathBuf>,
    /// Each a scene, for `follow` with its motion and cycles, as `builtin:city@sway@0.25`.
    worlds: Vec<WrittenWorld>,
}

impl Arguments {
    /// That all worlds are there, and move if they have to.
    fn check(&self) -> Result<(), Failure> {
        let has_its_own = matches!(self.lever, Lever::Sessions | Lever::Swap);
        if has_its_own && (self.each || self.winners.is_some()) {
            return Err("sessions have structures of their own; leave --each and --winners out".into());
        }
        let mut names = BTreeSet::new();
        for world in &self.worlds {
            let (name, wants_motion) = (world.name(), self.lever == Lever::Follow);
            if !names.insert(name) {
                return Err(format!("{name} is there twice").into());
            }
            if world.is_moving() != wants_motion {
                let wants =
                    if wants_motion { "wants a motion" } else { "has a motion, as for --lever follow" };
                return Err(format!("{name} {wants}").into());
            }
            world.check(self.frames)?;
        }
        Ok(())
    }
}

/// What rows of several runs must have in common.
#[derive(PartialEq, Serialize, Deserialize)]
struct Campaign {
    lever: Lever,
    rounds: u32,
    width: u32,
    frames: u32,
    ways: Vec<(String, Choice)>,
}

/// Named ways, each a configuration; the first is the baseline of the others. The recommended way and changes
/// of it are those of a scene's `own` space. A parameter that it lacks changes nothing.
fn ways(
    arguments: &Arguments,
    space: &TuningSpace,
    own: &TuningSpace,
) -> Result<Vec<(String, Choice)>, Failure> {
    let recommended = own.default_choice();
    // The renderer's defaults: the recommended tree with light by constants, a quick tree for each frame.
    let plain = if arguments.lever == Lever::Light {
        Choice { light: Default::default(), ..recommended }
    } else {
        space.choice(&parse("tree=quick,period=1")?)?
    };
    let mut all = vec![("untuned".to_owned(), plain), ("recommended".to_owned(), recommended)];
    if arguments.each {
        let levers = if arguments.lever == Lever::Light { EACH_OF_LIGHT } else { EACH_OF_FOLLOW };
        for (lever, texts) in levers {
            for text in *texts {
                let changed = own.choice(&parse(text)?).unwrap_or(recommended);
                all.push((named_by_lever(lever, text), changed));
            }
        }
        return Ok(all);
    }
    match &arguments.winners {
        None if arguments.lever == Lever::Light => {
            return Err("--lever light wants --winners or --each".into());
        }
        None => {
            for (name, text) in FOLLOW {
                all.push((name.to_owned(), space.choice(&parse(text)?)?));
            }
        }
        Some(folder) => all.extend(winners(folder, arguments, space)?),
    }
    Ok(all)
}

/// The winners in a folder, all of which run in every world, by the names of their worlds.
fn winners(
    folder: &Path,
    arguments: &Arguments,
    space: &TuningSpace,
) -> Result<Vec<(String, Choice)>, Failure> {
    let entries = std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let paths = entries.map(|entry| entry.map(|entry| entry.path()));
    let mut files = paths.collect::<Result<Vec<PathBuf>, std::io::Error>>()?;
    files.retain(|file| file.extension().is_some_and(|ending| ending == "json"));
    files.sort();
    let mut all: Vec<(String, Choice)> = Vec::new();
    for file in files {
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        all.push((name, space.choice(&read_configuration(&file)?)?));
    }
    match arguments.worlds.iter().find(|world| all.iter().all(|(name, _)| name != world.name())) {
        Some(world) => Err(format!("{} has no winner {}.json", folder.display(), world.name()).into()),
        None => Ok(all),
    }
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
    let mut renderer = Renderer::new(Arc::clone(scene), world.threads)?;
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
    let (size, rounds) = (world.size, arguments.rounds);
    let conditions = Conditions { view, size, rounds, frames_per_build, yardstick };
    Ok(standings(&interleaved(&mut renderer, &contenders, &conditions, || true), frames_per_build))
}

/// A world's rows, of all ways in their order.
fn row(world: &World, table: &[Standing]) -> WorldRow {
    let times = |one: &Standing| WayTimes {
        build_ms: one.build_ms.median,
        render_ms: one.render_ms.median,
        cost_ms: one.undelayed_ms.clone(),
    };
    let ways = table.iter().map(times).collect();
    WorldRow { world: world.name.clone(), scene: world.scene.clone(), ways }
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

/// A line for each world, with the median and the least of all behind them, and then their means.
fn print(ways: &Ways) {
    let gains: Vec<Gains> = (0..ways.rows.len()).map(|world| ways.gains(world)).collect();
    let mut heading = vec!["world", "own way", "best fixed way of other scenes"];
    heading.extend(COLUMNS);
    let mut table = output::table(&heading);
    let in_digits = |ratios: [f64; COLUMNS.len()]| ratios.map(|ratio| format!("{ratio:.3}"));
    for (row, gains) in ways.rows.iter().zip(&gains) {
        let mut cells = vec![row.world.clone(), gains.own.clone(), gains.fixed.clone()];
        cells.extend(in_digits(gains.ratios));
        table.add_row(cells);
    }
    let columns: [Vec<f64>; COLUMNS.len()] =
        std::array::from_fn(|column| gains.iter().map(|gains| gains.ratios[column]).collect());
    let least = |values: &Vec<f64>| values.iter().copied().fold(f64::INFINITY, f64::min);
    let medians = columns.each_ref().map(|values| Summary::of(values).median);
    for (title, ratios) in [("median", medians), ("least", columns.each_ref().map(least))] {
        let mut cells = vec![title.to_owned(), String::new(), String::new()];
        cells.extend(in_digits(ratios));
        table.add_row(cells);
    }
    println!("{table}");
    let scenes: Vec<String> = ways.rows.iter().map(|row| row.scene.clone()).collect();
    for (title, values) in COLUMNS.into_iter().zip(&columns) {
        in_summary(title, values, &scenes);
    }
}

/// A line for each parameter that was changed alone: what choosing its value for each world gains over the
/// one value that is best in the worlds of other scenes.
fn print_levers(ways: &Ways) {
    let mut table =
        output::table(&["parameter alone", "median", "at most", "least", "values that are best somewhere"]);
    for lever in ways.levers() {
        let gains = ways.gains_of(lever);
        let values: Vec<f64> = gains.iter().map(|gains| gains.ratios[0]).collect();
        let most = values.iter().copied().fold(0.0, f64::max);
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let best: BTreeSet<&str> = gains.iter().map(|gains| gains.own.as_str()).collect();
        let ratios = [Summary::of(&values).median, most, least].map(|ratio| format!("{ratio:.3}"));
        let mut cells = vec![lever.to_owned()];
        cells.extend(ratios);
        cells.push(best.len().to_string());
        table.add_row(cells);
    }
    println!("{table}");
}

/// Compares ways to sample light, or to follow motion, in all worlds.
fn compare(arguments: &Arguments) -> Result<(), Failure> {
    let preset = if arguments.lever == Lever::Light { Preset::Light } else { Preset::Follow };
    let space = TuningSpace::new(preset, &Premises::all());
    let &Arguments { lever, rounds, width, frames, .. } = arguments;
    let campaign = Campaign { lever, rounds, width, frames, ways: ways(arguments, &space, &space)? };
    let mut rows = record::measured_before(arguments, &campaign, |row: &WorldRow| row.world.as_str())?;
    for written in &arguments.worlds {
        if rows.iter().any(|row| row.world == written.name()) {
            continue;
        }
        let world = written.load(frames, width)?;
        let lights = LightKinds::of(&world.moments[0]);
        let own = TuningSpace::new(preset, &Premises { lights, ..Premises::all() });
        let table = measured(&world, &ways(arguments, &space, &own)?, arguments)?;
        println!("{}", world.name);
        for one in &table {
            let (build, render) = (one.build_ms.median, one.render_ms.median);
            println!("  {:24} {build:8.2} + {render:8.2} ms  {}", one.who, one.gain_over(&table[0]));
        }
        let row = row(&world, &table);
        record::keep(arguments, &row)?;
        rows.push(row);
    }
    let names: Vec<String> = campaign.ways.into_iter().map(|(name, _)| name).collect();
    let ways = Ways { names: &names, rows: &rows, are_winners: arguments.winners.is_some() };
    print(&ways);
    if arguments.each {
        print_levers(&ways);
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let arguments = Arguments::parse();
    arguments.check()?;
    match arguments.lever {
        Lever::Sessions => sessions::run(&arguments),
        Lever::Swap => swap::run(&arguments),
        Lever::Light | Lever::Follow => compare(&arguments),
    }
}

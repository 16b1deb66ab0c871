//! Whether searches and answers are as good as when they were last recorded, on equal seeds.
//!
//! `cargo run --release -p treewright-lab --example gate` plays every suite and compares each figure with
//! `lab/record/gate.json`, seed by seed. It fails where one is worse by more than three standard errors of
//! the paired differences, or behind a goal that does not move. `-- --record` rewrites the file, after an
//! improvement or for a release; `-- --add` records figures that it lacks, and leaves the others.
//! `-- --search NAME` plays the first three suites with that search in place of the model's.
//!
//! | suite | figure |
//! |---|---|
//! | kernels | share of the optimum after 20, 40 and 80 trials, and of dear trials, over seven landscapes |
//! | renderer | these shares on a model of the renderer's space |
//! | functions | these shares on seven continuous functions of 2, 5 or 10 dimensions |
//! | bowl, wandering, load | true gain of a confirmed search's answer, on a quiet and on disturbed machines |
//! | flat | distance of the reported gain from zero |
//! | contexts | regret where every round brings another context, from rounds 80 and 120 on; also beside 20 indicators that say nothing |
//! | turns | regret in ten states that are visited in turn, from the third visit on |
//! | table | share of the optimum where 63 % of the configurations cannot be run; infeasible trials; answers of a frozen study |
//! | machines | regret on two machines with opposite optima, by fingerprint; never worse than studies of their own; also in rounds 240 to 320 |
//! | changes | frames until an answer that became 10 % dearer is searched again, and whether within ten at 2 % of noise; false alarms in a thousand frames beside other programs |
//! | answers | milliseconds of the best answer after 80, 160 and 320 trials; not recorded, below a bound |

mod answers;
mod changes;
mod contexts;
mod functions;
mod kernels;
mod problem;
mod run;
mod table;
mod trees;
mod world;

use std::{collections::BTreeMap, process::ExitCode, sync::OnceLock};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use treewright_core::{policy::SearchMethod, words::Word as _};

use problem::Problem;
use run::Played;
use world::{Machine, Search, World};

const MARKS: [usize; 3] = [20, 40, 80];
/// Standard errors above which a difference is not by chance.
const ERRORS: f64 = 3.0;
/// Differences below this are none.
const NOTHING: f64 = 1e-4;
/// Figures that no version may fall behind, whatever was recorded last: the mean regret beside twenty
/// indicators that say nothing, where the default has 0.63, and in states that are met again; ten frames
/// until a change is seen, for most also where frames scatter by 2 %, and one false alarm in ten thousand
/// frames.
const GOALS: [(&str, &str, f64); 5] = [
    ("contexts", "beside 20", -0.35),
    ("turns", "from the third visit", -0.2),
    ("changes", "delay", -10.0),
    ("changes", "soon at 2 %", 0.8),
    ("changes", "alarms", -0.1),
];
const RECORD: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/record/gate.json");

/// The figures of one seed, by name; more is better.
type Figures = Vec<(String, f64)>;

struct Suite {
    name: &'static str,
    seeds: u64,
    play: fn(u64) -> Figures,
}

/// The number of suites that play a search alone, the first ones.
const SEARCHED: usize = 3;

const SUITES: [Suite; 12] = [
    Suite { name: "kernels", seeds: 32, play: |seed| searched(kernels_of(seed), seed) },
    Suite { name: "renderer", seeds: 32, play: |seed| searched(vec![trees::problem(seed)], seed) },
    Suite { name: "functions", seeds: 33, play: |seed| searched(functions::problems(seed), seed) },
    Suite { name: "bowl", seeds: 48, play: |seed| gained(World::Bowl, Machine::Quiet, seed) },
    Suite { name: "wandering", seeds: 48, play: |seed| gained(World::Bowl, Machine::Wander, seed) },
    Suite { name: "load", seeds: 48, play: |seed| gained(World::Bowl, Machine::Load, seed) },
    Suite { name: "flat", seeds: 48, play: |seed| gained(World::Flat, Machine::Wander, seed) },
    Suite { name: "contexts", seeds: 24, play: contexts::fresh },
    Suite { name: "turns", seeds: 8, play: contexts::turns },
    Suite { name: "machines", seeds: 24, play: contexts::machines },
    Suite { name: "changes", seeds: 20, play: changes::noticed },
    Suite { name: "table", seeds: 24, play: table::searched },
];

fn kernels_of(seed: u64) -> Vec<Problem> {
    kernels::KERNELS.iter().chain(&kernels::UNSEEN).map(|name| kernels::problem(name, seed)).collect()
}

fn is_given(option: &str) -> bool {
    std::env::args().any(|argument| argument == option)
}

/// The search that the first suites play: the model's, or the one named behind `--search`.
fn method() -> SearchMethod {
    static METHOD: OnceLock<SearchMethod> = OnceLock::new();
    *METHOD.get_or_init(|| {
        let named = std::env::args().skip_while(|argument| argument != "--search").nth(1);
        named.map_or(SearchMethod::Model, |name| {
            SearchMethod::from_word(&name).unwrap_or_else(|| panic!("{name} is no search"))
        })
    })
}

/// Shares of the optimum after each of the marks, and the share of dear trials, as means over problems.
fn searched(problems: Vec<Problem>, seed: u64) -> Figures {
    let runs: Vec<Played> = problems.iter().map(|problem| problem.run(method(), seed, &MARKS)).collect();
    let mean = |of: &dyn Fn(&Played) -> f64| runs.iter().map(of).sum::<f64>() / runs.len() as f64;
    let at = |(place, mark): (usize, &usize)| (format!("at {mark}"), mean(&|run| run.scores[place]));
    let dear = ("dear".to_owned(), -mean(&|run| run.dear));
    MARKS.iter().enumerate().map(at).chain([dear]).collect()
}

/// The true gain of a search with its confirmation; in a flat world the reported gain's distance from zero.
fn gained(world: World, machine: Machine, seed: u64) -> Figures {
    let run = Search { world, machine }.run(seed);
    match world {
        World::Flat => vec![("told".to_owned(), -run.reported.abs())],
        World::Bowl => vec![("true gain".to_owned(), run.truth)],
    }
}

/// Figures of a version by suite and name, each by seed.
#[derive(Default, Serialize, Deserialize)]
struct Record {
    version: String,
    figures: BTreeMap<String, BTreeMap<String, Vec<f64>>>,
}

fn played(suites: &[Suite]) -> Record {
    let mut record = Record { version: env!("CARGO_PKG_VERSION").to_owned(), ..Record::default() };
    for suite in suites {
        let seeds: Vec<Figures> = (0..suite.seeds).into_par_iter().map(suite.play).collect();
        let figures = record.figures.entry(suite.name.to_owned()).or_default();
        for (name, value) in seeds.into_iter().flatten() {
            figures.entry(name).or_default().push((value * 1e6).round() / 1e6);
        }
    }
    record
}

fn recorded() -> Record {
    let text = std::fs::read_to_string(RECORD).unwrap_or_else(|error| panic!("{RECORD}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{RECORD}: {error}"))
}

fn mean_and_error(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

/// Whether the differences are below zero beyond chance.
fn is_worse(differences: &[f64]) -> bool {
    let (mean, error) = mean_and_error(differences);
    mean < -ERRORS * error && mean < -NOTHING
}

/// Prints how long answers take, and counts those that take too long.
fn slow_answers() -> usize {
    let is_slow = |(trials, ms): (u32, f64)| {
        let is_slow = ms > answers::LONGEST_MS;
        let verdict = if is_slow { "  TOO LONG" } else { "" };
        let figure = format!("after {trials}");
        println!("{:<12}{figure:<24}{ms:>10.1} ms{verdict}", "answers");
        is_slow
    };
    answers::times_ms().into_iter().filter(|time| is_slow(*time)).count()
}

fn main() -> ExitCode {
    let suites = if is_given("--search") { SEARCHED } else { SUITES.len() };
    let now = played(&SUITES[..suites]);
    if suites == SUITES.len() && (is_given("--record") || is_given("--add")) {
        let mut now = now;
        if is_given("--add") {
            let before = recorded();
            now.version = before.version;
            for (suite, figures) in before.figures {
                now.figures.entry(suite).or_default().extend(figures);
            }
        }
        let text = serde_json::to_string(&now).expect("plain data").replace("],", "],\n");
        std::fs::write(RECORD, text + "\n").unwrap_or_else(|error| panic!("{RECORD}: {error}"));
        println!("wrote {RECORD}");
        return ExitCode::SUCCESS;
    }
    let before = recorded();
    println!("{:<12}{:<24}{:>10}{:>10}{:>20}", "suite", "figure", before.version, "now", "difference");
    let mut worse = 0;
    for (suite, figures) in &now.figures {
        for (name, values) in figures {
            let earlier = before.figures.get(suite).and_then(|figures| figures.get(name));
            let Some(earlier) = earlier.filter(|earlier| earlier.len() == values.len()) else {
                println!("{suite:<12}{name:<24} is not recorded: -- --add");
                worse += 1;
                continue;
            };
            let differences: Vec<f64> =
                values.iter().zip(earlier).map(|(now, before)| now - before).collect();
            let (mean, error) = mean_and_error(&differences);
            let goal = GOALS.iter().find(|(of, figure, _)| of == suite && figure == name);
            let is_behind = goal.is_some_and(|(.., goal)| mean_and_error(values).0 < *goal);
            let verdict = match (is_worse(&differences), is_behind) {
                (true, _) => "  WORSE",
                (false, true) => "  BEHIND ITS GOAL",
                (false, false) => "",
            };
            worse += usize::from(!verdict.is_empty());
            println!(
                "{suite:<12}{name:<24}{:>10.4}{:>10.4}{mean:>12.4} ± {error:.4}{verdict}",
                mean_and_error(earlier).0,
                mean_and_error(values).0
            );
        }
    }
    // A fingerprint counts as an indicator does: together must not be worse than apart.
    if let Some(machines) = now.figures.get("machines") {
        let pairs = machines["together"].iter().zip(&machines["apart"]);
        if is_worse(&pairs.map(|(one, two)| one - two).collect::<Vec<_>>()) {
            println!("machines: one study is worse than studies of their own");
            worse += 1;
        }
    }
    if suites == SUITES.len() {
        worse += slow_answers();
    }
    if worse == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

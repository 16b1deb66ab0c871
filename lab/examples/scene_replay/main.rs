//! Whether the service's answers are worth having, on recorded scenes: each scene of a book of
//! `treewright-lab leave-scene-out` becomes a landscape, and the tuner that knows the recordings of all
//! others is asked there.
//!
//! ```text
//! cargo run --release -p treewright-lab --example scene_replay -- BOOK [SEEDS [NOISE [WILD]]]
//! ```
//!
//! What a measurement over real frames takes ten minutes for takes one here, and every seed gives another run
//! of the same scene. The landscapes are smoother than the scenes: it compares policies, and proves nothing
//! of a gain. Told is the speed of the answer after so many frames, by its true cost, over the fixed
//! configuration that is best on the other scenes: median, mean and least of all runs. NOISE is the standard
//! deviation of the logarithm of a frame (0.05). Of the frames of native configurations a share WILD (0)
//! costs up to three times as much, as Embree's quick builds do.

mod landscape;
#[path = "../search_quality/problem.rs"]
#[allow(dead_code)]
mod problem;

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use rayon::prelude::*;
use serde::Deserialize;
use treewright_client::{Configuration as Assignment, Policy};
use treewright_core::configuration::{Configuration, RawConfiguration};
use treewright_core::space::Space;
use treewright_core::study::StudySpec;
use treewright_core::trial::Outcome;
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;
use treewright_renderer::frame::FrameTimes;
use treewright_renderer::space::{Premises, Preset, TuningSpace};
use treewright_renderer::statistics::Summary;
use treewright_renderer::tuning::objective::{Objective, specification};

use landscape::{Landscape, Recorded};
use problem::normal;

/// After so many frames the best is asked for; 0 is the first answer.
const AFTER: [usize; 5] = [0, 8, 16, 32, 60];

#[derive(Deserialize)]
struct Book {
    scenes: BTreeMap<String, serde_json::Value>,
    searches: BTreeMap<String, Search>,
    rounds: BTreeMap<String, Rounds>,
}

#[derive(Deserialize)]
struct Search {
    state: BTreeMap<String, f64>,
    trials: Vec<SearchTrial>,
    answers: BTreeMap<u32, Assignment>,
}

#[derive(Deserialize)]
struct SearchTrial {
    configuration: Assignment,
    times: Option<FrameTimes>,
}

#[derive(Deserialize)]
struct Rounds {
    contenders: Vec<Contender>,
}

#[derive(Deserialize)]
struct Contender {
    configuration: Option<Assignment>,
    build_ms: Vec<f64>,
    render_ms: Vec<f64>,
    failure: Option<String>,
}

/// One scene of the book.
struct Scene {
    name: String,
    state: BTreeMap<String, f64>,
    /// What ran in it, with the cost of each.
    ran: Vec<(Configuration, f64)>,
    /// What others are told of it, one frame after the other.
    frames: Vec<(Configuration, f64)>,
    /// What ran on every scene.
    candidates: Vec<Configuration>,
    /// What its own search answered.
    found: Vec<Configuration>,
    landscape: Landscape,
}

fn median(values: &[f64]) -> f64 {
    Summary::of(values).median
}

/// A recorded configuration in the space of now: parameters that came later have the value that was built in
/// then.
fn configuration(space: &Space, mut raw: RawConfiguration) -> Option<Configuration> {
    if let Ok(configuration) = space.configuration(raw.clone()) {
        return Some(configuration);
    }
    raw.insert("child_order".to_owned(), Value::Text("builder".to_owned()));
    space.configuration(raw).ok()
}

fn scenes(book: &Book, space: &Space, objective: Objective) -> Vec<Scene> {
    let per_build = f64::from(objective.frames_per_build());
    let mut all = Vec::new();
    for name in book.scenes.keys() {
        let of = |kind: &str| format!("{kind} {} {name} 2@320x240", objective.name());
        let mut ran: Vec<(Configuration, f64)> = Vec::new();
        let mut recorded: Vec<Recorded> = Vec::new();
        let mut frames = Vec::new();
        let mut state = None;
        let mut found: Vec<Configuration> = Vec::new();
        for key in [of("alone"), of("left-out")] {
            let Some(search) = book.searches.get(&key) else { continue };
            state = Some(search.state.clone());
            if key == of("alone") {
                let answers = search.answers.values();
                found.extend(answers.filter_map(|answer| configuration(space, answer.clone().into())));
            }
            for trial in &search.trials {
                let known = configuration(space, trial.configuration.clone().into());
                if let (Some(configuration), Some(times)) = (known, trial.times) {
                    let cost = times.build_ms / per_build + times.render_ms;
                    ran.push((configuration.clone(), cost));
                    if key == of("alone") {
                        frames.push((configuration, cost));
                    }
                }
            }
        }
        let Some(state) = state else { continue };
        // Rounds and searches ran at different times: what ran in both sets their levels equal.
        let searched = costs(&ran);
        let mut candidates = Vec::new();
        if let Some(rounds) = book.rounds.get(&of("candidates")) {
            let mut of_rounds = Vec::new();
            let most = rounds.contenders.iter().map(|one| one.render_ms.len()).max().unwrap_or(0);
            for (round, one) in
                (0..most).flat_map(|round| rounds.contenders.iter().map(move |one| (round, one)))
            {
                let known = one.configuration.clone().and_then(|raw| configuration(space, raw.into()));
                let times = one.build_ms.get(round).or(one.build_ms.last()).zip(one.render_ms.get(round));
                if let (None, Some(configuration), Some((build_ms, render_ms))) = (&one.failure, known, times)
                {
                    frames.push((configuration, build_ms / per_build + render_ms));
                }
            }
            for one in rounds.contenders.iter().filter(|one| one.failure.is_none()) {
                let known = one.configuration.clone().and_then(|raw| configuration(space, raw.into()));
                let (Some(configuration), false) = (known, one.render_ms.is_empty()) else { continue };
                let cost = median(&one.build_ms) / per_build + median(&one.render_ms);
                of_rounds.push((configuration, cost, one.render_ms.len() as f64));
            }
            let shifts: Vec<f64> = of_rounds
                .iter()
                .filter_map(|(configuration, cost, _)| {
                    let known = searched.iter().find(|known| known.configuration == *configuration)?;
                    Some(known.log_cost - cost.ln())
                })
                .collect();
            let shift = if shifts.is_empty() { 0.0 } else { median(&shifts) };
            for (configuration, cost, frames) in of_rounds {
                candidates.push(configuration.clone());
                ran.push((configuration.clone(), cost * shift.exp()));
                recorded.push(Recorded { configuration, log_cost: cost.ln() + shift, frames });
            }
        }
        recorded.extend(searched);
        let landscape = Landscape::of(space, &recorded);
        all.push(Scene { name: name.clone(), state, ran, frames, candidates, found, landscape });
    }
    all
}

/// The mean of what each configuration cost.
fn costs(ran: &[(Configuration, f64)]) -> Vec<Recorded> {
    let mut all: BTreeMap<&Configuration, Vec<f64>> = BTreeMap::new();
    ran.iter().for_each(|(configuration, cost)| all.entry(configuration).or_default().push(cost.ln()));
    all.into_iter()
        .map(|(configuration, logs)| Recorded {
            configuration: configuration.clone(),
            log_cost: logs.iter().sum::<f64>() / logs.len() as f64,
            frames: logs.len() as f64,
        })
        .collect()
}

/// Whether only the search of one scene found a configuration: the others do not know of it then, although it
/// ran there.
fn is_found_only_in(scenes: &[Scene], place: usize, configuration: &Configuration) -> bool {
    let mut finders = scenes.iter().enumerate().filter(|(_, scene)| scene.found.contains(configuration));
    finders.next().is_some_and(|(first, _)| first == place) && finders.next().is_none()
}

/// What ran everywhere and is best on the others.
fn fixed_of_others(scenes: &[Scene], without: usize) -> &Configuration {
    let others = || scenes.iter().enumerate().filter(move |(place, _)| *place != without).map(|(_, one)| one);
    let on_all = others().next().expect("several scenes").candidates.iter();
    let on_all = on_all.filter(|one| others().all(|scene| scene.candidates.contains(one)));
    let on_all = on_all.filter(|one| !is_found_only_in(scenes, without, one));
    let cost = |one: &Configuration| others().map(|scene| scene.landscape.cost(one).ln()).sum::<f64>();
    on_all.min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("a candidate that ran everywhere")
}

struct Run {
    /// Speed over the fixed configuration after so many frames, and of the best that anything reaches there.
    over_fixed: [f64; AFTER.len()],
    /// The same of the truly best among all that was tried by then.
    tried: [f64; AFTER.len()],
    roofline: f64,
}

fn run(spec: &StudySpec, scenes: &[Scene], place: usize, (seed, noise, wild): (u64, f64, f64)) -> Run {
    let mut random = ChaCha8Rng::seed_from_u64(7000 + seed);
    let spec = StudySpec { seed: spec.seed + seed, ..spec.clone() };
    let mut tuner = Tuner::new(Arc::new(spec)).expect("a study");
    let metrics = |cost: f64| BTreeMap::from([("frame_ms".to_owned(), cost)]);
    let mut now_ms = 0;
    for other in scenes.iter().enumerate().filter(|(other, _)| *other != place).map(|(_, scene)| scene) {
        let ask = Ask { client_id: "teacher".into(), indicators: other.state.clone(), ..Ask::default() };
        let known = other.frames.iter().filter(|(one, _)| !is_found_only_in(scenes, place, one));
        for (configuration, cost) in known {
            now_ms += 1;
            let (trial, _) =
                tuner.suggest_wanted(&ask, configuration.to_raw(), now_ms).expect("of the space");
            let _change = tuner.report(&trial, metrics(*cost), Outcome::Ok, now_ms).expect("a report");
        }
    }
    let scene = &scenes[place];
    let fixed = scene.landscape.cost(fixed_of_others(scenes, place));
    let indicators: BTreeMap<String, f64> = scene.state.clone();
    let ask = Ask { client_id: "renderer".into(), indicators: indicators.clone(), ..Ask::default() };
    let first = tuner.predict(&indicators, None).expect("an answer").configuration;
    let mut over_fixed = [fixed / scene.landscape.cost(&first); AFTER.len()];
    let mut least = fixed.min(scene.landscape.cost(&first));
    let mut tried = over_fixed;
    let last = AFTER[AFTER.len() - 1];
    for frame in 1..=last {
        now_ms += 1;
        let (trial, _) = tuner.suggest(&ask, now_ms).expect("a trial");
        let truth = scene.landscape.cost(&trial.configuration);
        least = least.min(truth);
        let mut cost = truth * (noise * normal(&mut random)).exp();
        let is_native = trial.configuration.get("backend") == Some(&Value::Text("native".into()));
        if is_native && random.random::<f64>() < wild {
            cost *= 1.2 + 1.8 * random.random::<f64>();
        }
        let _change = tuner.report(&trial, metrics(cost), Outcome::Ok, now_ms).expect("a report");
        if let Some(at) = AFTER.iter().position(|&after| after == frame) {
            let best = tuner.best(Some(&indicators), None).expect("valid").expect("measured");
            over_fixed[at] = fixed / scene.landscape.cost(&best.configuration);
            tried[at] = fixed / least;
        }
    }
    for known in scene.candidates.iter().chain(scene.ran.iter().map(|(configuration, _)| configuration)) {
        least = least.min(scene.landscape.cost(known));
    }
    Run { over_fixed, tried, roofline: fixed / least }
}

fn geometric_mean(values: &[f64]) -> f64 {
    (values.iter().map(|value| value.ln()).sum::<f64>() / values.len() as f64).exp()
}

/// One line of the table: something of the runs' speeds after so many frames, and of their rooflines.
fn line(name: &str, runs: &[&Run], of: fn(&[f64]) -> f64) {
    print!("{name:18}");
    for at in 0..AFTER.len() {
        print!("{:9.3}", of(&runs.iter().map(|run| run.over_fixed[at]).collect::<Vec<f64>>()));
    }
    println!("{:9.3}", of(&runs.iter().map(|run| run.roofline).collect::<Vec<f64>>()));
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments.first().expect("a book of `treewright-lab leave-scene-out`");
    let seeds: u64 = arguments.get(1).map_or(5, |text| text.parse().expect("a number"));
    let noise: f64 = arguments.get(2).map_or(0.05, |text| text.parse().expect("a number"));
    let wild: f64 = arguments.get(3).map_or(0.0, |text| text.parse().expect("a number"));
    let text = std::fs::read_to_string(path).expect("a book that can be read");
    let book: Book = serde_json::from_str(&text).expect("a book");
    for objective in [Objective::Render, Objective::Total] {
        let premises = Premises {
            builds_each_frame: objective.builds_each_frame(),
            animated: false,
            instanced: false,
            threads: 2,
            ..Premises::all()
        };
        let space = TuningSpace::new(Preset::Full, &premises);
        let policy = Policy::new().epsilon(1.0).trials_per_state(AFTER[AFTER.len() - 1] as u32);
        let asked = specification(&space, objective, policy).expect("a specification");
        let terms =
            vec![treewright_core::objective::ObjectiveTerm { metric: "frame_ms".into(), weight: 1.0 }];
        let spec = StudySpec {
            objective: treewright_core::objective::Objective::new(terms).expect("valid"),
            ..asked.with_policy(treewright_core::policy::Policy {
                epsilon: 1.0,
                trials_per_state: AFTER[AFTER.len() - 1] as u32,
                ..treewright_core::policy::Policy::default()
            })
        };
        let scenes = scenes(&book, space.space(), objective);
        println!(
            "{} time, {} scenes, {seeds} seeds, noise {noise}, wild {wild}",
            objective.name(),
            scenes.len()
        );
        print!("{:18}", "after");
        AFTER.iter().for_each(|after| print!("{after:>9}"));
        println!("{:>9}", "roofline");
        let jobs: Vec<(usize, u64)> =
            (0..scenes.len()).flat_map(|place| (0..seeds).map(move |seed| (place, seed))).collect();
        let runs: Vec<(usize, Run)> = jobs
            .par_iter()
            .map(|&(place, seed)| (place, run(&spec, &scenes, place, (seed, noise, wild))))
            .collect();
        for (place, scene) in scenes.iter().enumerate() {
            let own: Vec<&Run> = runs.iter().filter(|(of, _)| *of == place).map(|(_, run)| run).collect();
            line(&scene.name, &own, geometric_mean);
        }
        let all: Vec<&Run> = runs.iter().map(|(_, run)| run).collect();
        print!("{:18}", "best tried");
        for at in 0..AFTER.len() {
            print!("{:9.3}", median(&all.iter().map(|run| run.tried[at]).collect::<Vec<f64>>()));
        }
        println!();
        line("median", &all, median);
        line("geometric mean", &all, geometric_mean);
        line("least", &all, |values| values.iter().copied().fold(f64::INFINITY, f64::min));
    }
}

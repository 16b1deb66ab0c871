//! A compressor's settings, 63 % of which cannot be used: the output must not exceed a limit.

use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::policy::{Operation, Policy};
use treewright_core::{configuration::Configuration, space::Space, trial::Trial, tuner::Tuner, value::Value};
use treewright_lab::simulated::{ask, normal, report, study};

use crate::Figures;

const STRATEGIES: [&str; 5] = ["default", "filtered", "huffman_only", "rle", "fixed"];
/// The share of the configurations that are not allowed.
const FAILING: f64 = 0.63;
const NOISE: f64 = 0.03;
const MARKS: [usize; 3] = [20, 40, 80];

type Settings = [i64; 4];

/// About what zlib does with text: higher levels are dearer and smaller, larger windows help a little, and
/// two strategies find no matches. Size and cost, by the state.
fn formula([level, memory, strategy, window]: Settings, state: f64) -> (f64, f64) {
    let matches = match strategy {
        0 | 1 => 1.0,
        4 => 0.85,
        3 => 0.12,
        _ => 0.0,
    };
    let effort = (level - 1) as f64 / 8.0;
    let reach = ((window - 9) as f64 / 6.0).powf(0.6 + state);
    let table = 1.0 - 0.12 * (9 - memory) as f64 / 8.0;
    let size = 0.62 - matches * (0.16 + 0.10 * effort.powf(0.4) + 0.16 * reach * table);
    let search = 1.0 + 6.0 * effort.powf(1.8 + state) * (0.4 + 0.6 * reach);
    let slow = 1.0 + 0.1 * ((memory - 6).abs() as f64);
    (size, (2.0 + matches * search) * slow * if strategy == 4 { 0.9 } else { 1.0 })
}

/// Which sizes are allowed, and the least cost of those.
struct Table {
    state: f64,
    limit: f64,
    least: f64,
}

impl Table {
    fn of(state: f64) -> Self {
        let all = (1..=9).flat_map(|level| (1..=9).map(move |memory| (level, memory)));
        let all = all.flat_map(|(level, memory)| (0..5).map(move |strategy| (level, memory, strategy)));
        let all =
            all.flat_map(|(level, memory, strategy)| (9..=15).map(move |w| [level, memory, strategy, w]));
        let mut rows: Vec<(f64, f64)> = all.map(|settings| formula(settings, state)).collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let limit = rows[((1.0 - FAILING) * rows.len() as f64) as usize].0;
        let allowed = rows.iter().filter(|row| row.0 <= limit).map(|row| row.1);
        Table { state, limit, least: allowed.fold(f64::INFINITY, f64::min) }
    }

    /// The cost of a configuration; `None` where it is not allowed.
    fn cost(&self, configuration: &Configuration) -> Option<f64> {
        let number = |name: &str| match configuration.get(name) {
            Some(Value::Integer(number)) => *number,
            Some(Value::Text(text)) => STRATEGIES.iter().position(|name| name == text).unwrap_or(0) as i64,
            _ => 0,
        };
        let (size, cost) = formula(["level", "memory", "strategy", "window"].map(number), self.state);
        (size <= self.limit).then_some(cost)
    }
}

fn tuner(policy: Policy, seed: u64) -> Tuner {
    let space = Space::builder().integer("level", 1..=9).default(6).integer("memory", 1..=9).default(8);
    let space = space.categorical("strategy", STRATEGIES).default("default");
    let space = space.integer("window", 9..=15).default(15).build().expect("a valid space");
    let spec = study(space, std::iter::once("x".to_owned()), policy, seed);
    Tuner::new(Arc::new(spec)).expect("a valid study")
}

/// One frame: the trial, and its true cost where it can be run.
fn frame(tuner: &mut Tuner, random: &mut ChaCha8Rng, table: &Table, x: f64) -> (Trial, Option<f64>) {
    let trial = tuner.suggest(&ask([("x", x)]), 0).expect("a valid question").0;
    let truth = table.cost(&trial.configuration);
    report(tuner, &trial, truth.map(|cost| cost * (NOISE * normal(random)).exp()));
    (trial, truth)
}

/// The optimum over the best after each mark, the trials that could not run, and whether answers work.
pub(crate) fn searched(seed: u64) -> Figures {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let policy = Policy { epsilon: 1.0, confirm_rounds: 0, track_speed: false, ..Policy::default() };
    let (table, mut searching) = (Table::of(0.0), tuner(policy, seed));
    let (mut failed, mut best, mut figures) = (0.0, f64::INFINITY, Figures::new());
    for trial in 1..=MARKS[2] {
        match frame(&mut searching, &mut random, &table, 0.5).1 {
            Some(cost) => best = best.min(cost),
            None => failed += 1.0,
        }
        if MARKS.contains(&trial) {
            figures.push((format!("at {trial}"), table.least / best));
        }
    }
    figures.push(("failed".to_owned(), -failed));
    let policy = Policy { epsilon: 1.0, ..Policy::default() };
    let (other, mut tuner) = (Table::of(0.3), tuner(policy.clone(), seed));
    (0..80).for_each(|_| drop(frame(&mut tuner, &mut random, &table, 0.2)));
    (0..10 + 10 * (seed % 4)).for_each(|_| drop(frame(&mut tuner, &mut random, &other, 0.8)));
    let lacks_models = tuner.set_policy(Policy { operation: Operation::Freeze, ..policy }).expect("valid");
    assert!(!lacks_models, "the predictor does not change");
    let frozen = frame(&mut tuner, &mut random, &other, 0.8).1;
    figures.push(("frozen".to_owned(), frozen.map_or(0.0, |cost| other.least / cost)));
    figures
}

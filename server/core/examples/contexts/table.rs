//! A table of a compressor's settings, most of which are not allowed.

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::indicator::{Indicator, IndicatorSchema};
use treewright_core::objective::{Objective, ObjectiveTerm};
use treewright_core::policy::{Operation, Policy};
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;

use super::world::normal;

const STRATEGIES: [&str; 5] = ["default", "filtered", "huffman_only", "rle", "fixed"];
/// The share of the configurations that are not allowed.
const FAILING: f64 = 0.63;

type Settings = [i64; 4];

/// Sizes and costs of all settings.
struct Table {
    rows: BTreeMap<Settings, (f64, f64)>,
    limit: f64,
}

/// About what zlib does with text: higher levels are dearer and smaller, larger windows help a little, and
/// two strategies find no matches.
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

impl Table {
    fn new(rows: BTreeMap<Settings, (f64, f64)>) -> Self {
        let mut sizes: Vec<f64> = rows.values().map(|(size, _)| *size).collect();
        sizes.sort_by(f64::total_cmp);
        let limit = sizes[((1.0 - FAILING) * sizes.len() as f64) as usize];
        Table { rows, limit }
    }

    fn of(file: &str, state: f64) -> Self {
        if !file.is_empty() {
            let text = std::fs::read_to_string(file).expect("a table");
            let row = |line: &str| {
                let numbers: Vec<f64> = line.split(',').filter_map(|cell| cell.trim().parse().ok()).collect();
                let settings = std::array::from_fn(|place| numbers[place] as i64);
                (settings, (numbers[4], numbers[5]))
            };
            return Table::new(text.lines().filter(|line| line.matches(',').count() == 5).map(row).collect());
        }
        let all = (1..=9).flat_map(|level| (1..=9).map(move |memory| (level, memory)));
        let all = all.flat_map(|(level, memory)| (0..5).map(move |strategy| (level, memory, strategy)));
        let all = all.flat_map(|(level, memory, strategy)| {
            (9..=15).map(move |window| [level, memory, strategy, window])
        });
        Table::new(all.map(|settings| (settings, formula(settings, state))).collect())
    }

    /// The cost of a configuration; `None` where it is not allowed.
    fn cost(&self, configuration: &Configuration) -> Option<f64> {
        let number = |name: &str| match configuration.get(name) {
            Some(Value::Integer(number)) => *number,
            Some(Value::Text(text)) => STRATEGIES.iter().position(|name| name == text).unwrap_or(0) as i64,
            _ => 0,
        };
        let (size, cost) = self.rows[&["level", "memory", "strategy", "window"].map(number)];
        (size <= self.limit).then_some(cost)
    }

    fn least(&self) -> f64 {
        let allowed = self.rows.values().filter(|(size, _)| *size <= self.limit);
        allowed.map(|(_, cost)| *cost).fold(f64::INFINITY, f64::min)
    }
}

fn study(policy: Policy, seed: u64) -> Tuner {
    let parameter =
        |name: &str, domain, default| Parameter { name: name.into(), domain, default, active_if: None };
    let integer = |min, max| Domain::Integer { min, max, scale: Scale::Linear };
    let strategies = Domain::Categorical { values: STRATEGIES.map(|name| Value::Text(name.into())).to_vec() };
    let space = Space::new(
        vec![
            parameter("level", integer(1, 9), Value::Integer(6)),
            parameter("memory", integer(1, 9), Value::Integer(8)),
            parameter("strategy", strategies, Value::Text("default".into())),
            parameter("window", integer(9, 15), Value::Integer(15)),
        ],
        vec![],
    );
    let indicator = Indicator { name: "x".into(), min: 0.0, max: 1.0, scale: Scale::Linear };
    let term = ObjectiveTerm { metric: "ms".into(), weight: 1.0 };
    let spec = StudySpec {
        display_name: "table".into(),
        space: space.expect("a valid space"),
        indicators: IndicatorSchema::new(vec![indicator]).expect("valid"),
        objective: Objective::new(vec![term]).expect("valid"),
        state_tolerance: 0.05,
        policy,
        seed,
    };
    Tuner::new(Arc::new(spec)).expect("a valid study")
}

/// One frame: the trial, and its true cost where it can be run.
fn frame(
    tuner: &mut Tuner,
    random: &mut ChaCha8Rng,
    table: &Table,
    x: f64,
    noise: f64,
) -> (Trial, Option<f64>) {
    let ask =
        Ask { client_id: "a".into(), indicators: BTreeMap::from([("x".to_owned(), x)]), ..Ask::default() };
    let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
    let truth = table.cost(&trial.configuration);
    let (measurements, outcome) = match truth {
        Some(cost) => {
            let cost = cost * (noise * normal(random)).exp();
            (BTreeMap::from([("ms".to_owned(), cost)]), Outcome::Ok)
        }
        None => (BTreeMap::new(), Outcome::Infeasible { reason: "too large".into() }),
    };
    let _change = tuner.report(&trial, measurements, outcome, 1).expect("a valid report");
    (trial, truth)
}

/// Trials that failed, and the optimum over the best that ran, after 10, 20, 40 and 80 configurations.
pub(crate) fn search(seeds: u64, file: &str) -> String {
    let table = Table::of(file, 0.0);
    let mut lines = Vec::new();
    for noise in [0.0, 0.03] {
        let (mut failed, mut share) = ([0.0; 4], [0.0; 4]);
        for seed in 0..seeds {
            let policy = Policy { epsilon: 1.0, confirm_rounds: 0, track_speed: false, ..Policy::default() };
            let mut tuner = study(policy, seed);
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let (mut fails, mut best) = (0.0, f64::INFINITY);
            for trial in 1..=80 {
                match frame(&mut tuner, &mut random, &table, 0.5, noise).1 {
                    Some(cost) => best = best.min(cost),
                    None => fails += 1.0,
                }
                if let Some(place) = [10, 20, 40, 80].iter().position(|at| *at == trial) {
                    failed[place] += fails / seeds as f64;
                    share[place] += table.least() / best / seeds as f64;
                }
            }
        }
        lines.push(format!("noise {noise}: failed {failed:.1?}, optimum over best {share:.3?}"));
    }
    lines.join("; ")
}

/// Answers of a frozen study: how many were never measured in their state, and how many fail there.
pub(crate) fn frozen(file: &str) -> String {
    let mut lines = Vec::new();
    for noise in [0.03, 0.25] {
        let (mut untested, mut failing, mut worlds, mut excess) = (0, 0, 0, 0.0);
        for (world, trials) in (0..24).map(|world| (world, [10, 20, 30, 40][world % 4])) {
            let (first, second) =
                (Table::of(file, 0.0), Table::of(file, if file.is_empty() { 0.3 } else { 0.0 }));
            let policy = Policy { epsilon: 1.0, ..Policy::default() };
            let mut tuner = study(policy.clone(), world as u64);
            let mut random = ChaCha8Rng::seed_from_u64(world as u64);
            (0..80).for_each(|_| drop(frame(&mut tuner, &mut random, &first, 0.2, noise)));
            let mut ran = Vec::new();
            for _ in 0..trials {
                let (trial, truth) = frame(&mut tuner, &mut random, &second, 0.8, noise);
                if truth.is_some() {
                    ran.push(trial.configuration);
                }
            }
            let frozen = Policy { operation: Operation::Freeze, ..policy };
            assert!(!tuner.set_policy(frozen).expect("valid"));
            let (trial, truth) = frame(&mut tuner, &mut random, &second, 0.8, noise);
            worlds += 1;
            untested += usize::from(!ran.contains(&trial.configuration));
            failing += usize::from(truth.is_none());
            excess += truth.map_or(0.0, |cost| cost / second.least());
        }
        let runs = (worlds - failing).max(1) as f64;
        lines.push(format!("noise {noise}: of {worlds} answers {untested} untested, {failing} fail, others {:.3} of the optimum", excess / runs));
    }
    lines.join("; ")
}

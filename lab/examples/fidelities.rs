//! The worth of a cheaper level: how many full trials a search spends until a configuration within 5 % of the
//! optimum ran in full, with the level and without it, by how far the level agrees with full trials.
//!
//! `cargo run --release -p treewright-lab --example fidelities -- [SEEDS]` plays two landscapes of six
//! parameters, of which none or three are choices. The logarithms of the costs at the level and in full have
//! the given correlation over the space. A search that does not get there counts as its whole budget. Beside
//! each row stands that of the first attempt, a ladder by ranks, as it was measured with 40 seeds.

use std::sync::Arc;

use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use treewright_core::configuration::Configuration;
use treewright_core::fidelity::Fidelity;
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Space};
use treewright_core::study::StudySpec;
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::value::Value;
use treewright_lab::simulated::{normal, report, share, study};

const AXES: usize = 6;
const CHOICES: usize = 8;
/// Full trials of a search.
const BUDGET: f64 = 80.0;
/// The level's name, and the noise of full trials and of its own.
const LEVEL: &str = "small";
const NOISE: f64 = 0.02;
const NOISE_OF_LEVEL: f64 = 0.04;
/// A configuration within 5 % of the optimum, whose cost is 1.
const NEAR: f64 = 1.05;
/// Points by which a landscape is scaled.
const SAMPLES: usize = 2_000;
const SEEDS: u64 = 64;

/// The rows with a level: choices, its correlation and its cost, and the median and the mean of the ladder by
/// ranks.
const ROWS: [(usize, f64, f64, f64, f64); 12] = [
    (0, 0.95, 0.1, 18.1, 21.9),
    (0, 0.95, 0.3, 22.3, 26.1),
    (0, 0.7, 0.1, 20.7, 26.8),
    (0, 0.7, 0.3, 24.9, 31.3),
    (0, 0.0, 0.1, 21.7, 24.1),
    (0, 0.0, 0.3, 23.1, 27.1),
    (3, 0.95, 0.1, 42.1, 47.3),
    (3, 0.95, 0.3, 61.9, 53.4),
    (3, 0.7, 0.1, 38.2, 46.6),
    (3, 0.7, 0.3, 48.6, 53.8),
    (3, 0.0, 0.1, 43.3, 50.3),
    (3, 0.0, 0.3, 59.4, 54.2),
];

/// The logarithm of a cost: a parabola along each axis of numbers, a table along each axis of choices.
struct Landscape {
    steepness: [f64; AXES],
    best: [f64; AXES],
    tables: [[f64; CHOICES]; AXES],
    choices: usize,
}

/// A place of a configuration: the value of a number, the index of a choice.
type Place = [f64; AXES];

impl Landscape {
    fn drawn(choices: usize, random: &mut ChaCha8Rng) -> Self {
        let mut tables = [[0.0; CHOICES]; AXES];
        for table in &mut tables {
            table.iter_mut().for_each(|value| *value = random.random::<f64>());
            table[random.random_range(0..CHOICES)] = 0.0;
        }
        Landscape {
            steepness: [(); AXES].map(|()| 0.5 + 2.0 * random.random::<f64>()),
            best: [(); AXES].map(|()| 0.1 + 0.8 * random.random::<f64>()),
            tables,
            choices,
        }
    }

    fn log_cost(&self, place: &Place) -> f64 {
        let of = |axis: usize| match axis < self.choices {
            true => 0.4 * self.tables[axis][place[axis] as usize],
            false => self.steepness[axis] * (place[axis] - self.best[axis]).powi(2),
        };
        (0..AXES).map(of).sum()
    }

    /// Mean and deviation over the space.
    fn moments(&self, random: &mut ChaCha8Rng) -> (f64, f64) {
        let mut draw = |axis: usize| match axis < self.choices {
            true => random.random_range(0..CHOICES) as f64,
            false => random.random::<f64>(),
        };
        let costs: Vec<f64> = (0..SAMPLES).map(|_| self.log_cost(&std::array::from_fn(&mut draw))).collect();
        let mean = costs.iter().sum::<f64>() / SAMPLES as f64;
        let squares = costs.iter().map(|cost| (cost - mean).powi(2)).sum::<f64>();
        (mean, (squares / SAMPLES as f64).sqrt())
    }
}

fn space(choices: usize) -> Space {
    let words = || (0..CHOICES).map(|index| Value::from(format!("c{index}").as_str())).collect();
    let one = |axis: usize| -> Parameter {
        match axis < choices {
            true => Parameter::new(format!("p{axis}"), Domain::Categorical { values: words() }, "c0"),
            false => share(format!("p{axis}")),
        }
    };
    Space::new((0..AXES).map(one).collect(), Vec::new()).expect("a valid space")
}

fn place(configuration: &Configuration) -> Place {
    std::array::from_fn(|axis| match configuration.get(&format!("p{axis}")) {
        Some(Value::Text(word)) => word[1..].parse().expect("an index"),
        value => value.and_then(Value::as_number).expect("a number"),
    })
}

/// The cost of a search until it is near the optimum, and its number of full trials; the budget where it does
/// not get there.
fn spent(choices: usize, correlation: f64, level_cost: Option<f64>, seed: u64) -> (f64, usize) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (truth, other) = (Landscape::drawn(choices, &mut random), Landscape::drawn(choices, &mut random));
    let (mean, deviation) = truth.moments(&mut random);
    let (other_mean, other_deviation) = other.moments(&mut random);
    let policy = Policy { epsilon: 1.0, trials_per_state: BUDGET as u32, ..Policy::default() };
    let spec = study(space(choices), std::iter::empty(), policy, seed);
    let level = level_cost.map(|cost| Fidelity { name: LEVEL.to_owned(), cost });
    let objective = spec.objective.clone().with_fidelities(level.into_iter().collect()).expect("valid");
    let mut tuner = Tuner::new(Arc::new(StudySpec { objective, ..spec })).expect("a valid study");
    let ask = Ask { client_id: "a".to_owned(), fidelities: true, ..Ask::default() };
    let (mut spent, mut full) = (0.0, 0);
    while spent < BUDGET {
        let trial = tuner.suggest(&ask, 0).expect("a trial").0;
        let at = place(&trial.configuration);
        let log_cost = truth.log_cost(&at);
        let cost = match (&trial.decision.fidelity, level_cost) {
            (Some(_), Some(share)) => {
                spent += share;
                let (own, others) =
                    ((log_cost - mean) / deviation, (other.log_cost(&at) - other_mean) / other_deviation);
                let both = correlation * own + (1.0 - correlation.powi(2)).sqrt() * others;
                share * (mean + deviation * both + NOISE_OF_LEVEL * normal(&mut random)).exp()
            }
            _ => {
                spent += 1.0;
                full += 1;
                if log_cost.exp() <= NEAR {
                    return (spent, full);
                }
                (log_cost + NOISE * normal(&mut random)).exp()
            }
        };
        report(&mut tuner, &trial, Some(cost));
    }
    (BUDGET, full)
}

/// Median, mean, the share that got there, and the mean number of full trials.
fn summary(mut spent: Vec<(f64, usize)>) -> String {
    spent.sort_by(|a, b| a.0.total_cmp(&b.0));
    let count = spent.len() as f64;
    let reached = spent.iter().filter(|spent| spent.0 < BUDGET).count() as f64 / count;
    let mean = spent.iter().map(|spent| spent.0).sum::<f64>() / count;
    let full = spent.iter().map(|spent| spent.1).sum::<usize>() as f64 / count;
    format!("{:>8.1}{mean:>8.1}{:>8.0} %{full:>8.1}", spent[spent.len() / 2].0, 100.0 * reached)
}

fn main() {
    let seeds = std::env::args().nth(1).map_or(SEEDS, |text| text.parse().expect("a number of seeds"));
    let play = |choices: usize, correlation: f64, cost: Option<f64>| {
        let all = (0..seeds).into_par_iter().map(|seed| spent(choices, correlation, cost, seed));
        summary(all.collect())
    };
    println!("full trials until within 5 % of the optimum, {seeds} seeds, {BUDGET} at most");
    let head = ["correlation", "cost", "median", "mean", "reached", "full", "ladder", "mean"];
    let [correlation, cost, median, mean, reached, full, ladder, old] = head;
    println!(
        "{:<10}{correlation:>12}{cost:>8}{median:>8}{mean:>8}{reached:>10}{full:>8}{ladder:>10}{old:>8}",
        "choices"
    );
    for choices in [0, 3] {
        println!("{choices:<10}{:>12}{:>8}{}", "no level", "", play(choices, 0.0, None));
        for (_, correlation, cost, median, mean) in ROWS.into_iter().filter(|row| row.0 == choices) {
            let model = play(choices, correlation, Some(cost));
            println!("{choices:<10}{correlation:>12}{cost:>8}{model}{median:>10.1}{mean:>8.1}");
        }
    }
}

//! Sessions of frames: what exploring costs where nothing can be gained, and brings where something can.

use treewright_core::configuration::Configuration;
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Scale, Space};
use treewright_core::trial::Mode;
use treewright_core::value::Value;

use crate::problem::normal;
use crate::states::Study;

const STATES: u64 = 6;
const FRAMES: usize = 300;
const NOISE: f64 = 0.07;
/// Six parameters of sixteen values.
const PARAMETERS: usize = 6;

fn space() -> Space {
    let parameter = |axis: usize| Parameter {
        name: format!("p{axis}"),
        domain: Domain::Integer { min: 0, max: 15, scale: Scale::Linear },
        default: Value::Integer(7),
        active_if: None,
    };
    Space::new((0..PARAMETERS).map(parameter).collect(), Vec::new()).expect("a valid space")
}

/// Where the optimum of a state lies, its axes' weights among them: half of it common to all states of a
/// seed.
fn bowl(seed: u64, number: u64, gain: f64) -> impl Fn(&Configuration) -> Option<f64> {
    use rand::{RngExt, SeedableRng};
    let draw = |seed: u64| {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..PARAMETERS).map(|_| normal(&mut random) + 0.0 * random.random::<f64>()).collect::<Vec<f64>>()
    };
    let (common, own) = (draw(10 * seed + 1), draw(1_000_000 + 100 * seed + number));
    let centre: Vec<f64> = common.iter().zip(&own).map(|(a, b)| 7.0 + 3.0 * a + 1.5 * b).collect();
    let way = |x: &[f64]| x.iter().zip(&centre).map(|(x, c)| (x - c.clamp(0.0, 15.0)).powi(2)).sum::<f64>();
    let default = way(&[7.0; PARAMETERS]);
    move |configuration: &Configuration| {
        let x: Vec<f64> = (0..PARAMETERS)
            .map(|axis| configuration.get(&format!("p{axis}")).and_then(Value::as_number).unwrap_or(0.0))
            .collect();
        let way: f64 = x.iter().zip(&centre).map(|(x, c)| (x - c.clamp(0.0, 15.0)).powi(2)).sum();
        // The default costs 10, the optimum so much less.
        Some(10.0 * (1.0 - gain + gain * way / default))
    }
}

fn policies() -> Vec<(&'static str, Policy)> {
    vec![
        ("default policy", Policy::default()),
        ("weigh_gain", Policy { weigh_gain: true, epsilon: 1.0, ..Policy::default() }),
        ("epsilon 1", Policy { epsilon: 1.0, ..Policy::default() }),
    ]
}

/// Runs sessions in states one after the other: of each state the frames explored, and the mean true cost.
fn sessions(seed: u64, policy: &Policy, gain: f64) -> Vec<(usize, f64, f64)> {
    let mut study = Study::new(space(), seed, policy.clone());
    let session = |number: u64| {
        let truth = bowl(seed, number, gain);
        let (mut explored, mut cost) = (0, 0.0);
        for _ in 0..FRAMES {
            let trial = study.frame("a", number, &truth, NOISE);
            explored += usize::from(trial.mode() == Mode::Explore);
            cost += truth(&trial.configuration).unwrap_or(0.0);
        }
        let last = study.best(number).and_then(|best| truth(&best)).unwrap_or(10.0);
        (explored, cost / FRAMES as f64, last)
    };
    (0..STATES).map(session).collect()
}

fn table(seeds: u64, gain: f64) {
    for (name, policy) in policies() {
        let runs: Vec<Vec<(usize, f64, f64)>> =
            (0..seeds).map(|seed| sessions(seed, &policy, gain)).collect();
        print!("{name:16} explored in states 1 to {STATES}:");
        for state in 0..STATES as usize {
            let explored: usize = runs.iter().map(|run| run[state].0).sum();
            print!(" {:5.1}", explored as f64 / seeds as f64);
        }
        let all = || runs.iter().flatten();
        let mean = |of: &dyn Fn(&(usize, f64, f64)) -> f64| all().map(of).sum::<f64>() / all().count() as f64;
        println!(
            " | frames over default {:.3}, best at the end over default {:.3}",
            mean(&|run| run.1) / 10.0,
            mean(&|run| run.2) / 10.0
        );
    }
}

/// Nothing can be gained.
pub(crate) fn flat(seeds: u64) {
    table(seeds, 0.0);
}

/// 15 % can be gained.
pub(crate) fn short(seeds: u64) {
    table(seeds, 0.15);
}

/// A second client in a state that a first has explored.
pub(crate) fn second(seeds: u64) {
    let (mut never, mut costs) = (0, Vec::new());
    for seed in 0..seeds {
        let mut study = Study::new(space(), seed, Policy::default());
        let truth = bowl(seed, 0, 0.6);
        (0..40).for_each(|_| drop(study.frame("first", 0, &truth, NOISE)));
        let mut explored = 0;
        let mut last = 0.0;
        for _ in 0..80 {
            let trial = study.frame("second", 0, &truth, NOISE);
            explored += usize::from(trial.mode() == Mode::Explore);
            last = truth(&trial.configuration).unwrap_or(0.0);
        }
        never += usize::from(explored == 0);
        costs.push(last / 4.0);
    }
    let (mean, _) = crate::summary(&costs);
    costs.sort_by(f64::total_cmp);
    println!(
        "the second client never explored in {never} of {seeds}; its last frame over the optimum: mean {mean:.3}, \
         worst {:.3}",
        costs[costs.len() - 1]
    );
}

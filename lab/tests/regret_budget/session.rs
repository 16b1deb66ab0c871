//! A simulated renderer for the regret budget: its speed changes, frames vary, states are the worst.

use std::{collections::BTreeMap, sync::Arc};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::policy::{Policy, SearchMethod};
use treewright_core::trial::{Mode, Outcome, Trial};
use treewright_core::tuner::{Ask, Tuner};
use treewright_core::{space::Space, value::Value};
use treewright_lab::simulated::{METRIC, ask, normal, share, study};

/// Kinds of change of the machine's speed.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Weather {
    /// Not at all; frames vary by 7 %.
    Calm,
    /// By a random walk of 2 % a frame.
    Drifting,
    /// By a factor up to 2, up or down, every fifty frames or so.
    Stepping,
    /// In waves of sixty frames, by half.
    Waves,
}

#[derive(Clone, Debug)]
pub(crate) struct Session {
    pub(crate) weather: Weather,
    /// The share of frame time that exploring may cost.
    pub(crate) budget: f64,
    pub(crate) explored: u64,
    /// The largest share that exploring had cost at any moment: true regret over true frame time.
    pub(crate) worst: f64,
}

/// Cost of the default in every state, before the machine's speed.
const DEFAULT_COST: f64 = 10.0;

/// Cost in a state; in adversarial ones most are ten to a hundred times as dear as the default.
fn cost(trial: &Trial, adversarial: bool) -> f64 {
    let number = |name: &str| trial.configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
    let (a, b) = (number("a"), number("b"));
    let (from_default, ideal) = ((a - 0.5).abs() + (b - 0.5).abs(), (a - 0.8).abs() + (b - 0.3).abs());
    if adversarial { DEFAULT_COST * (1.0 + 90.0 * from_default) } else { 7.0 + 6.0 * ideal }
}

impl Session {
    /// A session with a budget of 2 to 10 %, or without one.
    pub(crate) fn run(seed: u64, frames: u64, has_budget: bool) -> Self {
        let budget = 0.02 + 0.08 * (seed % 7) as f64 / 6.0;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let policy = Policy {
            epsilon: 1.0,
            search: SearchMethod::Random,
            trials_per_state: 100_000,
            regret_budget: has_budget.then_some(budget),
            abort_above: Some(1.2 + 1.3 * random.random::<f64>()),
            ..Policy::default()
        };
        let space = Space::new(vec![share("a"), share("b")], vec![]).expect("a valid space");
        let spec = study(space, std::iter::once("place".to_owned()), policy, seed);
        let mut tuner = Tuner::new(Arc::new(spec)).expect("a valid specification");
        let all = [Weather::Calm, Weather::Drifting, Weather::Stepping, Weather::Waves];
        let weather = all[(seed % 4) as usize];
        let (mut speed, mut place, mut adversarial) = (1.0f64, 0.0, seed.is_multiple_of(3));
        // Some sessions never leave their state, some hardly stay.
        let stay = [1e9, 200.0, 30.0, 8.0][(seed / 4 % 4) as usize];
        let noise = 0.07;
        let mut session = Session { weather, budget, explored: 0, worst: 0.0 };
        let (mut regret, mut paid) = (0.0, 0.0);
        for frame in 0..frames {
            match weather {
                Weather::Calm => {}
                Weather::Drifting => speed *= (0.02 * normal(&mut random)).exp(),
                Weather::Stepping if random.random::<f64>() < 0.02 => {
                    speed = 2f64.powf(2.0 * random.random::<f64>() - 1.0);
                }
                Weather::Stepping => {}
                Weather::Waves => speed = 1.0 + 0.5 * (frame as f64 / 60.0 * std::f64::consts::TAU).sin(),
            }
            if random.random::<f64>() * stay < 1.0 {
                place = random.random();
                adversarial = random.random::<f64>() < 0.5;
            }
            let ask = Ask { session: 1, can_abort: true, ..ask([("place", place)]) };
            let trial = tuner.suggest(&ask, 0).expect("a valid question").0;
            let true_cost = speed * cost(&trial, adversarial);
            let measured = true_cost * (noise * normal(&mut random)).exp();
            let default = speed * DEFAULT_COST;
            let (spent, outcome) = match trial.reason().explanation.abort_above {
                Some(cap) if measured > cap => (cap, Outcome::Aborted { lower_bound: cap }),
                _ => (measured, Outcome::Ok),
            };
            // A client that stopped at the cap has spent the cap and no more.
            let truly = if spent < measured { spent } else { true_cost };
            paid += truly;
            if trial.mode() == Mode::Explore {
                session.explored += 1;
                regret += truly - default;
            }
            session.worst = session.worst.max(regret / paid);
            // Now and then a report never arrives, and the client, which was started again, asks again.
            if random.random::<f64>() < 0.02 {
                continue;
            }
            // Or a result is lost, or cannot be reported.
            if random.random::<f64>() < 0.01 {
                let _change = tuner.abandon(&trial).expect("it is open");
                continue;
            }
            let measurements = BTreeMap::from([(METRIC.to_owned(), spent)]);
            let _reported = tuner.report(&trial, measurements, outcome, 1).expect("a valid report");
        }
        session
    }
}

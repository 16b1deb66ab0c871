//! Worlds whose costs are known, and machines that are quiet or are not.

use std::{collections::BTreeMap, sync::Arc};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::trial::{Outcome, Rule};
use treewright_core::{
    configuration::Configuration, policy::Policy, space::Space, study::StudySpec, tuner::Tuner, value::Value,
};
use treewright_lab::simulated::{METRIC, ask, normal, study};

/// The noise of a measurement: the standard deviation of its logarithm.
const NOISE: f64 = 0.07;
/// Noise from frame to frame, the deviation of a wandering speed, and the frames that half forget it.
const NOISE_CALM: f64 = 0.04;
const WANDER: f64 = 0.13;
const WANDER_FRAMES: f64 = 14.0;
const CPU_NOISE: f64 = 0.02;
const TRIALS: usize = 80;
/// The most frames that a client runs to wait for the verdict, beyond the trials of the search.
const PATIENCE: usize = 120;

/// The costs of configurations.
#[derive(Clone, Copy, Debug)]
pub(crate) enum World {
    /// All costs are equal.
    Flat,
    /// One optimum, some way from the default.
    Bowl,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum Machine {
    /// Constant speed.
    Quiet,
    /// One and two other programs come and go.
    Load,
    /// Its speed wanders by minutes, as a virtual machine's beside others; between frames it is calmer.
    Wander,
}

/// One search, whose client goes on until the verdict stands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    pub(crate) world: World,
    pub(crate) machine: Machine,
}

/// The result of a run. Gains are over the default, as shares.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run {
    pub(crate) reported: f64,
    pub(crate) truth: f64,
}

fn space() -> Space {
    let space = Space::builder().float("a", 0.0..=1.0).default(0.7).float("b", 0.0..=1.0).default(0.2);
    let space = space.float("c", 0.0..=1.0).default(0.5).integer("leaf", 1..=64).log().default(4);
    let space = space.categorical("kind", ["sah", "median", "morton"]).default("median");
    space.build().expect("a space")
}

impl World {
    fn cost(self, configuration: &Configuration) -> f64 {
        let number = |name: &str| configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
        let kind = match configuration.get("kind") {
            Some(Value::Text(kind)) if kind == "sah" => 0.0,
            Some(Value::Text(kind)) if kind == "median" => 0.06,
            _ => 0.2,
        };
        let leaf = (number("leaf") / 16.0).log2() / 6.0;
        match self {
            World::Flat => 10.0,
            World::Bowl => {
                let off = 0.5 * (number("a") - 0.35).powi(2) + 0.4 * (number("b") - 0.6).powi(2);
                10.0 * (0.8 + off + 0.15 * (number("c") - 0.4).powi(2) + 0.5 * leaf * leaf + kind)
            }
        }
    }
}

/// The factors on wall time and on processor time at a frame.
struct Speed {
    machine: Machine,
    /// Number of other programs, and the time until which they run.
    others: (usize, usize),
    log_factor: f64,
    random: ChaCha8Rng,
}

impl Speed {
    fn factors(&mut self, frame: usize) -> (f64, f64) {
        match self.machine {
            Machine::Quiet => (1.0, 1.0),
            Machine::Load => {
                if frame >= self.others.1 {
                    self.others = (self.random.random_range(0..3), frame + self.random.random_range(5..25));
                }
                [(1.0, 1.0), (1.6, 1.04), (2.2, 1.06)][self.others.0]
            }
            Machine::Wander => {
                let keep = if frame == 0 { 0.0 } else { 0.5_f64.powf(1.0 / WANDER_FRAMES) };
                let step = WANDER * (1.0 - keep * keep).sqrt() * normal(&mut self.random);
                self.log_factor = keep * self.log_factor + step;
                let factor = self.log_factor.exp();
                (factor, factor)
            }
        }
    }
}

impl Search {
    fn spec(&self, seed: u64) -> StudySpec {
        let wanders = matches!(self.machine, Machine::Wander);
        let auxiliary = if wanders { vec!["cpu_ms".to_owned()] } else { Vec::new() };
        let policy = Policy { epsilon: 1.0, trials_per_state: TRIALS as u32, ..Policy::default() };
        let study = study(space(), std::iter::empty(), policy, seed);
        let objective = study.objective.clone().with_auxiliary(auxiliary).expect("valid");
        StudySpec { objective, ..study }
    }

    pub(crate) fn run(&self, seed: u64) -> Run {
        let mut tuner = Tuner::new(Arc::new(self.spec(seed))).expect("a study");
        let mut random = ChaCha8Rng::seed_from_u64(1000 + seed);
        // A number that nothing needs any more; the recorded figures drew it.
        let _: usize = random.random_range(TRIALS / 4..3 * TRIALS / 4);
        let mut speed = Speed {
            machine: self.machine,
            others: (0, 0),
            log_factor: 0.0,
            random: ChaCha8Rng::seed_from_u64(2000 + seed),
        };
        let ask = ask([]);
        for frame in 0..TRIALS + PATIENCE {
            let (trial, _change) = tuner.suggest(&ask, frame as i64).expect("a trial");
            let rule = trial.reason().explanation.rule;
            if frame >= TRIALS && matches!(rule, Some(Rule::Finished)) {
                break;
            }
            let truth = self.world.cost(&trial.configuration);
            let (wall, cpu) = speed.factors(frame);
            let noise = if matches!(self.machine, Machine::Wander) { NOISE_CALM } else { NOISE };
            let mut metrics =
                BTreeMap::from([(METRIC.to_owned(), truth * wall * (noise * normal(&mut random)).exp())]);
            metrics.insert("cpu_ms".to_owned(), truth * cpu * (CPU_NOISE * normal(&mut random)).exp());
            let _reported = tuner.report(&trial, metrics, Outcome::Ok, frame as i64).expect("a report");
        }
        let default = tuner.spec().space.default_configuration();
        let gain =
            |configuration: &Configuration| 1.0 - self.world.cost(configuration) / self.world.cost(&default);
        let best = tuner.best(None, None).expect("valid").expect("measured");
        let reported = best.standing.gain.expect("the default was measured");
        Run { reported: reported.share, truth: gain(&best.configuration) }
    }
}

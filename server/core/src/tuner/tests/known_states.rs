//! Knowledge of other states does no harm: a search beside 1, 3 and 30 known states, the nearest of which
//! wants the opposite, ends where a search alone does or lower. A lucky measurement does not travel.
//!
//! `-- --nocapture` prints the ratios, as rows of a table in `docs/measurements/warm-start.md`.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::randomness::standard_normal as normal;
use crate::robust::median;
use crate::session::SessionPolicy;

const LANDSCAPES: u64 = 4;
const NOISE: f64 = 0.03;
/// Trials in each known state.
const KNOWN: usize = 16;
/// Trials in the new state after which answers are compared.
const MARKS: [usize; 2] = [20, 40];
/// The most by which an answer may be dearer than alone in the median of all runs, and by which it may be in
/// the mean of the runs of one landscape after the last trial.
const DEARER_IN_THE_MEDIAN: f64 = 0.01;
const DEARER_AT_MOST: f64 = 0.03;
const KINDS: [&str; 3] = ["binned", "sweep", "ordered"];
/// The share by which the wrong end of each number makes a landscape dearer, over a distance of one.
const STEEPNESS: [f64; 4] = [0.5, 0.35, 0.25, 0.4];
const NAMES: [&str; 4] = ["cost", "bias", "share", "budget"];
/// The new state.
const HERE: (f64, f64) = (0.5, 0.5);

fn space() -> Space {
    let space = Space::builder().categorical("kind", KINDS).default("binned");
    let space = space.categorical("width", [2, 4, 8]).default(2);
    let space = space.float("cost", 0.0..=1.0).default(0.5).float("bias", 0.0..=1.0).default(0.5);
    let space = space.float("share", 0.0..=1.0).default(0.5);
    let space = space.float("budget", 0.0..=1.0).default(0.5).active_if("kind", ["sweep", "ordered"]);
    space.build().expect("a valid space")
}

/// The best values of a landscape.
struct Wants {
    kind: usize,
    width: f64,
    numbers: [f64; 4],
}

impl Wants {
    fn drawn(random: &mut ChaCha8Rng) -> Self {
        let kind = random.random_range(0..KINDS.len());
        let width = f64::from([2, 4, 8][random.random_range(0..3)]);
        // At one end or the other, so that the opposite is somewhere else.
        let mut end = || if random.random() { 0.15 } else { 0.85 };
        let ends = NAMES.map(|_| end());
        let numbers = ends.map(|end| end + 0.05 * normal(random));
        Wants { kind, width, numbers }
    }

    /// A landscape that wants nearly as much of everything.
    fn like(&self, random: &mut ChaCha8Rng) -> Self {
        Wants { numbers: self.numbers.map(|best| best + 0.05 * normal(random)), ..*self }
    }

    fn opposite(&self) -> Self {
        let kind = (self.kind + 1) % KINDS.len();
        Wants { kind, width: 16.0 / self.width, numbers: self.numbers.map(|best| 1.0 - best) }
    }

    /// The true cost of a configuration; the optimum costs 20.
    fn cost(&self, configuration: &Configuration) -> f64 {
        let number = |name: &str| configuration.get(name).and_then(Value::as_number);
        let is = |kind: &&str| configuration.get("kind") == Some(&Value::Text((*kind).into()));
        let kind = KINDS.iter().position(is).unwrap_or(0);
        let by_kind = [1.0, 1.12, 1.25][(kind + KINDS.len() - self.kind) % KINDS.len()];
        let by_width = 1.0 + 0.06 * (number("width").unwrap_or(2.0) / self.width).log2().abs();
        let one = |(place, name): (usize, &&str)| {
            let off = number(name).unwrap_or(0.5) - self.numbers[place];
            1.0 + STEEPNESS[place] * off * off
        };
        20.0 * by_kind * by_width * NAMES.iter().enumerate().map(one).product::<f64>()
    }
}

/// Explores a state. Returns the true costs of its answers at the marks.
fn explored(tuner: &mut Tuner, (x, y): (f64, f64), wants: &Wants, noise: u64, trials: usize) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(noise);
    let mut answers = Vec::new();
    for done in 1..=trials {
        let trial = suggest(tuner, "a", x, y);
        let cost = wants.cost(&trial.configuration) * f64::exp(NOISE * normal(&mut random));
        assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
        if MARKS.contains(&done) {
            let best = tuner.best(Some(&trial.indicators), None).expect("valid").expect("measured");
            answers.push(wants.cost(&best.configuration));
        }
    }
    answers
}

/// Places of known states, the nearest to the new one first.
fn places() -> Vec<(f64, f64)> {
    let steps = || (0..6).map(|step| 0.05 + 0.18 * f64::from(step));
    let far = |&(x, y): &(f64, f64)| (x - HERE.0).powi(2) + (y - HERE.1).powi(2);
    let mut all: Vec<(f64, f64)> = steps().flat_map(|x| steps().map(move |y| (x, y))).collect();
    all.sort_by(|a, b| far(a).total_cmp(&far(b)));
    all
}

/// The true costs of the answers in a new state of a landscape beside known states.
fn beside(known: usize, landscape: u64, noise: u64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(landscape);
    let wants = Wants::drawn(&mut random);
    let policy = Policy { trials_per_state: 40, ..explore_always() };
    let spec = StudySpec { seed: 100 * landscape + noise, ..spec_of(space(), policy) };
    let mut tuner = Tuner::new(Arc::new(spec)).expect("valid");
    for (number, &place) in places().iter().take(known).enumerate() {
        let there = if number == 0 { wants.opposite() } else { wants.like(&mut random) };
        explored(&mut tuner, place, &there, 1_000 * noise + number as u64, KNOWN);
    }
    assert_eq!(tuner.knowledge.states.len(), known, "each place is a state of its own");
    explored(&mut tuner, HERE, &wants, noise, MARKS[1])
}

#[test]
fn known_states_of_which_one_wants_the_opposite_do_no_harm() {
    for (known, noises) in [(1, 3), (3, 3), (30, 2)] {
        let (mut all, mut worst): ([Vec<f64>; MARKS.len()], f64) = Default::default();
        for landscape in 0..LANDSCAPES {
            let mut last = 0.0;
            for noise in 0..noises {
                let pairs = beside(known, landscape, noise).into_iter().zip(beside(0, landscape, noise));
                let ratios: Vec<f64> = pairs.map(|(with, alone)| with / alone).collect();
                all.iter_mut().zip(&ratios).for_each(|(all, ratio)| all.push(*ratio));
                last += ratios[MARKS.len() - 1] / noises as f64;
            }
            worst = worst.max(last);
        }
        let [early, late] = all.map(|mut ratios| median(&mut ratios));
        println!("| {known} | {early:.3} | {late:.3} | {worst:.3} |");
        let most = early.max(late);
        assert!(most <= 1.0 + DEARER_IN_THE_MEDIAN, "{known} known states: {most} of alone in the median");
        assert!(worst <= 1.0 + DEARER_AT_MOST, "{known} known states: {worst} of alone in one landscape");
    }
}

/// A flat state is searched and confirmed to the end. Then one configuration is measured there once, while
/// the machine runs at twice its speed.
#[test]
fn a_lucky_single_of_a_known_state_is_no_answer_of_a_new_one() {
    for seed in 0..4 {
        let mut tuner = seeded(seed, Policy { epsilon: 1.0, trials_per_state: 16, ..Policy::default() });
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        for _ in 0..400 {
            let trial = suggest(&mut tuner, "a", 0.2, 0.5);
            if trial.reason().explanation.rule == Some(Rule::Finished) {
                break;
            }
            let cost = 40.0 * f64::exp(NOISE * normal(&mut random));
            assert!(tuner.report(&trial, measured(cost), Outcome::Ok, 1).is_ok());
        }
        let lucky = tuner.spec().space.decode(&[0.9, 0.3, 0.6, 0.77]);
        let trial = tuner.suggest_wanted(&ask("w", 0.2, 0.5), lucky.to_raw(), None, 0).expect("valid").0;
        assert!(tuner.report(&trial, measured(20.0), Outcome::Ok, 1).is_ok());
        let luckiest =
            tuner.knowledge.states.results(StateId(1)).best().map(|record| record.configuration.clone());
        assert_eq!(luckiest.as_ref(), Some(&lucky), "by what was measured");
        let session_policy = SessionPolicy { epsilon: Some(0.0), ..SessionPolicy::default() };
        let production = Ask { session_policy, ..ask("production", 0.8, 0.5) };
        let answer = tuner.suggest(&production, 0).expect("valid").0;
        assert_ne!(answer.configuration, lucky, "seed {seed}: {}", answer.reason().summary);
        let first = suggest(&mut tuner, "explorer", 0.8, 0.5);
        assert_ne!(first.configuration, lucky, "seed {seed}: {}", first.reason().summary);
    }
}

//! A finished state whose answer became dearer is to be searched again soon, and one that did not change is
//! not.

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::policy::Policy;
use treewright_core::space::Space;
use treewright_core::trial::{Outcome, Rule, Trial};
use treewright_core::tuner::Tuner;
use treewright_core::value::Value;
use treewright_lab::simulated::{METRIC, ask, normal, study};

use crate::Figures;

/// Trials of a search, and the most frames until it and its confirmation are over.
const TRIALS: u32 = 40;
const FRAMES_OF_SEARCH: usize = 400;
/// Frames of a finished state before its costs change, and those in which that may be noticed.
const FRAMES_BEFORE: usize = 50;
const FRAMES_OF_CHANGE: usize = 200;
/// Frames within which that is soon.
const SOON: usize = 10;
/// Frames without a change.
const FRAMES_OF_CALM: usize = 1000;
/// The factor by which the answer's kind becomes dearer.
const DEARER: f64 = 1.1;
/// Noise of wall time where costs change, and where they do not; noise of processor time.
const NOISE_OF_CHANGE: f64 = 0.01;
const NOISE_LARGER: f64 = 0.02;
const NOISE_OF_CALM: f64 = 0.02;
const CPU_NOISE: f64 = 0.01;
/// Factors on wall time and on processor time beside 0, 1 and 2 other programs.
const BESIDE: [(f64, f64); 3] = [(1.0, 1.0), (1.6, 1.04), (2.2, 1.06)];

/// A client in its state.
struct Session {
    tuner: Tuner,
    random: ChaCha8Rng,
    noise: f64,
    /// Other programs come and go.
    is_loaded: bool,
    frames: usize,
    /// Number of other programs, and the frame until which they run.
    others: (usize, usize),
    /// The kind that became dearer.
    dearer: Option<String>,
}

/// A finished search: its answer, and how many configurations it tried.
struct Finished {
    answer: Configuration,
    tried: u64,
}

fn kind(configuration: &Configuration) -> &str {
    match configuration.get("kind") {
        Some(Value::Text(kind)) => kind.as_str(),
        _ => "",
    }
}

impl Session {
    fn new(noise: f64, is_loaded: bool, seed: u64) -> Self {
        let space = Space::builder().float("a", 0.0..=1.0).default(0.5).float("b", 0.0..=1.0).default(0.5);
        let space = space.categorical("kind", ["sah", "median", "morton"]).default("median");
        let policy = Policy { epsilon: 1.0, trials_per_state: TRIALS, ..Policy::default() };
        let spec = study(space.build().expect("a valid space"), std::iter::empty(), policy, seed);
        Self {
            tuner: Tuner::new(Arc::new(spec)).expect("a valid study"),
            random: ChaCha8Rng::seed_from_u64(seed),
            noise,
            is_loaded,
            frames: 0,
            others: (0, 0),
            dearer: None,
        }
    }

    fn cost(&self, configuration: &Configuration) -> f64 {
        let number = |name: &str| configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
        let kind = kind(configuration);
        let base = match kind {
            "sah" => 0.8,
            "median" => 0.95,
            _ => 1.1,
        };
        let off = 0.5 * (number("a") - 0.3).powi(2) + 0.4 * (number("b") - 0.7).powi(2);
        10.0 * (base + off) * if self.dearer.as_deref() == Some(kind) { DEARER } else { 1.0 }
    }

    fn frame(&mut self) -> Trial {
        let now = self.frames as i64;
        let trial = self.tuner.suggest(&ask([]), now).expect("a valid question").0;
        if self.is_loaded && self.frames >= self.others.1 {
            let until = self.frames + self.random.random_range(5..25);
            self.others = (self.random.random_range(0..BESIDE.len()), until);
        }
        let (wall, cpu) = BESIDE[self.others.0];
        let cost = self.cost(&trial.configuration);
        let wall_ms = cost * wall * (self.noise * normal(&mut self.random)).exp();
        // The study does not look at it.
        let cpu_ms = cost * cpu * (CPU_NOISE * normal(&mut self.random)).exp();
        let measurements = BTreeMap::from([(METRIC.to_owned(), wall_ms), ("cpu_ms".to_owned(), cpu_ms)]);
        self.frames += 1;
        self.tuner.report(&trial, measurements, Outcome::Ok, now).expect("an open trial").0
    }

    /// Configurations that are known in the state.
    fn tried(&self) -> u64 {
        let answer = self.tuner.predict(&BTreeMap::new(), None).expect("a valid question");
        answer.insight.map_or(0, |insight| insight.tried)
    }

    /// Runs the search and its confirmation; `None` where they do not end.
    fn finish(&mut self) -> Option<Finished> {
        let is_over = |trial: &Trial| trial.decision.rule() == Some(Rule::Finished);
        let last = (0..FRAMES_OF_SEARCH).map(|_| self.frame()).find(is_over)?;
        Some(Finished { answer: last.configuration, tried: self.tried() })
    }

    /// Whether the next frame belongs to a search that has begun again: it tries a configuration, and the
    /// results of before are gone.
    fn begins_again(&mut self, before: &Finished) -> bool {
        let trial = self.frame();
        trial.decision.explores() && trial.configuration != before.answer && self.tried() < before.tried / 2
    }
}

/// Frames after which a state whose answer became dearer is searched again.
fn delay(noise: f64, seed: u64) -> usize {
    let mut session = Session::new(noise, false, seed);
    let before = session.finish().expect("a search of few trials ends");
    (0..FRAMES_BEFORE).for_each(|_| drop(session.frame()));
    session.dearer = Some(kind(&before.answer).to_owned());
    (1..=FRAMES_OF_CHANGE).find(|_| session.begins_again(&before)).unwrap_or(FRAMES_OF_CHANGE)
}

/// How often a finished state is searched again although nothing has changed.
fn alarms(seed: u64) -> usize {
    let mut session = Session::new(NOISE_OF_CALM, true, seed);
    let (mut frames, mut alarms) = (0, 0);
    while frames < FRAMES_OF_CALM
        && let Some(before) = session.finish()
    {
        let Some(until) = (1..=FRAMES_OF_CALM - frames).find(|_| session.begins_again(&before)) else {
            break;
        };
        (frames, alarms) = (frames + until, alarms + 1);
    }
    alarms
}

/// Frames until a dearer answer is noticed, whether that is soon where frames scatter by 2 %, and false
/// alarms in a thousand frames beside other programs.
pub(crate) fn noticed(seed: u64) -> Figures {
    let is_soon = delay(NOISE_LARGER, seed) <= SOON;
    let frames = delay(NOISE_OF_CHANGE, seed) as f64;
    let figures =
        [("delay", -frames), ("soon at 2 %", f64::from(is_soon)), ("alarms", -(alarms(seed) as f64))];
    figures.map(|(name, value)| (name.to_owned(), value)).into()
}

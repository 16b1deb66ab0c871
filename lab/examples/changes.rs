//! How soon a finished state whose costs changed is searched again, and how often one whose costs did not.
//!
//! ```text
//! cargo run --release -p treewright-lab --example changes [SEEDS]
//! ```
//!
//! A client stays in one state of the real tuner until its search and its confirmation are over. Then either
//! the answer's kind becomes dearer by a share, which no indicator shows, and the frames until the first new
//! configuration are counted; or nothing changes for a thousand frames, on a quiet machine or one where other
//! programs come and go, and searches that begin again are false alarms.

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use treewright_core::configuration::Configuration;
use treewright_core::policy::Policy;
use treewright_core::space::{Domain, Parameter, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Outcome, Rule, Trial};
use treewright_core::tuner::Tuner;
use treewright_core::value::Value;
use treewright_lab::simulated::{METRIC, ask, normal, share, study};

/// Trials of a search, and the most frames until it and its confirmation are over.
const TRIALS: u32 = 40;
const FRAMES_OF_SEARCH: usize = 400;
/// Frames of a finished state before its costs change.
const FRAMES_BEFORE: usize = 50;
/// Frames after a change in which it may be noticed, and those in which it should be.
const FRAMES_OF_CHANGE: usize = 200;
const SOON: usize = 10;
/// Frames without a change.
const FRAMES_OF_CALM: usize = 1000;
/// Noise of processor time.
const CPU_NOISE: f64 = 0.01;
/// Factors on wall time and on processor time beside 0, 1 and 2 other programs.
const BESIDE: [(f64, f64); 3] = [(1.0, 1.0), (1.6, 1.04), (2.2, 1.06)];

/// The machine, and what its clients report.
#[derive(Clone, Copy, Debug)]
struct Machine {
    /// Standard deviation of the logarithm of a measurement.
    noise: f64,
    /// Other programs come and go.
    is_loaded: bool,
    /// Processor time is reported.
    tells_cpu: bool,
}

/// A client in its state.
struct Session {
    tuner: Tuner,
    machine: Machine,
    random: ChaCha8Rng,
    frames: usize,
    /// Number of other programs, and the frame until which they run.
    others: (usize, usize),
    /// The kind that became dearer, and its factor.
    dearer: (String, f64),
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

fn space() -> Space {
    let kinds = ["sah", "median", "morton"].map(|kind| Value::Text(kind.into())).to_vec();
    let kind = Parameter::new("kind", Domain::Categorical { values: kinds }, Value::Text("median".into()));
    Space::new(vec![share("a"), share("b"), kind], Vec::new()).expect("a space")
}

impl Session {
    fn new(machine: Machine, seed: u64) -> Self {
        let policy = Policy { epsilon: 1.0, trials_per_state: TRIALS, ..Policy::default() };
        let spec = study(space(), std::iter::empty(), policy, seed);
        let auxiliary = if machine.tells_cpu { vec!["cpu_ms".to_owned()] } else { Vec::new() };
        let objective = spec.objective.clone().with_auxiliary(auxiliary).expect("valid");
        Self {
            tuner: Tuner::new(Arc::new(StudySpec { objective, ..spec })).expect("a study"),
            machine,
            random: ChaCha8Rng::seed_from_u64(seed),
            frames: 0,
            others: (0, 0),
            dearer: (String::new(), 1.0),
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
        let factor = if kind == self.dearer.0 { self.dearer.1 } else { 1.0 };
        10.0 * (base + off) * factor
    }

    fn frame(&mut self) -> Trial {
        let now = self.frames as i64;
        let (trial, _change) = self.tuner.suggest(&ask([]), now).expect("a trial");
        if self.machine.is_loaded && self.frames >= self.others.1 {
            let until = self.frames + self.random.random_range(5..25);
            self.others = (self.random.random_range(0..BESIDE.len()), until);
        }
        let (wall, cpu) = BESIDE[self.others.0];
        let cost = self.cost(&trial.configuration);
        let wall_ms = cost * wall * (self.machine.noise * normal(&mut self.random)).exp();
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

/// Frames after which the state is searched again, infinite where it is not. `None` where the search keeps
/// the default's kind: the default shows the machine's speed, and is to stay as it is.
fn delay(noise: f64, change: f64, seed: u64) -> Option<f64> {
    let machine = Machine { noise, is_loaded: false, tells_cpu: false };
    let mut session = Session::new(machine, seed);
    let before = session.finish()?;
    let default = session.tuner.spec().space.default_configuration();
    if kind(&before.answer) == kind(&default) {
        return None;
    }
    (0..FRAMES_BEFORE).for_each(|_| drop(session.frame()));
    session.dearer = (kind(&before.answer).to_owned(), 1.0 + change);
    let seen = (1..=FRAMES_OF_CHANGE).find(|_| session.begins_again(&before));
    Some(seen.map_or(f64::INFINITY, |frames| frames as f64))
}

/// Frames of finished searches, and how many of these began again although nothing had changed.
fn alarms(machine: Machine, seed: u64) -> (usize, usize) {
    let mut session = Session::new(machine, seed);
    let (mut frames, mut alarms) = (0, 0);
    while let Some(before) = session.finish() {
        let left = FRAMES_OF_CALM - frames;
        match (1..=left).find(|_| session.begins_again(&before)) {
            Some(until) => (frames, alarms) = (frames + until, alarms + 1),
            None => return (FRAMES_OF_CALM, alarms),
        }
        if frames == FRAMES_OF_CALM {
            break;
        }
    }
    (frames, alarms)
}

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(20, |text| text.parse().expect("a number of seeds"));
    println!("the answer becomes dearer: frames until it is searched again ({seeds} seeds)");
    println!(
        "{:>8}{:>8}{:>10}{:>10}{:>16}{:>10}",
        "noise", "change", "searches", "noticed", "within 10", "median"
    );
    for noise in [0.01, 0.02, 0.05] {
        for change in [0.1, 0.3, 1.0] {
            let delays = (0..seeds).into_par_iter().filter_map(|seed| delay(noise, change, seed));
            let mut delays: Vec<f64> = delays.collect();
            delays.sort_by(f64::total_cmp);
            let within = |frames: usize| delays.iter().filter(|delay| **delay <= frames as f64).count();
            let median = delays.get(delays.len() / 2).copied().unwrap_or(f64::INFINITY);
            println!(
                "{noise:>8.2}{change:>8.1}{:>10}{:>10}{:>16}{median:>10.0}",
                delays.len(),
                within(FRAMES_OF_CHANGE),
                within(SOON),
            );
        }
    }
    println!("nothing changes: searches that begin again");
    println!("{:<38}{:>10}{:>10}{:>16}", "machine", "frames", "alarms", "in 10,000");
    for noise in [0.02, 0.05] {
        for (name, is_loaded, tells_cpu) in [
            ("quiet", false, false),
            ("0 to 2 other programs", true, false),
            ("these, with processor time", true, true),
        ] {
            let machine = Machine { noise, is_loaded, tells_cpu };
            let all = (0..seeds).into_par_iter().map(|seed| alarms(machine, seed));
            let (frames, alarms) = all.reduce(|| (0, 0), |one, other| (one.0 + other.0, one.1 + other.1));
            let rate = 1e4 * alarms as f64 / frames.max(1) as f64;
            println!("{:<38}{frames:>10}{alarms:>10}{rate:>16.1}", format!("{name}, noise {noise}"));
        }
    }
}

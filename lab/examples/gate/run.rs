//! The score of a search on a problem, and the trials that it cost.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::limits::KNOWN_POINTS_PER_SUGGESTION_MAX;
use treewright_core::policy::SearchMethod;
use treewright_core::search::{AnySearch, Feedback, SearchSetup, Step, Verdict};
use treewright_lab::simulated::normal;

use crate::problem::Problem;

/// Trials above this many times the default's cost are dear.
const DEAR_ABOVE: f64 = 1.1;

pub(crate) struct Played {
    /// Shares of the optimum after each of the marks, of the configuration that measured best.
    pub(crate) scores: Vec<f64>,
    /// Share of the trials whose true cost is dear.
    pub(crate) dear: f64,
}

/// Trials that a search plans its design for.
const PLANNED: u32 = 80;

impl Problem {
    /// The cost of the optimum over a cost: more is better.
    fn score(&self, truth: f64) -> f64 {
        if truth.is_finite() { self.optimum / truth } else { 0.0 }
    }

    /// Runs a search the way the tuner does, one point at a time.
    pub(crate) fn run(&self, method: SearchMethod, seed: u64, marks: &[usize]) -> Played {
        let space = &self.space;
        let mut search = AnySearch::new(method, SearchSetup::of(space, seed, 1, PLANNED));
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
        let mut known: BTreeMap<Configuration, (Verdict, f64, u32)> = BTreeMap::new();
        let (mut trials, mut in_a_row) = (0, 0);
        let default = (self.truth)(&space.default_configuration()).unwrap_or(f64::INFINITY);
        let (mut scores, mut dear) = (Vec::new(), 0);
        while scores.len() < marks.len() {
            let point = search.ask().expect("only searches with points out wait");
            let mut configuration = space.decode(&point.x);
            let before = known.get(&configuration).filter(|_| point.step != Step::Replicate);
            if let Some((verdict, ..)) = before {
                in_a_row += 1;
                if in_a_row < KNOWN_POINTS_PER_SUGGESTION_MAX {
                    search.tell(point.id, Feedback { verdict: *verdict, fresh: false });
                    continue;
                }
                search.withdraw(point.id);
                let anywhere: Vec<f64> = (0..space.dimension()).map(|_| random.random()).collect();
                configuration = space.decode(&anywhere);
            }
            let lost = in_a_row >= KNOWN_POINTS_PER_SUGGESTION_MAX;
            in_a_row = 0;
            trials += 1;
            let truth = (self.truth)(&configuration);
            dear += usize::from(truth.is_some_and(|truth| truth / default > DEAR_ABOVE));
            let measured = truth.map(|truth| truth * (self.noise * normal(&mut random)).exp());
            let verdict = measured.map_or(Verdict::Infeasible, Verdict::Cost);
            let entry = known.entry(configuration).or_insert((verdict, truth.unwrap_or(f64::INFINITY), 0));
            entry.2 += 1;
            if let (Verdict::Cost(mean), Some(cost)) = (&mut entry.0, measured) {
                *mean += (cost - *mean) / f64::from(entry.2);
            }
            if !lost {
                search.tell(point.id, Feedback { verdict, fresh: true });
            }
            while marks.get(scores.len()).is_some_and(|mark| trials >= *mark) {
                let cost = |entry: &&(Verdict, f64, u32)| match entry.0 {
                    Verdict::Cost(cost) => cost,
                    _ => f64::INFINITY,
                };
                let best = known.values().min_by(|a, b| cost(a).total_cmp(&cost(b)));
                scores.push(self.score(best.map_or(f64::INFINITY, |best| best.1)));
            }
        }
        Played { scores, dear: dear as f64 / trials as f64 }
    }
}

//! The score of a search on a problem, and the trials that it cost.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::{Configuration, RawConfiguration};
use treewright_core::limits::KNOWN_POINTS_PER_SUGGESTION_MAX;
use treewright_core::policy::SearchMethod;
use treewright_core::search::{AnySearch, Feedback, SearchSetup, Step, Verdict};
use treewright_core::space::{Parameter, Space};
use treewright_lab::simulated::normal;

use crate::problem::Problem;

/// Trials above this many times the default's cost are dear.
const DEAR_ABOVE: f64 = 1.1;

/// A search that was played.
pub(crate) struct Played {
    /// Shares of the optimum after each of the marks, of the configuration that measured best.
    pub(crate) scores: Vec<f64>,
    /// Share of the trials whose true cost is dear.
    pub(crate) dear: f64,
    /// True cost of the dearest trial over that of the default.
    pub(crate) worst: f64,
    pub(crate) trials: usize,
}

/// Trials that a search plans its design for.
const PLANNED: u32 = 80;
/// The price of a new set-up, in runs.
const SETUP_PRICE: usize = 10;

impl Problem {
    /// The cost of the optimum over a cost: more is better.
    fn score(&self, truth: f64) -> f64 {
        if truth.is_finite() { self.optimum / truth } else { 0.0 }
    }

    /// Runs a search the way the tuner does, one point at a time.
    pub(crate) fn run(&self, method: SearchMethod, seed: u64, marks: &[usize]) -> Played {
        let setup = SearchSetup::of(&self.space, seed, 1, PLANNED);
        self.play(AnySearch::new(method, setup), &self.space, seed, marks)
    }

    /// Runs the model search where a change of the first half of the parameters needs a set-up, which up to
    /// `held` further points keep. The marks are costs: a run costs 1, and a new set-up [`SETUP_PRICE`].
    pub(crate) fn run_setups(&self, held: usize, seed: u64, marks: &[usize]) -> Played {
        let half = self.space.parameters().len().div_ceil(2);
        let of = |(place, one): (usize, &Parameter)| Parameter { setup: place < half, ..one.clone() };
        let parameters = self.space.parameters().iter().enumerate().map(of).collect();
        let space = Space::new(parameters, self.space.constraints().to_vec()).expect("as before");
        let setup = SearchSetup { setup_held: held, ..SearchSetup::of(&space, seed, 1, PLANNED) };
        self.play(AnySearch::new(SearchMethod::Model, setup), &space, seed, marks)
    }

    fn play(&self, mut search: AnySearch, space: &Space, seed: u64, marks: &[usize]) -> Played {
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
        let mut known: BTreeMap<Configuration, (Verdict, f64, u32)> = BTreeMap::new();
        let (mut trials, mut spent, mut in_a_row) = (0, 0, 0);
        let mut set_up = RawConfiguration::new();
        let default = (self.truth)(&space.default_configuration()).unwrap_or(f64::INFINITY);
        let (mut scores, mut dear, mut worst) = (Vec::new(), 0, 0.0f64);
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
            let needs = space.setup_part(configuration.values());
            spent += if needs == set_up { 1 } else { 1 + SETUP_PRICE };
            set_up = needs;
            let truth = (self.truth)(&configuration);
            let over_default = truth.map_or(0.0, |truth| truth / default);
            dear += usize::from(over_default > DEAR_ABOVE);
            worst = worst.max(over_default);
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
            while marks.get(scores.len()).is_some_and(|mark| spent >= *mark) {
                let cost = |entry: &&(Verdict, f64, u32)| match entry.0 {
                    Verdict::Cost(cost) => cost,
                    _ => f64::INFINITY,
                };
                let best = known.values().min_by(|a, b| cost(a).total_cmp(&cost(b)));
                scores.push(self.score(best.map_or(f64::INFINITY, |best| best.1)));
            }
        }
        Played { scores, dear: dear as f64 / trials as f64, worst, trials }
    }
}

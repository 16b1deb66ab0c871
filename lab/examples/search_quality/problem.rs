//! What is searched, and how well a search did on it.

use std::collections::{BTreeMap, VecDeque};

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::configuration::Configuration;
use treewright_core::limits::KNOWN_POINTS_PER_SUGGESTION_MAX;
use treewright_core::policy::SearchMethod;
use treewright_core::search::{AnySearch, Feedback, Layout, SearchSetup, Step, Verdict, levels};
use treewright_core::space::Space;

/// How a result is scored.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// The decimal logarithm of the gap to the optimum: less is better.
    Gap,
    /// The cost of the optimum over the cost found: more is better.
    Ratio,
}

/// A cost without noise; `None` where a configuration cannot be run.
pub(crate) type Truth = Box<dyn Fn(&Configuration) -> Option<f64> + Send + Sync>;

/// A space with a cost.
pub(crate) struct Problem {
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) space: Space,
    pub(crate) truth: Truth,
    /// Standard deviation of the noise's logarithm.
    pub(crate) noise: f64,
    /// Added to what is measured.
    pub(crate) offset: f64,
    pub(crate) optimum: f64,
}

/// A standard normal number.
pub(crate) fn normal(random: &mut impl Rng) -> f64 {
    let (a, b) = (1.0 - random.random::<f64>(), random.random::<f64>());
    (-2.0 * a.ln()).sqrt() * (2.0 * std::f64::consts::PI * b).cos()
}

/// What a run came to.
pub(crate) struct Run {
    /// Score of the configuration that measured best, after each of the marks.
    pub(crate) scores: Vec<f64>,
    /// Score of the best that was ever tried.
    pub(crate) touched: Vec<f64>,
    /// Time of asking and telling, a trial, in microseconds.
    pub(crate) micros: Vec<f64>,
    pub(crate) infeasible: usize,
    pub(crate) repeats: usize,
}

impl Problem {
    fn score(&self, truth: f64) -> f64 {
        match self.kind {
            Kind::Gap => (truth - self.optimum).max(1e-8).log10(),
            Kind::Ratio => {
                if truth.is_finite() {
                    self.optimum / truth
                } else {
                    0.0
                }
            }
        }
    }

    /// Runs a search the way the tuner does, with so many points out at a time; the oldest is answered first.
    pub(crate) fn run(&self, method: SearchMethod, in_flight: usize, seed: u64, marks: &[usize]) -> Run {
        let budget = marks[marks.len() - 1];
        let start = self.space.encode(&self.space.default_configuration());
        let setup = SearchSetup {
            seed,
            state_id: 1,
            start,
            budget: budget as u32,
            levels: levels(&self.space),
            layout: Layout::of(&self.space),
        };
        let mut search = AnySearch::new(method, setup);
        let mut random = ChaCha8Rng::seed_from_u64(seed ^ 0x5eed);
        let mut known: BTreeMap<Configuration, (Verdict, f64, u32)> = BTreeMap::new();
        let (mut trials, mut in_a_row) = (0, 0);
        let mut run = Run { scores: vec![], touched: vec![], micros: vec![], infeasible: 0, repeats: 0 };
        let mut spent = 0.0;
        let mut out = VecDeque::new();
        while trials < budget {
            while out.len() < in_flight && trials + out.len() < budget {
                let clock = std::time::Instant::now();
                let Some(point) = search.ask() else { break };
                spent += clock.elapsed().as_secs_f64() * 1e6;
                let mut configuration = self.space.decode(&point.x);
                if let (Some((verdict, ..)), false) =
                    (known.get(&configuration), point.step == Step::Replicate)
                {
                    in_a_row += 1;
                    if in_a_row < KNOWN_POINTS_PER_SUGGESTION_MAX {
                        search.tell(point.id, Feedback { verdict: *verdict, fresh: false });
                        continue;
                    }
                    search.withdraw(point.id);
                    configuration = self.space.decode(&start_anew(&self.space, &mut random));
                }
                let lost = in_a_row >= KNOWN_POINTS_PER_SUGGESTION_MAX;
                in_a_row = 0;
                out.push_back((point, configuration, lost));
            }
            let (point, configuration, lost) = out.pop_front().expect("only searches with points out wait");
            trials += 1;
            let truth = (self.truth)(&configuration);
            let measured = truth.map(|truth| truth * (self.noise * normal(&mut random)).exp() + self.offset);
            let verdict = measured.map_or(Verdict::Infeasible, Verdict::Cost);
            run.infeasible += usize::from(truth.is_none());
            run.repeats += usize::from(point.step == Step::Replicate);
            let entry = known.entry(configuration).or_insert((verdict, truth.unwrap_or(f64::INFINITY), 0));
            entry.2 += 1;
            if let (Verdict::Cost(mean), Some(cost)) = (&mut entry.0, measured) {
                *mean += (cost - *mean) / f64::from(entry.2);
            }
            let clock = std::time::Instant::now();
            if !lost {
                search.tell(point.id, Feedback { verdict, fresh: true });
            }
            run.micros.push(spent + clock.elapsed().as_secs_f64() * 1e6);
            spent = 0.0;
            if marks.contains(&trials) {
                let cost = |entry: &&(Verdict, f64, u32)| match entry.0 {
                    Verdict::Cost(cost) => cost,
                    _ => f64::INFINITY,
                };
                let best = known.values().min_by(|a, b| cost(a).total_cmp(&cost(b)));
                run.scores.push(self.score(best.map_or(f64::INFINITY, |best| best.1)));
                let touched = known.values().map(|entry| entry.1).fold(f64::INFINITY, f64::min);
                run.touched.push(self.score(touched));
            }
        }
        run
    }
}

fn start_anew(space: &Space, random: &mut impl Rng) -> Vec<f64> {
    (0..space.dimension()).map(|_| random.random()).collect()
}

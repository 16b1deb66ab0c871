//! Warm start: the evidence of other states for a search that begins in a new state.
//!
//! The evidence is the nearest states in which a search was begun, on any machine. The measurements of the
//! nearest few give the [`MainEffects`]. The first points are the [portfolio](super::portfolio) of all these
//! states, then the best configuration by the effects. A portfolio of the best configurations of other
//! instances is how algorithm configurators begin as well (Feurer, Springenberg and Hutter, "Initializing
//! Bayesian hyperparameter optimization via meta-learning", AAAI 2015).
//!
//! Fitting takes some milliseconds, so its inputs are copied and it is computed apart where the tuner is
//! shared (see `plan`). Only the beginning of a search is taken over. The search is stored with its effects,
//! so that a restored tuner has equal ones even if other states have learnt since.

use crate::configuration::Configuration;
use crate::limits::REWARD_COST_MIN;
use crate::results::Record;
use crate::search::{Layout, MainEffects, SourceMeasurement, SourceRun, on_grid};
use crate::space::Space;
use crate::tuner::knowledge::portfolio::{MeasuredElsewhere, OtherState};

/// Numbers of nearest states, and of their best measured configurations, that main effects are fitted to.
pub(crate) const STATES: usize = 8;
const RECORDS: usize = 640;
/// Fewest states whose best fixed configuration is the incumbent of a new one. A single one that wants the
/// opposite would cost the search a ninth of the optimum at 20 trials.
const INCUMBENT_STATES_LEAST: usize = 2;
/// The most winners of single states beside the portfolio.
const WINNERS: usize = 16;
/// Multiple of a state's best cost above which a branch did badly there: where clients stop trials. A branch
/// that did so in all of the nearest states gets no look.
const LOOK_DEAREST: f64 = 4.0;
/// The most of their configurations that show what runs and what fails.
const RUNS: usize = 64;

#[derive(Clone, Debug)]
pub(crate) struct WarmStart {
    /// The effects of parameters elsewhere.
    pub(crate) main_effects: MainEffects,
    /// Points in the order in which they are run.
    pub(crate) first: Vec<Vec<f64>>,
    /// Winners of single states that are not among these, the nearest state's first.
    pub(crate) winners: Vec<Vec<f64>>,
    /// Points in which parameters act that do not in the default, the most promising first.
    pub(crate) looks: Vec<Vec<f64>>,
    /// Configurations that ran and that failed elsewhere; empty where nothing failed.
    pub(crate) runs: Vec<SourceRun>,
    /// The best fixed configuration of several other states, which is the incumbent here where it is not the
    /// default.
    pub(crate) incumbent: Option<Configuration>,
}

impl MeasuredElsewhere {
    /// Computes it: some milliseconds. `None` where nothing follows.
    pub(crate) fn beginning(&self, space: &Space) -> Option<WarmStart> {
        let mut measured = Vec::new();
        let nearest = &self.states[..self.states.len().min(STATES)];
        for (state, other) in nearest.iter().enumerate() {
            let reach = other.results.reach();
            let told = other.results.ranked().filter_map(|record| Some((record, record.told_cost(reach)?)));
            for (record, cost) in told.take(RECORDS / nearest.len()) {
                let log_cost = libm::log(cost.max(REWARD_COST_MIN));
                measured.push(SourceMeasurement { state, x: space.encode(&record.configuration), log_cost });
            }
        }
        assert!(measured.len() <= RECORDS, "{} measurements", measured.len());
        let layout = Layout::of(space);
        let main_effects = MainEffects::fit(&layout, &measured)?;
        let members = self.members(space);
        let mut first: Vec<Vec<f64>> = members.iter().map(|member| space.encode(member)).collect();
        let downhill = main_effects.descend(&layout, first.first()?);
        if !first.contains(&downhill) {
            first.push(downhill);
        }
        // The expected best of two or more other states is the incumbent here. That needs no proof: neither
        // it nor the default is known here, and the first few measurements show where it does badly. It is
        // rounded as it will be run, because a point is less exact than its configuration.
        let incumbent = Some(space.decode(&on_grid(&first[0])))
            .filter(|first| self.states.len() >= INCUMBENT_STATES_LEAST && first != space.default_ref());
        let winners = self.winners(space, &first);
        let (looks, runs) = (self.looks(space), self.runs(space));
        Some(WarmStart { main_effects, first, winners, looks, runs, incumbent })
    }

    /// For each parameter that does not act in the default: the configuration in which it acts that came
    /// nearest to the best of one of the nearest states. A state that is unlike all of them is most like this
    /// one. They are in the order of that distance.
    fn looks(&self, space: &Space) -> Vec<Vec<f64>> {
        let nearest = &self.states[..self.states.len().min(STATES)];
        let default = space.default_ref();
        let idle = space.parameters().iter().filter(|parameter| default.get(&parameter.name).is_none());
        let mut looks: Vec<(f64, Vec<f64>)> = Vec::new();
        for parameter in idle {
            let cheapest = nearest.iter().filter_map(|other| self.cheapest_with(&parameter.name, other));
            // The nearest state's among equals.
            let least = cheapest.reduce(|best, one| if one.0 < best.0 { one } else { best });
            let Some((ratio, configuration)) = least.filter(|(ratio, _)| *ratio <= LOOK_DEAREST) else {
                continue;
            };
            let x = space.encode(configuration);
            if looks.iter().all(|(_, other)| *other != x) {
                looks.push((ratio, x));
            }
        }
        looks.sort_by(|a, b| a.0.total_cmp(&b.0));
        looks.into_iter().map(|(_, x)| x).collect()
    }

    /// The cheapest configuration of another state in which a parameter acts and that is not known to fail,
    /// and its cost as a multiple of the best one there.
    fn cheapest_with<'a>(&self, name: &str, other: &'a OtherState) -> Option<(f64, &'a Configuration)> {
        let reach = other.results.reach();
        let is_told = |record: &&Record| record.told_cost(reach).is_some();
        let best = other.results.ranked().find(is_told)?;
        let acts = |record: &&Record| record.configuration.get(name).is_some();
        let runs = |record: &&Record| acts(record) && is_told(record) && !self.fails(&record.configuration);
        let cheapest = other.results.ranked().find(runs)?;
        let ratio = cheapest.mean_cost.max(REWARD_COST_MIN) / best.mean_cost.max(REWARD_COST_MIN);
        Some((ratio, &cheapest.configuration))
    }

    /// The answers of the states that are not among the `first` points and not known to fail, nearest first.
    fn winners(&self, space: &Space, first: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut winners: Vec<Vec<f64>> = Vec::new();
        let answers = self.states.iter().filter_map(|state| state.answers().next());
        for x in answers.filter(|answer| !self.fails(answer)).map(|answer| space.encode(answer)) {
            if winners.len() < WINNERS && !first.contains(&x) && !winners.contains(&x) {
                winners.push(x);
            }
        }
        winners
    }

    /// Configurations that ran and that failed in the nearest states, half of each: each configuration by the
    /// nearest that tried it.
    fn runs(&self, space: &Space) -> Vec<SourceRun> {
        let mut runs: Vec<SourceRun> = Vec::new();
        let nearest = &self.states[..self.states.len().min(STATES)];
        for failed in [true, false] {
            let mut room = RUNS / 2;
            for (place, other) in nearest.iter().enumerate() {
                let share = room.div_ceil(nearest.len() - place);
                let alike = other.results.records().iter().filter(|record| record.fails() == failed);
                let unseen = alike.filter(|record| {
                    let before = &nearest[..place];
                    before.iter().all(|nearer| nearer.results.record(&record.configuration).is_none())
                });
                let own = unseen.take(share).map(|record| space.encode(&record.configuration));
                let before = runs.len();
                runs.extend(own.map(|x| SourceRun { x, failed }));
                assert!(runs.len() - before <= room, "{} are more than {room}", runs.len() - before);
                room -= runs.len() - before;
            }
            if runs.is_empty() {
                break;
            }
        }
        assert!(runs.len() <= RUNS, "{} configurations", runs.len());
        runs
    }
}

//! Least squares over the paper's features, for each machine, each group of machines and the whole fleet.
//!
//! The paper leaves per-node prediction to future work ("hierarchical optimization or per node optimization
//! is promising"). Here every lesson teaches three models of the logarithm of cost: the fleet's, that of the
//! machine's group (same processor and software) and the machine's own. An answer weighs them by precision
//! (Gelman et al., "Bayesian Data Analysis", chapter 5): the inverse of the model's mean square error on this
//! machine's trials plus its variance at the asked point. A new machine's own model knows nothing, so the
//! fleet answers. As its trials come in, its own model takes over as far as it is better.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::{MODELS_MAX, REWARD_COST_MIN};
use crate::machines::Origin;
use crate::predict::nearest::neighbours;
use crate::predict::prequential::Fading;
use crate::predict::rbf::candidates::{CandidateConfiguration, Candidates};
use crate::predict::rbf::solver::Solver;
use crate::predict::rbf::{Basis, Shape};
use crate::predict::{Answer, Estimate, Lesson, Predictor, PredictorSetup, Query};
use crate::search::Verdict;
use crate::space::Space;

/// The prior's weight against one lesson.
const PRIOR: f64 = 1e-2;
/// A value more than this number of deviations from its expectation is drawn in (Huber, "Robust estimation of
/// a location parameter", 1964), after this number of lessons.
const SURPRISE: f64 = 4.0;
const SURPRISE_AFTER: u64 = 16;
/// Excess of an infeasible configuration over the worst cost seen, in logarithms.
const INFEASIBLE: f64 = 1.0;
/// A model's prior error on a new machine's trials, and the prior's weight in lessons.
const MISS: f64 = 0.05;
const MISS_WEIGHT: f64 = 3.0;
/// The factor by which an older error fades with each new one.
const MISS_FADE: f64 = 0.99;

/// A model's mean square error on a new machine's trials.
const PRIOR_MISS: Fading = Fading { sum: MISS * MISS_WEIGHT, weight: MISS_WEIGHT };

/// The model of a machine or a group, and the errors of the fleet's, the group's and its own model on its
/// trials.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Member {
    solver: Solver,
    misses: [Fading; 3],
    last: u64,
}

/// The models of one level, the [`MODELS_MAX`] that learnt last.
type MemberModels = BTreeMap<u64, Member>;

/// The predictor. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LeastSquares {
    basis: Basis,
    /// The logarithm of the first cost: values are relative to it, so that units do not matter.
    reference: Option<f64>,
    worst: f64,
    fleet: Solver,
    fleet_miss: Fading,
    groups: MemberModels,
    nodes: MemberModels,
    /// The one group and node met so far, while there is only one: the fleet's model is theirs.
    alone: Option<Origin>,
    candidates: Candidates,
}

/// The estimate of one value.
#[derive(Clone, Copy, Debug)]
struct ModelEstimate {
    mean: f64,
    variance: f64,
}

impl LeastSquares {
    /// An untrained model for `parameters` and `indicators`, its centres drawn from the study's seed.
    /// `omitted` are the places of indicators that it does not look at.
    pub fn new(parameters: usize, indicators: usize, seed: u64, omitted: &[usize]) -> Self {
        let basis = Basis::new(Shape::Printed, parameters, indicators, seed, omitted);
        LeastSquares {
            fleet: Solver::new(basis.len() + 1, PRIOR),
            fleet_miss: PRIOR_MISS,
            basis,
            reference: None,
            worst: 0.0,
            groups: MemberModels::new(),
            nodes: MemberModels::new(),
            alone: None,
            candidates: Candidates::default(),
        }
    }

    /// An untrained model of a study.
    pub(crate) fn for_study(setup: PredictorSetup<'_>) -> Self {
        Self::new(setup.space.dimension(), setup.indicators, setup.seed, setup.omitted)
    }

    fn features(&self, state_2: &[f64], action_2: &[f64], phi: &mut Vec<f64>) {
        self.basis.features(state_2, action_2, phi);
        phi.push(1.0);
        assert_eq!(phi.len(), self.basis.len() + 1, "the features and a constant");
    }

    /// The estimate of each model of a machine's chain, with its error there, the fleet's first.
    fn chain(&self, phi: &[f64], origin: Origin) -> Vec<ModelEstimate> {
        let (node, group) = (self.nodes.get(&origin.node), self.groups.get(&origin.group));
        let misses = node.or(group).map(|member| member.misses);
        let belief = |solver: &Solver, level: usize| {
            let miss = misses.map_or(self.fleet_miss, |misses| misses[level]).mean().unwrap_or(MISS);
            ModelEstimate { mean: solver.value(phi), variance: miss * (1.0 + solver.leverage(phi)) }
        };
        let solvers = [Some(&self.fleet), group.map(|group| &group.solver), node.map(|node| &node.solver)];
        solvers.into_iter().enumerate().filter_map(|(level, solver)| Some(belief(solver?, level))).collect()
    }

    /// The precision-weighted estimate of all models.
    fn believe(&self, phi: &[f64], origin: Origin) -> ModelEstimate {
        let chain = self.chain(phi, origin);
        assert!((1..=3).contains(&chain.len()), "{} models, the fleet's among them", chain.len());
        let precision = |belief: &ModelEstimate| 1.0 / belief.variance.max(f64::MIN_POSITIVE);
        let total: f64 = chain.iter().map(precision).sum();
        let mean = |of: fn(&ModelEstimate) -> f64| {
            chain.iter().map(|belief| precision(belief) / total * of(belief)).sum::<f64>()
        };
        // They learn from the same trials, so their errors do not cancel: variances average.
        ModelEstimate { mean: mean(|belief| belief.mean), variance: mean(|belief| belief.variance) }
    }

    fn expected(&self, belief: ModelEstimate) -> Option<Estimate> {
        let cost = libm::exp(belief.mean + self.reference?);
        Some(Estimate::new(cost, cost * libm::expm1(belief.variance.sqrt())))
    }

    /// Teaches the models of a machine and its group, once there is more than one of each.
    fn teach(&mut self, phi: &[f64], value: f64, origin: Origin) {
        let Some(alone) = self.alone else {
            self.alone = Some(origin);
            return;
        };
        if self.nodes.is_empty() && alone.node == origin.node {
            return;
        }
        let chain: Vec<f64> = {
            let level = |level: &MemberModels, key| level.get(&key).map(|member| member.solver.value(phi));
            let fleet = self.fleet.value(phi);
            let group = level(&self.groups, origin.group).unwrap_or(0.0);
            vec![fleet, group, level(&self.nodes, origin.node).unwrap_or(0.0)]
        };
        let (now, size) = (self.fleet.lessons(), phi.len());
        for (level, key) in [(&mut self.groups, origin.group), (&mut self.nodes, origin.node)] {
            let fresh = || Member { solver: Solver::new(size, PRIOR), misses: [PRIOR_MISS; 3], last: now };
            let member = level.entry(key).or_insert_with(fresh);
            assert_eq!(member.misses.len(), chain.len(), "a miss for every level");
            for (miss, expected) in member.misses.iter_mut().zip(&chain) {
                miss.take((value - expected) * (value - expected), MISS_FADE);
            }
            member.solver.learn(&mut phi.to_vec(), value);
            member.last = now;
            if level.len() > MODELS_MAX {
                let oldest = level.iter().min_by_key(|(_, member)| member.last).map(|(&key, _)| key);
                oldest.map(|key| level.remove(&key));
            }
            assert!(level.len() <= MODELS_MAX, "{} models of a level", level.len());
        }
    }
}

impl Predictor for LeastSquares {
    fn has_features(&self) -> bool {
        true
    }

    fn settle(&mut self, space: &Space) -> bool {
        self.candidates.settle(space)
    }

    fn learn(&mut self, lesson: &Lesson<'_>) {
        let (state_2, action_2) = (self.basis.state_2(lesson.state), self.basis.action_2(lesson.point));
        let mut phi = Vec::with_capacity(self.basis.len() + 1);
        self.features(&state_2, &action_2, &mut phi);
        let log = |cost: f64| libm::log(cost.max(REWARD_COST_MIN));
        let expected = self.believe(&phi, lesson.origin);
        let value = match (lesson.verdict, self.reference) {
            (Verdict::Cost(cost), _) => log(cost) - *self.reference.get_or_insert(log(cost)),
            (Verdict::Infeasible, Some(_)) => self.worst + INFEASIBLE,
            (Verdict::AtLeast(bound), Some(reference)) if expected.mean < log(bound) - reference => {
                log(bound) - reference
            }
            _ => return,
        };
        let reach = SURPRISE * expected.variance.sqrt();
        let value = if self.fleet.lessons() < SURPRISE_AFTER {
            value
        } else {
            expected.mean + (value - expected.mean).clamp(-reach, reach)
        };
        if let Verdict::Cost(cost) = lesson.verdict {
            self.worst = self.worst.max(value);
            self.candidates.keep(lesson, cost, action_2);
        }
        self.teach(&phi, value, lesson.origin);
        let miss = value - self.fleet.value(&phi);
        self.fleet_miss.take(miss * miss, MISS_FADE);
        self.fleet.learn(&mut phi, value);
    }

    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate> {
        let action_2 = self.basis.action_2(&query.space.encode(configuration));
        let mut phi = Vec::new();
        self.features(&self.basis.state_2(query.state), &action_2, &mut phi);
        self.expected(self.believe(&phi, query.origin()))
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let state_2 = self.basis.state_2(query.state);
        let mut phi = Vec::with_capacity(self.basis.len() + 1);
        let mut best: Option<(&CandidateConfiguration, ModelEstimate)> = None;
        for candidate in self.candidates.iter().filter(|candidate| !query.excludes(&candidate.configuration))
        {
            self.features(&state_2, &candidate.action_2, &mut phi);
            let belief = self.believe(&phi, query.origin());
            if best.is_none_or(|(_, best)| belief.mean < best.mean) {
                best = Some((candidate, belief));
            }
        }
        let (candidate, belief) = best?;
        Some(Answer {
            configuration: candidate.configuration.clone(),
            expected: self.expected(belief)?,
            neighbours: neighbours(query),
        })
    }
}

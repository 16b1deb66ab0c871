//! A predictor that models states and configurations together, and can propose new configurations.
//!
//! Where every input is met once, no search inside one state gets far, and a neighbour's best known
//! configuration is the best of very few. The remedy is a model of cost over indicators and parameters
//! together: a contextual Gaussian process (Krause and Ong, "Contextual Gaussian process bandit
//! optimization", NIPS 2011). Measurements stay in the states' tables. A question fits a small process to the
//! measurements of the states nearest to it (local fits after Gramacy and Apley, "Local Gaussian process
//! approximation for large computer experiments", 2015). So an answer costs no more after a million trials.
//! Lessons only move lengths and noise, one step each while there are few.

mod local_data;
mod lowest;
mod running;

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::gp::kernel::FeatureKind;
use crate::gp::warping::RobustLog;
use crate::gp::{Hyperparameters, Prior, Process, Sample, Schedule};
use crate::predict::nearest::neighbours;
use crate::predict::{Answer, Estimate, Lesson, Predictor, PredictorSetup, Query, draw_in};
use crate::randomness::{Purpose, stream};
use crate::search::Verdict;
use crate::search::layout::Layout;
use crate::space::Space;
use crate::trial::Neighbour;
pub(crate) use local_data::LocalData;

/// The number of latest lessons that lengths are learnt from.
const LESSONS_MAX: usize = 160;
/// Up to this number each lesson takes a step. Later lessons share a step: about an eighth of all lessons so
/// far, within these limits. A step takes as much time as ten trials, and lengths change slowly by then.
const LESSONS_EAGER: u64 = 160;
const LESSONS_SHARE: [u64; 2] = [32, 512];
/// Steps of ascent for a lesson.
const STEPS: usize = 2;
/// The prior of lengths and noise before anything is measured. Lengths have room to differ, which separates
/// indicators that matter from the others. With 64 lessons, twenty indicators and a spread of 0.35 the mean
/// regret was 0.79 in rounds 121 to 160, and 0.19 with this prior.
const PRIOR: Prior = Prior {
    length_mean: 0.4,
    length_spread: 0.6,
    weight_range: [1e-6, 1e4],
    noise_mean: 0.01,
    noise_spread: 1.5,
    noise_range: [1e-5, 4.0],
    squares: 1e-2,
    step_max: 0.8,
};
/// Deviations that are subtracted from the expected cost. The first is for a new configuration. The second is
/// for an answer where no state is searched, so that answers themselves must learn. The third is for an
/// answer where states near by were searched, so that measured configurations are preferred.
const EXPLORE: f64 = 1.0;
const EXPLOIT: f64 = 1.0;
const EXPLOIT_SEARCHED: f64 = -0.5;

/// A measurement that lengths are learnt from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Example {
    features: Vec<f64>,
    cost: f64,
}

/// The features of states and configurations: indicators first, then the machine, then parameters.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct FeatureMap {
    layout: Layout,
    kinds: Vec<FeatureKind>,
}

impl FeatureMap {
    fn of(space: &Space, indicators: usize) -> Arc<Self> {
        let layout = Layout::of(space);
        let mut kinds = vec![FeatureKind::Ordered; indicators];
        kinds.push(FeatureKind::Categorical);
        kinds.extend(layout.kinds());
        Arc::new(FeatureMap { layout, kinds })
    }

    /// The features of a state on a machine, by the machine's number.
    fn state(&self, indicators: &[f64], machine: u64) -> Vec<f64> {
        indicators.iter().map(|&x| draw_in(x)).chain([machine as f64]).collect()
    }

    fn features(&self, point: &[f64]) -> Vec<f64> {
        let mut x = point.to_vec();
        let active = self.layout.canonical(&mut x);
        self.layout.features(&x, &active)
    }
}

/// The number of lessons that share a step after `lessons` of them: a power of two, so that steps are evenly
/// apart.
fn share(lessons: u64) -> u64 {
    let [least, most] = LESSONS_SHARE;
    let eighth = (lessons / 8).max(1);
    (1 << eighth.ilog2()).clamp(least, most)
}

/// The predictor. See the head of this module.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Contextual {
    #[serde(skip)]
    features: Arc<FeatureMap>,
    indicators: usize,
    seed: u64,
    pub(super) hyper: Hyperparameters,
    /// The latest lessons, in a ring.
    examples: Vec<Example>,
    lessons: u64,
}

/// An update of lengths and noise by the latest lessons. To apply it takes a fit.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HyperparameterUpdate {
    features: Arc<FeatureMap>,
    examples: Vec<Example>,
}

impl HyperparameterUpdate {
    /// Moves lengths and noise by some steps of their posterior's gradient.
    pub(crate) fn apply(&self, hyper: &mut Hyperparameters) {
        let costs: Vec<f64> = self.examples.iter().map(|example| example.cost).collect();
        let Some(warping) = RobustLog::of(&costs) else { return };
        let points: Vec<&[f64]> = self.examples.iter().map(|example| &example.features[..]).collect();
        let sample = Sample::new(self.features.kinds.clone(), &points, vec![1.0; points.len()]);
        let values: Vec<f64> = costs.iter().map(|&cost| warping.see(cost)).collect();
        let schedule = Schedule { steps: STEPS - 1, ahead: true };
        // Where the lessons cannot be fitted, the hyperparameters stay.
        let _fitted = Process::learn(sample, &[(values, 0.0)], hyper, &PRIOR, schedule);
    }
}

/// The inputs of [`Predictor::predict`] and [`Predictor::propose`] for an answer apart from the study.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FitRequest {
    data: LocalData,
    hyper: Hyperparameters,
    /// Number of deviations that are subtracted from the expected cost.
    optimism: f64,
    neighbours: Vec<Neighbour>,
    /// The configuration of the answer without this model. `None` for a point to explore.
    rival: Option<Configuration>,
    /// Names the random numbers: the study's seed, the purpose and the number.
    random: (u64, u64, u64),
}

impl FitRequest {
    /// The answer, if there are enough measurements.
    pub(crate) fn answer(&self, space: &Space) -> Option<Answer> {
        let (seed, kind, number) = self.random;
        let random = &mut stream(seed, Purpose::Contextual, kind, number);
        self.data.answer(self, space, random)
    }

    pub(crate) fn beside(self, rival: Configuration) -> Self {
        FitRequest { rival: self.rival.is_some().then_some(rival), ..self }
    }
}

impl Contextual {
    pub(crate) fn new(setup: PredictorSetup<'_>) -> Self {
        let PredictorSetup { space, indicators, seed, .. } = setup;
        let features = FeatureMap::of(space, indicators);
        let hyper = Hyperparameters::new(&features.kinds, &PRIOR);
        Contextual { hyper, features, indicators, seed, examples: Vec::new(), lessons: 0 }
    }

    /// Adds a lesson. Gives the update of lengths and noise that is now due, to be applied later.
    pub(super) fn note(&mut self, lesson: &Lesson<'_>) -> Option<HyperparameterUpdate> {
        let Verdict::Cost(cost) = lesson.verdict else { return None };
        let mut features = self.features.state(lesson.state, lesson.machine);
        features.extend(self.features.features(lesson.point));
        assert_eq!(features.len(), self.features.kinds.len(), "a lesson of other features");
        let example = Example { features, cost };
        let place = (self.lessons % LESSONS_MAX as u64) as usize;
        match self.examples.get_mut(place) {
            Some(old) => *old = example,
            None => {
                assert_eq!(place, self.examples.len(), "the ring fills in order");
                self.examples.push(example);
            }
        }
        self.lessons += 1;
        let due = self.lessons <= LESSONS_EAGER || self.lessons.is_multiple_of(share(self.lessons));
        (due && self.examples.len() >= 4).then(|| HyperparameterUpdate {
            features: Arc::clone(&self.features),
            examples: self.examples.clone(),
        })
    }

    pub(super) fn local_data(&self, query: &Query<'_>) -> LocalData {
        LocalData::new(&self.features, query)
    }

    /// The request for an answer to exploit.
    pub(super) fn request(&self, query: &Query<'_>) -> FitRequest {
        let data = self.local_data(query);
        let optimism = if data.is_mostly_searched() { EXPLOIT_SEARCHED } else { EXPLOIT };
        self.requested(query, data, optimism, (self.seed, 0, self.lessons))
    }

    /// The request for a point to explore.
    pub(super) fn proposal(&self, query: &Query<'_>, number: u64) -> FitRequest {
        let query = &Query { rival: None, ..*query };
        self.requested(query, self.local_data(query), EXPLORE, (self.seed, 1, number))
    }

    fn requested(
        &self,
        query: &Query<'_>,
        data: LocalData,
        optimism: f64,
        random: (u64, u64, u64),
    ) -> FitRequest {
        let (hyper, rival) = (self.hyper.clone(), query.rival.cloned());
        FitRequest { data, hyper, optimism, neighbours: neighbours(query), rival, random }
    }
}

impl Predictor for Contextual {
    fn settle(&mut self, space: &Space) -> bool {
        self.features = FeatureMap::of(space, self.indicators);
        let width = self.features.kinds.len();
        self.hyper.fits(width) && self.examples.iter().all(|example| example.features.len() == width)
    }

    fn learn(&mut self, lesson: &Lesson<'_>) {
        if let Some(update) = self.note(lesson) {
            update.apply(&mut self.hyper);
        }
    }

    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate> {
        self.local_data(query).estimate(&self.hyper, query.space, configuration)
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        self.request(query).answer(query.space)
    }

    fn propose(&self, query: &Query<'_>, number: u64) -> Option<Answer> {
        self.proposal(query, number).answer(query.space)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_become_rarer_and_never_too_rare() {
        let due = |lessons: &u64| lessons.is_multiple_of(share(*lessons));
        let steps: Vec<u64> = (LESSONS_EAGER + 1..=100_000).filter(due).collect();
        let apart: Vec<u64> = steps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(apart.is_sorted() && apart[0] == 32 && apart.last() == Some(&512), "{apart:?}");
        assert!(steps[0] <= LESSONS_EAGER + 32, "the first of them comes soon: {}", steps[0]);
    }
}

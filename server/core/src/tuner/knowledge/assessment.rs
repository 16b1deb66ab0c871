//! The proven configurations of a state, and the choice of the exploited one.
//!
//! The lowest of many noisy costs is mostly luck. So a state's own answer is read from a
//! [posterior](crate::statistics::estimate). It is the configuration with the least expected cost among those
//! whose expected gain over the state's incumbent is much larger than the expected loss ([`WORTH`]). Where
//! there is none, the answer is the incumbent: the best of other states or the study's default configuration,
//! until a [confirmation](crate::tuner::exploring::confirmation) replaces it.
//!
//! An assessment takes milliseconds, up to some 25 in a state of many configurations. It is made apart from
//! the tuner, from a copy of the state's table, and kept until the table changes. A caller that cannot wait
//! gets the last assessment.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::configuration::Configuration;
use crate::gp::kernel::squared_distance;
use crate::ids::StateId;
use crate::limits::{ASSESSED_MAX, ASSESSED_SHARED_MAX, ASSESSMENTS_MAX};
use crate::predict::WORTH;
use crate::results::{Record, ResultTable};
use crate::robust::{
    Evidence, REACH_AFTER, SPREAD_LEAST, USUAL_COUNT, deviation, draw_in, median, reach_of, trusted,
};
use crate::search::Layout;
use crate::space::Space;
use crate::standing::Gain;
use crate::statistics::confirm::GAIN_LEAST;
use crate::statistics::estimate::{Comparison, ConfigurationSample, CostPosterior, Measurement};
use crate::study::StudySpec;

/// If the rounds of a confirmation leave a race open, a challenger wins that is better with this probability
/// by all measurements.
const PROBABLE: f64 = 0.95;
/// Number of configurations with the lowest expected costs that are compared more closely.
const LEADERS: usize = 8;
/// Most degrees of freedom with which one configuration contributes to the usual noise.
const FREEDOM_COUNTED: f64 = 3.0;
/// Costs of zero have no logarithm: they count as this share of the least that is above zero.
const SHARE_LEAST: f64 = 1e-12;

/// A copy of the inputs of a state's assessment.
#[derive(Clone, Debug)]
pub struct AssessmentRequest {
    pub(crate) state: StateId,
    pub(crate) spec: Arc<StudySpec>,
    pub(crate) results: Arc<ResultTable>,
    /// The incumbent where that is not the default.
    pub(crate) confirmed: Option<Configuration>,
    /// The verdict stands: the incumbent is the answer.
    pub(crate) is_settled: bool,
    /// A client's start, which takes the place of the default and of the incumbent.
    pub(crate) start: Option<Configuration>,
}

/// The assessment of a state's configurations.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// The version of the table that it was made from, and the incumbent at that time.
    version: u64,
    confirmed: Option<Configuration>,
    is_settled: bool,
    /// The start in the place of the default; `None` for the default itself.
    pub(crate) start: Option<Configuration>,
    /// The configuration to exploit.
    pub(crate) answer: Configuration,
    /// The configuration with the least expected cost among those that are better than the incumbent with a
    /// probability of at least [`PROBABLE`].
    pub(crate) probable: Option<Configuration>,
    /// The answer's cost, with the ends of its 95 % interval.
    pub(crate) cost: f64,
    pub(crate) cost_low: f64,
    pub(crate) cost_high: f64,
    /// The answer's gain over the default; `None` where the default was not measured.
    pub(crate) gain: Option<Gain>,
    /// The answer is the default, because no configuration is proven to be better.
    pub(crate) nothing_better: bool,
    pub(crate) is_incumbent: bool,
    /// The most that any other configuration may gain over the answer.
    pub(crate) gain_at_most: f64,
    /// The configurations that may be better than the incumbent, the best first.
    pub(crate) challengers: Vec<Configuration>,
    /// The standard deviation of the logarithm of one measurement.
    pub(crate) noise: f64,
}

impl Assessment {
    /// Whether it was made beside this incumbent; `None` for the default.
    pub(crate) fn is_beside(&self, confirmed: Option<&Configuration>) -> bool {
        self.confirmed.as_ref() == confirmed
    }
}

impl AssessmentRequest {
    /// The assessed state.
    pub fn state(&self) -> StateId {
        self.state
    }

    /// Whether the assessment takes only microseconds.
    pub(crate) fn is_quick(&self) -> bool {
        self.results.ranked().len() <= ASSESSED_SHARED_MAX
    }

    /// Whether an assessment was made from these inputs.
    pub(crate) fn is_answered_by(&self, assessment: &Assessment) -> bool {
        assessment.version == self.results.version()
            && assessment.confirmed == self.confirmed
            && assessment.is_settled == self.is_settled
            && assessment.start == self.start
    }

    /// Makes the assessment. `None` where nothing that can be run was measured.
    pub fn compute(&self) -> Option<Assessment> {
        let default = self.start.as_ref().unwrap_or(self.spec.space.default_ref());
        let incumbent = self.confirmed.as_ref().unwrap_or(default);
        let records = self.results.spread(ASSESSED_MAX / 2, ASSESSED_MAX / 2 - 2, &[default, incumbent]);
        let layout = Layout::of(&self.spec.space);
        let place = |of: &Configuration| records.iter().position(|record| record.configuration == *of);
        let default_at = place(default);
        let incumbent_at = place(incumbent).or(default_at);
        let (space, noise) = (&self.spec.space, self.results.assumed_noise());
        let posterior = posterior(&records, &layout, space, noise, [default_at, incumbent_at])?;
        let means = posterior.means();
        let mut leaders: Vec<usize> = (0..records.len()).collect();
        leaders.sort_by(|&a, &b| means[a].total_cmp(&means[b]));
        leaders.truncate(LEADERS);
        assert!(!leaders.is_empty() && means.len() == records.len(), "{} means", means.len());
        let over = |one: usize| -> Option<Comparison> {
            incumbent_at.filter(|&at| at != one).map(|at| posterior.compare(one, at))
        };
        let compared: Vec<(usize, Option<Comparison>)> =
            leaders.iter().map(|&leader| (leader, over(leader))).collect();
        let first = |rule: &dyn Fn(&Comparison) -> bool| {
            let mut beside = compared.iter().filter(|_| !self.is_settled);
            let found = beside.find(|(_, comparison)| comparison.as_ref().is_some_and(rule));
            found.map(|(leader, _)| *leader)
        };
        let probable = first(&|comparison| comparison.probability_better >= PROBABLE);
        let worth = first(&|comparison| comparison.is_worth(WORTH));
        let answer = worth.or(incumbent_at).unwrap_or(leaders[0]);
        let challengers = compared.iter().filter(|(_, comparison)| {
            comparison.is_some_and(|comparison| comparison.gain > 0.0 && comparison.gain_high > GAIN_LEAST)
        });
        let at_most = |&(leader, comparison): &(usize, Option<Comparison>)| match comparison {
            Some(comparison) if Some(answer) == incumbent_at => comparison.gain_high,
            _ if leader == answer => 0.0,
            _ => posterior.compare(leader, answer).gain_high,
        };
        let (low, high) = posterior.interval(answer);
        assert!(low <= high, "a cost between {low} and {high}");
        let cost = |log: f64| libm::exp(log).min(f64::MAX);
        Some(Assessment {
            version: self.results.version(),
            confirmed: self.confirmed.clone(),
            is_settled: self.is_settled,
            start: self.start.clone(),
            answer: records[answer].configuration.clone(),
            probable: probable.map(|probable| records[probable].configuration.clone()),
            cost: cost(means[answer]),
            cost_low: cost(low),
            cost_high: cost(high),
            gain: default_at.map(|at| gain(posterior.compare(answer, at))),
            nothing_better: Some(answer) == default_at,
            is_incumbent: Some(answer) == incumbent_at,
            gain_at_most: compared.iter().map(at_most).fold(0.0, f64::max),
            challengers: challengers.map(|(leader, _)| records[*leader].configuration.clone()).collect(),
            noise: posterior.noise(),
        })
    }
}

/// A comparison in the form in which it is reported.
fn gain(comparison: Comparison) -> Gain {
    let Comparison { gain, gain_low, gain_high, probability_better, .. } = comparison;
    let finite = |share: f64| Some(share).filter(|share| share.is_finite());
    let share = gain.max(f64::MIN);
    Gain {
        share,
        low: finite(gain_low),
        high: finite(gain_high),
        probability_better: Some(probability_better),
    }
}

fn posterior(
    records: &[&Record],
    layout: &Layout,
    space: &Space,
    noise: f64,
    compared: [Option<usize>; 2],
) -> Option<CostPosterior> {
    let mut samples = samples(records, layout, space, noise, compared);
    weigh(&mut samples);
    let kinds = layout.kinds();
    CostPosterior::of(&samples, |a, b| {
        kinds.iter().zip(a.iter().zip(b)).map(|(&kind, (&a, &b))| squared_distance(kind, a, b)).sum()
    })
}

/// The measurements of configurations, cleaned so that one absurd report does no harm. Measurements that
/// others of their configuration contradict are passed over or drawn in. A measurement far above all others
/// and above the records at `compared` is drawn in, because its exact cost does not matter. A single
/// measurement far below is drawn in likewise. Beside the `noise` of the state, a standard deviation, those
/// with large standard errors count for less.
pub(crate) fn samples(
    records: &[&Record],
    layout: &Layout,
    space: &Space,
    noise: f64,
    compared: [Option<usize>; 2],
) -> Vec<ConfigurationSample> {
    let costs = records.iter().flat_map(|record| record.evidence.values());
    let least = costs.filter(|cost| **cost > 0.0).copied().fold(f64::INFINITY, f64::min);
    let least = if least.is_finite() { (SHARE_LEAST * least).max(f64::MIN_POSITIVE) } else { 1.0 };
    let mut usual: Vec<f64> = records.iter().map(|record| libm::log(record.mean_cost.max(least))).collect();
    let logs = usual.clone();
    let middle = median(&mut usual);
    let reach = match records.len() < REACH_AFTER {
        true => f64::INFINITY,
        false => reach_of(deviation(&logs, middle)),
    };
    let (low, high) = (middle - reach, middle + reach);
    assert!(low <= high, "from {low} to {high}");
    let ceiling = compared.iter().flatten().map(|&place| logs[place] + reach).fold(high, f64::max);
    let one = |(place, record): (usize, &&Record)| {
        let mut x = space.encode(&record.configuration);
        let active = layout.canonical(&mut x);
        let (features, usual) = (layout.features(&x, &active), Some(libm::exp(middle)));
        let mut one = sample(features, &record.evidence, noise, (least, usual));
        let is_single = one.measurements.len() == 1;
        let least = if is_single { low } else { f64::NEG_INFINITY };
        let most = match compared.contains(&Some(place)) {
            true if is_single => high,
            true => f64::INFINITY,
            false => ceiling,
        };
        one.measurements.iter_mut().for_each(|one| one.log_cost = one.log_cost.clamp(least, most));
        one
    };
    records.iter().enumerate().map(one).collect()
}

/// Lets configurations whose measurements scatter more than is usual count for less: the posterior has one
/// noise for all, but some configurations vary more, for example where threads meet by chance. Each
/// configuration's variance is drawn towards the usual one, which has the weight of [`USUAL_COUNT`]
/// measurements.
fn weigh(samples: &mut [ConfigurationSample]) {
    let freedom = |sample: &ConfigurationSample| sample.measurements.len() as f64 - 1.0;
    let mut variances: Vec<(f64, f64)> = samples
        .iter()
        .filter(|sample| sample.measurements.len() > 1)
        .map(|sample| (sample.scatter() / freedom(sample), freedom(sample).min(FREEDOM_COUNTED)))
        .collect();
    variances.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The median of the variances, weighted by degrees of freedom, unless one configuration has most of
    // these.
    let all: f64 = variances.iter().map(|(_, freedom)| freedom).sum();
    let mut seen = 0.0;
    let usual = variances.iter().find(|(_, freedom_of_one)| {
        seen += freedom_of_one;
        seen >= all / 2.0
    });
    let Some(&(usual, _)) = usual else { return };
    let usual = usual.max(SPREAD_LEAST * SPREAD_LEAST);
    for sample in samples {
        let own = (USUAL_COUNT * usual + sample.scatter()) / (USUAL_COUNT + freedom(sample));
        sample.weight *= (usual / own).min(1.0);
        assert!(sample.weight > 0.0 && sample.weight <= 1.0, "a weight of {}", sample.weight);
    }
}

/// The measurements of one configuration; wild ones are passed over or drawn in. Costs count as `least` at
/// least.
fn sample(
    features: Vec<f64>,
    evidence: &Evidence,
    noise: f64,
    (least, usual): (f64, Option<f64>),
) -> ConfigurationSample {
    let places = trusted(evidence.values(), usual);
    let mut logs: Vec<f64> =
        places.iter().map(|&place| libm::log(evidence.values()[place].max(least))).collect();
    draw_in(&mut logs);
    let measurement = |(log_cost, place): (f64, usize)| Measurement {
        log_cost,
        moment: evidence.moments()[place],
        weight: evidence.weight(place, noise),
    };
    let measurements = logs.into_iter().zip(places).map(measurement).collect();
    ConfigurationSample { features, measurements, weight: 1.0 }
}

/// The last assessments of the states that were assessed last, each beside the default or a start. Each can
/// be computed again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Assessments {
    made: BTreeMap<(StateId, Option<Configuration>), (u64, Arc<Assessment>)>,
    clock: u64,
}

impl Assessments {
    /// The last assessment of a state, beside the default or a start, which may be out of date.
    pub(crate) fn of(&self, state: StateId, start: Option<&Configuration>) -> Option<&Arc<Assessment>> {
        self.made.get(&(state, start.cloned())).map(|(_, assessment)| assessment)
    }

    /// Keeps an assessment, and forgets the oldest of too many.
    pub(crate) fn keep(&mut self, state: StateId, assessment: Arc<Assessment>) {
        self.clock += 1;
        self.made.insert((state, assessment.start.clone()), (self.clock, assessment));
        if self.made.len() > ASSESSMENTS_MAX {
            let oldest = self.made.iter().min_by_key(|(_, (made, _))| *made).map(|(of, _)| of.clone());
            oldest.map(|of| self.made.remove(&of));
        }
        assert!(self.made.len() <= ASSESSMENTS_MAX, "{} assessments are kept", self.made.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_restless_counts_for_less_and_what_is_usual_for_all_it_ran() {
        let of = |costs: &[f64]| {
            let mut evidence = Evidence::default();
            costs.iter().for_each(|cost| {
                evidence.push(*cost, None);
            });
            sample(Vec::new(), &evidence, 0.05, (f64::MIN_POSITIVE, None))
        };
        let quiet = [of(&[10.0, 10.4, 9.7]), of(&[12.0, 12.5, 11.9]), of(&[11.0])];
        let restless = of(&[14.2, 11.8, 15.6, 12.0, 28.4, 12.2, 49.1]);
        let mut samples = quiet.to_vec();
        samples.push(restless.clone());
        weigh(&mut samples);
        assert!(samples[3].weight < 0.2, "{}", samples[3].weight);
        assert_eq!(samples[3].measurements, restless.measurements);
        assert_eq!(samples[2].weight, 1.0, "nothing is known of its own noise");
        assert!(samples[0].weight > 2.0 / 3.0 && samples[0].weight <= 1.0, "{}", samples[0].weight);
        // Where nothing ran twice there is nothing to compare with.
        let mut once = vec![of(&[10.0]), of(&[20.0])];
        weigh(&mut once);
        assert!(once.iter().all(|sample| sample.weight == 1.0));
    }
}

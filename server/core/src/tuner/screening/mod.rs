//! Sequential sensitivity screening: finds the parameters that no longer matter in a state.
//!
//! A linear model of each parameter's own effect on the logarithm of the cost is kept for the states that
//! were explored last. The common part of their effects is learnt from all of them (see `regression`). Every
//! few trials the model judges each parameter. If the chance that another value gains more than [`GAIN`] over
//! the best known one is below the policy's risk, the search holds the parameter there. Later evidence to the
//! contrary releases it. Every [`CONTROL`]th point holds nothing, so that such evidence can appear.
//!
//! The model cannot see effects that two parameters only have together. They count as noise, which makes the
//! model careful. A parameter that decides whether others are active is never held. After Morris ("Factorial
//! sampling plans for preliminary computational experiments", Technometrics 1991) in aim, Bayesian in method.

mod features;
mod regression;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::{SCREENED_FEATURES_MAX, SCREENED_STATES_MAX};
use crate::space::Space;
use features::ParameterFeatures;
use regression::{Common, Sums};

/// A gain above this share matters.
const GAIN: f64 = 0.02;
/// Number of tried configurations after which the question is asked again.
const EVERY: usize = 8;
/// One point of this number holds nothing.
pub(super) const CONTROL: u64 = 8;

/// The evidence of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Screening {
    #[serde(skip)]
    parts: Vec<ParameterFeatures>,
    /// Parameters on which others depend.
    #[serde(skip)]
    gates: Vec<bool>,
    #[serde(skip)]
    width: usize,
    /// For each kept state, its sums, the first cost, and the time of the last lesson.
    states: BTreeMap<usize, ScreenedState>,
    clock: u64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct ScreenedState {
    sums: Sums,
    first_cost: f64,
    last: u64,
}

/// The parameters that the search of a state holds. Stored with the search.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct HeldParameters {
    /// The number of tried configurations at the decision.
    pub(super) tried: usize,
    /// The held parameters, by their place in the space.
    pub(super) axes: Vec<HeldAxis>,
    /// The number of points asked for while a parameter was held.
    pub(super) points: u64,
}

/// A parameter that is held.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct HeldAxis {
    /// Its place in the space.
    pub(super) axis: usize,
    /// Its held coordinate, in 0..1.
    pub(super) x: f64,
    /// The most that another value may gain, as a share of the cost; the chance of more is the policy's risk.
    pub(super) gain_at_most: f64,
    /// The number of tried configurations when it was first held.
    pub(super) since: usize,
}

impl Screening {
    pub(super) fn new(space: &Space) -> Self {
        let parts = features::parts(space);
        let width = parts.last().map_or(1, |part| part.first + part.count);
        let conditions = space.parameters().iter().filter_map(|parameter| parameter.active_if.as_ref());
        let parents: Vec<&String> = conditions.map(|condition| &condition.parameter).collect();
        let gates = space.parameters().iter().map(|parameter| parents.contains(&&parameter.name)).collect();
        Screening { parts, gates, width, states: BTreeMap::new(), clock: 0 }
    }

    /// Completes the evidence that was read from a checkpoint. `false` when it is of another space.
    pub(super) fn settle(&mut self, space: &Space) -> bool {
        let Screening { parts, gates, width, .. } = Screening::new(space);
        (self.parts, self.gates, self.width) = (parts, gates, width);
        self.states.values().all(|kept| kept.sums.fits(width))
    }

    /// Whether the space is small enough for the sums.
    fn is_able(&self) -> bool {
        self.width <= SCREENED_FEATURES_MAX
    }

    /// Learns from a measured configuration, or from a bound that stands for it.
    pub(super) fn learn(&mut self, space: &Space, state: usize, configuration: &Configuration, cost: f64) {
        if !self.is_able() || cost <= f64::MIN_POSITIVE {
            return;
        }
        self.clock += 1;
        let (clock, width) = (self.clock, self.width);
        let kept = self.states.entry(state).or_insert_with(|| ScreenedState {
            sums: Sums::new(width),
            first_cost: cost,
            last: clock,
        });
        kept.last = clock;
        let target = libm::log(cost) - libm::log(kept.first_cost);
        kept.sums.learn(&features::of(space, &self.parts, configuration), target);
        if self.states.len() > SCREENED_STATES_MAX {
            let oldest = self.states.iter().min_by_key(|(_, kept)| kept.last).map(|(state, _)| *state);
            oldest.map(|oldest| self.states.remove(&oldest));
        }
        assert!(self.states.len() <= SCREENED_STATES_MAX, "{} states", self.states.len());
    }

    /// Forgets all of a state, because its costs have changed.
    pub(super) fn begin_again(&mut self, state: usize) {
        self.states.remove(&state);
    }

    /// Whether it is time to ask again which parameters to hold.
    pub(super) fn is_due(&self, held: Option<&HeldParameters>, tried: usize) -> bool {
        self.is_able() && held.is_none_or(|held| tried >= held.tried + EVERY)
    }

    /// The parameters to hold in a state, at the values of `best`.
    pub(super) fn judge(
        &self,
        space: &Space,
        state: usize,
        best: &Configuration,
        risk: f64,
        before: Option<&HeldParameters>,
        tried: usize,
    ) -> HeldParameters {
        let points = before.map_or(0, |held| held.points);
        let none = HeldParameters { tried, axes: Vec::new(), points };
        let fresh = Sums::new(self.width);
        let sums = self.states.get(&state).map_or(&fresh, |kept| &kept.sums);
        let all = self.states.values().map(|kept| &kept.sums);
        let Some(common) = Common::learn(all, self.width) else {
            return none;
        };
        let Some(effects) = common.effects(sums) else {
            return none;
        };
        let mut axes = Vec::new();
        for part in &self.parts {
            let parameter = &space.parameters()[part.axis];
            let (false, Some(value)) = (self.gates[part.axis], best.get(&parameter.name)) else {
                continue;
            };
            let own = features::of(space, &self.parts, best);
            assert_eq!(own.len(), self.width, "features of every parameter");
            let own = &own[part.first..part.first + part.count];
            let others: Vec<Vec<f64>> =
                features::alternatives(space, part).into_iter().filter(|other| other != own).collect();
            let deviations = quantile(1.0 - risk / others.len().max(1) as f64);
            let gain = |other: &Vec<f64>| {
                let mut combination = vec![0.0; self.width];
                for (place, (other, own)) in other.iter().zip(own).enumerate() {
                    combination[part.first + place] = own - other;
                }
                let mean: f64 = combination.iter().zip(&effects.mean).map(|(a, b)| a * b).sum();
                mean + deviations * effects.variance(&combination).sqrt()
            };
            let gain_at_most = others.iter().map(gain).fold(0.0, f64::max);
            if gain_at_most < GAIN {
                let held_before =
                    before.and_then(|held| held.axes.iter().find(|axis| axis.axis == part.axis));
                axes.push(HeldAxis {
                    axis: part.axis,
                    x: parameter.domain.encode(value),
                    gain_at_most,
                    since: held_before.map_or(tried, |axis| axis.since),
                });
            }
        }
        HeldParameters { tried, axes, points }
    }
}

/// The value that a standard normal number exceeds with probability `1 - p`, for `p` in 0.5..1: by halving.
fn quantile(p: f64) -> f64 {
    assert!((0.5..=1.0).contains(&p), "a probability of {p}");
    let (mut low, mut high) = (0.0, 40.0);
    for _ in 0..60 {
        let middle = (low + high) / 2.0;
        let above = 0.5 * libm::erfc(middle / std::f64::consts::SQRT_2);
        if above > 1.0 - p { low = middle } else { high = middle }
    }
    (low + high) / 2.0
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::space::{Domain, Parameter, Scale};
    use crate::value::Value;

    fn space() -> Space {
        let parameter = |name: &str| Parameter {
            name: name.into(),
            domain: Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear },
            default: Value::Float(0.5),
            active_if: None,
        };
        let switch =
            Parameter { domain: Domain::Boolean, default: Value::Boolean(false), ..parameter("switch") };
        Space::new(vec![parameter("a"), parameter("b"), switch], vec![]).expect("valid")
    }

    fn number(configuration: &Configuration, name: &str) -> f64 {
        configuration.get(name).and_then(Value::as_number).unwrap_or(0.0)
    }

    fn learn(screening: &mut Screening, state: usize, trials: u64, cost: impl Fn(&Configuration) -> f64) {
        let space = space();
        let mut random = ChaCha8Rng::seed_from_u64(state as u64 + 100);
        for _ in 0..trials {
            let configuration = space.decode(&[random.random(), random.random(), random.random()]);
            let noise = 0.02 * (2.0 * random.random::<f64>() - 1.0);
            screening.learn(&space, state, &configuration, cost(&configuration) * f64::exp(noise));
        }
    }

    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        for (p, expected) in
            [(0.5, 0.0), (0.95, 1.644_853_627), (0.99, 2.326_347_874), (0.9999, 3.719_016_485)]
        {
            assert!((quantile(p) - expected).abs() < 1e-8, "{p}");
        }
    }

    #[test]
    fn what_does_not_matter_is_held_and_thaws_when_it_does() {
        let space = space();
        let mut screening = Screening::new(&space);
        for state in 0..6 {
            learn(&mut screening, state, 120, |c| 10.0 * (0.5 * number(c, "a")).exp());
        }
        let best = space.decode(&[0.3, 0.5, 0.1]);
        let held = screening.judge(&space, 0, &best, 0.05, None, 120);
        let axes: Vec<usize> = held.axes.iter().map(|axis| axis.axis).collect();
        assert_eq!(axes, [1, 2], "{held:?}");
        // A parameter that matters has nothing to gain at its best value.
        let settled = space.decode(&[0.0, 0.5, 0.1]);
        let held = screening.judge(&space, 0, &settled, 0.05, Some(&held), 128);
        assert_eq!(held.axes.iter().map(|axis| axis.since).collect::<Vec<_>>(), [128, 120, 120]);
        // A new state knows much of this before a trial; a parameter that begins to matter there is released.
        learn(&mut screening, 7, 60, |c| 10.0 * (1.0 + (number(c, "b") - 0.9).abs()));
        let held = screening.judge(&space, 7, &best, 0.05, Some(&held), 60);
        assert!(held.axes.iter().all(|axis| axis.axis != 1), "{held:?}");
    }

    #[test]
    fn little_evidence_holds_nothing() {
        let space = space();
        let mut screening = Screening::new(&space);
        let best = space.default_configuration();
        assert!(screening.judge(&space, 0, &best, 0.05, None, 0).axes.is_empty());
        learn(&mut screening, 0, 5, |_| 10.0);
        assert!(screening.judge(&space, 0, &best, 0.05, None, 5).axes.is_empty());
    }

    #[test]
    fn a_state_that_begins_again_knows_what_the_others_do() {
        let space = space();
        let mut screening = Screening::new(&space);
        for state in 0..6 {
            learn(&mut screening, state, 120, |c| 10.0 * (0.5 * number(c, "a")).exp());
        }
        let best = space.decode(&[0.3, 0.5, 0.1]);
        let judge = |screening: &Screening, state| screening.judge(&space, state, &best, 0.05, None, 0);
        screening.begin_again(0);
        assert_eq!(judge(&screening, 0), judge(&screening, 99), "as a state that nobody met");
        assert_eq!(screening.states.len(), 5);
        screening.begin_again(99);
        assert_eq!(screening.states.len(), 5);
    }

    #[test]
    fn the_unit_of_the_cost_changes_nothing_and_extremes_do_no_harm() {
        let space = space();
        let best = space.decode(&[0.3, 0.5, 0.1]);
        let run = |unit: f64| {
            let mut screening = Screening::new(&space);
            for state in 0..4 {
                learn(&mut screening, state, 60, |c| unit * (1.0 + number(c, "a")));
            }
            screening.judge(&space, 0, &best, 0.05, None, 60).axes.iter().map(|a| a.axis).collect::<Vec<_>>()
        };
        assert_eq!(run(1.0), run(1e-9));
        assert_eq!(run(1.0), run(1e200));
        let mut screening = Screening::new(&space);
        for (place, cost) in [0.0, 5e-324, f64::MAX, 1.0, f64::MIN_POSITIVE, 1e300].into_iter().enumerate() {
            let configuration = space.decode(&[place as f64 / 6.0, 0.5, 0.2]);
            (0..50).for_each(|_| screening.learn(&space, 0, &configuration, cost));
        }
        let held = screening.judge(&space, 0, &best, 0.05, None, 6);
        assert!(held.axes.iter().all(|axis| axis.gain_at_most.is_finite()));
    }
}

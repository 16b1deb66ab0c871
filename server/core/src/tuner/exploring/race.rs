//! The race of a state's best few configurations against the incumbent, as it is stored.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::results::ResultTable;
use crate::robust::NOISE_LEAST;
use crate::space::Space;
use crate::standing::Gain;
use crate::statistics::confirm::{Race, RaceResult, rounds_needed};
use crate::tuner::knowledge::{Assessment, Stored};

/// Most of a search's best configurations that run against the incumbent.
const CHALLENGERS_MAX: usize = 4;
/// Factor by which the noise is assumed to be larger than measured. A proof holds only if the noise is not
/// larger still.
const NOISE_MARGIN: f64 = 1.25;

/// A race in a state. Plain data, exact through serde.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Confirming {
    /// The incumbent first; the default among the others where it is not the incumbent.
    pub(crate) contenders: Vec<Stored>,
    pub(crate) race: Race,
    pub(crate) rounds_max: u64,
    /// The number of tried configurations when it began. Once more configurations are tried, another race
    /// begins.
    pub(crate) tried: usize,
    /// The number of disturbances of the machine before it began.
    pub(crate) disturbances: u64,
    /// The contender of each open trial, by trial number.
    pub(crate) open: BTreeMap<u64, usize>,
    /// The challengers of which a run was stopped below their known cost.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    stopped: BTreeSet<usize>,
    /// Its consequences have been decided.
    pub(crate) settled: bool,
}

impl Confirming {
    /// Begins with the incumbent, the default, and the configurations that may be better by an assessment.
    pub(crate) fn new(
        (incumbent, default): (&Configuration, &Configuration),
        assessment: &Assessment,
        noise: f64,
        rounds: u32,
        results: &ResultTable,
    ) -> Self {
        let is_new = |one: &&Configuration| ![incumbent, default].contains(one);
        let challengers = assessment.challengers.iter().filter(is_new).take(CHALLENGERS_MAX);
        let default =
            [default].into_iter().filter(|_| incumbent != default && !results.is_infeasible(default));
        let contenders = [incumbent].into_iter().chain(default).chain(challengers);
        let contenders: Vec<Stored> = contenders.cloned().map(Stored).collect();
        let noise = noise.max(NOISE_LEAST);
        let rounds_max = rounds_needed(noise, rounds as usize);
        assert!(rounds_max > 0 && rounds_max <= rounds as usize, "{rounds_max} of {rounds} rounds");
        assert!(contenders.len() <= 2 + CHALLENGERS_MAX, "{} contenders", contenders.len());
        assert!(contenders[0].0 == *incumbent, "the incumbent comes first");
        let race = Race::new(contenders.len(), Some(NOISE_MARGIN * noise), rounds_max);
        Confirming {
            contenders,
            race,
            rounds_max: rounds_max as u64,
            tried: results.tried(),
            disturbances: results.disturbances(),
            open: BTreeMap::new(),
            stopped: BTreeSet::new(),
            settled: false,
        }
    }

    /// Whether it is over, for a table with `tried` tried configurations.
    pub(crate) fn is_settled(&self, tried: usize) -> bool {
        self.settled && tried <= self.tried
    }

    /// Passes over one more tried configuration, which is no reason for another race.
    pub(crate) fn pass_over(&mut self) {
        self.tried += 1;
    }

    /// The next contender to run, and its round.
    pub(crate) fn next(&self) -> Option<(usize, u64)> {
        let running = |place: usize| self.open.values().filter(|&&other| other == place).count();
        let place = self.race.next(running)?;
        Some((place, (self.race.rounds(place) + running(place)) as u64 + 1))
    }

    /// Takes a trial out, with what it found of its contender if it found anything.
    pub(crate) fn release(&mut self, trial: u64, finding: Option<Finding>) {
        let Some(place) = self.open.remove(&trial) else { return };
        match finding {
            Some(Finding::Cost(cost)) => self.race.tell(place, cost),
            Some(Finding::Stopped { known }) if self.stopped.insert(place) => self.race.tell(place, known),
            Some(Finding::Stopped { .. } | Finding::Fails) => self.race.fail(place),
            None => {}
        }
    }

    pub(crate) fn runs(&self, trial: u64) -> bool {
        self.open.contains_key(&trial)
    }

    /// Forgets open trials that are gone.
    pub(crate) fn keep_open(&mut self, is_open: impl Fn(u64) -> bool) {
        self.open.retain(|&number, _| is_open(number));
    }

    /// The contender that the race alone proved better.
    pub(crate) fn winner(&self) -> Option<&Configuration> {
        match self.race.verdict() {
            RaceResult::Better(place) => self.contenders.get(place).map(|contender| &contender.0),
            RaceResult::Open | RaceResult::NothingBetter => None,
        }
    }

    /// Whether a configuration ran against the incumbent.
    pub(crate) fn is_challenger(&self, configuration: &Configuration) -> bool {
        self.contenders.iter().skip(1).any(|contender| contender.0 == *configuration)
    }

    /// The contender that is better by the rounds alone, at an error probability of at most `error`.
    pub(crate) fn better_by_rounds(&self, error: f64) -> Option<&Configuration> {
        Some(&self.contenders.get(self.race.better_by_rounds(error)?)?.0)
    }

    /// The gain of a contender by the rounds alone: over the default where that ran, else over the incumbent.
    pub(crate) fn gain(&self, of: &Configuration, default: &Configuration) -> Option<Gain> {
        let place = |one: &Configuration| self.contenders.iter().position(|contender| contender.0 == *one);
        let (of, over) = (place(of)?, place(default).unwrap_or(0));
        let gain = self.race.gain(of, over).filter(|_| of != over)?;
        let share = |log_ratio: f64| -libm::expm1(-log_ratio);
        let finite = |log_ratio: f64| Some(share(log_ratio)).filter(|_| log_ratio.is_finite());
        let (low, high) = (finite(gain.low), finite(gain.high));
        Some(Gain {
            share: share(gain.log_ratio),
            low,
            high,
            probability_better: Some(gain.probability_better),
        })
    }

    /// Whether a configuration runs in it.
    pub(crate) fn has(&self, configuration: &Configuration) -> bool {
        self.contenders.iter().any(|contender| contender.0 == *configuration)
    }

    /// Whether its configurations are of the space.
    pub(crate) fn fits(&self, space: &Space) -> bool {
        self.contenders.iter().all(|contender| space.owns(&contender.0))
    }
}

/// The result of a trial of a race.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Finding {
    /// A cost.
    Cost(f64),
    /// A challenger was stopped below its known cost. Once may be chance, and counts as that cost. A
    /// challenger that is stopped so twice is never run to its end.
    Stopped {
        /// The mean cost of its runs before.
        known: f64,
    },
    /// The contender cannot be run.
    Fails,
}

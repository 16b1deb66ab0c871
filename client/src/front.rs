//! The trials of a front, and its next runs. [`Front`] says what the directions are.
//!
//! Each run is reported for all directions: for the others as a trial that is carried over, with the run's
//! name as its origin. Everything follows from stored trials, so a program that is started again goes on with
//! those numbers.

use std::collections::{BTreeMap, BTreeSet};

use treewright_model::front::Front;

use crate::{ClientError, Configuration, Indicators, Measurements, OpenEnum, Outcome, Question, TrialRecord};

/// One run in this number minimises a metric itself.
const FIRST_PART: u32 = 4;
/// Runs that a direction may have beyond its share of the planned ones.
const SPARE: usize = 8;
/// Most characters that are kept of a client's name in that of its carried trials.
const CLIENT_CHARACTERS: usize = 120;

impl TrialRecord {
    /// Whether it repeats the result of a run of its study for another direction of a front. It is no run,
    /// and needs not be kept: [`FrontHistory::owed`] makes it again.
    pub fn repeats_a_run(&self) -> bool {
        self.indicators.get(Front::DIRECTION).is_some() && carried_from(self).is_some()
    }

    /// Its configuration and its measurements for [`Front::of`]; `None` where it is no full run that
    /// succeeded, or repeats one.
    pub fn measured_run(&self) -> Option<(&Configuration, &BTreeMap<String, f64>)> {
        let counts = is_measured(self) && !self.repeats_a_run();
        counts.then_some((&self.configuration, &self.measurements.0))
    }
}

/// The trials of a front so far, and what follows from them. One program at a time adds to a front.
///
/// [`crate::FrontLoop`] is a loop over it: it asks each [`FrontHistory::question`] in the
/// [`FrontHistory::next_direction`], reports the run [`FrontHistory::with_cost`], and does the same with all
/// that is [`FrontHistory::owed`]. Every stored trial is [pushed](FrontHistory::push).
#[derive(Debug, Clone)]
pub struct FrontHistory {
    front: Front,
    /// Only completed ones.
    trials: Vec<TrialRecord>,
    planned: u32,
    /// Number of runs at the beginning.
    before: usize,
    over: BTreeSet<usize>,
    /// Repeats that were excluded by themselves, each as its run and its direction.
    spared: BTreeSet<(u64, usize)>,
}

impl FrontHistory {
    /// Goes on from the stored trials of one input and one machine. Those that are excluded do not count, nor
    /// what repeats them, nor trials at cheaper levels; an excluded repeat is not made again. In the first
    /// quarter of the `planned` runs only the metrics themselves are minimised, unless that was over before.
    pub fn new(front: Front, trials: Vec<TrialRecord>, planned: u32) -> Self {
        let excluded = trials.iter().filter(|trial| trial.exclusion.is_some());
        let excluded: BTreeSet<u64> = excluded.filter_map(TrialRecord::number).collect();
        let is_excluded = |number: Option<u64>| number.is_some_and(|number| excluded.contains(&number));
        let counts = |trial: &TrialRecord| {
            let is_out = is_excluded(trial.number()) || is_excluded(carried_from(trial));
            trial.outcome.is_some() && trial.fidelity.is_none() && !is_out
        };
        let (trials, left): (Vec<_>, Vec<_>) = trials.into_iter().partition(counts);
        let before = trials.iter().filter(|trial| carried_from(trial).is_none()).count();
        let (over, spared) = (BTreeSet::new(), BTreeSet::new());
        let mut history = Self { front, trials, planned, before, over, spared };
        let spared = left.iter().filter(|trial| trial.exclusion.is_some());
        history.spared = spared.filter_map(|trial| history.repeated(trial)).collect();
        history
    }

    /// The trials.
    pub fn trials(&self) -> &[TrialRecord] {
        &self.trials
    }

    /// The metrics of the front.
    pub fn front(&self) -> &Front {
        &self.front
    }

    /// The budget of each direction's search, for [`crate::SessionPolicy::trials_per_state`]: its share of
    /// the planned runs, and some more, so that all runs are done where a direction ends early. Trials that
    /// are carried over do not count.
    pub fn runs_each(&self) -> u32 {
        let all = self.before + self.planned as usize;
        u32::try_from(all.div_ceil(self.front.directions()) + SPARE).unwrap_or(u32::MAX)
    }

    /// Adds a trial as the service has stored it.
    pub fn push(&mut self, trial: TrialRecord) {
        self.trials.push(trial);
    }

    /// Nothing more is to be tried in a direction.
    pub fn end(&mut self, direction: usize) {
        self.over.insert(direction);
    }

    /// The direction of the next run: the one that had the fewest. `None` once all are over.
    pub fn next_direction(&self) -> Option<usize> {
        let count =
            if self.ideal().is_some() { self.front.directions() } else { self.front.metrics().count() };
        let runs =
            |direction: usize| self.runs().filter(|run| self.direction(run) == Some(direction)).count();
        (0..count).filter(|direction| !self.over.contains(direction)).min_by_key(|&direction| runs(direction))
    }

    /// The question for the next run in a direction, from one with all that is the program's own.
    pub fn question(&self, direction: usize, mut question: Question) -> Question {
        question.indicators = Indicators::from([(Front::DIRECTION, direction as f64)]);
        question.session_policy.trials_per_state = Some(self.runs_each());
        question
    }

    /// The measurements of a run with its cost in the direction of its trial.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] where a metric is missing, infinite or not above 0, and for trials without a
    /// direction.
    pub fn with_cost(
        &self,
        trial: &TrialRecord,
        measured: Measurements,
    ) -> Result<Measurements, ClientError> {
        let missing =
            self.front.metrics().find(|name| measured.get(name).is_none_or(|value| !Front::is_usable(value)));
        let costs = || {
            let minimised = self.front.values(&measured.0)?;
            self.front.cost(self.direction(trial)?, &minimised, self.ideal().as_deref())
        };
        match (missing, costs()) {
            (None, Some(cost)) => Ok(measured.with(Front::COST, cost)),
            (Some(name), _) => Err(ClientError::invalid(
                format!("measurement `{name}`"),
                "a front needs it in every run, finite and above 0",
            )),
            (None, None) => Err(ClientError::invalid("trial", "it has no direction of this front")),
        }
    }

    /// The results to carry over, so that every direction knows of every run: questions for
    /// [`crate::Client::ask`], each with its report. These trials are not run.
    pub fn owed(&self) -> Vec<(Question, Measurements, Outcome)> {
        let known = self.trials.iter().filter_map(|trial| self.repeated(trial));
        let known: BTreeSet<(u64, usize)> = known.chain(self.spared.iter().copied()).collect();
        let ideal = self.ideal();
        let count = if ideal.is_some() { self.front.directions() } else { self.front.metrics().count() };
        let mut owed = Vec::new();
        for run in self.runs() {
            let (Some(number), Some(own)) = (run.number(), self.direction(run)) else { continue };
            for direction in (0..count).filter(|&other| other != own && !known.contains(&(number, other))) {
                let (outcome, measured) = match &run.outcome {
                    Some(OpenEnum::Known(outcome @ Outcome::Infeasible { .. })) => {
                        (outcome.clone(), run.measurements.clone())
                    }
                    Some(OpenEnum::Known(Outcome::Ok)) => {
                        let Some(minimised) = self.front.values(&run.measurements.0) else { continue };
                        let Some(cost) = self.front.cost(direction, &minimised, ideal.as_deref()) else {
                            continue;
                        };
                        (Outcome::Ok, run.measurements.clone().with(Front::COST, cost))
                    }
                    // Such a result says nothing of the configuration.
                    _ => continue,
                };
                let client_id: String = run.client_id.chars().take(CLIENT_CHARACTERS).collect();
                let question = Question {
                    indicators: run.indicators.clone().with(Front::DIRECTION, direction as f64),
                    // Not the client that runs, whose visits stay as they are.
                    client_id: Some(format!("{client_id}/front")),
                    fingerprint: run.fingerprint.clone(),
                    wanted: Some(run.configuration.clone()),
                    origin: Some(run.name.clone()),
                    ..Question::default()
                };
                owed.push((question, measured, outcome));
            }
        }
        owed
    }

    fn direction(&self, trial: &TrialRecord) -> Option<usize> {
        let direction = trial.indicators.get(Front::DIRECTION)?.round();
        self.front.range().contains(&direction).then_some(direction as usize)
    }

    /// The run that a trial repeats, and the direction for which it does.
    fn repeated(&self, trial: &TrialRecord) -> Option<(u64, usize)> {
        Some((carried_from(trial)?, self.direction(trial)?))
    }

    fn runs(&self) -> impl Iterator<Item = &TrialRecord> {
        self.trials.iter().filter(|trial| carried_from(trial).is_none())
    }

    /// The best of each metric in the runs before the first trial that needed it; `None` while only the
    /// metrics themselves are minimised.
    fn ideal(&self) -> Option<Vec<f64>> {
        let extremes = self.front.metrics().count();
        let needs_it = |trial: &&TrialRecord| self.direction(trial).is_some_and(|one| one >= extremes);
        let first = self.trials.iter().filter(needs_it).filter_map(TrialRecord::number).min();
        let wanted = (self.planned / FIRST_PART).max(2) as usize;
        let is_due =
            || self.runs().count() >= wanted || (0..extremes).all(|direction| self.over.contains(&direction));
        if first.is_none() && !is_due() {
            return None;
        }
        let before =
            self.runs().filter(|run| is_measured(run) && first.is_none_or(|end| run.number() < Some(end)));
        before
            .filter_map(|run| self.front.values(&run.measurements.0))
            .reduce(|best, one| best.iter().zip(&one).map(|(a, b)| a.min(*b)).collect())
    }
}

/// Whether it ran in full, succeeded, and is not excluded.
pub(crate) fn is_measured(trial: &TrialRecord) -> bool {
    trial.outcome == Some(OpenEnum::Known(Outcome::Ok))
        && trial.fidelity.is_none()
        && trial.exclusion.is_none()
}

/// The number of the run whose result a trial of this study repeats for its own direction.
fn carried_from(trial: &TrialRecord) -> Option<u64> {
    Front::repeated_run(trial.origin.as_deref()?)
}

#[cfg(test)]
mod tests;

//! What other machines know of a state: the same input, measured elsewhere.
//!
//! Machines differ by a factor above all, so costs are compared as logarithms, less what the two machines differ by on
//! the configurations that both measured in this state (the default is the first of them); where there is none, less
//! the factor that other states showed. What is left over is that one configuration is better on one machine than on
//! another: which share of the difference to the default carries over, and how far that is off, is learnt of each
//! machine and level ([`Fleet`](crate::fleet::Fleet)).
//!
//! A belief in a configuration weighs four voices by their precision: that it does as well as the default, the
//! fleet's, the group's, and the machine's own measurements. A new machine has none, so it runs what the fleet found
//! best; whatever it measures itself soon counts for more, and where it disagrees, the others lose their say.

use crate::configuration::Configuration;
use crate::fleet::Level;
use crate::knowledge::Record;
use crate::limits::REWARD_COST_MIN;
use crate::search::Verdict;
use crate::trial::{Mode, Neighbour, Reason, Trial};
use crate::tuner::weigh::{NOISE_LEAST, NOISE_PRIOR};
use crate::tuner::{Prediction, Tuner};

/// The name of the step that reasons carry of what was taken over from other machines.
pub(super) const TRANSFER: &str = "transfer";
/// By how much, as a logarithm, a configuration is taken to differ from the default before anybody measured it.
const SPREAD: f64 = 0.3;
/// How many of a machine's best configurations two machines are compared by, beside the default.
const SHARED: usize = 16;
/// How many of its own, and of each other machine's, best configurations a machine chooses among.
const OWN_CANDIDATES: usize = 8;
const CANDIDATES: usize = 4;
/// While its own search goes on, the others are listened to after so many configurations each.
const LISTEN_EVERY: usize = 8;

/// A state of another machine, and what to add to the logarithm of a cost there.
#[derive(Clone, Copy, Debug)]
struct Voice {
    state: usize,
    level: Level,
    shift: f64,
    /// Both have measured something, so that the shift rests on this very state.
    shared: bool,
}

/// The logarithm of a cost as a level has it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Word {
    mean: f64,
    variance: f64,
    machines: usize,
    measurements: u64,
}

/// What is believed of a configuration, and whose evidence weighs most in it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Belief {
    mean: f64,
    level: Level,
    machines: usize,
    measurements: u64,
}

fn log(cost: f64) -> f64 {
    libm::log(cost.max(REWARD_COST_MIN))
}

impl Tuner {
    fn measured(&self, state: usize, configuration: &Configuration) -> Option<&Record> {
        let record = self.states[state].knowledge.record(configuration)?;
        (record.measurements > 0 && !record.infeasible).then_some(record)
    }

    fn noise_2(&self, state: usize) -> f64 {
        let noise = self.states[state].knowledge.noise().unwrap_or(NOISE_PRIOR).max(NOISE_LEAST);
        noise * noise
    }

    /// The other machines that measured something in this state.
    fn voices(&self, state: usize) -> Vec<Voice> {
        let others = self.work[state].siblings.iter().map(|&other| other as usize);
        let others = others.filter(|&other| self.states[other].knowledge.best().is_some());
        others.map(|other| self.voice(state, other)).collect()
    }

    fn voice(&self, state: usize, other: usize) -> Voice {
        let own = &self.states[state];
        let default = self.spec.space.default_ref();
        let best = own.knowledge.ranked().take(SHARED).filter(|record| record.configuration != *default);
        let (mut sum, mut weight) = (0.0, 0.0);
        for record in best.chain(self.measured(state, default)) {
            if let Some(there) = self.measured(other, &record.configuration) {
                let (here, elsewhere) = (record.measurements as f64, there.measurements as f64);
                let share = here * elsewhere / (here + elsewhere);
                sum += share * (log(record.mean_cost) - log(there.mean_cost));
                weight += share;
            }
        }
        let machine = self.states[other].machine;
        let far = self.fleet.effect(own.machine) - self.fleet.effect(machine);
        Voice {
            state: other,
            level: self.fleet.level(own.machine, machine),
            shift: if weight > 0.0 { sum / weight } else { far },
            shared: weight > 0.0,
        }
    }

    /// What a level has to say of a configuration in this state.
    fn word(&self, voices: &[Voice], level: Level, configuration: &Configuration) -> Option<Word> {
        let (mut sum, mut precision, mut machines, mut measurements) = (0.0, 0.0, 0, 0);
        for voice in voices.iter().filter(|voice| voice.level == level) {
            if let Some(record) = self.measured(voice.state, configuration) {
                let own = record.measurements as f64 / self.noise_2(voice.state);
                sum += own * (log(record.mean_cost) + voice.shift);
                precision += own;
                machines += 1;
                measurements += record.measurements;
            }
        }
        let word = || Word { mean: sum / precision, variance: 1.0 / precision, machines, measurements };
        (machines > 0).then(word)
    }

    fn words(&self, voices: &[Voice], configuration: &Configuration) -> [(Level, Option<Word>); 2] {
        [Level::Group, Level::Fleet].map(|level| (level, self.word(voices, level, configuration)))
    }

    /// What is believed of a configuration in this state; `None` where nobody measured it.
    fn believe(
        &self,
        state: usize,
        voices: &[Voice],
        baseline: Option<f64>,
        configuration: &Configuration,
    ) -> Option<Belief> {
        let machine = self.states[state].machine;
        let mut heard = Vec::with_capacity(3);
        if let Some(own) = self.measured(state, configuration) {
            let variance = self.noise_2(state) / own.measurements as f64;
            let word =
                Word { mean: log(own.mean_cost), variance, machines: 1, measurements: own.measurements };
            heard.push((Level::Machine, word));
        }
        for (level, word) in self.words(voices, configuration) {
            if let Some(word) = word {
                let variance = word.variance + self.fleet.miss_2(machine, level);
                let share = self.fleet.share(machine, level);
                let mean = baseline.map_or(word.mean, |base| base + share * (word.mean - base));
                heard.push((level, Word { mean, variance, ..word }));
            }
        }
        let loudest = heard.iter().min_by(|a, b| a.1.variance.total_cmp(&b.1.variance))?;
        let (level, Word { machines, measurements, .. }) = *loudest;
        let prior = baseline.map(|mean| (mean, SPREAD * SPREAD));
        let voices = heard.iter().map(|(_, word)| (word.mean, word.variance)).chain(prior);
        let (sum, precision) = voices.fold((0.0, 0.0), |(sum, precision), (mean, variance)| {
            let own = 1.0 / variance.max(f64::MIN_POSITIVE);
            (sum + own * mean, precision + own)
        });
        Some(Belief { mean: sum / precision, level, machines, measurements })
    }

    /// The configuration that is believed to be best among those that `filter` passes and that can be run here.
    fn favourite(
        &self,
        state: usize,
        voices: &[Voice],
        filter: impl Fn(&Configuration) -> bool,
    ) -> Option<(&Configuration, Belief)> {
        let default = self.spec.space.default_ref();
        let baseline = self.measured(state, default).map(|record| log(record.mean_cost)).or_else(|| {
            let words = self.words(voices, default);
            words.into_iter().find_map(|(_, word)| word).map(|word| word.mean)
        });
        let own = self.states[state].knowledge.ranked().take(OWN_CANDIDATES);
        let others =
            voices.iter().flat_map(|voice| self.states[voice.state].knowledge.ranked().take(CANDIDATES));
        let candidates = own.chain(others).map(|record| &record.configuration);
        let candidates = candidates
            .filter(|candidate| !self.states[state].knowledge.is_infeasible(candidate) && filter(candidate));
        let believed = candidates
            .filter_map(|candidate| Some((candidate, self.believe(state, voices, baseline, candidate)?)));
        believed.min_by(|(_, a), (_, b)| a.mean.total_cmp(&b.mean))
    }

    /// What the others found best in this state, as long as their word counts for more than what the machine
    /// measured itself.
    pub(super) fn best_by_others(&self, state: usize) -> Option<Prediction> {
        let voices = self.voices(state);
        if voices.is_empty() {
            return None;
        }
        let (configuration, belief) = self.favourite(state, &voices, |_| true)?;
        (belief.level != Level::Machine)
            .then(|| self.taken_over(state, &voices, configuration, belief, Mode::Exploit, ""))
    }

    /// What the others found best and this machine has not measured yet, where it is believed to be better than
    /// what it has. The default comes first, by which machines are compared.
    pub(super) fn transfer(&self, state: usize) -> Option<Prediction> {
        let (work, knowledge) = (&self.work[state], &self.states[state].knowledge);
        if work.siblings.is_empty() || knowledge.tried() >= self.spec.policy.trials_per_state as usize {
            return None;
        }
        if work.exploration.is_some() && !knowledge.tried().is_multiple_of(LISTEN_EVERY) {
            return None;
        }
        let voices = self.voices(state);
        if voices.is_empty() {
            return None;
        }
        let default = self.spec.space.default_ref();
        if !knowledge.is_tried(default) && !work.running.contains_key(default) && work.exploration.is_none() {
            let summary =
                "The baseline comes first: by it this machine is compared with the others.".to_owned();
            let reason =
                Reason { summary, source: "default".into(), step: "default".into(), ..Reason::default() };
            return Some(Prediction {
                configuration: default.clone(),
                mode: Mode::Default,
                predicted_cost: None,
                reason,
                insight: None,
            });
        }
        let is_new = |candidate: &Configuration| {
            !knowledge.is_tried(candidate) && !work.running.contains_key(candidate)
        };
        let (configuration, belief) = self.favourite(state, &voices, is_new)?;
        let promising = knowledge.best().is_none_or(|best| belief.mean < log(best.mean_cost));
        promising.then(|| self.taken_over(state, &voices, configuration, belief, Mode::Explore, TRANSFER))
    }

    fn taken_over(
        &self,
        state: usize,
        voices: &[Voice],
        configuration: &Configuration,
        belief: Belief,
        mode: Mode,
        step: &str,
    ) -> Prediction {
        let Belief { mean, level, machines, measurements } = belief;
        let who = match level {
            Level::Group => "with the same processor and software",
            _ => "of the fleet",
        };
        let mut summary = format!(
            "Best by what {machines} other machines {who} measured in this state, {measurements} times; this one has \
             less to say of it itself."
        );
        if let Some(changes) = self.fleet.change_of_software(self.states[state].machine) {
            summary.push_str(&format!(
                " What this machine measured before its software changed ({changes}) counts as the fleet's only."
            ));
        }
        let spoke = voices.iter().filter(|voice| voice.level == level);
        let neighbours = spoke.filter_map(|voice| {
            let best = self.states[voice.state].knowledge.best()?;
            let best_cost = libm::exp(log(best.mean_cost) + voice.shift).min(f64::MAX);
            Some(Neighbour { state_id: self.states[voice.state].id, distance: 0.0, best_cost })
        });
        let reason = Reason {
            summary,
            source: level.name().into(),
            step: step.into(),
            neighbours: neighbours.take(crate::limits::NEIGHBOURS_MAX).collect(),
            ..Reason::default()
        };
        let predicted_cost = Some(libm::exp(mean).min(f64::MAX));
        Prediction { configuration: configuration.clone(), mode, predicted_cost, reason, insight: None }
    }

    /// Holds a measurement against what the others would have said of it, before it is learnt.
    pub(super) fn compare(&mut self, trial: &Trial, state: usize, cost: f64) {
        let configuration = &trial.configuration;
        let siblings = &self.work[state].siblings;
        if !siblings.iter().any(|&other| self.measured(other as usize, configuration).is_some()) {
            return;
        }
        let machine = self.states[state].machine;
        let voices = self.voices(state);
        // By the factors between machines alone.
        let (mut sum, mut count) = (0.0, 0.0);
        for voice in &voices {
            if let Some(record) = self.measured(voice.state, configuration) {
                sum += log(record.mean_cost) - self.fleet.effect(self.states[voice.state].machine);
                count += 1.0;
            }
        }
        // The first time only: afterwards it is among what machines are compared by.
        let default = self.spec.space.default_ref();
        let baseline = self.measured(state, default).map(|record| log(record.mean_cost));
        if let Some(baseline) = baseline.filter(|_| self.measured(state, configuration).is_none()) {
            let shared: Vec<Voice> = voices.iter().copied().filter(|voice| voice.shared).collect();
            for (level, word) in self.words(&shared, configuration) {
                if let Some(word) = word {
                    self.fleet.carry(machine, level, word.mean - baseline, log(cost) - baseline);
                }
            }
        }
        self.fleet.compare(machine, log(cost) - sum / count - self.fleet.effect(machine));
    }

    /// Tells the state's search what was taken over from others. `false` when there is none.
    pub(super) fn tell_of_transfer(&mut self, trial: &Trial, state: usize, verdict: Option<Verdict>) -> bool {
        let point = self.spec.space.encode(&trial.configuration);
        let work = &mut self.work[state];
        let search = work.exploration.as_mut().and_then(|exploration| exploration.search.as_mut());
        let (Some(search), Some(verdict), TRANSFER) = (search, verdict, trial.reason.step.as_str()) else {
            return false;
        };
        search.hear(point, verdict);
        work.changes += 1;
        true
    }
}

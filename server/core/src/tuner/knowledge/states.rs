//! The states of a study: their recognition from indicators and machines, and the table of each.
//!
//! Invariants: state `n` is the `n`-th that was founded. Every state is in the index, and every machine that
//! founded one is among the machines. The number of remembered configurations is that of all tables together.

use std::cmp::Reverse;
use std::ops::Index;
use std::sync::Arc;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::limits::{RECORDS_PER_STATE_MAX, RECORDS_PER_STUDY_MAX, SIBLINGS_MAX, STATES_MAX};
use crate::machines::{FIRST, Machines, PoolingStatistics};
use crate::predict::state_index::{IndicatorStatistics, OmittedIndicator, match_distance_2};
use crate::predict::{Query, StateIndex};
use crate::results::{KnownState, ResultTable};
use crate::space::Space;
use crate::study::StudySpec;
use crate::trial::{Fingerprint, Trial};

/// The states of a study.
#[derive(Clone, Debug)]
pub(crate) struct States {
    /// State `n` sits at place `n - 1`.
    known: Vec<KnownState>,
    /// For each state, the states of other machines with its input, nearest relations first.
    siblings: Vec<Vec<StateId>>,
    /// For each state, whether a search was begun in it and not forgotten since.
    begun: Vec<bool>,
    /// The index of the anchors.
    index: StateIndex,
    /// The machines that measured in these states.
    pub(crate) machines: Machines,
    /// The most by which an indicator of a recognised state differs from its anchor, as a share of its range.
    tolerance: f64,
    default: Configuration,
    /// The number of remembered configurations in all states, and the count above which some are forgotten.
    remembered: usize,
    forget_above: usize,
}

/// The place of a state in lists of all of them.
pub(crate) fn place(id: StateId) -> usize {
    assert!(id.0 > 0, "states count from 1");
    id.0 as usize - 1
}

pub(crate) fn at(place: usize) -> StateId {
    StateId(place as u64 + 1)
}

impl Index<StateId> for States {
    type Output = KnownState;

    fn index(&self, id: StateId) -> &KnownState {
        &self.known[place(id)]
    }
}

impl States {
    fn check(&self) {
        assert_eq!(self.siblings.len(), self.known.len(), "every state has a list of siblings");
        assert_eq!(self.index.len(), self.known.len(), "every state is in the index");
    }

    /// No states yet.
    pub(crate) fn new(spec: &StudySpec) -> Self {
        States {
            known: Vec::new(),
            siblings: Vec::new(),
            begun: Vec::new(),
            index: StateIndex::new(spec.indicators.indicators().len()),
            machines: Machines::default(),
            tolerance: spec.state_tolerance,
            default: spec.space.default_configuration(),
            remembered: 0,
            forget_above: RECORDS_PER_STUDY_MAX,
        }
    }

    /// The number of states.
    pub(crate) fn len(&self) -> usize {
        self.known.len()
    }

    /// All of them, oldest first.
    pub(crate) fn ids(&self) -> impl DoubleEndedIterator<Item = StateId> + use<> {
        (0..self.known.len()).map(at)
    }

    /// Whether there is such a state.
    pub(crate) fn contains(&self, id: StateId) -> bool {
        (1..=self.known.len() as u64).contains(&id.0)
    }

    /// All states with their measurements, oldest first.
    pub(crate) fn known(&self) -> &[KnownState] {
        &self.known
    }

    pub(crate) fn results(&self, id: StateId) -> &ResultTable {
        &self[id].results
    }

    /// The machine that alone measures in a state.
    pub(crate) fn fingerprint(&self, id: StateId) -> Option<&Fingerprint> {
        self.machines.fingerprint(self[id].machine)
    }

    /// The states of other machines with this state's input, nearest relations first.
    pub(crate) fn siblings(&self, id: StateId) -> &[StateId] {
        &self.siblings[place(id)]
    }

    /// Indicators that distances and features leave out.
    pub(crate) fn omitted_indicators(&self) -> Vec<OmittedIndicator> {
        self.index.omitted_indicators()
    }

    /// The known reach of the indicators.
    pub(crate) fn indicator_statistics(&self) -> &IndicatorStatistics {
        self.index.indicator_statistics()
    }

    /// The number of remembered configurations in all states.
    #[cfg(test)]
    pub(crate) fn remembered(&self) -> usize {
        self.remembered
    }

    /// Above which count of remembered configurations some are forgotten.
    pub(crate) fn forget_above(&self) -> usize {
        self.forget_above
    }

    /// Mean cost of the default configuration in a state, if it was measured there.
    pub(crate) fn default_cost(&self, id: StateId) -> Option<f64> {
        self.cost_of(id, &self.default)
    }

    /// Mean cost of a configuration in a state, if it was measured there.
    pub(crate) fn cost_of(&self, id: StateId, configuration: &Configuration) -> Option<f64> {
        let record = self[id].results.record(configuration)?;
        (record.measurements > 0).then_some(record.mean_cost)
    }

    /// A question of a predictor about a state, known or not: then the study's first machine asks.
    pub(crate) fn query<'a>(
        &'a self,
        space: &'a Space,
        normalised: &'a [f64],
        here: Option<StateId>,
    ) -> Query<'a> {
        let here = here.map(|here| &self[here]);
        let machine = here.map_or(FIRST, |here| here.machine);
        let States { known, index, machines, .. } = self;
        Query { state: normalised, here, known, state_index: index, space, machines, machine, rival: None }
    }

    /// The machine's state that matches the normalised indicators: every one within the study's tolerance of
    /// the state's anchor. The client's `current` state is kept while it matches, so that a client between
    /// two anchors does not flicker. Else the nearest matching state is taken, the oldest among equally near
    /// ones. `None` when no state matches, as long as there may be more. Beyond that, the machine's nearest
    /// state is taken whether it matches or not, so that an input that never rests goes on for ever.
    pub(crate) fn recognise(
        &self,
        current: Option<StateId>,
        fingerprint: Option<&Fingerprint>,
        normalised: &[f64],
    ) -> Option<StateId> {
        let machine = self.machines.find(fingerprint)?;
        let matches = |state: &KnownState| {
            state.machine == machine && match_distance_2(&state.anchor, normalised, self.tolerance).is_some()
        };
        let found = current
            .filter(|&current| matches(&self[current]))
            .or_else(|| self.index.within(machine, normalised, self.tolerance).map(at))
            .or_else(|| {
                (self.len() >= STATES_MAX).then(|| self.index.nearest_of(machine, normalised).map(at))?
            })?;
        assert!(self[found].machine == machine, "{found:?} is a state of another machine");
        Some(found)
    }

    /// The state of the named machine if it has been there, else of the machine with the most frames there,
    /// the first among equals.
    pub(crate) fn recognise_for(
        &self,
        fingerprint: Option<&Fingerprint>,
        normalised: &[f64],
        frames: impl Fn(StateId) -> u64,
    ) -> Option<StateId> {
        let own = fingerprint.and_then(|_| self.machines.find(fingerprint));
        let there = own.and_then(|machine| self.index.within(machine, normalised, self.tolerance));
        there.map(at).or_else(|| {
            let matches = self.index.within_each(normalised, self.tolerance).map(at);
            matches.min_by_key(|&state| Reverse(frames(state)))
        })
    }

    pub(crate) fn found(&mut self, anchor: Vec<f64>, fingerprint: Option<&Fingerprint>) -> StateId {
        let id = at(self.known.len());
        let (machine, displaced) = self.machines.note_founder(fingerprint);
        let others = self.index.within_each(&anchor, self.tolerance).map(at);
        let mut siblings: Vec<StateId> = others.filter(|&other| self[other].machine != machine).collect();
        siblings.sort_by_key(|&other| (self.machines.level(machine, self[other].machine), other));
        siblings.truncate(SIBLINGS_MAX);
        for &sibling in &siblings {
            let theirs = &mut self.siblings[place(sibling)];
            if theirs.len() < SIBLINGS_MAX {
                theirs.push(id);
            }
        }
        if let Some(displaced) = displaced {
            self.index.displace(displaced);
        }
        let known = KnownState { id, anchor, machine, explored: false, results: Default::default() };
        self.index.note(&known);
        self.known.push(known);
        self.siblings.push(siblings);
        self.begun.push(false);
        assert!(self[id].id == id && !self.siblings(id).contains(&id), "{id:?} is another");
        self.check();
        id
    }

    pub(crate) fn note_search(&mut self, id: StateId) {
        (self.known[place(id)].explored, self.begun[place(id)]) = (true, true);
        self.index.note(&self.known[place(id)]);
    }

    /// Notes that the search of a state was forgotten. A replay does not: its rows say what was begun since.
    pub(crate) fn forget_search(&mut self, id: StateId) {
        (self.known[place(id)].explored, self.begun[place(id)]) = (false, false);
        self.index.note(&self.known[place(id)]);
    }

    /// Sets whether a restored state was explored, before anything of it is learnt.
    pub(crate) fn restore_search(&mut self, id: StateId, explored: bool) {
        (self.known[place(id)].explored, self.begun[place(id)]) = (explored, explored);
    }

    /// Notes the first frame of a state. `true` where other indicators are left out than before.
    pub(crate) fn note_first_frame(&mut self, id: StateId) -> bool {
        self.index.weigh(&self.known[place(id)].anchor)
    }

    /// Takes the result of a completed trial into the table of its state. `error` is the standard error of
    /// its cost, as a share; 0 where it is not known.
    pub(crate) fn learn(&mut self, id: StateId, trial: &Trial, error: f64) {
        let state = &mut self.known[place(id)];
        let before = state.results.remembered();
        let (version, had_default) = (state.results.version(), state.results.record(&self.default).is_some());
        let results = Arc::make_mut(&mut state.results);
        results.learn(trial, &self.default);
        results.note_error(trial, error);
        assert!(state.results.version() >= version, "version {} after {version}", state.results.version());
        assert!(!had_default || state.results.record(&self.default).is_some(), "the default stays");
        assert!(state.results.remembered() <= RECORDS_PER_STATE_MAX, "{}", state.results.remembered());
        // A client that brings measurements of many configurations has searched the state, though not by the
        // tuner's search.
        state.explored |= state.results.is_searched_by_clients();
        self.remembered = self.remembered + state.results.remembered() - before;
        assert!(self.remembered >= state.results.remembered(), "{} configurations", self.remembered);
        self.index.note(state);
    }

    /// Changes the table of a state other than by a trial.
    pub(crate) fn amend(&mut self, id: StateId, change: impl FnOnce(&mut ResultTable)) {
        let state = &mut self.known[place(id)];
        change(Arc::make_mut(&mut state.results));
        self.index.note(state);
    }

    /// Forgets the measurements of a state, because its costs have changed.
    pub(crate) fn begin_again(&mut self, id: StateId) {
        let forgotten = self[id].results.remembered();
        assert!(forgotten <= self.remembered, "{forgotten} of {} configurations", self.remembered);
        self.remembered -= forgotten;
        self.known[place(id)].explored = self.begun[place(id)];
        self.amend(id, ResultTable::begin_again);
    }

    /// Where more configurations are remembered than a study may, forgets most configurations of the states
    /// whose last report is oldest. `is_few` says whether the space has so few configurations that all can be
    /// tried.
    pub(crate) fn forget_somewhere(&mut self, is_few: bool) {
        if self.remembered <= self.forget_above {
            return;
        }
        let aim = RECORDS_PER_STUDY_MAX - RECORDS_PER_STUDY_MAX / 8;
        let each = (aim / 2 / self.known.len()).max(1);
        let mut order: Vec<usize> = (0..self.known.len()).collect();
        order.sort_unstable_by_key(|&place| (self.known[place].results.latest(), place));
        for place in order {
            let results = &mut self.known[place].results;
            let before = results.remembered();
            if self.remembered <= aim {
                break;
            }
            if before > each {
                let results = Arc::make_mut(results);
                results.forget(each, &self.default, is_few);
                assert!(results.remembered() <= before, "{} after {before}", results.remembered());
                self.remembered = self.remembered + results.remembered() - before;
            }
        }
        let all: usize = self.known.iter().map(|state| state.results.remembered()).sum();
        assert_eq!(self.remembered, all, "the remembered configurations of all tables together");
        // With many states this may not suffice; then it must not run at every report.
        self.forget_above = RECORDS_PER_STUDY_MAX.max(self.remembered + self.remembered / 8);
    }

    /// The states that were reported from last, latest first, as many as remember no more than `most`
    /// configurations together.
    pub(crate) fn latest(&self, most: usize) -> Vec<StateId> {
        let mut latest: Vec<StateId> = self.ids().collect();
        latest.sort_unstable_by_key(|&id| Reverse((self[id].results.latest(), id)));
        let mut left = most;
        let enough = latest.iter().position(|&id| {
            let records = self[id].results.remembered();
            let fits = records <= left;
            left = left.saturating_sub(records);
            !fits
        });
        latest.truncate(enough.unwrap_or(latest.len()));
        let records: usize = latest.iter().map(|&id| self[id].results.remembered()).sum();
        assert!(records <= most, "{records} configurations are more than {most}");
        latest
    }

    /// Takes over earlier knowledge: tables of the first states in their order, completed with the space, the
    /// comparisons of the first machines, and the reach of indicators.
    pub(crate) fn take_over(
        &mut self,
        tables: Vec<Arc<ResultTable>>,
        pooling: &[PoolingStatistics],
        statistics: IndicatorStatistics,
        forget_above: usize,
    ) {
        assert!(tables.len() <= self.known.len(), "{} tables", tables.len());
        assert!(pooling.len() <= self.machines.len(), "{} machines", pooling.len());
        self.machines.take_over(pooling);
        self.index.take_over(statistics);
        self.forget_above = forget_above;
        self.remembered = tables.iter().map(|results| results.remembered()).sum();
        for (state, results) in self.known.iter_mut().zip(tables) {
            state.results = results;
            state.explored |= state.results.is_searched_by_clients();
            self.index.note(state);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::Policy;
    use crate::tuner::tests::spec;

    fn machine(threads: u32) -> Fingerprint {
        Fingerprint { threads, ..Fingerprint::default() }
    }

    #[test]
    fn a_state_is_recognised_on_its_machine_and_the_current_one_is_kept() {
        let mut states = States::new(&spec(Policy::default()));
        assert_eq!(states.recognise(None, None, &[0.5, 0.5]), None);
        let first = states.found(vec![0.50, 0.5], None);
        let second = states.found(vec![0.56, 0.5], None);
        assert_eq!((first, second, states.len()), (StateId(1), StateId(2), 2));
        // Both match; the nearest is taken, unless the client is in the other.
        assert_eq!(states.recognise(None, None, &[0.54, 0.5]), Some(second));
        assert_eq!(states.recognise(Some(first), None, &[0.54, 0.5]), Some(first));
        assert_eq!(states.recognise(Some(first), None, &[0.59, 0.5]), Some(second), "it matches no more");
        assert_eq!(states.recognise(None, Some(&machine(8)), &[0.5, 0.5]), None, "another machine's");
        assert!(states.contains(second) && !states.contains(StateId(3)) && !states.contains(StateId(0)));
    }

    #[test]
    fn what_is_met_beyond_the_last_state_counts_as_the_nearest() {
        let mut states = States::new(&spec(Policy::default()));
        let anchor = |place: usize| vec![place as f64, 0.5];
        for place in 1..STATES_MAX {
            states.found(anchor(place), None);
        }
        assert_eq!(states.recognise(None, None, &[7.4, 0.5]), None, "there is room for it");
        states.found(anchor(STATES_MAX), None);
        assert_eq!(states.recognise(None, None, &[7.4, 0.5]), Some(StateId(7)));
        assert_eq!(states.recognise(Some(StateId(3)), None, &[1e9, 0.5]), Some(StateId(STATES_MAX as u64)));
        assert_eq!(states.recognise(None, Some(&machine(8)), &[7.4, 0.5]), None, "a machine without a state");
        states.found(anchor(1), Some(&machine(8)));
        assert_eq!(
            states.recognise(None, Some(&machine(8)), &[7.4, 0.5]),
            Some(StateId(STATES_MAX as u64 + 1)),
            "it keeps to its own"
        );
    }

    #[test]
    fn states_of_the_same_input_know_each_other() {
        let mut states = States::new(&spec(Policy::default()));
        let own = states.found(vec![0.5, 0.5], None);
        let far = states.found(vec![0.9, 0.5], None);
        let other = states.found(vec![0.51, 0.5], Some(&machine(8)));
        assert_eq!((states.siblings(own), states.siblings(other)), (&[other][..], &[own][..]));
        assert!(states.siblings(far).is_empty());
        // A client that names no machine gets the one with the most frames.
        let frames = |state: StateId| if state == other { 9 } else { 1 };
        assert_eq!(states.recognise_for(None, &[0.5, 0.5], frames), Some(other));
        assert_eq!(states.recognise_for(Some(&machine(9)), &[0.5, 0.5], |_| 1), Some(own));
        assert_eq!(states.fingerprint(other), Some(&machine(8)));
    }
}

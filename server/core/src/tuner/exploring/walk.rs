//! The walk along a state's search to its next point that is worth a measurement.

use std::sync::Arc;

use rand::RngExt;

use crate::configuration::Configuration;
use crate::decision;
use crate::ids::{StateId, TrialNumber};
use crate::limits::{KNOWN_POINTS_PER_SUGGESTION_MAX, UNSEEN_DRAWS_MAX};
use crate::randomness::{Purpose, stream};
use crate::search::{AnySearch, Feedback, Point, SearchSetup, Step, Verdict};
use crate::study::StudySpec;
use crate::tuner::Exploration;
use crate::tuner::clients::OpenTrials;
use crate::tuner::exploring::searches::{Searches, is_spent};
use crate::tuner::exploring::transfer::Transfer;
use crate::tuner::knowledge::{Knowledge, Models, States};
use crate::tuner::plan::Planned;
use crate::tuner::proposal::ProposedTrial;

/// The most of the best configurations that a search receives if it goes on where another one ended.
const OBSERVATIONS_MAX: usize = 128;

/// The result of the walk along a search.
pub(crate) enum NextPoint {
    /// A point to measure.
    Measure(Point, Configuration),
    /// The search waits for trials that are out, or its budget is spent.
    Wait,
    /// Every point fell on a known configuration.
    OnlyKnown,
}

/// The searches of all states, to be walked along.
#[derive(Debug)]
pub(crate) struct Walk<'a> {
    spec: &'a Arc<StudySpec>,
    states: &'a mut States,
    searches: &'a mut Searches,
    trials: &'a OpenTrials,
    models: &'a Models,
}

impl<'a> Walk<'a> {
    pub(crate) fn of(
        spec: &'a Arc<StudySpec>,
        knowledge: &'a mut Knowledge,
        searches: &'a mut Searches,
        trials: &'a OpenTrials,
    ) -> Self {
        let Knowledge { states, models, .. } = knowledge;
        Walk { spec, states, searches, trials, models }
    }

    fn transfer(&self) -> Transfer<'_> {
        let Walk { spec, trials, models, .. } = *self;
        Transfer { spec, states: &*self.states, searches: &*self.searches, trials, models, asking: None }
    }

    /// Makes sure that the state has a search of the policy's kind, unless its budget is spent. Trials that
    /// carry points of an earlier search only feed the table from then on. The new search receives the
    /// results of the table if an earlier one spent its budget, which was raised since. It also receives them
    /// if they come from other machines, other databases or an earlier space of the study.
    pub(crate) fn ensure(&mut self, room: usize, state: StateId, planned: &mut Planned) {
        // The policy's own number of trials need not be noted.
        let more = if room > self.spec.policy.trials_per_state as usize { room } else { 0 };
        if self.searches.of(state).is_some_and(|own| own.room() < more)
            && let Some(own) = self.searches.change(state)
        {
            own.make_room(more);
        }
        let (space, policy) = (&self.spec.space, &self.spec.policy);
        let mut was_dropped = false;
        if let Some(current) = self.searches.of(state) {
            was_dropped = current.search.is_none();
            let goes_on = match &current.search {
                Some(search) => search.is_of(policy.search),
                None => is_spent(current, self.states.results(state), policy, room),
            };
            if goes_on {
                return;
            }
        }
        let budget = u32::try_from(room).unwrap_or(u32::MAX);
        let setup = SearchSetup::of(space, self.spec.seed, state.0, budget);
        let mut search = AnySearch::new(policy.search, setup);
        let mut incumbent = None;
        let results = self.states.results(state);
        let from_others = !self.states.siblings(state).is_empty() || results.is_carried_over();
        for record in results.ranked().take(OBSERVATIONS_MAX) {
            let point = || space.encode(&record.configuration);
            match (was_dropped, from_others) {
                (true, _) => search.know(point(), Verdict::Cost(record.mean_cost)),
                (false, true) => search.hear(point(), Verdict::Cost(record.mean_cost)),
                (false, false) => break,
            }
            if let Some(weight) = results.weight(&record.configuration) {
                search.weigh(&point(), weight);
            }
        }
        let transfer = self.transfer();
        if !was_dropped && transfer.warms_up_searches() {
            let begins = || transfer.evidence(state).beginning(space);
            if let Some(start) = planned.beginning(state, &self.states[state].anchor, begins) {
                search.follow(start.main_effects, start.first, start.winners, start.runs);
                search.look_at(start.looks);
                incumbent = start.incumbent;
            }
        }
        self.searches.begin(state, search, incumbent);
        if more > 0
            && let Some(own) = self.searches.change(state)
        {
            own.make_room(more);
        }
        self.states.note_search(state);
    }

    /// Asks the search until a point is worth a measurement. Points that fall on configurations with a
    /// verdict are answered from the table (a pair of state and configuration is not sampled twice). Points
    /// whose configuration runs just now in this state go back until it is reported. A point at a cheaper
    /// level is measured unless its configuration cannot be run. `shares` are the costs of the open levels.
    pub(crate) fn next_point(
        &mut self,
        (room, shares): (usize, &[f64]),
        state: StateId,
        planned: &mut Planned,
    ) -> NextPoint {
        let (space, policy) = (&self.spec.space, &self.spec.policy);
        let results = self.states.results(state);
        let spent = match self.searches.of(state) {
            Some(own) if own.search.is_some() => is_spent(own, results, policy, room),
            _ => return NextPoint::Wait,
        };
        let Some(Exploration { search: Some(search), .. }) = self.searches.change(state) else {
            return NextPoint::Wait;
        };
        search.open_levels(shares);
        if let Some(point) = planned.take_point(state) {
            search.adopt(point);
        }
        let (mut waiting, mut walk) = (Vec::new(), NextPoint::OnlyKnown);
        for _ in 0..KNOWN_POINTS_PER_SUGGESTION_MAX {
            let is_at_hand = planned.is_at_once() || search.is_ready();
            let Some(point) = (if is_at_hand { search.ask() } else { search.ask_at_once() }) else {
                walk = NextPoint::Wait;
                break;
            };
            let configuration = match point.step {
                // The default itself, even where its coordinates lose a digit.
                Step::Default => space.default_configuration(),
                _ => space.decode(&point.x),
            };
            let is_cheaper = point.level.is_some();
            let settled = match point.step {
                // The search knows the point and wants another measurement.
                Step::Replicate => None,
                _ => results
                    .settled(&configuration, policy.replicates)
                    .filter(|verdict| !is_cheaper || *verdict == Verdict::Infeasible),
            };
            if let Some(verdict) = settled.filter(|_| is_cheaper) {
                search.tell_cheaper(point.id, Some(verdict));
            } else if let Some(verdict) = settled {
                search.tell(point.id, Feedback { verdict, fresh: false });
                if let Some(weight) = results.weight(&configuration) {
                    search.weigh(&point.x, weight);
                }
            } else if !is_cheaper && self.trials.runs(state, &configuration) {
                waiting.push(point.id);
                walk = NextPoint::Wait;
            } else if spent
                && (is_cheaper || point.step == Step::Replicate || !results.is_tried(&configuration))
            {
                waiting.push(point.id);
                walk = NextPoint::Wait;
                break;
            } else {
                debug_assert!(space.owns(&configuration), "{configuration:?} is not of the space");
                walk = NextPoint::Measure(point, configuration);
                break;
            }
        }
        for id in waiting {
            search.withdraw(id);
        }
        match walk {
            // A configuration that is drawn at random would be one more than the budget allows.
            NextPoint::OnlyKnown if spent => NextPoint::Wait,
            walk => walk,
        }
    }

    /// The trial of a point.
    pub(crate) fn measure(
        &mut self,
        state: StateId,
        number: TrialNumber,
        point: Point,
        configuration: Configuration,
    ) -> ProposedTrial {
        let record = self.states.results(state).record(&configuration);
        // At a cheaper level nothing is known of it.
        let known = record.filter(|record| record.measurements > 0 && point.level.is_none());
        let predicted_cost = known.map(|record| record.mean_cost);
        let measurements = known.map_or(0, |record| record.measurements);
        let search = self.spec.policy.search;
        let decided = match point.step {
            Step::Default => decision::ExploredPoint::Baseline(search),
            step => {
                let transferred = step == Step::Elsewhere;
                let neighbours = if transferred { self.transfer().neighbours(state) } else { Vec::new() };
                decision::ExploredPoint::Search { search, step, measurements, neighbours }
            }
        };
        if let Some(exploration) = self.searches.change(state) {
            exploration.open.insert(number.0, point.id);
        }
        ProposedTrial { configuration, predicted_cost, point: decided }
    }
}

/// A configuration without a verdict that does not run now, drawn at random. `None` when a bounded number
/// of draws meets none, as in a space that is nearly exhausted.
pub(crate) fn unseen(transfer: &Transfer<'_>, state: StateId, number: TrialNumber) -> Option<Configuration> {
    drawn(transfer, state, number, Some).or_else(|| {
        let results = transfer.states.results(state);
        let is_running = |configuration: &Configuration| transfer.trials.runs(state, configuration);
        transfer.searches.few().untried(results, is_running).cloned()
    })
}

/// [`unseen`] of what `of` makes of the drawn configurations.
pub(crate) fn drawn(
    transfer: &Transfer<'_>,
    state: StateId,
    number: TrialNumber,
    of: impl Fn(Configuration) -> Option<Configuration>,
) -> Option<Configuration> {
    let results = transfer.states.results(state);
    let mut random = stream(transfer.spec.seed, Purpose::Unseen, state.0, number.0);
    (0..UNSEEN_DRAWS_MAX).find_map(|_| {
        let x: Vec<f64> = (0..transfer.spec.space.dimension()).map(|_| random.random()).collect();
        let configuration = of(transfer.spec.space.decode(&x))?;
        let seen =
            results.settled(&configuration, 1).is_some() || transfer.trials.runs(state, &configuration);
        (!seen).then_some(configuration)
    })
}

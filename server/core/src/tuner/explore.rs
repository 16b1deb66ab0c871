//! The next step of a state's search, for one client among several.

use rand::RngExt;

use crate::configuration::Configuration;
use crate::decision::{self, ExploitRule, Predicted};
use crate::ids::{StateId, TrialNumber};
use crate::limits::{KNOWN_POINTS_PER_SUGGESTION_MAX, UNSEEN_DRAWS_MAX};
use crate::policy::Policy;
use crate::predict::Answer;
use crate::randomness::{Purpose, stream};
use crate::results::{Record, ResultTable};
use crate::search::{AnySearch, Feedback, Point, SearchSetup, Step, Verdict};
use crate::trial::Trial;
use crate::tuner::plan::Planned;
use crate::tuner::proposal::{Exploitation, ProposedTrial};
use crate::tuner::{Ask, Exploration, Tuner, few, searches};

/// The most of the best configurations that a search receives if it goes on where another one ended.
const OBSERVATIONS_MAX: usize = 128;

/// Where another configuration beats an incumbent of other states, the incumbent is measured again after
/// every `DOUBTED_EVERY` tried configurations, until it has `DOUBTED_UNTIL` measurements.
const DOUBTED_EVERY: u64 = 3;
const DOUBTED_UNTIL: u64 = 3;
/// Number of stopped configurations after which the incumbent is measured again, where nothing else was
/// measured.
const STOPPED_BESIDE: usize = 3;

/// The best [`LEADERS`] that are not yet clearly better than the incumbent are measured again once
/// [`LEADERS_FROM`] configurations were tried and the share [`LEADERS_LATE`] of the budget is spent. Earlier,
/// a new configuration is worth more than a repeat: late repeats find lucky results as well.
const LEADERS_FROM: usize = 8;
const LEADERS_LATE: f64 = 0.6;
const LEADERS: usize = 3;
/// A leader is clearly better by [`LEADERS_CLEAR`] deviations of their difference, and after
/// [`LEADERS_MEASURED_LEAST`] measurements.
const LEADERS_CLEAR: f64 = 2.5;
const LEADERS_MEASURED_LEAST: u64 = 3;
/// No leader is measured more often than [`LEADERS_MEASURED_MAX`] times, and repeats are at most the share
/// [`LEADERS_SHARE`] of the tried configurations.
const LEADERS_MEASURED_MAX: u64 = 8;
const LEADERS_SHARE: f64 = 0.3;

/// The result of the walk along a search.
enum NextPoint {
    /// A point to measure.
    Measure(Point, Configuration),
    /// The search waits for trials that are out, or its budget is spent.
    Wait,
    /// Every point fell on a known configuration.
    OnlyKnown,
}

/// The result of exploring.
pub(super) enum Explored {
    /// A configuration to measure.
    Candidate(ProposedTrial),
    /// By a rule, a known configuration is run instead.
    Nothing { instead: Exploitation, rule: ExploitRule },
}

impl Explored {
    /// Whether a configuration beside the default and the incumbent is measured.
    pub(super) fn explores(&self) -> bool {
        let is_baseline = |point: &decision::ExploredPoint| {
            use decision::ExploredPoint::{Baseline, BaselineOfMachine, Incumbent};
            matches!(point, Baseline(_) | BaselineOfMachine | Incumbent { .. })
        };
        matches!(self, Explored::Candidate(candidate) if !is_baseline(&candidate.point))
    }
}

impl Tuner {
    /// The configuration that a client runs in trial `number` while it explores `state`: the search's next
    /// point that is worth a measurement. Where there is none (the search waits for other clients, or the
    /// budget is spent), it is the best known, because a client never waits. The best may then change from
    /// one answer to the next: only repeats of the leaders separate luck from merit.
    pub(super) fn explore(
        &mut self,
        (ask, room): (&Ask, usize),
        state: StateId,
        number: TrialNumber,
        normalised: &[f64],
        planned: &mut Planned,
    ) -> Explored {
        let client_id = ask.client_id.as_str();
        if let Some(candidate) = self.recheck(client_id, state)
            && self.standings().is_spent_within(room, state)
            && !self.standings().is_to_be_confirmed(state)
        {
            return Explored::Candidate(candidate);
        }
        // A session may want fewer trials than the study.
        let is_open = !self.standings().is_spent_within(room, state);
        let candidate = is_open.then(|| self.transfer().untried_by_machines(state)).flatten();
        let candidate = candidate.or_else(|| self.first_of_a_state(state, number, normalised, planned));
        let candidate = candidate.or_else(|| self.incumbent_again(client_id, room, state));
        if let Some(candidate) = candidate.or_else(|| self.leader_again(room, state)) {
            return Explored::Candidate(candidate);
        }
        self.ensure_exploration(room, state, planned);
        let is_exhausted = self.searches.few().is_exhausted(self.states.results(state));
        let next = match is_exhausted {
            true => NextPoint::Wait,
            false => self.walk((ask, room), state, planned),
        };
        let rule = match next {
            NextPoint::Measure(point, configuration) => {
                return Explored::Candidate(self.measure(state, number, point, configuration));
            }
            NextPoint::Wait if is_exhausted => match self.contender_again(room, state) {
                Some(candidate) => return Explored::Candidate(candidate),
                None if self.standings().is_spent_within(room, state) => ExploitRule::Finished,
                None => ExploitRule::Waiting,
            },
            NextPoint::OnlyKnown => match self.unseen(state, number) {
                Some(configuration) => {
                    let point = decision::ExploredPoint::Random;
                    let candidate = ProposedTrial { configuration, predicted_cost: None, point };
                    return Explored::Candidate(candidate);
                }
                None => ExploitRule::Finished,
            },
            NextPoint::Wait if self.is_over(room, state) => ExploitRule::Finished,
            NextPoint::Wait => ExploitRule::Waiting,
        };
        let mut rule = rule;
        if rule == ExploitRule::Finished {
            if let Some(candidate) = self.racing().confirm(state, number, planned) {
                return Explored::Candidate(candidate);
            }
            if self.standings().is_to_be_confirmed(state) {
                rule = ExploitRule::Waiting;
            }
        }
        let best = self.best_known(state, None, planned);
        let instead =
            best.unwrap_or_else(|| self.exploiting().measured_answer(normalised, Some(state), planned));
        let instead = self.beside_start(instead, self.start_of(ask).as_ref(), Some(state), planned);
        Explored::Nothing { instead, rule }
    }

    /// The incumbent, where it is to be measured again while others are explored, because it shows the speed
    /// of the client's machine. An incumbent of other states that does badly here is measured again soon, so
    /// that it gives way. One whose single cost may be far too low is measured again where all others were
    /// stopped by it. Once the search is spent the confirmation measures it anyway.
    fn incumbent_again(&self, client_id: &str, room: usize, state: StateId) -> Option<ProposedTrial> {
        let (results, incumbent) = (self.states.results(state), self.standings().incumbent(state));
        let goes_on = self.searches.taken(state, results, &self.spec.policy) < room && !results.is_exact();
        let hurried = !self.spec.objective.auxiliary().is_empty() && !self.auxiliaries.explains(state);
        let record = results.ran(incumbent)?;
        let is_default = incumbent == self.spec.space.default_ref();
        let is_beaten = results.best().is_some_and(|best| best.mean_cost < record.mean_cost);
        let is_doubtful = !is_default
            && is_beaten
            && record.measurements < DOUBTED_UNTIL
            && results.tried() as u64 >= DOUBTED_EVERY * record.measurements;
        let is_due = is_doubtful || self.speeds.is_due(client_id, state, hurried, results.wanders());
        let is_unsure = record.measurements < 2 || record.evidence.is_torn();
        let is_alone = is_unsure && results.ranked().len() == 1 && results.stopped() >= STOPPED_BESIDE;
        if !(goes_on && (is_alone || self.spec.policy.track_speed && is_due)) {
            return None;
        }
        let point = decision::ExploredPoint::Incumbent { is_default, round: None };
        let predicted_cost = Some(record.mean_cost);
        Some(ProposedTrial { configuration: incumbent.clone(), predicted_cost, point })
    }

    /// The next configuration of a recheck, which finds whether the machine or the state has changed after a
    /// cost jumped.
    fn recheck(&self, client_id: &str, state: StateId) -> Option<ProposedTrial> {
        let results = self.states.results(state);
        let wanted = self.rechecks.wanted(client_id, state);
        let record = wanted.and_then(|wanted| results.record(wanted)).filter(|record| !record.fails())?;
        let is_default = record.configuration == *self.spec.space.default_ref();
        let point = decision::ExploredPoint::Incumbent { is_default, round: None };
        let predicted_cost = Some(record.mean_cost);
        Some(ProposedTrial { configuration: record.configuration.clone(), predicted_cost, point })
    }

    /// A leader that seems better than the incumbent without being clearly so. A challenger that ran once is
    /// never proven by other trials, so a part of the search's measurements goes to the leaders, as in the
    /// racing of Maron and Moore ("Hoeffding races", NIPS 1993). Lucky ones fall back behind others, which
    /// are measured again next. Nothing is repeated where the policy confirms nothing, or where a search is
    /// followed as it was published. A single measurement far from all others is repeated at once, at any
    /// stage of the search.
    fn leader_again(&self, room: usize, state: StateId) -> Option<ProposedTrial> {
        let (results, incumbent) = (self.states.results(state), self.standings().incumbent(state));
        let (tried, taken) = (results.tried(), self.searches.taken(state, results, &self.spec.policy));
        let is_confirmed = self.spec.policy.confirm_rounds > 0 && self.transfer().warms_up_searches();
        if is_confirmed
            && taken < room
            && let Some(doubtful) = results.doubtful(incumbent)
            && !self.trials.runs(state, &doubtful.configuration)
        {
            return Some(self.again(doubtful));
        }
        let beside = results.ran(incumbent)?;
        let is_late = taken < room && taken as f64 >= LEADERS_LATE * room as f64;
        if !is_confirmed || tried < LEADERS_FROM || !is_late || results.is_exact() {
            return None;
        }
        let others = results.ranked().filter(|record| record.configuration != *incumbent);
        assert!(results.ranked().all(|record| record.measurements > 0), "what is ranked was measured");
        let repeats: u64 = others.map(|record| record.measurements - 1).sum();
        // On a machine whose speed wanders, only neighbouring trials compare well with the incumbent.
        let is_apart = results.wanders() && !results.is_latest(beside);
        if repeats as f64 >= LEADERS_SHARE * tried as f64 || is_apart {
            return None;
        }
        let noise = results.assumed_noise();
        let is_open = |leader: &&Record| {
            let parts = 1.0 / leader.measurements as f64 + 1.0 / beside.measurements as f64;
            let deviations = libm::log(beside.mean_cost / leader.mean_cost) / (noise * parts.sqrt());
            let is_clear = deviations >= LEADERS_CLEAR && leader.measurements >= LEADERS_MEASURED_LEAST;
            leader.configuration != *incumbent
                && deviations > 0.0
                && !is_clear
                && leader.measurements < LEADERS_MEASURED_MAX
                && !self.trials.runs(state, &leader.configuration)
        };
        results.ranked().take(LEADERS).find(is_open).map(|leader| self.again(leader))
    }

    /// One of the few configurations of a space that were all tried, which may be the best.
    fn contender_again(&self, room: usize, state: StateId) -> Option<ProposedTrial> {
        let results = self.states.results(state);
        let races = self.spec.policy.confirm_rounds > 0 && self.transfer().warms_up_searches();
        if !races || self.searches.taken(state, results, &self.spec.policy) >= room {
            return None;
        }
        let is_running = |configuration: &Configuration| self.trials.runs(state, configuration);
        few::next_of_race(results, is_running).map(|record| self.again(record))
    }

    /// A configuration once more.
    fn again(&self, record: &Record) -> ProposedTrial {
        let (search, measurements) = (self.spec.policy.search, record.measurements);
        let neighbours = Vec::new();
        let point =
            decision::ExploredPoint::Search { search, step: Step::Replicate, measurements, neighbours };
        let predicted_cost = Some(record.mean_cost);
        ProposedTrial { configuration: record.configuration.clone(), predicted_cost, point }
    }

    /// Whether the state's search has ended, and none of its trials is open.
    fn is_over(&self, room: usize, state: StateId) -> bool {
        let results = self.states.results(state);
        let own = self.searches.of(state);
        own.is_some_and(|own| own.open.is_empty() && is_spent(own, results, &self.spec.policy, room))
    }

    /// The first configuration of a state without measurements, if the predictor expects much gain from other
    /// states' measurements. A client that stays goes on with the state's search. Where every input is met
    /// only once, there is no other exploring.
    fn first_of_a_state(
        &self,
        state: StateId,
        number: TrialNumber,
        normalised: &[f64],
        planned: &Planned,
    ) -> Option<ProposedTrial> {
        let (answer, predictor) = self.transfer().first(state, number.0, normalised, planned)?;
        let Answer { configuration, expected, neighbours } = answer;
        let predicted_cost = Some(expected.cost);
        let expected = (expected.cost, expected.deviation);
        let point = decision::ExploredPoint::Proposal(Predicted { predictor, expected, neighbours });
        Some(ProposedTrial { configuration, predicted_cost, point })
    }

    /// Makes sure that the state has a search of the policy's kind, unless its budget is spent. Trials that
    /// carry points of an earlier search only feed the table from then on. The new search receives the
    /// results of the table if an earlier one spent its budget, which was raised since. It also receives them
    /// if they come from other machines, other databases or an earlier space of the study.
    fn ensure_exploration(&mut self, room: usize, state: StateId, planned: &mut Planned) {
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
    /// level is measured unless its configuration cannot be run.
    fn walk(&mut self, (ask, room): (&Ask, usize), state: StateId, planned: &mut Planned) -> NextPoint {
        let shares = self.open_levels(ask, room);
        let (space, policy) = (&self.spec.space, &self.spec.policy);
        let results = self.states.results(state);
        let spent = match self.searches.of(state) {
            Some(own) if own.search.is_some() => is_spent(own, results, policy, room),
            _ => return NextPoint::Wait,
        };
        let Some(Exploration { search: Some(search), .. }) = self.searches.change(state) else {
            return NextPoint::Wait;
        };
        search.open_levels(&shares);
        if let Some(point) = planned.take_point(state) {
            search.adopt(point);
        }
        let mut waiting = Vec::new();
        let mut walk = NextPoint::OnlyKnown;
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

    fn measure(
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

    /// A configuration without a verdict that does not run now, drawn at random. `None` when a bounded number
    /// of draws meets none, as in a space that is nearly exhausted.
    fn unseen(&self, state: StateId, number: TrialNumber) -> Option<Configuration> {
        self.drawn(state, number, Some).or_else(|| {
            let results = self.states.results(state);
            let is_running = |configuration: &Configuration| self.trials.runs(state, configuration);
            self.searches.few().untried(results, is_running).cloned()
        })
    }

    /// [`unseen`](Self::unseen) of what `of` makes of the drawn configurations.
    fn drawn(
        &self,
        state: StateId,
        number: TrialNumber,
        of: impl Fn(Configuration) -> Option<Configuration>,
    ) -> Option<Configuration> {
        let results = self.states.results(state);
        let mut random = stream(self.spec.seed, Purpose::Unseen, state.0, number.0);
        (0..UNSEEN_DRAWS_MAX).find_map(|_| {
            let x: Vec<f64> = (0..self.spec.space.dimension()).map(|_| random.random()).collect();
            let configuration = of(self.spec.space.decode(&x))?;
            let seen =
                results.settled(&configuration, 1).is_some() || self.trials.runs(state, &configuration);
            (!seen).then_some(configuration)
        })
    }

    /// In place of a trial that was to explore and that its client cannot run: a configuration without a
    /// verdict that `of` makes of another one. `None` where the trial does not explore or somebody limits its
    /// cost, and once as many configurations were tried as the policy searches.
    pub fn explored_instead(
        &self,
        (trial, ask): (&Trial, &Ask),
        of: impl Fn(Configuration) -> Option<Configuration>,
    ) -> Option<Configuration> {
        let (state, policy) = (StateId(trial.state_id), &self.spec.policy);
        let is_wanted = policy.abort_above.or(ask.session_policy.abort_above).is_some();
        let is_stopped = is_wanted && trial.decision.abort_above().is_some();
        let is_limited = policy.regret_budget.is_some() || is_stopped;
        let goes_on = self.states.results(state).tried() < policy.trials_per_state as usize;
        let explores = trial.decision.explores() && goes_on && !is_limited;
        explores.then(|| self.drawn(state, TrialNumber(trial.number), of)).flatten()
    }
}

/// Whether a search with a budget of `room` trials has none left that adds a configuration.
pub(super) fn is_spent(
    exploration: &Exploration,
    results: &ResultTable,
    policy: &Policy,
    room: usize,
) -> bool {
    searches::taken(Some(exploration), results, policy.replicates) + exploration.open.len() >= room
}

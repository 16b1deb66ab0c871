//! The next step of a state's search, for one client among several.

use rand::RngExt;

use crate::configuration::Configuration;
use crate::limits::{KNOWN_POINTS_PER_SUGGESTION_MAX, UNSEEN_DRAWS_MAX};
use crate::predict::Answer;
use crate::randomness::{Purpose, stream};
use crate::search::{AnySearch, Feedback, Layout, Point, Search, SearchSetup, Step, Verdict, levels};
use crate::trial::{Mode, Reason};
use crate::tuner::report::is_spent;
use crate::tuner::screening::CONTROL;
use crate::tuner::{Exploration, Prediction, Tuner, Work, query};

/// Most of the best configurations that a search is told which goes on where another one ended.
const TOLD_MAX: usize = 128;

/// What the walk along a search came to.
enum Walk {
    /// A point to measure.
    Measure(Point, Configuration),
    /// The search waits for trials that are out, or its budget is spent.
    Wait,
    /// One point after the other fell on known configurations.
    OnlyKnown,
}

impl Tuner {
    /// What a client that explores `state` runs in trial `number`: the search's next point that is worth a
    /// measurement; where there is none (other clients hold what the search waits for, or the budget is
    /// spent), the best that is known, because a client never waits. The best may change from one answer to
    /// the next here: measuring the leaders again is what tells luck from merit.
    pub(super) fn explore(&mut self, state: usize, number: u64, normalised: &[f64]) -> Prediction {
        if let Some(prediction) = self.transfer(state) {
            return prediction;
        }
        if let Some(prediction) = self.first_of_a_state(state, number, normalised) {
            return prediction;
        }
        self.ensure_exploration(state);
        let held = self.hold(state);
        let walk = self.walk(state, &held);
        let unseen = match walk {
            Walk::Measure(point, configuration) => {
                let mut prediction = self.measure(state, number, point, configuration);
                if prediction.mode == Mode::Explore {
                    prediction.reason.explanation.held = self.names_of(&held, &prediction.configuration);
                }
                return prediction;
            }
            Walk::OnlyKnown => self.unseen(state, number),
            Walk::Wait => None,
        };
        if let Some(configuration) = unseen {
            let reason = Reason {
                summary: "The search only met known configurations; this one was drawn at random.".into(),
                source: "random".into(),
                step: Step::RandomSearch.name().into(),
                ..Reason::default()
            };
            return Prediction {
                configuration,
                mode: Mode::Explore,
                predicted_cost: None,
                reason,
                insight: None,
            };
        }
        self.best_known(state).unwrap_or_else(|| self.exploitation(normalised, Some(state)))
    }

    /// What to run where nothing was measured yet, if the predictor can say from elsewhere where much may be
    /// gained. A client that stays goes on with the state's search; where every input is met once, this is all
    /// the exploring there is.
    fn first_of_a_state(&self, state: usize, number: u64, normalised: &[f64]) -> Option<Prediction> {
        if !self.is_untouched(state) {
            return None;
        }
        let query = query(&self.spec, &self.states, &self.atlas, &self.fleet, normalised, Some(state));
        let predictor = self.spec.policy.predictor;
        let (answer, method) = match &self.thoughts {
            None => self.predictors.propose(predictor, &query, number),
            Some(thoughts) => {
                self.predictors.propose_ahead(predictor, &query, number, thoughts.first(normalised))
            }
        }?;
        let Answer { configuration, expected, neighbours } = answer;
        let summary = format!(
            "Nothing was measured in this state; by what is known of others this may do better than the rest: \
             {:.4} ± {:.4}.",
            expected.cost, expected.deviation
        );
        let reason = Reason {
            summary,
            source: method.name().into(),
            step: Step::Model.name().into(),
            neighbours,
            ..Reason::default()
        };
        let predicted_cost = Some(expected.cost);
        Some(Prediction { configuration, mode: Mode::Explore, predicted_cost, reason, insight: None })
    }

    /// Sees that the state has a search of the policy's kind, unless its budget is spent. Trials that carry points
    /// of an earlier search only feed the table from then on. Where an earlier one was dropped because its budget
    /// was spent, and the budget was raised since, the new one is told what the table knows, and so it is where that was
    /// taken over from other machines.
    fn ensure_exploration(&mut self, state: usize) {
        let method = self.spec.policy.search;
        let mut was_dropped = false;
        if let Some(current) = &self.work[state].exploration {
            was_dropped = current.search.is_none();
            let goes_on = match &current.search {
                Some(search) => search.method() == method,
                None => is_spent(current, &self.states[state].knowledge, &self.spec.policy),
            };
            if goes_on {
                return;
            }
        }
        let setup = SearchSetup {
            seed: self.spec.seed,
            state_id: self.states[state].id,
            start: self.spec.space.encode(self.spec.space.default_ref()),
            budget: self.spec.policy.trials_per_state,
            levels: levels(&self.spec.space),
            layout: Layout::of(&self.spec.space),
        };
        let mut search = AnySearch::new(method, setup);
        let from_others = !self.work[state].siblings.is_empty();
        for record in self.states[state].knowledge.ranked().take(TOLD_MAX) {
            let point = || self.spec.space.encode(&record.configuration);
            match (was_dropped, from_others) {
                (true, _) => search.know(point(), Verdict::Cost(record.mean_cost)),
                (false, true) => search.hear(point(), Verdict::Cost(record.mean_cost)),
                (false, false) => break,
            }
        }
        if !was_dropped && self.hears_others() {
            let (thoughts, known) = (&mut self.thoughts, &self.states[state]);
            let thought =
                thoughts.as_mut().and_then(|thoughts| thoughts.take_beginning(known.id, &known.anchor));
            let beginning = thought.unwrap_or_else(|| self.told_by_others(state).beginning(&self.spec.space));
            if let Some((guide, first)) = beginning {
                search.follow(guide, first);
            }
        }
        self.work[state].exploration = Some(Exploration::new(search));
        self.work[state].changes += 1;
        self.states[state].explored = true;
        self.atlas.note(&self.states[state]);
    }

    /// The axes that the next point of a state's search leaves where they are: decided anew every few trials, and
    /// now and then none, so that there is evidence against it.
    fn hold(&mut self, state: usize) -> Vec<(usize, f64)> {
        let work = &mut self.work[state];
        let Some(mut exploration) = work.exploration.take_if(|exploration| exploration.search.is_some())
        else {
            return Vec::new();
        };
        work.changes += 1;
        let held = self.held_axes(&mut exploration, state);
        self.work[state].exploration = Some(exploration);
        held
    }

    /// The same on a copy of the exploration.
    pub(super) fn held_axes(&self, exploration: &mut Exploration, state: usize) -> Vec<(usize, f64)> {
        let Some(risk) = self.spec.policy.freeze_risk else {
            exploration.held = None;
            return Vec::new();
        };
        let knowledge = &self.states[state].knowledge;
        let tried = knowledge.tried();
        if self.screening.is_due(exploration.held.as_ref(), tried) {
            let best = knowledge.best().map_or(self.spec.space.default_ref(), |best| &best.configuration);
            let before = exploration.held.as_ref();
            exploration.held = Some(self.screening.judge(&self.spec.space, state, best, risk, before, tried));
        }
        let Some(held) = exploration.held.as_mut().filter(|held| !held.axes.is_empty()) else {
            return Vec::new();
        };
        held.points += 1;
        if held.points % CONTROL == 0 {
            return Vec::new();
        }
        held.axes.iter().map(|axis| (axis.axis, axis.x)).collect()
    }

    /// The names of held axes that a configuration has.
    fn names_of(&self, held: &[(usize, f64)], configuration: &Configuration) -> Vec<String> {
        let names = held.iter().map(|&(axis, _)| &self.spec.space.parameters()[axis].name);
        names.filter(|name| configuration.get(name).is_some()).cloned().collect()
    }

    /// Asks the search until a point is worth a measurement. Points that fall on configurations with a
    /// verdict are answered from the table (a pair of state and configuration is not sampled twice); points
    /// whose configuration runs just now in this state go back until it is reported.
    fn walk(&mut self, state: usize, held: &[(usize, f64)]) -> Walk {
        let Tuner { spec, states, work, thoughts, .. } = self;
        let (space, policy, knowledge) = (&spec.space, &spec.policy, &states[state].knowledge);
        let Work { exploration: Some(exploration), running, changes, .. } = &mut work[state] else {
            return Walk::Wait;
        };
        let spent = is_spent(exploration, knowledge, policy);
        let Some(search) = &mut exploration.search else {
            return Walk::Wait;
        };
        *changes += 1;
        let moves = !search.hold(held);
        let thinks = thoughts.is_none();
        if let Some(plan) = thoughts.as_mut().and_then(|thoughts| thoughts.take_plan(states[state].id)) {
            search.adopt(plan);
        }
        let mut waiting = Vec::new();
        let mut walk = Walk::OnlyKnown;
        for _ in 0..KNOWN_POINTS_PER_SUGGESTION_MAX {
            let is_at_hand = thinks || search.is_ready();
            let Some(point) = is_at_hand.then(|| search.ask()).flatten() else {
                walk = Walk::Wait;
                break;
            };
            let configuration = match point.step {
                // The default itself, even where its coordinates lose a digit.
                Step::Default => space.default_configuration(),
                _ if moves && !held.is_empty() => {
                    let mut x = point.x.clone();
                    held.iter().for_each(|&(axis, at)| x[axis] = at);
                    space.decode(&x)
                }
                _ => space.decode(&point.x),
            };
            let settled = match point.step {
                // The search knows it and wants to know it better.
                Step::Replicate => None,
                _ => knowledge.settled(&configuration, policy.replicates),
            };
            if let Some(verdict) = settled {
                search.tell(point.id, Feedback { verdict, fresh: false });
            } else if running.contains_key(&configuration) {
                waiting.push(point.id);
                walk = Walk::Wait;
            } else if spent && (point.step == Step::Replicate || !knowledge.is_tried(&configuration)) {
                waiting.push(point.id);
                walk = Walk::Wait;
                break;
            } else {
                walk = Walk::Measure(point, configuration);
                break;
            }
        }
        for id in waiting {
            search.withdraw(id);
        }
        walk
    }

    fn measure(
        &mut self,
        state: usize,
        number: u64,
        point: Point,
        configuration: Configuration,
    ) -> Prediction {
        let record = self.states[state].knowledge.record(&configuration);
        let known = record.filter(|record| record.measurements > 0);
        let predicted_cost = known.map(|record| record.mean_cost);
        let (mode, summary) = match (point.step, known) {
            (Step::Default, _) => {
                (Mode::Default, "The baseline comes first in a state that is explored.".to_owned())
            }
            (_, None) if point.step == Step::Elsewhere => {
                (Mode::Explore, "It did well in other states; here it was not measured yet.".to_owned())
            }
            (_, None) => (Mode::Explore, "The next point of the state's search.".to_owned()),
            (_, Some(record)) => {
                let count = record.measurements;
                (Mode::Explore, format!("Another replicate, after {count} measurements."))
            }
        };
        let neighbours = match point.step {
            Step::Elsewhere => self.neighbours(state),
            _ => Vec::new(),
        };
        let reason = Reason {
            summary,
            source: self.spec.policy.search.name().to_owned(),
            step: point.step.name().to_owned(),
            neighbours,
            ..Reason::default()
        };
        if let Some(exploration) = &mut self.work[state].exploration {
            exploration.open.insert(number, point.id);
        }
        self.work[state].changes += 1;
        Prediction { configuration, mode, predicted_cost, reason, insight: None }
    }

    /// A configuration without a verdict that nobody runs, drawn at random; `None` when a bounded number of
    /// draws meets none, as in a space that is as good as used up.
    fn unseen(&self, state: usize, number: u64) -> Option<Configuration> {
        let knowledge = &self.states[state].knowledge;
        let running = &self.work[state].running;
        let mut random = stream(self.spec.seed, Purpose::Unseen, self.states[state].id, number);
        (0..UNSEEN_DRAWS_MAX).find_map(|_| {
            let x: Vec<f64> = (0..self.spec.space.dimension()).map(|_| random.random()).collect();
            let configuration = self.spec.space.decode(&x);
            let seen = knowledge.settled(&configuration, 1).is_some() || running.contains_key(&configuration);
            (!seen).then_some(configuration)
        })
    }
}

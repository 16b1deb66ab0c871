//! The promises of every predictor, run against all of them.

use std::sync::Arc;

use proptest::prelude::*;
use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::decision::Choice;
use crate::ids::StateId;
use crate::policy::PredictorMethod;
use crate::space::{Domain, Parameter, Scale, Space};
use crate::trial::{Fingerprint, Outcome, Trial, TrialState};

pub(super) fn space(dimension: usize) -> Space {
    let share = || Domain::Float { min: 0.0, max: 1.0, scale: Scale::Linear };
    let parameter = |index: usize| Parameter::new(format!("p{index}"), share(), 0.5);
    Space::new((0..dimension).map(parameter).collect(), vec![]).expect("a valid space")
}

/// Known states with all predictors of a study.
#[derive(Clone)]
pub(super) struct World {
    pub(super) space: Space,
    pub(super) states: Vec<KnownState>,
    pub(super) state_index: StateIndex,
    pub(super) machines: Machines,
    pub(super) predictors: Predictors,
    trials: u64,
}

impl World {
    pub(super) fn new(dimension: usize, indicators: usize) -> Self {
        let space = space(dimension);
        World {
            predictors: Predictors::new(PredictorMethod::Auto, &space, indicators, 11, &[]),
            space,
            states: Vec::new(),
            state_index: StateIndex::new(indicators),
            machines: Machines::default(),
            trials: 0,
        }
    }

    /// The place of a machine; those whose numbers share their tens are a group.
    fn machine(&mut self, node: u64) -> MachineId {
        let threads = (node % 10) as u32;
        let fingerprint =
            Fingerprint { cpu_model: (node / 10).to_string(), threads, ..Fingerprint::default() };
        self.machines.note_founder(Some(&fingerprint)).0
    }

    pub(super) fn query<'a>(&'a self, state: &'a [f64]) -> Query<'a> {
        let here = self.states.iter().find(|known| known.anchor == state);
        let World { space, states, state_index, machines, .. } = self;
        Query { state, here, known: states, state_index, space, machines, machine: MachineId(0), rival: None }
    }

    /// A trial as the tuner takes it: tested, entered in its state's table, learnt.
    pub(super) fn take(
        &mut self,
        state: &[f64],
        point: &[f64],
        outcome: Outcome,
        cost: Option<f64>,
        node: u64,
    ) {
        let configuration = self.space.decode(point);
        let machine = self.machine(node);
        let place = self.states.iter().position(|known| known.anchor == state).unwrap_or_else(|| {
            let id = StateId(self.states.len() as u64 + 1);
            let (anchor, results) = (state.to_vec(), Default::default());
            self.states.push(KnownState { id, anchor, machine, explored: true, results });
            self.states.len() - 1
        });
        if let (Some(cost), Outcome::Ok) = (cost, &outcome) {
            let mut predictors = self.predictors.clone();
            predictors.test(&Query { machine, ..self.query(state) }, &configuration, cost);
            self.predictors = predictors;
        }
        self.trials += 1;
        let verdict = match (&outcome, cost) {
            (Outcome::Ok, Some(cost)) => Verdict::Cost(cost),
            (Outcome::Aborted { lower_bound }, _) => Verdict::AtLeast(*lower_bound),
            _ => Verdict::Infeasible,
        };
        let (client, state_id, decision) = (node.to_string(), place as u64 + 1, Choice::Wanted.decided());
        let trial = Trial {
            state: TrialState::Completed,
            cost,
            outcome: Some(outcome),
            complete_ms: Some(0),
            completion: Some(self.trials),
            ..Trial::new(self.trials, &client, state_id, configuration.clone(), decision)
        };
        Arc::make_mut(&mut self.states[place].results).learn(&trial, self.space.default_ref());
        self.state_index.note(&self.states[place]);
        let default = self.states[place].results.record(self.space.default_ref());
        let default_cost = default.filter(|record| record.measurements > 0).map(|record| record.mean_cost);
        let (configuration, machine) = (&configuration, self.machines.number(machine));
        let point = &self.space.encode(configuration)[..];
        self.predictors.learn(&Lesson { state, configuration, point, verdict, default_cost, machine });
    }

    pub(super) fn measure(&mut self, state: &[f64], point: &[f64], cost: f64) {
        self.take(state, point, Outcome::Ok, Some(cost), 1);
    }

    pub(super) fn ask(&self, method: PredictorMethod, state: &[f64]) -> Option<Answer> {
        self.predictors.predict(method, &self.query(state)).map(|(answer, _)| answer)
    }
}

/// A cost whose best action follows the state.
pub(super) fn cost(state: &[f64], point: &[f64]) -> f64 {
    1.0 + state.iter().zip(point).map(|(s, p)| 3.0 * (s - p).powi(2)).sum::<f64>()
}

/// A world with `states` states of three indicators and `each` random trials in each, at `scale` times the
/// cost.
pub(super) fn trained(states: usize, each: usize, scale: f64) -> World {
    let mut world = World::new(3, 3);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..states {
        let state: [f64; 3] = std::array::from_fn(|_| random.random());
        for _ in 0..each {
            let point: [f64; 3] = std::array::from_fn(|_| random.random());
            world.measure(&state, &point, scale * cost(&state, &point));
        }
    }
    world
}

pub(super) fn methods() -> impl Iterator<Item = PredictorMethod> {
    METHODS.iter().copied().chain([PredictorMethod::Auto])
}

#[test]
fn without_a_trial_there_is_no_answer() {
    let world = World::new(3, 3);
    for method in methods() {
        assert_eq!(world.ask(method, &[0.1, 0.2, 0.3]), None, "{method:?}");
        let query = world.query(&[0.1, 0.2, 0.3]);
        assert_eq!(world.predictors.propose(method, &query, 1, FitTime::Now), None, "{method:?}");
        assert_eq!(world.predictors.estimate(method, &query, world.space.default_ref()), None);
    }
}

/// A second implementation of the paper's section 6.1, slow and plain. It takes the nearest of the measured
/// states by Euclidean distance, and of its trials the cheapest.
#[test]
fn the_nearest_neighbour_is_what_a_plain_walk_finds() {
    let mut world = World::new(3, 3);
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let mut trials: Vec<([f64; 3], [f64; 3], f64)> = Vec::new();
    for _ in 0..30 {
        let state: [f64; 3] = std::array::from_fn(|_| random.random());
        for _ in 0..random.random_range(1..6) {
            let point: [f64; 3] = std::array::from_fn(|_| random.random());
            let cost = cost(&state, &point);
            world.measure(&state, &point, cost);
            trials.push((state, point, cost));
        }
    }
    for _ in 0..200 {
        let asked: [f64; 3] = std::array::from_fn(|_| random.random());
        let distance = |state: &[f64; 3]| state.iter().zip(&asked).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let nearest = trials.iter().map(|trial| trial.0).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let there = trials.iter().filter(|trial| Some(trial.0) == nearest);
        let best = there.min_by(|a, b| a.2.total_cmp(&b.2)).expect("something was measured");
        let answer = world.ask(PredictorMethod::NearestNeighbour, &asked).expect("an answer");
        assert_eq!(answer.configuration, world.space.decode(&best.1), "for {asked:?}");
        let cost = answer.expected.cost;
        assert!((cost - best.2).abs() < 1e-9 * best.2, "{cost} for {}", best.2);
    }
}

#[test]
fn all_learn_a_smooth_function() {
    let world = trained(120, 12, 1.0);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    for method in methods() {
        let (mut chosen, mut default, mut errors, mut constant) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..100 {
            let state: [f64; 3] = std::array::from_fn(|_| random.random());
            let point: [f64; 3] = std::array::from_fn(|_| random.random());
            let answer = world.ask(method, &state).expect("trained");
            chosen += cost(&state, &world.space.encode(&answer.configuration)) / 100.0;
            default += cost(&state, &[0.5; 3]) / 100.0;
            let configuration = world.space.decode(&point);
            let expected = world.predictors.estimate(method, &world.query(&state), &configuration);
            errors += prequential::error(expected, cost(&state, &point)) / 100.0;
            // Of a model that ignores state and action and always says the middle.
            constant += (cost(&state, &point) / 1.5).ln().abs() / 100.0;
        }
        assert!(chosen < 1.0 + 0.75 * (default - 1.0), "{method:?}: chosen {chosen}, default {default}");
        assert!(errors < 0.95 * constant, "{method:?}: error {errors}, of a constant {constant}");
    }
}

#[test]
fn the_choice_does_not_depend_on_the_unit_of_the_cost() {
    // Powers of two leave the rounding of rewards as it is; logarithms are only nearly as good.
    for scale in [2f64.powi(-20), 2f64.powi(30)] {
        let (plain, scaled) = (trained(30, 6, 1.0), trained(30, 6, scale));
        for method in methods() {
            let mut same = 0;
            for step in 0..20 {
                let state = [f64::from(step) / 20.0, 0.3, 0.7];
                let (a, b) = (
                    plain.ask(method, &state).expect("trained"),
                    scaled.ask(method, &state).expect("trained"),
                );
                same += u32::from(a.configuration == b.configuration);
                let (a, b) = (scale * a.expected.cost, b.expected.cost);
                assert!((a - b).abs() <= 1e-6 * a, "{method:?}: {a} and {b}");
            }
            assert!(same >= 19, "{method:?}: {same} of 20");
        }
    }
}

#[test]
fn an_infeasible_configuration_is_never_answered_in_its_state() {
    let base = trained(20, 8, 1.0);
    let state = base.states[3].anchor.clone();
    for method in methods() {
        let mut world = base.clone();
        for _ in 0..12 {
            let Some(answer) = world.ask(method, &state) else { break };
            assert!(!world.states[3].results.is_infeasible(&answer.configuration), "{method:?}");
            let point = world.space.encode(&answer.configuration);
            world.take(&state, &point, Outcome::Infeasible { reason: String::new() }, None, 1);
        }
    }
}

/// Where a limit of feasibility moves with the state, what ran on one side of it may fail on the other.
#[test]
fn where_something_failed_a_prediction_ran_on_both_sides_and_not_only_far_away() {
    let mut world = World::new(2, 1);
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let (cheap, default) = ([0.3, 0.5], [0.5, 0.5]);
    let cost = |point: &[f64; 2]| 1.0 + 20.0 * ((point[0] - 0.3).powi(2) + (point[1] - 0.5).powi(2));
    let fails = || Outcome::Infeasible { reason: String::new() };
    let known = [0.2, 0.3, 0.4, 0.6, 0.7, 0.8];
    for state in known {
        let others: [[f64; 2]; 4] = std::array::from_fn(|_| [0.6 * random.random::<f64>(), random.random()]);
        for point in [cheap, default].iter().chain(&others) {
            world.measure(&[state], point, cost(point));
        }
        world.take(&[state], &[0.95, random.random()], fails(), None, 1);
    }
    let answer = |world: &World, state: f64| {
        let state = [state];
        let query = Query { rival: Some(world.space.default_ref()), ..world.query(&state) };
        let answer = world.predictors.predict(PredictorMethod::Contextual, &query);
        answer.map(|(answer, _)| answer.configuration)
    };
    let best = world.space.decode(&cheap);
    assert_eq!(answer(&world, 0.5), Some(best.clone()));
    for step in 0..=40 {
        let state = f64::from(step) / 40.0;
        // In a known state its own measurements suffice.
        let is_known = world.states.iter().any(|known| known.anchor == [state]);
        if let Some(answer) = answer(&world, state).filter(|_| !is_known) {
            let ran = world.states.iter().filter(|known| known.results.ran(&answer).is_some());
            let (below, above): (Vec<f64>, Vec<f64>) =
                ran.map(|known| known.anchor[0]).partition(|anchor| *anchor < state);
            assert!(!below.is_empty() && !above.is_empty(), "{answer:?} at {state} is known of one side");
        }
    }
    // Nothing ran there.
    world.take(&[0.5], &cheap, Outcome::Aborted { lower_bound: 9.0 }, Some(9.0), 1);
    assert_ne!(answer(&world, 0.53), Some(best.clone()), "it was stopped in the nearest state");
    world.take(&[0.5], &cheap, fails(), None, 1);
    assert_ne!(answer(&world, 0.51), Some(best), "it failed in the nearest state that tried it");
}

#[test]
fn a_state_unlike_all_others_does_not_decide_next_to_it() {
    let mut world = World::new(2, 2);
    let mut random = ChaCha8Rng::seed_from_u64(5);
    // In the first state alone a fourth of the cost is reached, with the first parameter near its end.
    let anchors = [[0.5, 0.5], [0.2, 0.4], [0.7, 0.8], [0.8, 0.3], [0.3, 0.8], [0.1, 0.1], [0.9, 0.6]];
    let rival: [f64; 2] = [0.3, 0.5];
    for (place, anchor) in anchors.iter().enumerate() {
        for number in 0..30 {
            let point = if number == 0 { rival } else { random.random() };
            let far = point[0] > 0.8;
            let factor = if far && place == 0 { 0.25 } else { 1.0 + 0.3 * f64::from(u8::from(far)) };
            let bowl = 1.0 + (point[0] - rival[0]).powi(2) + (point[1] - rival[1]).powi(2);
            world.take(anchor, &point, Outcome::Ok, Some(10.0 * bowl * factor), 0);
        }
    }
    let rival = world.space.decode(&rival);
    for asked in [[0.52, 0.5], [0.45, 0.47], [0.5, 0.6]] {
        let query = Query { rival: Some(&rival), ..world.query(&asked) };
        for method in [PredictorMethod::Auto, PredictorMethod::Contextual] {
            let answer = world.predictors.predict(method, &query);
            let first = answer.and_then(|(answer, _)| answer.configuration.get("p0")?.as_number());
            assert!(first.is_none_or(|first| first <= 0.8), "{first:?} by {method:?} at {asked:?}");
        }
    }
}

#[test]
fn one_predictor_proposes_and_never_twice_the_same() {
    let world = trained(20, 2, 1.0);
    let propose =
        |method, number| world.predictors.propose(method, &world.query(&[0.4; 3]), number, FitTime::Now);
    let by_model = |number| propose(PredictorMethod::Contextual, number).expect("one").0.configuration;
    assert_ne!(by_model(1), by_model(2));
    assert_eq!(propose(PredictorMethod::NearestNeighbour, 1), None);
}

proptest! {
    #![proptest_config(crate::testing::cases(24))]

    #[test]
    fn whatever_they_are_told_answers_are_finite_and_in_the_space(
        observations in prop::collection::vec((0usize..8, 0.0f64..1.0), 1..60), far in 0usize..4,
    ) {
        let mut world = World::new(3, 3);
        for (index, (kind, at)) in observations.iter().enumerate() {
            let (outcome, cost) = match kind {
                0 => (Outcome::Ok, Some(0.0)),
                1 => (Outcome::Ok, Some(f64::MAX)),
                2 => (Outcome::Ok, Some(5e-324)),
                3 => (Outcome::Infeasible { reason: String::new() }, None),
                4 => (Outcome::Aborted { lower_bound: 1e300 }, Some(1e300)),
                _ => (Outcome::Ok, Some(1e-3 + at)),
            };
            let outlier = if index % 4 == far { 1e9 } else { (at * 8.0).round() };
            world.take(&[outlier, 0.5, 0.1], &[*at, 1.0 - at, 0.5], outcome, cost, index as u64 % 3);
        }
        for method in methods() {
            for state in [[0.5; 3], [-1e9; 3], [1e9, 0.0, 1.0]] {
                let query = world.query(&state);
                let answers = [
                    world.predictors.predict(method, &query),
                    world.predictors.propose(method, &query, 1, FitTime::Now),
                ];
                for (answer, _) in answers.into_iter().flatten() {
                    let Estimate { cost, deviation } = answer.expected;
                    prop_assert!(cost.is_finite() && cost >= 0.0 && deviation.is_finite() && deviation >= 0.0);
                    prop_assert!(world.space.configuration(answer.configuration.to_raw()).is_ok());
                    prop_assert!(answer.neighbours.iter().all(|neighbour| neighbour.distance.is_finite()));
                }
            }
        }
        for (_, interval) in world.predictors.errors() {
            prop_assert!(interval.low <= interval.mean && interval.mean <= interval.high);
            prop_assert!(interval.high.is_finite());
        }
    }
}

//! Possible answers: configurations that were measured and work.

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::decision::Predicted;
use crate::policy::Operation;
use crate::randomness::standard_normal;
use crate::session::SessionPolicy;

/// A random study: states, the infeasible region of each, noise, and machines whose speed drifts and jumps.
struct RandomWorld {
    tuner: Tuner,
    random: ChaCha8Rng,
    states: Vec<(f64, f64)>,
    noise: f64,
    /// The limit of feasibility, and its movement with the state.
    limit: (f64, f64),
    frames: u64,
    /// For each state, the configurations that ran to the end and those that did not.
    ran: BTreeMap<u64, Vec<Configuration>>,
    failed: BTreeMap<u64, Vec<Configuration>>,
}

impl RandomWorld {
    fn new(seed: u64, policy: Policy) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let count = random.random_range(1..=5);
        let states = (0..count).map(|_| (random.random(), random.random())).collect();
        let (noise, limit) =
            ([0.0, 0.03, 0.25][random.random_range(0..3)], (random.random_range(2.0..9.0), random.random()));
        RandomWorld {
            tuner: seeded(seed, policy),
            random,
            states,
            noise,
            limit,
            frames: 0,
            ran: BTreeMap::new(),
            failed: BTreeMap::new(),
        }
    }

    /// The cheapest configurations lie just beside the infeasible region.
    fn truth(&self, trial: &Trial) -> Option<f64> {
        let number = |name: &str| trial.configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
        let reach = number("travel_cost") + 0.2 * number("width");
        let limit = self.limit.0 + 3.0 * self.limit.1 * (trial.indicators["x"] - 0.5);
        let cost = 30.0 - 2.0 * reach + 0.5 * number("max_leaf_size") + 0.25 * number("min_leaf_size");
        (reach <= limit.max(1.5)).then_some(cost)
    }

    /// A frame of a client in a state, which runs the trial that it receives. `check` sees the tuner before
    /// the report.
    fn frame(&mut self, client: &str, state: usize, session: SessionPolicy, check: impl Fn(&Self, &Trial)) {
        let (x, y) = self.states[state];
        let ask = Ask { session_policy: session, ..ask(client, x, y) };
        let trial = self.tuner.suggest(&ask, 0).expect("a valid question").0;
        check(self, &trial);
        self.frames += 1;
        // The machine warms up, and once it is twice as fast for a while.
        let jumped = if self.frames % 37 < 5 { 0.5 } else { 1.0 };
        let speed = jumped * (1.0 + 0.1 * (self.frames as f64 / 9.0).sin());
        let (outcome, cost) = match self.truth(&trial) {
            Some(cost) => {
                (Outcome::Ok, cost * speed * (self.noise * standard_normal(&mut self.random)).exp())
            }
            None => (infeasible(), 0.0),
        };
        let book = if outcome == Outcome::Ok { &mut self.ran } else { &mut self.failed };
        book.entry(trial.state_id).or_default().push(trial.configuration.clone());
        let _change = self.tuner.report(&trial, measured(cost), outcome, 1).expect("a valid report");
    }

    /// Runs `frames` frames of three clients that tune.
    fn tune(&mut self, frames: usize) {
        for _ in 0..frames {
            let client = ["a", "b", "c"][self.random.random_range(0..3)];
            let state = self.random.random_range(0..self.states.len());
            (0..4).for_each(|_| self.frame(client, state, SessionPolicy::default(), |_, _| {}));
        }
    }

    /// Checks an answer where only measurements count: it ran in the state. Where nothing did, it ran in
    /// another and did not fail here, or is the default.
    fn assert_measured(&self, trial: &Trial) {
        let of =
            |book: &BTreeMap<u64, Vec<Configuration>>| book.get(&trial.state_id).cloned().unwrap_or_default();
        let (ran, failed) = (of(&self.ran), of(&self.failed));
        let is_default = trial.configuration == self.tuner.spec().space.default_configuration();
        let elsewhere = self.ran.values().flatten().any(|other| *other == trial.configuration);
        if ran.is_empty() {
            assert!(is_default || elsewhere, "nobody ran it: {}", trial.reason().summary);
            assert!(is_default || !failed.contains(&trial.configuration), "it failed here before");
        } else {
            assert!(ran.contains(&trial.configuration), "untested here: {}", trial.reason().summary);
            assert!(!failed.contains(&trial.configuration), "it fails here");
        }
    }
}

fn policies() -> impl Strategy<Value = Policy> {
    let predictors = [
        PredictorMethod::Auto,
        PredictorMethod::Auto,
        PredictorMethod::NearestNeighbour,
        PredictorMethod::RbfGreedyGq,
        PredictorMethod::Contextual,
    ];
    (0..predictors.len(), 0.2..1.0f64, 4..40u32, any::<bool>()).prop_map(
        move |(predictor, epsilon, trials_per_state, confirms)| Policy {
            predictor: predictors[predictor],
            epsilon,
            trials_per_state,
            confirm_rounds: if confirms { 10 } else { 0 },
            ..Policy::default()
        },
    )
}

/// A client keeps a model's answer that it never ran, in a state where nothing was measured.
#[test]
fn a_kept_prediction_does_not_outlive_exploring() {
    for now in [Policy { operation: Operation::Freeze, ..explore_always() }, exploit_always()] {
        let mut tuner = tuner(explore_always());
        let trial = suggest(&mut tuner, "a", 0.5, 0.5);
        let _ = tuner.abandon(&trial).expect("it was open");
        let configuration = tuner.spec().space.decode(&[0.9, 0.1, 0.2, 0.3]);
        let (predictor, neighbours) = (PredictorMethod::Contextual, Vec::new());
        let source = ExploitSource::Predictor(Predicted { predictor, expected: (3.0, 0.1), neighbours });
        exploits(&mut tuner, "a", configuration.clone(), source, ExploitRule::Dice);
        let kept = suggest(&mut tuner, "a", 0.5, 0.5);
        assert_eq!(kept.configuration, configuration);
        let _ = tuner.abandon(&kept).expect("it was open");
        tuner.set_policy(now).expect("valid");
        let default = tuner.spec().space.default_configuration();
        assert_eq!(suggest(&mut tuner, "a", 0.5, 0.5).configuration, default);
    }
}

proptest! {
    #![proptest_config(crate::testing::cases(48))]

    #[test]
    fn frozen_never_hands_out_the_untested(seed in 0..10_000u64, policy in policies(), frames in 1..30usize) {
        let mut world = RandomWorld::new(seed, policy.clone());
        world.tune(frames);
        let stale = world.tuner.set_policy(Policy { operation: Operation::Freeze, ..policy }).expect("valid");
        assert!(!stale, "the models stay");
        // Two of the states may be new.
        world.states.extend([(0.31, 0.77), (0.9, 0.1)]);
        for state in 0..world.states.len() {
            for client in ["a", "d"] {
                (0..3).for_each(|_| world.frame(client, state, SessionPolicy::default(), RandomWorld::assert_measured));
            }
        }
    }

    #[test]
    fn a_client_with_epsilon_zero_meets_no_configuration_that_nobody_ran(
        seed in 0..10_000u64,
        policy in policies(),
    ) {
        let mut world = RandomWorld::new(seed, policy);
        let never = SessionPolicy { epsilon: Some(0.0), ..SessionPolicy::default() };
        for _ in 0..12 {
            world.tune(2);
            let state = world.random.random_range(0..world.states.len());
            (0..3).for_each(|_| world.frame("production", state, never, RandomWorld::assert_measured));
        }
    }

    #[test]
    fn an_answer_that_failed_is_not_answered_again(seed in 0..10_000u64, policy in policies()) {
        let mut world = RandomWorld::new(seed, policy);
        let default = world.tuner.spec().space.default_configuration();
        let check = |world: &RandomWorld, trial: &Trial| {
            let failed = world.failed.get(&trial.state_id).is_some_and(|all| all.contains(&trial.configuration));
            let is_answer = trial.mode() != Mode::Explore && trial.configuration != default;
            assert!(!(failed && is_answer), "it failed here before: {}", trial.reason().summary);
        };
        for _ in 0..40 {
            let client = ["a", "b", "c"][world.random.random_range(0..3)];
            let state = world.random.random_range(0..world.states.len());
            (0..4).for_each(|_| world.frame(client, state, SessionPolicy::default(), check));
        }
    }
}

/// Five states in which the cheapest configurations fail, as of a compressor whose output may not grow.
#[test]
fn what_is_predicted_while_a_study_is_tuned_can_nearly_always_be_run() {
    // Answers that a model predicted, and those that other states answer; and how many of each failed.
    let (mut predicted, mut taken_over) = ((0, 0), (0, 0));
    for seed in 0..40 {
        let mut world = RandomWorld::new(seed, Policy { epsilon: 0.3, ..Policy::default() });
        world.states = vec![(0.1, 0.5), (0.3, 0.5), (0.5, 0.5), (0.7, 0.5), (0.9, 0.5)];
        for frame in 0..150 {
            let state = (frame / 3) % 5;
            let ran = world.ran.clone();
            let prediction = std::cell::Cell::new(None);
            world.frame("a", state, SessionPolicy::default(), |world, trial| {
                let is_new = ran.get(&trial.state_id).is_none_or(|ran| !ran.contains(&trial.configuration));
                let is_prediction = trial.mode() == Mode::Exploit && is_new;
                prediction.set(is_prediction.then(|| (world.truth(trial).is_none(), trial.reason().summary)));
            });
            if let Some((fails, summary)) = prediction.into_inner() {
                assert!(summary.contains("Predicted") || summary.contains("known states"), "{summary}");
                let counts = if summary.contains("Predicted") { &mut predicted } else { &mut taken_over };
                counts.0 += 1;
                counts.1 += usize::from(fails);
            }
        }
    }
    println!("predicted, and of these failed: {predicted:?}; taken over: {taken_over:?}");
    let (count, failed) = predicted;
    // The goal is one in a hundred. Where it sufficed that a prediction ran in one near state, 15 of 291
    // failed. Where a sure model of feasibility sufficed, 86 of 473 did: limits are sharper than it believes.
    // Asked to have run on both sides, 9 are left, and the best measured answers in place of the others.
    assert!(count > 4 && failed == 0, "{failed} of {count} predictions failed");
    assert_eq!(taken_over.1, 0, "what runs in other states runs here");
}

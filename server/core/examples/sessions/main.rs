//! Sessions of several clients under every policy, search and predictor, with every answer.
//!
//! The tuner is deterministic, so the output of two versions that should behave alike can be compared line by
//! line. Run `cargo run -p treewright-core --example sessions > before.txt` before and again after a change,
//! then `diff`. A section does not depend on the place of its policy, search or predictor among the others.
//! The last column is the text for people; the others hold the clients' data and the learnt values.

use std::collections::BTreeMap;
use std::sync::Arc;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use treewright_core::fnv;
use treewright_core::policy::{Operation, Policy, PredictorMethod, SearchMethod};
use treewright_core::space::{Scale, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Fingerprint, Outcome, Trial};
use treewright_core::tuner::{Ask, Change, DecisionStep, Tuner};
use treewright_core::value::Value;
use treewright_core::words::Word as _;

/// Number of events in a session: suggestions, reports and disturbances.
const EVENTS: usize = 260;

fn space() -> Space {
    let space = Space::builder().categorical("builder", ["sah", "morton", "spatial"]).default("sah");
    let space = space.float("split_budget", 0.01..=1.0).log().default(0.2).active_if("builder", ["spatial"]);
    let space = space.integer("min_leaf_size", 1..=16).default(1);
    let space = space.integer("max_leaf_size", 1..=16).default(16);
    let space = space.float("travel_cost", 0.0..=10.0).default(1.0).boolean("compressed").default(false);
    space.less_or_equal("min_leaf_size", "max_leaf_size").build().expect("a valid space")
}

fn spec(policy: Policy) -> StudySpec {
    let spec = StudySpec::builder(space()).display_name("sessions").minimise("render_ms", 1.0).seed(7);
    let spec = spec.indicator("x", 0.0..=1.0, Scale::Linear).indicator("y", 0.0..=1.0, Scale::Linear);
    spec.state_tolerance(0.05).build().expect("valid").with_policy(policy)
}

/// The true cost of a trial: another configuration is best for each input and machine.
fn cost(trial: &Trial, threads: u32, noise: f64) -> f64 {
    let number = |name: &str| trial.configuration.get(name).and_then(Value::as_number).unwrap_or(0.0);
    let builder = match trial.configuration.get("builder") {
        Some(Value::Text(text)) if text == "spatial" => 2.0 - trial.indicators["x"] + number("split_budget"),
        Some(Value::Text(text)) if text == "morton" => 3.0,
        _ => 2.0,
    };
    let leaves = 0.2 * (number("max_leaf_size") - 4.0).abs() + 0.1 * number("min_leaf_size");
    let travel = (number("travel_cost") - 10.0 * trial.indicators["x"]).abs();
    (10.0 + builder + leaves + travel) * (1.0 + noise) / f64::from(threads.max(1))
}

fn machine(number: u32) -> Option<Fingerprint> {
    let software = BTreeMap::from([("embree".to_owned(), format!("4.{}", number / 3))]);
    (number > 0).then(|| Fingerprint {
        cpu_model: format!("processor {}", number % 2),
        isa: "avx2".into(),
        threads: number,
        software,
    })
}

/// Every policy, by name.
fn policies() -> Vec<(String, Policy)> {
    let base = Policy { epsilon: 0.5, trials_per_state: 24, ..Policy::default() };
    let pinned = space().decode(&[0.9, 0.5, 0.1, 0.2, 0.3, 0.9]);
    let mut all = vec![
        ("base".to_owned(), base.clone()),
        ("replicates".to_owned(), Policy { replicates: 2, lease_s: 5, ..base.clone() }),
        (
            "budget".to_owned(),
            Policy { regret_budget: Some(0.5), abort_above: Some(1.2), epsilon: 1.0, ..base.clone() },
        ),
        (
            "strict budget".to_owned(),
            Policy { regret_budget: Some(0.1), worst_factor: 4.0, epsilon: 1.0, ..base.clone() },
        ),
        (
            "weigh gain".to_owned(),
            Policy { weigh_gain: true, epsilon_halves_after: 3, warm_up: 2, ..base.clone() },
        ),
        ("abort".to_owned(), Policy { epsilon: 1.0, abort_above: Some(1.5), ..base.clone() }),
        ("freeze".to_owned(), Policy { operation: Operation::Freeze, ..base.clone() }),
        ("shadow".to_owned(), Policy { operation: Operation::Shadow, ..base.clone() }),
        ("pinned".to_owned(), Policy { pinned: Some(pinned), ..base.clone() }),
        ("never".to_owned(), Policy { epsilon: 0.0, ..base.clone() }),
        ("no roll back".to_owned(), Policy { roll_back: false, ..base.clone() }),
    ];
    for &(search, _) in SearchMethod::WORDS {
        all.push((format!("search {}", search.name()), Policy { search, epsilon: 0.9, ..base.clone() }));
    }
    for &(predictor, _) in PredictorMethod::WORDS {
        let policy = Policy { predictor, epsilon: 0.4, ..base.clone() };
        all.push((format!("predictor {}", predictor.name()), policy));
    }
    all
}

struct Session {
    tuner: Tuner,
    random: ChaCha8Rng,
    now_ms: i64,
    /// Trials that were handed out, with the thread count of their clients.
    trials: BTreeMap<u64, (Trial, u32)>,
    /// Plans are made apart from the tuner, as a daemon does.
    apart: bool,
}

impl Session {
    fn pick(&mut self) -> Option<(Trial, u32)> {
        let back = self.random.random_range(0..6).min(self.trials.len().checked_sub(1)?);
        let (number, (stored, threads)) = self.trials.iter().nth_back(back)?;
        Some((self.tuner.clients().open_trial(*number).unwrap_or(stored).clone(), *threads))
    }

    fn take(&mut self, change: &Change, threads: u32) {
        for trial in &change.trials {
            let threads = self.trials.get(&trial.number).map_or(threads, |known| known.1);
            self.trials.insert(trial.number, (trial.clone(), threads));
            print_trial(trial);
        }
        for state in &change.states {
            let bytes = state.search.as_ref().map_or(Vec::new(), |search| search.pack());
            println!("  state {} {:?} search {:016x}", state.id, state.indicators, fnv::hash(bytes));
        }
        for visit in &change.visits {
            let account = serde_json::to_string(&visit.account).expect("plain data");
            println!("  visit {} {} {} {account}", visit.client_id, visit.state_id, visit.number);
        }
    }

    fn suggest(&mut self, wants: bool) {
        let client = self.random.random_range(0..5u32);
        let place: u32 = self.random.random_range(0..5);
        let hurry = self.random.random_range(0..30) == 0;
        let threads = if hurry { 9 } else { [0, 0, 1, 2, 4][client as usize] };
        let indicators = BTreeMap::from([
            ("x".to_owned(), 0.2 * f64::from(place / 2)),
            ("y".to_owned(), 0.3 + 0.005 * f64::from(client)),
        ]);
        let ask = Ask {
            client_id: format!("client {client}"),
            indicators,
            fingerprint: machine(threads),
            session: self.trials.len() as u64 / 100,
            can_abort: client > 1,
            ..Ask::default()
        };
        let answer = if wants {
            let x: Vec<f64> = (0..6).map(|_| self.random.random()).collect();
            let wanted = self.tuner.spec().space.decode(&x).to_raw();
            self.tuner.suggest_wanted(&ask, wanted, None, self.now_ms)
        } else if self.apart {
            let spec = Arc::clone(self.tuner.spec());
            if let Some(updates) = self.tuner.knowledge().deferred_updates() {
                self.tuner.knowledge_mut().apply_updates(updates.compute(&spec.space));
            }
            let mut plan = None;
            loop {
                match self.tuner.suggest_step(&ask, plan, |_| true, self.now_ms) {
                    Ok(DecisionStep::Need(request)) => plan = Some(request.compute()),
                    Ok(DecisionStep::Done(answer)) => break Ok(answer),
                    Err(refused) => break Err(refused),
                }
            }
        } else {
            self.tuner.suggest(&ask, self.now_ms)
        };
        match answer {
            Ok((_, change)) => self.take(&change, threads),
            Err(error) => println!("  refused: {error}"),
        }
    }

    fn report(&mut self) {
        let Some((trial, threads)) = self.pick() else { return };
        let noise = 0.05 * (2.0 * self.random.random::<f64>() - 1.0);
        let cost = cost(&trial, threads, noise);
        let outcome = match self.random.random_range(0..20) {
            0 => Outcome::Infeasible { reason: "depth".into() },
            1 => Outcome::Aborted { lower_bound: 0.75 * cost },
            2 => Outcome::Failed { reason: "crash".into() },
            _ => Outcome::Ok,
        };
        let measurements = BTreeMap::from([("render_ms".to_owned(), cost)]);
        match self.tuner.report(&trial, measurements, outcome, self.now_ms) {
            Ok((_, change)) => self.take(&change, threads),
            Err(error) => println!("  refused: {error}"),
        }
    }

    fn step(&mut self) {
        self.now_ms += 100;
        match self.random.random_range(0..40) {
            0 => {
                let Some((trial, threads)) = self.pick() else { return };
                match self.tuner.abandon(&trial) {
                    Ok((_, change)) => self.take(&change, threads),
                    Err(error) => println!("  refused: {error}"),
                }
            }
            1 => {
                self.now_ms += 40_000;
                let change = self.tuner.expire(self.now_ms);
                self.take(&change, 0);
            }
            2 => self.suggest(true),
            3..22 => self.suggest(false),
            _ => self.report(),
        }
    }
}

fn print_trial(trial: &Trial) {
    let (mode, reason) = (trial.mode(), trial.reason());
    let explanation = &reason.explanation;
    let estimate = (&explanation.epsilon, &explanation.expected_gain, &explanation.expected_frames);
    let budget = (&explanation.budget_left, &explanation.set_aside, &explanation.reference_cost);
    println!(
        "{} {} {} {:?} {} {mode:?} cap {:?} silent {} predicted {:?} cost {:?} {:?} lease {} completion {:?} | {} {} \
         {:?} {estimate:?} {:?} {budget:?} {:?} {:?} | {:?} | {}",
        trial.number,
        trial.client_id,
        trial.state_id,
        trial.state,
        serde_json::to_string(&trial.configuration.to_raw()).expect("plain data"),
        explanation.abort_above,
        explanation.silent,
        trial.predicted_cost,
        trial.cost,
        trial.outcome,
        trial.lease_expire_ms,
        trial.completion,
        reason.source,
        reason.step,
        reason.neighbours,
        explanation.exploring_cost,
        explanation.instead_of,
        trial.late,
        explanation.rule,
        reason.summary,
    );
}

fn main() {
    let policies = policies();
    for (place, (name, policy)) in policies.iter().enumerate() {
        for apart in [false, true] {
            println!("== {name}, plans made apart: {apart}");
            // A frozen, pinned or shadow study has learnt from trials before.
            let begins = if (6..9).contains(&place) { policies[0].1.clone() } else { policy.clone() };
            let mut tuner = Tuner::new(Arc::new(spec(begins))).expect("a valid specification");
            if apart {
                tuner.knowledge_mut().defer_updates();
            }
            let random = ChaCha8Rng::seed_from_u64(fnv::hash(name.bytes()));
            let mut session = Session { tuner, random, now_ms: 0, trials: BTreeMap::new(), apart };
            for event in 0..EVENTS {
                // These policies have no models, so nothing has to be restored.
                match event {
                    100 => assert_eq!(session.tuner.set_policy(policy.clone()), Ok(false)),
                    180 => {
                        let changed = Policy { epsilon: 0.9, trials_per_state: 30, ..policy.clone() };
                        assert_eq!(session.tuner.set_policy(changed), Ok(false));
                    }
                    _ => {}
                }
                session.step();
            }
            for x in [0.0, 0.2, 0.3, 0.4] {
                let indicators = BTreeMap::from([("x".to_owned(), x), ("y".to_owned(), 0.31)]);
                let said = session.tuner.predict(&indicators, machine(2).as_ref()).expect("an answer");
                println!(
                    "predict {x}: {:?} {:?} {:?}",
                    said.configuration, said.predicted_cost, said.insight
                );
                println!("best {x}: {:?}", session.tuner.best(Some(&indicators), None));
            }
            let mut errors = session.tuner.knowledge().predictor_errors();
            errors.sort_by_key(|(predictor, _)| predictor.name());
            println!("{:?} {errors:?}", session.tuner.statistics());
            let learnt = session
                .tuner
                .knowledge()
                .learnt(session.tuner.spec())
                .checkpoint()
                .map_or(0, |learnt| fnv::hash(learnt.bytes));
            println!("learnt {learnt:016x}");
        }
    }
}

//! A tuner that is rebuilt from its rows answers like one that never stopped, after any history.

use std::collections::BTreeMap;
use std::sync::Arc;

use proptest::prelude::*;

use super::tests::{ask, cost, measured, spec, with_levels};
use super::*;
use crate::limits::{CLIENTS_MAX, MACHINES_MAX};
use crate::policy::{Operation, Policy, PredictorMethod, SearchMethod};
use crate::space::EarlierSpaces;
use crate::trial::{Fingerprint, Outcome, RawTrial, Trial, TrialState};

/// The simplest store: rows as text, so that the tests find every loss of serde.
#[derive(Default)]
pub(super) struct Rows {
    trials: BTreeMap<u64, String>,
    states: BTreeMap<u64, String>,
    visits: BTreeMap<String, String>,
}

fn text<T: serde::Serialize>(row: &T) -> String {
    serde_json::to_string(row).expect("rows are plain data")
}

impl Rows {
    pub(super) fn write(&mut self, change: &Change) {
        self.trials.extend(change.trials.iter().map(|trial| (trial.number, text(trial))));
        self.states.extend(change.states.iter().map(|state| (state.id, text(state))));
        change.forgotten.iter().for_each(|client_id| drop(self.visits.remove(client_id)));
        self.visits.extend(change.visits.iter().map(|visit| (visit.client_id.clone(), text(visit))));
    }

    fn trial(&self, tuner: &Tuner, number: u64) -> Trial {
        let raw: RawTrial = serde_json::from_str(&self.trials[&number]).expect("own row");
        raw.check(&tuner.spec().space).expect("a valid configuration")
    }

    /// All trials, the completed ones by rising completion.
    pub(super) fn trials(&self, tuner: &Tuner) -> Vec<Trial> {
        let mut trials: Vec<Trial> = self.trials.keys().map(|&number| self.trial(tuner, number)).collect();
        trials.sort_by_key(|trial| trial.completion);
        trials
    }

    pub(super) fn snapshot(&self, tuner: &Tuner) -> Snapshot {
        let visit = |row: &String| {
            let raw: RawVisit = serde_json::from_str(row).expect("own row");
            let adopted = raw.adopt(&EarlierSpaces::default(), &tuner.spec().space);
            adopted.expect("a valid configuration").expect("inside")
        };
        Snapshot {
            states: self.states.values().map(|row| serde_json::from_str(row).expect("own row")).collect(),
            visits: self.visits.values().map(visit).collect(),
            last_trial: self.trials.keys().next_back().copied().unwrap_or(0),
            models_since: tuner.knowledge.models_since(),
        }
    }

    pub(super) fn restore(&self, tuner: &Tuner, checkpoint: Option<&Checkpoint>) -> Tuner {
        // The specification takes the way through text as well.
        let spec: StudySpec = serde_json::from_str(&text(tuner.spec().as_ref())).expect("own row");
        assert_eq!(&spec, tuner.spec().as_ref());
        let snapshot = self.snapshot(tuner);
        let mut restoring = Restoring::new(Arc::new(spec), snapshot, checkpoint).expect("consistent rows");
        let (completed, open): (Vec<Trial>, Vec<Trial>) = self
            .trials(tuner)
            .into_iter()
            .filter(|trial| matches!(trial.state, TrialState::Open | TrialState::Completed))
            .partition(|trial| trial.state == TrialState::Completed);
        while let Some(trial) = completed.get(restoring.after() as usize) {
            restoring.learn(trial).expect("consistent rows");
        }
        restoring.finish(open).expect("consistent rows")
    }
}

/// One thing that happens to a study.
#[derive(Clone, Debug)]
enum Event {
    Suggest { client: usize, place: usize },
    Report { which: usize, kind: usize },
    Abandon { which: usize },
    Expire { later_ms: i64 },
    Policy { which: usize },
    Save,
    Restart { checkpoint: bool },
}

fn event() -> impl Strategy<Value = Event> {
    prop_oneof![
        8 => (0usize..3, 0usize..6).prop_map(|(client, place)| Event::Suggest { client, place }),
        8 => (0usize..8, 0usize..12).prop_map(|(which, kind)| Event::Report { which, kind }),
        1 => (0usize..8).prop_map(|which| Event::Abandon { which }),
        1 => (0i64..80_000).prop_map(|later_ms| Event::Expire { later_ms }),
        1 => (0usize..10).prop_map(|which| Event::Policy { which }),
        2 => Just(Event::Save),
        2 => any::<bool>().prop_map(|checkpoint| Event::Restart { checkpoint }),
    ]
}

fn policy(which: usize) -> Policy {
    let base = Policy { epsilon: 0.5, trials_per_state: 12, ..Policy::default() };
    match which {
        0 => base,
        1 => Policy { predictor: PredictorMethod::RbfGreedyGq, replicates: 2, ..base },
        2 => Policy { search: SearchMethod::LatinHypercube, lease_s: 5, ..base },
        3 => Policy { epsilon: 0.9, trials_per_state: 6, ..base },
        4 => Policy { regret_budget: Some(0.5), abort_above: Some(1.2), epsilon: 1.0, ..base },
        5 => Policy { weigh_gain: true, epsilon_halves_after: 3, warm_up: 2, ..base },
        6 => Policy { operation: Operation::Freeze, ..base },
        7 => Policy { operation: Operation::Shadow, ..base },
        8 => Policy { predictor: PredictorMethod::Auto, ..base },
        _ => Policy { predictor: PredictorMethod::Contextual, ..base },
    }
}

/// Machines of three groups.
fn machine_of(number: usize) -> Fingerprint {
    let software = BTreeMap::from([("embree".to_owned(), format!("4.{}", number % 3))]);
    Fingerprint { cpu_model: "any".into(), isa: "avx2".into(), threads: number as u32, software }
}

fn outcome(kind: usize, trial: &Trial) -> Outcome {
    match kind {
        0 => Outcome::Infeasible { reason: "depth".into() },
        1 => Outcome::Aborted { lower_bound: cost(trial) * 0.75 },
        2 => Outcome::Failed { reason: "crash".into() },
        _ => Outcome::Ok,
    }
}

/// Answers as a daemon does while nothing else happens.
fn plan_apart(tuner: &mut Tuner, question: &Ask, now_ms: i64) -> Result<(Trial, Change), TunerError> {
    let spec = Arc::clone(tuner.spec());
    if let Some(updates) = tuner.knowledge.deferred_updates() {
        tuner.knowledge.apply_updates(updates.compute(&spec.space));
    }
    let mut plan = None;
    loop {
        match tuner.suggest_step(question, plan, |_| true, now_ms)? {
            DecisionStep::Need(request) => plan = Some(request.compute()),
            DecisionStep::Done(answer) => return Ok(answer),
        }
    }
}

/// Lets `event` happen to one tuner.
fn happen(tuner: &mut Tuner, rows: &mut Rows, event: &Event, now_ms: &mut i64) -> Option<Trial> {
    *now_ms += 100;
    // Reports concern any trial that was ever handed out, the latest ones above all.
    let pick = |rows: &Rows, tuner: &Tuner, which: usize| {
        let number = rows.trials.keys().nth_back(which.min(rows.trials.len().checked_sub(1)?))?;
        Some(tuner.clients.open_trial(*number).cloned().unwrap_or_else(|| rows.trial(tuner, *number)))
    };
    let (answer, change) = match event {
        Event::Suggest { client, place } => {
            let (x, y) = (0.1 * *place as f64, 0.3 + 0.01 * *client as f64);
            let session = rows.trials.len() as u64 / 40;
            // More machines than a study distinguishes, and clients that change theirs.
            let machine = (rows.trials.len() / 8 + 2 * *client) % (MACHINES_MAX + 2);
            let fingerprint = (machine > 0).then(|| machine_of(machine));
            let client_id = format!("client {client}");
            let (can_abort, fidelities) = (*client > 0, *client < 2);
            let space = &tuner.spec().space;
            let at = 1.0 - 0.3 * *client as f64;
            let start = (*client > 0).then(|| space.decode(&vec![at; space.dimension()]).to_raw());
            let question =
                Ask { session, can_abort, fidelities, fingerprint, start, ..ask(&client_id, x, y) };
            let answer = match tuner.knowledge.models.defers {
                true => plan_apart(tuner, &question, *now_ms),
                false => tuner.suggest(&question, *now_ms),
            };
            answer.expect("a valid question")
        }
        Event::Report { which, kind } => {
            let trial = pick(rows, tuner, *which)?;
            let measurements = measured(cost(&trial));
            tuner.report(&trial, measurements, outcome(*kind, &trial), *now_ms).ok()?
        }
        Event::Abandon { which } => tuner.abandon(&pick(rows, tuner, *which)?).ok()?,
        Event::Expire { later_ms } => {
            *now_ms += later_ms;
            rows.write(&tuner.expire(*now_ms));
            return None;
        }
        Event::Policy { which } => {
            if tuner.set_policy(policy(*which)).expect("valid") {
                let defers = tuner.knowledge.models.defers;
                *tuner = rows.restore(tuner, None);
                if defers {
                    tuner.knowledge.defer_updates();
                }
            }
            return None;
        }
        Event::Save | Event::Restart { .. } => return None,
    };
    rows.write(&change);
    Some(answer)
}

/// More clients than a study remembers come and go, one stays, and the daemon starts again now and then.
#[test]
fn clients_are_forgotten_alike_after_a_restart() {
    let fresh = || Tuner::new(Arc::new(spec(policy(0)))).expect("valid");
    let (mut steady, mut steady_rows) = (fresh(), Rows::default());
    let (mut restarted, mut rows) = (fresh(), Rows::default());
    let frame = |tuner: &mut Tuner, rows: &mut Rows, client: &str, round: usize| {
        let question = ask(client, 0.1 * (round % 7) as f64, 0.5);
        let (trial, change) = tuner.suggest(&question, round as i64).expect("there is room");
        rows.write(&change);
        let reported = tuner.report(&trial, measured(cost(&trial)), Outcome::Ok, round as i64).expect("ours");
        rows.write(&reported.1);
        assert!(rows.visits.len() <= CLIENTS_MAX);
        trial
    };
    for round in 0..3 * CLIENTS_MAX {
        for client in ["steady", &format!("passing {}", round * 7919 % (2 * CLIENTS_MAX))] {
            let expected = frame(&mut steady, &mut steady_rows, client, round);
            assert_eq!(frame(&mut restarted, &mut rows, client, round), expected);
        }
        if round % 50 == 49 {
            restarted = rows.restore(&restarted, None);
        }
    }
    assert_eq!(rows.visits, steady_rows.visits);
    assert!(rows.visits.len() == CLIENTS_MAX && rows.visits.contains_key("steady"));
}

/// A client that holds a trial is not forgotten; only where all do is there no room for one more.
#[test]
fn clients_that_hold_trials_are_not_forgotten() {
    let mut tuner = Tuner::new(Arc::new(spec(policy(0)))).expect("valid");
    let mut held = Vec::new();
    for number in 0..CLIENTS_MAX {
        held.push(tuner.suggest(&ask(&format!("{number}"), 0.5, 0.5), 0).expect("there is room").0);
    }
    assert_eq!(tuner.suggest(&ask("late", 0.5, 0.5), 0).unwrap_err(), TunerError::TooManyClients);
    let (_, reported) = tuner.report(&held[7], measured(1.0), Outcome::Ok, 1).expect("it holds the trial");
    drop(reported);
    let (_, change) = tuner.suggest(&ask("late", 0.5, 0.5), 1).expect("there is room again");
    assert_eq!(change.forgotten, ["7"]);
}

/// Clients of a pinned study have no visits, and still hold trials.
#[test]
fn no_more_clients_hold_trials_of_a_pinned_study() {
    let pinned = Some(spec(policy(0)).space.default_configuration());
    let mut tuner = Tuner::new(Arc::new(spec(Policy { pinned, ..policy(0) }))).expect("valid");
    let mut suggest = |client: &str| tuner.suggest(&ask(client, 0.5, 0.5), 0).map(|(trial, _)| trial.number);
    for number in 0..CLIENTS_MAX as u64 {
        assert_eq!(suggest(&number.to_string()), Ok(number + 1));
    }
    assert_eq!(suggest("late"), Err(TunerError::TooManyClients));
    assert_eq!(suggest("7"), Ok(8), "a lost answer is repeated");
}

proptest! {
    #![proptest_config(crate::testing::cases(96))]

    #[test]
    fn a_restored_tuner_gives_the_same_next_answers(
        has_levels: bool, events in prop::collection::vec(event(), 1..160),
    ) {
        let plain = || spec(policy(0));
        let spec = || if has_levels { with_levels(plain()) } else { plain() };
        let fresh = || Tuner::new(Arc::new(spec())).expect("valid");
        let (mut steady, mut steady_rows, mut steady_ms) = (fresh(), Rows::default(), 0);
        let (mut restarted, mut rows, mut now_ms) = (fresh(), Rows::default(), 0);
        let mut saved = None;
        for event in &events {
            let expected = happen(&mut steady, &mut steady_rows, event, &mut steady_ms);
            match event {
                Event::Save => saved = restarted.knowledge.learnt(restarted.spec()).checkpoint().ok(),
                Event::Restart { checkpoint } => {
                    restarted = rows.restore(&restarted, saved.as_ref().filter(|_| *checkpoint));
                }
                _ => {}
            }
            let answer = happen(&mut restarted, &mut rows, event, &mut now_ms);
            prop_assert_eq!(answer, expected);
        }
        prop_assert_eq!(&rows.trials, &steady_rows.trials);
        prop_assert_eq!(&rows.states, &steady_rows.states);
        prop_assert_eq!(&rows.visits, &steady_rows.visits);
        prop_assert_eq!(restarted.statistics(), steady.statistics());
        for place in 0..6 {
            let indicators = ask("z", 0.1 * f64::from(place), 0.31).indicators;
            prop_assert_eq!(restarted.predict(&indicators, None), steady.predict(&indicators, None));
            prop_assert_eq!(restarted.best(Some(&indicators), None), steady.best(Some(&indicators), None));
        }
    }

    #[test]
    fn a_tuner_that_is_planned_for_gives_the_same_answers(events in prop::collection::vec(event(), 1..160)) {
        let fresh = || Tuner::new(Arc::new(with_levels(spec(policy(0))))).expect("valid");
        let (mut here, mut here_rows, mut here_ms) = (fresh(), Rows::default(), 0);
        let (mut apart, mut apart_rows, mut apart_ms) = (fresh(), Rows::default(), 0);
        apart.knowledge.defer_updates();
        for event in &events {
            let expected = happen(&mut here, &mut here_rows, event, &mut here_ms);
            prop_assert_eq!(happen(&mut apart, &mut apart_rows, event, &mut apart_ms), expected);
        }
        prop_assert_eq!(&apart_rows.states, &here_rows.states);
        prop_assert_eq!(&apart_rows.visits, &here_rows.visits);
        let saved = |tuner: &Tuner| tuner.knowledge.learnt(tuner.spec()).checkpoint();
        prop_assert_eq!(saved(&apart), saved(&here));
    }

    #[test]
    fn answers_do_not_depend_on_the_unit_of_the_cost(
        seed: u64, power in -20i32..20, rbf in any::<bool>(), places in prop::collection::vec(0usize..4, 60),
    ) {
        let predictor = if rbf { PredictorMethod::RbfGreedyGq } else { PredictorMethod::NearestNeighbour };
        let policy = Policy { epsilon: 0.5, predictor, trials_per_state: 20, ..Policy::default() };
        let scale = 2f64.powi(power);
        let run = |scale: f64| {
            let mut tuner = Tuner::new(Arc::new(StudySpec { seed, ..spec(policy.clone()) })).expect("valid");
            let mut answers = Vec::new();
            for place in &places {
                for _ in 0..4 {
                    let trial = tuner.suggest(&ask("a", 0.2 * *place as f64, 0.5), 0).expect("valid").0;
                    let report = tuner.report(&trial, measured(scale * cost(&trial)), Outcome::Ok, 1);
                    assert!(report.is_ok());
                    answers.push((trial.mode(), trial.configuration));
                }
            }
            answers
        };
        prop_assert_eq!(run(1.0), run(scale));
    }
}

#[test]
fn rows_that_contradict_each_other_are_refused() {
    let mut tuner = Tuner::new(Arc::new(spec(policy(0)))).expect("valid");
    let (trial, change) = tuner.suggest(&ask("a", 0.5, 0.5), 0).expect("valid");
    let snapshot =
        |last_trial| Snapshot { states: change.states.clone(), visits: vec![], last_trial, models_since: 0 };
    let restore = |snapshot, trial: &Trial| {
        Restoring::of_all(tuner.spec().clone(), snapshot, [trial.clone()]).map(|tuner| tuner.statistics())
    };
    assert_eq!(restore(snapshot(1), &trial).map(|counts| counts.open_trials), Ok(1));
    assert!(restore(snapshot(0), &trial).is_err(), "a trial beyond the last");
    let strange = Trial { state_id: 7, ..trial.clone() };
    assert!(restore(snapshot(1), &strange).is_err(), "a state that does not exist");
    let unordered = Trial { state: TrialState::Completed, ..trial.clone() };
    assert!(restore(snapshot(1), &unordered).is_err(), "a completed trial without its place");
    let gap = Snapshot { states: vec![StateRecord { id: 3, ..change.states[0].clone() }], ..snapshot(1) };
    assert!(restore(gap, &trial).is_err(), "a gap between states");
}

//! The promises of every store, run against each implementation. The memory store is the oracle.

#[macro_use]
mod common;

use common::{ask, change, completed, decided, numbers, open, pages, spec, state, visit};
use treewright_core::configuration::RawConfiguration;
use treewright_core::policy::{Policy, SearchMethod};
use treewright_core::space::{Domain, EarlierSpaces, Parameter, Space};
use treewright_core::study::StudySpec;
use treewright_core::trial::{Mode, Outcome, RawTrial, Trial, TrialState};
use treewright_core::tuner::{Change, Checkpoint, Visit};
use treewright_core::value::Value;
use treewright_store::{Fence, Store, StoreError};

contract!(
    creating_is_idempotent_for_equal_specifications,
    studies_are_listed_by_id,
    everything_comes_back_as_it_was_stored,
    completed_trials_are_read_in_stretches,
    the_latest_checkpoint_comes_back_whole,
    old_trials_go_and_the_counts_stay,
    of_two_changes_in_one_commit_the_last_wins,
    clients_are_forgotten_unless_they_come_back,
    a_completed_trial_is_never_changed,
    a_trial_is_excluded_and_counts_again,
    who_holds_an_open_trial_is_kept,
    a_commit_is_stored_whole_or_not_at_all,
    a_newer_load_breaks_the_fence,
    policies_and_texts_change_and_stay,
    a_changed_space_keeps_trials_as_they_ran,
    deleting_takes_everything_along,
    a_study_that_is_created_again_is_another,
    a_renamed_study_stays_the_same_one,
    who_names_an_identity_never_reaches_a_namesake,
    pages_follow_each_other_in_every_order,
    both_zeros_are_one_place_in_an_order,
    due_leases_are_found,
    unknown_names_are_named,
    a_closed_store_says_so,
);

async fn fence(store: &dyn Store, study: &str) -> Fence {
    store.create_study(study, &spec(), 5).await.expect("stored");
    store.load(study).await.expect("loaded").fence
}

async fn commit(store: &dyn Store, fence: &Fence, changes: &[Change]) -> Result<(), StoreError> {
    store.commit(fence, changes).durable().await
}

async fn creating_is_idempotent_for_equal_specifications(store: &dyn Store) {
    let first = store.create_study("hall", &spec(), 5).await.unwrap();
    assert!(first.is_new);
    assert_eq!(first.study.spec, spec());
    assert_eq!(first.study.create_ms, 5);

    // Texts and policy are not compared, and the stored ones stay.
    let mut renamed = spec();
    renamed.display_name = "Another name".to_owned();
    renamed.note = "Another note".to_owned();
    renamed.policy.epsilon = 0.5;
    let again = store.create_study("hall", &renamed, 9).await.unwrap();
    assert!(!again.is_new);
    assert_eq!(again.study, first.study);

    let mut other = spec();
    other.seed = 8;
    let error = store.create_study("hall", &other, 9).await.unwrap_err();
    let difference = "seed is 7 against 8".to_owned();
    assert_eq!(error, StoreError::StudyExists { study: "hall".to_owned(), difference });
}

async fn studies_are_listed_by_id(store: &dyn Store) {
    for id in ["sponza", "bmw", "hall", "a-1"] {
        store.create_study(id, &spec(), 5).await.unwrap();
    }
    let ids =
        |list: Vec<treewright_store::StudyRecord>| list.into_iter().map(|study| study.id).collect::<Vec<_>>();
    let page = store.list_studies(None, 3).await.unwrap();
    assert_eq!(ids(page), ["a-1", "bmw", "hall"]);
    let page = store.list_studies(Some("hall"), 3).await.unwrap();
    assert_eq!(ids(page), ["sponza"]);
}

async fn everything_comes_back_as_it_was_stored(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let mut default = completed(4, 3, Outcome::Ok);
    default.decision = decided(Mode::Default);
    default.late = true;
    let mut pinned = open(6);
    pinned.decision = decided(Mode::Pinned);
    pinned.state = TrialState::Abandoned;
    let mut exploited = open(7);
    exploited.decision = decided(Mode::Exploit);
    exploited.state = TrialState::Expired;
    exploited.predicted_cost = None;
    exploited.fingerprint = None;
    let reason = || "depth \"limit\" reached".to_owned();
    let trials = vec![
        completed(1, 2, Outcome::Infeasible { reason: reason() }),
        completed(2, 1, Outcome::Failed { reason: reason() }),
        completed(3, 4, Outcome::Aborted { lower_bound: 0.1 }),
        default,
        open(5),
        pinned,
        exploited,
    ];
    let (states, visits) = (vec![state(1), state(2)], vec![visit("a", 3), visit("b", 1)]);
    let stored = Change { trials: trials.clone(), states, visits, forgotten: vec![] };
    commit(store, &held, std::slice::from_ref(&stored)).await.unwrap();

    let space = spec().space;
    for trial in &trials {
        let raw: RawTrial = store.get_trial("hall", trial.number).await.unwrap();
        assert_eq!(&raw.check(&space).expect("valid"), trial);
    }
    let loaded = store.load("hall").await.unwrap();
    assert_eq!(loaded.snapshot.states, stored.states);
    assert_eq!(loaded.snapshot.visits, stored.visits);
    assert_eq!(loaded.snapshot.last_trial, 7);
    assert_eq!(loaded.open_trials, trials[4..5]);
    assert_eq!(loaded.checkpoint, None);
    let completed = store.completed_trials(&loaded.fence, 0, 10).await.unwrap();
    let checked = completed[3].clone().check(&space).expect("valid");
    assert_eq!(checked, trials[2]);

    let statistics = store.get_study("hall").await.unwrap().statistics;
    assert_eq!((statistics.states, statistics.trials), (2, 7));
    assert_eq!((statistics.completed_trials, statistics.open_trials), (4, 1));
}

async fn completed_trials_are_read_in_stretches(store: &dyn Store) {
    let held = fence(store, "hall").await;
    // Completed in another order than they were handed out, with an open one between them.
    let trials = (1..=7).map(|number| completed(number, 8 - number, Outcome::Ok)).chain([open(8)]).collect();
    commit(store, &held, &[change(trials)]).await.unwrap();
    let mut found = Vec::new();
    while let Some(last) = {
        let after = found.len() as u64;
        let stretch = store.completed_trials(&held, after, 3).await.unwrap();
        assert!(stretch.len() <= 3);
        found.extend(stretch.iter().map(|trial| trial.number));
        stretch.last().cloned()
    } {
        assert_eq!(last.completion, Some(found.len() as u64));
    }
    assert_eq!(found, [7, 6, 5, 4, 3, 2, 1]);
    assert_eq!(store.completed_trials(&held, 100, 3).await.unwrap(), []);
}

async fn the_latest_checkpoint_comes_back_whole(store: &dyn Store) {
    let mut held = fence(store, "hall").await;
    // Larger than a part, and not a multiple of one.
    let bytes = |length: usize| (0..length).map(|at| (at % 251) as u8).collect::<Vec<u8>>();
    let long = Checkpoint { completion: 12, bytes: bytes(700_001) };
    let short = Checkpoint { completion: 40, bytes: bytes(3) };
    for checkpoint in [&long, &short, &short] {
        store.save_checkpoint(&held, checkpoint).await.unwrap();
        assert!(held.holds());
        let other = store.load("hall").await.unwrap();
        assert_eq!(other.checkpoint.as_ref(), Some(checkpoint));
        // A replica that has lost the study cannot save any more.
        let error = store.save_checkpoint(&held, checkpoint).await.unwrap_err();
        assert!(matches!(error, StoreError::Fenced { .. }), "{error}");
        held = other.fence;
    }
    // It goes with its study.
    store.delete_study("hall", None).await.unwrap();
    fence(store, "hall").await;
    assert_eq!(store.load("hall").await.unwrap().checkpoint, None);
}

async fn old_trials_go_and_the_counts_stay(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let mut trials: Vec<_> = (1..=9).map(|number| completed(number, number, Outcome::Ok)).collect();
    // One that was given back, one that ran out and was reported late, and two that are open.
    trials[2] = Trial { state: TrialState::Abandoned, ..open(3) };
    trials[4] = completed(5, 10, Outcome::Ok);
    trials[6] = open(7);
    for (trial, completion) in trials.iter_mut().filter(|trial| trial.completion.is_some()).zip(1..) {
        trial.completion = Some(completion);
    }
    trials.push(open(10));
    commit(store, &held, &[change(trials)]).await.unwrap();
    let before = store.get_study("hall").await.unwrap().statistics;

    let closed = |after, up_to, size| store.closed_trials(&held, after, up_to, size);
    let all = closed(0, 100, 100).await.unwrap();
    let pairs: Vec<_> = all.iter().map(|trial| (trial.number, trial.completion)).collect();
    let expected = [(1, 1), (2, 2), (3, 0), (4, 3), (5, 4), (6, 5), (8, 6), (9, 7)];
    assert_eq!(pairs, expected.map(|(number, at)| (number, Some(at).filter(|at| *at > 0))));
    assert_eq!(closed(2, 6, 3).await.unwrap(), all[2..5]);
    assert_eq!(closed(9, 3, 3).await.unwrap(), []);

    // Numbers that are open, unknown or completed too late are skipped; all other trials stay unchanged.
    assert_eq!(store.remove_trials(&held, &[1, 2, 3, 5, 6, 7, 99], 4).await.unwrap(), 4);
    assert_eq!(store.remove_trials(&held, &[], 4).await.unwrap(), 0);
    assert_eq!(numbers(store, "").await, [4, 6, 7, 8, 9, 10]);
    assert_eq!(store.get_study("hall").await.unwrap().statistics, before);
    let error = store.get_trial("hall", 1).await.unwrap_err();
    assert!(matches!(error, StoreError::TrialNotFound { number: 1, .. }), "{error}");
    let stretch = store.completed_trials(&held, 0, 2).await.unwrap();
    assert_eq!(stretch.iter().map(|trial| trial.completion).collect::<Vec<_>>(), [Some(3), Some(5)]);
    let loaded = store.load("hall").await.unwrap();
    assert_eq!((loaded.snapshot.last_trial, loaded.open_trials.len()), (10, 2));

    // A replica that has lost the study removes nothing, and a failure does not break the fence.
    let error = store.remove_trials(&held, &[4], 4).await.unwrap_err();
    assert!(matches!(error, StoreError::Fenced { .. }), "{error}");
    assert_eq!(numbers(store, "").await.len(), 6);
    assert!(loaded.fence.holds());
    // A number that went can be written again, as by a report that comes very late.
    commit(store, &loaded.fence, &[change(vec![completed(3, 8, Outcome::Ok)])]).await.unwrap();
    assert_eq!(numbers(store, "").await, [3, 4, 6, 7, 8, 9, 10]);
}

async fn of_two_changes_in_one_commit_the_last_wins(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let changes = [change(vec![open(1)]), change(vec![completed(1, 1, Outcome::Ok), open(2)])];
    commit(store, &held, &changes).await.unwrap();
    assert_eq!(numbers(store, "state = COMPLETED").await, [1]);
    assert_eq!(numbers(store, "state = OPEN").await, [2]);
}

async fn clients_are_forgotten_unless_they_come_back(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let visits = vec![visit("a", 3), visit("b", 1), visit("c", 2)];
    commit(store, &held, &[Change { states: vec![state(1)], visits, ..Change::default() }]).await.unwrap();
    let forget = |client: &str| Change { forgotten: vec![client.to_owned()], ..Change::default() };
    let comes = |client: &str, number| Change { visits: vec![visit(client, number)], ..Change::default() };
    // Not waiting between them, so that they may share a transaction.
    let commits = [
        vec![forget("a"), forget("never seen")],
        vec![comes("d", 1), forget("b"), comes("b", 7)],
        vec![forget("d"), comes("e", 1)],
        vec![comes("d", 2)],
    ];
    let receipts: Vec<_> = commits.iter().map(|changes| store.commit(&held, changes)).collect();
    for receipt in receipts {
        receipt.durable().await.unwrap();
    }
    let visits = store.load("hall").await.unwrap().snapshot.visits;
    let known: Vec<_> = visits.iter().map(|visit| (visit.client_id.as_str(), visit.number)).collect();
    assert_eq!(known, [("b", 7), ("c", 2), ("d", 2), ("e", 1)]);
}

async fn a_completed_trial_is_never_changed(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let original = completed(1, 1, Outcome::Ok);
    commit(store, &held, &[change(vec![original.clone()])]).await.unwrap();
    let mut forged = original.clone();
    forged.measurements.insert("render_ms".to_owned(), 0.0);
    let error = commit(store, &held, &[change(vec![forged])]).await.unwrap_err();
    assert!(matches!(error, StoreError::Inconsistent { .. }), "{error}");
    assert!(error.to_string().contains("never changed"), "{error}");
    assert!(error.to_string().contains("in study \"hall\""), "{error}");
    let raw = store.get_trial("hall", 1).await.unwrap();
    assert_eq!(raw.check(&spec().space).unwrap(), original);
    // The holder's later changes rest on one that was refused.
    assert!(!held.holds());
    let error = commit(store, &held, &[change(vec![open(2)])]).await.unwrap_err();
    assert!(matches!(error, StoreError::Fenced { .. }));
}

/// Its data stays as it was.
async fn a_trial_is_excluded_and_counts_again(store: &dyn Store) {
    store.create_study("hall", &spec(), 5).await.expect("created");
    let held = store.load("hall").await.expect("loaded").fence;
    let trials = vec![completed(1, 1, Outcome::Ok), completed(2, 2, Outcome::Ok), open(3)];
    store.commit(&held, &[change(trials)]).durable().await.expect("stored");
    let checkpoint = Checkpoint { completion: 2, bytes: vec![7; 9] };
    store.save_checkpoint(&held, &checkpoint).await.expect("saved");

    let before = store.get_trial("hall", 1).await.expect("there");
    let reason = "it's \"odd\" ä";
    store.exclude_trial(&held, 1, Some(reason)).durable().await.expect("excluded");
    let after = RawTrial { exclusion: Some(reason.to_owned()), ..before.clone() };
    assert_eq!(store.get_trial("hall", 1).await.expect("there"), after);
    assert_eq!(store.completed_trials(&held, 0, 9).await.expect("a stretch")[0], after);
    assert_eq!(numbers(store, "excluded = true").await, [1]);
    assert_eq!(numbers(store, "excluded != true").await, [2, 3]);
    assert_eq!(numbers(store, "state = COMPLETED AND excluded = false").await, [2]);
    let loaded = store.load("hall").await.expect("loaded");
    assert_eq!((loaded.checkpoint, loaded.study.statistics.completed_trials), (None, 2));

    let other = change(vec![completed(1, 1, Outcome::failed("something else"))]);
    store.commit(&loaded.fence, &[other]).durable().await.expect_err("it is as final as ever");
    let held = store.load("hall").await.expect("loaded").fence;
    store.exclude_trial(&held, 1, None).durable().await.expect("included");
    assert_eq!(store.get_trial("hall", 1).await.expect("there"), before);

    for number in [3, 99] {
        let held = store.load("hall").await.expect("loaded").fence;
        store.exclude_trial(&held, number, Some("?")).durable().await.expect_err("it has no result");
        assert!(!held.holds());
    }
    store.exclude_trial(&held, 2, Some("?")).durable().await.expect_err("the study was loaded since");
    assert_eq!(numbers(store, "excluded = true").await, [0; 0]);
}

async fn who_holds_an_open_trial_is_kept(store: &dyn Store) {
    let held = fence(store, "hall").await;
    commit(store, &held, &[change(vec![open(1)])]).await.unwrap();
    let mut renewed = Trial { lease_expire_ms: 90_000, ..open(1) };
    (renewed.decision.session, renewed.decision.heartbeat) = (7, true);
    commit(store, &held, &[change(vec![renewed.clone()])]).await.unwrap();
    assert_eq!(store.load("hall").await.unwrap().open_trials, [renewed]);
}

async fn a_commit_is_stored_whole_or_not_at_all(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let other = fence(store, "sponza").await;
    commit(store, &held, &[change(vec![completed(1, 1, Outcome::Ok)])]).await.unwrap();
    // Queued together, so that they share a transaction where a store groups its writes.
    let good = store.commit(&other, &[change(vec![open(1)])]);
    let bad = store.commit(&held, &[change(vec![open(2)]), change(vec![open(1)])]);
    let late = store.commit(&held, &[change(vec![open(3)])]);
    let also_good = store.commit(&other, &[change(vec![open(2)])]);
    assert_eq!(good.durable().await, Ok(()));
    assert!(bad.durable().await.is_err());
    assert!(matches!(late.durable().await, Err(StoreError::Fenced { .. })));
    assert_eq!(also_good.durable().await, Ok(()));
    assert_eq!(numbers(store, "").await, [1]);
    assert_eq!(store.get_study("sponza").await.unwrap().statistics.trials, 2);
}

async fn a_newer_load_breaks_the_fence(store: &dyn Store) {
    let old = fence(store, "hall").await;
    let before = store.commit(&old, &[change(vec![open(1)])]);
    let loaded = store.load("hall").await.unwrap();
    // The load includes changes that were queued before it.
    assert_eq!(before.durable().await, Ok(()));
    assert_eq!(loaded.snapshot.last_trial, 1);
    assert!(!old.holds());
    assert!(loaded.fence.holds());
    let refused = commit(store, &old, &[]).await;
    assert!(matches!(refused, Err(StoreError::Fenced { .. })));
    assert_eq!(commit(store, &loaded.fence, &[]).await, Ok(()));
}

async fn policies_and_texts_change_and_stay(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let (search, pinned) = (SearchMethod::Random, Some(open(1).configuration));
    let policy = Policy { epsilon: 1.0, search, pinned, ..Policy::default() };
    let (note, tags) = ("loud \"fan\"\n\tat 80 °C".to_owned(), ["gpu", "層"].map(str::to_owned).into());
    let changed = StudySpec { display_name: "An attic".to_owned(), note, tags, policy, ..spec() };
    store.update_study(&held, &changed, &EarlierSpaces::default(), 3).durable().await.unwrap();
    assert!(held.holds());
    let stored = store.get_study("hall").await.unwrap();
    assert_eq!((&stored.spec, stored.spec.first_difference(&spec())), (&changed, None));
    assert_eq!(store.load("hall").await.unwrap().snapshot.models_since, 3);
}

async fn a_changed_space_keeps_trials_as_they_ran(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let trials = vec![completed(1, 1, Outcome::Ok), open(2)];
    let visits = vec![Visit { since: 1, ..visit("renderer", 1) }];
    commit(store, &held, &[Change { visits, ..change(trials) }]).await.unwrap();
    store.save_checkpoint(&held, &Checkpoint { completion: 1, bytes: vec![7; 9] }).await.unwrap();
    // All trials had `compact` switched on, which goes, and none had `wide`.
    let (before, none) = (spec(), RawConfiguration::new());
    let wide = Parameter::new("wide", Domain::Boolean, false);
    let parameters = before.space.parameters().iter().filter(|one| one.name != "compact").cloned();
    let space = Space::new(parameters.chain([wide]).collect(), Vec::new()).unwrap();
    let changed = StudySpec { space, ..before.clone() };
    let on = RawConfiguration::from([("compact".to_owned(), Value::Boolean(true))]);
    let earlier = |fixed| EarlierSpaces::default().changed(&before.space, &changed.space, 2, fixed).unwrap();
    store.change_space(&held, &changed, &earlier(on.clone())).durable().await.unwrap();
    let stored = store.get_study("hall").await.unwrap();
    assert_eq!((&stored.spec, &stored.earlier), (&changed, &earlier(on)));
    assert_eq!((stored.revision_of(&before), stored.revision_of(&changed)), (Ok(1), Ok(2)));
    assert!(!store.create_study("hall", &before, 9).await.unwrap().is_new);
    assert!(store.create_study("hall", &StudySpec { seed: 8, ..before.clone() }, 9).await.is_err());
    let loaded = store.load("hall").await.unwrap();
    let Trial { configuration, decision, .. } = loaded.open_trials[0].clone();
    assert!(changed.space.owns(&configuration) && loaded.checkpoint.is_none());
    assert_eq!(decision.mode(), Mode::Pinned, "it is read as wanted");
    assert_eq!(loaded.snapshot.visits.len(), 1);
    let late = Trial { configuration, decision, ..completed(2, 2, Outcome::Ok) };
    commit(store, &loaded.fence, &[change(vec![late])]).await.unwrap();
    for trial in store.completed_trials(&loaded.fence, 0, 9).await.unwrap() {
        assert_eq!(trial.configuration, open(1).configuration.to_raw(), "trial {}", trial.number);
        assert_eq!(trial.decision, open(1).decision, "trial {}", trial.number);
    }
    store.change_space(&loaded.fence, &changed, &earlier(none)).durable().await.unwrap();
    assert!(store.load("hall").await.unwrap().snapshot.visits.is_empty());
}

async fn deleting_takes_everything_along(store: &dyn Store) {
    let held = fence(store, "hall").await;
    commit(store, &held, &[change(vec![completed(1, 1, Outcome::Ok)])]).await.unwrap();
    store.delete_study("hall", None).await.unwrap();
    assert!(!held.holds());
    assert!(matches!(store.delete_study("hall", None).await, Err(StoreError::StudyNotFound { .. })));
    let new_fence = fence(store, "hall").await;
    // A change to the deleted study does not reach its namesake.
    assert!(commit(store, &held, &[change(vec![open(1)])]).await.is_err());
    assert_eq!(numbers(store, "").await, [0; 0]);
    assert_eq!(commit(store, &new_fence, &[change(vec![open(1)])]).await, Ok(()));
}

/// Hands out and completes trials up to a number.
async fn trials_up_to(store: &dyn Store, study: &str, last: u64) -> Fence {
    let fence = fence(store, study).await;
    let first = store.get_study(study).await.unwrap().last_trial + 1;
    for number in first..=last {
        let trial = completed(number, number - first + 1, Outcome::Ok);
        commit(store, &fence, &[change(vec![trial])]).await.unwrap();
    }
    fence
}

async fn a_study_that_is_created_again_is_another(store: &dyn Store) {
    let old = trials_up_to(store, "hall", 3).await;
    let before = store.get_study("hall").await.unwrap();
    assert_eq!((before.named_after, before.last_trial, before.statistics.trials), (0, 3, 3));
    assert_eq!(store.create_study("hall", &spec(), 9).await.unwrap().study.uid, before.uid);
    assert_eq!(store.find_study(before.uid).await.unwrap().as_deref(), Some("hall"));
    store.delete_study("hall", None).await.unwrap();
    assert_eq!(store.find_study(before.uid).await.unwrap(), None);
    assert!(!old.holds());

    let after = store.create_study("hall", &spec(), 9).await.unwrap().study;
    assert_ne!(after.uid, before.uid);
    assert_eq!((after.named_after, after.last_trial, after.statistics.trials), (3, 3, 0));
    assert_eq!(store.load("hall").await.unwrap().snapshot.last_trial, 3);
    trials_up_to(store, "hall", 5).await;
    assert_eq!(store.get_study("hall").await.unwrap().statistics.trials, 2);
    assert_eq!(numbers(store, "").await, [4, 5]);
    // A second deletion changes nothing, and neither do other names.
    store.delete_study("hall", None).await.unwrap();
    assert_eq!(store.create_study("hall", &spec(), 9).await.unwrap().study.last_trial, 5);
    assert_eq!(store.create_study("attic", &spec(), 9).await.unwrap().study.last_trial, 0);
}

async fn a_renamed_study_stays_the_same_one(store: &dyn Store) {
    trials_up_to(store, "hall", 5).await;
    store.delete_study("hall", None).await.unwrap();
    let old = trials_up_to(store, "attic", 2).await;
    let before = store.get_study("attic").await.unwrap();
    let missing = store.rename_study("none", None, "other").await;
    assert_eq!(missing, Err(StoreError::StudyNotFound("none".to_owned())));
    let taken = |study: &str| Err(StoreError::NameTaken(study.to_owned()));
    store.create_study("cellar", &spec(), 5).await.unwrap();
    assert_eq!(store.rename_study("attic", None, "cellar").await, taken("cellar"));
    assert!(old.holds(), "nothing happened to it");
    assert_eq!(store.rename_study("attic", None, "attic").await.unwrap(), before);

    // The name was another study's, which has handed out five trials.
    let renamed = store.rename_study("attic", None, "hall").await.unwrap();
    assert_eq!((renamed.id.as_str(), renamed.uid), ("hall", before.uid));
    assert_eq!((renamed.named_after, renamed.last_trial, renamed.statistics), (5, 5, before.statistics));
    assert_eq!(store.find_study(before.uid).await.unwrap().as_deref(), Some("hall"));
    assert!(!old.holds());
    assert!(store.get_study("attic").await.is_err());
    assert_eq!(numbers(store, "").await, [1, 2], "its trials stay");
    let fence = store.load("hall").await.unwrap().fence;
    let next = change(vec![completed(6, 3, Outcome::Ok)]);
    commit(store, &fence, &[next]).await.unwrap();
    assert_eq!(store.get_study("hall").await.unwrap().statistics.trials, 3);
    // A new study under its old name begins after it, and so does one under the new name.
    assert_eq!(store.create_study("attic", &spec(), 9).await.unwrap().study.last_trial, 2);
    let back = store.rename_study("hall", None, "loft").await.unwrap();
    assert_eq!((back.named_after, back.last_trial, back.statistics.trials), (6, 6, 3));
    assert_eq!(store.create_study("hall", &spec(), 9).await.unwrap().study.last_trial, 6);
}

/// The study was found under a name, and lost it before the act.
async fn who_names_an_identity_never_reaches_a_namesake(store: &dyn Store) {
    let meant = store.create_study("hall", &spec(), 5).await.unwrap().study.uid;
    store.rename_study("hall", Some(meant), "attic").await.unwrap();
    let namesake = store.create_study("hall", &spec(), 5).await.unwrap().study;
    let held = fence(store, "hall").await;
    let missing = StoreError::StudyNotFound("hall".to_owned());
    assert_eq!(store.delete_study("hall", Some(meant)).await, Err(missing.clone()));
    for to in ["loft", "hall"] {
        assert_eq!(store.rename_study("hall", Some(meant), to).await, Err(missing.clone()));
    }
    assert!(held.holds(), "nothing happened to it");
    assert_eq!(store.get_study("hall").await.unwrap(), namesake);
    store.delete_study("attic", Some(meant)).await.unwrap();
    store.delete_study("hall", Some(namesake.uid)).await.unwrap();
    assert!(!held.holds());
    assert!(store.list_studies(None, 9).await.unwrap().is_empty());
}

async fn pages_follow_each_other_in_every_order(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let mut trials = vec![open(1)];
    for (completion, number) in (2..=9_u64).enumerate() {
        let mut trial = completed(number, completion as u64 + 1, Outcome::Ok);
        // Ties, so that the number has to break them.
        trial.cost = Some((number % 3) as f64 * 0.1);
        trials.push(trial);
    }
    commit(store, &held, &[change(trials)]).await.unwrap();
    for (order, expected) in [
        ("number", [1, 2, 3, 4, 5, 6, 7, 8, 9]),
        ("number desc", [9, 8, 7, 6, 5, 4, 3, 2, 1]),
        ("cost", [3, 6, 9, 4, 7, 2, 5, 8, 1]),
        ("cost desc", [2, 5, 8, 4, 7, 3, 6, 9, 1]),
        ("measurement.render_ms desc", [9, 8, 7, 6, 5, 4, 3, 2, 1]),
        ("measurement.absent", [1, 2, 3, 4, 5, 6, 7, 8, 9]),
    ] {
        for size in [1, 2, 4, 9, 20] {
            let found = pages(store, "hall", ask("", order, size)).await;
            assert!(found.iter().all(|page| page.len() <= size as usize));
            assert_eq!(found.concat(), expected, "{order}, {size} to a page");
        }
    }
}

async fn both_zeros_are_one_place_in_an_order(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let mut trials = Vec::new();
    for (number, measured) in [(1, 0.0), (2, -0.0), (3, 0.0)] {
        let mut trial = completed(number, number, Outcome::Ok);
        trial.measurements.insert("render_ms".to_owned(), measured);
        trials.push(trial);
    }
    commit(store, &held, &[change(trials)]).await.unwrap();
    for order in ["measurement.render_ms", "measurement.render_ms desc"] {
        let found = pages(store, "hall", ask("", order, 1)).await;
        assert_eq!(found.concat(), [1, 2, 3], "{order}");
    }
}

async fn due_leases_are_found(store: &dyn Store) {
    let held = fence(store, "hall").await;
    store.create_study("empty", &spec(), 5).await.unwrap();
    commit(store, &held, &[change(vec![open(1)])]).await.unwrap();
    let due = |now_ms| store.studies_with_due_leases(now_ms);
    assert_eq!(due(60_000).await.unwrap(), [""; 0]);
    assert_eq!(due(60_001).await.unwrap(), ["hall"]);
    commit(store, &held, &[change(vec![completed(1, 1, Outcome::Ok)])]).await.unwrap();
    assert_eq!(due(60_001).await.unwrap(), [""; 0]);
}

async fn unknown_names_are_named(store: &dyn Store) {
    let error = store.get_study("hal").await.unwrap_err();
    assert_eq!(error.to_string(), "study \"hal\" does not exist");
    assert_eq!(store.load("hal").await.unwrap_err(), error);
    assert_eq!(store.get_trial("hal", 1).await.unwrap_err(), error);
    let query = ask("", "", 1);
    assert_eq!(store.query_trials("hal", &query).await.unwrap_err(), error);
    store.create_study("hall", &spec(), 5).await.unwrap();
    for number in [1, u64::MAX] {
        let missing = store.get_trial("hall", number).await.unwrap_err();
        assert_eq!(missing, StoreError::TrialNotFound { study: "hall".to_owned(), number });
    }
}

async fn a_closed_store_says_so(store: &dyn Store) {
    let held = fence(store, "hall").await;
    let last = store.commit(&held, &[change(vec![open(1)])]);
    store.close().await;
    // A change that was queued before is stored.
    assert_eq!(last.durable().await, Ok(()));
    assert_eq!(store.get_study("hall").await, Err(StoreError::Closed));
    let refused = store.commit(&held, &[change(vec![open(2)])]);
    assert!(refused.durable().await.is_err());
    store.close().await;
}

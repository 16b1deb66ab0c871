//! In every store a completed trial is excluded and counts again, and its data stays as it was.

#[macro_use]
mod common;

use common::{change, completed, numbers, open, spec};
use treewright_core::trial::{Outcome, RawTrial};
use treewright_core::tuner::Checkpoint;
use treewright_store::Store;

contract!(a_trial_is_excluded_and_counts_again);

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

//! The per-frame loop that never waits. Its calls are plain functions, so that a test of them cannot wait for
//! anything.

use std::time::Duration;

use treewright_client::{Client, ClientError, Finished, Outcome, PrefetchingTuner, Source, Suggestion};
use treewright_proto::v1::TrialState;

use crate::support::{Fake, Hold, finish, in_episodes, measured, spec, state, until};

async fn tuner(client: &Client) -> PrefetchingTuner {
    client.study("scene", spec()).await.unwrap().prefetching_tuner()
}

/// Frames until one has a trial; the first of them hands in the result.
async fn with_trial(tuner: &mut PrefetchingTuner, number: u32, mut previous: Option<Finished>) -> Suggestion {
    loop {
        let suggestion = tuner.next(&state(number), previous.take());
        if suggestion.source() == Source::Daemon {
            return suggestion;
        }
        assert!(matches!(suggestion.problem(), Some(ClientError::NotYet { .. })), "{suggestion:?}");
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
}

#[tokio::test]
async fn each_frame_runs_what_was_asked_for_in_the_frame_before() {
    let (fake, client) = Fake::with_client();
    let mut tuner = tuner(&client).await;
    let first = tuner.next(&state(1), None);
    assert_eq!(first.source(), Source::Default);
    assert!(matches!(first.problem(), Some(ClientError::NotYet { .. })));
    let mut previous = finish(first, 1.0);
    for frame in 1..=20 {
        let suggestion = with_trial(&mut tuner, 1, previous.take()).await;
        assert_eq!(suggestion.trial(), Some(format!("studies/scene/trials/{frame}").as_str()));
        previous = finish(suggestion, f64::from(frame));
    }
    drop((previous, tuner));
    client.flush(Duration::from_secs(20)).await.unwrap();
    let (stats, book) = (client.stats(), fake.book());
    assert_eq!(book.in_state(TrialState::Completed), 20, "and the one that was asked for last is given back");
    assert_eq!((stats.acknowledged, stats.abandoned, stats.resent), (20, 1, 0));
}

#[tokio::test]
async fn a_hanging_daemon_keeps_no_frame_waiting_and_loses_no_report() {
    let (fake, client) = Fake::with_client();
    let mut tuner = tuner(&client).await;
    let first = with_trial(&mut tuner, 1, None).await;
    fake.hold(Hold::Everything);
    let mut previous = finish(first, 1.0);
    for _frame in 0..1000 {
        let suggestion = tuner.next(&state(1), previous.take());
        assert!(suggestion.trial().is_none_or(|trial| trial == "studies/scene/trials/2"));
        previous = finish(suggestion, 2.0);
    }
    fake.hold(Hold::Nothing);
    drop((previous, tuner));
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    assert_eq!(book.stored_reports[0], "studies/scene/trials/1");
    assert_eq!(book.in_state(TrialState::Open), 0, "{:?}", book.trials);
}

#[tokio::test]
async fn who_would_rather_wait_gets_a_trial_in_every_frame() {
    let (fake, client) = Fake::with_client();
    let mut tuner = tuner(&client).await;
    let (wait, mut previous) = (Duration::from_secs(60), None);
    for frame in 1..=20 {
        assert!(tuner.wait(&state(1), wait).await);
        let suggestion = tuner.next(&state(1), previous.take());
        assert_eq!(suggestion.trial(), Some(format!("studies/scene/trials/{frame}").as_str()));
        previous = finish(suggestion, f64::from(frame));
    }
    let (seen, next) = (state(1), state(1));
    // One that is slow for a while loses nothing.
    fake.hold(Hold::Suggestions);
    while tuner.wait(&state(1), Duration::ZERO).await {
        previous = finish(tuner.next(&state(1), previous.take()), 1.0);
    }
    assert!(!tuner.wait(&state(1), Duration::from_millis(50)).await, "patience has an end");
    let (waited, ()) = tokio::join!(tuner.wait(&seen, wait), async {
        tokio::time::sleep(Duration::from_millis(300)).await;
        fake.hold(Hold::Nothing);
    });
    assert!(waited);
    let suggestion = tuner.next(&state(1), previous.take());
    assert_eq!(suggestion.source(), Source::Daemon);
    // Nor does one that is started again.
    previous = finish(suggestion, 2.0);
    let mut fake = fake;
    fake.go_away();
    let (waited, ()) = tokio::join!(tuner.wait(&next, wait), async {
        tokio::time::sleep(Duration::from_millis(300)).await;
        fake.come_back();
    });
    assert!(waited);
    assert_eq!(tuner.next(&state(1), previous.take()).source(), Source::Daemon);
    drop(tuner);
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().in_state(TrialState::Open), 0, "{:?}", fake.book().trials);
}

#[tokio::test]
async fn a_trial_of_another_state_is_given_back() {
    let (fake, client) = Fake::with_client();
    let mut tuner = tuner(&client).await;
    let here = with_trial(&mut tuner, 1, None).await;
    let moved = tuner.next(&state(3), finish(here, 1.0));
    assert_eq!((moved.source(), moved.trial()), (Source::Default, None));
    let there = with_trial(&mut tuner, 3, None).await;
    let mut previous = finish(there, 2.0);
    loop {
        let foreseen = tuner.next_before(&state(3), &state(5), previous.take());
        let is_asked = foreseen.trial().is_some();
        drop(foreseen);
        if is_asked {
            break;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    until("the answer", || fake.book().count("streamed Suggest") >= 5).await;
    assert_eq!(fake.book().trials[4].indicators["triangles"], 1e5, "asked for before its frame");
    drop(with_trial(&mut tuner, 5, None).await);
    drop(tuner);
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().stored_reports, ["studies/scene/trials/1", "studies/scene/trials/3"]);
    assert_eq!(fake.book().in_state(TrialState::Open), 0);
}

#[tokio::test]
async fn wrong_indicators_are_told() {
    let (_fake, client) = Fake::with_client();
    let mut tuner = tuner(&client).await;
    let wrong = tuner.next(&treewright_client::Indicators::new(), None);
    assert!(matches!(wrong.problem(), Some(ClientError::Invalid { .. })));
}

#[tokio::test]
async fn the_next_trial_is_asked_for_with_the_last_frame_of_one() {
    let (fake, client) = Fake::with_client();
    let mut tuner = client.study("scene", in_episodes(3)).await.unwrap().prefetching_tuner();
    let first = with_trial(&mut tuner, 1, None).await;
    let second = tuner.next(&state(1), finish(first, 1.0));
    assert_eq!(second.trial(), Some("studies/scene/trials/1"));
    assert_eq!(fake.book().trials.len(), 1);
    let third = tuner.next(&state(1), finish(second, 1.0));
    assert_eq!(third.trial(), Some("studies/scene/trials/1"));
    until("the next one is asked for", || fake.book().trials.len() == 2).await;
    let next = with_trial(&mut tuner, 1, finish(third, 4.0)).await;
    assert_eq!(next.trial(), Some("studies/scene/trials/2"));
    drop((next, tuner));
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    assert_eq!(book.stored_reports, ["studies/scene/trials/1"]);
    assert_eq!(book.trials[0].measurements.get("render_ms"), Some(&2.0));
}

#[tokio::test]
async fn between_the_frames_of_a_trial_there_is_nothing_to_wait_for() {
    let (fake, client) = Fake::with_client();
    let mut tuner = client.study("scene", in_episodes(3)).await.unwrap().prefetching_tuner();
    let wait = Duration::from_secs(60);
    assert!(tuner.wait(&state(1), wait).await);
    let previous = finish(tuner.next(&state(1), None), 1.0);
    assert!(tuner.wait(&state(1), wait).await);
    assert_eq!(fake.book().trials.len(), 1, "the next one is needed two frames later");
    let second = tuner.next(&state(1), previous);
    assert_eq!(second.trial(), Some("studies/scene/trials/1"));
    // A trial that ends early leaves nothing.
    let previous = Some(second.finished(measured(1.0), Outcome::failed("the device is lost")).unwrap());
    assert!(tuner.wait(&state(1), wait).await);
    let next = tuner.next(&state(1), previous);
    assert_eq!(next.trial(), Some("studies/scene/trials/2"));
    drop((next, tuner));
    client.flush(Duration::from_secs(20)).await.unwrap();
}

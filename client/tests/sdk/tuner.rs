//! The per-frame loop: one round trip a frame, and the reports that a broken stream leaves behind.

use std::time::{Duration, SystemTime};

use treewright_client::{Client, Options, Outcome, Source, Status, StudySpec, Suggestion, Tuner};
use treewright_proto::convert::outcome_to_wire;
use treewright_proto::v1::TrialState;

use crate::support::{self, Fake, Hold, finish, hasty, in_episodes, measured, patient, spec, state, until};

/// The stand-in with a study and the loop over its frames.
async fn with_tuner(spec: StudySpec, options: Options) -> (Fake, Client, Tuner) {
    let fake = Fake::start();
    let client = Client::connect(&fake.url(), options).unwrap();
    let tuner = client.study("scene", spec).await.unwrap().tuner();
    (fake, client, tuner)
}

/// Asks until the daemon answers again.
async fn from_the_daemon(tuner: &mut Tuner, number: u32) -> Suggestion {
    support::from_the_daemon(async || tuner.next(&state(number), None).await).await
}

#[tokio::test]
async fn a_frame_is_one_round_trip() {
    let (fake, client, mut tuner) = with_tuner(spec(), patient()).await;
    let mut previous = None;
    for frame in 1..=20 {
        let suggestion = tuner.next(&state(1), previous.take()).await;
        assert_eq!(suggestion.trial(), Some(format!("studies/scene/trials/{frame}").as_str()));
        previous = finish(suggestion, f64::from(frame));
    }
    drop(previous);
    drop(tuner);
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    assert_eq!((book.count("Tune"), book.count("Suggest"), book.count("Report")), (1, 0, 1));
    assert_eq!((book.count("streamed Suggest"), book.count("streamed Report")), (20, 19));
    assert_eq!(book.in_state(TrialState::Completed), 20);
    assert_eq!((client.stats().acknowledged, client.stats().resent, client.stats().fallbacks), (20, 0, 0));
}

#[tokio::test]
async fn a_broken_stream_is_opened_again_and_loses_no_report() {
    let (fake, client, mut tuner) = with_tuner(spec(), patient()).await;
    let first = tuner.next(&state(1), None).await;
    // The report is stored, but the stream breaks before that is acknowledged.
    fake.book().break_streams = 1;
    let fallback = tuner.next(&state(1), finish(first, 1.0)).await;
    assert_eq!(fallback.source(), Source::LastGood);
    assert!(fallback.problem().is_some_and(treewright_client::ClientError::is_unreachable));
    let second = from_the_daemon(&mut tuner, 1).await;
    assert_eq!(second.trial(), Some("studies/scene/trials/2"));
    client.flush(Duration::from_secs(20)).await.unwrap();
    let stats = client.stats();
    assert_eq!((stats.acknowledged, stats.resent, stats.duplicates), (1, 1, 1));
    assert_eq!(fake.book().stored_reports, ["studies/scene/trials/1"]);
    assert_eq!(fake.book().count("Tune"), 2);
}

#[tokio::test]
async fn a_daemon_that_dies_between_frames_loses_no_report() {
    let (mut fake, client, mut tuner) = with_tuner(spec(), patient()).await;
    let first = tuner.next(&state(1), None).await;
    fake.go_away();
    let mut previous = finish(first, 1.0);
    for _frame in 0..50 {
        let suggestion = tuner.next(&state(1), previous.take()).await;
        assert_eq!(suggestion.source(), Source::LastGood);
        previous = finish(suggestion, 2.0);
    }
    fake.come_back();
    let second = from_the_daemon(&mut tuner, 1).await;
    assert_eq!(second.trial(), Some("studies/scene/trials/2"));
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().stored_reports, ["studies/scene/trials/1"]);
    let measured = fake.book().trials[0].measurements["render_ms"];
    assert!((measured - 1.0).abs() < f64::EPSILON, "a fallback's result went to the trial: {measured}");
    assert_eq!(client.stats().unreported, 50);
}

#[tokio::test]
async fn a_late_answer_is_not_taken_for_the_answer_to_a_later_frame() {
    let (fake, client, mut tuner) = with_tuner(spec(), hasty()).await;
    fake.hold(Hold::Suggestions);
    let missed = tuner.next(&state(1), None).await;
    assert_eq!(missed.source(), Source::Default);
    fake.hold(Hold::Nothing);
    until("the late answer is under way", || fake.book().trials.len() == 1).await;
    let other = from_the_daemon(&mut tuner, 5).await;
    let name = other.trial().unwrap().to_owned();
    until("the late trial is given back", || fake.book().trials[0].state() == TrialState::Abandoned).await;
    drop(tuner.next(&state(5), finish(other, 3.0)).await);
    drop(tuner);
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    let reported = book.trials.iter().find(|trial| trial.name == name).unwrap();
    assert_eq!(reported.state(), TrialState::Completed);
    assert_eq!(reported.indicators["triangles"].to_bits(), 1e5f64.to_bits());
    assert_eq!(book.in_state(TrialState::Open), 0, "{:?}", book.trials);
}

#[tokio::test]
async fn a_late_answer_is_used_for_the_next_frame_of_the_same_state() {
    let (fake, _client, mut tuner) = with_tuner(spec(), hasty()).await;
    fake.hold(Hold::Suggestions);
    assert_eq!(tuner.next(&state(1), None).await.source(), Source::Default);
    fake.hold(Hold::Nothing);
    let late = from_the_daemon(&mut tuner, 1).await;
    assert_eq!(late.trial(), Some("studies/scene/trials/1"));
    assert_eq!(fake.book().count("streamed Suggest"), 1);
}

#[tokio::test]
async fn a_report_refused_on_the_stream_is_counted_and_the_stream_goes_on() {
    let (fake, client, mut tuner) = with_tuner(spec(), patient()).await;
    let first = tuner.next(&state(1), None).await;
    fake.book().refuse.insert("streamed Report", tonic::Code::NotFound);
    let second = tuner.next(&state(2), finish(first, 1.0)).await;
    assert_eq!(second.source(), Source::Daemon);
    assert_eq!((client.stats().refused, client.stats().acknowledged), (1, 0));
    // After a passing error the report is sent again, outside the stream.
    fake.book().refuse.insert("streamed Report", tonic::Code::ResourceExhausted);
    let third = tuner.next(&state(3), finish(second, 1.0)).await;
    assert_eq!(third.source(), Source::Daemon);
    drop(third);
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!((client.stats().refused, client.stats().acknowledged), (1, 1));
    assert_eq!(fake.book().count("Tune"), 1);
}

#[tokio::test]
async fn a_trial_of_several_frames_is_asked_for_once_and_reported_as_their_mean() {
    let (fake, client, mut tuner) = with_tuner(in_episodes(4), patient()).await;
    let mut previous = None;
    for frame in 0..8 {
        let suggestion = tuner.next(&state(1), previous.take()).await;
        let trial = format!("studies/scene/trials/{}", 1 + frame / 4);
        assert_eq!(suggestion.trial(), Some(trial.as_str()));
        previous = finish(suggestion, f64::from(1 + frame % 4));
    }
    drop((previous, tuner));
    client.flush(Duration::from_secs(20)).await.unwrap();
    let (stats, book) = (client.stats(), fake.book());
    assert_eq!((book.count("streamed Suggest"), book.count("streamed Report")), (2, 1));
    let means = book.trials.iter().map(|trial| trial.measurements["render_ms"]).collect::<Vec<_>>();
    assert_eq!(means, [2.5, 2.5]);
    assert_eq!((stats.suggestions, stats.acknowledged, stats.abandoned), (2, 2, 0));
}

#[tokio::test]
async fn a_daemon_that_dies_within_a_trial_gets_its_report_later() {
    let (mut fake, client, mut tuner) = with_tuner(in_episodes(4), patient()).await;
    let mut previous = finish(tuner.next(&state(1), None).await, 1.0);
    fake.go_away();
    for _frame in 1..4 {
        let suggestion = tuner.next(&state(1), previous.take()).await;
        let answer = (suggestion.source(), suggestion.trial());
        assert_eq!(answer, (Source::Daemon, Some("studies/scene/trials/1")));
        previous = finish(suggestion, 5.0);
    }
    assert_eq!(tuner.next(&state(1), previous.take()).await.source(), Source::LastGood);
    fake.come_back();
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    assert_eq!(book.stored_reports, ["studies/scene/trials/1"]);
    assert_eq!(book.trials[0].measurements.get("render_ms"), Some(&4.0));
}

#[tokio::test]
async fn another_state_gives_a_trial_of_several_frames_up() {
    let (fake, _client, mut tuner) = with_tuner(in_episodes(2), patient()).await;
    let first = tuner.next(&state(1), None).await;
    let other = tuner.next(&state(5), finish(first, 1.0)).await;
    assert_eq!(other.trial(), Some("studies/scene/trials/2"));
    assert_eq!(fake.book().trials[0].state(), TrialState::Abandoned);
    assert!(fake.book().stored_reports.is_empty(), "one frame of two is no result");
}

#[tokio::test]
async fn a_trial_of_several_frames_ends_once_its_mean_must_be_above_the_cap() {
    let (fake, _client, mut tuner) = with_tuner(in_episodes(4), patient()).await;
    fake.book().abort_above = Some(10.0);
    let first = tuner.next(&state(1), None).await;
    assert_eq!(first.abort_above(), Some(40.0));
    let second = tuner.next(&state(1), finish(first, 30.0)).await;
    assert_eq!(second.abort_above(), Some(10.0));
    let next = tuner.next(&state(1), finish(second, 11.0)).await;
    assert_eq!((next.trial(), next.abort_above()), (Some("studies/scene/trials/2"), Some(40.0)));
    assert_eq!(fake.book().trials[0].outcome, Some(outcome_to_wire(&Outcome::aborted(10.25))));
}

#[tokio::test]
async fn a_frame_is_not_reported_as_its_trial() {
    let (fake, client) = Fake::with_client();
    let study = client.study("scene", in_episodes(2)).await.unwrap();
    let frame = study.tuner().next(&state(1), None).await;
    let refused = frame.report(measured(1.0), Outcome::Ok).unwrap_err().to_string();
    assert!(refused.contains("its trial has more frames"), "{refused}");
    until("it is given back", || fake.book().in_state(TrialState::Abandoned) == 1).await;
    // Without a frame loop the program runs the frames, and reports the mean.
    study.suggest(&state(1)).await.report(measured(1.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().stored_reports, ["studies/scene/trials/2"]);
}

#[tokio::test]
async fn the_lease_of_a_trial_of_several_frames_is_renewed() {
    let (fake, _client, mut tuner) = with_tuner(in_episodes(3), patient()).await;
    fake.book().lease_end = Some(SystemTime::UNIX_EPOCH);
    let first = tuner.next(&state(1), None).await;
    tokio::time::sleep(treewright_client::limits::LEAST_RENEWAL).await;
    let second = tuner.next(&state(1), finish(first, 1.0)).await;
    until("the lease is renewed", || fake.book().count("ExtendLease") == 1).await;
    drop(second);
}

#[tokio::test]
async fn a_lease_that_could_not_be_renewed_is_renewed_once_the_daemon_is_back() {
    let mut fake = Fake::start();
    fake.book().lease_end = Some(SystemTime::now() + Duration::from_secs(4));
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", in_episodes(3)).await.unwrap();
    let mut tuner = study.tuner();
    let first = tuner.next(&state(1), None).await;
    fake.go_away();
    assert!(study.best(&state(1)).await.is_err() && matches!(client.status(), Status::Away { .. }));
    tokio::time::sleep(Duration::from_millis(2100)).await;
    let second = tuner.next(&state(1), finish(first, 1.0)).await;
    fake.come_back();
    until("it is found again", || matches!(client.status(), Status::Connected)).await;
    let third = tuner.next(&state(1), finish(second, 1.0)).await;
    until("the lease is renewed", || fake.book().count("ExtendLease") == 1).await;
    drop(third);
}

//! Reports: bounded, sent again, stored once, counted when lost.

use std::time::Duration;

use tonic::Code;
use treewright_client::{ClientError, Outcome, Source};
use treewright_proto::v1::TrialState;

use crate::support::{Fake, Hold, from_the_daemon, hasty, measured, patient, state, until};

#[tokio::test]
async fn a_lost_answer_does_not_store_a_report_twice() {
    let (fake, client, study) = Fake::with_study().await;
    fake.book().lose_answers = 3;
    study.suggest(&state(1)).await.report(measured(7.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    assert_eq!(book.count("Report"), 4);
    assert_eq!(book.stored_reports, ["studies/scene/trials/1"]);
    let stats = client.stats();
    assert_eq!((stats.sent, stats.resent, stats.acknowledged, stats.duplicates), (4, 3, 1, 1));
    assert_eq!((stats.refused, stats.dropped, stats.queued), (0, 0, 0));
    assert!(stats.last_error.is_some_and(|error| error.contains("the answer is lost")));
}

#[tokio::test]
async fn reports_wait_for_a_daemon_that_is_away() {
    let (mut fake, client, study) = Fake::with_study().await;
    let suggestion = study.suggest(&state(1)).await;
    fake.go_away();
    suggestion.report(measured(7.0), Outcome::Ok).unwrap();
    let error = client.flush(Duration::from_millis(50)).await.unwrap_err();
    assert!(matches!(error, ClientError::Unflushed { waiting: 1, .. }), "{error}");
    assert_eq!(client.stats().queued, 1);
    fake.come_back();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().stored_reports.len(), 1);
    assert_eq!(client.stats().acknowledged, 1);
}

#[tokio::test]
async fn a_full_queue_drops_the_oldest_reports_and_counts_them() {
    let (fake, client, study) = Fake::with_study_and(patient().queue(2)).await;
    let mut suggestions = Vec::new();
    for number in 0..6 {
        suggestions.push(study.suggest(&state(number)).await);
    }
    fake.hold(Hold::Reports);
    for (number, suggestion) in suggestions.into_iter().enumerate() {
        assert_eq!(suggestion.source(), Source::Daemon);
        suggestion.report(measured(1.0), Outcome::Ok).unwrap();
        if number == 0 {
            until("the first is on its way", || client.stats().sent == 1).await;
        }
    }
    // One on its way, two queued, and of six that leaves three.
    let stats = client.stats();
    assert_eq!((stats.dropped, stats.queued), (3, 3));
    assert!(stats.last_error.is_some_and(|error| error.contains("dropped")));
    fake.hold(Hold::Nothing);
    client.flush(Duration::from_secs(20)).await.unwrap();
    let stored = fake.book().stored_reports.clone();
    assert_eq!(stored, ["studies/scene/trials/1", "studies/scene/trials/5", "studies/scene/trials/6"]);
}

#[tokio::test]
async fn a_refused_report_is_given_up_and_an_internal_error_after_some_attempts() {
    let (fake, client, study) = Fake::with_study().await;
    let (one, two) = (study.suggest(&state(1)).await, study.suggest(&state(2)).await);
    fake.book().refuse.insert("Report", Code::FailedPrecondition);
    one.report(measured(1.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!((client.stats().refused, fake.book().count("Report")), (1, 1));
    fake.book().refuse.insert("Report", Code::Internal);
    two.report(measured(1.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!((client.stats().refused, fake.book().count("Report")), (2, 1 + 8));
    assert_eq!(client.stats().acknowledged, 0);
}

#[tokio::test]
async fn an_overloaded_daemon_gets_time() {
    let (fake, client, study) = Fake::with_study().await;
    let suggestion = study.suggest(&state(1)).await;
    fake.book().refuse.insert("Report", Code::ResourceExhausted);
    suggestion.report(measured(1.0), Outcome::Ok).unwrap();
    until("it is tried more often than an internal error", || fake.book().count("Report") > 10).await;
    fake.book().refuse.clear();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!((client.stats().refused, client.stats().acknowledged), (0, 1));
}

#[tokio::test]
async fn a_suggestion_waits_for_the_report_of_the_trial_before() {
    let (fake, _client, study) = Fake::with_study_and(hasty()).await;
    let first = from_the_daemon(async || study.suggest(&state(1)).await).await;
    fake.hold(Hold::Reports);
    let asked = fake.book().count("Suggest");
    first.report(measured(1.0), Outcome::Ok).unwrap();
    assert_eq!(study.suggest(&state(1)).await.source(), Source::LastGood);
    assert_eq!(fake.book().count("Suggest"), asked, "the question waits for the report");
    fake.hold(Hold::Nothing);
    until("the report arrives and the question after it", || fake.book().trials.len() == 2).await;
    assert_eq!(fake.book().trials[0].state(), TrialState::Completed);
}

#[tokio::test]
async fn what_is_queued_is_still_sent_after_the_last_handle_is_gone() {
    let (fake, client, study) = Fake::with_study().await;
    let (one, two) = (study.suggest(&state(1)).await, study.suggest(&state(2)).await);
    one.report(measured(1.0), Outcome::Ok).unwrap();
    drop((study, client, two));
    until("the report is stored", || fake.book().stored_reports.len() == 1).await;
    until("the other trial is given back", || fake.book().in_state(TrialState::Abandoned) == 1).await;
}

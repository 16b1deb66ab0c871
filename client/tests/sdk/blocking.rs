//! The blocking client: it gives the asynchronous client's answers, without a runtime of the caller's.

use std::time::Duration;

use treewright_client::blocking::Client;
use treewright_client::{Indicators, Outcome, Source, TrialQuery};
use treewright_proto::v1::TrialState;

use crate::support::{Fake, Hold, hasty, measured, patient, spec, state};

#[test]
fn a_program_without_a_runtime_is_tuned() {
    let fake = Fake::start();
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", spec()).unwrap();
    study.suggest(&state(1)).report(measured(4.0), Outcome::Ok).unwrap();
    let mut tuner = study.tuner();
    let mut previous = None;
    for render_ms in [3.0, 2.0, 5.0] {
        let suggestion = tuner.next(&state(1), previous.take());
        assert_eq!(suggestion.source(), Source::Daemon);
        previous = Some(suggestion.finished(measured(render_ms), Outcome::Ok).unwrap());
    }
    drop((previous, tuner));
    client.flush(Duration::from_secs(20)).unwrap();
    assert!((study.best(&Indicators::new()).unwrap().cost - 2.0).abs() < f64::EPSILON);
    let trials: Result<Vec<_>, _> = client.trials("scene", TrialQuery::all()).collect();
    assert_eq!(trials.unwrap().len(), 4);
    let mut refused = client.trials("scene", TrialQuery::all().filter("rubbish"));
    assert!(refused.next().is_some_and(|trial| trial.is_err()) && refused.next().is_none());
    let mut suggestion = study.suggest(&state(2));
    client.extend_lease(&mut suggestion).unwrap();
    assert_eq!(client.list_studies().unwrap().len(), 1);
    client.ping().unwrap();
}

#[test]
fn the_end_of_the_program_waits_for_reports() {
    let fake = Fake::start();
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", spec()).unwrap();
    let (one, two) = (study.suggest(&state(1)), study.suggest(&state(2)));
    one.report(measured(1.0), Outcome::Ok).unwrap();
    drop(two);
    drop((client, study));
    assert_eq!(fake.book().in_state(TrialState::Completed), 1);
    assert_eq!(fake.book().in_state(TrialState::Abandoned), 1);
}

#[test]
fn a_hanging_daemon_keeps_neither_frame_nor_end() {
    let fake = Fake::start();
    let client = Client::connect(&fake.url(), hasty()).unwrap();
    let study = client.study("scene", spec()).unwrap();
    fake.hold(Hold::Everything);
    for _frame in 0..3 {
        let suggestion = study.suggest(&state(1));
        assert_eq!(suggestion.source(), Source::Default);
    }
    // A suggestion may outlive the client; then no client is left to send its report.
    let suggestion = study.suggest(&state(1));
    drop((study, client));
    suggestion.report(measured(1.0), Outcome::Ok).unwrap();
}

#[tokio::test]
async fn it_works_inside_a_runtime_too() {
    let fake = Fake::start();
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", spec()).unwrap();
    assert_eq!(study.suggest(&state(1)).source(), Source::Daemon);
}

//! Trials that run side by side: each suggestion has a worker of its own, in any thread, task or process.

use std::collections::BTreeSet;
use std::time::Duration;

use treewright_client::{Outcome, Source, blocking};
use treewright_proto::v1::TrialState;

use crate::support::{Fake, measured, patient, spec, state};

/// The workers that ran the trials so far.
fn workers(fake: &Fake) -> BTreeSet<String> {
    fake.book().trials.iter().map(|trial| trial.client_id.clone()).collect()
}

#[test]
fn threads_that_share_a_study_run_a_trial_each() {
    let fake = Fake::start();
    let client = blocking::Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", spec()).unwrap();
    let all_have_one = std::sync::Barrier::new(4);
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for frame in 0..10 {
                    let suggestion = study.suggest(&state(3));
                    assert_eq!(suggestion.source(), Source::Daemon, "{:?}", suggestion.problem());
                    all_have_one.wait();
                    suggestion.report(measured(f64::from(frame)), Outcome::Ok).unwrap();
                }
            });
        }
    });
    client.flush(Duration::from_secs(20)).unwrap();
    assert_eq!(fake.book().stored_reports.len(), 40);
    assert_eq!(fake.book().trials.len(), 40);
    let names = ["tester", "tester#2", "tester#3", "tester#4"].map(str::to_owned);
    assert_eq!(workers(&fake), names.into());
}

#[tokio::test]
async fn so_do_tasks_whichever_way_they_came_by_the_study() {
    let (fake, client) = Fake::with_client();
    let mut tasks = Vec::new();
    for number in 0..40 {
        // As programs do where a study is made in each task.
        let client = client.clone();
        tasks.push(tokio::spawn(async move {
            let study = client.study("scene", spec()).await.unwrap();
            let suggestion = match number % 2 {
                0 => study.suggest(&state(3)).await,
                _ => study.tuner().next(&state(3), None).await,
            };
            (study, suggestion)
        }));
    }
    let mut open = Vec::new();
    for task in tasks {
        open.push(task.await.unwrap());
    }
    let trials: BTreeSet<_> = open.iter().filter_map(|(_, suggestion)| suggestion.trial()).collect();
    assert_eq!(trials.len(), 40, "one each");
    for (_, suggestion) in open {
        suggestion.report(measured(1.0), Outcome::Ok).unwrap();
    }
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().in_state(TrialState::Completed), 40);
}

#[tokio::test]
async fn one_loop_is_one_worker() {
    let (fake, client, study) = Fake::with_study().await;
    for number in [1, 1, 2, 3] {
        study.suggest(&state(number)).await.report(measured(1.0), Outcome::Ok).unwrap();
    }
    drop(study.suggest(&state(1)).await);
    let mut tuner = study.tuner();
    let mut previous = None;
    for number in [1, 1, 2] {
        let suggestion = tuner.next(&state(number), previous.take()).await;
        previous = Some(suggestion.finished(measured(2.0), Outcome::Ok).unwrap());
    }
    drop((previous, tuner));
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().trials.len(), 8);
    assert_eq!(workers(&fake), BTreeSet::from(["tester".to_owned()]));
}

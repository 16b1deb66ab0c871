//! Trials over the wire: suggest, report, leases, queries, and each error that the contract names.

mod common;

use std::collections::{BTreeMap, BTreeSet};

use common::{Client, Server, ask, create, done, get, report, suggest, triangles};
use tonic::{Code, Status};
use treewright_proto::v1::{self as wire, outcome};

fn assert_refused<T: std::fmt::Debug>(answer: Result<T, Status>, code: Code, fragment: &str) {
    let status = answer.expect_err("refused");
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(fragment), "{status}");
}

async fn server() -> (Server, Client) {
    let server = Server::in_memory().await;
    let mut client = server.client().await;
    create(&mut client, "hall").await;
    (server, client)
}

#[tokio::test]
async fn a_trial_goes_out_and_comes_back() {
    let (server, mut client) = server().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    assert_eq!(trial.name, "studies/hall/trials/1");
    assert_eq!(trial.client_id, "a");
    assert_eq!(trial.state(), wire::TrialState::Open);
    assert_eq!(trial.mode(), wire::Mode::Default);
    assert_eq!(trial.indicators, triangles(10.0));
    assert_eq!(trial.fingerprint, ask("a", 10.0).fingerprint);
    assert!(!trial.reason.as_ref().unwrap().summary.is_empty());
    let expire = trial.lease_expire_time.unwrap();
    assert_eq!(expire.seconds, common::START_MS / 1000 + 60);

    server.clock.advance_ms(1234);
    let answer = done(&mut client, &trial.name, 12.5).await;
    assert!(!answer.duplicate);
    let stored = answer.trial.unwrap();
    assert_eq!(stored.state(), wire::TrialState::Completed);
    assert_eq!(stored.cost, Some(12.5));
    assert_eq!(stored.measurements, report("", 12.5).measurements);
    assert_eq!(stored.outcome, common::ok());
    assert!(!stored.late);
    let complete = stored.complete_time.unwrap();
    assert_eq!(
        (complete.seconds, complete.nanos),
        (common::START_MS / 1000 + 1, 234_000_000)
    );
    assert_eq!(get(&mut client, &trial.name).await, stored);
}

#[tokio::test]
async fn a_repeated_suggestion_is_the_same_trial_with_a_fresh_lease() {
    let (server, mut client) = server().await;
    let first = suggest(&mut client, "a", 10.0).await;
    server.clock.advance_ms(5_000);
    let second = suggest(&mut client, "a", 10.0).await;
    assert_eq!(second.name, first.name);
    assert_eq!(second.configuration, first.configuration);
    let seconds = |trial: &wire::Trial| trial.lease_expire_time.unwrap().seconds;
    assert_eq!(seconds(&second), seconds(&first) + 5);
    // Another client gets a trial of its own.
    assert_ne!(suggest(&mut client, "b", 10.0).await.name, first.name);
}

#[tokio::test]
async fn a_repeated_report_changes_nothing() {
    let (_server, mut client) = server().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    let first = done(&mut client, &trial.name, 12.5).await;
    let second = done(&mut client, &trial.name, 99.0).await;
    assert!(second.duplicate);
    assert_eq!(second.trial, first.trial);
}

#[tokio::test]
async fn every_outcome_is_taken() {
    let (_server, mut client) = server().await;
    let reason = || "depth limit reached".to_owned();
    let kinds = [
        outcome::Kind::Infeasible(wire::Infeasible { reason: reason() }),
        outcome::Kind::Aborted(wire::Aborted { lower_bound: 7.5 }),
        outcome::Kind::Failed(wire::Failed { reason: reason() }),
    ];
    for kind in kinds {
        let trial = suggest(&mut client, "a", 10.0).await;
        let request = wire::ReportRequest {
            trial: trial.name.clone(),
            measurements: BTreeMap::new(),
            outcome: Some(wire::Outcome {
                kind: Some(kind.clone()),
            }),
        };
        let stored = client
            .report(request)
            .await
            .unwrap()
            .into_inner()
            .trial
            .unwrap();
        let bound = match &kind {
            outcome::Kind::Aborted(aborted) => Some(aborted.lower_bound),
            _ => None,
        };
        assert_eq!(stored.cost, bound);
        assert_eq!(stored.outcome.unwrap().kind, Some(kind));
    }
}

#[tokio::test]
async fn malformed_questions_and_results_are_refused() {
    let (_server, mut client) = server().await;
    type Change<T> = fn(&mut T);
    let questions: [(Change<wire::SuggestRequest>, &str); 8] = [
        (
            |r| r.study = "hall".to_owned(),
            "study: \"hall\" must have the form",
        ),
        (|r| r.client_id.clear(), "client_id must be 1 to 128"),
        (
            |r| r.client_id = "x".repeat(129),
            "client_id must be 1 to 128",
        ),
        (
            |r| r.client_id = "a\nb".to_owned(),
            "client_id must be 1 to 128",
        ),
        (|r| r.indicators.clear(), "\"triangles\" is missing"),
        (
            |r| {
                r.indicators.insert("x".to_owned(), 1.0);
            },
            "\"x\" is unknown",
        ),
        (
            |r| {
                r.indicators.insert("triangles".to_owned(), f64::NAN);
            },
            "\"triangles\" is NaN",
        ),
        (
            |r| r.fingerprint.as_mut().unwrap().threads = -1,
            "fingerprint.threads",
        ),
    ];
    for (change, fragment) in questions {
        let mut request = ask("a", 10.0);
        change(&mut request);
        assert_refused(
            client.suggest(request).await,
            Code::InvalidArgument,
            fragment,
        );
    }

    let trial = suggest(&mut client, "a", 10.0).await;
    let results: [(Change<wire::ReportRequest>, &str); 8] = [
        (
            |r| r.trial = "studies/hall".to_owned(),
            "trial: \"studies/hall\" must have the form",
        ),
        (|r| r.outcome = None, "outcome: is required"),
        (
            |r| r.outcome = Some(wire::Outcome { kind: None }),
            "outcome: is required",
        ),
        (
            |r| {
                r.measurements.remove("render_ms");
            },
            "\"render_ms\" is missing",
        ),
        (
            |r| {
                r.measurements.insert("render_ms".to_owned(), f64::INFINITY);
            },
            "\"render_ms\" is inf",
        ),
        (
            |r| {
                r.measurements.insert("frames".to_owned(), -1.0);
            },
            "\"frames\" is -1",
        ),
        (
            |r| {
                r.measurements.insert("Frames".to_owned(), 1.0);
            },
            "\"Frames\" is not a name",
        ),
        (
            |r| {
                r.outcome = Some(wire::Outcome {
                    kind: Some(outcome::Kind::Aborted(wire::Aborted {
                        lower_bound: f64::NAN,
                    })),
                })
            },
            "lower bound",
        ),
    ];
    for (change, fragment) in results {
        let mut request = report(&trial.name, 1.0);
        change(&mut request);
        assert_refused(
            client.report(request).await,
            Code::InvalidArgument,
            fragment,
        );
    }
    // None of that touched the trial.
    assert_eq!(
        get(&mut client, &trial.name).await.state(),
        wire::TrialState::Open
    );

    let answer = client.report(report("studies/hall/trials/99", 1.0)).await;
    assert_refused(answer, Code::NotFound, "trial 99");
    let answer = client.report(report("studies/none/trials/1", 1.0)).await;
    assert_refused(answer, Code::NotFound, "study \"none\"");
}

#[tokio::test]
async fn an_abandoned_trial_is_handed_out_again() {
    let (_server, mut client) = server().await;
    let first = suggest(&mut client, "a", 10.0).await;
    let abandon = |trial: &str| wire::AbandonTrialRequest {
        trial: trial.to_owned(),
    };
    for _ in 0..2 {
        // Idempotent.
        let given_back = client
            .abandon_trial(abandon(&first.name))
            .await
            .unwrap()
            .into_inner();
        assert_eq!(given_back.state(), wire::TrialState::Abandoned);
    }
    let second = suggest(&mut client, "b", 10.0).await;
    assert_ne!(second.name, first.name);
    assert_eq!(second.configuration, first.configuration);

    let answer = client.report(report(&first.name, 1.0)).await;
    assert_refused(answer, Code::FailedPrecondition, "trial 1 was abandoned");
    done(&mut client, &second.name, 1.0).await;
    let answer = client.abandon_trial(abandon(&second.name)).await;
    assert_refused(
        answer,
        Code::FailedPrecondition,
        "trial 2 is already completed",
    );
    let answer = client
        .abandon_trial(abandon("studies/hall/trials/99"))
        .await;
    assert_refused(answer, Code::NotFound, "trial 99");
}

#[tokio::test]
async fn a_lease_ends_and_a_late_report_still_counts() {
    let (server, mut client) = server().await;
    let first = suggest(&mut client, "a", 10.0).await;
    server.clock.advance_ms(60_001);
    // The configuration goes to whoever asks next.
    let second = suggest(&mut client, "b", 10.0).await;
    assert_ne!(second.name, first.name);
    assert_eq!(second.configuration, first.configuration);
    assert_eq!(
        get(&mut client, &first.name).await.state(),
        wire::TrialState::Expired
    );

    let late = done(&mut client, &first.name, 3.0).await;
    assert!(!late.duplicate);
    let stored = late.trial.unwrap();
    assert!(stored.late);
    assert_eq!(
        (stored.state(), stored.cost),
        (wire::TrialState::Completed, Some(3.0))
    );
    let again = done(&mut client, &first.name, 9.0).await;
    assert!(again.duplicate);
    assert_eq!(again.trial.unwrap(), stored);
}

#[tokio::test]
async fn leases_end_without_anyone_asking() {
    let (server, mut client) = server().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    server.clock.advance_ms(60_001);
    // The sweep comes by within a period; reading does not end leases.
    for _ in 0..200 {
        if get(&mut client, &trial.name).await.state() == wire::TrialState::Expired {
            return;
        }
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    panic!("the lease was never ended");
}

#[tokio::test]
async fn a_lease_can_be_extended_while_the_trial_is_open() {
    let (server, mut client) = server().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    let extend = |trial: &str| wire::ExtendLeaseRequest {
        trial: trial.to_owned(),
    };
    for _ in 0..3 {
        server.clock.advance_ms(50_000);
        let extended = client
            .extend_lease(extend(&trial.name))
            .await
            .unwrap()
            .into_inner();
        assert_eq!(extended.state(), wire::TrialState::Open);
    }
    done(&mut client, &trial.name, 1.0).await;
    let answer = client.extend_lease(extend(&trial.name)).await;
    assert_refused(
        answer,
        Code::FailedPrecondition,
        "trial 1 is Completed, not open",
    );
    let answer = client.extend_lease(extend("studies/hall/trials/99")).await;
    assert_refused(answer, Code::NotFound, "trial 99");
}

#[tokio::test]
async fn predictions_and_the_best_rest_on_reports() {
    let (_server, mut client) = server().await;
    let predict = |count| wire::PredictRequest {
        study: "studies/hall".to_owned(),
        indicators: triangles(count),
    };
    let best = |indicators| wire::GetBestRequest {
        study: "studies/hall".to_owned(),
        indicators,
    };
    let before = client.predict(predict(10.0)).await.unwrap().into_inner();
    assert_eq!(before.mode(), wire::Mode::Default);
    assert_eq!(before.predicted_cost, None);
    assert_refused(
        client.get_best(best(BTreeMap::new())).await,
        Code::NotFound,
        "in any state",
    );

    let mut cheapest = None;
    for render_ms in [9.0, 4.0, 7.0] {
        let trial = suggest(&mut client, "a", 10.0).await;
        let stored = done(&mut client, &trial.name, render_ms)
            .await
            .trial
            .unwrap();
        if render_ms == 4.0 {
            cheapest = Some(stored);
        }
    }
    let cheapest = cheapest.unwrap();
    for indicators in [BTreeMap::new(), triangles(10.2)] {
        let found = client
            .get_best(best(indicators))
            .await
            .unwrap()
            .into_inner();
        assert_eq!(found.configuration, cheapest.configuration);
        assert_eq!((found.cost, found.default_cost), (4.0, Some(9.0)));
        assert_eq!((found.measurements, found.state_id), (1, cheapest.state_id));
        assert_eq!(found.trial, cheapest.name);
        assert_eq!(found.last_measure_time, cheapest.complete_time);
    }
    assert_refused(
        client.get_best(best(triangles(90.0))).await,
        Code::NotFound,
        "in this state",
    );
    assert_refused(
        client.get_best(best(triangles(f64::NAN))).await,
        Code::InvalidArgument,
        "NaN",
    );

    let after = client.predict(predict(12.0)).await.unwrap().into_inner();
    assert_eq!(after.mode(), wire::Mode::Exploit);
    assert_eq!(after.configuration, cheapest.configuration);
    assert!(!after.reason.unwrap().neighbours.is_empty());
    // Nothing was written for any of that.
    let name = "studies/hall".to_owned();
    let study = client
        .get_study(wire::GetStudyRequest { name })
        .await
        .unwrap()
        .into_inner();
    let statistics = study.statistics.unwrap();
    assert_eq!((statistics.states, statistics.trials), (1, 3));
    assert_eq!(
        (statistics.completed_trials, statistics.open_trials),
        (3, 0)
    );
}

#[tokio::test]
async fn trials_are_queried_page_by_page() {
    let (_server, mut client) = server().await;
    for render_ms in [5.0, 3.0, 8.0, 1.0, 9.0] {
        let trial = suggest(&mut client, "a", 10.0).await;
        done(&mut client, &trial.name, render_ms).await;
    }
    suggest(&mut client, "a", 10.0).await;
    let mut request = wire::QueryTrialsRequest {
        study: "studies/hall".to_owned(),
        filter: "state = COMPLETED AND measurement.render_ms >= 3 AND config.min_leaf <= 32"
            .to_owned(),
        order_by: "cost desc".to_owned(),
        page_size: 3,
        page_token: String::new(),
    };
    let costs = |page: &wire::QueryTrialsResponse| {
        page.trials
            .iter()
            .map(|trial| trial.cost.unwrap())
            .collect::<Vec<_>>()
    };
    let page = client
        .query_trials(request.clone())
        .await
        .unwrap()
        .into_inner();
    assert_eq!(costs(&page), [9.0, 8.0, 5.0]);
    request.page_token = page.next_page_token;
    let page = client
        .query_trials(request.clone())
        .await
        .unwrap()
        .into_inner();
    assert_eq!(costs(&page), [3.0]);
    assert_eq!(page.next_page_token, "");

    let mut other = request.clone();
    other.order_by = "cost".to_owned();
    assert_refused(
        client.query_trials(other).await,
        Code::InvalidArgument,
        "page_token",
    );
    type Change = fn(&mut wire::QueryTrialsRequest);
    let mistakes: [(Change, &str); 4] = [
        (|r| r.filter = "cost <".to_owned(), "filter: at character 7"),
        (
            |r| r.order_by = "price".to_owned(),
            "order_by: at character 1",
        ),
        (|r| r.page_size = -1, "page_size: -1"),
        (|r| r.study.clear(), "study: "),
    ];
    for (change, fragment) in mistakes {
        let mut wrong = request.clone();
        change(&mut wrong);
        assert_refused(
            client.query_trials(wrong).await,
            Code::InvalidArgument,
            fragment,
        );
    }
    request.study = "studies/none".to_owned();
    request.page_token.clear();
    assert_refused(
        client.query_trials(request).await,
        Code::NotFound,
        "study \"none\"",
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn eight_clients_in_one_state_never_share_an_open_trial() {
    let directory = tempfile::tempdir().unwrap();
    let server = Server::on_disk(&directory.path().join("studies.db"), common::START_MS).await;
    let mut client = server.client().await;
    create(&mut client, "hall").await;
    let mut tasks = Vec::new();
    for number in 0..8 {
        let mut client = server.client().await;
        tasks.push(tokio::spawn(async move {
            let name = format!("client-{number}");
            let mut seen = Vec::new();
            for round in 0..6 {
                let trial = suggest(&mut client, &name, 10.0).await;
                assert_eq!(trial.client_id, name);
                let answer = done(&mut client, &trial.name, f64::from(5 + round)).await;
                assert!(!answer.duplicate, "someone else reported {}", trial.name);
                seen.push(trial.name);
            }
            seen
        }));
    }
    let mut all = Vec::new();
    for task in tasks {
        all.extend(task.await.expect("a client"));
    }
    let distinct: BTreeSet<&String> = all.iter().collect();
    assert_eq!((all.len(), distinct.len()), (48, 48));
    let name = "studies/hall".to_owned();
    let study = client
        .get_study(wire::GetStudyRequest { name })
        .await
        .unwrap()
        .into_inner();
    assert_eq!(study.statistics.unwrap().completed_trials, 48);
    server.stop().await;
}

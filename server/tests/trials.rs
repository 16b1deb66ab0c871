//! Trials over the wire: suggest, report, predict, query, exclude, and each error that the contract names.

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use common::{
    Client, START_MS, Server, ask, assert_refused, configuration, create, done, get, report, suggest,
    triangles,
};
use tonic::Code;
use treewright_core::tuner::{Ask, Change, Tuner};
use treewright_proto::v1::{self as wire, outcome};
use treewright_store::{MemoryStore, Store as _};

#[tokio::test]
async fn a_trial_goes_out_and_comes_back() {
    let (server, mut client) = Server::with_hall().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    assert_eq!(trial.name, "studies/hall/trials/1");
    assert_eq!(trial.client_id, "a");
    assert_eq!(trial.state(), wire::TrialState::Open);
    assert_eq!(trial.mode(), wire::Mode::Default);
    assert_eq!(trial.indicators, triangles(10.0));
    assert_eq!(trial.fingerprint, ask("a", 10.0).fingerprint);
    assert!(!trial.reason.as_ref().unwrap().summary.is_empty());
    let expire = trial.lease_expire_time.unwrap();
    assert_eq!(expire.seconds, START_MS / 1000 + 60);

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
    assert_eq!((complete.seconds, complete.nanos), (START_MS / 1000 + 1, 234_000_000));
    assert_eq!(get(&mut client, &trial.name).await, stored);
}

#[tokio::test]
async fn a_repeated_suggestion_is_the_same_trial_with_a_fresh_lease() {
    let (server, mut client) = Server::with_hall().await;
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
async fn standard_errors_are_checked_and_stored() {
    let (_server, mut client) = Server::with_hall().await;
    let trial = suggest(&mut client, "a", 10.0).await.name;
    let estimated = |name: &str, error: f64| wire::ReportRequest {
        standard_errors: BTreeMap::from([(name.to_owned(), error)]),
        ..report(&trial, 12.5)
    };
    for (name, error, words) in
        [("render_ms", -1.0, "not negative"), ("other_ms", 1.0, "no such measurement")]
    {
        assert_refused(client.report(estimated(name, error)).await, Code::InvalidArgument, words);
    }
    let request = estimated("render_ms", 0.5);
    let stored = client.report(request.clone()).await.unwrap().into_inner().trial.unwrap();
    assert_eq!(stored.standard_errors, request.standard_errors);
    assert_eq!(get(&mut client, &trial).await, stored);
}

#[tokio::test]
async fn every_outcome_is_taken() {
    let (_server, mut client) = Server::with_hall().await;
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
            outcome: of_kind(kind.clone()),
            ..wire::ReportRequest::default()
        };
        let stored = client.report(request).await.unwrap().into_inner().trial.unwrap();
        let bound =
            if let outcome::Kind::Aborted(aborted) = &kind { Some(aborted.lower_bound) } else { None };
        assert_eq!(stored.cost, bound);
        assert_eq!(stored.outcome.unwrap().kind, Some(kind));
    }
}

fn of_kind(kind: outcome::Kind) -> Option<wire::Outcome> {
    Some(wire::Outcome { kind: Some(kind) })
}

fn set(values: &mut BTreeMap<String, f64>, name: &str, value: f64) {
    values.insert(name.to_owned(), value);
}

#[tokio::test]
async fn malformed_questions_and_results_are_refused() {
    let (_server, mut client) = Server::with_hall().await;
    type Change<T> = fn(&mut T);
    let questions: [(Change<wire::SuggestRequest>, &str); 8] = [
        (|r| r.study = "hall".to_owned(), "study: \"hall\" must have the form"),
        (|r| r.client_id.clear(), "client_id must be 1 to 128"),
        (|r| r.client_id = "x".repeat(129), "client_id must be 1 to 128"),
        (|r| r.client_id = "a\nb".to_owned(), "client_id must be 1 to 128"),
        (|r| r.indicators.clear(), "\"triangles\" is missing"),
        (|r| set(&mut r.indicators, "x", 1.0), "\"x\" is unknown"),
        (|r| set(&mut r.indicators, "triangles", f64::NAN), "\"triangles\" is NaN"),
        (|r| r.fingerprint.as_mut().unwrap().threads = -1, "fingerprint.threads"),
    ];
    for (change, fragment) in questions {
        let mut request = ask("a", 10.0);
        change(&mut request);
        assert_refused(client.suggest(request).await, Code::InvalidArgument, fragment);
    }

    let trial = suggest(&mut client, "a", 10.0).await;
    let results: [(Change<wire::ReportRequest>, &str); 8] = [
        (|r| r.trial = "studies/hall".to_owned(), "trial: \"studies/hall\" must have the form"),
        (|r| r.outcome = None, "outcome: is required"),
        (|r| r.outcome = Some(wire::Outcome { kind: None }), "outcome: is required"),
        (|r| r.measurements.retain(|name, _| name != "render_ms"), "\"render_ms\" is missing"),
        (|r| set(&mut r.measurements, "render_ms", f64::INFINITY), "\"render_ms\" is inf"),
        (|r| set(&mut r.measurements, "frames", -1.0), "\"frames\" is -1"),
        (|r| set(&mut r.measurements, "Frames", 1.0), "\"Frames\" is not a name"),
        (
            |r| r.outcome = of_kind(outcome::Kind::Aborted(wire::Aborted { lower_bound: f64::NAN })),
            "lower bound",
        ),
    ];
    for (change, fragment) in results {
        let mut request = report(&trial.name, 1.0);
        change(&mut request);
        assert_refused(client.report(request).await, Code::InvalidArgument, fragment);
    }
    // None of that touched the trial.
    assert_eq!(get(&mut client, &trial.name).await.state(), wire::TrialState::Open);

    let answer = client.report(report("studies/hall/trials/99", 1.0)).await;
    assert_refused(answer, Code::NotFound, "trial 99");
    let answer = client.report(report("studies/none/trials/1", 1.0)).await;
    assert_refused(answer, Code::NotFound, "study \"none\"");
}

#[tokio::test]
async fn predictions_and_the_best_rest_on_reports() {
    let (_server, mut client) = Server::with_client().await;
    // It answers the nearest measured configuration, and none between two measurements.
    let predictor = wire::PredictorMethod::NearestNeighbour.into();
    let nearest = wire::Policy { epsilon: Some(1.0), predictor, ..Default::default() };
    let study = wire::Study { policy: Some(nearest), ..common::study() };
    client.create_study(common::creation("hall", study)).await.expect("created");
    let predict = |count| wire::PredictRequest { indicators: triangles(count), ..common::predict() };
    let best = |indicators| wire::GetBestRequest { indicators, ..common::best() };
    let before = client.predict(predict(10.0)).await.unwrap().into_inner();
    assert_eq!(before.mode(), wire::Mode::Default);
    assert_eq!(before.predicted_cost, None);
    assert_refused(client.get_best(best(BTreeMap::new())).await, Code::NotFound, "in any state");

    let mut cheapest = None;
    for render_ms in [9.0, 4.0, 7.0] {
        let trial = suggest(&mut client, "a", 10.0).await;
        let stored = done(&mut client, &trial.name, render_ms).await.trial.unwrap();
        if render_ms == 4.0 {
            cheapest = Some(stored);
        }
    }
    let cheapest = cheapest.unwrap();
    for indicators in [BTreeMap::new(), triangles(10.2)] {
        let found = client.get_best(best(indicators)).await.unwrap().into_inner();
        assert_eq!(found.configuration, cheapest.configuration);
        assert_eq!((found.cost, found.default_cost), (4.0, Some(9.0)));
        assert_eq!((found.measurements, found.state_id), (1, cheapest.state_id));
        assert_eq!(found.trial, cheapest.name);
        assert_eq!(found.last_measure_time, cheapest.complete_time);
    }
    assert_refused(client.get_best(best(triangles(90.0))).await, Code::NotFound, "in this state");
    assert_refused(client.get_best(best(triangles(f64::NAN))).await, Code::InvalidArgument, "NaN");

    let after = client.predict(predict(12.0)).await.unwrap().into_inner();
    assert_eq!(after.mode(), wire::Mode::Exploit);
    assert_eq!(after.configuration, cheapest.configuration, "{after:?}");
    assert!(!after.reason.unwrap().neighbours.is_empty());
    // Nothing was written for any of that.
    let name = "studies/hall".to_owned();
    let study = client.get_study(wire::GetStudyRequest { name }).await.unwrap().into_inner();
    let statistics = study.statistics.unwrap();
    assert_eq!((statistics.states, statistics.trials), (1, 3));
    assert_eq!((statistics.completed_trials, statistics.open_trials), (3, 0));
}

#[tokio::test]
async fn a_client_begins_with_its_own_default() {
    let (_server, mut client) = Server::with_hall().await;
    let start = Some(configuration(16, "high"));
    let ask_from = |start| wire::SuggestRequest { start, ..ask("a", 10.0) };
    for frame in 0..4 {
        let trial = client.suggest(ask_from(start.clone())).await.unwrap().into_inner();
        let is_start = trial.configuration == start;
        if frame == 0 {
            assert!(is_start && trial.mode() == wire::Mode::Default, "{trial:?}");
        }
        done(&mut client, &trial.name, if is_start { 7.0 } else { 9.0 }).await;
    }
    let best = |start| wire::GetBestRequest { start, ..common::best() };
    let own = client.get_best(best(start.clone())).await.unwrap().into_inner();
    assert_eq!((own.default_cost, &own.configuration), (Some(7.0), &start));
    assert!(own.standing.is_some_and(|standing| standing.nothing_better), "nothing is better than it");
    let plain = client.get_best(best(None)).await.unwrap().into_inner();
    assert_eq!(plain.default_cost, Some(9.0), "others are told of the study's default");
    let predict = |start| wire::PredictRequest { start, ..common::predict() };
    let predicted = client.predict(predict(start.clone())).await.unwrap().into_inner();
    assert_eq!(predicted.configuration, start);

    let outside = Some(configuration(99, "low"));
    assert_refused(client.suggest(ask_from(outside.clone())).await, Code::InvalidArgument, "start");
    assert_refused(client.predict(predict(outside.clone())).await, Code::InvalidArgument, "start");
    assert_refused(client.get_best(best(outside)).await, Code::InvalidArgument, "start");
}

#[tokio::test]
async fn trials_are_queried_page_by_page() {
    let (_server, mut client) = Server::with_hall().await;
    for render_ms in [5.0, 3.0, 8.0, 1.0, 9.0] {
        let trial = suggest(&mut client, "a", 10.0).await;
        done(&mut client, &trial.name, render_ms).await;
    }
    suggest(&mut client, "a", 10.0).await;
    let mut request = wire::QueryTrialsRequest {
        study: "studies/hall".to_owned(),
        filter: "state = COMPLETED AND measurement.render_ms >= 3 AND config.min_leaf <= 32 \
                 AND indicator.triangles > 1"
            .to_owned(),
        order_by: "cost desc".to_owned(),
        page_size: 3,
        ..wire::QueryTrialsRequest::default()
    };
    let costs = |page: &wire::QueryTrialsResponse| {
        page.trials.iter().map(|trial| trial.cost.unwrap()).collect::<Vec<_>>()
    };
    let page = client.query_trials(request.clone()).await.unwrap().into_inner();
    assert_eq!(costs(&page), [9.0, 8.0, 5.0]);
    request.page_token = page.next_page_token;
    let page = client.query_trials(request.clone()).await.unwrap().into_inner();
    assert_eq!(costs(&page), [3.0]);
    assert_eq!(page.next_page_token, "");

    let mut other = request.clone();
    other.order_by = "cost".to_owned();
    assert_refused(client.query_trials(other).await, Code::InvalidArgument, "page_token");
    type Change = fn(&mut wire::QueryTrialsRequest);
    let mistakes: [(Change, &str); 6] = [
        (|r| r.filter = "cost <".to_owned(), "filter: at character 7"),
        (|r| r.filter = "config.leaf = 2".to_owned(), "at character 1: the study has no parameter \"leaf\""),
        (
            |r| r.filter = "cost > 1 AND indicator.size > 1".to_owned(),
            "at character 14: the study has no indicator \"size\"",
        ),
        (|r| r.order_by = "price".to_owned(), "order_by: at character 1"),
        (|r| r.page_size = -1, "page_size: -1"),
        (|r| r.study.clear(), "study: "),
    ];
    for (change, fragment) in mistakes {
        let mut wrong = request.clone();
        change(&mut wrong);
        assert_refused(client.query_trials(wrong).await, Code::InvalidArgument, fragment);
    }
    request.study = "studies/none".to_owned();
    request.page_token.clear();
    assert_refused(client.query_trials(request).await, Code::NotFound, "study \"none\"");
}

#[tokio::test]
async fn a_page_ends_before_its_message_grows_too_large() {
    const COUNT: u64 = 450;
    let store = Arc::new(MemoryStore::new());
    let server = Server::with(Arc::clone(&store) as _, START_MS).await;
    let mut client = server.client().await;
    create(&mut client, "hall").await;
    // Written behind the server's back, since no client can make trials this large so quickly.
    let loaded = store.load("hall").await.unwrap();
    let mut tuner = Tuner::new(Arc::new(loaded.study.spec)).unwrap();
    let mut change = Change::default();
    for number in 0..COUNT {
        let ask =
            Ask { client_id: format!("client-{number}"), indicators: triangles(10.0), ..Ask::default() };
        let (mut trial, mut more) = tuner.suggest(&ask, START_MS).unwrap();
        trial.decision.said = Some("x".repeat(10_000));
        change.trials.push(trial);
        change.states.append(&mut more.states);
    }
    store.commit(&loaded.fence, &[change]).durable().await.unwrap();

    for order_by in ["number desc", "cost"] {
        let mut request = wire::QueryTrialsRequest {
            study: "studies/hall".to_owned(),
            order_by: order_by.to_owned(),
            page_size: 1000,
            ..wire::QueryTrialsRequest::default()
        };
        let mut sizes = Vec::new();
        let mut names = BTreeSet::new();
        loop {
            let page = client.query_trials(request.clone()).await.unwrap().into_inner();
            sizes.push(page.trials.len());
            names.extend(page.trials.into_iter().map(|trial| trial.name));
            if page.next_page_token.is_empty() {
                break;
            }
            request.page_token = page.next_page_token;
        }
        assert_eq!(sizes.len(), 2, "{sizes:?}");
        assert_eq!(sizes.iter().sum::<usize>() as u64, COUNT);
        assert_eq!(names.len() as u64, COUNT);
    }
}

/// A measured trial of the default configuration.
async fn measured(client: &mut Client, ms: f64) -> wire::Trial {
    let request = wire::SuggestRequest { wanted: Some(configuration(8, "low")), ..ask("a", 10.0) };
    let trial = client.suggest(request).await.expect("a trial").into_inner();
    done(client, &trial.name, ms).await;
    trial
}

fn exclude(trial: &wire::Trial, reason: &str) -> wire::ExcludeTrialRequest {
    let (trial, reason, include) = (trial.name.clone(), reason.to_owned(), reason.is_empty());
    wire::ExcludeTrialRequest { trial, reason, include }
}

async fn best(client: &mut Client) -> wire::Best {
    client.get_best(common::best()).await.expect("something was measured").into_inner()
}

#[tokio::test]
async fn no_answer_rests_on_what_is_excluded() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("studies.db");
    let server = Server::on_disk(&path, START_MS).await;
    let mut client = server.client().await;
    create(&mut client, "hall").await;
    let good = measured(&mut client, 5.0).await;
    let wrong = measured(&mut client, 7.0).await;
    let both = best(&mut client).await;
    assert_eq!((both.measurements, &both.trial), (2, &wrong.name));
    let before = client.report(report(&wrong.name, 7.0)).await.expect("a duplicate").into_inner();

    let request = exclude(&wrong, "the clock was wrong");
    let excluded = client.exclude_trial(request.clone()).await.expect("excluded").into_inner();
    assert_eq!(excluded.exclusion, "the clock was wrong");
    let again = client.exclude_trial(request).await.expect("it is repeated").into_inner();
    assert_eq!(again, excluded);
    let one = best(&mut client).await;
    assert_eq!((one.measurements, one.cost, &one.trial), (1, 5.0, &good.name));
    let after = client.report(report(&wrong.name, 7.0)).await.expect("a duplicate").into_inner();
    let unmarked = wire::Trial { exclusion: String::new(), ..after.trial.expect("it comes back") };
    assert!(after.duplicate && before.trial == Some(unmarked));
    let study = "studies/hall".to_owned();
    let query =
        wire::QueryTrialsRequest { study, filter: "excluded = true".to_owned(), ..Default::default() };
    assert_eq!(client.query_trials(query).await.expect("a page").into_inner().trials, [excluded]);

    client.exclude_trial(exclude(&wrong, "")).await.expect("included");
    assert_eq!(best(&mut client).await.measurements, 2);
    client.exclude_trial(exclude(&wrong, "the clock was wrong")).await.expect("excluded");
    // The study goes on.
    for _ in 0..5 {
        let trial = client.suggest(ask("b", 10.0)).await.expect("a trial").into_inner();
        done(&mut client, &trial.name, 9.0).await;
    }

    let before = best(&mut client).await;
    server.stop().await;
    let server = Server::on_disk(&path, START_MS).await;
    let mut client = server.client().await;
    assert_eq!(best(&mut client).await, before);
    assert_eq!(get(&mut client, "studies/hall/trials/2").await.exclusion, "the clock was wrong");
    server.stop().await;
}

#[tokio::test]
async fn only_a_result_is_excluded_and_only_with_a_reason() {
    let (server, mut client) = Server::with_hall().await;
    let open = client.suggest(ask("a", 10.0)).await.expect("a trial").into_inner();
    assert_refused(client.exclude_trial(exclude(&open, "?")).await, Code::FailedPrecondition, "completed");
    done(&mut client, &open.name, 3.0).await;
    let bare = wire::ExcludeTrialRequest { include: false, ..exclude(&open, "") };
    assert_refused(client.exclude_trial(bare).await, Code::InvalidArgument, "reason");
    let both = wire::ExcludeTrialRequest { include: true, ..exclude(&open, "why") };
    assert_refused(client.exclude_trial(both).await, Code::InvalidArgument, "leave it out");
    let long = exclude(&open, &"x".repeat(501));
    assert_refused(client.exclude_trial(long).await, Code::InvalidArgument, "500");
    let missing = wire::Trial { name: "studies/hall/trials/9".to_owned(), ..open };
    assert_refused(client.exclude_trial(exclude(&missing, "?")).await, Code::NotFound, "9");
    server.stop().await;
}

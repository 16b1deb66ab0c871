//! A trial is excluded: it stays in the log, and no answer rests on it.

mod common;

use common::{
    Client, START_MS, Server, ask, assert_refused, configuration, create, done, get, report, triangles,
};
use tonic::Code;
use treewright_proto::v1::{self as wire};

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
    let request = wire::GetBestRequest {
        study: "studies/hall".to_owned(),
        indicators: triangles(10.0),
        ..Default::default()
    };
    client.get_best(request).await.expect("something was measured").into_inner()
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

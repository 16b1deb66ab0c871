//! Three replicas on one PostgreSQL: whichever is asked, the one that holds the study answers.

mod common;

use std::time::Duration;

use common::{Client, Server, ask, assert_refused, create, done, get, report, suggest};
use tonic::{Code, Request};
use treewright_proto::v1 as wire;
use treewright_test_postgres::Database;

async fn replicas(database: &Database) -> ([Server; 3], [Client; 3]) {
    let servers =
        [Server::replica(database).await, Server::replica(database).await, Server::replica(database).await];
    let clients = [servers[0].client().await, servers[1].client().await, servers[2].client().await];
    (servers, clients)
}

async fn frame(
    client: &mut Client,
    report: Option<wire::ReportRequest>,
    suggest: Option<wire::SuggestRequest>,
) -> wire::TuneResponse {
    let frames = tokio_stream::once(wire::TuneRequest { report, suggest });
    let mut answers = client.tune(frames).await.expect("a stream").into_inner();
    answers.message().await.expect("an answer").expect("one for each frame")
}

#[tokio::test]
async fn any_replica_answers_for_all() {
    let database = Database::create().await;
    let (servers, [mut first, mut second, mut third]) = replicas(&database).await;
    create(&mut first, "hall").await;
    create(&mut second, "hall").await;
    let mut names = Vec::new();
    for _ in 0..4 {
        let trial = suggest(&mut first, "a", 10.0).await;
        // The client comes back at another replica and finds its open trial.
        assert_eq!(suggest(&mut second, "a", 10.0).await.name, trial.name);
        let taken = done(&mut second, &trial.name, 5.0).await;
        assert!(!taken.duplicate);
        assert!(done(&mut third, &trial.name, 5.0).await.duplicate);
        assert_eq!(get(&mut third, &trial.name).await, taken.trial.expect("the stored trial"));
        names.push(trial.name);
    }
    let expected: Vec<String> = (1..=4).map(|number| format!("studies/hall/trials/{number}")).collect();
    assert_eq!(names, expected);

    // What changes a study, or rests on its tuner, finds its way as well.
    let best = wire::GetBestRequest { study: "studies/hall".to_owned(), ..wire::GetBestRequest::default() };
    assert!(
        third.get_best(best).await.expect("a best").into_inner().trial.starts_with("studies/hall/trials/")
    );
    let policy = wire::Policy { epsilon: Some(0.25), ..wire::Policy::default() };
    let study =
        wire::Study { name: "studies/hall".to_owned(), policy: Some(policy), ..wire::Study::default() };
    let update_mask = Some(prost_types::FieldMask { paths: vec!["policy.epsilon".to_owned()] });
    let request = wire::UpdateStudyRequest { study: Some(study), update_mask };
    let updated = third.update_study(request).await.expect("updated").into_inner();
    assert_eq!(updated.policy.expect("a policy").epsilon, Some(0.25));
    // An error of the holder's comes back as it was given.
    assert_refused(third.report(report("studies/hall/trials/99", 1.0)).await, Code::NotFound, "trial 99");
    for server in servers {
        server.stop().await;
    }
}

#[tokio::test]
async fn a_frame_of_two_studies_goes_two_ways() {
    let database = Database::create().await;
    let (servers, [mut first, mut second, mut third]) = replicas(&database).await;
    create(&mut first, "hall").await;
    create(&mut first, "sponza").await;
    let in_sponza = || wire::SuggestRequest { study: "studies/sponza".to_owned(), ..ask("a", 10.0) };
    let mut trial = suggest(&mut first, "a", 10.0).await;
    second.suggest(in_sponza()).await.expect("a trial");
    for client in [&mut third, &mut first, &mut second] {
        let answer = frame(client, Some(report(&trial.name, 3.0)), Some(in_sponza())).await;
        assert_eq!((&answer.report_error, &answer.suggest_error), (&None, &None));
        assert_eq!(answer.reported.expect("taken").trial.expect("the trial").name, trial.name);
        assert_eq!(answer.trial.expect("the open one").name, "studies/sponza/trials/1");
        let answer = frame(client, None, Some(ask("a", 10.0))).await;
        trial = answer.trial.expect("the next");
        assert!(trial.name.starts_with("studies/hall/"));
    }
    for server in servers {
        server.stop().await;
    }
}

#[tokio::test]
async fn a_replica_that_drains_leaves_its_studies_to_the_others() {
    let database = Database::create().await;
    let ([mut holder, second, third], [mut first, mut client, mut other]) = replicas(&database).await;
    create(&mut first, "hall").await;
    let trial = suggest(&mut first, "a", 10.0).await;
    suggest(&mut client, "b", 10.0).await;
    holder.begin_stop();
    // Asked while the holder goes: nothing is refused, whoever takes the study over.
    let reported = done(&mut client, &trial.name, 3.0).await;
    assert!(!reported.duplicate);
    assert!(done(&mut other, &trial.name, 3.0).await.duplicate);
    holder.stop().await;
    suggest(&mut other, "a", 10.0).await;
    second.stop().await;
    third.stop().await;
}

#[tokio::test]
async fn a_request_is_passed_on_once() {
    let database = Database::create().await;
    let (servers, [mut first, mut second, _]) = replicas(&database).await;
    create(&mut first, "hall").await;
    suggest(&mut first, "a", 10.0).await;
    let mut marked = Request::new(ask("b", 10.0));
    marked.metadata_mut().insert("treewright-forwarded", "1".parse().expect("a value"));
    let refused = second.suggest(marked).await;
    let status = refused.expect_err("not passed on again");
    assert_eq!(status.code(), Code::Unavailable);
    assert!(status.message().contains("is held by the replica at http://127.0.0.1:"), "{status}");
    // A study that is deleted through one replica is gone for the one that held it.
    let name = "studies/hall".to_owned();
    second.delete_study(wire::DeleteStudyRequest { name }).await.expect("deleted");
    tokio::time::timeout(Duration::from_secs(10), async {
        while first.suggest(ask("a", 10.0)).await.err().map(|status| status.code()) != Some(Code::NotFound) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await
    .expect("the holder hears of it");
    for server in servers {
        server.stop().await;
    }
}

//! Three replicas on one PostgreSQL: the one that holds the study answers requests to any of them.

mod common;

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use bytes::Bytes;
use common::{Client, Server, ask, assert_refused, create, done, get, report, suggest};
use http_body_util::StreamBody;
use hyper::body::{Frame, Incoming};
use hyper::server::conn::http2;
use hyper::service::service_fn;
use hyper_util::rt::{TokioExecutor, TokioIo};
use prost::Message as _;
use sqlx::Connection as _;
use tokio::net::TcpListener;
use tonic::{Code, Request};
use treewright_proto::v1 as wire;
use treewright_server::access::Access;
use treewright_server::clock::ManualClock;
use treewright_server::peers::FORWARDED;
use treewright_server::serve::Options;
use treewright_store::tokens::{Quota, Scope, Usage};
use treewright_store::{PostgresAddress, PostgresTokens, TokenStore};
use treewright_test_postgres::Database;

async fn replicas(database: &Database) -> ([Server; 3], [Client; 3]) {
    let servers =
        [Server::replica(database).await, Server::replica(database).await, Server::replica(database).await];
    let clients = [servers[0].client().await, servers[1].client().await, servers[2].client().await];
    (servers, clients)
}

/// The key that replicas show each other, read from the database.
async fn replica_key(database: &Database) -> String {
    let found = sqlx::query_scalar("SELECT key FROM replica_key");
    let key: Vec<u8> = found.fetch_one(&mut database.connect().await).await.expect("there is a key");
    format!("tw1_replicas_{}", URL_SAFE_NO_PAD.encode(key))
}

/// Says in the database that a replica is reached at another address.
async fn move_replica(url: String, from: String, to: String) {
    let mut connection = sqlx::PgConnection::connect(&url).await.expect("the server lets us in");
    let update = sqlx::query("UPDATE replicas SET address = $2 WHERE address = $1").bind(from).bind(to);
    let updated = update.execute(&mut connection).await.expect("updated");
    assert_eq!(updated.rows_affected(), 1);
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

    // Requests that change a study, or rest on its tuner, find their way as well.
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
    // Asked while the holder goes: no request is refused, and either replica may take the study over.
    let reported = done(&mut client, &trial.name, 3.0).await;
    assert!(!reported.duplicate);
    assert!(done(&mut other, &trial.name, 3.0).await.duplicate);
    holder.stop().await;
    suggest(&mut other, "a", 10.0).await;
    second.stop().await;
    third.stop().await;
}

/// A replica that is killed between the head of its answer and its message has not answered.
#[tokio::test]
async fn an_answer_that_breaks_off_is_sought_again() {
    let database = Database::create().await;
    let (holder, other) = (Server::replica(&database).await, Server::replica(&database).await);
    let (mut first, mut second) = (holder.client().await, other.client().await);
    create(&mut first, "hall").await;
    let trial = suggest(&mut first, "a", 10.0).await;
    // Something that breaks off stands in the holder's place until it is asked.
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let broken = format!("http://{}", listener.local_addr().expect("an address"));
    let held = format!("http://{}", holder.address);
    let url = database.url().to_owned();
    move_replica(url.clone(), held.clone(), broken.clone()).await;
    let breaking = tokio::spawn(async move {
        let (stream, _) = listener.accept().await.expect("it is asked");
        let head = service_fn(move |_: http::Request<Incoming>| {
            let moved = move_replica(url.clone(), broken.clone(), held.clone());
            async move {
                moved.await;
                let never = tokio_stream::pending::<Result<Frame<Bytes>, Infallible>>();
                Ok::<_, Infallible>(http::Response::new(StreamBody::new(never)))
            }
        });
        let served = http2::Builder::new(TokioExecutor::new()).serve_connection(TokioIo::new(stream), head);
        tokio::time::timeout(Duration::from_millis(500), served).await.expect_err("it is cut");
    });
    assert!(!done(&mut second, &trial.name, 3.0).await.duplicate);
    breaking.await.expect("it was asked");
    holder.stop().await;
    other.stop().await;
}

#[tokio::test]
async fn a_request_is_passed_on_once() {
    let database = Database::create().await;
    let (servers, [mut first, mut second, _]) = replicas(&database).await;
    create(&mut first, "hall").await;
    suggest(&mut first, "a", 10.0).await;
    let marked = |mark: &str| {
        let mut marked = Request::new(ask("b", 10.0));
        marked.metadata_mut().insert(FORWARDED, mark.parse().expect("a value"));
        marked
    };
    let key = replica_key(&database).await;
    let refused = second.suggest(marked(&key)).await;
    let status = refused.expect_err("not passed on again");
    assert_eq!(status.code(), Code::Unavailable);
    assert!(status.message().contains("is held by the replica at http://127.0.0.1:"), "{status}");
    // A client that only says that it is a replica is treated as a client.
    for lie in ["1", "", &key[..key.len() - 1], "tw1_replicas_"] {
        second.suggest(marked(lie)).await.expect("passed on");
    }
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

/// A replica that asks for tokens, and the tokens as it sees them.
async fn guarded(database: &Database) -> (Server, Arc<Access>, Arc<PostgresTokens>) {
    let clock = Arc::new(ManualClock::at(common::START_MS));
    let address = PostgresAddress::parse(database.url()).expect("an address");
    let tokens = Arc::new(PostgresTokens::open(&address, Duration::ZERO).await.expect("a database"));
    let access = Access::open(Arc::clone(&tokens) as _, Arc::clone(&clock) as _).await.expect("opened");
    let access = Arc::new(access);
    let options =
        Options { drain: Duration::from_secs(5), access: Some(Arc::clone(&access)), ..Options::default() };
    (Server::replica_with(database, clock, options).await, access, tokens)
}

#[tokio::test]
async fn what_is_passed_on_counts_once_and_quotas_are_one_for_all_replicas() {
    let database = Database::create().await;
    let (first, first_access, tokens) = guarded(&database).await;
    let (second, second_access, _) = guarded(&database).await;
    let quota = Quota { trials: Some(6), ..Quota::default() };
    let (token, record) = common::token(Scope::Tune, Vec::new(), quota);
    tokens.create(&record).await.expect("stored");
    for access in [&first_access, &second_access] {
        access.refresh().await.expect("read");
    }
    let show = |message: wire::SuggestRequest, mark: Option<&str>| {
        let mut request = Request::new(message);
        let bearer = format!("Bearer {}", token.text()).parse().expect("a header");
        request.metadata_mut().insert("authorization", bearer);
        if let Some(mark) = mark {
            request.metadata_mut().insert(FORWARDED, mark.parse().expect("a value"));
        }
        request
    };
    let (mut holder, mut other) = (first.client().await, second.client().await);
    let mut creation = Request::new(common::creation("hall", common::study()));
    let bearer = format!("Bearer {}", token.text()).parse().expect("a header");
    creation.metadata_mut().insert("authorization", bearer);
    let mut bytes = creation.get_ref().encoded_len() as u64;
    holder.create_study(creation).await.expect("created");

    // The first makes its replica the holder. The others go through the second under any claimed identity;
    // one of them in a frame.
    holder.suggest(show(ask("a", 1.0), None)).await.expect("a trial");
    other.suggest(show(ask("b", 1.0), None)).await.expect("a trial");
    other.suggest(show(ask("c", 1.0), Some("1"))).await.expect("a trial");
    let in_frame = wire::TuneRequest { report: None, suggest: Some(ask("d", 1.0)) };
    bytes += in_frame.encoded_len() as u64 + 3 * ask("a", 1.0).encoded_len() as u64;
    let mut stream = show(ask("d", 1.0), None).map(|_| tokio_stream::once(in_frame));
    stream.metadata_mut().insert(FORWARDED, "1".parse().expect("a value"));
    let mut answers = other.tune(stream).await.expect("a stream").into_inner();
    assert!(answers.message().await.expect("an answer").expect("one").trial.is_some());
    for access in [&first_access, &second_access] {
        access.save().await;
    }
    let (used, _) = tokens.usage(token.id(), 0).await.expect("read");
    assert_eq!(used, Usage { studies: 1, trials: 4, bytes });

    // After two more trials the quota is used up at every replica.
    for client in ["e", "f"] {
        other.suggest(show(ask(client, 1.0), None)).await.expect("a trial");
    }
    for access in [&first_access, &second_access] {
        access.save().await;
    }
    for client in [&mut holder, &mut other] {
        assert_refused(client.suggest(show(ask("g", 1.0), None)).await, Code::ResourceExhausted, "6 trials");
    }
    // Without a token not even a replica gets in.
    let mut bare = Request::new(ask("h", 1.0));
    let key = replica_key(&database).await;
    bare.metadata_mut().insert(FORWARDED, key.parse().expect("a value"));
    assert_refused(holder.suggest(bare).await, Code::Unauthenticated, "no token");
    first.stop().await;
    second.stop().await;
}

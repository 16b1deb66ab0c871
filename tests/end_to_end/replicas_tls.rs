//! Two daemons on one PostgreSQL, with mutual TLS between them and tokens in the database. Both answer a
//! client, also the daemon that does not hold the study. A request that is passed on counts once. Once the
//! client's token is revoked, neither daemon answers.

use std::path::{Path, PathBuf};

use tonic::transport::{Certificate, Channel, ClientTlsConfig, Identity};
use tonic::{Code, Request};
use treewright_proto::v1 as pb;
use treewright_test_postgres::Database;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr, stdout};

use crate::guard::{self, Authority, Caller, in_force, until};
use crate::site::wait_until;
use crate::wire;

/// A daemon with a certificate of an authority, which asks for certificates of that authority.
fn replica(folder: &Path, name: &str, authority: &Authority, database: &str) -> Daemon {
    let (certificate, key) = authority.issue("replica.example");
    let file = |kind: &str, text: &str| {
        let path = folder.join(format!("{name}-{kind}"));
        std::fs::write(&path, text).expect("a scratch file");
        path.to_string_lossy().into_owned()
    };
    let (certificate, key) = (file("cert.pem", &certificate), file("key.pem", &key));
    let authority = file("ca.pem", &authority.pem);
    let arguments = [
        ["--tls-cert", &certificate],
        ["--tls-key", &key],
        ["--tls-client-ca", &authority],
        ["--peer-name", "replica.example"],
        ["--log", "trace"],
    ];
    let arguments: Vec<&str> = arguments.iter().flatten().copied().chain(["--tokens"]).collect();
    Daemon::start_with(Path::new(database), &arguments, &log(folder, name))
}

fn log(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!("{name}-log"))
}

async fn caller(daemon: &Daemon, authority: &Authority, token: Option<&str>) -> Caller {
    let (certificate, key) = authority.issue("client");
    let tls = ClientTlsConfig::new()
        .ca_certificate(Certificate::from_pem(&authority.pem))
        .identity(Identity::from_pem(certificate, key))
        .domain_name("replica.example");
    let channel = Channel::from_shared(daemon.url().to_owned()).expect("an address");
    let channel = channel.tls_config(tls).expect("TLS").connect().await.expect("a connection");
    guard::caller(channel, token)
}

fn token_command(database: &str, command: &str, arguments: &[&str]) -> String {
    let output = run("treewrightd", &[&["token", command, "--database", database], arguments].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    stdout(&output).trim().to_owned()
}

#[tokio::test]
async fn a_token_and_a_study_are_good_at_every_replica() {
    let database = Database::create().await;
    let folder = tempfile::tempdir().expect("a scratch folder");
    let authority = Authority::new();
    let holder = replica(folder.path(), "holder", &authority, database.url());
    let other = replica(folder.path(), "other", &authority, database.url());
    let create = ["--name", "a farm", "--scope", "tune", "--max-trials", "100"];
    let token = token_command(database.url(), "create", &create);
    let mut at_holder = caller(&holder, &authority, Some(&token)).await;
    let mut at_other = caller(&other, &authority, Some(&token)).await;
    let list = pb::ListStudiesRequest::default;
    in_force(&mut at_holder).await;
    in_force(&mut at_other).await;

    let creation = pb::CreateStudyRequest { study_id: "hall".to_owned(), study: Some(wire::study()) };
    let name = at_holder.create_study(creation).await.expect("created").into_inner().name;
    at_holder.suggest(wire::suggestion(&name, "a", 0.1)).await.expect("a trial");
    for round in 0..5 {
        let mut asked = Request::new(wire::suggestion(&name, "b", 0.2));
        asked.metadata_mut().insert("x-request-id", format!("round-{round}").parse().expect("an id"));
        let trial = at_other.suggest(asked).await.expect("passed on").into_inner();
        at_other.report(wire::report(&trial)).await.expect("passed on");
    }
    let frame = |report| pb::TuneRequest { report, suggest: Some(wire::suggestion(&name, "c", 0.3)) };
    let (frames, sent) = tokio::sync::mpsc::channel(1);
    let stream = at_other.tune(tokio_stream::wrappers::ReceiverStream::new(sent)).await.expect("a stream");
    let mut answers = stream.into_inner();
    let mut previous = None;
    for _ in 0..5 {
        frames.send(frame(previous.take())).await.expect("sent");
        let answer = answers.message().await.expect("an answer").expect("one for each frame");
        assert_eq!((answer.report_error, answer.suggest_error), (None, None));
        previous = answer.trial.as_ref().map(wire::report);
    }

    // Each trial was counted once, wherever it was asked for: by the replica that handed it out.
    wait_until("eleven trials are counted", || {
        let listed = token_command(database.url(), "list", &["--json"]);
        let listed: serde_json::Value = serde_json::from_str(&listed).expect("JSON");
        listed[0]["used"]["trials"] == 11
    });

    // Revoked on the command line, it is good nowhere, also on the stream that is open.
    let id = token.split('_').nth(1).expect("an id");
    token_command(database.url(), "revoke", &[id]);
    let ended = |answer: &Result<_, tonic::Status>| {
        answer.as_ref().is_err_and(|status: &tonic::Status| status.code() == Code::Unauthenticated)
    };
    until("the end of the token", async || at_holder.list_studies(list()).await, ended).await;
    until("the end of the token", async || at_other.list_studies(list()).await, ended).await;
    frames.send(frame(previous)).await.expect("sent");
    assert_eq!(answers.message().await.expect_err("over").code(), Code::Unauthenticated);

    assert!(holder.terminate().success() && other.terminate().success());
    let logs =
        ["holder", "other"].map(|name| std::fs::read_to_string(log(folder.path(), name)).expect("a log"));
    // Its own text may have underscores.
    let secret = token.splitn(3, '_').nth(2).expect("a secret");
    let key = "tw1_replicas_";
    for log in &logs {
        assert!(!log.contains(secret), "the token's secret stands in a log");
        for (place, _) in log.match_indices(key) {
            assert!(log[place + key.len()..].starts_with('*'), "the replicas' key stands in a log");
        }
    }
    // A request that is passed on is no refusal, and has one name at both replicas.
    let refusals = logs[1].lines().filter(|line| line.contains("request refused"));
    assert!(refusals.clone().all(|line| line.contains("token")), "{:?}", refusals.collect::<Vec<_>>());
    assert!(logs.iter().all(|log| log.contains("round-3")));
}

#[tokio::test]
async fn nothing_is_passed_on_to_a_replica_with_a_wrong_certificate() {
    let database = Database::create().await;
    let folder = tempfile::tempdir().expect("a scratch folder");
    let (authority, strangers) = (Authority::new(), Authority::new());
    let stranger = replica(folder.path(), "stranger", &strangers, database.url());
    let ours = replica(folder.path(), "ours", &authority, database.url());
    let token = token_command(database.url(), "create", &["--name", "a farm", "--scope", "tune"]);
    let mut there = caller(&stranger, &strangers, Some(&token)).await;
    let mut here = caller(&ours, &authority, Some(&token)).await;
    let create = || pb::CreateStudyRequest { study_id: "hall".to_owned(), study: Some(wire::study()) };
    until("the token", async || there.create_study(create()).await, Result::is_ok).await;
    there.suggest(wire::suggestion("studies/hall", "a", 0.1)).await.expect("a trial");

    until("the token", async || here.create_study(create()).await, Result::is_ok).await;
    let refused = here.suggest(wire::suggestion("studies/hall", "b", 0.2)).await.expect_err("not passed on");
    assert_eq!(refused.code(), Code::Unavailable, "{refused}");
    let said = std::fs::read_to_string(log(folder.path(), "ours")).expect("a log");
    let warnings: Vec<&str> =
        said.lines().filter(|line| line.contains("a replica does not answer")).collect();
    assert_eq!(warnings.len(), 1, "said once, however often it was tried: {warnings:?}");
    assert!(warnings[0].contains("certificate"), "{warnings:?}");
}

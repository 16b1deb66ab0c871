//! Attempts that the daemon must refuse, against the real program over real TLS, with the status of each
//! refusal. Those with tokens alone are in `server/tests/access.rs`.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use tonic::transport::{Certificate, Channel, ClientTlsConfig, Identity};
use tonic::{Code, Status};
use treewright_proto::v1 as pb;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_tests::programs::{program, run, stderr, token};

use crate::guard::{self, Authority, Caller, in_force, until};
use crate::site::{Site, path_text, wait_until};
use crate::wire;

/// A daemon behind TLS and tokens.
struct Guarded {
    site: Site,
    authority: Authority,
}

impl Guarded {
    fn start(more: &[&str]) -> Self {
        let folder = tempfile::tempdir().expect("a scratch folder");
        let authority = Authority::new();
        let (certificate, key) = authority.issue("localhost");
        let certificate = write(folder.path(), "cert.pem", &certificate);
        let key = write(folder.path(), "key.pem", &key);
        write(folder.path(), "ca.pem", &authority.pem);
        let tls = ["--tls-cert", &certificate, "--tls-key", &key, "--tokens", "--log", "trace"];
        Self { site: Site::within(folder, &[&tls[..], more].concat()), authority }
    }

    /// Makes a token with the command line, beside the running daemon.
    fn token(&self, arguments: &[&str]) -> String {
        token(&self.site.database(), arguments)
    }

    fn tls(&self) -> ClientTlsConfig {
        ClientTlsConfig::new()
            .ca_certificate(Certificate::from_pem(&self.authority.pem))
            .domain_name("localhost")
    }

    async fn channel(&self, tls: ClientTlsConfig) -> Result<Channel, tonic::transport::Error> {
        let endpoint = Channel::from_shared(self.site.url().to_owned()).expect("an address");
        endpoint.tls_config(tls).expect("TLS").connect().await
    }

    async fn caller(&self, token: Option<&str>) -> Caller {
        let channel = self.channel(self.tls()).await.expect("a connection");
        guard::caller(channel, token)
    }
}

fn write(folder: &Path, name: &str, text: &str) -> String {
    let path = folder.join(name);
    std::fs::write(&path, text).expect("a scratch file");
    path_text(&path).to_owned()
}

fn list() -> pb::ListStudiesRequest {
    pb::ListStudiesRequest::default()
}

#[tokio::test]
async fn every_attempt_is_refused_with_the_right_status_and_no_secret_is_in_the_log() {
    let guarded = Guarded::start(&[]);
    let admin = guarded.token(&["--scope", "admin"]);
    let mut owner = guarded.caller(Some(&admin)).await;
    in_force(&mut owner).await;
    let study = Some(wire::study());
    let creation = pb::CreateStudyRequest { study_id: "open".into(), study };
    owner.create_study(creation).await.expect("created");
    let wrong =
        format!("{}{}", &admin[..admin.len() - 4], if admin.ends_with("AAAA") { "BBBB" } else { "AAAA" });
    let status = guarded.caller(Some(&wrong)).await.list_studies(list()).await.expect_err("a wrong secret");
    assert_eq!(status.code(), Code::Unauthenticated, "{status}");

    // (attempt, status, expected status)
    let mut table: Vec<(&str, Option<Status>, Code)> = Vec::new();
    let query = |filter: &str| pb::QueryTrialsRequest {
        study: "studies/open".into(),
        filter: filter.to_owned(),
        ..pb::QueryTrialsRequest::default()
    };
    for (attempt, filter) in [
        ("a filter that ends the statement", "state = COMPLETED; DROP TABLE trials"),
        ("a filter with a subquery", "number = (SELECT 1)"),
        ("a filter with OR", "number = 1 OR 1 = 1"),
        ("a filter with a comment", "number = 1 -- "),
        ("a filter with a function", "cost < load_extension(\"x\")"),
        ("a filter with a JSON path", "config.a\")) OR (\"1 = 1"),
        ("a filter with text that is not closed", "client_id = \"x"),
        ("a filter with a quoted quote", "client_id = 'x' OR 'a' = 'a'"),
    ] {
        table.push((attempt, owner.query_trials(query(filter)).await.err(), Code::InvalidArgument));
    }
    let order = pb::QueryTrialsRequest { order_by: "cost; DROP TABLE trials".into(), ..query("") };
    let status = owner.query_trials(order).await.err();
    table.push(("an order that ends the statement", status, Code::InvalidArgument));
    let injected = pb::GetStudyRequest { name: "studies/x' OR '1'='1".into() };
    table.push(("a name with a quote", owner.get_study(injected).await.err(), Code::InvalidArgument));
    let mut wide = wire::study();
    let parameter = wide.space.as_ref().expect("a space").parameters[0].clone();
    wide.space.as_mut().expect("a space").parameters =
        (0..1000).map(|number| pb::Parameter { name: format!("p{number}"), ..parameter.clone() }).collect();
    let thousand = pb::CreateStudyRequest { study_id: "wide".into(), study: Some(wide.clone()) };
    table.push(("a thousand parameters", owner.create_study(thousand).await.err(), Code::InvalidArgument));
    wide.space.as_mut().expect("a space").parameters = vec![pb::Parameter::default(); 1_000_000];
    let million = pb::CreateStudyRequest { study_id: "wide".into(), study: Some(wide) };
    table.push(("a million parameters", owner.create_study(million).await.err(), Code::OutOfRange));
    for (attempt, status, code) in &table {
        let came = status.as_ref().map(Status::code);
        assert_eq!(came, Some(*code), "{attempt}: {status:?}");
    }
    // After all that the daemon serves, and nothing was dropped.
    assert!(owner.list_studies(list()).await.expect("a list").into_inner().studies.len() == 1);

    // No attempt has brought a secret into the log, even at its finest level.
    let file = guarded.site.file("log");
    assert!(guarded.site.daemon.terminate().success());
    let log = std::fs::read_to_string(file).expect("a log");
    assert!(log.contains("request refused") && log.contains("TRACE"), "the log is fine enough to tell");
    for token in [&admin, &wrong] {
        let secret = token.splitn(3, '_').nth(2).expect("a secret");
        assert!(!log.contains(secret), "the secret of {} is in the log", &token[..16]);
    }
}

#[tokio::test]
async fn plain_text_strangers_and_a_slow_loris_end_quickly_and_hold_up_nobody() {
    let guarded = Guarded::start(&[]);
    let start = Instant::now();
    // Plain HTTP/2 against TLS: an alert or an end, and soon.
    let mut plain = TcpStream::connect(guarded.site.daemon.address()).expect("a connection");
    plain.set_read_timeout(Some(Duration::from_secs(10))).expect("set");
    plain.write_all(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n").expect("sent");
    let mut answer = Vec::new();
    // The end may be a reset.
    let _ = plain.read_to_end(&mut answer);
    assert!(!answer.starts_with(b"HTTP") && answer.len() < 64, "{answer:?}");
    let insecure = TuningServiceClient::connect(guarded.site.url().replace("https", "http")).await;
    if let Ok(mut insecure) = insecure {
        insecure.list_studies(list()).await.expect_err("refused");
    }
    assert!(start.elapsed() < Duration::from_secs(10), "it took {:?}", start.elapsed());

    // A client that trusts another authority does not go on.
    let stranger = ClientTlsConfig::new()
        .ca_certificate(Certificate::from_pem(Authority::new().pem))
        .domain_name("localhost");
    assert!(guarded.channel(stranger).await.is_err());

    let start = Instant::now();
    let mut idle: Vec<TcpStream> = (0..200)
        .map(|_| {
            let stream = TcpStream::connect(guarded.site.daemon.address()).expect("a connection");
            stream.set_read_timeout(Some(Duration::from_secs(30))).expect("set");
            stream
        })
        .collect();
    // A byte now and then does not help.
    for stream in &mut idle {
        stream.write_all(b"\x16").expect("sent");
    }
    let mut end = [0; 16];
    for stream in &mut idle {
        assert!(matches!(stream.read(&mut end), Ok(0) | Err(_)), "it was answered");
    }
    assert!(start.elapsed() < Duration::from_secs(25), "they were kept for {:?}", start.elapsed());
    let status = guarded.caller(None).await.list_studies(list()).await;
    assert_eq!(status.expect_err("no token").code(), Code::Unauthenticated, "it serves");
}

#[tokio::test]
async fn a_client_without_the_right_certificate_is_refused() {
    // The authority of the clients is another one than the daemon's.
    let (clients, folder) = (Authority::new(), tempfile::tempdir().expect("a scratch folder"));
    let file = write(folder.path(), "clients.pem", &clients.pem);
    let guarded = Guarded::start(&["--tls-client-ca", &file]);
    let token = guarded.token(&["--scope", "read"]);
    let ask = async |tls: ClientTlsConfig| {
        let channel = guarded.channel(tls).await.map_err(|error| Status::unavailable(error.to_string()))?;
        guard::caller(channel, Some(&token)).list_studies(list()).await
    };
    assert!(ask(guarded.tls()).await.is_err(), "no certificate");
    let (certificate, key) = guarded.authority.issue("client");
    let foreign = guarded.tls().identity(Identity::from_pem(certificate, key));
    assert!(ask(foreign).await.is_err(), "another authority's");
    let (certificate, key) = clients.issue("client");
    let good = guarded.tls().identity(Identity::from_pem(certificate, key));
    until("the right certificate", async || ask(good.clone()).await, Result::is_ok).await;
}

#[tokio::test]
async fn certificates_are_renewed_without_a_restart() {
    let guarded = Guarded::start(&[]);
    let token = guarded.token(&["--scope", "read"]);
    let mut before = guarded.caller(Some(&token)).await;
    in_force(&mut before).await;

    // A broken certificate changes nothing.
    guarded.site.write("cert.pem", "no certificate");
    guarded.site.daemon.signal("HUP");
    let said = || guarded.site.log().contains("the old ones stay in force");
    wait_until("the broken certificate is reported", said);
    guarded.caller(Some(&token)).await.list_studies(list()).await.expect("the old one serves");

    // A new one, of a new authority: the key first, as a careless operator would.
    let other = Authority::new();
    let (certificate, key) = other.issue("localhost");
    guarded.site.write("key.pem", &key);
    guarded.site.write("cert.pem", &certificate);
    let tls =
        || ClientTlsConfig::new().ca_certificate(Certificate::from_pem(&other.pem)).domain_name("localhost");
    let connect =
        async || guarded.channel(tls()).await.map_err(|error| Status::unavailable(error.to_string()));
    until("the new certificate comes into force", connect, Result::is_ok).await;
    before.list_studies(list()).await.expect("who was connected stays so");
}

#[tokio::test]
async fn the_command_line_client_shows_token_and_checks_certificate() {
    let guarded = Guarded::start(&[]);
    let token = guarded.token(&["--scope", "read"]);
    let mut caller = guarded.caller(Some(&token)).await;
    in_force(&mut caller).await;
    let token_file = guarded.site.write("token", &format!("{token}\n"));
    let url = guarded.site.url().replace("127.0.0.1", "localhost");
    let ca = guarded.site.path("ca.pem");
    let good =
        run("treewright", &["studies", "--server", &url, "--tls-ca", &ca, "--token-file", &token_file]);
    assert!(good.status.success(), "{}", stderr(&good));
    let without = run("treewright", &["studies", "--server", &url, "--tls-ca", &ca]);
    assert_eq!(without.status.code(), Some(1), "{}", stderr(&without));
    let said = stderr(&without);
    assert!(said.contains("token") && said.contains("Unauthenticated"), "{said}");
    let untrusted = run("treewright", &["studies", "--server", &url, "--token-file", &token_file]);
    assert_eq!(untrusted.status.code(), Some(3), "{}", stderr(&untrusted));
    let plain = run("treewright", &["studies", "--server", "http://localhost:1", "--tls-ca", &ca]);
    assert_eq!(plain.status.code(), Some(2), "{}", stderr(&plain));
    assert!(stderr(&plain).contains("certificate authority"), "{}", stderr(&plain));
    // An authority in the environment is for another daemon than the one that is named.
    for (name, asks) in [("treewright", "ping"), ("treewright-render", "best --scene builtin:quick")] {
        let mut command = Command::new(program(name));
        command.args(asks.split(' ')).args(["--server", "http://localhost:1"]).env("TREEWRIGHT_TLS_CA", &ca);
        let absent = command.output().expect("it starts");
        assert_eq!(absent.status.code(), Some(3), "{name}: {}", stderr(&absent));
        command.arg("--tls-ca").arg(&ca);
        let refused = command.output().expect("it starts");
        assert_eq!(refused.status.code(), Some(2), "{name}: {}", stderr(&refused));
    }
}

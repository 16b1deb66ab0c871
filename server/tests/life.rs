//! The server's life: restarts, failing disks, health, reflection, draining, and what monitoring sees of it.

mod common;

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use common::{Client, START_MS, Server, create, done, report, suggest};
use tokio::net::TcpListener;
use tokio_stream::StreamExt as _;
use tonic::Code;
use tonic_health::pb::health_client::HealthClient;
use tonic_health::pb::{HealthCheckRequest, health_check_response::ServingStatus};
use tonic_reflection::pb::v1::ServerReflectionRequest;
use tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient;
use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
use treewright_proto::v1 as wire;
use treewright_server::admission::AdmissionLimits;
use treewright_server::clock::ManualClock;
use treewright_server::connections::ConnectionLimits;
use treewright_server::listeners::Listeners;
use treewright_server::serve::{self, Options};
use treewright_store::{Faults, MemoryStore, SqliteStore, Store};

/// Rounds of one client: the names and configurations it gets.
async fn rounds(client: &mut Client, count: u32) -> Vec<(String, Option<wire::Configuration>)> {
    let mut seen = Vec::new();
    for round in 0..count {
        let trial = suggest(client, "a", 10.0).await;
        done(client, &trial.name, f64::from(20 - round % 7)).await;
        seen.push((trial.name, trial.configuration));
    }
    seen
}

#[tokio::test]
async fn a_restarted_server_goes_on_with_the_same_suggestions() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("studies.db");
    // One server that never stops is the oracle.
    let (_steady, mut client) = Server::with_hall().await;
    let expected = rounds(&mut client, 40).await;

    let mut found = Vec::new();
    for stretch in 0..4 {
        let (server, mut client) = Server::on_disk_with_hall(&path).await;
        // The costs go on where they stood: 10 is no multiple of their period.
        for round in 0..10 {
            let trial = suggest(&mut client, "a", 10.0).await;
            let render_ms = f64::from(20 - (stretch * 10 + round) % 7);
            done(&mut client, &trial.name, render_ms).await;
            found.push((trial.name, trial.configuration));
        }
        drop(client);
        server.stop().await;
    }
    assert_eq!(found, expected);
}

#[tokio::test]
async fn an_open_trial_survives_a_restart() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("studies.db");
    let (server, mut client) = Server::on_disk_with_hall(&path).await;
    let held = suggest(&mut client, "a", 10.0).await;
    let lost = suggest(&mut client, "b", 10.0).await;
    drop(client);
    server.stop().await;

    let server = Server::on_disk(&path, START_MS + 1000).await;
    let mut client = server.client().await;
    let again = suggest(&mut client, "a", 10.0).await;
    assert_eq!((again.name, again.configuration), (held.name.clone(), held.configuration));
    assert!(!done(&mut client, &held.name, 4.0).await.duplicate);
    assert!(!done(&mut client, &lost.name, 5.0).await.duplicate);
    drop(client);
    server.stop().await;

    // The third start is long after; no acknowledged change is missing.
    let server = Server::on_disk(&path, START_MS + 1_000_000).await;
    let mut client = server.client().await;
    assert!(done(&mut client, &held.name, 9.0).await.duplicate);
    drop(client);
    server.stop().await;
}

/// Serves until that ends by itself, with an error.
async fn ends(listeners: impl Into<Listeners>, faults: Faults) {
    let clock = Arc::new(ManualClock::at(START_MS));
    let (drain, never) = (Duration::from_millis(100), std::future::pending());
    let served = serve::run(listeners, Arc::new(MemoryStore::with(faults)) as _, clock as _, drain, never);
    let served = tokio::time::timeout(Duration::from_secs(30), served).await.expect("it ends by itself");
    assert!(matches!(served, Err(serve::ServeError::Task)), "{served:?}");
}

#[tokio::test]
async fn a_daemon_whose_writer_has_met_a_defect_ends_with_an_error() {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    ends(listener, Faults { broken: true.into(), failed: true, ..Faults::default() }).await;
}

/// So ends a server whose last listener met a defect: an end without an error would not be started again.
#[tokio::test]
async fn a_daemon_that_nobody_can_reach_any_more_ends_with_an_error() {
    ends(Listeners::default(), Faults::default()).await;
}

#[tokio::test]
async fn nothing_is_acknowledged_that_could_not_be_stored() {
    let store = Arc::new(MemoryStore::new());
    let server = Server::with(Arc::clone(&store) as _, START_MS).await;
    let mut client = server.client().await;
    create(&mut client, "hall").await;
    let held = suggest(&mut client, "a", 10.0).await;

    store.faults.broken.store(true, Ordering::SeqCst);
    let status = client.report(report(&held.name, 4.0)).await.unwrap_err();
    assert_eq!(status.code(), Code::Unavailable);
    assert!(status.message().contains("disk is full"), "{status}");
    let status = client.suggest(common::ask("b", 10.0)).await.unwrap_err();
    assert_eq!(status.code(), Code::Unavailable);

    // With the disk back, the tuner equals the store: the report is new, the number is free.
    store.faults.broken.store(false, Ordering::SeqCst);
    assert!(!done(&mut client, &held.name, 4.0).await.duplicate);
    let next = suggest(&mut client, "b", 10.0).await;
    assert_eq!(next.name, "studies/hall/trials/2");
}

#[tokio::test]
async fn health_and_reflection_answer() {
    let mut server = Server::in_memory().await;
    let channel = server.channel().await;
    let mut health = HealthClient::new(channel.clone());
    for service in ["", "treewright.v1.TuningService"] {
        let service = service.to_owned();
        let answer = health.check(HealthCheckRequest { service }).await.unwrap();
        assert_eq!(answer.into_inner().status(), ServingStatus::Serving);
    }

    let list = ServerReflectionRequest {
        host: String::new(),
        message_request: Some(MessageRequest::ListServices(String::new())),
    };
    let mut reflection = ServerReflectionClient::new(channel.clone());
    let mut answers =
        reflection.server_reflection_info(tokio_stream::iter([list])).await.unwrap().into_inner();
    let answer = answers.message().await.unwrap().unwrap();
    let Some(MessageResponse::ListServicesResponse(list)) = answer.message_response else {
        panic!("not a list of services");
    };
    let names: Vec<_> = list.service.into_iter().map(|service| service.name).collect();
    assert!(names.contains(&"treewright.v1.TuningService".to_owned()), "{names:?}");
    assert!(names.contains(&"grpc.health.v1.Health".to_owned()), "{names:?}");
    drop(answers);

    // A watcher sees the end coming, and does not hold it up.
    let service = String::new();
    let mut watch = health.watch(HealthCheckRequest { service }).await.unwrap().into_inner();
    let first = watch.next().await.unwrap().unwrap();
    assert_eq!(first.status(), ServingStatus::Serving);
    server.begin_stop();
    let second = watch.next().await.unwrap().unwrap();
    assert_eq!(second.status(), ServingStatus::NotServing);
    drop((health, reflection, channel));
    assert!(watch.next().await.is_none());
    server.stop().await;
}

async fn ask(address: SocketAddr, method: &str, path: &str) -> String {
    common::exchange(address, &format!("{method} {path} HTTP/1.1\r\nhost: here\r\n\r\n")).await
}

fn value(text: &str, figure: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix(figure));
    line.map(|value| value.trim().parse().expect("a number"))
}

#[tokio::test]
async fn figures_follow_what_happens_and_readiness_follows_the_database() {
    let watch = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = watch.local_addr().expect("an address");
    let store = Arc::new(MemoryStore::new());
    let options = Options { drain: Duration::from_secs(5), watch: Some(watch), ..Options::default() };
    let clock = Arc::new(ManualClock::at(START_MS));
    let server = Server::with_options(Arc::clone(&store) as _, clock, options).await;
    let mut client = server.client().await;
    create(&mut client, "hall").await;
    let missing = wire::GetStudyRequest { name: "studies/none".into() };
    assert_eq!(client.get_study(missing).await.expect_err("none").code(), Code::NotFound);

    let text = ask(address, "GET", "/metrics").await;
    assert!(text.starts_with("HTTP/1.1 200") && text.contains("application/openmetrics-text"), "{text}");
    for figure in [
        "treewright_requests_total{rpc=\"CreateStudy\",code=\"OK\"}",
        "treewright_requests_total{rpc=\"GetStudy\",code=\"NOT_FOUND\"}",
        "treewright_request_seconds_count{rpc=\"GetStudy\"}",
        "treewright_refusals_total{reason=\"not_found\"}",
    ] {
        assert!(value(&text, figure).is_some_and(|value| value >= 1.0), "{figure} in\n{text}");
    }
    let failures = "treewright_refusals_total{reason=\"store\"}";
    assert_eq!(value(&text, failures), Some(0.0), "what is not there is no failure of the database");
    assert_eq!(value(&text, "treewright_store_queue "), Some(0.0));
    assert_eq!(value(&text, "treewright_draining "), Some(0.0));
    assert!(!text.contains("hall"), "no study is named");

    assert!(ask(address, "GET", "/readyz").await.ends_with("ready\n"));
    assert!(ask(address, "GET", "/other").await.starts_with("HTTP/1.1 404"));
    assert!(ask(address, "POST", "/metrics").await.starts_with("HTTP/1.1 405"));

    // Without its database the daemon is alive, but not ready.
    store.close().await;
    let ready = ask(address, "GET", "/readyz").await;
    assert!(ready.starts_with("HTTP/1.1 503"), "{ready}");
    assert!(ask(address, "GET", "/livez").await.starts_with("HTTP/1.1 200"));
    server.stop().await;
}

#[tokio::test]
async fn figures_of_studies_are_shown_of_a_few() {
    let watch = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = watch.local_addr().expect("an address");
    let options = Options {
        drain: Duration::from_secs(5),
        watch: Some(watch),
        studies_shown: 2,
        connections: ConnectionLimits::new(9, 9),
        admission: AdmissionLimits { requests: 8, streams: 7 },
        ..Options::default()
    };
    let clock = Arc::new(ManualClock::at(START_MS));
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("studies.db");
    let store = SqliteStore::open(&path).await.expect("a database");
    let server = Server::with_options(Arc::new(store), Arc::clone(&clock), options).await;
    let mut client = server.client().await;
    for study in ["attic", "cellar", "hall"] {
        create(&mut client, study).await;
        let wanted = wire::SuggestRequest { study: format!("studies/{study}"), ..common::ask("a", 10.0) };
        client.suggest(wanted).await.expect("a trial");
    }
    // Of two frames in one state the dearer is regretted.
    for cost in [4.0, 7.0] {
        let trial = suggest(&mut client, "a", 10.0).await;
        done(&mut client, &trial.name, cost).await;
    }
    clock.advance_ms(2_000);
    let text = ask(address, "GET", "/metrics").await;
    assert_eq!(value(&text, "treewright_study_trials{study=\"cellar\"}"), Some(1.0));
    assert_eq!(value(&text, "treewright_study_model_age_seconds{study=\"hall\"}"), Some(2.0));
    assert_eq!(value(&text, "treewright_study_unsaved_trials{study=\"hall\"}"), Some(2.0));
    let sum = |figure: &str| -> f64 {
        let start = format!("treewright_study_{figure}_total{{study=\"hall\",mode=");
        let lines = text.lines().filter_map(|line| line.strip_prefix(&start)?.split_once(' '));
        lines.map(|(_, value)| value.parse::<f64>().expect("a number")).sum()
    };
    assert_eq!((sum("frames"), sum("cost"), sum("regret")), (2.0, 11.0, 3.0), "{text}");
    assert!(!text.contains("attic"), "two were used since");

    assert_eq!(value(&text, "treewright_studies_in_memory "), Some(3.0));
    assert_eq!(value(&text, "treewright_open_leases "), Some(2.0), "those of the attic and of the cellar");
    for (figure, name) in [("database", "studies.db"), ("database_log", "studies.db-wal")] {
        let bytes = std::fs::metadata(folder.path().join(name)).expect("a file").len();
        assert_eq!(value(&text, &format!("treewright_{figure}_bytes ")), Some(bytes as f64), "{name}");
    }
    for (figure, most) in [("connections", 9.0), ("requests_in_flight", 8.0), ("tune_streams", 7.0)] {
        assert_eq!(value(&text, &format!("treewright_{figure}_limit ")), Some(most), "{figure}");
    }
    server.stop().await;
}

#[tokio::test]
async fn more_idle_clients_than_connections_take_turns() {
    const MOST: usize = 6;
    let watch = TcpListener::bind("127.0.0.1:0").await.expect("a port");
    let address = watch.local_addr().expect("an address");
    let connections = ConnectionLimits::new(MOST, MOST);
    let drain = Duration::from_secs(5);
    let options = Options { drain, watch: Some(watch), connections, ..Options::default() };
    let clock = Arc::new(ManualClock::at(START_MS));
    let server = Server::with_options(Arc::new(MemoryStore::new()), clock, options).await;
    let mut clients = Vec::new();
    for _ in 0..3 * MOST {
        let mut client = server.client().await;
        client.list_studies(wire::ListStudiesRequest::default()).await.expect("served");
        clients.push(client);
    }
    let text = ask(address, "GET", "/metrics").await;
    assert_eq!(value(&text, "treewright_connections "), Some(MOST as f64));
    let made_room = value(&text, "treewright_connections_lost_total{reason=\"made_room\"}");
    assert!(made_room >= Some(2.0 * MOST as f64), "{text}");
    for client in &mut clients {
        // The first answer may be that the connection is gone; the client connects again by itself.
        let mut is_served = false;
        for _ in 0..3 {
            is_served |= client.list_studies(wire::ListStudiesRequest::default()).await.is_ok();
        }
        assert!(is_served);
    }
    server.stop().await;
}

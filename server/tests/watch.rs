//! Monitoring: figures, liveness and readiness over a real socket.

mod common;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use common::{START_MS, Server, create, done, suggest};
use tokio::net::TcpListener;
use tonic::Code;
use treewright_proto::v1 as wire;
use treewright_server::clock::ManualClock;
use treewright_server::serve::Options;
use treewright_store::{MemoryStore, Store};

/// Asks and returns the whole answer, head and all.
async fn ask(address: SocketAddr, method: &str, path: &str) -> String {
    common::exchange(address, &format!("{method} {path} HTTP/1.1\r\nhost: here\r\n\r\n")).await
}

/// The value of a figure.
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
    assert_eq!(
        value(&text, failures),
        Some(0.0),
        "a question for what is not there is no failure of the database"
    );
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
    let options =
        Options { drain: Duration::from_secs(5), watch: Some(watch), studies_shown: 2, ..Options::default() };
    let clock = Arc::new(ManualClock::at(START_MS));
    let server = Server::with_options(Arc::new(MemoryStore::new()), Arc::clone(&clock), options).await;
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
    server.stop().await;
}

//! Those who watch: figures, liveness and readiness over a real socket.

mod common;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use common::{START_MS, Server, create};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tonic::Code;
use treewright_proto::v1 as wire;
use treewright_server::clock::ManualClock;
use treewright_server::serve::Options;
use treewright_store::{MemoryStore, Store};

/// Asks and returns the whole answer, head and all.
async fn ask(address: SocketAddr, method: &str, path: &str) -> String {
    let mut stream = TcpStream::connect(address).await.expect("a connection");
    let head = format!("{method} {path} HTTP/1.1\r\nhost: here\r\n\r\n");
    stream.write_all(head.as_bytes()).await.expect("sent");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.expect("text");
    answer
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
        "treewright_refusals_total{reason=\"store\"}",
    ] {
        assert!(value(&text, figure).is_some_and(|value| value >= 1.0), "{figure} in\n{text}");
    }
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

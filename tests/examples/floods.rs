//! Floods of connections against a daemon that asks for tokens: the clients still served, and the cost.
//!
//! `cargo run --release -p treewright-tests --example floods -- [CONNECTIONS] [SECONDS]` (8,000 and 10 by
//! default). The flood comes from 127.0.0.2; two clients with tokens come from 127.0.0.1: a renderer,
//! connected before the flood, that asks and reports 30 times a second, and a newcomer that connects twice a
//! second for one request. Prints a table in Markdown. Needs two descriptors a connection (`ulimit -n`).

mod leaf_study;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use leaf_study::{report, study};
use tokio::io::AsyncWriteExt as _;
use tokio::net::{TcpSocket, TcpStream};
use tokio::task::JoinSet;
use tonic::Request;
use tonic::transport::Endpoint;
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::token;

const FLOODER: IpAddr = IpAddr::V4(Ipv4Addr::new(127, 0, 0, 2));
const FRAME: Duration = Duration::from_micros(33_333);
const PATIENCE: Duration = Duration::from_secs(5);
/// Connections of a flood that asks instead of being silent.
const ASKING: usize = 200;

#[derive(Clone, Copy)]
enum Flood {
    None,
    /// Connections on which nothing is ever said.
    Silent,
    /// Connections on which HTTP/2 is begun and nothing asked.
    Begun,
    /// Requests without a token, one after the other.
    Strangers,
    /// Requests with a token, one after the other.
    Known,
}

const FLOODS: [(&str, Flood); 5] = [
    ("none", Flood::None),
    ("silent connections", Flood::Silent),
    ("connections that only begin HTTP/2", Flood::Begun),
    ("requests without a token, 200 at a time", Flood::Strangers),
    ("requests with a token, 200 at a time", Flood::Known),
];

/// A request that shows a token, if there is one.
fn with<T>(token: Option<&str>, message: T) -> Request<T> {
    let mut request = Request::new(message);
    request.set_timeout(PATIENCE);
    if let Some(token) = token {
        let value = format!("Bearer {token}").parse().expect("a token is ASCII");
        request.metadata_mut().insert("authorization", value);
    }
    request
}

async fn hold(address: SocketAddr, says: &[u8]) -> Option<TcpStream> {
    let socket = TcpSocket::new_v4().ok()?;
    socket.bind(SocketAddr::new(FLOODER, 0)).ok()?;
    let mut stream = tokio::time::timeout(PATIENCE, socket.connect(address)).await.ok()?.ok()?;
    stream.write_all(says).await.ok()?;
    Some(stream)
}

/// Floods until it is aborted. Connections that the daemon closes are opened again.
async fn flood(url: String, address: SocketAddr, flood: Flood, connections: usize, token: String) {
    let mut all = JoinSet::new();
    let (count, says): (usize, &'static [u8]) = match flood {
        Flood::None => (0, b""),
        Flood::Silent => (connections, b""),
        Flood::Begun => (connections, b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n\0\0\0\x04\0\0\0\0\0"),
        Flood::Strangers | Flood::Known => (ASKING, b""),
    };
    for _ in 0..count {
        let (url, token) = (url.clone(), token.clone());
        all.spawn(async move {
            match flood {
                Flood::Strangers | Flood::Known => {
                    let endpoint =
                        Endpoint::from_shared(url).expect("an address").local_address(Some(FLOODER));
                    let token = matches!(flood, Flood::Known).then_some(&*token);
                    let mut client = TuningServiceClient::new(endpoint.connect_lazy());
                    loop {
                        let list = wire::ListStudiesRequest::default();
                        if client.list_studies(with(token, list)).await.is_err() {
                            tokio::task::yield_now().await;
                        }
                    }
                }
                _ => loop {
                    if let Some(stream) = hold(address, says).await {
                        // Until the daemon hangs up.
                        let mut buffer = [0; 64];
                        loop {
                            stream.readable().await.ok();
                            match stream.try_read(&mut buffer) {
                                Ok(0) => break,
                                Err(error) if error.kind() != std::io::ErrorKind::WouldBlock => break,
                                _ => {}
                            }
                        }
                    }
                    tokio::time::sleep(Duration::from_millis(50)).await;
                },
            }
        });
    }
    all.join_all().await;
}

/// Asks and reports at 30 frames a second. Times of the frames that were served, and how many were not.
async fn renderer(
    mut client: TuningServiceClient<tonic::transport::Channel>,
    token: String,
    time: Duration,
) -> (Vec<f64>, usize) {
    let (begin, mut times_ms, mut failed) = (Instant::now(), Vec::new(), 0);
    while begin.elapsed() < time {
        let asked = Instant::now();
        let (study, client_id) = ("studies/hall".into(), "renderer".into());
        let question = wire::SuggestRequest { study, client_id, ..Default::default() };
        let served = match client.suggest(with(Some(&token), question)).await {
            Ok(trial) => client.report(with(Some(&token), report(trial.into_inner()))).await.is_ok(),
            Err(_) => false,
        };
        if served {
            times_ms.push(asked.elapsed().as_secs_f64() * 1e3);
        } else {
            failed += 1;
        }
        tokio::time::sleep(FRAME.saturating_sub(asked.elapsed())).await;
    }
    (times_ms, failed)
}

/// Makes a connection for one request, twice a second. As for [`renderer`].
async fn newcomer(url: String, token: String, time: Duration) -> (Vec<f64>, usize) {
    let (begin, mut times_ms, mut failed) = (Instant::now(), Vec::new(), 0);
    while begin.elapsed() < time {
        let asked = Instant::now();
        let served = async {
            let mut client = TuningServiceClient::connect(url.clone()).await.ok()?;
            client.list_studies(with(Some(&token), wire::ListStudiesRequest::default())).await.ok()
        };
        match tokio::time::timeout(PATIENCE, served).await {
            Ok(Some(_)) => times_ms.push(asked.elapsed().as_secs_f64() * 1e3),
            _ => failed += 1,
        }
        tokio::time::sleep(Duration::from_millis(500).saturating_sub(asked.elapsed())).await;
    }
    (times_ms, failed)
}

fn figures((mut times_ms, failed): (Vec<f64>, usize)) -> String {
    times_ms.sort_by(f64::total_cmp);
    let served = times_ms.len();
    let at = |share: f64| {
        times_ms.get((served.saturating_sub(1) as f64 * share) as usize).copied().unwrap_or(f64::NAN)
    };
    format!("{served} of {} | {:.1} | {:.1}", served + failed, at(0.5), at(0.99))
}

async fn row(name: &str, kind: Flood, connections: usize, time: Duration) {
    let folder = tempfile::tempdir().expect("a folder");
    let database = folder.path().join("floods.db");
    let daemon = Daemon::start_with(&database, &["--tokens"], &folder.path().join("log"));
    let token = token(&database, &["--scope", "admin"]);
    let url = daemon.url().to_owned();
    let mut client = TuningServiceClient::connect(url.clone()).await.expect("a connection");
    let create = || wire::CreateStudyRequest { study_id: "hall".into(), study: Some(study()) };
    // The daemon looks for new tokens now and then.
    while client.create_study(with(Some(&token), create())).await.is_err() {
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let address = daemon.address().parse().expect("an address");
    let flooding = tokio::spawn(flood(url.clone(), address, kind, connections, token.clone()));
    // The flood is there before anything is counted.
    tokio::time::sleep(Duration::from_secs(2)).await;
    let cpu_s = daemon.processor_s();
    let known = tokio::spawn(renderer(client, token.clone(), time));
    let new = tokio::spawn(newcomer(url, token, time));
    let (known, new) = (known.await.expect("no panic"), new.await.expect("no panic"));
    let cpu = (daemon.processor_s() - cpu_s) / time.as_secs_f64();
    let memory_mb = daemon.memory_bytes() as f64 / 1e6;
    flooding.abort();
    println!("| {name} | {} | {} | {cpu:.2} | {memory_mb:.0} |", figures(known), figures(new));
}

#[tokio::main]
async fn main() {
    let argument = |place: usize, or: usize| {
        std::env::args().nth(place).map_or(or, |text| text.parse().expect("a number"))
    };
    let (connections, time) = (argument(1, 8000), Duration::from_secs(argument(2, 10) as u64));
    println!(
        "| flood | renderer's frames served | p50 ms | p99 ms | newcomers served | p50 ms | p99 ms | processors of the daemon | MB |\n\
         |---|---|---|---|---|---|---|---|---|"
    );
    for (name, kind) in FLOODS {
        row(name, kind, connections, time).await;
    }
}

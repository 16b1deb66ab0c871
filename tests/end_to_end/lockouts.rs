//! Clients without a token, or with too many connections, cannot shut others out, fill the memory, or delay
//! the end of the daemon.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use tokio::time::timeout;
use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::program;

use crate::site::Site;
use crate::{dashboard, wire};

const PREFACE: &[u8] = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n";
const DATA: u8 = 0;
const HEADERS: u8 = 1;
const SETTINGS: u8 = 4;
const END_STREAM: u8 = 1;
const END_HEADERS: u8 = 4;
const PATIENCE: Duration = Duration::from_secs(5);

/// A frame of HTTP/2 (RFC 9113, section 4.1).
pub(crate) fn frame(kind: u8, flags: u8, stream: u32, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).expect("a short frame").to_be_bytes();
    [&length[1..], &[kind, flags], &stream.to_be_bytes(), payload].concat()
}

/// The fields of a call: POST, http, and the rest as literals of HPACK.
fn fields(rpc: &str, authority: &str) -> Vec<u8> {
    let text = |text: &str| [&[u8::try_from(text.len()).expect("short")][..], text.as_bytes()].concat();
    let path = format!("/treewright.v1.TuningService/{rpc}");
    let named = |name: &str, value: &str| [vec![0], text(name), text(value)].concat();
    [
        vec![0x83, 0x86, 0x04],
        text(&path),
        vec![0x01],
        text(authority),
        named("content-type", "application/grpc"),
        named("te", "trailers"),
    ]
    .concat()
}

/// The beginning of a connection, and a call with this part of its message.
fn call(rpc: &str, authority: &str, settings: &[u8], message: &[u8], flags: u8) -> Vec<u8> {
    let mut bytes = [PREFACE, &frame(SETTINGS, 0, 0, settings)].concat();
    bytes.extend(frame(HEADERS, END_HEADERS, 1, &fields(rpc, authority)));
    for (index, piece) in message.chunks(16_000).enumerate() {
        let is_last = (index + 1) * 16_000 >= message.len();
        bytes.extend(frame(DATA, if is_last { flags } else { 0 }, 1, piece));
    }
    bytes
}

fn under_descriptors(descriptors: usize) -> Command {
    let mut shell = Command::new("sh");
    shell.args(["-c", &format!("ulimit -n {descriptors}; exec \"$0\" \"$@\"")]).arg(program("treewrightd"));
    shell
}

/// Connections that are opened and say this, as many as can be had.
fn hold(address: &str, count: usize, says: &[u8]) -> Vec<TcpStream> {
    let open = |_| {
        let mut stream = TcpStream::connect(address).ok()?;
        // The daemon may have closed it already.
        let _ = stream.write_all(says);
        Some(stream)
    };
    (0..count).filter_map(open).collect()
}

async fn served(url: &str) -> bool {
    let asked = timeout(PATIENCE, async {
        let mut client =
            pb::tuning_service_client::TuningServiceClient::connect(url.to_owned()).await.ok()?;
        client.list_studies(pb::ListStudiesRequest::default()).await.ok()
    });
    asked.await.is_ok_and(|answer| answer.is_some())
}

#[tokio::test]
async fn silent_connections_shut_nobody_out_whatever_the_limit_of_descriptors() {
    for descriptors in [256, 1024] {
        let folder = tempfile::tempdir().expect("a folder");
        let daemon = Daemon::start_by(under_descriptors(descriptors), &folder.path().join("tuning.db"));
        // A client that was connected before is served throughout.
        let mut known = wire::connect(daemon.url()).await;
        wire::create(&mut known, "calm").await;
        let silent = hold(daemon.address(), 1400, b"");
        for attempt in 0..8 {
            assert!(served(daemon.url()).await, "{attempt} with {descriptors} descriptors");
            let name = "studies/calm".to_owned();
            known.get_study(pb::GetStudyRequest { name }).await.expect("it is known");
        }
        drop(silent);
        assert!(daemon.terminate().success());
    }
}

fn ask(address: &str, path: &str) -> Option<String> {
    let mut stream = TcpStream::connect(address).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).ok()?;
    stream
        .write_all(format!("GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n").as_bytes())
        .ok()?;
    let mut answer = String::new();
    stream.read_to_string(&mut answer).ok()?;
    answer.split(' ').nth(1).map(str::to_owned)
}

#[test]
fn slow_connections_and_logins_keep_nobody_from_the_pages() {
    let (site, pages) = dashboard::start(&["--tokens", "--metrics", "127.0.0.1:0"]);
    let metrics = dashboard::metrics(&site);
    for says in [
        &b""[..],
        b"G",
        b"GET /metrics HTTP/1.1\r\nHost: x\r\n",
        b"POST /livez HTTP/1.1\r\nContent-Length: 9\r\n\r\n",
    ] {
        let slow = hold(&metrics, 200, says);
        for attempt in 0..30 {
            let status = ask(&metrics, "/livez");
            assert_eq!(status.as_deref(), Some("200"), "{attempt}: {:?}", String::from_utf8_lossy(says));
        }
        drop(slow);
    }
    let login = b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 100\r\n\r\nt";
    let slow = hold(&pages, 200, login);
    for attempt in 0..10 {
        assert_eq!(ask(&pages, "/login").as_deref(), Some("200"), "{attempt}");
    }
    // Nor do they stay.
    let begin = Instant::now();
    let mut last = slow.into_iter().next_back().expect("one");
    last.set_read_timeout(Some(Duration::from_secs(20))).expect("set");
    let mut answer = String::new();
    let _ = last.read_to_string(&mut answer);
    assert!(answer.is_empty() || answer.contains("408"), "{answer}");
    assert!(begin.elapsed() < Duration::from_secs(15), "{:?}", begin.elapsed());
    assert!(site.daemon.terminate().success());
}

#[tokio::test]
async fn messages_without_their_end_fill_no_memory_and_disturb_nobody() {
    const CONNECTIONS: usize = 1000;
    let site = Site::new();
    let daemon = &site.daemon;
    let mut known = wire::connect(daemon.url()).await;
    let name = wire::create(&mut known, "calm").await;
    let before = daemon.memory_bytes();
    // A megabyte is announced, and as much sent as the daemon lets one send.
    let message = [&[0, 0, 0x0f, 0xff, 0x00][..], &vec![7; 900_000]].concat();
    let bytes = call("CreateStudy", "x", &[], &message, 0);
    let address = daemon.address().to_owned();
    let hostile: Vec<_> = (0..CONNECTIONS)
        .map(|_| {
            let (address, bytes) = (address.clone(), bytes.clone());
            tokio::spawn(async move {
                use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
                let Ok(mut stream) = tokio::net::TcpStream::connect(address).await else { return };
                let (mut read, mut write) = stream.split();
                let reading = async {
                    let mut buffer = [0; 4096];
                    while read.read(&mut buffer).await.is_ok_and(|count| count > 0) {}
                };
                let writing = async {
                    // No faster than windows are opened again.
                    for piece in bytes.chunks(16_000) {
                        if write.write_all(piece).await.is_err() {
                            return;
                        }
                        tokio::time::sleep(Duration::from_millis(40)).await;
                    }
                    std::future::pending::<()>().await;
                };
                tokio::select! { () = reading => {}, () = writing => {} }
            })
        })
        .collect();
    let mut most = 0;
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(5) {
        let trial = known.suggest(wire::suggestion(&name, "known", 0.5)).await.expect("a suggestion");
        known.report(wire::report(trial.get_ref())).await.expect("a report");
        most = most.max(daemon.memory_bytes());
    }
    let grown_mb = most.saturating_sub(before) / 1_000_000;
    println!("{CONNECTIONS} connections: {grown_mb} MB more");
    // The budget for unfinished requests, the least window of each connection, and the connections
    // themselves.
    assert!(grown_mb < 134 + CONNECTIONS as u64 / 8, "{grown_mb} MB more");
    hostile.into_iter().for_each(|one| one.abort());
    assert!(site.daemon.terminate().success());
}

/// A unary answer that cannot be sent, as its client's window is closed, and an unread stream.
#[test]
fn a_client_that_is_frozen_does_not_hold_up_the_end() {
    const INITIAL_WINDOW_SIZE_0: [u8; 6] = [0, 4, 0, 0, 0, 0];
    let site = Site::new();
    let mut frozen = Vec::new();
    for (rpc, flags) in [("ListStudies", END_STREAM), ("Tune", 0), ("Tune", 0)] {
        let messages: Vec<u8> = [0; 5].repeat(if rpc == "Tune" { 20 } else { 1 });
        let bytes = call(rpc, "x", &INITIAL_WINDOW_SIZE_0, &messages, flags);
        frozen.extend(hold(site.daemon.address(), 1, &bytes));
    }
    std::thread::sleep(Duration::from_millis(500));
    let begin = Instant::now();
    assert!(site.daemon.terminate().success());
    assert!(begin.elapsed() < Duration::from_secs(5), "{:?}", begin.elapsed());
}

/// Whether plain gRPC over a Unix socket is answered.
pub(crate) fn answers_over(socket: &Path, authority: &str) -> bool {
    let mut stream = UnixStream::connect(socket).expect("a connection");
    stream.set_read_timeout(Some(PATIENCE)).expect("set");
    stream.write_all(&call("ListStudies", authority, &[], &[0; 5], END_STREAM)).expect("sent");
    let mut answer = Vec::new();
    let mut buffer = [0; 4096];
    // `grpc-status: 0` comes in the trailers, `application/grpc` in the head, both in Huffman code or not.
    // Only an answer has a frame of data with a message, a refusal has none.
    let has_message =
        |answer: &[u8]| frames(answer).iter().any(|(kind, payload)| *kind == DATA && payload.len() >= 5);
    while let Ok(count) = stream.read(&mut buffer) {
        answer.extend_from_slice(&buffer[..count]);
        if count == 0 || has_message(&answer) {
            break;
        }
    }
    has_message(&answer)
}

/// The kinds and payloads of frames; the last may be cut off.
pub(crate) fn frames(mut bytes: &[u8]) -> Vec<(u8, &[u8])> {
    let mut frames = Vec::new();
    while let [a, b, c, kind, ..] = *bytes {
        let length = usize::from(a) << 16 | usize::from(b) << 8 | usize::from(c);
        let end = bytes.len().min(9 + length);
        frames.push((kind, bytes.get(9..end).unwrap_or_default()));
        bytes = &bytes[end..];
    }
    frames
}

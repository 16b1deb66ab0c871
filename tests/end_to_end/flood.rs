//! Floods against the real program: more streams than there is room for, and streams that are reset as soon
//! as they are opened ("rapid reset", CVE-2023-44487).

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::Code;
use treewright_proto::v1 as pb;

use crate::guard::until;
use crate::lockouts::{frame, frames};
use crate::site::Site;
use crate::wire;

/// The daemon's limit of open Tune streams.
const TUNE_STREAMS: usize = 1024;

#[tokio::test]
async fn more_streams_than_there_is_room_for_are_refused_and_others_are_served() {
    let site = Site::with(&["--max-streams", &TUNE_STREAMS.to_string()]);
    let mut other = wire::connect(site.url()).await;
    let name = wire::create(&mut other, "flooded").await;

    let mut open = Vec::new();
    let mut refused = 0;
    for _ in 0..6 {
        let mut client = wire::connect(site.url()).await;
        for _ in 0..200 {
            // Streams on which nothing is ever said; each ends with its sender.
            let (say, frames) = mpsc::channel::<pb::TuneRequest>(1);
            match client.tune(ReceiverStream::new(frames)).await {
                Ok(answers) => open.push((say, answers)),
                Err(status) => {
                    assert_eq!(status.code(), Code::ResourceExhausted, "{status:?}");
                    refused += 1;
                }
            }
        }
    }
    assert_eq!((open.len(), refused), (TUNE_STREAMS, 6 * 200 - TUNE_STREAMS));
    // A client with no part in the flood is served meanwhile.
    other.get_study(pb::GetStudyRequest { name: name.clone() }).await.expect("it serves");
    other.suggest(wire::suggestion(&name, "other", 0.5)).await.expect("it suggests");

    // There is room again once the flood is over.
    drop(open);
    let tune = async || other.tune(tokio_stream::empty::<pb::TuneRequest>()).await;
    until("the places of the flood are free", tune, Result::is_ok).await;
    assert!(site.daemon.terminate().success());
}

#[tokio::test]
async fn who_opens_streams_only_to_reset_them_is_cut_off() {
    const HEADERS: u8 = 1;
    const RST_STREAM: u8 = 3;
    const SETTINGS: u8 = 4;
    const GOAWAY: u8 = 7;
    const END_STREAM_AND_HEADERS: u8 = 5;
    const CANCEL: [u8; 4] = [0, 0, 0, 8];
    const ENHANCE_YOUR_CALM: [u8; 4] = [0, 0, 0, 11];
    let site = Site::new();

    // POST, http, the path "/" from the static table of HPACK, and an authority as a literal.
    let head = [0x83, 0x86, 0x84, 0x01, 0x01, b'x'];
    let mut flood = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec();
    flood.extend(frame(SETTINGS, 0, 0, &[]));
    for stream in (1..4000).step_by(2) {
        flood.extend(frame(HEADERS, END_STREAM_AND_HEADERS, stream, &head));
        flood.extend(frame(RST_STREAM, 0, stream, &CANCEL));
    }
    let mut connection = TcpStream::connect(site.daemon.address()).expect("a connection");
    connection.set_read_timeout(Some(Duration::from_secs(20))).expect("set");
    // The daemon may have hung up before the end.
    let _ = connection.write_all(&flood);
    let mut answer = Vec::new();
    let end = connection.read_to_end(&mut answer);
    let timed_out = end.as_ref().is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock);
    assert!(!timed_out, "the connection stays open");
    let farewell = frames(&answer).into_iter().rfind(|(kind, _)| *kind == GOAWAY);
    let reason = farewell.and_then(|(_, payload)| payload.get(4..8));
    // A reset of the connection may swallow the reason, a polite end does not.
    assert!(end.is_err() || reason == Some(&ENHANCE_YOUR_CALM[..]), "{reason:?} {end:?}");

    let mut other = wire::connect(site.url()).await;
    wire::create(&mut other, "calm").await;
}

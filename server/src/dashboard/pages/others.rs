//! The studies of other daemons, as their own dashboards list them.
//!
//! Only dashboards that the operator named are asked, never an address of a request. They are read at once,
//! each for [`limits::DASHBOARD_PEER_WAIT`] at most, and their answers are kept for a moment, so that open
//! pages do not ask again and again.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::Arc;

use bytes::Bytes;
use http::{Request, StatusCode, header};
use http_body_util::{BodyExt as _, Empty, Limited};
use hyper::client::conn::http1;
use hyper_util::rt::TokioIo;
use serde_json::Value;
use tokio::net::TcpStream;
use tokio::sync::Mutex;
use tokio::task::JoinSet;
use tokio::time::{Instant, timeout};

use super::index::IndexRow;
use crate::config::DashboardPeer;
use crate::limits;

/// Where a dashboard lists its studies in JSON.
const PATH: &str = "/studies.json";

pub(super) struct OtherDaemons {
    peers: Vec<DashboardPeer>,
    /// Their last answers, and when they came.
    last: Mutex<Option<(Instant, Arc<Vec<OtherDaemon>>)>>,
}

#[derive(Debug)]
pub(super) struct OtherDaemon {
    pub(super) peer: DashboardPeer,
    /// Its studies, or why there are none.
    pub(super) studies: Result<Vec<IndexRow>, String>,
}

impl OtherDaemons {
    pub(super) fn new(peers: Vec<DashboardPeer>) -> Self {
        Self { peers, last: Mutex::default() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.peers.is_empty()
    }

    /// The answers of all of them, in the order in which they were named.
    pub(super) async fn read(&self) -> Arc<Vec<OtherDaemon>> {
        let mut last = self.last.lock().await;
        if let Some((when, told)) = last.as_ref()
            && when.elapsed() < limits::DASHBOARD_PEER_AGE
        {
            return Arc::clone(told);
        }
        let mut reading = JoinSet::new();
        for (place, peer) in self.peers.iter().cloned().enumerate() {
            reading.spawn(async move {
                let studies = read(&peer).await;
                (place, OtherDaemon { peer, studies })
            });
        }
        let mut told = BTreeMap::new();
        while let Some(read) = reading.join_next().await {
            told.extend(read);
        }
        let told = Arc::new(told.into_values().collect::<Vec<_>>());
        *last = Some((Instant::now(), Arc::clone(&told)));
        told
    }
}

async fn read(peer: &DashboardPeer) -> Result<Vec<IndexRow>, String> {
    let wait = limits::DASHBOARD_PEER_WAIT;
    let late = || Err(format!("it did not answer within {} s", wait.as_secs_f64()));
    timeout(wait, ask(peer)).await.unwrap_or_else(|_| late())
}

async fn ask(peer: &DashboardPeer) -> Result<Vec<IndexRow>, String> {
    let stream = TcpStream::connect(&peer.authority).await.map_err(said)?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(said)?;
    // It ends with this question.
    let mut driving = JoinSet::new();
    driving.spawn(async move {
        // The answer is a failure.
        let _ = connection.await;
    });
    let mut request = Request::get(PATH).header(header::HOST, &peer.authority);
    if let Some(token) = &peer.token {
        request = request.header(header::AUTHORIZATION, token);
    }
    let request = request.body(Empty::<Bytes>::new()).map_err(said)?;
    let answer = sender.send_request(request).await.map_err(said)?;
    match answer.status() {
        StatusCode::OK => {}
        // A dashboard leads a client without a good token to its log-in.
        StatusCode::SEE_OTHER | StatusCode::UNAUTHORIZED => {
            return Err("it asks for a token that it knows; see --dashboard-token-files".to_owned());
        }
        StatusCode::NOT_FOUND => {
            return Err("it has no list for others; it may be an older daemon".to_owned());
        }
        StatusCode::MISDIRECTED_REQUEST => {
            return Err("it asks for no tokens, so it must be named by its IP address".to_owned());
        }
        status => return Err(format!("it answered {status}")),
    }
    let body =
        Limited::new(answer.into_body(), limits::DASHBOARD_PEER_BYTES).collect().await.map_err(said)?;
    rows(&body.to_bytes()).ok_or_else(|| "its answer is no list of studies".to_owned())
}

fn rows(text: &[u8]) -> Option<Vec<IndexRow>> {
    let told: Value = serde_json::from_slice(text).ok()?;
    told["studies"].as_array()?.iter().take(limits::DASHBOARD_STUDIES).map(IndexRow::of_json).collect()
}

fn said(problem: impl Display) -> String {
    problem.to_string()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use http::HeaderValue;
    use serde_json::json;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpListener;

    use super::*;

    const ROW: &str = r#"{"studies":[{"id":"hall","uid":"0000000000000abc","trials":7}],"more":false}"#;

    /// A dashboard that gives this answer to each question, and the last question to it.
    async fn dashboard(answer: String) -> (DashboardPeer, Arc<Mutex<String>>) {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let authority = listener.local_addr().expect("an address").to_string();
        let asked = Arc::new(Mutex::new(String::new()));
        let kept = Arc::clone(&asked);
        tokio::spawn(async move {
            while let Ok((mut stream, _)) = listener.accept().await {
                let mut head = vec![0; 4096];
                let length = stream.read(&mut head).await.expect("a question");
                *kept.lock().await = String::from_utf8_lossy(&head[..length]).into_owned();
                if answer.is_empty() {
                    tokio::time::sleep(Duration::from_secs(60)).await;
                }
                // A client that gives up does not read the rest.
                let _ = stream.write_all(answer.as_bytes()).await;
            }
        });
        (DashboardPeer { name: "one".to_owned(), authority, token: None }, asked)
    }

    fn answer(status: &str, body: &str) -> String {
        format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\n\r\n{body}", body.len())
    }

    #[tokio::test]
    async fn a_named_dashboard_is_asked_with_the_token_and_told_with_its_name() {
        let (peer, asked) = dashboard(answer("200 OK", ROW)).await;
        let token = Some(HeaderValue::from_static("Bearer tw1_x"));
        let others = OtherDaemons::new(vec![DashboardPeer { token, ..peer.clone() }]);
        let told = others.read().await;
        let studies = told[0].studies.as_ref().expect("studies");
        assert_eq!(
            (told[0].peer.name.as_str(), studies[0].id.as_str(), studies[0].trials),
            ("one", "hall", 7)
        );
        let question = asked.lock().await.to_lowercase();
        assert!(question.starts_with("get /studies.json http/1.1\r\n"), "{question}");
        assert!(question.contains("authorization: bearer tw1_x\r\n"), "{question}");
        assert!(question.contains(&format!("host: {}\r\n", peer.authority)), "{question}");
        assert!(Arc::ptr_eq(&told, &others.read().await), "not asked again at once");
    }

    #[tokio::test]
    async fn who_is_away_is_told_with_the_reason_and_soon() {
        let mut peers = Vec::new();
        let large = format!(r#"{{"studies":[],"rest":"{}"}}"#, "x".repeat(limits::DASHBOARD_PEER_BYTES));
        for wrong in [
            answer("303 See Other", ""),
            answer("404 Not Found", ""),
            answer("200 OK", "<html>"),
            answer("200 OK", r#"{"studies":[{"id":"../x"}]}"#),
            answer("200 OK", &large),
            // A redirection is not followed.
            "HTTP/1.1 302 Found\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\n\r\n".to_owned(),
            // It never answers.
            String::new(),
        ] {
            peers.push(dashboard(wrong).await.0);
        }
        let closed = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let authority = closed.local_addr().expect("an address").to_string();
        drop(closed);
        peers.push(DashboardPeer { name: "gone".to_owned(), authority, token: None });
        let begun = std::time::Instant::now();
        let told = OtherDaemons::new(peers).read().await;
        assert!(begun.elapsed() < 5 * limits::DASHBOARD_PEER_WAIT, "{:?}", begun.elapsed());
        let reasons: Vec<&str> =
            told.iter().map(|one| one.studies.as_ref().expect_err("nothing").as_str()).collect();
        for (reason, part) in reasons.iter().zip([
            "--dashboard-token-files",
            "older daemon",
            "no list",
            "no list",
            "length limit",
            "302",
            "within 1 s",
            "refused",
        ]) {
            assert!(reason.contains(part), "{part} is not in {reason}");
        }
        assert_eq!(reasons.len(), 8);
    }

    #[test]
    fn a_long_list_is_cut() {
        let row = json!({ "id": "hall", "uid": "0000000000000abc" });
        let many = json!({ "studies": vec![row; limits::DASHBOARD_STUDIES + 5] }).to_string();
        assert_eq!(rows(many.as_bytes()).expect("a list").len(), limits::DASHBOARD_STUDIES);
    }
}

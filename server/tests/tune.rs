//! The Tune stream.

mod common;

use common::{Client, Server, ask, create, get, report};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Streaming};
use treewright_proto::v1 as wire;

struct Stream {
    frames: mpsc::Sender<wire::TuneRequest>,
    answers: Streaming<wire::TuneResponse>,
}

impl Stream {
    async fn open(client: &mut Client) -> Self {
        let (frames, outgoing) = mpsc::channel(4);
        let answers = client.tune(ReceiverStream::new(outgoing)).await.expect("a stream");
        Self { frames, answers: answers.into_inner() }
    }

    async fn frame(
        &mut self,
        report: Option<wire::ReportRequest>,
        suggest: Option<wire::SuggestRequest>,
    ) -> wire::TuneResponse {
        self.frames.send(wire::TuneRequest { report, suggest }).await.expect("sent");
        self.answers.message().await.expect("an answer").expect("the stream is open")
    }
}

#[tokio::test]
async fn each_frame_reports_and_suggests() {
    let directory = tempfile::tempdir().unwrap();
    let (server, mut client) = Server::on_disk_with_hall(&directory.path().join("studies.db")).await;
    let mut stream = Stream::open(&mut client).await;

    let first = stream.frame(None, Some(ask("a", 10.0))).await;
    assert_eq!((&first.reported, &first.report_error, &first.suggest_error), (&None, &None, &None));
    let mut trial = first.trial.unwrap();
    for number in 1..20 {
        let render_ms = f64::from(number);
        let answer = stream.frame(Some(report(&trial.name, render_ms)), Some(ask("a", 10.0))).await;
        assert_eq!((&answer.report_error, &answer.suggest_error), (&None, &None));
        let reported = answer.reported.unwrap();
        assert!(!reported.duplicate);
        let stored = reported.trial.unwrap();
        assert_eq!((&stored.name, stored.cost), (&trial.name, Some(render_ms)));
        assert_eq!(get(&mut client, &trial.name).await, stored);
        let next = answer.trial.unwrap();
        assert_eq!(next.name, format!("studies/hall/trials/{}", number + 1));
        trial = next;
    }
    let only_report = stream.frame(Some(report(&trial.name, 1.0)), None).await;
    assert!(only_report.reported.is_some() && only_report.trial.is_none());
    let nothing = stream.frame(None, None).await;
    assert_eq!(nothing, wire::TuneResponse::default());
    drop(stream);
    server.stop().await;
}

#[tokio::test]
async fn errors_leave_the_stream_open() {
    let (_server, mut client) = Server::with_hall().await;
    create(&mut client, "other").await;
    let mut stream = Stream::open(&mut client).await;
    let trial = stream.frame(None, Some(ask("a", 10.0))).await.trial.unwrap();

    // A wrong question beside a right report.
    let answer = stream.frame(Some(report(&trial.name, 4.0)), Some(ask("a", f64::NAN))).await;
    assert!(answer.reported.is_some() && answer.trial.is_none());
    let error = answer.suggest_error.unwrap();
    assert_eq!(error.code, Code::InvalidArgument as i32);
    assert!(error.message.contains("NaN"), "{}", error.message);

    // A wrong report beside a right question.
    let answer = stream.frame(Some(report("nonsense", 4.0)), Some(ask("a", 10.0))).await;
    let error = answer.report_error.unwrap();
    assert_eq!(error.code, Code::InvalidArgument as i32);
    let trial = answer.trial.unwrap();

    let answer = stream.frame(Some(report(&trial.name, f64::NAN)), Some(ask("a", 10.0))).await;
    assert_eq!(answer.report_error.unwrap().code, Code::InvalidArgument as i32);
    // The report was refused, so that the trial is still the client's.
    assert_eq!(answer.trial.unwrap().name, trial.name);

    // Two studies in one frame.
    let mut elsewhere = ask("a", 10.0);
    elsewhere.study = "studies/other".to_owned();
    let answer = stream.frame(Some(report(&trial.name, 4.0)), Some(elsewhere)).await;
    assert!(answer.reported.is_some());
    assert_eq!(answer.trial.unwrap().name, "studies/other/trials/1");

    // A repeated report.
    let answer = stream.frame(Some(report(&trial.name, 9.0)), Some(ask("a", 10.0))).await;
    let reported = answer.reported.unwrap();
    assert!(reported.duplicate);
    assert_eq!(reported.trial.unwrap().cost, Some(4.0));
    assert!(answer.trial.is_some());
    let mut nowhere = ask("a", 10.0);
    nowhere.study = "studies/none".to_owned();
    let answer = stream.frame(None, Some(nowhere)).await;
    assert_eq!(answer.suggest_error.unwrap().code, Code::NotFound as i32);
    assert!(stream.frame(None, Some(ask("a", 10.0))).await.trial.is_some());
}

#[tokio::test]
async fn draining_ends_the_stream_politely() {
    let (mut server, mut client) = Server::with_hall().await;
    let mut stream = Stream::open(&mut client).await;
    assert!(stream.frame(None, Some(ask("a", 10.0))).await.trial.is_some());
    server.begin_stop();
    let status = stream.answers.message().await.expect_err("ended");
    assert_eq!(status.code(), Code::Unavailable);
    assert!(status.message().contains("draining"), "{status}");
    drop(stream);
    drop(client);
    server.stop().await;
}

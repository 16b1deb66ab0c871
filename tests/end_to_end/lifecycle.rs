//! Ending the daemon by a signal.

use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;

use crate::wire;

// A second thread lets the client see the daemon's goodbye while this one waits for its end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sigterm_ends_it_politely_and_the_database_stays_whole() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    let study = wire::create(&mut client, "polite").await;
    let trial = client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
    client.report(wire::report(&trial)).await.expect("taken");
    // A stream left open must not hold up the end.
    let (_open, requests) = tokio::sync::mpsc::channel::<pb::TuneRequest>(1);
    let stream = client.tune(tokio_stream::wrappers::ReceiverStream::new(requests)).await;
    assert!(stream.is_ok());
    assert!(daemon.terminate().success(), "SIGTERM is a normal end");

    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    assert_eq!(wire::query(&mut client, &study, "state = COMPLETED").await.len(), 1);
}

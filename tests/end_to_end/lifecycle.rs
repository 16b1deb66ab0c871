//! Ending the daemon by a signal, and starting it on a socket that systemd hands over.

use std::net::TcpListener;
use std::process::Stdio;

use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, run, stderr};

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

/// A daemon that finds its listener among its descriptors, as systemd hands it over.
fn start_on(socket: &TcpListener, database: &std::path::Path, listen: &str) -> std::process::Command {
    let mut command = std::process::Command::new("sh");
    command.args(["-c", "exec 3<&0 </dev/null; LISTEN_FDS=1 LISTEN_PID=$$ exec \"$@\"", "sh"]);
    command.arg(program("treewrightd")).args(["serve", "--listen", listen, "--database"]).arg(database);
    command.stdin(std::os::fd::OwnedFd::from(socket.try_clone().expect("a second descriptor")));
    command
}

#[test]
fn a_socket_that_systemd_hands_over_is_served() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let socket = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = socket.local_addr().expect("an address").to_string();
    // A client that connects before the daemon is there waits for it.
    let url = format!("http://{address}");
    let early = std::thread::spawn(move || run("treewright", &["--server", &url, "--timeout", "2m", "ping"]));
    let mut daemon =
        start_on(&socket, &database, &address).stdout(Stdio::piped()).spawn().expect("it starts");
    let pinged = early.join().expect("it ends");
    let _ = daemon.kill();
    let _ = daemon.wait();
    assert!(pinged.status.success(), "{}", stderr(&pinged));

    let other = start_on(&socket, &database, "127.0.0.1:1").output().expect("it runs");
    assert!(!other.status.success(), "another address than the one that was checked");
    assert!(stderr(&other).contains("systemd passed on a socket"), "{}", stderr(&other));
}

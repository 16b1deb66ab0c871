//! Unix sockets, and sockets that the system passes on.

use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixListener;
use std::process::Command;
use std::time::Duration;

use treewright_client::{Client, Indicators, Options, Outcome};
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, stderr};

use crate::lockouts::answers_over;
use crate::site::leaf_study;

/// One frame, durable from end to end.
async fn frame(url: &str) {
    let options = Options::new().client_id("a").deadline(Duration::from_secs(60));
    let client = Client::connect(url, options).expect("a good address");
    let study = client.study("hall", leaf_study()).await.expect("a study");
    let suggestion = study.suggest(&Indicators::from([("triangles", 3.0)])).await;
    assert!(suggestion.trial().is_some(), "{suggestion:?}");
    suggestion.report([("render_ms", 2.0)].into(), Outcome::Ok).expect("measured");
    client.flush(Duration::from_secs(60)).await.expect("acknowledged");
}

#[tokio::test]
async fn a_unix_socket_serves_beside_a_port_or_alone() {
    let folder = tempfile::tempdir().expect("a folder");
    let (database, log) = (folder.path().join("tuning.db"), folder.path().join("log"));
    let socket = folder.path().join("daemon.sock");
    let socket_url = format!("unix:{}", socket.display());
    let path = socket.to_str().expect("a plain path");

    let both = Daemon::start_with(&database, &["--socket", path], &log);
    let (port_url, said) = both.url().split_once(',').expect("two addresses");
    assert_eq!(said, socket_url);
    frame(port_url).await;
    frame(&socket_url).await;
    frame(both.url()).await;
    // Killed, it leaves the file, which the next one replaces.
    both.kill();
    assert!(socket.exists());
    let alone = Daemon::start_with(&database, &["--socket", path, "--socket-only"], &log);
    assert_eq!(alone.url(), socket_url);
    frame(alone.url()).await;
    // Plain gRPC may name any authority.
    for authority in
        ["localhost", "%2Frun%2Ftreewright%2Fdaemon.sock", "/run/daemon.sock", "a b@:%", "daemon.sock"]
    {
        assert!(answers_over(&socket, authority), "{authority}");
    }
    assert!(alone.terminate().success());
    assert!(!socket.exists(), "a polite end takes its file along");
}

/// A shell that becomes the daemon, with a socket that was opened for it as descriptor 3, as systemd does it.
fn activation(socket: OwnedFd) -> Command {
    let mut shell = Command::new("sh");
    let script = "exec 3<&0 </dev/null; export LISTEN_FDS=1 LISTEN_PID=$$; exec \"$0\" \"$@\"";
    shell.args(["-c", script]).arg(program("treewrightd")).stdin(socket);
    shell
}

#[tokio::test]
async fn sockets_that_the_system_opened_take_the_place_of_others() {
    let folder = tempfile::tempdir().expect("a folder");
    let database = folder.path().join("tuning.db");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let url = format!("http://{address}");
    let passed = || activation(listener.try_clone().expect("a second descriptor").into());
    // A client that connects before the daemon is there waits in the queue.
    let early = url.clone();
    let waiting = tokio::spawn(async move { frame(&early).await });
    tokio::time::sleep(Duration::from_millis(200)).await;
    let daemon = Daemon::start_by_at(passed(), &database, &address);
    assert_eq!(daemon.url(), url);
    waiting.await.expect("it was served");
    assert!(daemon.terminate().success());
    // A daemon that names no port gets that of the socket; another than the one that was checked is refused.
    let daemon = Daemon::start_by(passed(), &database);
    assert_eq!(daemon.url(), url);
    assert!(daemon.terminate().success());
    let mut other = passed();
    let other = other.args(["serve", "--listen", "127.0.0.1:1", "--database"]).arg(&database).output();
    let other = other.expect("it runs");
    assert!(!other.status.success() && stderr(&other).contains("systemd passed on a socket"), "{other:?}");

    let socket = folder.path().join("passed.sock");
    let listener = UnixListener::bind(&socket).expect("a socket");
    let daemon = Daemon::start_by(activation(listener.into()), &database);
    assert_eq!(daemon.url(), format!("unix:{}", socket.display()));
    frame(daemon.url()).await;
    assert!(daemon.terminate().success());
    assert!(socket.exists(), "it is the system's");
}

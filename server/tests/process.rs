//! `treewrightd` as a process: its ready line, its exit codes, its one-line messages.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};

struct Daemon {
    child: Child,
    ready: String,
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_treewrightd"));
    // The developer's settings must not reach the test.
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("TREEWRIGHT_")) {
        command.env_remove(name);
    }
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn serve(database: &Path) -> Command {
    let database = database.to_str().expect("plain");
    command(&["serve", "--listen", "127.0.0.1:0", "--database", database])
}

impl Daemon {
    fn start(database: &Path) -> Self {
        Self::spawn(serve(database))
    }

    fn spawn(mut command: Command) -> Self {
        let mut child = command.spawn().expect("started");
        let mut ready = String::new();
        let stdout = child.stdout.as_mut().expect("piped");
        BufReader::new(stdout).read_line(&mut ready).expect("a line");
        Self { child, ready }
    }

    /// Sends SIGTERM and returns exit code and log.
    fn terminate(mut self) -> (Option<i32>, String) {
        let pid = self.child.id().to_string();
        let sent = Command::new("kill").args(["-TERM", &pid]).status().expect("sent");
        assert!(sent.success());
        let mut log = String::new();
        self.child.stderr.take().expect("piped").read_to_string(&mut log).expect("a log");
        (self.child.wait().expect("ended").code(), log)
    }
}

/// Runs to the end: exit code, standard output and standard error.
fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = command(arguments).output().expect("run");
    (
        output.status.code(),
        String::from_utf8(output.stdout).expect("text"),
        String::from_utf8(output.stderr).expect("text"),
    )
}

#[test]
fn it_prints_one_line_serves_and_stops_at_sigterm() {
    let directory = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&directory.path().join("studies.db"));
    let address = daemon
        .ready
        .strip_prefix("treewrightd listening on http://")
        .and_then(|rest| rest.strip_suffix('\n'))
        .expect("the ready line");
    let address: std::net::SocketAddr = address.parse().expect("an address");
    assert_ne!(address.port(), 0);
    std::net::TcpStream::connect(address).expect("it listens");
    let (code, log) = daemon.terminate();
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("draining") && log.contains("stopped"), "{log}");
}

#[test]
fn variables_that_are_empty_are_as_if_they_were_not_set() {
    let help = run(&["serve", "--help"]).1;
    let variables = help.split("[env: ").skip(1).filter_map(|rest| rest.split(['=', ']']).next());
    let variables: Vec<&str> = variables.collect();
    assert!(variables.len() > 20 && variables.contains(&"TREEWRIGHT_OTLP"), "{variables:?}");
    let directory = tempfile::tempdir().unwrap();
    let mut empty = serve(&directory.path().join("studies.db"));
    empty.envs(variables.iter().map(|name| (name, "")));
    let daemon = Daemon::spawn(empty);
    let ready = daemon.ready.clone();
    let (code, log) = daemon.terminate();
    assert!(ready.starts_with("treewrightd listening on http://127.0.0.1:"), "{log}");
    assert_eq!(code, Some(0), "{log}");
}

#[test]
fn a_second_daemon_on_one_database_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("studies.db");
    let first = Daemon::start(&database);
    let pid = first.child.id();
    let path = database.to_str().unwrap();
    let (code, stdout, stderr) = run(&["serve", "--listen", "127.0.0.1:0", "--database", path]);
    assert_eq!(code, Some(4));
    assert_eq!(stdout, "");
    let message = format!("studies.db is in use by another treewrightd (pid {pid})");
    assert!(stderr.contains(&message), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert_eq!(first.terminate().0, Some(0));
}

#[test]
fn each_trouble_has_its_exit_code_and_one_line() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path().to_str().unwrap();
    let (code, _, stderr) = run(&["serve", "--listen", "127.0.0.1:0", "--database", here]);
    assert_eq!(code, Some(4));
    assert!(stderr.contains(&format!("{here} is a directory")), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let database = directory.path().join("studies.db");
    let database = database.to_str().unwrap();
    let (code, stdout, stderr) = run(&["serve", "--listen", &address, "--database", database]);
    assert_eq!(code, Some(3));
    assert_eq!(stdout, "", "nothing claims to listen");
    assert!(stderr.contains(&format!("cannot listen on {address}")), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(!Path::new(database).exists());

    let (code, _, stderr) = run(&["serve", "--listen", "0.0.0.0:0", "--database", database]);
    assert_eq!(code, Some(2));
    assert!(stderr.contains("--insecure"), "{stderr}");
    assert_eq!(run(&["serve"]).0, Some(2));
    let (code, help, _) = run(&["serve", "--help"]);
    assert_eq!(code, Some(0));
    assert!(help.contains("TREEWRIGHT_DATABASE"), "{help}");
}

//! A daemon with a folder of its own, the command line that talks to it, and waiting for what comes.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;
use treewright_client::{Scale, Space, StudySpec};
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{run, stderr, stdout};

/// Longest wait for something that should happen by itself, on a machine with much other work.
const PATIENCE: Duration = Duration::from_secs(180);

/// A daemon, and the scratch folder of its database.
pub(crate) struct Site {
    pub(crate) daemon: Daemon,
    pub(crate) folder: TempDir,
}

impl Site {
    /// On any free port.
    pub(crate) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a scratch folder");
        Self { daemon: Daemon::start(&folder.path().join("tuning.db")), folder }
    }

    /// With further arguments, and its log in the folder's file `log`.
    pub(crate) fn with(arguments: &[&str]) -> Self {
        Self::within(tempfile::tempdir().expect("a scratch folder"), arguments)
    }

    /// As [`Self::with`], in a folder that may hold a database.
    pub(crate) fn within(folder: TempDir, arguments: &[&str]) -> Self {
        let file = |name: &str| folder.path().join(name);
        Self { daemon: Daemon::start_with(&file("tuning.db"), arguments, &file("log")), folder }
    }

    /// After `kill -9`: another daemon on the database, at its address.
    pub(crate) fn killed(self) -> Self {
        let (database, address) = (self.database(), self.daemon.address().to_owned());
        self.daemon.kill();
        Self { daemon: Daemon::start_at(&database, &address), folder: self.folder }
    }

    /// The log of a daemon with further arguments.
    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.file("log")).expect("the log")
    }

    pub(crate) fn url(&self) -> &str {
        self.daemon.url()
    }

    pub(crate) fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn database(&self) -> PathBuf {
        self.file("tuning.db")
    }

    /// The path of a file of the folder, for a command line.
    pub(crate) fn path(&self, name: &str) -> String {
        path_text(&self.file(name)).to_owned()
    }

    /// Writes a file into the folder, and returns its path.
    pub(crate) fn write(&self, name: &str, contents: &str) -> String {
        std::fs::write(self.file(name), contents).expect("a scratch file");
        self.path(name)
    }
}

pub(crate) fn path_text(path: &Path) -> &str {
    path.to_str().expect("a path of text")
}

/// Runs the command line against a daemon.
pub(crate) fn shell(url: &str, arguments: &[&str]) -> Output {
    run("treewright", &[&["--server", url], arguments].concat())
}

/// The output of the command line; it must succeed.
pub(crate) fn say(url: &str, arguments: &[&str]) -> String {
    let output = shell(url, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    stdout(&output)
}

pub(crate) fn ask(url: &str, arguments: &[&str]) -> Value {
    json(&shell(url, &[&["--json"], arguments].concat()))
}

/// The JSON that a program printed, which must have succeeded.
pub(crate) fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_str(&stdout(output)).expect("JSON")
}

pub(crate) fn trials(url: &str, study: &str, filter: &str) -> Vec<Value> {
    let all = ask(url, &["trials", study, "--all", "--filter", filter]);
    all.as_array().expect("a list of trials").clone()
}

/// The database of a daemon, in use or not, is sound.
pub(crate) fn assert_sound(database: &Path) {
    let checked = run("treewrightd", &["check", "--database", path_text(database)]);
    assert!(checked.status.success() && stdout(&checked).contains("is sound"), "{}", stderr(&checked));
}

/// Sends a signal, such as `INT`.
pub(crate) fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(sent.expect("kill runs").success(), "SIG{name} could not be sent");
}

pub(crate) fn wait_until(what: &str, mut holds: impl FnMut() -> bool) {
    let patience = Instant::now() + PATIENCE;
    while !holds() {
        assert!(Instant::now() < patience, "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A study of the SDK: a parameter, an indicator, a metric.
pub(crate) fn leaf_study() -> StudySpec {
    let space = Space::builder().integer("leaf", 1..=32).default(8).build().expect("a space");
    let spec = StudySpec::builder(space).indicator("triangles", 0.0..=100.0, Scale::Linear);
    spec.minimise("render_ms", 1.0).build().expect("a specification")
}

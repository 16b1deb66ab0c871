//! A daemon of one's own, for those who have none: started when it is needed, found again by its address file, and
//! ended by itself when nobody has asked it anything for a while.
//!
//! It listens on a free port of the loopback interface; its address stands in the runtime folder and its database in
//! the data folder of the user. Several that look for it at once take turns by a lock on a file, so that only one is
//! started.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{BufRead as _, BufReader};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use treewright_client::Options;
use treewright_client::blocking::Client;

use crate::failure::Failure;
use crate::files;

/// It ends when nobody has asked it anything for so long, unless [`IDLE_VARIABLE`] says otherwise.
const IDLE_S: u32 = 600;
/// Seconds of silence after which it ends.
const IDLE_VARIABLE: &str = "TREEWRIGHT_LOCAL_IDLE_S";
/// One that is just ending still holds the database; so long is waited for that.
const PATIENCE: Duration = Duration::from_secs(15);
/// One that is there answers within this.
const ANSWER: Duration = Duration::from_secs(2);
/// The daemon's program.
const PROGRAM: &str = "treewrightd";
/// What the daemon says before its address when it is ready.
const READY: &str = "treewrightd listening on ";

/// Where everything of the local daemon is.
#[derive(Clone, Debug)]
pub(crate) struct Local {
    runtime: PathBuf,
    data: PathBuf,
}

impl Local {
    /// The user's.
    ///
    /// # Errors
    /// When neither HOME nor the XDG variables say where.
    pub(crate) fn of_user() -> Result<Self, Failure> {
        match (files::runtime_folder(), files::data_folder()) {
            (Some(runtime), Some(data)) => Ok(Self { runtime, data }),
            _ => Err(Failure::Local("HOME is not set, so there is no place for its database".into())),
        }
    }

    /// Its database.
    pub(crate) fn database(&self) -> PathBuf {
        self.data.join("tuning.db")
    }

    fn address_file(&self) -> PathBuf {
        self.runtime.join("address")
    }

    /// Its log.
    pub(crate) fn log(&self) -> PathBuf {
        self.runtime.join("daemon.log")
    }

    /// Its address, if it is running.
    pub(crate) fn running(&self) -> Option<String> {
        let url = std::fs::read_to_string(self.address_file()).ok()?.trim().to_owned();
        answers(&url).then_some(url)
    }

    /// Its address; it is started where it is not running.
    ///
    /// # Errors
    /// [`Failure::Local`] with what its log says.
    pub(crate) fn start(&self) -> Result<String, Failure> {
        for folder in [&self.runtime, &self.data] {
            let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
            made.map_err(|error| Failure::file(folder, error.to_string()))?;
        }
        let lock_file = self.runtime.join("lock");
        let problem = |error: std::io::Error| Failure::file(&lock_file, error.to_string());
        let lock = OpenOptions::new()
            .create(true)
            .truncate(false)
            .write(true)
            .mode(0o600)
            .open(&lock_file)
            .map_err(problem)?;
        // Given back when the file is closed.
        lock.lock().map_err(problem)?;
        if let Some(url) = self.running() {
            return Ok(url);
        }
        let begin = Instant::now();
        loop {
            match self.spawn() {
                Ok(url) => {
                    std::fs::write(self.address_file(), &url)
                        .map_err(|error| Failure::file(&self.address_file(), error.to_string()))?;
                    crate::exec::progress::note(&format!(
                        "started a local daemon on {url}; its database is {}, and it ends after {} s of silence",
                        self.database().display(),
                        idle_s()
                    ));
                    return Ok(url);
                }
                // An earlier one that is ending may still hold the database.
                Err(_) if begin.elapsed() < PATIENCE && self.is_in_use() => {
                    std::thread::sleep(Duration::from_millis(300));
                }
                Err(failure) => return Err(failure),
            }
        }
    }

    fn spawn(&self) -> Result<String, Failure> {
        let program = files::program(PROGRAM).ok_or_else(|| {
            Failure::Local(format!("the program {PROGRAM} is neither beside this one nor in PATH"))
        })?;
        let log = self.log();
        let log_file = File::create(&log).map_err(|error| Failure::file(&log, error.to_string()))?;
        let mut child = Command::new(&program)
            .args(["serve", "--listen", "127.0.0.1:0", "--idle-exit-s", &idle_s().to_string(), "--database"])
            .arg(self.database())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log_file)
            // Ctrl-C is meant for us.
            .process_group(0)
            .spawn()
            .map_err(|error| Failure::Local(format!("{} cannot be started: {error}", program.display())))?;
        let mut line = String::new();
        if let Some(out) = child.stdout.take() {
            BufReader::new(out)
                .read_line(&mut line)
                .map_err(|error| Failure::Local(format!("it cannot be heard: {error}")))?;
        }
        match line.trim().strip_prefix(READY) {
            Some(url) => Ok(url.to_owned()),
            None => {
                // It has ended, or is about to.
                let _ = child.wait();
                Err(Failure::Local(last_line(&log)))
            }
        }
    }

    /// Whether the last start failed because another daemon has the database.
    fn is_in_use(&self) -> bool {
        let log = std::fs::read_to_string(self.log()).unwrap_or_default();
        log.contains("in use") || log.contains("another")
    }
}

fn idle_s() -> u32 {
    std::env::var(IDLE_VARIABLE).ok().and_then(|text| text.parse().ok()).filter(|&s| s > 0).unwrap_or(IDLE_S)
}

fn last_line(log: &Path) -> String {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let last = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
    format!("{last} (its log is {})", log.display())
}

/// Whether a daemon serves there.
pub(crate) fn answers(url: &str) -> bool {
    let options = Options::new().call_deadline(ANSWER);
    Client::connect(url, options).is_ok_and(|client| client.ping().is_ok())
}

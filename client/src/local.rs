//! A daemon of the user's own, for users without another one. It is started when it is needed, found again by
//! its database, and ends by itself after a time without requests. A client sends it a health check now and
//! then, so that it stays as long as the client does.
//!
//! Its database is in the data folder of the user (XDG Base Directory Specification 0.8). It listens on a
//! Unix socket in a folder beside the database, or below `/tmp` where that path is too long for a socket. So
//! every program that would use that database finds it. The folder for a session (`XDG_RUNTIME_DIR`) would
//! not do, because jobs of cron have none. A user with write access to a folder can put another daemon or a
//! link into it, so both folders have to be the user's alone. Several programs that look for the daemon at
//! once take turns by a lock on a file, so that only one is started.

use std::fs::{DirBuilder, File, OpenOptions};
use std::io::{BufRead as _, BufReader};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::blocking::Client;
use crate::client_id::{hash, machine_name};
use crate::{ClientError, Options};

/// The daemon ends after this time without requests, unless [`IDLE_VARIABLE`] says otherwise.
const IDLE_S: u32 = 600;
/// Seconds without a request after which it ends.
const IDLE_VARIABLE: &str = "TREEWRIGHT_LOCAL_IDLE_S";
/// Number of health checks that a client sends within that time.
const ASKED_WHILE_IDLE: u32 = 4;
/// Longest wait for a daemon that is just ending and still holds the database.
const PATIENCE: Duration = Duration::from_secs(15);
/// One that is there answers within this.
const ANSWER: Duration = Duration::from_secs(2);
const PROGRAM: &str = "treewrightd";
/// Bytes of a path that a Unix socket can have, and some to spare (`unix(7)`).
const SOCKET_PATH_BYTES: usize = 100;
/// Its name in the runtime folder.
const SOCKET: &str = "daemon.sock";
/// The daemon's words before its address when it is ready.
const READY: &str = "treewrightd listening on ";

/// The user's own daemon, running or not.
#[derive(Clone, Debug)]
pub struct LocalDaemon {
    runtime: PathBuf,
    data: PathBuf,
    /// The daemon's program; `None` is one beside this program or in `PATH`.
    program: Option<PathBuf>,
}

impl LocalDaemon {
    /// The one of this user.
    ///
    /// Errors: [`ClientError::NoLocalDaemon`] when neither HOME nor the XDG variables say where it is.
    pub fn of_user() -> Result<Self, ClientError> {
        let data = folder("XDG_DATA_HOME", ".local/share");
        data.map(Self::at)
            .ok_or_else(|| none("HOME is not set, so there is no place for its database".into()))
    }

    /// The one whose database lies in a folder.
    fn at(data: PathBuf) -> Self {
        // Several machines may share a home, but not a socket.
        let mut runtime = data.join(format!("run-{:08x}", hash(machine_name().as_bytes())));
        if runtime.join(SOCKET).as_os_str().len() > SOCKET_PATH_BYTES {
            let user = rustix::process::geteuid().as_raw();
            let number = hash(runtime.as_os_str().as_bytes());
            runtime = PathBuf::from(format!("/tmp/treewright-{user}-{number:08x}"));
        }
        Self { runtime, data, program: None }
    }

    /// Starts this file in place of a `treewrightd` beside this program or in `PATH`: for packages that hold
    /// one.
    #[must_use]
    pub fn with_program(mut self, program: PathBuf) -> Self {
        self.program = Some(program);
        self
    }

    /// Its database, which may not exist yet.
    pub fn database(&self) -> PathBuf {
        self.data.join("tuning.db")
    }

    fn url(&self) -> String {
        format!("unix:{}", self.runtime.join(SOCKET).display())
    }

    /// The log of the last one.
    pub fn log(&self) -> PathBuf {
        self.runtime.join("daemon.log")
    }

    /// Its address, if it is running. Blocks for two seconds at most.
    pub fn running(&self) -> Option<String> {
        // Without a socket there is no daemon to wait for.
        let is_safe =
            self.folders().iter().all(|&(folder, may_be_link)| check_folder(folder, may_be_link).is_ok());
        let is_there = is_safe && self.runtime.join(SOCKET).exists();
        Some(self.url()).filter(|url| is_there && answers(url))
    }

    /// The folders, and whether each may be a link: that is the user's own choice, of another disk.
    fn folders(&self) -> [(&Path, bool); 2] {
        [(&self.data, true), (&self.runtime, false)]
    }

    /// Its address. It is started where it is not running, and `note` is called with a message. Blocks until
    /// it answers, for some seconds at most.
    ///
    /// Errors: [`ClientError::NoLocalDaemon`] with what its log says, or with the folder that is not the
    /// user's alone.
    pub fn start(&self, note: impl FnOnce(&str)) -> Result<String, ClientError> {
        for (folder, may_be_link) in self.folders() {
            let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
            made.map_err(|error| of_file(folder, &error))?;
            check_folder(folder, may_be_link)?;
        }
        let lock_file = self.runtime.join("lock");
        let problem = |error: std::io::Error| of_file(&lock_file, &error);
        let opened = OpenOptions::new().create(true).truncate(false).write(true).mode(0o600).open(&lock_file);
        let lock = opened.map_err(problem)?;
        // Given back when the file is closed.
        lock.lock().map_err(problem)?;
        if let Some(url) = self.running() {
            return Ok(url);
        }
        let begin = Instant::now();
        loop {
            match self.spawn() {
                Ok(url) => {
                    note(&format!(
                        "started a local daemon on {url}; its database is {}, and it exits after {} s without a request",
                        self.database().display(),
                        idle_s()
                    ));
                    return Ok(url);
                }
                // An earlier one that is ending may still hold the database.
                Err(_) if begin.elapsed() < PATIENCE && self.is_in_use() => {
                    std::thread::sleep(Duration::from_millis(300));
                }
                Err(problem) => return Err(problem),
            }
        }
    }

    fn spawn(&self) -> Result<String, ClientError> {
        let named = self.program.clone().or_else(|| program(PROGRAM));
        let program = named
            .ok_or_else(|| none(format!("the program {PROGRAM} is neither beside this one nor in PATH")))?;
        let log = self.log();
        let log_file = File::create(&log).map_err(|error| of_file(&log, &error))?;
        let mut child = Command::new(&program)
            .args(["serve", "--socket-only", "--socket"])
            .arg(self.runtime.join(SOCKET))
            .args(["--idle-exit-s", &idle_s().to_string(), "--database"])
            .arg(self.database())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log_file)
            // Ctrl-C is meant for us.
            .process_group(0)
            .spawn()
            .map_err(|error| none(format!("{} cannot be started: {error}", program.display())))?;
        let mut line = String::new();
        if let Some(out) = child.stdout.take() {
            BufReader::new(out)
                .read_line(&mut line)
                .map_err(|error| none(format!("it cannot be heard: {error}")))?;
        }
        match line.trim().strip_prefix(READY) {
            Some(url) => Ok(url.to_owned()),
            None => {
                // It has ended, or is about to.
                let _ = child.wait();
                Err(none(last_line(&log)))
            }
        }
    }

    /// Whether the last start failed because another daemon has the database.
    fn is_in_use(&self) -> bool {
        let log = std::fs::read_to_string(self.log()).unwrap_or_default();
        log.contains("in use") || log.contains("another")
    }
}

impl crate::Client {
    /// Makes a client of the user's own daemon. It is started where it is not running, and ends by itself
    /// when there has been no client for a while; see [`LocalDaemon`].
    ///
    /// Errors: [`ClientError::NoLocalDaemon`] when there is none to be had; else as
    /// [`crate::Client::connect`].
    pub async fn local(options: Options) -> Result<Self, ClientError> {
        let started = tokio::task::spawn_blocking(|| LocalDaemon::of_user()?.start(|_| {})).await;
        let url = started.map_err(|error| ClientError::NoLocalDaemon { problem: error.to_string() })??;
        Self::connect(&url, options)
    }
}

impl Client {
    /// See [`crate::Client::local`]. Errors: as there.
    pub fn local(options: Options) -> Result<Self, ClientError> {
        Self::connect(&LocalDaemon::of_user()?.start(|_| {})?, options)
    }
}

fn idle_s() -> u32 {
    std::env::var(IDLE_VARIABLE).ok().and_then(|text| text.parse().ok()).filter(|&s| s > 0).unwrap_or(IDLE_S)
}

/// Interval of health checks at which a client of this address keeps the user's own daemon alive while the
/// program is busy. `None` for other daemons.
pub(crate) fn keep_awake_every(url: &str) -> Option<Duration> {
    let is_own = LocalDaemon::of_user().is_ok_and(|own| own.url() == url);
    is_own.then(|| Duration::from_secs(idle_s().into()) / ASKED_WHILE_IDLE)
}

fn last_line(log: &Path) -> String {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    let last = text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
    format!("{last} (its log is {})", log.display())
}

/// Whether a daemon serves there. Blocks for two seconds at most.
pub fn answers(url: &str) -> bool {
    let options = Options::new().call_deadline(ANSWER);
    Client::connect(url, options).is_ok_and(|client| client.ping().is_ok())
}

fn none(problem: String) -> ClientError {
    ClientError::NoLocalDaemon { problem }
}

/// Refuses a folder that is not the user's alone.
fn check_folder(folder: &Path, may_be_link: bool) -> Result<(), ClientError> {
    /// Write permissions of others than the owner.
    const OTHERS_WRITE: u32 = 0o022;
    let user = rustix::process::geteuid().as_raw();
    let failed = |error| of_file(folder, &error);
    let entry = std::fs::symlink_metadata(folder).map_err(failed)?;
    if entry.is_symlink() && !may_be_link {
        return Err(unsafe_folder(folder, "is a link: remove it"));
    }
    let target = std::fs::metadata(folder).map_err(failed)?;
    if [&entry, &target].iter().any(|one| one.uid() != user) {
        return Err(unsafe_folder(folder, "belongs to another user: choose another with XDG_DATA_HOME"));
    }
    if target.mode() & OTHERS_WRITE != 0 {
        return Err(unsafe_folder(folder, "can be written by others: run `chmod 700` on it"));
    }
    Ok(())
}

fn unsafe_folder(folder: &Path, problem: &str) -> ClientError {
    none(format!("the folder {} {problem}", folder.display()))
}

fn of_file(path: &Path, error: &std::io::Error) -> ClientError {
    none(format!("{}: {error}", path.display()))
}

/// A folder of the user's: what the variable says, or one below HOME.
pub fn folder(variable: &str, below_home: &str) -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let base = absolute(variable).or_else(|| absolute("HOME").map(|home| home.join(below_home)));
    base.map(|base| base.join("treewright"))
}

/// A program that lies beside this one, or else is found in `PATH`.
pub fn program(name: &str) -> Option<PathBuf> {
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.join(name)));
    let path = std::env::var_os("PATH").unwrap_or_default();
    let listed = std::env::split_paths(&path).map(|folder| folder.join(name)).collect::<Vec<_>>();
    beside.into_iter().chain(listed).find(|path| path.is_file())
}

//! A `treewrightd` process under test.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::ports::lasting_address;
use crate::programs::program;

/// A running daemon. Killed when dropped.
pub struct Daemon {
    process: Child,
    url: String,
}

impl Daemon {
    /// Starts a daemon on any free port.
    pub fn start(database: &Path) -> Self {
        Self::start_at(database, &lasting_address())
    }

    /// Starts a daemon at an address, e.g. the one that an earlier daemon had.
    pub fn start_at(database: &Path, address: &str) -> Self {
        Self::start_at_with(database, address, &[])
    }

    /// Starts a daemon at an address with further arguments.
    pub fn start_at_with(database: &Path, address: &str, arguments: &[&str]) -> Self {
        let all = [&["--listen", address], arguments].concat();
        Self::spawn(Command::new(program("treewrightd")), database, &all, Stdio::inherit())
    }

    /// Starts a daemon on any free port with further arguments, and its log in a file.
    pub fn start_with(database: &Path, arguments: &[&str], log: &Path) -> Self {
        let log = std::fs::File::create(log).expect("a file for the log");
        let address = lasting_address();
        let mut all = vec!["--listen", &*address];
        all.extend(arguments);
        Self::spawn(Command::new(program("treewrightd")), database, &all, log.into())
    }

    /// Starts a daemon on any free port by a command that ends in the program, which it becomes: one of a
    /// [sandbox](crate::sandbox).
    pub fn start_by(command: Command, database: &Path) -> Self {
        Self::start_by_at(command, database, "127.0.0.1:0")
    }

    /// As [`Daemon::start_by`], at an address.
    pub fn start_by_at(command: Command, database: &Path, address: &str) -> Self {
        Self::spawn(command, database, &["--listen", address], Stdio::inherit())
    }

    fn spawn(mut command: Command, database: &Path, arguments: &[&str], log: Stdio) -> Self {
        let mut process = command
            .args(["serve", "--database"])
            .arg(database)
            .args(arguments)
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .expect("treewrightd starts");
        let mut line = String::new();
        BufReader::new(process.stdout.take().expect("stdout is piped"))
            .read_line(&mut line)
            .expect("stdout is text");
        let url = line.trim().rsplit(' ').next().unwrap_or_default().to_owned();
        assert!(
            url.contains("://") || url.starts_with("unix:"),
            "treewrightd said {line:?} instead of its address"
        );
        Self { process, url }
    }

    /// `http://127.0.0.1:PORT`, or `https:` with TLS.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// `127.0.0.1:PORT`.
    pub fn address(&self) -> &str {
        self.url.split_once("://").map_or("", |(_, address)| address)
    }

    /// The number of its process.
    pub fn id(&self) -> u32 {
        self.process.id()
    }

    /// Sends a signal, such as `HUP`.
    pub fn signal(&self, name: &str) {
        let number = self.process.id().to_string();
        let sent = Command::new("kill").args([&format!("-{name}"), &number]).status().expect("kill runs");
        assert!(sent.success(), "SIG{name} could not be sent");
    }

    /// The memory that it has in use, as Linux counts it.
    pub fn memory_bytes(&self) -> u64 {
        let file = format!("/proc/{}/status", self.process.id());
        let status = std::fs::read_to_string(file).expect("the daemon runs");
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("Linux says it");
        let kb: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number");
        kb * 1024
    }

    /// Processor time that it has used, user and system, in seconds, as Linux counts it.
    pub fn processor_s(&self) -> f64 {
        /// The value of `sysconf(_SC_CLK_TCK)` on every Linux.
        const TICKS_PER_S: f64 = 100.0;
        let file = format!("/proc/{}/stat", self.process.id());
        let text = std::fs::read_to_string(file).expect("the daemon runs");
        // The name, in brackets, may hold spaces; user and system time are the 12th and 13th words behind it.
        let words = text.rsplit_once(')').map_or("", |(_, rest)| rest).split_whitespace();
        let ticks = words.skip(11).take(2).map(|word| word.parse::<f64>().expect("a number"));
        ticks.sum::<f64>() / TICKS_PER_S
    }

    /// The targets of its descriptors, as Linux names them.
    pub fn open_files(&self) -> Vec<PathBuf> {
        let folder = format!("/proc/{}/fd", self.process.id());
        let descriptors = std::fs::read_dir(folder).expect("the daemon runs");
        // One may be closed while they are listed.
        descriptors.flatten().filter_map(|one| std::fs::read_link(one.path()).ok()).collect()
    }

    /// `kill -9`, and waits until it is gone.
    pub fn kill(mut self) {
        self.process.kill().expect("the daemon can be killed");
        self.process.wait().expect("the daemon can be waited for");
    }

    /// SIGTERM, and waits for a polite end.
    pub fn terminate(mut self) -> ExitStatus {
        self.signal("TERM");
        let patience = Instant::now() + Duration::from_secs(120);
        loop {
            if let Some(status) = self.process.try_wait().expect("the daemon can be waited for") {
                return status;
            }
            assert!(Instant::now() < patience, "the daemon does not end on SIGTERM");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Already gone after kill() and terminate(); a failed test leaves it to be cleaned up here.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

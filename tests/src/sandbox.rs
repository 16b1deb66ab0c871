//! Places where faults do no harm: a small disk, a private network, a clock that can be set. The first two
//! are namespaces of Linux, which vanish with the process that holds them; they need root. Where the system
//! lacks something that a test needs, the test says so and ends.

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// The file in which `tools/test.sh` gathers skipped tests, to list them at the end.
const SKIPPED: &str = "TREEWRIGHT_SKIPPED";

/// Says, past the capturing of the test runner, why a test was not run.
pub fn skip(what: &str, why: &str) {
    let line = format!("skipped: {what}: {}\n", why.trim());
    if let Some(file) = std::env::var_os(SKIPPED) {
        let opened = std::fs::OpenOptions::new().append(true).create(true).open(file);
        // An error here cannot be reported.
        let _ = opened.and_then(|mut file| file.write_all(line.as_bytes()));
    }
    let _ = std::io::stderr().write_all(line.as_bytes());
}

/// A tool that `tools/setup.py --tests` installs where it can, which is as root: there, and under `CI=true`,
/// a test that needs it must run.
pub fn expect_installed(tool: &str) {
    let must = std::env::var("CI").is_ok_and(|ci| ci == "true")
        && std::fs::metadata("/proc/self").is_ok_and(|this| this.uid() == 0);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let is_there = std::env::split_paths(&path).any(|folder| folder.join(tool).is_file());
    assert!(is_there || !must, "{tool} is missing, which `tools/setup.py --tests` installs");
}

/// A file system in memory, seen by the programs that are started in it.
pub struct SmallDisk {
    holder: Child,
    folder: PathBuf,
}

impl SmallDisk {
    /// Mounts one at a folder, with options such as `size=8m`.
    ///
    /// # Errors
    /// Why it cannot be had here.
    pub fn mount(folder: &Path, options: &str) -> Result<Self, String> {
        // It ends when its standard input does, so at the latest with this process.
        let script = "mount -t tmpfs -o \"$2\" tmpfs \"$1\" && echo ready && exec cat";
        let mut holder = Command::new("unshare")
            .args(["--mount", "--propagation", "private", "sh", "-c", script, "sh"])
            .arg(folder)
            .arg(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|error| format!("unshare: {error}"))?;
        let mut line = String::new();
        if let Some(stdout) = holder.stdout.as_mut() {
            let _ = BufReader::new(stdout).read_line(&mut line);
        }
        let disk = Self { holder, folder: folder.to_owned() };
        if line.trim() == "ready" { Ok(disk) } else { Err(disk.said()) }
    }

    fn said(mut self) -> String {
        let mut said = String::new();
        if let Some(mut stderr) = self.holder.stderr.take() {
            let _ = stderr.read_to_string(&mut said);
        }
        if said.is_empty() { "no mount namespace".to_owned() } else { said }
    }

    /// A program that sees the disk.
    pub fn command(&self, program: impl AsRef<Path>) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--target", &self.holder.id().to_string(), "--mount"]).arg(program.as_ref());
        command
    }

    /// The folder as it is seen from outside.
    pub fn view(&self) -> PathBuf {
        let inside = self.folder.strip_prefix("/").unwrap_or(&self.folder);
        PathBuf::from(format!("/proc/{}/root", self.holder.id())).join(inside)
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

/// A clock for one program: `libfaketime` adds an offset to the system's, which it reads from a file at every
/// look. The monotonic clock stays the machine's, as when somebody sets the time.
pub struct Clock {
    faketime: PathBuf,
    file: PathBuf,
}

impl Clock {
    /// A clock that shows the system's time.
    ///
    /// # Errors
    /// Why it cannot be had here.
    pub fn new(folder: &Path) -> Result<Self, String> {
        let places = [
            "/usr/lib/x86_64-linux-gnu/faketime",
            "/usr/lib/aarch64-linux-gnu/faketime",
            "/usr/lib/faketime",
        ];
        let libraries = places.iter().map(|place| Path::new(place).join("libfaketime.so.1"));
        let faketime = libraries.into_iter().find(|library| library.exists());
        let faketime = faketime.ok_or("libfaketime is not installed")?;
        let clock = Self { faketime, file: folder.join("clock") };
        clock.set("+0");
        Ok(clock)
    }

    /// Sets it, for example to `+1d` or `-1d`.
    pub fn set(&self, offset: &str) {
        // By a rename, so that no reader sees half of it.
        let draft = self.file.with_extension("new");
        std::fs::write(&draft, format!("{offset}\n")).expect("the clock's file can be written");
        std::fs::rename(&draft, &self.file).expect("the clock's file can be replaced");
    }

    /// A program that goes by it.
    pub fn command(&self, program: impl AsRef<Path>) -> Command {
        let mut command = Command::new(program.as_ref());
        command
            .env("LD_PRELOAD", &self.faketime)
            .env("FAKETIME_TIMESTAMP_FILE", &self.file)
            .env("FAKETIME_NO_CACHE", "1")
            .env("FAKETIME_DONT_FAKE_MONOTONIC", "1")
            .env("DONT_FAKE_MONOTONIC", "1");
        command
    }
}

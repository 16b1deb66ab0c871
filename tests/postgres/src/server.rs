//! A PostgreSQL server of the tests' own.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use treewright_tests::ports::lasting_port;

use crate::user::User;

/// The superuser's password, which stands in addresses.
const PASSWORD: &str = "only-for-tests";

/// Waits until the process that started it is gone, however it went, and then clears up: the server, and
/// the folder. Its standard input is a pipe whose other end only that process holds.
const WATCH: &str = r#"trap '' INT TERM HUP; read _; "$1" -D "$2/data" -m immediate stop; rm -rf "$2""#;

/// A running server.
pub struct Server {
    programs: PathBuf,
    folder: PathBuf,
    port: u16,
    user: User,
    watch: Child,
}

impl Server {
    /// Makes a server in a temporary folder and starts it on a free port.
    #[allow(clippy::new_without_default)] // It is no value but a process.
    pub fn start() -> Self {
        let programs = programs();
        let user = User::unprivileged();
        // Kept: the watch removes it.
        let folder = tempfile::Builder::new().prefix("treewright-pg-").tempdir().expect("a folder").keep();
        let secret = folder.join("password");
        std::fs::write(&secret, PASSWORD).expect("a file in the folder");
        user.own(&folder);
        user.own(&secret);
        let data = folder.join("data");
        let mut initdb = Command::new(programs.join("initdb"));
        initdb.args(["--username=postgres", "--auth=scram-sha-256", "--encoding=UTF8", "--locale=C"]);
        initdb.arg("--pwfile").arg(&secret).arg("--pgdata").arg(&data);
        succeed(user.run(initdb.current_dir(&folder)), "initdb");

        let mut watch = Command::new("sh");
        watch.args(["-c", WATCH, "watch"]).arg(programs.join("pg_ctl")).arg(&folder);
        watch.current_dir("/").stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let watch = user.run(&mut watch).spawn().expect("sh starts");
        let mut server = Self { programs, folder, port: 0, user, watch };
        // Another process may take the port between the question and the start.
        for _ in 0..5 {
            server.port = lasting_port();
            if server.try_start() {
                return server;
            }
        }
        panic!("PostgreSQL does not start: {}", server.log());
    }

    /// The address of one of its databases, with a password.
    pub fn url(&self, database: &str) -> String {
        format!("postgres://postgres:{PASSWORD}@127.0.0.1:{}/{database}", self.port)
    }

    /// Stops it as a restart of the machine would: sessions are ended, nothing acknowledged is lost.
    pub fn stop(&self) {
        succeed(&mut self.control(&["-m", "fast", "stop"]), "pg_ctl stop");
    }

    /// Starts it again at its old address.
    pub fn start_again(&self) {
        assert!(self.try_start(), "PostgreSQL does not start: {}", self.log());
    }

    fn try_start(&self) -> bool {
        let options = format!(
            "-c listen_addresses=127.0.0.1 -c port={} -c unix_socket_directories='{}' -c max_connections=200",
            self.port,
            self.folder.display()
        );
        let mut start = self.control(&["-w", "-o", &options, "-l"]);
        start.arg(self.folder.join("log")).arg("start");
        start.status().expect("pg_ctl starts").success()
    }

    fn control(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.programs.join("pg_ctl"));
        command.arg("-D").arg(self.folder.join("data")).args(arguments).current_dir(&self.folder);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        self.user.run(&mut command);
        command
    }

    fn log(&self) -> String {
        std::fs::read_to_string(self.folder.join("log")).unwrap_or_default()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Closing the pipe is the sign to clear up.
        drop(self.watch.stdin.take());
        let _ = self.watch.wait();
    }
}

fn succeed(command: &mut Command, name: &str) {
    let output = command.output().unwrap_or_else(|error| panic!("{name} does not start: {error}"));
    assert!(output.status.success(), "{name} fails: {}", String::from_utf8_lossy(&output.stderr));
}

/// The folder with `initdb` and `pg_ctl`: on the PATH, or where Debian puts the newest.
fn programs() -> PathBuf {
    let has_all = |folder: &Path| folder.join("initdb").exists() && folder.join("pg_ctl").exists();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut debian: Vec<PathBuf> = std::fs::read_dir("/usr/lib/postgresql")
        .map(|versions| versions.flatten().map(|version| version.path().join("bin")).collect())
        .unwrap_or_default();
    debian.sort();
    std::env::split_paths(&path).chain(debian.into_iter().rev()).find(|folder| has_all(folder)).expect(
        "PostgreSQL is installed (Debian: apt-get install postgresql), or DATABASE_URL names a server",
    )
}

//! A private tuning daemon with a fresh database, which ends with its owner.

use std::io::{BufRead as _, BufReader};
use std::process::{Child, ChildStdout, Command, Stdio};

use tempfile::TempDir;
use treewright_render_cli::error::{CliError, Result};

/// The program, in the folder of this one.
const PROGRAM: &str = "treewrightd";

#[derive(Debug)]
pub(crate) struct Daemon {
    child: Child,
    pub(crate) url: String,
    /// Kept open, so that the daemon can go on printing.
    _stdout: BufReader<ChildStdout>,
    _folder: TempDir,
}

impl Daemon {
    /// Starts one on a free port.
    pub(crate) fn start() -> Result<Self> {
        let failed = |what: String| CliError::Failed(format!("{PROGRAM} does not start: {what}"));
        let own = std::env::current_exe().map_err(|error| failed(error.to_string()))?;
        let program = own.with_file_name(PROGRAM);
        let folder = tempfile::tempdir().map_err(|error| failed(error.to_string()))?;
        let mut child = Command::new(&program)
            .args(["serve", "--listen", "127.0.0.1:0", "--database"])
            .arg(folder.path().join("tuning.db"))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|error| failed(format!("{}: {error}; `make build` builds it", program.display())))?;
        let mut stdout = child.stdout.take().map(BufReader::new);
        let mut line = String::new();
        // A line that cannot be read is empty, which is reported below.
        let _ = stdout.as_mut().map(|stdout| stdout.read_line(&mut line));
        let url = line.split_whitespace().find(|word| word.starts_with("http://")).map(str::to_owned);
        match (stdout, url) {
            (Some(stdout), Some(url)) => Ok(Self { child, url, _stdout: stdout, _folder: folder }),
            _ => {
                // Best effort: it may have ended by itself.
                let _ = child.kill();
                let _ = child.wait();
                Err(failed(format!("it does not say where it listens but {line:?}")))
            }
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Its database goes with it, so nothing is lost by ending it at once.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

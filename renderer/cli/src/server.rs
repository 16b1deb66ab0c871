//! The daemon's address and the study's name, as arguments of every command that talks to it.

use std::time::Duration;

use clap::Args;
use treewright_accel::{Device, Isa};
use treewright_client::{CredentialArguments, Fingerprint, Options, blocking::Client, detect_fingerprint};

use crate::error::Result;

/// Where the service is, and which study.
#[derive(Args, Clone, Debug)]
pub struct ServerArguments {
    /// Address of the daemon; separate several that share a database by commas.
    #[arg(long, value_name = "URLS", env = "TREEWRIGHT_SERVER", default_value = "http://127.0.0.1:50611")]
    pub server: String,

    /// Id of the study. Default: one per objective and space, shared by all scenes and sizes.
    #[arg(long, value_name = "ID")]
    pub study: Option<String>,

    /// Maximum time that a frame waits for the daemon, in milliseconds. After that it is rendered with the
    /// last good configuration.
    #[arg(long, value_name = "MS", default_value_t = 500, value_parser = clap::value_parser!(u64).range(1..=60_000))]
    pub deadline_ms: u64,

    /// The credentials for it.
    #[command(flatten)]
    pub credentials: CredentialArguments,
}

/// The machine that the renderer runs on, with the instruction set that it is kept to, if it is.
pub fn machine() -> Fingerprint {
    let mut machine = detect_fingerprint();
    if let Some(isa) = Isa::widest() {
        isa.name().clone_into(&mut machine.isa);
    }
    machine
}

impl ServerArguments {
    /// Connects, and makes sure that a daemon answers.
    pub fn connect(&self, threads: usize) -> Result<Client> {
        self.connect_within(threads, Duration::from_millis(self.deadline_ms))
    }

    /// Connects with another time limit for calls.
    pub fn connect_within(&self, threads: usize, deadline: Duration) -> Result<Client> {
        let (major, minor, patch) = Device::open(threads)?.version();
        // What other versions of either measured does not hold for this one.
        let mut fingerprint = machine()
            .software("treewright-render", env!("CARGO_PKG_VERSION"))
            .software("embree", format!("{major}.{minor}.{patch}"));
        if threads > 0 {
            fingerprint = fingerprint.threads(u32::try_from(threads).unwrap_or(u32::MAX));
        }
        let options = Options::new()
            .deadline(deadline)
            .fingerprint(fingerprint)
            .credentials(self.credentials.credentials()?);
        let client = Client::connect(&self.server, options)?;
        client.ping()?;
        Ok(client)
    }
}

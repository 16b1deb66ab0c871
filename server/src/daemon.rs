//! The daemon as a process: addresses, database, signals, exit codes.

use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use treewright_store::{OpenError, SqliteStore, Store};

use crate::clock::SystemClock;
use crate::config::ServeConfig;
use crate::serve::{self, ServeError};

/// Why the daemon ended with an error. Each has an exit code of its own.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// The address cannot be had.
    #[error("cannot listen on {address}: {problem}; choose another address with --listen")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system said.
        problem: std::io::Error,
    },
    /// The database cannot be had.
    #[error("cannot open the database: {0}")]
    Database(#[from] OpenError),
    /// Serving failed.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// Something that the system should provide is missing.
    #[error("the system refuses: {0}")]
    System(#[from] std::io::Error),
}

impl DaemonError {
    /// The exit code; 2 is wrong usage, which the command line answers itself.
    #[must_use]
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Serve(_) | Self::System(_) => 1,
            Self::Listen { .. } => 3,
            Self::Database(_) => 4,
        }
    }
}

/// Serves until SIGTERM or SIGINT.
///
/// # Errors
/// [`DaemonError`], before the ready line is printed or after it.
pub async fn run(config: ServeConfig) -> Result<(), DaemonError> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    let listen_error = |problem| DaemonError::Listen { address: config.listen, problem };
    let listener = TcpListener::bind(config.listen).await.map_err(listen_error)?;
    let address = listener.local_addr()?;
    let store: Arc<dyn Store> = Arc::new(SqliteStore::open(&config.database).await?);
    tracing::info!(%address, database = %config.database.display(), "serving");

    // Connections are queued from the moment of binding, so that whoever reads this line can connect.
    let mut stdout = std::io::stdout();
    writeln!(stdout, "treewrightd listening on http://{address}")?;
    stdout.flush()?;

    let clock = Arc::new(SystemClock::default());
    let shutdown = async {
        tokio::select! {
            _ = terminate.recv() => tracing::info!("SIGTERM"),
            _ = interrupt.recv() => tracing::info!("SIGINT"),
        }
    };
    serve::run(listener, store, clock, config.drain(), shutdown).await?;
    Ok(())
}

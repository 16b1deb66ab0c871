//! The daemon as a process: addresses, database, signals, exit codes.

use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use treewright_store::{OpenError, PostgresStore, SqliteStore, Store};

use crate::clock::SystemClock;
use crate::config::{Database, ServeConfig};
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

/// Opens the database that was asked for.
async fn open(
    config: &ServeConfig,
    database: &Database,
    listening: SocketAddr,
) -> Result<Arc<dyn Store>, OpenError> {
    match database {
        Database::File(path) => Ok(Arc::new(SqliteStore::open(path).await?)),
        Database::Postgres(server) => {
            let advertise = config.database.advertise.clone();
            let advertise = advertise.unwrap_or_else(|| format!("http://{listening}"));
            let wait = config.database.wait();
            Ok(Arc::new(PostgresStore::open(server.clone(), &advertise, wait).await?))
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
    let database = config.database.read().map_err(|problem| OpenError::BadAddress { problem })?;
    let store = open(&config, &database, address).await?;
    tracing::info!(%address, %database, "serving");

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

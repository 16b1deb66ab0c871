//! The daemon as a process: addresses, database, signals, exit codes.

use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use tokio::net::TcpListener;
use tokio::signal::unix::{SignalKind, signal};
use treewright_store::tokens::TokenError;
use treewright_store::{OpenError, SqliteStore, SqliteTokens, Store, TokenStore};
#[cfg(feature = "postgres")]
use treewright_store::{PostgresStore, PostgresTokens};

use crate::access::Access;
use crate::clock::{SteadyClock, SystemClock};
use crate::config::{Database, ServeConfig};
use crate::descriptors::{self, DescriptorShares};
use crate::idle::idle_for;
use crate::listeners::Listeners;
use crate::metrics::Metrics;
use crate::serve::{self, Options, ServeError};
use crate::tls::{Tls, TlsError};
use crate::{limits, maintenance};

const LOCAL: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// Why the daemon ended with an error. Each has an exit code of its own.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    /// An address or a Unix socket cannot be bound: its name, the system's error, and what to choose instead.
    #[error("cannot listen on {0}: {1}; choose another {2}")]
    Listen(String, std::io::Error, &'static str),
    /// A socket that the system has opened must not be served.
    #[error("the socket passed on by the system cannot be used: {0}")]
    Inherited(String),
    /// The database cannot be opened.
    #[error("cannot open the database: {0}")]
    Database(#[from] OpenError),
    /// The certificates cannot be used.
    #[error("cannot use the certificates: {0}")]
    Tls(#[from] TlsError),
    /// The tokens cannot be read.
    #[error("cannot read the tokens: {0}")]
    Tokens(#[from] TokenError),
    /// Serving failed.
    #[error(transparent)]
    Serve(#[from] ServeError),
    /// A service of the operating system is missing.
    #[error("the operating system refuses: {0}")]
    System(#[from] std::io::Error),
}

impl DaemonError {
    /// The exit code; 2 is wrong usage, which the command line answers itself.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Serve(_) | Self::System(_) | Self::Tls(_) => 1,
            Self::Listen(..) | Self::Inherited(_) => 3,
            Self::Database(_) | Self::Tokens(_) => 4,
        }
    }
}

async fn open(
    config: &ServeConfig,
    database: &Database,
    listening: SocketAddr,
) -> Result<Arc<dyn Store>, OpenError> {
    #[cfg(not(feature = "postgres"))]
    let _ = (config, listening);
    match database {
        Database::File(path) => Ok(Arc::new(SqliteStore::open(path).await?)),
        #[cfg(feature = "postgres")]
        Database::Postgres(server) => {
            let advertise = config.advertised(listening);
            Ok(Arc::new(PostgresStore::open(server.clone(), &advertise, config.database.wait()).await?))
        }
    }
}

async fn open_tokens(config: &ServeConfig, database: &Database) -> Result<Arc<dyn TokenStore>, OpenError> {
    #[cfg(not(feature = "postgres"))]
    let _ = config;
    match database {
        Database::File(path) => Ok(Arc::new(SqliteTokens::open_served(path).await?)),
        #[cfg(feature = "postgres")]
        Database::Postgres(server) => {
            Ok(Arc::new(PostgresTokens::open(server, config.database.wait()).await?))
        }
    }
}

/// Serves until SIGTERM or SIGINT, and counts in `metrics`.
///
/// # Errors
/// [`DaemonError`], before the ready line is printed or after it.
pub async fn run(config: ServeConfig, metrics: Arc<Metrics>) -> Result<(), DaemonError> {
    let mut terminate = signal(SignalKind::terminate())?;
    let mut interrupt = signal(SignalKind::interrupt())?;
    // Without certificates to reload it is ignored, because closing a terminal should not end the daemon.
    let hang_up = signal(SignalKind::hangup())?;
    let shares = shares(&config)?;
    let refused = |name: String, other| move |problem| DaemonError::Listen(name, problem, other);
    let tls = config.peers.tls_files(&config.guard).map(Tls::load).transpose()?.map(Arc::new);
    let mut listeners = Listeners::inherited()?;
    if listeners.is_empty() {
        if !config.socket_only {
            let refused = refused(config.listen.to_string(), "address with --listen");
            listeners.bind_tcp(config.listen).await.map_err(refused)?;
        }
        if let Some(path) = &config.socket {
            let refused = refused(path.display().to_string(), "path with --socket");
            listeners.bind_unix(path).await.map_err(refused)?;
        }
    } else {
        config.check_inherited(&listeners.addresses()).map_err(DaemonError::Inherited)?;
    }
    // Without TCP only this machine can connect, as with a loopback address.
    let address = listeners.address().unwrap_or(LOCAL);
    let watch = match config.metrics {
        Some(address) => {
            let refused = refused(format!("{address} for metrics"), "address with --metrics");
            let watch = TcpListener::bind(address).await.map_err(refused)?;
            tracing::info!(address = %watch.local_addr()?, "metrics are served");
            Some(watch)
        }
        None => None,
    };
    let dashboard = match config.dashboard {
        Some(address) => {
            let refused = refused(format!("{address} for the dashboard"), "address with --dashboard");
            let dashboard = TcpListener::bind(address).await.map_err(refused)?;
            tracing::info!(url = %format!("http://{}/", dashboard.local_addr()?), "the dashboard is served");
            Some(dashboard)
        }
        None => None,
    };
    let database = config.database.read().map_err(OpenError::BadAddress)?;
    let store = open(&config, &database, address).await?;
    // Tokens end by the calendar, leases after a time.
    let (calendar, clock) = (Arc::new(SystemClock::default()), Arc::new(SteadyClock::new()));
    let access = if config.guard.asks_for_tokens(address) {
        let tokens = open_tokens(&config, &database).await?;
        Some(Arc::new(Access::open(tokens, calendar as _).await?))
    } else {
        None
    };
    announce(&config, &database, &listeners, access.as_deref())?;

    let reloading = tls.clone().map(|tls| tokio::spawn(async move { tls.follow(hang_up).await }));
    let idle = idle_for(config.idle_exit(), Arc::clone(&metrics));
    let shutdown = async {
        tokio::select! {
            _ = terminate.recv() => tracing::info!("SIGTERM"),
            _ = interrupt.recv() => tracing::info!("SIGINT"),
            () = idle => tracing::info!("nobody has asked for long"),
        }
    };
    let (studies_shown, keep_trials) = (config.metrics_studies, config.keep_trials);
    let (connections, admission) = (config.capacity.connections(&shares), config.capacity.admission());
    let backup_mark = match &database {
        Database::File(path) => Some(maintenance::backup_mark(path)),
        #[cfg(feature = "postgres")]
        Database::Postgres(_) => None,
    };
    let options = Options {
        drain: config.drain(),
        access,
        tls,
        watch,
        dashboard,
        dashboard_peers: config.named_dashboards(),
        studies_shown,
        keep_trials,
        connections,
        pages: Some(shares.pages),
        backup_mark,
        admission,
        metrics,
    };
    let served = serve::run(listeners, store, clock, options, shutdown).await;
    if let Some(reloading) = reloading {
        reloading.abort();
    }
    Ok(served?)
}

/// Raises the limit of descriptors and shares them out.
fn shares(config: &ServeConfig) -> std::io::Result<DescriptorShares> {
    let (descriptors, before) = descriptors::raise()?;
    let shares = DescriptorShares::of(descriptors);
    let connections = config.capacity.connections(&shares).total;
    tracing::debug!(descriptors, raised_from = before, connections, "open files and connections are limited");
    let asked = config.capacity.max_connections.map_or(limits::CONNECTIONS, |asked| asked as usize);
    if connections < asked {
        tracing::warn!(
            descriptors,
            connections,
            "fewer connections than the {asked} that should be possible; raise `ulimit -Hn`, or LimitNOFILE of the unit"
        );
    }
    Ok(shares)
}

/// Announces the service, in the log and, in one line, on standard output.
fn announce(
    config: &ServeConfig,
    database: &Database,
    listeners: &Listeners,
    access: Option<&Access>,
) -> std::io::Result<()> {
    let guard = &config.guard;
    let scheme = if guard.tls_cert.is_some() { "https" } else { "http" };
    let urls = listeners.urls(scheme);
    tracing::info!(
        addresses = ?urls,
        %database,
        tls = guard.tls_cert.is_some(),
        client_certificates = guard.tls_client_ca.is_some(),
        tokens = access.map(Access::live),
        "serving"
    );
    if access.is_some_and(|access| access.live() == 0) {
        tracing::warn!(
            "there is no token yet, so nobody can enter; make one with `treewrightd token create`"
        );
    }
    if let Some(address) = listeners.address().filter(|address| !address.ip().is_loopback())
        && access.is_none()
    {
        tracing::warn!(
            "no token is asked for: every program that reaches {address} can read and change every study"
        );
    }
    // Connections are queued from the moment of binding, so that a reader of this line can connect.
    let mut stdout = std::io::stdout();
    writeln!(stdout, "treewrightd listening on {}", urls.join(","))?;
    stdout.flush()
}

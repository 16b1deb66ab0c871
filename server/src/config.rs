//! The command line of `treewrightd`. Every option can also be set by an environment variable.

mod capacity;
mod dashboards;
mod database;
mod guard;
mod maintenance;
mod peers;
mod token;

use std::net::{SocketAddr, ToSocketAddrs as _};
use std::path::PathBuf;
use std::time::Duration;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};

use crate::limits::{DASHBOARD_PEERS, DRAIN_S, KEEP_TRIALS_MIN, STUDIES_SHOWN};
use crate::telemetry::LogFormat;

pub use capacity::CapacityConfig;
pub use dashboards::{DashboardPeer, DashboardToken};
pub use database::{Database, DatabaseArgument, DatabaseConfig};
pub use guard::GuardConfig;
pub use maintenance::{BackupConfig, FileDatabase, RestoreConfig};
pub use peers::PeersConfig;
pub use token::{CreateConfig, TokenCommand};

/// A tuning service for ray-tracing acceleration structures.
///
/// Clients ask over gRPC what to run next and report how long it took. The daemon keeps everything in one
/// database. What it has acknowledged survives a crash.
#[derive(Debug, Parser)]
#[command(name = "treewrightd", version, max_term_width = 100)]
pub struct Cli {
    /// The command.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Serve until SIGTERM or Ctrl-C.
    ///
    /// When ready, prints "treewrightd listening on http://ADDRESS" (https with TLS) on standard output. Logs
    /// to standard error. Exit codes: 0 stopped as requested, 1 failed, 2 wrong usage, 3 cannot listen on the
    /// address, 4 cannot open the database.
    Serve(Box<ServeConfig>),

    /// Create, list and revoke tokens. Needs write access to the database; running daemons notice changes at
    /// once.
    #[command(subcommand)]
    Token(TokenCommand),

    /// Back up a database file while the daemon runs. The copy contains everything acknowledged before. Exit
    /// codes: 0 done, 1 cannot write the copy, 2 wrong usage, 4 cannot read the database.
    Backup(BackupConfig),

    /// Restore a backup while no daemon runs on the database. The old file is kept under another name. Exit
    /// codes: 0 done, 1 cannot write the file, 2 wrong usage, 4 cannot use the database or the backup.
    Restore(RestoreConfig),

    /// Check a database file for damage; works while the daemon runs. Exit codes: 0 sound, 1 cannot read it,
    /// 2 wrong usage, 4 damaged, or not a database.
    Check(FileDatabase),

    /// Print the completion script for a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },

    /// Write the manual pages.
    Man {
        /// Folder to write them to.
        folder: PathBuf,
    },
}

/// Heading of the options by which a daemon is observed.
const MONITORING: &str = "Monitoring";
/// Heading of the options by which it is run.
const OPERATION: &str = "Operation";

/// How to serve.
#[derive(Clone, Debug, clap::Args)]
pub struct ServeConfig {
    /// Address and port to listen on; port 0 picks a free one.
    #[arg(long, env = "TREEWRIGHT_LISTEN", default_value = "127.0.0.1:50611", value_name = "ADDRESS", value_parser = address)]
    pub listen: SocketAddr,

    /// Also listen on this Unix socket, which only the daemon's own user can reach. Clients write it as
    /// unix:PATH. Sockets passed on by systemd replace this option and --listen.
    #[arg(long, env = "TREEWRIGHT_SOCKET", value_name = "PATH")]
    pub socket: Option<PathBuf>,

    /// Listen on the Unix socket only, on no port.
    #[arg(long, env = "TREEWRIGHT_SOCKET_ONLY", requires = "socket")]
    pub socket_only: bool,

    /// Where everything is kept.
    #[command(flatten)]
    pub database: DatabaseConfig,

    /// The callers that may enter, and their connections.
    #[command(flatten)]
    pub guard: GuardConfig,

    /// How much is taken on at once.
    #[command(flatten)]
    pub capacity: CapacityConfig,

    /// The other daemons on this daemon's database.
    #[command(flatten)]
    pub peers: PeersConfig,

    /// Serve /metrics for Prometheus, /livez and /readyz on this address and port, without tokens or
    /// encryption. Addresses beyond this machine need --insecure. Off by default.
    #[arg(long, env = "TREEWRIGHT_METRICS", value_name = "ADDRESS", value_parser = address, help_heading = MONITORING)]
    pub metrics: Option<SocketAddr>,

    /// Serve the dashboard on this address and port. It requires the daemon's tokens and does not encrypt:
    /// addresses beyond this machine need --insecure. Off by default.
    #[arg(long, env = "TREEWRIGHT_DASHBOARD", value_name = "ADDRESS", value_parser = address, help_heading = MONITORING)]
    pub dashboard: Option<SocketAddr>,

    /// Other daemons' dashboards whose studies the dashboard lists with its own, e.g.
    /// farm=http://127.0.0.1:8081. Addresses beyond this machine need --insecure.
    #[arg(long, env = "TREEWRIGHT_DASHBOARD_PEERS", value_name = "NAME=URL", value_delimiter = ',', value_parser = dashboards::peer, requires = "dashboard", help_heading = MONITORING)]
    pub dashboard_peers: Vec<DashboardPeer>,

    /// For a dashboard of --dashboard-peers that requires tokens: the file with one of its daemon, of scope
    /// read.
    #[arg(long, env = "TREEWRIGHT_DASHBOARD_TOKEN_FILES", value_name = "NAME=FILE", value_delimiter = ',', value_parser = dashboards::token_file, requires = "dashboard_peers", help_heading = MONITORING)]
    pub dashboard_token_files: Vec<DashboardToken>,

    /// How many studies, the most recently used, /metrics shows by name; 0 for none.
    #[arg(long, env = "TREEWRIGHT_METRICS_STUDIES", default_value_t = 16, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(..=i64::from(STUDIES_SHOWN)), help_heading = MONITORING)]
    pub metrics_studies: u16,

    /// Send traces of requests to this OpenTelemetry collector, over OTLP and gRPC, e.g.
    /// http://127.0.0.1:4317. Off by default.
    #[arg(long, env = "TREEWRIGHT_OTLP", value_name = "URL", value_parser = collector, help_heading = MONITORING)]
    pub otlp: Option<String>,

    /// Keep at least this many of the latest trials of each study. Older ones are removed in the background,
    /// except those that last measured a configuration its states remember, and only once a checkpoint covers
    /// what they taught. Default: keep all.
    #[arg(long, env = "TREEWRIGHT_KEEP_TRIALS", value_name = "COUNT", value_parser = clap::value_parser!(u64).range(KEEP_TRIALS_MIN..), help_heading = OPERATION)]
    pub keep_trials: Option<u64>,

    /// How long running requests may take to finish after SIGTERM, in seconds.
    #[arg(long, env = "TREEWRIGHT_DRAIN_S", default_value_t = 10, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(..=DRAIN_S), help_heading = OPERATION)]
    pub drain_s: u64,

    /// Exit after this many seconds without a request, and close the files that the daemon inherited from its
    /// parent. Default: never.
    #[arg(long, env = "TREEWRIGHT_IDLE_EXIT_S", value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..), help_heading = OPERATION)]
    pub idle_exit_s: Option<u64>,

    /// Log level: error, warn, info, debug, trace, or a list such as "info,treewright_server=debug".
    #[arg(long, env = "TREEWRIGHT_LOG", default_value = "info", value_name = "FILTER", help_heading = MONITORING)]
    pub log: String,

    /// Log format.
    #[arg(long, env = "TREEWRIGHT_LOG_FORMAT", default_value = "text", value_name = "FORMAT", help_heading = MONITORING)]
    pub log_format: LogFormat,
}

impl ServeConfig {
    /// Checks the database options, and that other replicas can reach this one.
    fn check_database(&self) -> Result<(), String> {
        let database = self.database.read()?;
        if self.socket_only && database.is_shared() && self.peers.advertise.is_none() {
            return Err(
                "other daemons on the same database cannot reach a Unix socket; leave out --socket-only"
                    .to_owned(),
            );
        }
        self.peers.check(&database, self.listen, &self.guard)
    }

    /// Checks the TCP addresses that the system has opened for the daemon. The first has to be the one of
    /// `--listen`, on which the access rules rest. A further one must not be open to more callers.
    pub fn check_inherited(&self, addresses: &[SocketAddr]) -> Result<(), String> {
        let Some((first, others)) = addresses.split_first() else {
            return Ok(());
        };
        let is_port = self.listen.port() == 0 || first.port() == self.listen.port();
        if first.ip() != self.listen.ip() || !is_port {
            return Err(format!(
                "systemd passed on a socket at {first}, but --listen names another address; make them equal"
            ));
        }
        for own in others {
            self.guard.check(*own)?;
            if self.guard.asks_for_tokens(*own) && !self.guard.asks_for_tokens(*first) {
                return Err(format!(
                    "systemd passed on a socket at {own} as well, which other machines can reach, and no tokens \
                     are asked for at {first}; say --tokens, or leave one of them out"
                ));
            }
        }
        Ok(())
    }

    /// The other dashboards, each with its token.
    pub fn named_dashboards(&self) -> Vec<DashboardPeer> {
        let token = |name: &str| self.dashboard_token_files.iter().find(|token| token.name == name);
        let peers = self.dashboard_peers.iter().cloned();
        peers
            .map(|peer| DashboardPeer { token: token(&peer.name).map(|token| token.header.clone()), ..peer })
            .collect()
    }

    /// Checks that each of the other dashboards has a name of its own, and that no token goes over a network
    /// by mistake.
    fn check_dashboards(&self) -> Result<(), String> {
        let peers = &self.dashboard_peers;
        if peers.len() > DASHBOARD_PEERS {
            return Err(format!(
                "--dashboard-peers names {}; at most {DASHBOARD_PEERS} are allowed",
                peers.len()
            ));
        }
        let twice =
            peers.iter().enumerate().find(|(at, one)| peers[..*at].iter().any(|two| two.name == one.name));
        if let Some((_, peer)) = twice {
            return Err(format!("--dashboard-peers has two of the name {:?}; give each its own", peer.name));
        }
        let is_known = |name: &str| peers.iter().any(|peer| peer.name == name);
        if let Some(token) = self.dashboard_token_files.iter().find(|token| !is_known(&token.name)) {
            let name = &token.name;
            return Err(format!(
                "--dashboard-token-files: no dashboard of --dashboard-peers is called {name:?}"
            ));
        }
        let far_peer = peers.iter().find(|peer| !peer.is_near() && !self.guard.insecure);
        match far_peer {
            None => Ok(()),
            Some(peer) => Err(format!(
                "--dashboard-peers {} sends a token and reads lists of studies without encryption; let a tunnel or \
                 a proxy on this machine pass them on, or add --insecure if you trust the network",
                peer.url()
            )),
        }
    }

    /// Checks that the figures and the dashboard are not exposed beyond this machine by mistake.
    fn check_watchers(&self) -> Result<(), String> {
        let far = |address: &Option<SocketAddr>| address.filter(|address| !address.ip().is_loopback());
        let remedy = "use 127.0.0.1, or add --insecure if you trust the network";
        match (far(&self.metrics), far(&self.dashboard)) {
            _ if self.guard.insecure => Ok(()),
            (Some(address), _) => Err(format!(
                "--metrics {address} can be reached from other machines without encryption or tokens; {remedy}"
            )),
            (_, Some(address)) => Err(format!(
                "--dashboard {address} can be reached from other machines without encryption; {remedy}"
            )),
            _ => Ok(()),
        }
    }

    /// The address of this daemon for others on its database; it listens there.
    #[cfg(feature = "postgres")]
    pub fn advertised(&self, listening: SocketAddr) -> String {
        self.peers.advertise.clone().unwrap_or_else(|| {
            let scheme = if self.guard.tls_cert.is_some() { "https" } else { "http" };
            format!("{scheme}://{listening}")
        })
    }

    /// The idle time after which the daemon ends.
    pub fn idle_exit(&self) -> Option<Duration> {
        self.idle_exit_s.map(Duration::from_secs)
    }

    /// How long draining may take.
    pub fn drain(&self) -> Duration {
        Duration::from_secs(self.drain_s)
    }
}

impl Cli {
    /// Reads the arguments and checks their combination.
    ///
    /// # Errors
    /// A message for people; [`clap::Error::exit`] prints it and ends with the right code.
    pub fn read<I, T>(arguments: I) -> Result<Self, clap::Error>
    where
        I: IntoIterator<Item = T>,
        T: Into<std::ffi::OsString> + Clone,
    {
        let mut command = without_empty_variables(Self::command());
        let matches = command.try_get_matches_from_mut(arguments)?;
        let cli = Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))?;
        let Command::Serve(serve) = &cli.command else {
            return Ok(cli);
        };
        if let Err(problem) = serve.guard.check(serve.listen) {
            return Err(Self::command().error(ErrorKind::ValueValidation, problem));
        }
        let checked = serve.check_database().and_then(|()| serve.check_watchers());
        if let Err(problem) = checked.and_then(|()| serve.check_dashboards()) {
            return Err(Self::command().error(ErrorKind::ValueValidation, problem));
        }
        if let Err(error) = crate::telemetry::filter(&serve.log) {
            let problem = format!("--log {:?}: {error}", serve.log);
            return Err(Self::command().error(ErrorKind::ValueValidation, problem));
        }
        Ok(cli)
    }
}

/// The command with empty environment variables treated as unset, as `VARIABLE=` in a settings file or
/// `${VARIABLE:-}` in a container file means them.
fn without_empty_variables(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|argument| {
        let value = argument.get_env().and_then(std::env::var_os);
        if value.is_some_and(|value| value.is_empty()) {
            argument.env(None::<&'static str>)
        } else {
            argument
        }
    });
    command.mut_subcommands(without_empty_variables)
}

/// `ADDRESS:PORT`, where the address may be a name such as `localhost`.
fn address(text: &str) -> Result<SocketAddr, String> {
    let mut found = text
        .to_socket_addrs()
        .map_err(|error| format!("{error}; write ADDRESS:PORT, for example 127.0.0.1:50611"))?;
    found.next().ok_or_else(|| "the name has no address".to_owned())
}

/// `http://ADDRESS:PORT` of a collector. One that is far away is best reached through one that is near.
fn collector(text: &str) -> Result<String, String> {
    match text.parse::<http::Uri>() {
        Ok(url) if url.scheme_str() == Some("http") && url.host().is_some() => Ok(text.to_owned()),
        _ => {
            Err("write http://ADDRESS:PORT; for https let a collector on this machine pass spans on"
                .to_owned())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::descriptors::DescriptorShares;

    fn read(arguments: &[&str]) -> Result<ServeConfig, clap::Error> {
        let all = ["treewrightd", "serve"].iter().chain(arguments);
        match Cli::read(all)?.command {
            Command::Serve(serve) => Ok(*serve),
            other => unreachable!("it says serve, not {other:?}"),
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn defaults_are_safe() {
        let config = read(&["--database", "x.db"]).unwrap();
        assert!(config.listen.ip().is_loopback());
        assert_eq!(config.listen.port(), 50611);
        assert!(!config.guard.insecure);
        assert!(!config.guard.asks_for_tokens(config.listen));
        assert_eq!(config.drain(), Duration::from_secs(10));
    }

    #[test]
    fn the_capacity_is_what_was_asked_for() {
        let asked = "--database x --max-connections 40 --max-connections-per-address 7 --max-streams 5 \
                     --max-requests 3";
        let capacity = read(&asked.split(' ').collect::<Vec<_>>()).unwrap().capacity;
        let connections = capacity.connections(&DescriptorShares::of(1024));
        assert_eq!((connections.total, connections.per_address), (40, 7));
        let admission = capacity.admission();
        assert_eq!((admission.streams, admission.requests), (5, 3));
    }

    #[test]
    fn mistakes_are_usage_errors() {
        for (arguments, fragment) in [
            ("--listen 127.0.0.1:0", "--database"),
            ("--database=", "it is empty"),
            ("--database x --max-connections 0", "65536"),
            ("--database x --max-requests 4001", "4000"),
            ("--database x --listen 0.0.0.0:1", "--insecure"),
            ("--database x --listen [::]:1", "--insecure"),
            ("--database x --listen 0.0.0.0:1 --tokens", "--tls-cert"),
            ("--database x --tls-cert c", "--tls-key"),
            ("--database x --tls-client-ca c", "--tls-cert"),
            ("--database x --listen 127.0.0.1", "ADDRESS:PORT"),
            ("--database x --drain-s 3601", "3600"),
            ("--database x --keep-trials 19999", "20000"),
            ("--database x --log-format xml", "json"),
            ("--database x --log a=b=c", "--log"),
            ("--database x --colour", "--colour"),
            ("--database x --metrics 0.0.0.0:1", "--insecure"),
            ("--database x --metrics 9464", "ADDRESS:PORT"),
            ("--database x --dashboard 0.0.0.0:1", "--insecure"),
            ("--database x --dashboard-peers a=http://127.0.0.1:1", "--dashboard"),
            ("--database x --dashboard 127.0.0.1:0 --dashboard-peers a=http://10.0.0.7:1", "--insecure"),
            (
                "--database x --dashboard [::1]:0 --dashboard-peers a=http://127.0.0.1:1,a=http://127.0.0.1:2",
                "two of the name",
            ),
            ("--database x --metrics-studies 65", "64"),
            ("--database x --otlp 127.0.0.1:4317", "http://ADDRESS:PORT"),
            ("--database x --advertise http://a:1", "--database postgres://"),
            ("--database postgres://u@h/d --peer-ca c", "--tls-cert"),
            ("--database postgres://u@h/d --tls-cert c --tls-key k --advertise http://a:1", "by https://"),
            ("--database postgres://u:geheim@h/d --advertise a:1", "write http://HOST:PORT"),
            ("--database postgres://u:geheim@h", "names no database"),
            ("--database postgres://u:geheim@h:x/d", "postgres://USER@HOST"),
            ("--database postgres://u@h/d --database-password-file /missing", "/missing"),
        ] {
            let arguments: Vec<&str> = arguments.split(' ').collect();
            let error = read(&arguments).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{error}");
            assert!(error.to_string().contains(fragment), "{error}");
            assert!(!error.to_string().contains("geheim"), "{error}");
        }
        let shared = ["--database", "postgres://u:geheim@h/d", "--listen", "0.0.0.0:1", "--insecure"];
        assert!(read(&shared).unwrap_err().to_string().contains("--advertise"));
        let config = read(&[&shared[..], &["--advertise", "http://a:1"]].concat()).unwrap();
        assert!(!format!("{config:?}").contains("geheim"), "{config:?}");
        let trusted = ["--database", "x", "--listen", "0.0.0.0:1", "--insecure"];
        let trusted = read(&trusted).unwrap();
        assert!(!trusted.guard.asks_for_tokens(trusted.listen));
        let guarded = ["--database", "x", "--listen", "0.0.0.0:1", "--tls-cert", "c", "--tls-key", "k"];
        let guarded = read(&guarded).unwrap();
        assert!(guarded.guard.asks_for_tokens(guarded.listen));
        let replica =
            ["--database", "postgres://u@h/d", "--listen", "0.0.0.0:1", "--advertise", "https://a:1"];
        let replica = read(&[&replica[..], &["--tls-cert", "c", "--tls-key", "k"]].concat()).unwrap();
        assert!(replica.guard.asks_for_tokens(replica.listen));
    }

    #[test]
    fn no_socket_of_the_system_is_open_to_more_callers_than_the_first() {
        let plain = read(&["--database", "x"]).unwrap();
        let check = |config: &ServeConfig, addresses: &[&str]| {
            let parsed = addresses.iter().map(|text| text.parse().expect("an address"));
            config.check_inherited(&parsed.collect::<Vec<_>>())
        };
        let (near, far) = ("127.0.0.1:50611", "10.0.0.7:50612");
        check(&plain, &[]).expect("a Unix socket alone");
        check(&plain, &[near, "[::1]:50611"]).expect("both are of this machine");
        assert!(check(&plain, &[far]).unwrap_err().contains("--listen"));
        assert!(check(&plain, &[near, far]).unwrap_err().contains("--tls-cert"));
        let encrypted = ["--database", "x", "--tls-cert", "c", "--tls-key", "k"];
        let config = read(&encrypted).unwrap();
        assert!(check(&config, &[near, far]).unwrap_err().contains("--tokens"));
        for more in ["--tokens", "--insecure"] {
            let config = read(&[&encrypted[..], &[more]].concat()).unwrap();
            check(&config, &[near, far]).expect("it was said");
        }
    }

    #[test]
    fn options_about_other_daemons_stand_under_their_own_heading() {
        let mut command = Cli::command();
        command.build();
        let serve = command.find_subcommand("serve").expect("serve");
        let peers =
            serve.get_arguments().filter(|one| one.get_help_heading().is_some_and(|h| h.contains("daemons")));
        let names: Vec<_> = peers.map(|one| one.get_id().as_str()).collect();
        assert_eq!(names, ["advertise", "peer_ca", "peer_name"]);
    }
}

//! The database: a file, or a PostgreSQL server. An address may hold a password, so it is never shown as
//! given, neither in a log nor in an error.

use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;

#[cfg(feature = "postgres")]
use treewright_store::PostgresAddress;
use treewright_store::is_postgres_address;

/// The options that say where everything is kept.
#[derive(Clone, Debug, clap::Args)]
pub struct DatabaseConfig {
    /// Database file, created if missing; or postgres://USER@HOST/DATABASE, which several daemons can share.
    #[arg(long, env = "TREEWRIGHT_DATABASE", hide_env_values = true, value_name = "FILE or URL")]
    pub database: DatabaseArgument,

    /// File with the PostgreSQL password. Default: the password from PGPASSFILE, ~/.pgpass, PGPASSWORD or the
    /// address.
    #[arg(long, env = "TREEWRIGHT_DATABASE_PASSWORD_FILE", value_name = "FILE")]
    pub database_password_file: Option<PathBuf>,

    /// How long to wait for PostgreSQL to become available, in seconds.
    #[arg(long, env = "TREEWRIGHT_DATABASE_WAIT_S", default_value_t = 10, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(..=3600))]
    pub database_wait_s: u64,
}

/// The database option as given. Only the path of a file is shown.
#[derive(Clone)]
pub struct DatabaseArgument(String);

impl FromStr for DatabaseArgument {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text.is_empty() {
            return Err("it is empty; name a file, or postgres://USER@HOST/DATABASE");
        }
        Ok(Self(text.to_owned()))
    }
}

impl std::fmt::Debug for DatabaseArgument {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(if is_postgres_address(&self.0) { "postgres://..." } else { &self.0 })
    }
}

/// The database of the daemon.
#[derive(Clone, Debug)]
pub enum Database {
    /// A file that this daemon alone serves.
    File(PathBuf),
    /// A database that several daemons may share.
    #[cfg(feature = "postgres")]
    Postgres(PostgresAddress),
}

impl Database {
    /// Whether several daemons may share it.
    pub fn is_shared(&self) -> bool {
        !matches!(self, Self::File(_))
    }
}

impl std::fmt::Display for Database {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::File(path) => write!(formatter, "{}", path.display()),
            #[cfg(feature = "postgres")]
            Self::Postgres(address) => formatter.write_str(&address.shown()),
        }
    }
}

impl DatabaseConfig {
    /// Reads the option, with the password from its file.
    ///
    /// # Errors
    /// The mistake and its remedy, without any password.
    pub fn read(&self) -> Result<Database, String> {
        let DatabaseArgument(text) = &self.database;
        if !is_postgres_address(text) {
            return match &self.database_password_file {
                Some(_) => Err("--database-password-file goes with --database postgres://...".to_owned()),
                None => Ok(Database::File(PathBuf::from(text))),
            };
        }
        self.read_address(text)
    }

    #[cfg(not(feature = "postgres"))]
    fn read_address(&self, _text: &str) -> Result<Database, String> {
        Err("this program was built without PostgreSQL; build it with `--features postgres`, or name a file"
            .to_owned())
    }

    #[cfg(feature = "postgres")]
    fn read_address(&self, text: &str) -> Result<Database, String> {
        let address = PostgresAddress::parse(text).map_err(|error| error.to_string())?;
        let Some(file) = &self.database_password_file else {
            return Ok(Database::Postgres(address));
        };
        let password = std::fs::read_to_string(file).map_err(|error| {
            format!("the password file {} cannot be read ({error}); check path and rights", file.display())
        })?;
        Ok(Database::Postgres(address.password(password.trim_end_matches(['\r', '\n']))))
    }

    /// How long to wait for a server.
    pub fn wait(&self) -> Duration {
        Duration::from_secs(self.database_wait_s)
    }
}

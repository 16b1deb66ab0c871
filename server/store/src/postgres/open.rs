//! Connecting: address, settings, migrations, and clear errors.

use std::str::FromStr as _;
use std::time::Duration;

use sqlx::migrate::MigrateError;
use sqlx::postgres::{PgConnectOptions, PgConnection, PgPool, PgPoolOptions};
use sqlx::{AssertSqlSafe, ConnectOptions as _, Connection as _, Executor as _};
use tokio::time::{Instant, sleep, timeout};

use super::statements as sql;
use crate::error::OpenError;
use crate::{limits, migrations};

/// The oldest PostgreSQL that supports the statements.
const OLDEST_SERVER: i32 = 130_000;

/// Pause between attempts to reach a server that may be starting.
const PAUSE: Duration = Duration::from_millis(200);

/// The interval of log messages while a start waits.
const SAID_AGAIN: Duration = Duration::from_secs(10);

/// The address of a database with the credentials. Its text shows no password.
#[derive(Clone)]
pub struct PostgresAddress {
    options: Box<PgConnectOptions>,
}

impl PostgresAddress {
    /// Reads `postgres://USER:PASSWORD@HOST:PORT/DATABASE`, to which the usual parameters may be added, such
    /// as `?sslmode=verify-full`. Missing parts come from the environment (`PGPASSWORD`, `PGPASSFILE`, ...)
    /// as with PostgreSQL's own programs.
    ///
    /// # Errors
    /// [`OpenError::BadAddress`], which does not repeat the address: it may hold a password.
    pub fn parse(url: &str) -> Result<Self, OpenError> {
        let bad = |problem: &str| OpenError::BadAddress(problem.to_owned());
        if !crate::is_postgres_address(url) {
            return Err(bad("it does not begin with postgres://"));
        }
        // The parser's message could quote the address.
        let options = PgConnectOptions::from_str(url).map_err(|_| bad("it is not a URL"))?;
        if options.get_database().is_none_or(str::is_empty) {
            return Err(bad("it names no database"));
        }
        let options = options.application_name("treewrightd").disable_statement_logging();
        Ok(Self { options: Box::new(options) })
    }

    /// Sets the password.
    #[must_use]
    pub fn password(self, password: &str) -> Self {
        Self { options: Box::new(self.options.password(password)) }
    }

    /// The address for people: user, host, port and database.
    pub fn shown(&self) -> String {
        let options = &self.options;
        let host = match options.get_socket() {
            Some(socket) => socket.display().to_string(),
            None => options.get_host().to_owned(),
        };
        let database = options.get_database().unwrap_or_default();
        format!("postgres://{}@{host}:{}/{database}", options.get_username(), options.get_port())
    }

    pub(super) fn options(&self) -> &PgConnectOptions {
        &self.options
    }

    /// A separate connection, ready for use.
    pub(super) async fn connect(&self) -> Result<PgConnection, sqlx::Error> {
        let connecting = async {
            let mut connection = PgConnection::connect_with(&self.options).await?;
            connection.execute(sql::SETTINGS).await?;
            Ok(connection)
        };
        timeout(limits::POSTGRES_CONNECT_TIMEOUT, connecting).await.unwrap_or_else(|_| Err(silent()))
    }

    /// A pool of at most `connections` connections for questions, of which the server breaks off those that
    /// take too long. None is made yet.
    pub(super) fn pool(&self, connections: u32) -> PgPool {
        assert!(connections > 0, "a question would wait for a connection for ever");
        PgPoolOptions::new()
            .max_connections(connections)
            .acquire_timeout(limits::POSTGRES_READER_TIMEOUT)
            .after_connect(|connection, _| {
                Box::pin(async move {
                    let longest_ms = limits::POSTGRES_QUESTION_TIMEOUT.as_millis();
                    let settings = format!("{}; SET statement_timeout = {longest_ms}", sql::SETTINGS);
                    connection.execute(AssertSqlSafe(settings)).await.map(|_| ())
                })
            })
            .connect_lazy_with(self.options().clone())
    }
}

impl std::fmt::Debug for PostgresAddress {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str(&self.shown())
    }
}

/// The error for a server that takes a connection and then says nothing.
pub(super) fn silent() -> sqlx::Error {
    sqlx::Error::Io(std::io::Error::new(std::io::ErrorKind::TimedOut, "the server does not answer"))
}

/// Connects and brings the schema up to date. It waits up to `patience` for a server that does not answer
/// yet, and without limit for one that says it is starting: recovery after a crash can take many minutes.
pub(super) async fn open(address: &PostgresAddress, patience: Duration) -> Result<PgConnection, OpenError> {
    let mut until = Instant::now() + patience;
    let mut said: Option<Instant> = None;
    loop {
        let error = match prepare(address).await {
            Err(error @ OpenError::Starting { .. }) => {
                until = Instant::now() + patience.max(2 * PAUSE);
                error
            }
            Err(error @ OpenError::Unreachable { .. }) if Instant::now() + PAUSE < until => error,
            result => return result,
        };
        if said.is_none_or(|said| said.elapsed() >= SAID_AGAIN) {
            tracing::warn!(%error, wait_s = patience.as_secs(), "waiting for the database");
            said = Some(Instant::now());
        }
        sleep(PAUSE).await;
    }
}

async fn prepare(address: &PostgresAddress) -> Result<PgConnection, OpenError> {
    let server = address.shown();
    let explained = |error: sqlx::Error| explain(&server, &error);
    let unfit = |problem: String| OpenError::Unfit(server.clone(), problem);
    let mut connection = address.connect().await.map_err(explained)?;
    let (version, fsync): (i32, String) =
        sqlx::query_as(sql::SERVER).fetch_one(&mut connection).await.map_err(explained)?;
    if version < OLDEST_SERVER {
        let (found, oldest) = (version / 10_000, OLDEST_SERVER / 10_000);
        return Err(unfit(format!("the server is PostgreSQL {found}; use {oldest} or newer")));
    }
    if fsync != "on" {
        tracing::warn!(database = %server, "fsync is off: a crash of the server can lose what was acknowledged");
    }
    let foreign: Option<bool> =
        sqlx::query_scalar(sql::FOREIGN).fetch_one(&mut connection).await.map_err(explained)?;
    if foreign == Some(true) {
        return Err(unfit("it holds the tables of another program; name a database of its own".to_owned()));
    }
    migrations::postgres().run(&mut connection).await.map_err(|error| match error {
        MigrateError::VersionMissing(version) => unfit(format!(
            "it was written by a newer treewrightd (schema version {version}, this one knows {}); upgrade this program",
            migrations::postgres().iter().map(|m| m.version).max().unwrap_or(0)
        )),
        MigrateError::Execute(error) | MigrateError::ExecuteMigration(error, _) => explained(error),
        other => unfit(format!("its tables are not ours or have been altered ({other}); name another database or restore a backup")),
    })?;
    Ok(connection)
}

/// The secret that only replicas find, in the database.
pub(super) async fn replica_key(connection: &mut PgConnection, server: &str) -> Result<[u8; 32], OpenError> {
    let found: Result<Vec<u8>, _> = sqlx::query_scalar(sql::REPLICA_KEY).fetch_one(connection).await;
    let key = found.map_err(|error| explain(server, &error))?;
    key.try_into().map_err(|_| {
        OpenError::Unfit(server.to_owned(), "the replicas' key has not 32 bytes; restore a backup".to_owned())
    })
}

/// Translates SQLSTATE classes; see the appendix "PostgreSQL Error Codes" of its manual.
fn explain(server: &str, error: &sqlx::Error) -> OpenError {
    let server = server.to_owned();
    let Some(database) = error.as_database_error() else {
        return OpenError::Unreachable(server, error.to_string());
    };
    let problem = database.message().to_owned();
    match database.code().as_deref() {
        // "cannot connect now": it starts, recovers or shuts down.
        Some("57P03") => OpenError::Starting(server, problem),
        // Shutting down; too many connections.
        Some("57P01" | "57P02" | "53300") => OpenError::Unreachable(server, problem),
        _ => OpenError::Refused(server, problem),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_shown_without_their_password() {
        let address = PostgresAddress::parse("postgres://anna:geheim@db:5433/farm").unwrap();
        assert_eq!(address.shown(), "postgres://anna@db:5433/farm");
        assert_eq!(format!("{address:?}"), "postgres://anna@db:5433/farm");
        assert!(!format!("{:?}", address.password("anders")).contains("anders"));
    }

    #[test]
    fn bad_addresses_are_not_repeated() {
        for bad in ["postgres://u:geheim@host:port/x", "postgres://u:geheim@host", "mysql://u:geheim@h/d"] {
            let error = PostgresAddress::parse(bad).unwrap_err().to_string();
            assert!(!error.contains("geheim") && error.contains("postgres://USER@HOST"), "{error}");
        }
    }
}

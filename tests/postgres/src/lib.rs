//! PostgreSQL for tests: the server that `DATABASE_URL` names, or a private one that this process starts,
//! and a database of its own for each test.
//!
//! A private server lives in a temporary folder, listens on a free port of the loopback, and has fsync on. It
//! ends with the process that started it, also after a crash. PostgreSQL refuses to run as root; for root it
//! runs as the user `postgres`, or `nobody`.

mod server;
mod user;

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use sqlx::{AssertSqlSafe, Connection as _, Executor as _, PgConnection};

pub use server::Server;

/// A new, empty database. Removed when dropped, where the server is not the process's own.
pub struct Database {
    url: String,
    /// The server's own database, through which this one is removed; none for a private server, which takes
    /// everything along.
    remove_through: Option<String>,
}

impl Database {
    /// Makes a database on the server of `DATABASE_URL`, or else on one that this process starts once.
    pub async fn create() -> Self {
        static PRIVATE: OnceLock<Server> = OnceLock::new();
        match std::env::var("DATABASE_URL") {
            Ok(given) => {
                let url = Self::create_on(&given).await;
                Self { url, remove_through: Some(given) }
            }
            Err(_) => {
                let server = tokio::task::spawn_blocking(|| PRIVATE.get_or_init(Server::start));
                let server = server.await.expect("a PostgreSQL server starts");
                Self { url: Self::create_on(&server.url("postgres")).await, remove_through: None }
            }
        }
    }

    /// Makes a database on a server and returns its address. `through` is the address of any other database
    /// there.
    pub async fn create_on(through: &str) -> String {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("treewright_test_{}_{number}", std::process::id());
        let mut connection = PgConnection::connect(through).await.expect("the server lets us in");
        let statement = format!("CREATE DATABASE {name}");
        // The template is locked while another test copies it.
        for _ in 0..200 {
            match connection.execute(AssertSqlSafe(statement.as_str())).await {
                Ok(_) => break,
                Err(error) => {
                    let busy = error.as_database_error().and_then(|e| e.code()).as_deref() == Some("55006");
                    assert!(busy, "the database cannot be made: {error}");
                    tokio::time::sleep(Duration::from_millis(50)).await;
                }
            }
        }
        // The part behind the database's name stays: DATABASE_URL may carry parameters.
        let (address, parameters) = through.split_once('?').unwrap_or((through, ""));
        let server = address.rsplit_once('/').map_or(address, |(server, _)| server);
        let mark = if parameters.is_empty() { "" } else { "?" };
        format!("{server}/{name}{mark}{parameters}")
    }

    /// Its address, with a password.
    pub fn url(&self) -> &str {
        &self.url
    }

    /// A direct connection to it, past the tested code.
    pub async fn connect(&self) -> PgConnection {
        PgConnection::connect(&self.url).await.expect("the server lets us in")
    }
}

/// The address of the replica that holds a study, if one does.
pub async fn holder_of(connection: &mut PgConnection, study: &str) -> Option<String> {
    let holder = "SELECT replicas.address FROM studies JOIN replicas ON replicas.id = studies.owner WHERE studies.name = $1";
    sqlx::query_scalar(holder).bind(study).fetch_optional(connection).await.expect("the server answers")
}

impl Drop for Database {
    fn drop(&mut self) {
        let Some(through) = self.remove_through.clone() else { return };
        let name = self.url.split('?').next().and_then(|url| url.rsplit('/').next()).unwrap_or_default();
        let statement = format!("DROP DATABASE IF EXISTS {name} WITH (FORCE)");
        // A test's runtime cannot be waited on from within; one of another thread can.
        let removing = std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
            if let Ok(runtime) = runtime {
                let _ = runtime.block_on(async {
                    PgConnection::connect(&through).await?.execute(AssertSqlSafe(statement)).await
                });
            }
        });
        let _ = removing.join();
    }
}

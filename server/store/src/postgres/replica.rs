//! A replica's life in the database: its row, its heartbeat, its lock, and the notices of the others.
//!
//! Safety rests on none of this: every write is checked against the study's epoch (see
//! [`fence`](crate::fence)). It only decides how soon others take over. A killed replica loses its connection
//! and with it its lock, which shows at once. One that is cut off stops renewing its heartbeat, which shows
//! after [`REPLICA_LAPSE`](limits::REPLICA_LAPSE).

use std::sync::Arc;
use std::time::Duration;

use sqlx::Connection as _;
use sqlx::postgres::{PgConnection, PgListener, PgPoolOptions};
use tokio::sync::oneshot;
use tokio::time::{sleep, timeout};

use super::open::silent;
use super::shared::SharedState;
use super::statements as sql;
use super::studies;
use crate::limits;

/// Pause after an attempt to come back to the database.
const RETRY: Duration = Duration::from_millis(100);

/// Pieces of deleted studies that are removed between two heartbeats.
const REAPS_PER_BEAT: usize = 4;

/// Enters a new replica and takes its lock on this connection.
pub(super) async fn register(connection: &mut PgConnection, advertised: &str) -> Result<i32, sqlx::Error> {
    let me: i32 =
        sqlx::query_scalar(sql::REPLICA_INSERT).bind(advertised).fetch_one(&mut *connection).await?;
    // Other replicas at most ask for a moment whether the lock is taken, so it is free soon.
    while !take_lock(connection, me).await? {
        sleep(RETRY).await;
    }
    Ok(me)
}

async fn take_lock(connection: &mut PgConnection, me: i32) -> Result<bool, sqlx::Error> {
    sqlx::query_scalar(sql::REPLICA_LOCK).bind(me).fetch_one(connection).await
}

/// Renews the heartbeat until `leave` has a message. If `leave` closes without one, the replica ends as if
/// killed.
pub(super) async fn live(
    shared: Arc<SharedState>,
    connection: PgConnection,
    mut leave: oneshot::Receiver<()>,
) {
    let mut session = Some(connection);
    loop {
        let pause = if session.is_some() { limits::HEARTBEAT } else { RETRY };
        let left = tokio::select! {
            left = &mut leave => Some(left.is_ok()),
            () = sleep(pause) => None,
        };
        if let Some(politely) = left {
            if let Some(connection) = session.filter(|_| politely) {
                say_good_bye(&shared, connection).await;
            }
            return;
        }
        let was_there = session.is_some();
        let beaten = timeout(limits::POSTGRES_WRITE_TIMEOUT, beat(&shared, session.take())).await;
        session = match beaten.unwrap_or_else(|_| Err(silent())) {
            Ok(connection) => Some(connection),
            Err(error) => {
                // Not a line for each of the ten looks a second.
                if was_there {
                    tracing::warn!(%error, "the database is away; looking for it");
                }
                None
            }
        };
    }
}

/// One heartbeat and some housework. A lost connection is made again.
async fn beat(shared: &SharedState, session: Option<PgConnection>) -> Result<PgConnection, sqlx::Error> {
    let (mut connection, is_new) = match session {
        Some(connection) => (connection, false),
        None => (shared.database.connect().await?, true),
    };
    let me = shared.me();
    let locked = !is_new || take_lock(&mut connection, me).await?;
    let rows = sqlx::query(sql::REPLICA_BEAT).bind(me).execute(&mut connection).await?.rows_affected();
    assert!(rows <= 1, "{rows} replicas have the id {me}");
    let known = rows == 1;
    if locked && known {
        if is_new {
            tracing::info!(replica = me, "the database is back");
        }
    } else {
        // The row was removed because the replica seemed dead, or an old connection still holds the lock at
        // the server.
        sqlx::query(sql::REPLICA_DELETE).bind(me).execute(&mut connection).await?;
        let new_id = register(&mut connection, &shared.advertised).await?;
        debug_assert_ne!(new_id, me, "who holds the earlier id would hold its studies");
        tracing::warn!(replica = new_id, earlier = me, "registered again; every study is loaded again");
        shared.become_replica(new_id);
    }
    let reaping =
        sqlx::query(sql::REPLICAS_REAP).bind(shared.me()).bind(limits::REPLICA_ROW_KEPT.as_secs_f64());
    reaping.execute(&mut connection).await?;
    for _ in 0..REAPS_PER_BEAT {
        if !studies::reap(&mut connection).await? {
            break;
        }
    }
    Ok(connection)
}

/// Leaves all studies to the others.
async fn say_good_bye(shared: &SharedState, mut connection: PgConnection) {
    let leaving = async {
        sqlx::query(sql::REPLICA_DELETE).bind(shared.me()).execute(&mut connection).await?;
        connection.close().await
    };
    let left = timeout(limits::POSTGRES_CONNECT_TIMEOUT, leaving).await;
    if let Err(error) = left.unwrap_or_else(|_| Err(silent())) {
        tracing::warn!(%error, "the database was not left in order; the others will notice");
    }
}

pub(super) async fn listener(shared: &SharedState) -> Result<PgListener, sqlx::Error> {
    let pool = PgPoolOptions::new()
        .max_connections(1)
        .acquire_timeout(limits::POSTGRES_CONNECT_TIMEOUT)
        .connect_lazy_with(shared.database.options().clone());
    let mut listener = PgListener::connect_with(&pool).await?;
    listener.listen(sql::CHANNEL).await?;
    Ok(listener)
}

/// Acts on the notices of the others, for ever. A lost notice only costs time.
pub(super) async fn listen(shared: Arc<SharedState>, mut listener: PgListener) {
    loop {
        match listener.try_recv().await {
            Ok(Some(notice)) => act(&shared, notice.payload()),
            // The connection was lost and made again; the notices in between are unknown.
            Ok(None) => shared.forget_owners(|_| true),
            Err(error) => {
                tracing::debug!(%error, "no notices");
                sleep(RETRY).await;
            }
        }
    }
}

fn act(shared: &SharedState, notice: &str) {
    let words: Vec<&str> = notice.split(' ').collect();
    match words.as_slice() {
        ["claimed", key, epoch] => {
            if let (Ok(key), Ok(epoch)) = (key.parse(), epoch.parse()) {
                shared.claimed(key, epoch);
            }
        }
        ["deleted", key] => {
            if let Ok(key) = key.parse() {
                shared.deleted(key);
            }
        }
        ["left", replica] => {
            if let Ok(replica) = replica.parse::<i32>() {
                shared.forget_owners(|owner| owner.replica == replica);
            }
        }
        // A newer replica may send other notices.
        _ => tracing::debug!(notice, "not understood"),
    }
}

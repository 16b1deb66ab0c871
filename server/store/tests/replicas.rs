//! Several replicas on one PostgreSQL: the holder of a study, its take-over, and the refusal of writes of a
//! replica that lost it.

mod common;

use std::time::Duration;

use common::{change, completed, open, postgres, spec};
use sqlx::{AssertSqlSafe, Executor as _, PgConnection};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use treewright_core::space::EarlierSpaces;
use treewright_core::trial::Outcome;
use treewright_store::{Loaded, OpenError, PostgresAddress, PostgresStore, Store, StoreError, limits};
use treewright_test_postgres::Database;

async fn replica(database: &Database, advertised: &str) -> PostgresStore {
    let address = PostgresAddress::parse(database.url()).expect("an address");
    PostgresStore::open(address, advertised, Duration::ZERO).await.expect("a database")
}

async fn execute(connection: &mut PgConnection, sql: &str) -> u64 {
    connection.execute(AssertSqlSafe(sql)).await.expect("the statement runs").rows_affected()
}

/// Loads as soon as that is possible.
async fn load_soon(store: &PostgresStore, study: &str) -> Loaded {
    for _ in 0..1000 {
        match store.load(study).await {
            Ok(loaded) => return loaded,
            Err(StoreError::Elsewhere { .. }) => {
                store.doubt(study);
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
            Err(error) => panic!("{error}"),
        }
    }
    panic!("study {study} stays with a replica that is gone");
}

/// Waits until something has happened in the background.
async fn until(what: &str, mut happened: impl AsyncFnMut() -> bool) {
    for _ in 0..1000 {
        if happened().await {
            return;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("{what}");
}

#[tokio::test]
async fn a_study_is_held_by_one_replica_and_left_to_the_next() {
    for is_killed in [false, true] {
        let database = Database::create().await;
        let first = replica(&database, "http://first:1").await;
        let second = replica(&database, "http://second:1").await;
        first.create_study("hall", &spec(), 5).await.unwrap();
        assert!(!second.create_study("hall", &spec(), 6).await.unwrap().is_new);
        let held = first.load("hall").await.unwrap().fence;
        for _ in 0..2 {
            let error = second.load("hall").await.unwrap_err();
            let address = "http://first:1".to_owned();
            assert_eq!(error, StoreError::Elsewhere { study: "hall".to_owned(), address });
        }
        assert!(held.holds());
        let last = first.commit(&held, &[change(vec![open(1)])]);
        if !is_killed {
            first.close().await;
        }
        assert_eq!(last.durable().await, Ok(()));
        drop(first);

        let loaded = load_soon(&second, "hall").await;
        assert_eq!(loaded.snapshot.last_trial, 1);
        second.commit(&loaded.fence, &[change(vec![open(2)])]).durable().await.unwrap();
    }
}

#[tokio::test]
async fn replicas_share_a_key_that_no_other_database_has() {
    let (database, other) = (Database::create().await, Database::create().await);
    let first = replica(&database, "http://first:1").await;
    let second = replica(&database, "http://second:1").await;
    let foreign = replica(&other, "http://first:1").await;
    assert!(first.replica_key().is_some());
    assert_eq!(first.replica_key(), second.replica_key());
    assert_ne!(first.replica_key(), foreign.replica_key());
}

#[tokio::test]
async fn a_question_that_is_not_answered_ends() {
    let database = Database::create().await;
    let store = replica(&database, "http://first:1").await;
    store.create_study("hall", &spec(), 5).await.unwrap();
    let mut other = database.connect().await;
    execute(&mut other, "BEGIN").await;
    execute(&mut other, "LOCK TABLE studies IN ACCESS EXCLUSIVE MODE").await;
    let spec = spec();
    let asked = async {
        tokio::join!(
            async { store.get_study("hall").await.map(drop) },
            async { store.create_study("sponza", &spec, 6).await.map(drop) },
            store.delete_study("hall", None),
            async { store.studies_with_due_leases(7).await.map(drop) },
        )
    };
    let longest = limits::POSTGRES_QUESTION_TIMEOUT + Duration::from_secs(5);
    let (read, created, deleted, swept) = tokio::time::timeout(longest, asked).await.expect("they end");
    for ended in [read, created, deleted, swept] {
        assert!(matches!(ended, Err(StoreError::Unavailable { .. })), "{ended:?}");
    }
    execute(&mut other, "ROLLBACK").await;
    store.get_study("hall").await.expect("it was not deleted");
}

#[tokio::test]
async fn a_replica_that_was_taken_for_dead_stores_nothing_more() {
    let database = Database::create().await;
    let first = replica(&database, "http://first:1").await;
    let second = replica(&database, "http://second:1").await;
    let mut other = database.connect().await;
    first.create_study("hall", &spec(), 5).await.unwrap();
    first.create_study("sponza", &spec(), 5).await.unwrap();
    let held = first.load("hall").await.unwrap().fence;
    let kept = first.load("sponza").await.unwrap().fence;
    // Its heartbeat seems to have stopped long ago. It beats again within a second, so be quick, or try
    // again.
    let mut taken = None;
    while taken.is_none() {
        execute(&mut other, "UPDATE replicas SET heartbeat = '2000-01-01'").await;
        second.doubt("hall");
        taken = second.load("hall").await.ok();
    }
    let taken = taken.expect("loaded").fence;
    // The notice reaches the first; and without it the epoch would have stopped its writes.
    until("the notice does not arrive", async || !held.holds()).await;
    let refused = first.commit(&held, &[change(vec![open(1)])]).durable().await;
    assert!(matches!(refused, Err(StoreError::Fenced { .. })));
    second.commit(&taken, &[change(vec![open(1)])]).durable().await.unwrap();
    // A study that no other replica took stays with it.
    assert!(kept.holds());
    first.commit(&kept, &[change(vec![open(1)])]).durable().await.unwrap();
}

#[tokio::test]
async fn the_epoch_in_the_database_decides_and_not_the_notice() {
    let database = Database::create().await;
    let store = postgres(&database).await;
    for study in ["hall", "sponza"] {
        store.create_study(study, &spec(), 5).await.unwrap();
    }
    let held = store.load("hall").await.unwrap().fence;
    let other = store.load("sponza").await.unwrap().fence;
    let mut connection = database.connect().await;
    execute(&mut connection, "UPDATE studies SET epoch = epoch + 1 WHERE name = 'hall'").await;
    // The old holder does not know yet, and both are queued together; only one is stored.
    assert!(held.holds());
    let stale = store.commit(&held, &[change(vec![completed(1, 1, Outcome::Ok)])]);
    let good = store.commit(&other, &[change(vec![open(1)])]);
    assert!(matches!(stale.durable().await, Err(StoreError::Fenced { .. })));
    assert_eq!(good.durable().await, Ok(()));
    assert!(!held.holds());
    assert_eq!(store.get_study("hall").await.unwrap().statistics.trials, 0);
    let update = store.update_study(&held, &spec(), &EarlierSpaces::default(), 0).durable().await;
    assert!(matches!(update, Err(StoreError::Fenced { .. })));
}

#[tokio::test]
async fn a_deleted_study_is_gone_for_every_replica_and_its_rows_follow() {
    let database = Database::create().await;
    let first = replica(&database, "http://first:1").await;
    let second = replica(&database, "http://second:1").await;
    first.create_study("hall", &spec(), 5).await.unwrap();
    let held = first.load("hall").await.unwrap().fence;
    first.commit(&held, &[change((1..50).map(open).collect())]).durable().await.unwrap();
    // More than is removed at once.
    let mut connection = database.connect().await;
    let states = "INSERT INTO states (study, id, indicators) \
                  SELECT s.id, n, '[0.1]'::json FROM studies s, generate_series(2, 25000) n";
    assert_eq!(execute(&mut connection, states).await, 24_999);
    second.delete_study("hall", None).await.unwrap();
    until("the notice does not arrive", async || !held.holds()).await;
    assert!(first.commit(&held, &[change(vec![open(50)])]).durable().await.is_err());
    assert!(first.get_study("hall").await.is_err());
    let count = "SELECT (SELECT count(*) FROM trials) + (SELECT count(*) FROM studies)";
    until("the rows of a deleted study stay", async || {
        let rows: i64 = sqlx::query_scalar(count).fetch_one(&mut connection).await.unwrap();
        rows == 0
    })
    .await;
}

#[tokio::test]
async fn of_due_leases_each_goes_to_one_replica() {
    let database = Database::create().await;
    let gone = replica(&database, "http://gone:1").await;
    for number in 0..20 {
        let study = format!("hall-{number}");
        gone.create_study(&study, &spec(), 5).await.unwrap();
        let fence = gone.load(&study).await.unwrap().fence;
        gone.commit(&fence, &[change(vec![open(1)])]).durable().await.unwrap();
    }
    let first = replica(&database, "http://first:1").await;
    let second = replica(&database, "http://second:1").await;
    // Their holder sweeps them as long as it lives.
    assert_eq!(first.studies_with_due_leases(60_001).await.unwrap(), [""; 0]);
    assert_eq!(gone.studies_with_due_leases(60_001).await.unwrap().len(), 20);
    drop(gone);
    until("not all are swept", async || {
        let (left, right) =
            tokio::join!(first.studies_with_due_leases(60_001), second.studies_with_due_leases(60_001));
        let (left, right) = (left.unwrap(), right.unwrap());
        assert!(left.iter().all(|study| !right.contains(study)), "swept twice: {left:?} {right:?}");
        left.len() + right.len() == 20
    })
    .await;
}

#[tokio::test]
async fn a_lost_connection_is_made_anew() {
    let database = Database::create().await;
    let store = postgres(&database).await;
    store.create_study("hall", &spec(), 5).await.unwrap();
    let held = store.load("hall").await.unwrap().fence;
    let mut other = database.connect().await;
    let end = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity \
               WHERE datname = current_database() AND pid <> pg_backend_pid()";
    execute(&mut other, end).await;
    // One write may fail with a reason; then all is as before.
    let (mut number, mut fence) = (1, held);
    loop {
        match store.commit(&fence, &[change(vec![open(number)])]).durable().await {
            Ok(()) => break,
            Err(StoreError::Unavailable { .. } | StoreError::Fenced { .. }) => {
                let loaded = load_soon(&store, "hall").await;
                number = loaded.snapshot.last_trial + 1;
                fence = loaded.fence;
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert_eq!(store.get_study("hall").await.unwrap().statistics.trials, number);
}

#[tokio::test]
async fn databases_that_cannot_be_used_are_explained() {
    let database = Database::create().await;
    let open = |url: String| async move {
        let address = PostgresAddress::parse(&url).expect("an address");
        let opened = PostgresStore::open(address, "http://127.0.0.1:1", Duration::ZERO).await;
        opened.err().expect("this database cannot be used")
    };
    let missing = open(format!("{}_missing", database.url())).await;
    assert!(matches!(missing, OpenError::Refused { .. }), "{missing}");
    let unreachable = open("postgres://anna:geheim@127.0.0.1:9/farm".to_owned()).await;
    assert!(matches!(unreachable, OpenError::Unreachable { .. }), "{unreachable}");
    assert!(!unreachable.to_string().contains("geheim"), "{unreachable}");

    let mut other = database.connect().await;
    execute(&mut other, "CREATE TABLE photographs (id integer)").await;
    let foreign = open(database.url().to_owned()).await;
    assert!(foreign.to_string().contains("another program"), "{foreign}");
    execute(&mut other, "DROP TABLE photographs").await;
    postgres(&database).await.close().await;
    execute(
        &mut other,
        "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
         VALUES (9999, 'from the future', true, '\\x00', 1)",
    )
    .await;
    let newer = open(database.url().to_owned()).await;
    assert!(newer.to_string().contains("newer treewrightd (schema version 9999"), "{newer}");
}

/// A server that says it is starting for this time, and then passes on to that of `database`.
async fn recovering(database: &Database, time: Duration) -> String {
    let after_user = database.url().rsplit_once('@').expect("a user").1;
    let (target, rest) = after_user.split_once('/').expect("a database");
    let target = target.to_owned();
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let until = tokio::time::Instant::now() + time;
    tokio::spawn(async move {
        while let Ok((mut client, _)) = listener.accept().await {
            if tokio::time::Instant::now() < until {
                let fields = b"SFATAL\0VFATAL\0C57P03\0Mthe database system is starting up\0\0";
                let length = (fields.len() as u32 + 4).to_be_bytes();
                let mut head = [0; 8];
                client.read_exact(&mut head).await.unwrap();
                // Whether TLS is spoken is asked first, and denied.
                if head[4..] == 80_877_103_u32.to_be_bytes() {
                    client.write_all(b"N").await.unwrap();
                    client.read_exact(&mut head).await.unwrap();
                }
                client.write_all(&[b"E", &length[..], fields].concat()).await.unwrap();
                continue;
            }
            let mut server = tokio::net::TcpStream::connect(&target).await.unwrap();
            tokio::spawn(async move { tokio::io::copy_bidirectional(&mut client, &mut server).await });
        }
    });
    let user = database.url().rsplit_once('@').expect("a user").0;
    format!("{user}@{address}/{rest}")
}

#[tokio::test]
async fn a_server_that_recovers_is_waited_for_beyond_the_patience() {
    let database = Database::create().await;
    let url = recovering(&database, Duration::from_secs(2)).await;
    let address = PostgresAddress::parse(&url).expect("an address");
    let since = std::time::Instant::now();
    let store = PostgresStore::open(address, "http://127.0.0.1:1", Duration::ZERO).await.expect("in the end");
    assert!(since.elapsed() >= Duration::from_secs(2));
    store.create_study("hall", &common::spec(), 1).await.expect("it works");
    store.close().await;
}

//! The promises of every token store, run against each implementation. The memory store is the oracle.

#[macro_use]
mod common;

use std::time::Duration;

use treewright_store::tokens::{Quota, Scope, Studies, TokenError, TokenRecord, Usage};
use treewright_store::{
    MemoryTokens, PostgresAddress, PostgresStore, PostgresTokens, SqliteStore, SqliteTokens, Store,
    StoreError, TokenStore,
};
use treewright_test_postgres::Database;

contract!(
    super::MemoryTokens::new();
    path => super::SqliteTokens::open(&path).await.expect("opened");
    database => super::postgres(&database).await;
    tokens_come_back_as_they_were_stored,
    revoking_keeps_the_first_time,
    forgetting_takes_the_use_along,
    every_change_raises_the_revision,
    use_adds_up_by_day,
    a_closed_store_says_so,
);

async fn postgres(database: &Database) -> PostgresTokens {
    let address = PostgresAddress::parse(database.url()).expect("an address");
    PostgresTokens::open(&address, Duration::ZERO).await.expect("a database")
}

fn token(id: &str, create_ms: i64) -> TokenRecord {
    TokenRecord {
        id: id.to_owned(),
        name: format!("the '{id}'; DROP TABLE tokens"),
        hash: [7; 32],
        scope: Scope::Tune,
        studies: Studies(vec!["hall".to_owned(), "farm-*".to_owned()]),
        quota: Quota { requests_per_s: Some(10), trials: Some(u64::MAX), ..Quota::default() },
        create_ms,
        expire_ms: Some(9_000),
        revoke_ms: None,
    }
}

async fn tokens_come_back_as_they_were_stored(tokens: &dyn TokenStore) {
    let (studies, quota) = (Studies::default(), Quota::default());
    let second = TokenRecord { scope: Scope::Admin, studies, quota, expire_ms: None, ..token("b", 5) };
    tokens.create(&second).await.unwrap();
    tokens.create(&token("a", 6)).await.unwrap();
    assert_eq!(tokens.list().await.unwrap(), [second, token("a", 6)]);
    let again = tokens.create(&token("a", 7)).await;
    assert_eq!(again, Err(TokenError::Exists("a".to_owned())));
}

async fn revoking_keeps_the_first_time(tokens: &dyn TokenStore) {
    tokens.create(&token("a", 1)).await.unwrap();
    tokens.revoke("a", 100).await.unwrap();
    tokens.revoke("a", 200).await.unwrap();
    let stored = &tokens.list().await.unwrap()[0];
    assert_eq!(stored.revoke_ms, Some(100));
    assert!(!stored.is_live(50) && token("a", 1).is_live(8_999) && !token("a", 1).is_live(9_000));
    assert_eq!(tokens.revoke("b", 1).await, Err(TokenError::NotFound("b".to_owned())));
}

async fn forgetting_takes_the_use_along(tokens: &dyn TokenStore) {
    tokens.create(&token("a", 1)).await.unwrap();
    let used = Usage { studies: 1, trials: 2, bytes: 3 };
    tokens.add_usage(4, &[("a".to_owned(), used), ("gone".to_owned(), used)]).await.unwrap();
    tokens.forget("a").await.unwrap();
    assert_eq!(tokens.forget("a").await, Err(TokenError::NotFound("a".to_owned())));
    assert_eq!(tokens.list().await.unwrap(), []);
    tokens.create(&token("a", 1)).await.unwrap();
    assert_eq!(tokens.usage("a", 4).await.unwrap(), (Usage::default(), Usage::default()));
}

async fn every_change_raises_the_revision(tokens: &dyn TokenStore) {
    let mut last = tokens.revision().await.unwrap();
    for change in 0..3 {
        match change {
            0 => tokens.create(&token("a", 1)).await.unwrap(),
            1 => tokens.revoke("a", 2).await.unwrap(),
            _ => tokens.forget("a").await.unwrap(),
        }
        let now = tokens.revision().await.unwrap();
        assert!(now > last, "change {change}");
        last = now;
    }
    tokens.list().await.unwrap();
    assert_eq!(tokens.revision().await.unwrap(), last);
}

async fn use_adds_up_by_day(tokens: &dyn TokenStore) {
    tokens.create(&token("a", 1)).await.unwrap();
    let before = tokens.revision().await.unwrap();
    let one = Usage { studies: 1, trials: 10, bytes: 100 };
    for day in [3, 3, 4] {
        tokens.add_usage(day, &[("a".to_owned(), one)]).await.unwrap();
    }
    let times = |n| Usage { studies: n, trials: 10 * n, bytes: 100 * n };
    assert_eq!(tokens.usage("a", 3).await.unwrap(), (times(3), times(2)));
    assert_eq!(tokens.usage("a", 5).await.unwrap(), (times(3), times(0)));
    assert_eq!(tokens.revision().await.unwrap(), before, "use is no change of a token");
}

async fn a_closed_store_says_so(tokens: &dyn TokenStore) {
    tokens.close().await;
    let closed = TokenError::Store(StoreError::Closed);
    assert_eq!(tokens.list().await, Err(closed.clone()));
    assert_eq!(tokens.create(&token("a", 1)).await, Err(closed));
    tokens.close().await;
}

#[tokio::test]
async fn tokens_are_made_while_a_daemon_has_the_database() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("studies.db");
    let daemon = SqliteStore::open(&path).await.unwrap();
    let watching = SqliteTokens::open(&path).await.unwrap();
    let before = watching.revision().await.unwrap();

    let operator = SqliteTokens::open(&path).await.unwrap();
    operator.create(&token("a", 1)).await.unwrap();
    operator.close().await;
    assert!(watching.revision().await.unwrap() > before);
    assert_eq!(watching.list().await.unwrap(), [token("a", 1)]);
    watching.close().await;
    daemon.close().await;
    assert!(!directory.path().join("studies.db-wal").exists(), "the log is folded into the file");

    assert!(SqliteTokens::open(directory.path()).await.is_err(), "a folder is no database");
    // Without a daemon too; and the lock is free afterwards.
    let tokens = SqliteTokens::open(&path).await.unwrap();
    assert_eq!(tokens.list().await.unwrap(), [token("a", 1)]);
    SqliteStore::open(&path).await.unwrap();
}

#[tokio::test]
async fn replicas_see_each_other_s_tokens_and_add_up_their_use() {
    let database = Database::create().await;
    let address = PostgresAddress::parse(database.url()).unwrap();
    let daemon = PostgresStore::open(address, "http://127.0.0.1:1", Duration::ZERO).await.unwrap();
    let (one, two) = (postgres(&database).await, postgres(&database).await);
    let before = two.revision().await.unwrap();
    one.create(&token("a", 1)).await.unwrap();
    one.create(&token("b", 2)).await.unwrap();
    assert!(two.revision().await.unwrap() > before);
    assert_eq!(two.list().await.unwrap(), [token("a", 1), token("b", 2)]);
    assert_eq!(two.create(&token("a", 1)).await, Err(TokenError::Exists("a".to_owned())));

    // Both count these tokens at the same time, in opposite orders.
    let used =
        |names: [&str; 2]| names.map(|name| (name.to_owned(), Usage { trials: 1, ..Usage::default() }));
    let (forth, back) = (used(["a", "b"]), used(["b", "a"]));
    for _ in 0..50 {
        let (first, second) = tokio::join!(one.add_usage(7, &forth), two.add_usage(7, &back));
        first.and(second).unwrap();
    }
    assert_eq!(one.usage("b", 7).await.unwrap().1.trials, 100);
    two.revoke("a", 5).await.unwrap();
    assert_eq!(one.list().await.unwrap()[0].revoke_ms, Some(5));
    one.close().await;
    two.close().await;
    daemon.close().await;
}

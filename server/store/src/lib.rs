//! Persistence of studies, states, trials and visits.
//!
//! [`Store`] is the interface: each method is one transaction and one use case. [`MemoryStore`] is its
//! simplest implementation and the oracle of the tests, [`SqliteStore`] the one that survives `kill -9`,
//! [`PostgresStore`] the one that several daemons share. All pass one contract suite. Domain types go in and
//! come out; rows stay inside the stores.
//!
//! [`filter`] is the query language for trials, [`cursor`] the page tokens, [`fence`] the guard of a copy in
//! memory, [`tokens`] the rights of clients, [`maintenance`] the copying, restoring and checking of database
//! files.
// Some of the shared code is only used by PostgreSQL.
#![cfg_attr(not(feature = "postgres"), allow(dead_code))]

mod assembly;
pub mod cursor;
mod error;
pub mod fence;
pub mod filter;
mod from_row;
pub mod limits;
pub mod maintenance;
mod memory;
mod migrations;
#[cfg(feature = "postgres")]
mod postgres;
mod question;
mod read;
mod rows;
mod sqlite;
mod statements;
mod store;
pub mod tokens;

pub use error::{OpenError, Result, StoreError};
pub use fence::{Fence, Receipt};
pub use memory::{Faults, MemoryStore};
#[cfg(feature = "postgres")]
pub use postgres::{PostgresAddress, PostgresStore, PostgresTokens};
pub use sqlite::{SqliteStore, SqliteTokens};
pub use store::{
    ClosedTrial, Created, Loaded, Store, StoreSize, StudyRecord, StudyWrite, TrialPage, TrialQuery,
};
pub use tokens::{MemoryTokens, TokenStore};

/// Whether `text` is the address of a PostgreSQL database rather than the path of a file.
pub fn is_postgres_address(text: &str) -> bool {
    text.starts_with("postgres://") || text.starts_with("postgresql://")
}

//! Every limit of the store, in one place. Reaching one is a clear error.

use std::time::Duration;

/// Longest filter, in characters. The wire contract promises this figure.
pub const FILTER_CHARACTERS: usize = 2000;

/// Most comparisons in one filter. The wire contract promises this figure.
pub const FILTER_COMPARISONS: usize = 32;

/// Most rows on one page.
pub const PAGE_SIZE: u32 = 1000;

/// Rows on a page without a requested size.
pub const PAGE_SIZE_DEFAULT: u32 = 100;

/// Longest page token that is parsed, in characters. Issued tokens are far shorter.
pub const TOKEN_CHARACTERS: usize = 256;

/// Most studies in one database.
pub const STUDIES: u32 = 10_000;

/// Former names of studies that are listed, each with the last trial number under it. Names beyond the limit
/// are merged into one with the highest of their numbers.
pub const FORMER_NAMES: u32 = 10_000;

/// Most tokens in one database, revoked ones included.
pub const TOKENS: u32 = 10_000;

/// Writes that may wait for the writer. Each has one caller, so this is also the number of callers that can
/// wait for the disk at once.
pub const WRITE_QUEUE: usize = 8192;

/// Most writes that share one transaction, so that the first of them does not wait for ever.
pub const WRITE_GROUP: usize = 256;

/// Largest part of a checkpoint that is written at once, in bytes. Another write may have to wait for it.
pub const CHECKPOINT_PART_BYTES: usize = 256 << 10;

/// Connections that read.
pub const READERS: u32 = 4;

/// How long a writer or reader waits for another process that holds a lock on the database file.
pub const BUSY_TIMEOUT: Duration = Duration::from_secs(2);

/// How long a question waits for a connection that reads.
pub const READER_TIMEOUT: Duration = Duration::from_secs(10);

/// How long a start looks for damage in a database file. Some fifty megabytes are read in this time; larger
/// files are checked in part.
pub const START_CHECK: Duration = Duration::from_millis(200);

/// The length in bytes above which a write-ahead log is cut as soon as possible.
pub const WAL_BYTES_KEPT: u64 = 64 << 20;

/// Free pages that a database file always keeps.
pub const PAGES_KEPT_FREE: i64 = 1024;

/// Most pages that are given back at once. Another write may have to wait for it.
pub const PAGES_FREED: i64 = 128;

/// Connections of a replica that write to PostgreSQL. Each study has one of them, which keeps its writes in
/// order. There are two, so that one gathers writes while the other waits for the disk.
pub const POSTGRES_WRITERS: usize = 2;

/// Connections of a replica that read and write tokens in PostgreSQL.
pub const POSTGRES_TOKENS: u32 = 2;

/// Longest wait for PostgreSQL to take one write. A busy disk needs less; a server that stays silent longer
/// counts as gone.
pub const POSTGRES_WRITE_TIMEOUT: Duration = Duration::from_secs(10);

/// How long a question waits for a connection to PostgreSQL.
pub const POSTGRES_READER_TIMEOUT: Duration = Duration::from_secs(3);

/// Longest wait for PostgreSQL's answer to a question, and for it to create, rename or delete a study.
pub const POSTGRES_QUESTION_TIMEOUT: Duration = Duration::from_secs(10);

/// How long an attempt to connect to PostgreSQL may take.
pub const POSTGRES_CONNECT_TIMEOUT: Duration = Duration::from_secs(2);

/// The interval of a replica's heartbeats.
pub const HEARTBEAT: Duration = Duration::from_secs(1);

/// A replica without a heartbeat for this long, by the database's clock, counts as dead.
pub const REPLICA_LAPSE: Duration = Duration::from_secs(6);

/// How long a dead replica's row is kept before another replica removes it.
pub const REPLICA_ROW_KEPT: Duration = Duration::from_secs(60);

/// How long the replica that holds a study is remembered.
pub const OWNER_REMEMBERED: Duration = Duration::from_secs(1);

/// Owners that are remembered.
pub const OWNERS_REMEMBERED: usize = 4096;

/// Studies whose leases one sweep looks at.
pub const SWEEP_STUDIES: u32 = 256;

/// Rows of a deleted study that SQLite removes in one transaction: about two milliseconds.
pub const REAPED_ROWS_SQLITE: u32 = 500;

/// Parts of a deleted study's checkpoints that SQLite removes in one transaction. Each is as long as
/// [`CHECKPOINT_PART_BYTES`], and SQLite visits all of its pages.
pub const REAPED_PARTS_SQLITE: u32 = 8;

/// Pause between two such transactions, in which other writes go on.
pub const REAP_PAUSE: Duration = Duration::from_millis(20);

/// Pause after a transaction of that kind that failed.
pub const REAP_RETRY: Duration = Duration::from_secs(10);

/// Rows of each table that PostgreSQL removes of a deleted study in one transaction.
pub const REAPED_ROWS: u32 = 10_000;

const _: () = assert!(HEARTBEAT.as_millis() * 3 <= REPLICA_LAPSE.as_millis());
const _: () = assert!(WRITE_GROUP <= WRITE_QUEUE);
const _: () = assert!(PAGE_SIZE_DEFAULT <= PAGE_SIZE);
// `PRAGMA incremental_vacuum(0)` would give back all free pages.
const _: () = assert!(0 < PAGES_FREED && PAGES_FREED <= PAGES_KEPT_FREE);
// A replica that cannot connect at once does not count as dead, and its row outlasts its lapse.
const _: () = assert!(POSTGRES_CONNECT_TIMEOUT.as_millis() < REPLICA_LAPSE.as_millis());
const _: () = assert!(REPLICA_LAPSE.as_millis() < REPLICA_ROW_KEPT.as_millis());
const _: () = assert!(OWNER_REMEMBERED.as_millis() < REPLICA_LAPSE.as_millis());

//! Every limit of the store, in one place. Reaching one is a clear error, never a surprise.

use std::time::Duration;

/// Longest filter, in characters. The wire contract promises this figure.
pub const FILTER_CHARACTERS: usize = 2000;

/// Most comparisons in one filter. The wire contract promises this figure.
pub const FILTER_COMPARISONS: usize = 32;

/// Longest name of a measurement, parameter or indicator inside a filter, in characters.
pub const NAME_CHARACTERS: usize = 64;

/// Most rows on one page.
pub const PAGE_SIZE: u32 = 1000;

/// Rows on a page when the caller does not say.
pub const PAGE_SIZE_DEFAULT: u32 = 100;

/// Longest page token that is looked at, in characters. Ours are far shorter.
pub const TOKEN_CHARACTERS: usize = 256;

/// Most studies in one database.
pub const STUDIES: u32 = 10_000;

/// Writes that may wait for the writer. Each waits for one caller, so this is also the number of
/// callers that can be waiting for the disk at once.
pub const WRITE_QUEUE: usize = 1024;

/// Most writes that share one transaction, so that the first of them does not wait for ever.
pub const WRITE_GROUP: usize = 256;

/// Largest part of a checkpoint that is written at once, in bytes: what another write may have to wait for.
pub const CHECKPOINT_PART_BYTES: usize = 256 << 10;

/// Connections that read.
pub const READERS: u32 = 4;

/// How long a writer or reader waits for another process that holds a lock on the database file.
pub const BUSY_TIMEOUT: Duration = Duration::from_secs(2);

/// How long a question waits for a connection that reads.
pub const READER_TIMEOUT: Duration = Duration::from_secs(10);

const _: () = assert!(WRITE_GROUP <= WRITE_QUEUE);
const _: () = assert!(PAGE_SIZE_DEFAULT <= PAGE_SIZE);

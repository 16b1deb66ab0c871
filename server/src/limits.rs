//! Every limit of the daemon, in one place. The core has the limits of studies, the store those of filters
//! and pages.

use std::time::Duration;

use treewright_core::limits::MODELS_TRIALS_MAX;
use treewright_store::limits::WRITE_QUEUE;

/// Largest request message, in bytes.
pub const REQUEST_BYTES: usize = 1 << 20;

/// An answer with many entries ends a page early rather than grow beyond this, in bytes: generated clients
/// refuse messages above 4 MiB by default.
pub const PAGE_BYTES: usize = 3 << 20;

/// Default limit of connections at once, unless the process may open fewer descriptors.
pub const CONNECTIONS: usize = 16_384;

/// Most connections that can be configured.
pub const CONNECTIONS_MAX: usize = 65_536;

/// Longest wait of a new connection for the one that makes room, which closes as soon as its task is run.
pub const LEAVING: Duration = Duration::from_secs(1);

/// Descriptors that are not connections of clients: the database, its write-ahead log and its readers,
/// connections to other replicas or to PostgreSQL, listeners, certificates while they are read.
pub const DESCRIPTORS_OWN: usize = 96;

/// Fewest connections that a daemon starts with.
pub const CONNECTIONS_MIN: usize = 16;

/// Bytes of incomplete requests and of unread answers, on all connections together.
pub const UNFINISHED_BYTES: usize = 128 << 20;

/// Memory of a request besides its headers and its message, in bytes: its stream, its task, its span.
pub const REQUEST_HEAD_BYTES: usize = 4 << 10;

/// A message up to this size, in bytes, does not count after it is finished.
pub const MESSAGE_BYTES_SMALL: usize = 16 << 10;

/// Bytes that a client may send on one stream, and on one connection, before the daemon has processed them.
/// It is the least window of a connection in HTTP/2 (RFC 9113, section 6.9.2).
pub const WINDOW_BYTES: u32 = 65_535;

/// Connections that wait for the HTTP server to take them.
pub const CONNECTIONS_READY: usize = 64;

/// Calls and streams at once on one connection.
pub const CALLS_PER_CONNECTION: u32 = 256;

/// Streams on one connection that a client may reset before the daemon has processed them. More resets close
/// the connection ("rapid reset", CVE-2023-44487).
pub const RESETS_PER_CONNECTION: usize = 32;

/// Bytes of the headers of one request, as HTTP/2 counts them.
pub const HEADER_BYTES: u32 = 8 << 10;

/// Longest message of an error, in bytes. It travels in a header, where each byte may take three characters,
/// and once more in its details. Many gRPC libraries refuse more than 8 KiB of headers.
pub const MESSAGE_BYTES: usize = 1500;

/// Headers of one request.
pub const HEADERS: usize = 48;

/// Characters of a request id that is taken from a client.
pub const REQUEST_ID_CHARACTERS: usize = 64;

/// Longest TLS handshake.
pub const HANDSHAKE: Duration = Duration::from_secs(5);

/// The first bytes of HTTP/2 must be there within this time after the connection.
pub const PREFACE: Duration = Duration::from_secs(5);

/// The first request that is authorised must be there within this time after the connection.
pub const FIRST_REQUEST: Duration = Duration::from_secs(20);

/// A connection without a request and a stream for this time is closed.
pub const IDLE: Duration = Duration::from_secs(900);

/// A Tune stream without a whole frame for this time is ended.
pub const TUNE_IDLE: Duration = Duration::from_secs(3600);

/// A Tune stream whose client does not read its answers is ended after this time.
pub const TUNE_UNREAD: Duration = Duration::from_secs(60);

/// Longest time of a request, with the reading of its message.
pub const REQUEST: Duration = Duration::from_secs(30);

/// Most bytes of a certificate or key file.
pub const CERTIFICATE_BYTES: u64 = 1 << 20;

/// Interval of the checks of certificate files.
pub const CERTIFICATES_PERIOD: Duration = Duration::from_secs(2);

/// Interval of the checks for new or revoked tokens.
pub const TOKENS_PERIOD: Duration = Duration::from_millis(100);

/// A copy of the tokens that is older admits no caller. So this is also the longest life of a revoked token
/// at a daemon that is cut off from its database.
pub const TOKENS_STALE: Duration = Duration::from_secs(30);

/// Period between stores of the tokens' usage. A crash forgets at most the usage of one period.
pub const USAGE_PERIOD: Duration = Duration::from_secs(2);

/// Longest wait for the database to list the tokens, and to store or to list their usage. The daemon's end
/// waits for the latter as well.
pub const TOKENS_WAIT: Duration = Duration::from_secs(5);

/// Default limit of requests in progress at once; a frame of a Tune stream counts as one.
pub const REQUESTS_IN_FLIGHT: usize = 512;

/// Most such requests that can be configured.
pub const REQUESTS_IN_FLIGHT_MAX: usize = 4000;

/// Writes one request can have in the store's queue at once: ended leases, and its own.
const WRITES_PER_REQUEST: usize = 2;

// The store's queue cannot overflow as long as callers wait for their answers.
const _: () = assert!(REQUESTS_IN_FLIGHT_MAX * WRITES_PER_REQUEST < WRITE_QUEUE);

/// Connections to other replicas that are kept.
pub const PEERS: usize = 64;

/// Longest time to connect to another replica.
pub const PEER_CONNECT: Duration = Duration::from_millis(500);

/// Interval of the checks that a replica with a forwarded request is still alive.
pub const PEER_LOOK: Duration = Duration::from_secs(1);

/// How long a request may look for the replica that holds its study. It lies above the time after which a
/// silent replica counts as dead.
pub const PEER_PATIENCE: Duration = Duration::from_secs(8);

/// First pause before a request looks again; it doubles each time.
pub const PEER_PAUSE: Duration = Duration::from_millis(2);

/// Longest pause before a request looks again.
pub const PEER_PAUSE_LONGEST: Duration = Duration::from_millis(100);

const _: () = assert!(PEER_PATIENCE.as_millis() > treewright_store::limits::REPLICA_LAPSE.as_millis());

/// Default limit of open Tune streams.
pub const TUNE_STREAMS: usize = 16_384;

/// Most Tune streams that can be configured.
pub const TUNE_STREAMS_MAX: usize = 65_536;

/// Answers of one Tune stream that wait for a slow reader.
pub const TUNE_ANSWERS_WAITING: usize = 4;

/// Studies whose tuner is held in memory. Another one replaces the least recently used.
pub const STUDIES_IN_MEMORY: usize = 256;

/// Longest wait of a request for its study to be loaded before the client has to try again. The load goes on.
pub const LOADING_WAIT: Duration = Duration::from_secs(1);

/// The wait before a retry of a request whose study is being loaded.
pub const LOADING_RETRY: Duration = Duration::from_millis(100);

/// Lines logged about refusals of one reason within [`REFUSAL_PERIOD`].
pub const REFUSAL_LINES: u64 = 10;

/// Period of [`REFUSAL_LINES`], in whole seconds.
pub const REFUSAL_PERIOD: Duration = Duration::from_secs(10);

/// Interval of the lines about a task that fails each time.
pub const TROUBLE_PERIOD: Duration = Duration::from_secs(60);

/// How long a question waits for a processor to compute its plan; then it is answered from the tables.
pub const PLANNING_WAIT: Duration = Duration::from_millis(5);

/// Additional niceness of the threads that plan and fit: beside busy threads that answer, they get a tenth of
/// a processor.
pub const COMPUTING_NICENESS: i32 = 10;

/// Longest earlier spaces of a study together, as they are written on the wire. They are read with the study.
pub const EARLIER_SPACES_BYTES: usize = 2 << 20;

/// Completed trials that are read at once when a study is loaded: a few megabytes.
pub const TRIALS_PER_READ: u32 = 1000;

/// Fewest trials of a study that retention may keep: a change of predictor may need them.
pub const KEEP_TRIALS_MIN: u64 = MODELS_TRIALS_MAX;

/// Trials that are removed in one write. Another write may have to wait for it.
pub const TRIALS_PER_REMOVAL: usize = 500;

/// Interval of the removal of old trials.
pub const THINNING_PERIOD: Duration = Duration::from_secs(5);

/// Longest id of a study, in characters. The wire contract promises this figure.
pub const STUDY_ID_CHARACTERS: usize = 64;

/// Longest resource name that is parsed, in bytes.
pub const NAME_BYTES: usize = 256;

/// Interval of the sweep of leases that have run out.
pub const SWEEP_PERIOD: Duration = Duration::from_secs(1);

/// Without a sweep of leases for this time, the daemon was away: stopped, asleep, or without its database.
pub const ABSENCE_MIN: Duration = Duration::from_secs(10);

/// The time after an absence of the daemon in which a lease that ends does not count as lost: twice the SDK's
/// longest pause between attempts.
pub const RETURN_GRACE: Duration = Duration::from_secs(10);

/// Interval of the checks for due checkpoints.
pub const CHECKPOINT_PERIOD: Duration = Duration::from_secs(1);

/// Longest time for the last checkpoints of an orderly stop.
pub const LAST_CHECKPOINTS: Duration = Duration::from_secs(2);

/// Fewer completed trials behind a checkpoint are learnt again at the next start instead.
pub const LAST_CHECKPOINT_TRIALS: u64 = 100;

/// A connection that does not answer a ping within this time is closed, and the next ping follows after that
/// time: a vanished client's streams must not stay for ever.
pub const KEEPALIVE: Duration = Duration::from_secs(20);

/// Longest drain that can be configured, in seconds.
pub const DRAIN_S: u64 = 3600;

/// Longest wait for the database's answer to a readiness probe.
pub const READY: Duration = Duration::from_secs(2);

/// Most studies whose figures are shown with their names. Each has about 25 series.
pub const STUDIES_SHOWN: u16 = 64;

/// Connections at once of monitors, and of browsers on the dashboard, where there are descriptors enough.
/// Each open page keeps one for its events.
pub const PAGES_CONNECTIONS: usize = 64;

/// A browser's connection ends after this time, and the browser connects again by itself.
pub const DASHBOARD_STAY: Duration = Duration::from_secs(600);

/// Interval of the checks whether an open page must change.
pub const DASHBOARD_LOOK: Duration = Duration::from_secs(1);

/// Most studies that the list of studies reads.
pub const DASHBOARD_STUDIES: usize = 1000;

/// Rows of one page of the list of studies.
pub const DASHBOARD_ROWS: usize = 100;

/// Longest wait of the list of studies for summaries of studies that it shows for the first time.
pub const DASHBOARD_SUMMARY_WAIT: Duration = Duration::from_millis(100);

/// The summary of a study that has changed is made again after this time at the earliest: its assessments
/// compete with those for clients.
pub const DASHBOARD_SUMMARY_AGE: Duration = Duration::from_secs(10);

/// A summary that could not be made whole is made again after this time.
pub const DASHBOARD_SUMMARY_RETRY: Duration = Duration::from_secs(10);

/// Most other dashboards in the list of studies.
pub const DASHBOARD_PEERS: usize = 16;

/// Longest name of another daemon on the dashboard, in characters.
pub const DASHBOARD_PEER_NAME: usize = 40;

/// Longest wait for another dashboard's list of studies.
pub const DASHBOARD_PEER_WAIT: Duration = Duration::from_secs(1);

/// The lists of other dashboards are read again after this time.
pub const DASHBOARD_PEER_AGE: Duration = Duration::from_secs(2);

/// Largest list that another dashboard may send, in bytes.
pub const DASHBOARD_PEER_BYTES: usize = 4 << 20;

/// Largest file of a token for other dashboards, in bytes.
pub const DASHBOARD_TOKEN_BYTES: usize = 4 << 10;

/// Largest form that a browser may send, in bytes: the longest note and tags that the page takes, and those
/// that it showed, escaped.
pub const DASHBOARD_FORM_BYTES: usize = 64 << 10;

/// The head of a request for metrics or for a page must arrive within this time, and a form within as long
/// again.
pub const WATCH: Duration = Duration::from_secs(5);

/// Longest wait of an orderly end for clients to read their answers.
pub const DRAIN_UNREAD: Duration = Duration::from_secs(1);

// The default limits can be configured.
const _: () = assert!(CONNECTIONS_MIN <= CONNECTIONS && CONNECTIONS <= CONNECTIONS_MAX);
const _: () = assert!(REQUESTS_IN_FLIGHT <= REQUESTS_IN_FLIGHT_MAX && TUNE_STREAMS <= TUNE_STREAMS_MAX);
// One request alone does not use up the budget of all connections.
const _: () = assert!(REQUEST_BYTES + REQUEST_HEAD_BYTES + HEADER_BYTES as usize <= UNFINISHED_BYTES);
// A page token names a study: a check sum of 16 digits, and two digits for each character of its id.
const _: () = assert!(16 + 2 * STUDY_ID_CHARACTERS <= treewright_store::limits::TOKEN_CHARACTERS);
// A late sweep is no absence, and one failed check of the tokens does not shut callers out.
const _: () = assert!(2 * SWEEP_PERIOD.as_millis() < ABSENCE_MIN.as_millis());
const _: () = assert!(2 * TOKENS_PERIOD.as_millis() + TOKENS_WAIT.as_millis() < TOKENS_STALE.as_millis());
// Lines are counted by whole periods.
const _: () = assert!(REFUSAL_PERIOD.as_secs() > 0 && REFUSAL_PERIOD.subsec_nanos() == 0);

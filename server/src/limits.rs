//! Every limit of the daemon, in one place. Limits of what a study may hold stand in the core, limits of
//! filters and pages in the store.

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

/// Most connections that can be asked for.
pub const CONNECTIONS_MAX: usize = 65_536;

/// Longest wait of a new connection for the one that makes room, which closes as soon as its task is run.
pub const LEAVING: Duration = Duration::from_secs(1);

/// Descriptors that are not connections of clients: the database, its write-ahead log and its readers,
/// connections to other replicas or to PostgreSQL, listeners, certificates while they are read.
pub const DESCRIPTORS_OWN: usize = 96;

/// Fewest connections that a daemon starts with.
pub const CONNECTIONS_MIN: usize = 16;

/// Bytes of requests that have not come as a whole and of answers that were not read, on all connections
/// together.
pub const UNFINISHED_BYTES: usize = 128 << 20;

/// Memory of a request besides its headers and its message, in bytes: its stream, its task, its span.
pub const REQUEST_HEAD_BYTES: usize = 4 << 10;

/// A message up to this size, in bytes, leaves no room behind that is worth counting.
pub const MESSAGE_BYTES_SMALL: usize = 16 << 10;

/// Bytes that a client may send on one stream, and on one connection, before the daemon has looked at them.
/// The least that HTTP/2 knows for a connection (RFC 9113, section 6.9.2).
pub const WINDOW_BYTES: u32 = 65_535;

/// Connections that wait for the HTTP server to take them.
pub const CONNECTIONS_READY: usize = 64;

/// Calls and streams at once on one connection.
pub const CALLS_PER_CONNECTION: u32 = 256;

/// Streams on one connection that a client may reset before the daemon has looked at them. Who resets more is
/// cut off ("rapid reset", CVE-2023-44487).
pub const RESETS_PER_CONNECTION: usize = 32;

/// Bytes of the headers of one request, as HTTP/2 counts them.
pub const HEADER_BYTES: u32 = 8 << 10;

/// Headers of one request.
pub const HEADERS: usize = 48;

/// Characters of a request id that is taken from a client.
pub const REQUEST_ID_CHARACTERS: usize = 64;

/// A TLS handshake may take so long.
pub const HANDSHAKE: Duration = Duration::from_secs(5);

/// The first bytes of HTTP/2 must be there within this time after the connection.
pub const PREFACE: Duration = Duration::from_secs(5);

/// The first request that is authorised must be there within this time after the connection.
pub const FIRST_REQUEST: Duration = Duration::from_secs(20);

/// A connection with no request and no stream for so long is closed.
pub const IDLE: Duration = Duration::from_secs(900);

/// A Tune stream without a whole frame for so long is ended.
pub const TUNE_IDLE: Duration = Duration::from_secs(3600);

/// A Tune stream whose client does not read the answers that wait for it is ended after so long.
pub const TUNE_UNREAD: Duration = Duration::from_secs(60);

/// A request may take so long, the reading of its message included.
pub const REQUEST: Duration = Duration::from_secs(30);

/// Most bytes of a certificate or key file.
pub const CERTIFICATE_BYTES: u64 = 1 << 20;

/// How often certificate files are looked at.
pub const CERTIFICATES_PERIOD: Duration = Duration::from_secs(2);

/// How often the daemon looks whether a token was made or revoked.
pub const TOKENS_PERIOD: Duration = Duration::from_millis(100);

/// Tokens that could not be read again for so long let nobody in. So this is also the longest that a revoked
/// token can be good for, at a daemon that is cut off from its database.
pub const TOKENS_STALE: Duration = Duration::from_secs(30);

/// Period between stores of the tokens' usage. A crash forgets at most the usage of one period.
pub const USAGE_PERIOD: Duration = Duration::from_secs(2);

/// Default limit of requests in progress at once; a frame of a Tune stream counts as one.
pub const REQUESTS_IN_FLIGHT: usize = 512;

/// Most such requests that can be asked for.
pub const REQUESTS_IN_FLIGHT_MAX: usize = 4000;

/// Writes one request can have in the store's queue at once: ended leases, and its own.
const WRITES_PER_REQUEST: usize = 2;

// The store's queue cannot overflow as long as callers wait for their answers.
const _: () = assert!(REQUESTS_IN_FLIGHT_MAX * WRITES_PER_REQUEST < WRITE_QUEUE);

/// Connections to other replicas that are kept.
pub const PEERS: usize = 64;

/// How long a connection to another replica may take to be made.
pub const PEER_CONNECT: Duration = Duration::from_millis(500);

/// How often it is looked whether the replica that a request was passed on to is still alive.
pub const PEER_LOOK: Duration = Duration::from_secs(1);

/// How long a request may look for the replica that holds its study. It lies above the time after which the
/// database takes a silent replica for dead.
pub const PEER_PATIENCE: Duration = Duration::from_secs(8);

/// First pause before a request looks again; it doubles each time.
pub const PEER_PAUSE: Duration = Duration::from_millis(2);

/// Longest pause before a request looks again.
pub const PEER_PAUSE_LONGEST: Duration = Duration::from_millis(100);

const _: () = assert!(PEER_PATIENCE.as_millis() > treewright_store::limits::REPLICA_LAPSE.as_millis());

/// Default limit of open Tune streams.
pub const TUNE_STREAMS: usize = 16_384;

/// Most Tune streams that can be asked for.
pub const TUNE_STREAMS_MAX: usize = 65_536;

/// Answers of one Tune stream that wait for a slow reader.
pub const TUNE_ANSWERS_WAITING: usize = 4;

/// Studies whose tuner is held in memory. Another one replaces the least recently used.
pub const STUDIES_IN_MEMORY: usize = 256;

/// Longest wait of a request for its study to be loaded before the client has to try again. The load goes on.
pub const LOADING_WAIT: Duration = Duration::from_secs(1);

/// When a request whose study is being loaded should come again.
pub const LOADING_RETRY: Duration = Duration::from_millis(100);

/// Lines logged about refusals of one reason within [`REFUSAL_PERIOD`].
pub const REFUSAL_LINES: u64 = 10;

/// Period of [`REFUSAL_LINES`], in whole seconds.
pub const REFUSAL_PERIOD: Duration = Duration::from_secs(10);

/// How long a question waits for a processor to compute its plan; then it is answered from the tables.
pub const PLANNING_WAIT: Duration = Duration::from_millis(5);

/// By how much the threads that plan and fit are nicer than those that answer: with both busy on one
/// processor, a tenth of it is theirs.
pub const COMPUTING_NICENESS: i32 = 10;

/// Completed trials that are read at once when a study is loaded: a few megabytes.
pub const TRIALS_PER_READ: u32 = 1000;

/// Fewest trials of a study that can be asked to be kept: what a change of predictor may need.
pub const KEEP_TRIALS_MIN: u64 = MODELS_TRIALS_MAX;

/// Trials that are removed in one write: what another write may have to wait for.
pub const TRIALS_PER_REMOVAL: usize = 500;

/// How often it is looked whether old trials can go.
pub const THINNING_PERIOD: Duration = Duration::from_secs(5);

/// Longest id of a study, in characters. The wire contract promises this figure.
pub const STUDY_ID_CHARACTERS: usize = 64;

/// Longest resource name that is looked at, in bytes.
pub const NAME_BYTES: usize = 256;

/// How often leases that have run out are looked for.
pub const SWEEP_PERIOD: Duration = Duration::from_secs(1);

/// When leases were not looked after for so long, the daemon was away: stopped, asleep, or without its
/// database.
pub const ABSENCE_MIN: Duration = Duration::from_secs(10);

/// How long clients are given, after the daemon was away, before a lease that ends counts as lost. Twice the
/// SDK's longest pause between attempts.
pub const RETURN_GRACE: Duration = Duration::from_secs(10);

/// How often it is looked whether a checkpoint is due.
pub const CHECKPOINT_PERIOD: Duration = Duration::from_secs(1);

/// For so long an orderly stop saves what was learnt since.
pub const LAST_CHECKPOINTS: Duration = Duration::from_secs(2);

/// Fewer completed trials behind a checkpoint are learnt again at the next start instead.
pub const LAST_CHECKPOINT_TRIALS: u64 = 100;

/// A connection that does not answer a ping within this time is closed, and the next ping follows after
/// the same time: a vanished client's streams must not stay for ever.
pub const KEEPALIVE: Duration = Duration::from_secs(20);

/// Longest drain that can be asked for, in seconds.
pub const DRAIN_S: u64 = 3600;

/// The database may take so long to answer the question whether it is there.
pub const READY: Duration = Duration::from_secs(2);

/// Most studies whose figures are shown with their names. Each has about 25 series.
pub const STUDIES_SHOWN: u16 = 64;

/// Connections at once of those who ask for metrics, and of browsers that show the dashboard, where there are
/// descriptors enough. Each page that is open in a browser keeps one for its events.
pub const PAGES_CONNECTIONS: usize = 64;

/// A browser's connection ends after this time, and the browser connects again by itself.
pub const DASHBOARD_STAY: Duration = Duration::from_secs(600);

/// How often it is looked whether a page that is open must change.
pub const DASHBOARD_LOOK: Duration = Duration::from_secs(1);

/// Largest form that a browser may send, in bytes: a token.
pub const DASHBOARD_FORM_BYTES: usize = 8 << 10;

/// The head of a question for metrics or for a page must be there within this time, and a form within as long
/// again.
pub const WATCH: Duration = Duration::from_secs(5);

/// An orderly end waits so long for answers to be read, once everything is answered.
pub const DRAIN_UNREAD: Duration = Duration::from_secs(1);

// What is unless told otherwise can be asked for.
const _: () = assert!(CONNECTIONS_MIN <= CONNECTIONS && CONNECTIONS <= CONNECTIONS_MAX);
const _: () = assert!(REQUESTS_IN_FLIGHT <= REQUESTS_IN_FLIGHT_MAX && TUNE_STREAMS <= TUNE_STREAMS_MAX);
// One request alone does not use up the budget of all connections.
const _: () = assert!(REQUEST_BYTES + REQUEST_HEAD_BYTES + HEADER_BYTES as usize <= UNFINISHED_BYTES);
// A page token names a study: a check sum of 16 digits, and two digits for each character of its id.
const _: () = assert!(16 + 2 * STUDY_ID_CHARACTERS <= treewright_store::limits::TOKEN_CHARACTERS);
// A sweep that is late is no absence, and a look at the tokens that fails is no reason to let nobody in.
const _: () = assert!(2 * SWEEP_PERIOD.as_millis() < ABSENCE_MIN.as_millis());
const _: () = assert!(2 * TOKENS_PERIOD.as_millis() < TOKENS_STALE.as_millis());
// Lines are counted by whole periods.
const _: () = assert!(REFUSAL_PERIOD.as_secs() > 0 && REFUSAL_PERIOD.subsec_nanos() == 0);

//! Every limit of the client, in one place. Messages to the service have the limits of
//! `treewright_model::limits`.

use std::time::Duration;

/// Most clients of one program, user and machine at the same time: each has a slot of its own.
pub const CLIENT_SLOTS: u32 = 1024;
/// Workers under one client's name, over all of its processes: trials that may be run side by side.
pub const WORKERS: usize = 1024;
/// Reports and abandoned trials that wait for the daemon, unless the options say otherwise.
pub const DEFAULT_QUEUE: usize = 1024;
/// The largest queue that the options may ask for.
pub const LARGEST_QUEUE: usize = 1 << 20;
/// Configurations remembered for the time when the daemon is away, each once for a state.
pub const REMEMBERED_CONFIGURATIONS: usize = 64;
/// Suggestions that one study may have under way at once; a further one gets the fallback.
pub const OUTSTANDING_SUGGESTIONS: usize = 256;
/// Frames that a tuner's stream may have unanswered; a further one gets the fallback.
pub const UNANSWERED_FRAMES: usize = 8;
/// Number of attempts after which a report answered by an internal error of the daemon is given up.
pub const ATTEMPTS_AFTER_INTERNAL_ERROR: u32 = 8;
/// Trials fetched at once when reading page by page. A trial takes about 3 kB, a page thus 0.6 MB.
pub const PAGE_SIZE: i32 = 200;
/// Bytes of the largest answer that is accepted.
pub const ANSWER_BYTES: usize = 16 << 20;

/// Longest wait for a suggestion that missed its frame; the next frame takes it.
pub const LATE_ANSWER: Duration = Duration::from_secs(5);
/// Shortest time after which the lease of a trial of several frames is renewed.
pub const LEAST_RENEWAL: Duration = Duration::from_millis(250);
/// Pause between looks for a daemon that is away.
pub const WAIT_PAUSE: Duration = Duration::from_millis(100);
/// Longest time of one attempt to deliver a report or to give a trial back.
pub const DELIVERY_ATTEMPT: Duration = Duration::from_secs(5);
/// Longest time of one attempt to find out whether the daemon answers.
pub const PROBE: Duration = Duration::from_secs(1);
/// Addresses of one service that a client may be given.
pub const ADDRESSES: usize = 16;
/// Longest time for establishing one connection.
pub const CONNECT: Duration = Duration::from_secs(1);
/// Longest time for sending queued reports after the last handle is gone.
pub const FLUSH_ON_DROP: Duration = Duration::from_secs(2);
/// Longest time for which a daemon's hint to try again later is obeyed.
pub const LONGEST_HINT: Duration = Duration::from_secs(60);
/// Bytes of a token. Ours are far shorter.
pub const TOKEN_BYTES: usize = 4096;
/// Bytes of a token, certificate or key file.
pub const CREDENTIAL_BYTES: u64 = 1 << 20;

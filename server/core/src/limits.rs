//! Every limit of the core in one place: the memory of studies, states, clients and machines. The limits of
//! requests to the daemon come from [`treewright_model::limits`], and stand here too.
//!
//! A limit that is reached is answered with an error that names the field and the limit, never with
//! silent truncation.

pub use treewright_model::limits::*;

/// Most states of a study. A million anchors of 17 indicators are 136 MB, and up to three times this size in
/// their index. Beyond the limit, indicators count as the nearest known state of their machine.
pub const STATES_MAX: usize = if cfg!(test) { 2000 } else { 1_000_000 };
/// States beyond [`STATES_MAX`], for machines that have none yet.
pub const STATES_OF_NEW_MACHINES_MAX: usize = if cfg!(test) { 2 } else { 4096 };
/// Most trials one client may hold open, one per state, and most that are put aside for it.
pub const OPEN_TRIALS_PER_CLIENT_MAX: usize = 64;
/// Most trials of a study that are put aside at a time.
pub const TRIALS_ASIDE_MAX: usize = 4096;
/// Most clients a study remembers the visits of. One more displaces the client with the oldest last decision
/// among those that hold no trial.
pub const CLIENTS_MAX: usize = if cfg!(test) { 200 } else { 100_000 };

/// Most kinds of machine, by fingerprint, that a study distinguishes at a time. One more displaces the
/// machine whose last new state is oldest. Its measurements stay as another machine's, and its fingerprint
/// remains.
pub const MACHINES_MAX: usize = if cfg!(test) { 6 } else { 256 };
/// Most states of other machines with a state's input that are linked to it: the first ones.
pub const SIBLINGS_MAX: usize = 32;

/// Largest packed value, in bytes before it was packed: a damaged length must not take all memory.
pub const UNPACKED_BYTES_MAX: usize = 1 << 30;

/// Most exploring trials of a client that wait to be settled; the oldest is charged in full when there are
/// more.
pub const CHARGES_MAX: usize = 16;
/// Most frames of the reference that an account remembers of a stay.
pub const REFERENCES_MAX: usize = 4;

/// Most configurations that are remembered of one state: the best and those met last. A forgotten one may be
/// sampled again.
pub const RECORDS_PER_STATE_MAX: usize = 1024;
/// Most configurations that are remembered of all states of a study together, as long as there are at most
/// half as many states. Else the best of each and its default are remembered. Configurations of states whose
/// last report is oldest are forgotten first. With six parameters this is about 50 MB.
pub const RECORDS_PER_STUDY_MAX: usize = if cfg!(test) { 1200 } else { 65_536 };
/// Most trials from before a change of predictor that the new one is taught.
pub const MODELS_TRIALS_MAX: u64 = if cfg!(test) { 40 } else { 20_000 };
/// Most configurations that models learn again when the omitted indicators change: some milliseconds of work.
pub const RELEARNT_MAX: usize = 512;
/// Most updates of the models that reports defer; with more, a report computes them itself.
pub const DEFERRED_UPDATES_MAX: usize = 64;
/// Least number of trials between checkpoints. A restart has to replay them.
pub const CHECKPOINT_TRIALS_MIN: u64 = 4096;
/// A checkpoint waits one trial for this number of bytes of the last one, so that checkpoints write less than
/// trials.
pub const CHECKPOINT_BYTES_PER_TRIAL: u64 = 512;

/// Most measurements at cheaper levels that a search remembers: the latest.
pub const CHEAPER_RUNS_MAX: usize = 512;

/// Most clients whose machines' speed is remembered: those that reported last.
pub const SPEEDS_MAX: usize = 4096;
/// Most open rechecks of a study: states in which either the state or a machine has changed.
pub const RECHECKS_MAX: usize = 64;
/// Most trials of a client that are taken back when the speed of its machine jumped.
pub const UNHELD_MAX: usize = 64;
/// Most trials of a state that the regression of costs on auxiliary measurements is learnt from: the latest.
pub const OBSERVATIONS_MAX: usize = 192;
/// Most states of a study that have such a regression: those measured last.
pub const DENOISED_STATES_MAX: usize = 1024;

/// Most configurations that an assessment of a state looks at: its work grows with their cube, up to some
/// 25 milliseconds with their measurements apart (`make gate` tells how long answers take).
pub const ASSESSED_MAX: usize = 96;
/// Most cells of an assessment, which are measurements that ran close to each other; with more, each
/// configuration is one cell.
pub const CELLS_MAX: usize = 160;
/// Least excess of these over configurations before a machine can be seen to change its speed.
pub const DRIFT_CELLS_LEAST: usize = 4;
/// Most configurations of a state that is assessed while other clients wait: a quarter of a millisecond at
/// most.
pub const ASSESSED_SHARED_MAX: usize = 12;
/// Most states of a study whose last assessment is kept.
pub const ASSESSMENTS_MAX: usize = 1024;

/// Most measurements of one configuration in one state that count in its cost: the latest.
pub const EVIDENCE_MAX: usize = 16;
/// Most repeated measurements that the noise of a state is judged by: the latest.
pub const NOISE_SAMPLES_MAX: usize = 32;

/// Most states that a portfolio is made for: the nearest; and most configurations that it is chosen among.
pub const PORTFOLIO_STATES_MAX: usize = 64;
/// See [`PORTFOLIO_STATES_MAX`].
pub const PORTFOLIO_CANDIDATES_MAX: usize = 128;

/// Most configurations of a state that its progress is judged by: the work grows with the cube of their
/// number.
pub const PROGRESS_SAMPLES_MAX: usize = 40;
/// Most states by which the expected gain of a search is judged: those met last.
pub const GAIN_STATES_MAX: usize = 1024;

/// Most known points of a search in one suggestion. Each is answered from the table; beyond this number an
/// unseen configuration is drawn at random instead.
pub const KNOWN_POINTS_PER_SUGGESTION_MAX: usize = 32;
/// Most points in reserve beyond the next one, for clients that ask while their search cannot be planned.
pub const POINTS_IN_RESERVE_MAX: usize = 12;
/// Most random configurations that are drawn to find an unseen one.
pub const UNSEEN_DRAWS_MAX: usize = 64;
/// Number of failures of a configuration in one state, without a verdict on it, after which it is given up
/// there.
pub const FAILURES_PER_CONFIGURATION_MAX: u32 = 3;

/// Lost leases of a configuration in a state without a measurement of it, after which it counts as
/// infeasible: its clients crash or hang.
pub const LEASES_LOST_MAX: u32 = 2;
/// Most sessions that are remembered of those which held an open trial before: the latest.
pub const EARLIER_SESSIONS_MAX: usize = 16;
/// Most configurations of a state of which lost leases are remembered: the latest.
pub const LOST_CONFIGURATIONS_MAX: usize = 64;

/// Most neighbouring states that a reason lists.
pub const NEIGHBOURS_MAX: usize = 5;
/// Most configurations among which a radial basis model chooses: it looks at all of them for an answer.
pub const CANDIDATES_MAX: usize = 48;
/// The smallest cost that the radial basis model distinguishes from zero: its reward is the inverse of the
/// cost, and sums of rewards must stay finite.
pub const REWARD_COST_MIN: f64 = 1e-100;

// The square of the largest distance between two normalised states must be finite.
const _: () =
    assert!(4.0 * NORMALISED_MAGNITUDE_MAX * NORMALISED_MAGNITUDE_MAX * (INDICATORS_MAX as f64) < f64::MAX);

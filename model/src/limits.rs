//! Every limit of the messages between a client and the daemon in one place, as in the comments of the wire
//! contract. The daemon's memory has other limits (`treewright_core::limits`).
//!
//! A limit that is reached is answered with an error that names the field and the limit, never with
//! silent truncation.

/// Longest name of a parameter, an indicator or a metric, in characters.
pub const NAME_CHARACTERS_MAX: usize = 64;
/// Longest `display_name` of a study, in characters.
pub const DISPLAY_NAME_CHARACTERS_MAX: usize = 200;
/// Longest `note` of a study, in bytes.
pub const NOTE_BYTES_MAX: usize = 4 << 10;
/// Most tags of a study.
pub const TAGS_MAX: usize = 16;
/// Longest tag of a study, in characters.
pub const TAG_CHARACTERS_MAX: usize = 32;
/// Longest `client_id`, in characters.
pub const CLIENT_ID_CHARACTERS_MAX: usize = 128;
/// Longest text value of a categorical parameter, in characters.
pub const TEXT_VALUE_CHARACTERS_MAX: usize = 256;
/// Longest reason of an infeasible or failed outcome, in characters.
pub const OUTCOME_REASON_CHARACTERS_MAX: usize = 1000;
/// Longest reason of the exclusion of a trial, in characters.
pub const EXCLUSION_CHARACTERS_MAX: usize = 500;
/// Longest origin of a trial that was carried over, in characters.
pub const ORIGIN_CHARACTERS_MAX: usize = 200;
/// Longest entry of a fingerprint, in characters.
pub const FINGERPRINT_TEXT_CHARACTERS_MAX: usize = 256;
/// Most software entries of a fingerprint.
pub const FINGERPRINT_SOFTWARE_MAX: usize = 32;

/// Most parameters of a space.
pub const PARAMETERS_MAX: usize = 128;
/// Most constraints of a space.
pub const CONSTRAINTS_MAX: usize = 64;
/// Longest constraint, in characters.
pub const CONSTRAINT_CHARACTERS_MAX: usize = 1000;
/// Most names, values and operators of a constraint.
pub const CONSTRAINT_NODES_MAX: usize = 256;
/// Most parentheses within each other, together with signs, in a constraint.
pub const CONSTRAINT_DEPTH_MAX: usize = 32;
/// Most values of a categorical domain, and of a condition.
pub const CATEGORIES_MAX: usize = 64;
/// Largest magnitude of an integer: beyond 2^53 doubles cannot represent every integer.
pub const INTEGER_MAGNITUDE_MAX: i64 = 1 << 53;
/// Most revisions of a study's space.
pub const SPACE_REVISIONS_MAX: usize = 32;
/// Most indicators of a study.
pub const INDICATORS_MAX: usize = 128;
/// Most auxiliary metrics of an objective.
pub const AUXILIARY_METRICS_MAX: usize = 8;
/// Most limits on measurements of an objective.
pub const MEASUREMENT_LIMITS_MAX: usize = 16;
/// Most frames of a trial.
pub const EPISODE_FRAMES_MAX: u32 = 64;
/// Most cheaper levels of measurements of an objective.
pub const FIDELITIES_MAX: usize = 4;
/// Most terms of an objective.
pub const OBJECTIVE_TERMS_MAX: usize = 16;
/// Most measurements of a report.
pub const MEASUREMENTS_MAX: usize = 64;

/// Most runs that a state's search may take.
pub const TRIALS_PER_STATE_MAX: u32 = 100_000;
/// Most measurements of one configuration in one state before the search goes on.
pub const REPLICATES_MAX: u32 = 100;
/// Most rounds in which the best of a state run against its incumbent.
pub const CONFIRM_ROUNDS_MAX: u32 = 100;
/// Most visits after which epsilon is halved.
pub const EPSILON_HALVES_AFTER_MAX: u32 = 1_000_000;
/// Most trials at the start of a session that are not learnt.
pub const WARM_UP_MAX: u32 = 10_000;
/// Largest factor between the costs of a configuration and the reference that a policy may name.
pub const COST_FACTOR_MAX: f64 = 1e6;
/// Most configurations of a space that are counted: a search can try this number one by one.
pub const ENUMERATED_MAX: usize = 1024;
/// Most solutions of connected constraints that are listed, so that the nearest is found among all of them.
pub const LISTED_MAX: usize = 1 << 16;
/// Most values that are tried to count configurations, or to list the solutions of constraints.
pub const LISTING_STEPS_MAX: usize = 1 << 19;
/// Most values that are tried to find a configuration near a point that breaks constraints.
pub const REPAIR_STEPS_MAX: usize = 1 << 13;
/// Most values that are tried in vain once one was found.
pub const REPAIR_PATIENCE: usize = 1 << 9;
/// Longest lease, in seconds: one day.
pub const LEASE_S_MAX: u32 = 86_400;

/// Largest magnitude of a normalised indicator. Values beyond a billion times the width of the declared range
/// are cut to it, so that squares and sums stay finite.
pub const NORMALISED_MAGNITUDE_MAX: f64 = 1e9;

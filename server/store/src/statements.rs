//! The fixed SQL that both databases share. A study without a name is deleted; in SQLite it has one that
//! sorts behind those of all others.

pub(crate) const FOLDED_NAMES_DELETE: &str = "DELETE FROM former_names WHERE name <> '' \
     AND last_trial <= (SELECT last_trial FROM former_names WHERE name = '')";

/// A stretch of the primary key.
pub(crate) const CLOSED_TRIALS: &str = "SELECT number, completion FROM trials WHERE study = $1 AND number > $2 \
     AND number <= $3 AND state <> 'OPEN' ORDER BY number LIMIT $4";

/// The latest checkpoint that has all its parts.
pub(crate) const CHECKPOINT: &str = "SELECT completion FROM checkpoints WHERE study = $1 \
     GROUP BY completion HAVING count(*) = max(parts) AND max(parts) = min(parts) \
     ORDER BY completion DESC LIMIT 1";

pub(crate) const CHECKPOINT_PARTS: &str =
    "SELECT bytes FROM checkpoints WHERE study = $1 AND completion = $2 ORDER BY part";

pub(crate) const REAP_TRIALS: &str = "DELETE FROM trials WHERE study = $1 AND number IN \
     (SELECT number FROM trials WHERE study = $1 ORDER BY number LIMIT $2)";

pub(crate) const REAP_VISITS: &str = "DELETE FROM visits WHERE study = $1 AND client_id IN \
     (SELECT client_id FROM visits WHERE study = $1 ORDER BY client_id LIMIT $2)";

pub(crate) const REAP_STATES: &str = "DELETE FROM states WHERE study = $1 AND id IN \
     (SELECT id FROM states WHERE study = $1 ORDER BY id LIMIT $2)";

pub(crate) const REAP_CHECKPOINTS: &str = "DELETE FROM checkpoints WHERE study = $1 AND \
     (completion, part) IN (SELECT completion, part FROM checkpoints WHERE study = $1 \
     ORDER BY completion, part LIMIT $2)";

pub(crate) const REAP_STUDY: &str = "DELETE FROM studies WHERE id = $1";

/// A column of JSON, read as text under its own name.
macro_rules! text {
    ($column:literal) => {
        concat!("CAST(", $column, " AS text) AS ", $column)
    };
}

/// A study with its counts. State ids and completions rise by one from 1, so that the highest is the count;
/// trial numbers have gaps. Each of these values is at the end of an index.
macro_rules! study_select {
    ($which:literal) => {
        concat!(
            "SELECT name, uid, named_after, skipped, ",
            text!("specification"),
            ", ",
            text!("policy"),
            ", create_ms, models_since, ",
            "(SELECT coalesce(max(s.id), 0) FROM states s WHERE s.study = studies.id) AS states, ",
            "(SELECT coalesce(max(t.number), 0) FROM trials t WHERE t.study = studies.id) AS last_trial, ",
            "(SELECT coalesce(max(t.completion), 0) FROM trials t WHERE t.study = studies.id ",
            "AND t.completion IS NOT NULL) AS completed_trials, ",
            "(SELECT count(*) FROM trials t WHERE t.study = studies.id AND t.state = 'OPEN') ",
            "AS open_trials FROM studies WHERE ",
            $which
        )
    };
}

pub(crate) const STUDY_KEY: &str = "SELECT id FROM studies WHERE name = $1 AND name < '~'";

pub(crate) const STUDY_COUNT: &str = "SELECT count(*) FROM studies WHERE name < '~'";

pub(crate) const STUDY_OF_UID: &str = "SELECT name FROM studies WHERE uid = $1 AND name < '~'";

pub(crate) const STUDY_BY_NAME: &str = study_select!("name = $1 AND name < '~'");

pub(crate) const STUDY_BY_KEY: &str = study_select!("id = $1 AND name < '~'");

pub(crate) const STUDY_PAGE: &str = study_select!("name > $1 AND name < '~' ORDER BY name LIMIT $2");

pub(crate) const VISITS_OF_STUDY: &str = concat!(
    "SELECT client_id, state_id, number, since, ",
    text!("decision"),
    ", ",
    text!("weighed"),
    ", ",
    text!("account"),
    " FROM visits WHERE study = $1 ORDER BY client_id"
);

/// The trials of study `$1`, in the columns that a [`TrialRow`](crate::rows::TrialRow) reads.
macro_rules! trial_select {
    ($which:literal) => {
        concat!(
            "SELECT number, client_id, state_id, mode, state, outcome, outcome_reason, outcome_lower_bound, \
             cost, predicted_cost, late, create_ms, lease_expire_ms, complete_ms, completion, exclusion, ",
            text!("configuration"),
            ", ",
            text!("indicators"),
            ", ",
            text!("measurements"),
            ", ",
            text!("standard_errors"),
            ", ",
            text!("reason"),
            ", ",
            text!("fingerprint"),
            " FROM trials WHERE study = ",
            $which
        )
    };
}

/// The beginning of a question for trials; the key of their study follows.
pub(crate) const TRIALS_OF_STUDY: &str = trial_select!("");

pub(crate) const TRIAL_BY_NUMBER: &str = trial_select!("$1 AND number = $2");

/// The sign before the number keeps SQLite's index of open trials in use: otherwise it would read all trials
/// of the study in the order of their numbers.
pub(crate) const OPEN_TRIALS: &str = trial_select!("$1 AND state = 'OPEN' ORDER BY +number");

/// A stretch of one index.
pub(crate) const COMPLETED_TRIALS: &str =
    trial_select!("$1 AND completion IS NOT NULL AND completion > $2 ORDER BY completion LIMIT $3");

/// The highest trial number of earlier studies under a name, as `former.last`.
macro_rules! former {
    ($name:literal) => {
        concat!(
            "(SELECT coalesce(max(last_trial), 0) AS last FROM former_names WHERE name IN (",
            $name,
            ", '')) AS former"
        )
    };
}

/// The highest trial number that a study has handed out or skipped. `$greatest` is the function that returns
/// the greater of two numbers, in this and in what follows.
macro_rules! last_trial {
    ($greatest:literal) => {
        concat!(
            $greatest,
            "(named_after, (SELECT coalesce(max(t.number), 0) FROM trials t WHERE t.study = studies.id))"
        )
    };
}

/// Notes the last trial number of a study under the name that it is about to lose.
macro_rules! name_left {
    ($greatest:literal) => {
        concat!(
            "INSERT INTO former_names (name, last_trial) SELECT name, last FROM (SELECT name, ",
            $crate::statements::last_trial!($greatest),
            " AS last FROM studies WHERE id = $1) AS study WHERE last > 0 ",
            "ON CONFLICT (name) DO UPDATE SET last_trial = ",
            $greatest,
            "(former_names.last_trial, excluded.last_trial)"
        )
    };
}

/// Merges former names beyond `$1`, those with the lowest numbers, into the empty name. `$all` is the limit
/// that is none.
macro_rules! names_folded {
    ($greatest:literal, $all:literal) => {
        concat!(
            "INSERT INTO former_names (name, last_trial) SELECT '', highest FROM \
             (SELECT max(last_trial) AS highest FROM (SELECT last_trial FROM former_names WHERE name <> '' \
             ORDER BY last_trial DESC LIMIT ",
            $all,
            " OFFSET $1) AS lowest) AS rest WHERE highest IS NOT NULL \
             ON CONFLICT (name) DO UPDATE SET last_trial = ",
            $greatest,
            "(former_names.last_trial, excluded.last_trial)"
        )
    };
}

/// Gives study `$1` the name `$2`; further changes of its row stand in `$more`.
macro_rules! study_renamed {
    ($greatest:literal, $more:literal) => {
        concat!(
            "UPDATE studies SET name = $2, ",
            $more,
            "named_after = ",
            $greatest,
            "(former.last, ",
            $crate::statements::last_trial!($greatest),
            "), skipped = skipped + ",
            $greatest,
            "(0, former.last - ",
            $crate::statements::last_trial!($greatest),
            ") FROM ",
            $crate::statements::former!("$2"),
            " WHERE id = $1"
        )
    };
}

pub(crate) use {former, last_trial, name_left, names_folded, study_renamed};

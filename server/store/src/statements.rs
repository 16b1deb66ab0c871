//! The fixed SQL that both databases share.

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

/// A study with its counts; `$documents` reads its specification and its policy. State ids and completions
/// rise by one from 1, so that the highest is the count; trial numbers have gaps. Each of these values is at
/// the end of an index.
macro_rules! study_select {
    ($documents:literal, $rest:literal) => {
        concat!(
            "SELECT name, uid, named_after, skipped, ",
            $documents,
            ", create_ms, models_since, ",
            "(SELECT coalesce(max(s.id), 0) FROM states s WHERE s.study = studies.id) AS states, ",
            "(SELECT coalesce(max(t.number), 0) FROM trials t WHERE t.study = studies.id) AS last_trial, ",
            "(SELECT coalesce(max(t.completion), 0) FROM trials t WHERE t.study = studies.id ",
            "AND t.completion IS NOT NULL) AS completed_trials, ",
            "(SELECT count(*) FROM trials t WHERE t.study = studies.id AND t.state = 'OPEN') ",
            "AS open_trials FROM studies ",
            $rest
        )
    };
}

pub(crate) use study_select;

//! The fixed SQL. For `script` the upserts have parameters without numbers, which count on from one
//! statement to the next.

pub(super) use crate::statements::*;

/// Begins a transaction that only reads, and sees the database as of its first question.
pub(super) const BEGIN_READING: &str = "BEGIN";

/// With the identity, where one is given.
pub(super) const STUDY_LOCK: &str =
    "SELECT id FROM studies WHERE name = $1 AND name < '~' AND uid = coalesce($2, uid)";

pub(super) const STUDY_INSERT: &str = concat!(
    "INSERT INTO studies (name, specification, policy, create_ms, uid, named_after, skipped) ",
    "SELECT $1, $2, $3, $4, lower(hex(randomblob(8))), last, last FROM ",
    former!("$1")
);

pub(super) const NAME_LEFT: &str = name_left!("max");

pub(super) const NAMES_FOLDED: &str = names_folded!("max", "-1");

pub(super) const STUDY_RENAME: &str = study_renamed!("max", "");

/// Gives a study a name that no study can have and that sorts behind all others. [`REAP_TRIALS`] and the
/// following remove its rows.
pub(super) const STUDY_DELETE: &str = "UPDATE studies SET name = '~' || id WHERE id = $1";

/// A study whose rows are to be removed.
pub(super) const DELETED_STUDY: &str = "SELECT id FROM studies WHERE name >= '~' ORDER BY name LIMIT 1";

pub(super) const STUDY_UPDATE: &str =
    "UPDATE studies SET specification = $2, policy = $3, models_since = $4 WHERE id = $1";

/// A new space, and the removal of what is of the earlier one: searches and the checkpoint.
pub(super) const SPACE_UPDATE: &str = "UPDATE studies SET specification = $2, policy = $3 WHERE id = $1";

pub(super) const SEARCHES_DELETE: &str = "UPDATE states SET search = NULL, search_packed = NULL \
     WHERE study = $1 AND (search IS NOT NULL OR search_packed IS NOT NULL)";

pub(super) const CHECKPOINTS_DELETE: &str = "DELETE FROM checkpoints WHERE study = $1";

pub(super) const STATES_OF_STUDY: &str =
    "SELECT id, indicators, fingerprint, search, search_packed FROM states WHERE study = $1 ORDER BY id";

pub(super) const STATE_UPSERT: &str = "INSERT INTO states (study, id, indicators, fingerprint, search_packed) \
     VALUES (?, ?, ?, ?, ?) \
     ON CONFLICT (study, id) DO UPDATE SET search = NULL, search_packed = excluded.search_packed";

pub(super) const VISIT_UPSERT: &str = "INSERT INTO visits \
     (study, client_id, state_id, number, since, decision, weighed, account) VALUES (?, ?, ?, ?, ?, ?, ?, ?) \
     ON CONFLICT (study, client_id) DO UPDATE SET state_id = excluded.state_id, \
     number = excluded.number, since = excluded.since, decision = excluded.decision, \
     weighed = excluded.weighed, account = excluded.account";

pub(super) const VISIT_DELETE: &str = "DELETE FROM visits WHERE study = ? AND client_id = ?";

/// A stored trial keeps its other columns. Only the lease, what `reason` notes of its client, and the report
/// can still change.
pub(super) const TRIAL_UPSERT: &str = "INSERT INTO trials (study, number, client_id, state_id, mode, state, \
     outcome, outcome_reason, outcome_lower_bound, cost, predicted_cost, late, create_ms, lease_expire_ms, \
     complete_ms, completion, configuration, indicators, measurements, reason, fingerprint, standard_errors) \
     VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) \
     ON CONFLICT (study, number) DO UPDATE SET state = excluded.state, outcome = excluded.outcome, \
     outcome_reason = excluded.outcome_reason, outcome_lower_bound = excluded.outcome_lower_bound, \
     cost = excluded.cost, late = excluded.late, lease_expire_ms = excluded.lease_expire_ms, \
     complete_ms = excluded.complete_ms, completion = excluded.completion, \
     measurements = excluded.measurements, standard_errors = excluded.standard_errors, reason = excluded.reason";

pub(super) const TRIAL_EXCLUDE: &str = "UPDATE trials SET exclusion = $3 WHERE study = $1 AND number = $2 \
     AND state = 'COMPLETED'";

/// `$2`: a JSON list of numbers, `$3`: the last completion that may be removed.
pub(super) const TRIALS_DELETE: &str = "DELETE FROM trials WHERE study = $1 \
     AND number IN (SELECT value FROM json_each($2)) AND state <> 'OPEN' \
     AND (completion IS NULL OR completion <= $3)";

/// Free pages, and all pages.
pub(super) const PAGES: &str =
    "SELECT freelist_count, page_count FROM pragma_freelist_count, pragma_page_count";

pub(super) const PART_UPSERT: &str = "INSERT INTO checkpoints (study, completion, part, parts, bytes) \
     VALUES ($1, $2, $3, $4, $5) \
     ON CONFLICT (study, completion, part) DO UPDATE SET parts = excluded.parts, bytes = excluded.bytes";

/// Also removes surplus parts of an earlier attempt at this checkpoint.
pub(super) const OTHER_CHECKPOINTS_DELETE: &str =
    "DELETE FROM checkpoints WHERE study = $1 AND (completion <> $2 OR part >= $3)";

pub(super) const STUDIES_WITH_DUE_LEASES: &str = "SELECT name FROM studies WHERE name < '~' AND EXISTS \
     (SELECT 1 FROM trials t WHERE t.study = studies.id AND t.state = 'OPEN' AND t.lease_expire_ms < $1) \
     ORDER BY name";

#[cfg(test)]
mod tests {
    use sqlx::sqlite::SqliteConnection;
    use sqlx::{AssertSqlSafe, Connection as _, Row as _};

    use super::*;

    /// The questions about a study of any size: none may walk through its trials.
    #[tokio::test]
    async fn no_question_walks_through_the_trials() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.unwrap();
        crate::migrations::sqlite().run(&mut connection).await.unwrap();
        for statement in [
            STUDY_BY_NAME,
            STUDY_BY_KEY,
            STUDY_PAGE,
            STATES_OF_STUDY,
            VISITS_OF_STUDY,
            TRIAL_BY_NUMBER,
            OPEN_TRIALS,
            COMPLETED_TRIALS,
            CLOSED_TRIALS,
            TRIALS_DELETE,
            TRIAL_EXCLUDE,
            DELETED_STUDY,
            STUDIES_WITH_DUE_LEASES,
            CHECKPOINT,
            CHECKPOINT_PARTS,
        ] {
            let explained = AssertSqlSafe(format!("EXPLAIN QUERY PLAN {statement}"));
            let rows = sqlx::query(explained).fetch_all(&mut connection).await.unwrap();
            for plan in rows.iter().map(|row| row.get::<String, _>("detail")) {
                let scans = plan.starts_with("SCAN")
                    && !plan.starts_with("SCAN studies")
                    && !plan.starts_with("SCAN json_each");
                // Open trials are few, and are sorted.
                let sorts = plan.contains("TEMP B-TREE") && statement != OPEN_TRIALS;
                assert!(!scans && !sorts, "{plan}: {statement}");
                // The highest number or completion of a study is the end of an index.
                let is_end = plan.contains(" t ") && plan.contains("(study=?)");
                let narrow = !plan.contains("trials") && !plan.contains(" t ")
                    || plan.contains("number=?")
                    || plan.contains("number>? AND number<?")
                    || plan.contains("completion>?")
                    || plan.contains("trials_open")
                    || is_end;
                assert!(narrow, "{plan}: {statement}");
            }
        }
    }
}

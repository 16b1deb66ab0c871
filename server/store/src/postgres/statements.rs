//! The fixed SQL for PostgreSQL.
//!
//! A replica lives while it renews its heartbeat and holds the advisory lock of its id. A question takes the
//! shared lock for a moment, so that several may ask at once. `$lapse` below is in seconds.

pub(super) use crate::statements::*;

/// First key of every advisory lock of ours ("TWrt"); the second is the replica's id.
macro_rules! lock_class {
    () => {
        "1415017076"
    };
}

/// Whether the replica `r` lives; false without one. `$lapse` is the parameter with the seconds of silence
/// after which a replica is dead.
macro_rules! lives {
    ($lapse:literal) => {
        concat!(
            "(r.id IS NOT NULL AND r.heartbeat > clock_timestamp() - ",
            $lapse,
            " * interval '1 second' AND NOT pg_try_advisory_xact_lock_shared(",
            lock_class!(),
            ", r.id))"
        )
    };
}

/// The channel of notices between replicas about studies that are taken, left and deleted.
macro_rules! channel {
    () => {
        "treewright"
    };
}

pub(super) const CHANNEL: &str = channel!();

// Opening.

pub(super) const SETTINGS: &str = "SET synchronous_commit = on; SET timezone = 'UTC'";

pub(super) const SERVER: &str =
    "SELECT current_setting('server_version_num')::integer, current_setting('fsync')";

/// Whether there are tables, but none of ours.
pub(super) const FOREIGN: &str = "SELECT count(*) > 0 AND bool_and(c.relname <> '_sqlx_migrations') \
     FROM pg_class c JOIN pg_namespace n ON n.oid = c.relnamespace \
     WHERE n.nspname = current_schema() AND c.relkind IN ('r', 'p')";

// Replicas.

pub(super) const REPLICA_INSERT: &str = "INSERT INTO replicas (address) VALUES ($1) RETURNING id";

pub(super) const REPLICA_KEY: &str = "SELECT key FROM replica_key";

pub(super) const REPLICA_LOCK: &str = concat!("SELECT pg_try_advisory_lock(", lock_class!(), ", $1)");

pub(super) const REPLICA_BEAT: &str = "UPDATE replicas SET heartbeat = clock_timestamp() WHERE id = $1";

/// Leaves every study of the replica without an owner.
pub(super) const REPLICA_DELETE: &str = concat!(
    "WITH gone AS (DELETE FROM replicas WHERE id = $1 RETURNING id) ",
    "SELECT id FROM gone, LATERAL pg_notify('",
    channel!(),
    "', 'left ' || id)"
);

/// Removes the rows of replicas that have been silent for long. Each row is removed by one replica.
pub(super) const REPLICAS_REAP: &str = "DELETE FROM replicas WHERE id IN (SELECT r.id FROM replicas r \
     WHERE r.id <> $1 AND r.heartbeat < clock_timestamp() - $2 * interval '1 second' \
     FOR UPDATE SKIP LOCKED)";

// Studies.

/// Begins a transaction that only reads, and sees the database as of its first question.
pub(super) const BEGIN_READING: &str = "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY";

pub(super) const STUDY_INSERT: &str = concat!(
    "INSERT INTO studies (name, specification, policy, create_ms, named_after, skipped) ",
    "SELECT $1::text, $2::json, $3::json, $4::bigint, former.last, former.last FROM ",
    former!("$1::text"),
    " ON CONFLICT (name) DO NOTHING"
);

/// Keeps other replicas from storing rows of the study until the end of the transaction.
pub(super) const STUDY_LOCK: &str =
    "SELECT id FROM studies WHERE name = $1 AND ($2::text IS NULL OR uid = $2) FOR UPDATE";

pub(super) const NAME_LEFT: &str = name_left!("greatest");

pub(super) const NAMES_FOLDED: &str = names_folded!("greatest", "ALL");

/// Takes the name from the study, so that it cannot be found, and raises its epoch, so that no replica stores
/// it.
pub(super) const STUDY_DELETE: &str = concat!(
    "WITH gone AS (UPDATE studies SET name = NULL, owner = NULL, epoch = epoch + 1 ",
    "WHERE id = $1 RETURNING id) SELECT id FROM gone, LATERAL pg_notify('",
    channel!(),
    "', 'deleted ' || id)"
);

/// Gives the study another name, and raises its epoch, so that a replica with the study in memory loads it
/// again.
pub(super) const STUDY_RENAME: &str = concat!(
    "WITH renamed AS (",
    study_renamed!("greatest", "owner = NULL, epoch = epoch + 1, "),
    " RETURNING id) SELECT id FROM renamed, LATERAL pg_notify('",
    channel!(),
    "', 'deleted ' || id)"
);

pub(super) const STUDY_OWNER: &str = concat!(
    "SELECT s.id, s.epoch, s.owner, CASE WHEN ",
    lives!("$2"),
    " THEN r.address END AS address FROM studies s LEFT JOIN replicas r ON r.id = s.owner WHERE s.name = $1"
);

pub(super) const HOLDER_ADDRESS: &str = concat!(
    "SELECT CASE WHEN ",
    lives!("$2"),
    " THEN r.address END FROM studies s LEFT JOIN replicas r ON r.id = s.owner WHERE s.name = $1"
);

pub(super) const DATABASE_BYTES: &str = "SELECT pg_database_size(current_database())";

/// Takes the study, unless another replica took it since it was read.
pub(super) const STUDY_CLAIM: &str = concat!(
    "WITH claimed AS (UPDATE studies SET owner = $3, epoch = epoch + 1 ",
    "WHERE id = $1 AND epoch = $2 AND name IS NOT NULL RETURNING id, epoch) ",
    "SELECT epoch FROM claimed, LATERAL pg_notify('",
    channel!(),
    "', 'claimed ' || id || ' ' || epoch)"
);

pub(super) const STUDY_UPDATE: &str = "UPDATE studies \
     SET specification = $3::json, policy = $4::json, models_since = $5 \
     WHERE id = $1 AND epoch = $2 AND name IS NOT NULL";

/// A new space, and the removal of what is of the earlier one: searches and the checkpoint.
pub(super) const SPACE_UPDATE: &str = "WITH held AS MATERIALIZED (SELECT id FROM studies \
     WHERE id = $1 AND epoch = $2 AND name IS NOT NULL FOR NO KEY UPDATE), \
     searches AS (UPDATE states SET search = NULL WHERE study IN (SELECT id FROM held) AND search IS NOT NULL), \
     saved AS (DELETE FROM checkpoints WHERE study IN (SELECT id FROM held)) \
     UPDATE studies SET specification = $3::json, policy = $4::json WHERE id IN (SELECT id FROM held)";

/// The exclusion of a completed trial, and the removal of the checkpoint, which rests on other trials.
pub(super) const TRIAL_EXCLUDE: &str = "WITH held AS MATERIALIZED (SELECT id FROM studies \
     WHERE id = $1 AND epoch = $2 AND name IS NOT NULL FOR NO KEY UPDATE), \
     saved AS (DELETE FROM checkpoints WHERE study IN (SELECT id FROM held)) \
     UPDATE trials SET exclusion = $4 WHERE study IN (SELECT id FROM held) AND number = $3 \
     AND state = 'COMPLETED'";

// Reading.

pub(super) const STATES_OF_STUDY: &str = "SELECT id, indicators::text, fingerprint::text, NULL::text AS search, \
     search AS search_packed \
     FROM states WHERE study = $1 ORDER BY id";

// Background work that replicas share: a row in use by one replica is skipped by the others.

/// The studies with leases that ended before `$1`: those of replica `$2`, and those without a living owner,
/// which it takes over. A row that another replica took meanwhile is judged again by its new owner, which a
/// question within the question finds. A join would compare that owner with the replica of before.
pub(super) const STUDIES_WITH_DUE_LEASES: &str = concat!(
    "WITH orphans AS (SELECT s.id FROM studies s ",
    "WHERE s.name IS NOT NULL AND s.owner IS DISTINCT FROM $2 AND EXISTS (SELECT 1 FROM trials t ",
    "WHERE t.study = s.id AND t.state = 'OPEN' AND t.lease_expire_ms < $1) ",
    "AND NOT EXISTS (SELECT 1 FROM replicas r WHERE r.id = s.owner AND ",
    lives!("$3"),
    ") ORDER BY s.id LIMIT $4 FOR NO KEY UPDATE OF s SKIP LOCKED), ",
    "adopted AS (UPDATE studies s SET owner = $2 FROM orphans WHERE s.id = orphans.id RETURNING s.name) ",
    "SELECT name FROM adopted UNION ALL (SELECT s.name FROM studies s WHERE s.owner = $2 ",
    "AND s.name IS NOT NULL AND EXISTS (SELECT 1 FROM trials t WHERE t.study = s.id ",
    "AND t.state = 'OPEN' AND t.lease_expire_ms < $1) LIMIT $4) ORDER BY name"
);

/// Of these studies, those whose epoch still holds: for commits without rows, whose callers wait for earlier
/// writes.
pub(super) const HELD_STUDIES: &str = "SELECT s.id FROM studies s \
     JOIN unnest($1::bigint[], $2::bigint[]) AS f (id, epoch) ON s.id = f.id AND s.epoch = f.epoch \
     WHERE s.name IS NOT NULL";

/// Locks a deleted study, so that one replica at a time removes its rows.
pub(super) const DELETED_STUDY: &str =
    "SELECT id FROM studies WHERE name IS NULL ORDER BY id LIMIT 1 FOR UPDATE SKIP LOCKED";

// Writing.

/// Saves a part of a checkpoint, if the study's epoch still holds.
pub(super) const PART_UPSERT: &str = "WITH held AS (SELECT id FROM studies \
     WHERE id = $1 AND epoch = $2 AND name IS NOT NULL FOR NO KEY UPDATE) \
     INSERT INTO checkpoints (study, completion, part, parts, bytes) SELECT id, $3, $4, $5, $6 FROM held \
     ON CONFLICT (study, completion, part) DO UPDATE SET parts = excluded.parts, bytes = excluded.bytes";

/// Removes closed trials of a study whose epoch still holds, unless completed after `$4`. Returns whether the
/// epoch holds, and the number of removed trials.
pub(super) const TRIALS_DELETE: &str = "WITH held AS MATERIALIZED (SELECT id FROM studies \
     WHERE id = $1 AND epoch = $2 AND name IS NOT NULL FOR NO KEY UPDATE), \
     gone AS (DELETE FROM trials t USING held WHERE t.study = held.id AND t.number = ANY($3) \
     AND t.state <> 'OPEN' AND (t.completion IS NULL OR t.completion <= $4) RETURNING t.number) \
     SELECT (SELECT count(*) FROM held), (SELECT count(*) FROM gone)";

/// Also removes surplus parts of an earlier attempt at this checkpoint. Changes nothing where the study's
/// epoch no longer holds: the other checkpoint is then that of the present holder.
pub(super) const OTHER_CHECKPOINTS_DELETE: &str = "WITH held AS MATERIALIZED (SELECT id FROM studies \
     WHERE id = $1 AND epoch = $2 AND name IS NOT NULL FOR NO KEY UPDATE) \
     DELETE FROM checkpoints c USING held WHERE c.study = held.id AND (c.completion <> $3 OR c.part >= $4)";

/// Stores a batch in one statement, and so in one transaction and one round trip.
///
/// `held` locks the studies whose epoch is still the writer's, in the order of their keys, so that two
/// replicas cannot wait for each other. A replica that takes a study meanwhile waits for this lock. One that
/// took it before has raised the epoch. Only rows of held studies are stored, and the answer lists these
/// studies. A stored trial keeps its other columns; only the lease and the report can still change.
pub(super) const BATCH: &str = "\
WITH held AS MATERIALIZED (
    SELECT s.id FROM studies s
    JOIN unnest($1::bigint[], $2::bigint[]) AS f (study, epoch) ON s.id = f.study AND s.epoch = f.epoch
    WHERE s.name IS NOT NULL ORDER BY s.id FOR NO KEY UPDATE OF s
), stored_states AS (
    INSERT INTO states (study, id, indicators, fingerprint, search)
    SELECT r.study, r.id, r.indicators::json, r.fingerprint::json, r.search
    FROM unnest($3::bigint[], $4::bigint[], $5::text[], $6::text[], $7::bytea[])
        AS r (study, id, indicators, fingerprint, search)
    WHERE r.study IN (SELECT id FROM held)
    ON CONFLICT (study, id) DO UPDATE SET search = excluded.search
), stored_visits AS (
    INSERT INTO visits (study, client_id, state_id, number, decision, weighed, account, since)
    SELECT r.study, r.client_id, r.state_id, r.number, r.decision::json, r.weighed::json, r.account::json, r.since
    FROM unnest($8::bigint[], $9::text[], $10::bigint[], $11::bigint[], $12::text[], $13::text[],
        $14::text[], $36::bigint[]) AS r (study, client_id, state_id, number, decision, weighed, account, since)
    WHERE r.study IN (SELECT id FROM held)
    ON CONFLICT (study, client_id) DO UPDATE SET state_id = excluded.state_id,
        number = excluded.number, decision = excluded.decision, weighed = excluded.weighed,
        account = excluded.account, since = excluded.since
), forgotten_visits AS (
    DELETE FROM visits v USING unnest($37::bigint[], $38::text[]) AS r (study, client_id)
    WHERE v.study = r.study AND v.client_id = r.client_id AND r.study IN (SELECT id FROM held)
), stored_trials AS (
    INSERT INTO trials (study, number, client_id, state_id, mode, state, outcome, outcome_reason,
        outcome_lower_bound, cost, predicted_cost, late, create_ms, lease_expire_ms, complete_ms,
        completion, configuration, indicators, measurements, reason, fingerprint, standard_errors)
    SELECT r.study, r.number, r.client_id, r.state_id, r.mode, r.state, r.outcome, r.outcome_reason,
        r.outcome_lower_bound, r.cost, r.predicted_cost, r.late, r.create_ms, r.lease_expire_ms,
        r.complete_ms, r.completion, r.configuration::json, r.indicators::json, r.measurements::json,
        r.reason::json, r.fingerprint::json, r.standard_errors::json
    FROM unnest($15::bigint[], $16::bigint[], $17::text[], $18::bigint[], $19::text[], $20::text[],
        $21::text[], $22::text[], $23::float8[], $24::float8[], $25::float8[], $26::boolean[],
        $27::bigint[], $28::bigint[], $29::bigint[], $30::bigint[], $31::text[], $32::text[],
        $33::text[], $34::text[], $35::text[], $39::text[]) AS r (study, number, client_id, state_id, mode, state,
        outcome, outcome_reason, outcome_lower_bound, cost, predicted_cost, late, create_ms,
        lease_expire_ms, complete_ms, completion, configuration, indicators, measurements, reason,
        fingerprint, standard_errors)
    WHERE r.study IN (SELECT id FROM held)
    ON CONFLICT (study, number) DO UPDATE SET state = excluded.state, outcome = excluded.outcome,
        outcome_reason = excluded.outcome_reason, outcome_lower_bound = excluded.outcome_lower_bound,
        cost = excluded.cost, late = excluded.late, lease_expire_ms = excluded.lease_expire_ms,
        complete_ms = excluded.complete_ms, completion = excluded.completion,
        measurements = excluded.measurements, standard_errors = excluded.standard_errors,
        reason = excluded.reason
)
SELECT id FROM held";

#[cfg(test)]
mod tests {
    use super::*;

    /// The holder of an earlier epoch may wake up at any statement.
    #[test]
    fn every_write_under_a_fence_asks_for_its_epoch() {
        for statement in
            [STUDY_UPDATE, SPACE_UPDATE, TRIAL_EXCLUDE, PART_UPSERT, OTHER_CHECKPOINTS_DELETE, TRIALS_DELETE]
        {
            assert!(statement.contains("epoch = $2 AND name IS NOT NULL"), "{statement}");
        }
        assert!(BATCH.contains("s.epoch = f.epoch"));
    }

    /// A study may have a million states, and the replica's heartbeat waits for each piece.
    #[test]
    fn every_piece_of_a_deleted_study_has_a_limit() {
        for statement in [REAP_TRIALS, REAP_VISITS, REAP_STATES, REAP_CHECKPOINTS] {
            assert!(statement.contains("WHERE study = $1"), "{statement}");
            assert!(statement.ends_with("LIMIT $2)"), "{statement}");
        }
    }
}

-- Why a completed trial is excluded from all that is learnt; NULL where it counts.
ALTER TABLE trials ADD COLUMN exclusion TEXT;

-- Raw measurements are still never overwritten, whoever asks: only the exclusion of a completed trial changes.
DROP TRIGGER trials_completed_are_final;
CREATE TRIGGER trials_completed_are_final
BEFORE UPDATE OF study, number, client_id, state_id, mode, state, outcome, outcome_reason, outcome_lower_bound, cost,
    predicted_cost, late, create_ms, lease_expire_ms, complete_ms, completion, configuration, indicators, measurements,
    reason, fingerprint
ON trials
WHEN old.state = 'COMPLETED'
BEGIN
    SELECT RAISE(ABORT, 'a completed trial is never changed');
END;

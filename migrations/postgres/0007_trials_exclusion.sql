-- Why a completed trial is excluded from all that is learnt; NULL where it counts.
ALTER TABLE trials ADD COLUMN exclusion text;

-- Raw measurements are still never overwritten, whoever asks: only the exclusion of a completed trial changes.
DROP TRIGGER trials_completed_are_final ON trials;
CREATE TRIGGER trials_completed_are_final
BEFORE UPDATE OF study, number, client_id, state_id, mode, state, outcome, outcome_reason, outcome_lower_bound, cost,
    predicted_cost, late, create_ms, lease_expire_ms, complete_ms, completion, configuration, indicators, measurements,
    reason, fingerprint
ON trials
FOR EACH ROW WHEN (old.state = 'COMPLETED')
EXECUTE FUNCTION refuse_change_of_completed_trial();

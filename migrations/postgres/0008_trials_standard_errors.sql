-- The standard errors of measurements that are estimates; NULL where the client gave none.
ALTER TABLE trials ADD COLUMN standard_errors json;

-- They are as final as the measurements.
DROP TRIGGER trials_completed_are_final ON trials;
CREATE TRIGGER trials_completed_are_final
BEFORE UPDATE OF study, number, client_id, state_id, mode, state, outcome, outcome_reason, outcome_lower_bound, cost,
    predicted_cost, late, create_ms, lease_expire_ms, complete_ms, completion, configuration, indicators, measurements,
    reason, fingerprint, standard_errors
ON trials
FOR EACH ROW WHEN (old.state = 'COMPLETED')
EXECUTE FUNCTION refuse_change_of_completed_trial();

-- The trials of one state in order, which pages and analyses ask for: without it each such question walks through
-- all trials of the study.
CREATE INDEX trials_by_state ON trials (study, state_id, number);

-- What a policy weighs beside the dice: why a visit explores, and what exploring may still cost its client.
-- Both NULL where the policy keeps neither.
ALTER TABLE visits ADD COLUMN weighed TEXT;
ALTER TABLE visits ADD COLUMN account TEXT;

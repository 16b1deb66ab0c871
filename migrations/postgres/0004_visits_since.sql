-- The last trial that had been handed out when a client's visit was last decided. Of more clients than a study
-- remembers, those with the lowest are forgotten first; those of earlier versions before all others.
ALTER TABLE visits ADD COLUMN since bigint NOT NULL DEFAULT 0;

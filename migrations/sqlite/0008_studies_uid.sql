-- The identity of a study: 16 hexadecimal digits drawn when it was created, those of earlier versions here.
ALTER TABLE studies ADD COLUMN uid TEXT NOT NULL DEFAULT '';
UPDATE studies SET uid = lower(hex(randomblob(8)));
CREATE UNIQUE INDEX studies_by_uid ON studies (uid);
-- Trials with numbers up to this were handed out before the study got its name, by itself or by others.
ALTER TABLE studies ADD COLUMN named_after INTEGER NOT NULL DEFAULT 0;
-- How many numbers were left out, since other studies had handed them out under the name.
ALTER TABLE studies ADD COLUMN skipped INTEGER NOT NULL DEFAULT 0;

-- Names that studies had until they were deleted or renamed, and the highest trial number that was handed out under
-- each. The row of the empty name stands for all names that are no longer listed.
CREATE TABLE former_names (
    name       TEXT    PRIMARY KEY,
    last_trial INTEGER NOT NULL
) STRICT;

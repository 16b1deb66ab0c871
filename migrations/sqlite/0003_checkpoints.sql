-- What a daemon learnt from a study's completed trials, so that it need not read them all when it starts. Only
-- an accelerator: without it the trials are gone through again. Written part by part, so that no other write
-- waits for long; one that lacks parts is as good as none.
CREATE TABLE checkpoints (
    study      INTEGER NOT NULL REFERENCES studies (id) ON DELETE CASCADE,
    -- It covers the trials up to this place in the order of completion.
    completion INTEGER NOT NULL,
    part       INTEGER NOT NULL,
    -- How many parts it has.
    parts      INTEGER NOT NULL,
    bytes      BLOB    NOT NULL,
    PRIMARY KEY (study, completion, part)
) STRICT;

-- The completion at which the models that the policy's predictor needs were begun anew; 0 for the beginning.
ALTER TABLE studies ADD COLUMN models_since INTEGER NOT NULL DEFAULT 0;

-- Where a search stands, packed to a fraction of the text. `search` is what earlier versions wrote, and is read
-- where this is NULL.
ALTER TABLE states ADD COLUMN search_packed BLOB;

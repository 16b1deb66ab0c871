-- Studies, states, trials and visits.
--
-- Columns for what people ask for, JSON text for what varies from study to study. Times are milliseconds
-- since 1970, UTC. A released migration is never edited: sqlx compares check sums.

CREATE TABLE studies (
    -- AUTOINCREMENT, so that the key of a deleted study is never given out again.
    id            INTEGER PRIMARY KEY AUTOINCREMENT,
    -- The last part of the resource name.
    name          TEXT    NOT NULL UNIQUE,
    -- Everything but the policy.
    specification TEXT    NOT NULL,
    policy        TEXT    NOT NULL,
    create_ms     INTEGER NOT NULL
) STRICT;

CREATE TABLE states (
    study      INTEGER NOT NULL REFERENCES studies (id) ON DELETE CASCADE,
    id         INTEGER NOT NULL,
    -- The normalised indicators that founded the state, in the order of the study's schema.
    indicators TEXT    NOT NULL,
    -- Where the search stands; NULL while the state has not been explored.
    search     TEXT,
    PRIMARY KEY (study, id)
) STRICT;

CREATE TABLE visits (
    study     INTEGER NOT NULL REFERENCES studies (id) ON DELETE CASCADE,
    client_id TEXT    NOT NULL,
    state_id  INTEGER NOT NULL,
    -- How many visits the client has made.
    number    INTEGER NOT NULL,
    -- What was decided when the client came to the state.
    decision  TEXT    NOT NULL,
    PRIMARY KEY (study, client_id),
    FOREIGN KEY (study, state_id) REFERENCES states (study, id)
) STRICT;

CREATE TABLE trials (
    study               INTEGER NOT NULL REFERENCES studies (id) ON DELETE CASCADE,
    number              INTEGER NOT NULL,
    client_id           TEXT    NOT NULL,
    state_id            INTEGER NOT NULL,
    mode                TEXT    NOT NULL CHECK (mode IN ('DEFAULT', 'EXPLORE', 'EXPLOIT', 'PINNED')),
    state               TEXT    NOT NULL CHECK (state IN ('OPEN', 'COMPLETED', 'ABANDONED', 'EXPIRED')),
    outcome             TEXT             CHECK (outcome IN ('OK', 'INFEASIBLE', 'ABORTED', 'FAILED')),
    -- Of infeasible and failed trials.
    outcome_reason      TEXT,
    -- Of aborted trials.
    outcome_lower_bound REAL,
    cost                REAL,
    predicted_cost      REAL,
    late                INTEGER NOT NULL CHECK (late IN (0, 1)),
    create_ms           INTEGER NOT NULL,
    lease_expire_ms     INTEGER NOT NULL,
    complete_ms         INTEGER,
    -- Place in the order of completion within the study, from 1.
    completion          INTEGER,
    configuration       TEXT    NOT NULL,
    indicators          TEXT    NOT NULL,
    measurements        TEXT    NOT NULL,
    reason              TEXT    NOT NULL,
    fingerprint         TEXT,
    PRIMARY KEY (study, number),
    FOREIGN KEY (study, state_id) REFERENCES states (study, id),
    CHECK ((state = 'COMPLETED') = (outcome IS NOT NULL)),
    CHECK ((state = 'COMPLETED') = (completion IS NOT NULL))
) STRICT;

-- The order in which a tuner is rebuilt; its highest entry is the count of completed trials.
CREATE UNIQUE INDEX trials_by_completion ON trials (study, completion) WHERE completion IS NOT NULL;

-- The few trials under a lease, soonest to expire first.
CREATE INDEX trials_open ON trials (study, lease_expire_ms) WHERE state = 'OPEN';

-- Raw measurements are never overwritten, whoever asks.
CREATE TRIGGER trials_completed_are_final
BEFORE UPDATE ON trials
WHEN old.state = 'COMPLETED'
BEGIN
    SELECT RAISE(ABORT, 'a completed trial is never changed');
END;

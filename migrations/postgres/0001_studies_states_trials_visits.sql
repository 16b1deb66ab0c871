-- Studies, states, trials and visits, and the replicas that share them.
--
-- Columns for what people ask for, JSON for what varies from study to study. JSON is of type json, which
-- keeps the text as it was written: jsonb would read 1e16 as an integer and forget the sign of -0.0, and
-- raw measurements come back as they were. Times of the domain are milliseconds since 1970, UTC, by the
-- replicas' clocks; the replicas' own lives go by the database's clock. A released migration is never
-- edited: sqlx compares check sums.

-- A process that serves this database. While it lives it holds the advisory lock of its id, so that the
-- others see its end as soon as the database does; and it renews its heartbeat, so that they also see when
-- it is cut off without its connection having broken.
CREATE TABLE replicas (
    id        integer GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    -- Where the other replicas reach it.
    address   text        NOT NULL,
    start     timestamptz NOT NULL DEFAULT clock_timestamp(),
    heartbeat timestamptz NOT NULL DEFAULT clock_timestamp()
);

CREATE TABLE studies (
    -- The key of a deleted study is never given out again.
    id            bigint  GENERATED ALWAYS AS IDENTITY PRIMARY KEY,
    -- The last part of the resource name, ordered by its bytes. NULL once the study is deleted: its rows are
    -- then taken away piece by piece.
    name          text    COLLATE "C" UNIQUE,
    -- Everything but the policy.
    specification json    NOT NULL,
    policy        json    NOT NULL,
    create_ms     bigint  NOT NULL,
    -- The completion at which the models that the policy's predictor needs were begun anew; 0 for the
    -- beginning.
    models_since  bigint  NOT NULL DEFAULT 0,
    -- Rises whenever a replica takes the study; a change computed under an earlier one is refused.
    epoch         bigint  NOT NULL DEFAULT 0,
    -- The replica that holds the study's tuner.
    owner         integer REFERENCES replicas (id) ON DELETE SET NULL
);

CREATE INDEX studies_by_owner ON studies (owner) WHERE owner IS NOT NULL;
CREATE INDEX studies_deleted ON studies (id) WHERE name IS NULL;

CREATE TABLE states (
    study      bigint NOT NULL REFERENCES studies (id),
    id         bigint NOT NULL,
    -- The normalised indicators that founded the state, in the order of the study's schema.
    indicators json   NOT NULL,
    -- Where the search stands, packed; NULL while the state has not been explored.
    search     bytea,
    PRIMARY KEY (study, id)
);

CREATE TABLE visits (
    study     bigint NOT NULL,
    client_id text   COLLATE "C" NOT NULL,
    state_id  bigint NOT NULL,
    -- How many visits the client has made.
    number    bigint NOT NULL,
    -- What was decided when the client came to the state.
    decision  json   NOT NULL,
    -- What a policy weighs beside the dice: why a visit explores, and what exploring may still cost its
    -- client. Both NULL where the policy keeps neither.
    weighed   json,
    account   json,
    PRIMARY KEY (study, client_id),
    FOREIGN KEY (study, state_id) REFERENCES states (study, id)
);

CREATE TABLE trials (
    study               bigint  NOT NULL,
    number              bigint  NOT NULL,
    client_id           text    COLLATE "C" NOT NULL,
    state_id            bigint  NOT NULL,
    mode                text    NOT NULL CHECK (mode IN ('DEFAULT', 'EXPLORE', 'EXPLOIT', 'PINNED')),
    state               text    NOT NULL CHECK (state IN ('OPEN', 'COMPLETED', 'ABANDONED', 'EXPIRED')),
    outcome             text             CHECK (outcome IN ('OK', 'INFEASIBLE', 'ABORTED', 'FAILED')),
    -- Of infeasible and failed trials.
    outcome_reason      text,
    -- Of aborted trials.
    outcome_lower_bound double precision,
    cost                double precision,
    predicted_cost      double precision,
    late                boolean NOT NULL,
    create_ms           bigint  NOT NULL,
    lease_expire_ms     bigint  NOT NULL,
    complete_ms         bigint,
    -- Place in the order of completion within the study, from 1.
    completion          bigint,
    configuration       json    NOT NULL,
    indicators          json    NOT NULL,
    measurements        json    NOT NULL,
    reason              json    NOT NULL,
    fingerprint         json,
    PRIMARY KEY (study, number),
    FOREIGN KEY (study, state_id) REFERENCES states (study, id),
    CHECK ((state = 'COMPLETED') = (outcome IS NOT NULL)),
    CHECK ((state = 'COMPLETED') = (completion IS NOT NULL))
);

-- The order in which a tuner is rebuilt; its highest entry is the count of completed trials.
CREATE UNIQUE INDEX trials_by_completion ON trials (study, completion) WHERE completion IS NOT NULL;

-- The few trials under a lease, soonest to expire first.
CREATE INDEX trials_open ON trials (study, lease_expire_ms) WHERE state = 'OPEN';

-- What a replica learnt from a study's completed trials, so that it need not read them all when it takes the
-- study. Only an accelerator: without it the trials are gone through again. Written part by part, so that no
-- other write waits for long; one that lacks parts is as good as none.
CREATE TABLE checkpoints (
    study      bigint NOT NULL REFERENCES studies (id),
    -- It covers the trials up to this place in the order of completion.
    completion bigint NOT NULL,
    part       bigint NOT NULL,
    -- How many parts it has.
    parts      bigint NOT NULL,
    bytes      bytea  NOT NULL,
    PRIMARY KEY (study, completion, part)
);

-- Both are packed already.
ALTER TABLE states ALTER COLUMN search SET STORAGE EXTERNAL;
ALTER TABLE checkpoints ALTER COLUMN bytes SET STORAGE EXTERNAL;

-- Raw measurements are never overwritten, whoever asks.
CREATE FUNCTION refuse_change_of_completed_trial() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'a completed trial is never changed' USING ERRCODE = 'integrity_constraint_violation';
END
$$;

CREATE TRIGGER trials_completed_are_final
BEFORE UPDATE ON trials
FOR EACH ROW WHEN (old.state = 'COMPLETED')
EXECUTE FUNCTION refuse_change_of_completed_trial();

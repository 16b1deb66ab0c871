-- Who may do what: tokens, of which only the hash is kept, and what each has used. And the key by which the
-- replicas know each other.

CREATE TABLE tokens (
    -- The public part of the token, by which it is looked up and named in logs.
    id        text   COLLATE "C" PRIMARY KEY,
    -- For people.
    name      text   NOT NULL,
    -- SHA-256 of the secret part.
    hash      bytea  NOT NULL CHECK (length(hash) = 32),
    scope     text   NOT NULL CHECK (scope IN ('READ', 'TUNE', 'ADMIN')),
    -- List of study ids and prefixes ("farm-*"); empty means every study.
    studies   json   NOT NULL,
    -- Limits; what is missing is not limited.
    quota     json   NOT NULL,
    create_ms bigint NOT NULL,
    expire_ms bigint,
    revoke_ms bigint
);

-- Additive, so that several replicas can count into one row. One row for each day of use.
CREATE TABLE token_usage (
    token   text   COLLATE "C" NOT NULL REFERENCES tokens (id) ON DELETE CASCADE,
    -- Days since 1970, UTC.
    day     bigint NOT NULL,
    studies bigint NOT NULL,
    trials  bigint NOT NULL,
    bytes   bigint NOT NULL,
    PRIMARY KEY (token, day)
);

-- Rises with every change of a token, so that each replica can tell cheaply that there was one.
CREATE TABLE token_revision (
    only_row integer PRIMARY KEY CHECK (only_row = 1),
    revision bigint  NOT NULL
);
INSERT INTO token_revision VALUES (1, 0);

CREATE FUNCTION raise_token_revision() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    UPDATE token_revision SET revision = revision + 1;
    RETURN NULL;
END
$$;

CREATE TRIGGER tokens_changed
AFTER INSERT OR UPDATE OR DELETE ON tokens
FOR EACH STATEMENT
EXECUTE FUNCTION raise_token_revision();

-- Whoever shows this key passes on a request that a replica has counted already. Two random UUIDs hold 244 bits
-- of the server's strong randomness.
CREATE TABLE replica_key (
    only_row integer PRIMARY KEY CHECK (only_row = 1),
    key      bytea   NOT NULL CHECK (length(key) = 32)
);
INSERT INTO replica_key VALUES
    (1, decode(replace(gen_random_uuid()::text || gen_random_uuid()::text, '-', ''), 'hex'));

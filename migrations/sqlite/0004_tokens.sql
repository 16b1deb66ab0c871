-- Who may do what: tokens, of which only the hash is kept, and what each has used.

CREATE TABLE tokens (
    -- The public part of the token, by which it is looked up and named in logs.
    id        TEXT    PRIMARY KEY,
    -- For people.
    name      TEXT    NOT NULL,
    -- SHA-256 of the secret part.
    hash      BLOB    NOT NULL CHECK (length(hash) = 32),
    scope     TEXT    NOT NULL CHECK (scope IN ('READ', 'TUNE', 'ADMIN')),
    -- JSON list of study ids and prefixes ("farm-*"); empty means every study.
    studies   TEXT    NOT NULL,
    -- JSON object of limits; what is missing is not limited.
    quota     TEXT    NOT NULL,
    create_ms INTEGER NOT NULL,
    expire_ms INTEGER,
    revoke_ms INTEGER
) STRICT;

-- Additive, so that several daemons can count into one row. One row for each day of use.
CREATE TABLE token_usage (
    token   TEXT    NOT NULL REFERENCES tokens (id) ON DELETE CASCADE,
    -- Days since 1970, UTC.
    day     INTEGER NOT NULL,
    studies INTEGER NOT NULL,
    trials  INTEGER NOT NULL,
    bytes   INTEGER NOT NULL,
    PRIMARY KEY (token, day)
) STRICT;

-- Rises with every change of a token, so that a running daemon can tell cheaply that there was one.
CREATE TABLE token_revision (
    only_row INTEGER PRIMARY KEY CHECK (only_row = 1),
    revision INTEGER NOT NULL
) STRICT;
INSERT INTO token_revision VALUES (1, 0);
CREATE TRIGGER tokens_inserted AFTER INSERT ON tokens BEGIN UPDATE token_revision SET revision = revision + 1; END;
CREATE TRIGGER tokens_updated AFTER UPDATE ON tokens BEGIN UPDATE token_revision SET revision = revision + 1; END;
CREATE TRIGGER tokens_deleted AFTER DELETE ON tokens BEGIN UPDATE token_revision SET revision = revision + 1; END;

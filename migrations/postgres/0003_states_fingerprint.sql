-- The machine that founded a state and alone measures in it. NULL where the client named none, and in rows of
-- earlier versions, in which machines shared their states: what was measured there counts as that of others.
ALTER TABLE states ADD COLUMN fingerprint json;

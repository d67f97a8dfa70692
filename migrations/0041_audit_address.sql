-- The address of the client in the audit trail. It is personal data: it is erased with the account that made the entry.
ALTER TABLE audit ADD COLUMN address TEXT CHECK (length(address) BETWEEN 2 AND 45); -- of the client, without a port; NULL: the service or a command, before this was noted, or erased
CREATE INDEX audit_address ON audit (actor) WHERE address IS NOT NULL;
CREATE TRIGGER person_address_erased AFTER DELETE ON person BEGIN
    UPDATE audit SET address = NULL WHERE actor = 'person:' || OLD.id AND address IS NOT NULL;
END;

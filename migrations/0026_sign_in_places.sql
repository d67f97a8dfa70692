-- From where a browser signed in, so that a person recognises the sign-ins of the own account.
ALTER TABLE cookie_session ADD COLUMN browser TEXT NOT NULL DEFAULT '' CHECK (length(browser) <= 200); -- the browser's name, as it states it; empty: unknown
ALTER TABLE cookie_session ADD COLUMN address TEXT NOT NULL DEFAULT '' CHECK (length(address) <= 64); -- the client's address at the sign-in; empty: unknown

-- The installation that this database belongs to. A restored backup belongs to the same installation as the original.
CREATE TABLE installation (
    number        INTEGER PRIMARY KEY CHECK (number = 1),                    -- there is one row
    id            TEXT NOT NULL CHECK (length(id) = 36),                     -- InstallationId
    backup_folder TEXT CHECK (length(backup_folder) >= 1)                    -- of the scheduled backups, when last seen; NULL: none
) STRICT;
INSERT INTO installation (number, id)
    SELECT 1, substr(ms, 1, 8) || '-' || substr(ms, 9) || '-7' || substr(random, 1, 3) || '-8' || substr(random, 4, 3) || '-'
        || substr(random, 7, 12)
    FROM (SELECT format('%012x', CAST(unixepoch('subsec') * 1000 AS INTEGER)) AS ms, lower(hex(randomblob(9))) AS random);

-- Months for keeping videos that are set after a merge belong to the record that stays. A merge notes which months that record had
-- after it, so that a separation can distinguish them from months that were set since.
ALTER TABLE record_merge ADD COLUMN retention_after TEXT CHECK (json_valid(retention_after)); -- months that the kept record had right after the merge (row of trainee_retention; JSON null: none); NULL: unknown, or of a box

-- Merges in force. The months after a merge are those that a later merge into the same record replaced, else those that the record
-- has now. If they followed the record into another one, that merge and that record are looked at instead, and so on. Months that
-- were set since the merge say nothing about it.
WITH RECURSIVE
    moving (position, kept_id, merged_id, replaced) AS
        (SELECT rowid, kept_trainee_id, merged_trainee_id, kept_retention FROM record_merge
         WHERE separated_at_ms IS NULL AND kept_trainee_id IS NOT NULL
           AND EXISTS (SELECT 1 FROM record_merge_row WHERE merge_id = record_merge.id AND part = 'retention')),
    followed (merge_position, position, holder_id) AS
        (SELECT rowid, rowid, kept_trainee_id FROM record_merge
         WHERE separated_at_ms IS NULL AND kept_trainee_id IS NOT NULL
         UNION ALL
         SELECT followed.merge_position, own.position, own.kept_id FROM followed
         JOIN moving AS own ON own.merged_id = followed.holder_id AND own.position > followed.position
         WHERE NOT EXISTS (SELECT 1 FROM moving AS earlier WHERE earlier.kept_id = followed.holder_id
                           AND earlier.position > followed.position AND earlier.position < own.position)),
    held (merge_position, position, holder_id) AS
        (SELECT merge_position, position, holder_id FROM followed
         WHERE position = (SELECT max(position) FROM followed AS last WHERE last.merge_position = followed.merge_position)),
    found (merge_position, months) AS
        (SELECT merge_position,
                coalesce((SELECT coalesce(replaced, 'null') FROM moving
                          WHERE moving.kept_id = held.holder_id AND moving.position > held.position
                          ORDER BY moving.position LIMIT 1),
                         (SELECT json_object('months', months, 'reason', reason, 'person_id', person_id,
                                             'changed_at_ms', changed_at_ms)
                          FROM trainee_retention WHERE trainee_id = held.holder_id),
                         'null')
         FROM held)
UPDATE record_merge SET retention_after = found.months
FROM found
WHERE record_merge.rowid = found.merge_position
  AND CASE found.months
      WHEN 'null' THEN record_merge.rowid NOT IN (SELECT position FROM moving)
      ELSE found.months ->> 'changed_at_ms' <= record_merge.created_at_ms END;

-- Where the kept record got others since, the months of the merged record are not known any more: those stay with the kept one.
DELETE FROM record_merge_row
WHERE part = 'retention' AND merge_id IN (SELECT id FROM record_merge WHERE retention_after IS NULL);

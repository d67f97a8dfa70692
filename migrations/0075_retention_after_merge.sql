-- Months for keeping videos that are set after a merge belong to the record that stays. A merge notes which months that record had
-- after it, so that a separation can distinguish them from months that were set since.
ALTER TABLE record_merge ADD COLUMN retention_after TEXT CHECK (json_valid(retention_after)); -- months that the kept record had right after the merge (row of trainee_retention; JSON null: none); NULL: unknown, or of a box

-- Merges in force: the months that the kept record has now are those of the merge, unless they were set since.
UPDATE record_merge
SET retention_after =
        (SELECT json_object('months', months, 'reason', reason, 'person_id', person_id, 'changed_at_ms', changed_at_ms)
         FROM trainee_retention
         WHERE trainee_retention.trainee_id = record_merge.kept_trainee_id
           AND trainee_retention.changed_at_ms <= record_merge.created_at_ms)
WHERE separated_at_ms IS NULL AND kept_trainee_id IS NOT NULL;
UPDATE record_merge SET retention_after = 'null'
WHERE separated_at_ms IS NULL AND kept_trainee_id IS NOT NULL AND retention_after IS NULL
  AND NOT EXISTS (SELECT 1 FROM trainee_retention WHERE trainee_retention.trainee_id = record_merge.kept_trainee_id)
  AND NOT EXISTS (SELECT 1 FROM record_merge_row WHERE merge_id = record_merge.id AND part = 'retention');

-- The months of the merged record are not known any more where the kept record got others since: those stay with it.
DELETE FROM record_merge_row
WHERE part = 'retention' AND merge_id IN (SELECT id FROM record_merge WHERE retention_after IS NULL);

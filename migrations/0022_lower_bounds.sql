-- A duration with only a known lower bound is stored with `low` and without `high`. Results from before that rule have
-- neither, and would count as known values without an error bar.
UPDATE feature SET low = value
WHERE value IS NOT NULL AND low IS NULL AND high IS NULL
  AND no_error = 'at least this long: a tool was moving as the recording began or ended';

-- What came of a job, where nothing else keeps it: which tapes suit a box.

ALTER TABLE job ADD COLUMN advice TEXT CHECK (advice IS NULL OR json_valid(advice)); -- PaletteAdvice; NULL: the job is about something else, or not done

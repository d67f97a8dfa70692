-- What a palette's colours are worth, found when they were learned: confusion, verdicts, warnings.

ALTER TABLE palette ADD COLUMN report TEXT CHECK (report IS NULL OR json_valid(report)); -- PaletteReport; NULL: learned before reports

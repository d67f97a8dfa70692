-- How far a feature may be off. Results that were made before this have none of it.
ALTER TABLE feature ADD COLUMN as_measured REAL;                                      -- before the shift that errors cause was taken off
ALTER TABLE feature ADD COLUMN sigma REAL CHECK (sigma >= 0);                         -- standard deviation, in `unit`
ALTER TABLE feature ADD COLUMN low REAL;                                              -- in 95 of 100 sessions the true value lies
ALTER TABLE feature ADD COLUMN high REAL CHECK (high >= low);                         -- between `low` and `high`
ALTER TABLE feature ADD COLUMN no_error TEXT CHECK (length(no_error) BETWEEN 1 AND 200); -- why that is not known of a value

-- The centre's name and logo, which the pages and the printed sheets show. Both are public.
CREATE TABLE centre (
    number    INTEGER PRIMARY KEY CHECK (number = 1),                        -- there is one row
    name      TEXT CHECK (length(name) BETWEEN 1 AND 120),                   -- what people call the centre; NULL: not set
    logo      BLOB CHECK (length(logo) BETWEEN 1 AND 524288),                -- the picture's file as it was sent; NULL: none
    logo_type TEXT CHECK (logo_type IN ('image/png', 'image/jpeg')),         -- its media type
    logo_hash TEXT CHECK (length(logo_hash) = 64),                           -- SHA-256 of the file, hexadecimal
    CHECK ((logo IS NULL) = (logo_type IS NULL) AND (logo IS NULL) = (logo_hash IS NULL))
) STRICT;
INSERT INTO centre (number) VALUES (1);

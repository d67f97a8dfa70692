-- A version of a standard judges the recordings that arrive from a day on, and a limit may be for a hand instead of a tape.

ALTER TABLE standard ADD COLUMN valid_from_ms INTEGER NOT NULL DEFAULT 0 CHECK (valid_from_ms >= 0); -- judges recordings that arrived from then on, epoch ms; 0: all
-- The first version judged every session so far. The later ones replaced it on the day when they were set.
UPDATE standard SET valid_from_ms = created_at_ms WHERE version > 1;

DROP VIEW standard_record;
CREATE VIEW standard_record AS
    SELECT standard.id, standard.task_id, standard.version, standard.definition, person.name AS who, standard.created_at_ms,
           standard.valid_from_ms
    FROM standard LEFT JOIN person ON person.id = standard.person_id;

ALTER TABLE result ADD COLUMN left_tool TEXT CHECK (length(left_tool) BETWEEN 1 AND 64);   -- the tool in the left hand; NULL: not known
ALTER TABLE result ADD COLUMN right_tool TEXT CHECK (length(right_tool) BETWEEN 1 AND 64); -- the tool in the right hand; NULL: not known

-- The tools in the left and the right hand, as the camera shows them. Of two tools, the one whose trocar is farther left is in the
-- left hand, if the trocars lie more beside than above each other and apart by more than three standard deviations. Where the trocars
-- do not say it, the sides count that were stated when the tools were set up.
CREATE VIEW tool_hand AS
    SELECT placed.id AS result_id,
           CASE WHEN placed.by_trocars IS NOT NULL THEN placed.by_trocars ->> '$[0]' ELSE placed.stated_left END AS left_tool,
           CASE WHEN placed.by_trocars IS NOT NULL THEN placed.by_trocars ->> '$[1]' ELSE placed.stated_right END AS right_tool
    FROM
        (SELECT result.id,
                (SELECT json_array(one.value ->> '$.tool', other.value ->> '$.tool')
                 FROM json_each(result.quality, '$.tools') AS one, json_each(result.quality, '$.tools') AS other
                 WHERE json_array_length(result.tools) = 2
                   AND (other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]')
                       > abs((other.value ->> '$.fulcrum.at_mm[1]') - (one.value ->> '$.fulcrum.at_mm[1]'))
                   AND ((other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]'))
                       * ((other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]'))
                       > 9 * ((one.value ->> '$.fulcrum.covariance_mm2[0]') + (other.value ->> '$.fulcrum.covariance_mm2[0]'))
                ) AS by_trocars,
                (SELECT iif(count(*) = 1, min(tool.value ->> '$.name'), NULL) FROM palette, json_each(palette.tools) AS tool
                 WHERE palette.id = result.palette_id AND tool.value ->> '$.side' = 'left'
                   AND tool.value ->> '$.name' IN (SELECT value FROM json_each(result.tools))) AS stated_left,
                (SELECT iif(count(*) = 1, min(tool.value ->> '$.name'), NULL) FROM palette, json_each(palette.tools) AS tool
                 WHERE palette.id = result.palette_id AND tool.value ->> '$.side' = 'right'
                   AND tool.value ->> '$.name' IN (SELECT value FROM json_each(result.tools))) AS stated_right
         FROM result) AS placed;

UPDATE result SET (left_tool, right_tool) = (SELECT left_tool, right_tool FROM tool_hand WHERE tool_hand.result_id = result.id);

CREATE TRIGGER result_has_hands AFTER INSERT ON result BEGIN
    UPDATE result SET (left_tool, right_tool) = (SELECT left_tool, right_tool FROM tool_hand WHERE tool_hand.result_id = NEW.id)
    WHERE id = NEW.id;
END;

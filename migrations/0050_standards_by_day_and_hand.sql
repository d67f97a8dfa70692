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
ALTER TABLE result ADD COLUMN trocar_middle_mm REAL; -- the middle between both trocars, to the right of the camera's axis; NULL: not known
CREATE INDEX result_trocar_middle ON result (calibration_id) WHERE trocar_middle_mm IS NOT NULL;

-- The tools in the left and the right hand, as the camera shows them. Of two tools, the one whose trocar is farther left is in the
-- left hand, if the trocars lie more beside than above each other and apart by more than three standard deviations. If only one trocar
-- is known, it is compared with the middle between both trocars in another session with this camera that counts; 64 mm² is the largest
-- variance of a trocar that is stated. Where the trocars do not say it, the sides count that were stated when the tools were set up.
CREATE VIEW tool_hand AS
    SELECT placed.id AS result_id,
           CASE WHEN placed.by_both IS NOT NULL THEN placed.by_both ->> '$[0]'
                WHEN placed.offset_mm * placed.offset_mm > 9 * (placed.variance_mm2 + 64)
                THEN iif(placed.offset_mm < 0, placed.known_tool, placed.other_tool)
                ELSE placed.stated_left END AS left_tool,
           CASE WHEN placed.by_both IS NOT NULL THEN placed.by_both ->> '$[1]'
                WHEN placed.offset_mm * placed.offset_mm > 9 * (placed.variance_mm2 + 64)
                THEN iif(placed.offset_mm < 0, placed.other_tool, placed.known_tool)
                ELSE placed.stated_right END AS right_tool,
           placed.by_both ->> '$[2]' AS trocar_middle_mm
    FROM
        (SELECT result.id,
                (SELECT json_array(one.value ->> '$.tool', other.value ->> '$.tool',
                                   ((one.value ->> '$.fulcrum.at_mm[0]') + (other.value ->> '$.fulcrum.at_mm[0]')) / 2)
                 FROM json_each(result.quality, '$.tools') AS one, json_each(result.quality, '$.tools') AS other
                 WHERE json_array_length(result.tools) = 2
                   AND (other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]')
                       > abs((other.value ->> '$.fulcrum.at_mm[1]') - (one.value ->> '$.fulcrum.at_mm[1]'))
                   AND ((other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]'))
                       * ((other.value ->> '$.fulcrum.at_mm[0]') - (one.value ->> '$.fulcrum.at_mm[0]'))
                       > 9 * ((one.value ->> '$.fulcrum.covariance_mm2[0]') + (other.value ->> '$.fulcrum.covariance_mm2[0]'))
                ) AS by_both,
                alone.trocar ->> '$[0]' AS known_tool, alone.trocar ->> '$[2]' AS variance_mm2,
                (SELECT value FROM json_each(result.tools) WHERE value <> alone.trocar ->> '$[0]') AS other_tool,
                (alone.trocar ->> '$[1]')
                - (SELECT seen.trocar_middle_mm FROM result AS seen
                   WHERE seen.calibration_id = result.calibration_id AND seen.trocar_middle_mm IS NOT NULL
                     AND seen.quality ->> '$.verdict' IS NOT 'refused'
                     AND NOT EXISTS (SELECT 1 FROM uncounted_session WHERE uncounted_session.session_id = seen.session_id)
                   ORDER BY seen.rowid DESC LIMIT 1) AS offset_mm,
                (SELECT iif(count(*) = 1, min(tool.value ->> '$.name'), NULL) FROM palette, json_each(palette.tools) AS tool
                 WHERE palette.id = result.palette_id AND tool.value ->> '$.side' = 'left'
                   AND tool.value ->> '$.name' IN (SELECT value FROM json_each(result.tools))) AS stated_left,
                (SELECT iif(count(*) = 1, min(tool.value ->> '$.name'), NULL) FROM palette, json_each(palette.tools) AS tool
                 WHERE palette.id = result.palette_id AND tool.value ->> '$.side' = 'right'
                   AND tool.value ->> '$.name' IN (SELECT value FROM json_each(result.tools))) AS stated_right
         FROM
             (SELECT result.id AS result_id,
                     (SELECT iif(count(*) = 1, json_array(min(tool.value ->> '$.tool'), min(tool.value ->> '$.fulcrum.at_mm[0]'),
                                                          min(tool.value ->> '$.fulcrum.covariance_mm2[0]')), NULL)
                      FROM json_each(result.quality, '$.tools') AS tool
                      WHERE json_array_length(result.tools) = 2 AND tool.value ->> '$.fulcrum.at_mm[0]' IS NOT NULL) AS trocar
              FROM result) AS alone
         JOIN result ON result.id = alone.result_id) AS placed;

UPDATE result SET (left_tool, right_tool, trocar_middle_mm) =
    (SELECT left_tool, right_tool, trocar_middle_mm FROM tool_hand WHERE tool_hand.result_id = result.id);
-- Once more, since a trocar that is known alone is compared with other sessions.
UPDATE result SET (left_tool, right_tool) = (SELECT left_tool, right_tool FROM tool_hand WHERE tool_hand.result_id = result.id)
WHERE left_tool IS NULL OR right_tool IS NULL;

CREATE TRIGGER result_has_hands AFTER INSERT ON result BEGIN
    UPDATE result SET (left_tool, right_tool, trocar_middle_mm) =
        (SELECT left_tool, right_tool, trocar_middle_mm FROM tool_hand WHERE tool_hand.result_id = NEW.id)
    WHERE id = NEW.id;
END;

-- Recordings are tracked with the camera and colours of their day: of the versions of the box that were valid by then, the one
-- that became valid last; for a recording that is older than all of them, the one that became valid first.
ALTER TABLE calibration ADD COLUMN valid_from_ms INTEGER CHECK (valid_from_ms >= 0); -- recordings from then on are tracked with it, epoch ms; NULL: from `created_at_ms` on
ALTER TABLE palette ADD COLUMN valid_from_ms INTEGER CHECK (valid_from_ms >= 0); -- recordings from then on are tracked with it, epoch ms; NULL: from `created_at_ms` on

-- The versions that each session is tracked with: of its box, and valid when it was recorded. NULL: the box has none.
CREATE VIEW valid_setup AS
    SELECT session.id AS session_id,
           coalesce((SELECT calibration.id FROM calibration
                     WHERE calibration.box_id = session.box_id
                       AND coalesce(calibration.valid_from_ms, calibration.created_at_ms) <= session.recorded_at_ms
                     ORDER BY coalesce(calibration.valid_from_ms, calibration.created_at_ms) DESC, calibration.version DESC LIMIT 1),
                    (SELECT calibration.id FROM calibration WHERE calibration.box_id = session.box_id
                     ORDER BY coalesce(calibration.valid_from_ms, calibration.created_at_ms), calibration.version DESC LIMIT 1))
               AS calibration_id,
           coalesce((SELECT palette.id FROM palette
                     WHERE palette.box_id = session.box_id
                       AND coalesce(palette.valid_from_ms, palette.created_at_ms) <= session.recorded_at_ms
                     ORDER BY coalesce(palette.valid_from_ms, palette.created_at_ms) DESC, palette.version DESC LIMIT 1),
                    (SELECT palette.id FROM palette WHERE palette.box_id = session.box_id
                     ORDER BY coalesce(palette.valid_from_ms, palette.created_at_ms), palette.version DESC LIMIT 1))
               AS palette_id
    FROM session;

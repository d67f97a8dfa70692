-- Recordings are tracked with the camera and colours of their day: of the versions of the box that were valid by then, the one
-- that became valid last; for a recording that is older than all of them, the one that became valid first.
ALTER TABLE calibration ADD COLUMN valid_from_ms INTEGER CHECK (valid_from_ms >= 0); -- recordings from then on are tracked with it, epoch ms; NULL: from `created_at_ms` on
ALTER TABLE palette ADD COLUMN valid_from_ms INTEGER CHECK (valid_from_ms >= 0); -- recordings from then on are tracked with it, epoch ms; NULL: from `created_at_ms` on

-- When each session was made, for the choice of the versions. A recording that is sent frame by frame while it is made was made when
-- the service first heard of it, unless its sender states a time more than ten minutes away: the sender's clock may be wrong by
-- minutes, and the box may have been calibrated just before.
CREATE VIEW session_time AS
    SELECT session.id AS session_id, session.box_id,
           coalesce((SELECT feed.created_at_ms FROM feed
                     WHERE feed.session_id = session.id AND abs(feed.created_at_ms - session.recorded_at_ms) <= 600000),
                    session.recorded_at_ms) AS made_at_ms
    FROM session;

-- The versions that each session is tracked with: of its box, and valid when it was made. NULL: the box has none.
CREATE VIEW valid_setup AS
    SELECT made.session_id, made.made_at_ms,
           coalesce((SELECT calibration.id FROM calibration
                     WHERE calibration.box_id = made.box_id
                       AND coalesce(calibration.valid_from_ms, calibration.created_at_ms) <= made.made_at_ms
                     ORDER BY coalesce(calibration.valid_from_ms, calibration.created_at_ms) DESC, calibration.version DESC LIMIT 1),
                    (SELECT calibration.id FROM calibration WHERE calibration.box_id = made.box_id
                     ORDER BY coalesce(calibration.valid_from_ms, calibration.created_at_ms), calibration.version DESC LIMIT 1))
               AS calibration_id,
           coalesce((SELECT palette.id FROM palette
                     WHERE palette.box_id = made.box_id
                       AND coalesce(palette.valid_from_ms, palette.created_at_ms) <= made.made_at_ms
                     ORDER BY coalesce(palette.valid_from_ms, palette.created_at_ms) DESC, palette.version DESC LIMIT 1),
                    (SELECT palette.id FROM palette WHERE palette.box_id = made.box_id
                     ORDER BY coalesce(palette.valid_from_ms, palette.created_at_ms), palette.version DESC LIMIT 1))
               AS palette_id
    FROM session_time AS made;

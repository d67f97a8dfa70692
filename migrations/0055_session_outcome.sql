-- The outcome of each session in the words of lists, and the verdict of the quality gate. A session is judged by the standard of its
-- day, as `SessionResponse::judged_by` does; a test compares both. A limit for a hand is one for the tool that was in it. `met` is 1 or 0 for a target that was met or missed, else NULL.
CREATE VIEW session_outcome (session_id, verdict, outcome) AS
    SELECT session.id, result.verdict,
           CASE
               WHEN session.video IS NULL THEN 'receiving'
               WHEN job.state IN ('quarantined', 'failed') THEN job.state
               WHEN job.state = 'running' THEN 'tracking'
               WHEN job.state IS NULL
                    AND EXISTS (SELECT 1 FROM blob WHERE hash = session.video AND dropped_at_ms IS NOT NULL) THEN 'failed'
               WHEN job.state IS NOT 'done' THEN 'queued'
               WHEN session.box_question = 'asked' THEN 'box_asked'
               WHEN session.box_question = 'other_box' THEN 'other_box'
               WHEN result.verdict = 'refused' THEN 'refused'
               WHEN EXISTS (SELECT 1 FROM set_aside_session WHERE set_aside_session.session_id = session.id) THEN 'done'
               ELSE coalesce(
                   (SELECT (SELECT CASE WHEN min(met) = 0 THEN 'missed'
                                        WHEN count(*) > 0 AND count(met) = count(*) THEN 'passed'
                                        ELSE 'undecided' END
                            FROM (SELECT CASE
                                             WHEN target.value ->> '$.made_from.pipeline' <> result.pipeline THEN NULL
                                             WHEN target.value ->> '$.made_from.handedness' IS NOT NULL
                                                  AND target.value ->> '$.made_from.handedness' IS NOT trainee.handedness THEN NULL
                                             WHEN low IS NOT NULL AND high IS NULL THEN
                                                 CASE target.value ->> 'better'
                                                     WHEN 'higher' THEN iif(feature.value >= target.value ->> 'limit', 1, NULL)
                                                     ELSE iif(feature.value > target.value ->> 'limit', 0, NULL) END
                                             WHEN feature.value BETWEEN low AND high THEN
                                                 CASE target.value ->> 'better'
                                                     WHEN 'higher' THEN iif(low >= target.value ->> 'limit', 1,
                                                                            iif(high < target.value ->> 'limit', 0, NULL))
                                                     ELSE iif(high <= target.value ->> 'limit', 1,
                                                              iif(low > target.value ->> 'limit', 0, NULL)) END
                                         END AS met
                                  FROM json_each(standard.definition, '$.targets') AS target
                                  LEFT JOIN feature ON feature.result_id = result.id
                                       AND feature.name = target.value ->> 'feature'
                                       AND CASE target.value ->> 'in_hand' || coalesce(trainee.handedness, '')
                                               WHEN 'dominantleft' THEN feature.tool = result.left_tool
                                               WHEN 'otherright' THEN feature.tool = result.left_tool
                                               WHEN 'dominantright' THEN feature.tool = result.right_tool
                                               WHEN 'otherleft' THEN feature.tool = result.right_tool
                                               ELSE CASE target.value ->> 'in_hand'
                                                   WHEN 'left' THEN feature.tool = result.left_tool
                                                   WHEN 'right' THEN feature.tool = result.right_tool
                                                   ELSE target.value ->> 'in_hand' IS NULL AND feature.tool IS target.value ->> 'tool' END
                                           END
                                       AND feature.space = target.value ->> 'space'))
                    FROM standard
                    WHERE standard.task_id = session.task_id AND standard.valid_from_ms <= session.created_at_ms
                          AND result.id IS NOT NULL
                    ORDER BY standard.version DESC LIMIT 1), 'done')
           END
    FROM session
    JOIN trainee ON trainee.id = session.trainee_id
    LEFT JOIN tracking_job AS job ON job.session_id = session.id
    LEFT JOIN current_result AS result ON result.session_id = session.id;

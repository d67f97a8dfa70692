-- A box's finished job keeps no pictures: they may show a person, and what was learned from them is numbers. Colours that were marked
-- before the surroundings of a box were kept still need their pictures, once.
DELETE FROM job_file WHERE job_id IN
    (SELECT id FROM job
     WHERE box_id IS NOT NULL AND state = 'done'
       AND (kind <> 'palette'
            OR NOT EXISTS (SELECT 1 FROM palette WHERE palette.box_id = job.box_id AND NOT EXISTS
                           (SELECT 1 FROM palette_surroundings WHERE palette_surroundings.palette_id = palette.id))));

//! The schema: it is commented and strict, and refuses invalid rows from any writer.

use std::sync::Arc;

use sqlx::sqlite::SqliteConnection;
use sqlx::{AssertSqlSafe, Connection};

use crate::domain::job::JobKind;
use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::secret::Secret;
use crate::store::testing::{NOW_MS, TestCentre};
use crate::store::{ActsAs, NewToken, Store, StoreError, StoreSettings};
use crate::time::ManualClock;

const FILES: [&str; 17] = [
    include_str!("../../../migrations/0001_people.sql"),
    include_str!("../../../migrations/0002_boxes.sql"),
    include_str!("../../../migrations/0003_work.sql"),
    include_str!("../../../migrations/0007_self_tests.sql"),
    include_str!("../../../migrations/0011_standards.sql"),
    include_str!("../../../migrations/0012_skill_models.sql"),
    include_str!("../../../migrations/0013_evidence_ratings.sql"),
    include_str!("../../../migrations/0014_rescoring.sql"),
    include_str!("../../../migrations/0015_session_edits.sql"),
    include_str!("../../../migrations/0016_lately.sql"),
    include_str!("../../../migrations/0017_courses.sql"),
    include_str!("../../../migrations/0018_job_kinds.sql"),
    include_str!("../../../migrations/0021_box_question.sql"),
    include_str!("../../../migrations/0034_password_links.sql"),
    include_str!("../../../migrations/0035_owners.sql"),
    include_str!("../../../migrations/0039_installation.sql"),
    include_str!("../../../migrations/0049_error_sheets.sql"),
];

/// A connection that bypasses the store's functions.
async fn raw(centre: &TestCentre) -> SqliteConnection {
    let path = centre.folder.path().join("trocar.sqlite");
    SqliteConnection::connect(path.to_str().unwrap()).await.unwrap()
}

#[test]
fn every_table_is_strict_and_every_table_and_column_is_commented() {
    let mut tables = 0;
    for file in FILES {
        let mut above = "";
        let mut inside = false;
        for line in file.lines() {
            let text = line.trim();
            if text.starts_with("CREATE TABLE") && !text.contains(" AS SELECT ") {
                assert!(above.starts_with("--"), "no comment above `{text}`");
                (inside, tables) = (true, tables + 1);
            } else if text.starts_with(')') {
                assert!(!inside || text.contains("STRICT"), "not strict before `{text}`");
                inside = false;
            } else if inside && !["UNIQUE", "CHECK", "PRIMARY KEY"].iter().any(|word| text.starts_with(word)) {
                assert!(text.contains("-- "), "no comment on `{text}`");
            }
            above = text;
        }
    }
    assert!(tables >= 20, "{tables} tables");
}

#[tokio::test]
async fn invalid_rows_are_refused_from_any_writer() {
    let centre = TestCentre::with_camera_and_colours().await;
    let session = centre.session(centre.trainee("Ana").await.id, "video").await;
    let lease = centre.claim().await.unwrap();
    centre.store.jobs().finish_track(&lease, centre.result(session.id).await).await.unwrap();
    let mut raw = raw(&centre).await;
    for sense in [
        "INSERT INTO course VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45', 'Basic skills', 1)",
        "INSERT INTO training_group (id, name, created_at_ms) VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a46', 'G', 1)",
    ] {
        sqlx::query(AssertSqlSafe(sense)).execute(&mut raw).await.unwrap();
    }
    for nonsense in [
        "INSERT INTO ownership (group_id) SELECT id FROM training_group",
        "INSERT INTO ownership (group_id, box_id, task_id)
         SELECT training_group.id, training_box.id, task.id FROM training_group, training_box, task",
        "UPDATE job SET state = 'sleeping'",
        "UPDATE job SET state = 'running' WHERE kind = 'track'",
        "UPDATE job SET lease_token = '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44' WHERE kind = 'track'",
        "UPDATE job SET state = 'failed', problem = NULL WHERE kind = 'track'",
        "UPDATE job SET ended_at_ms = NULL WHERE kind = 'track'",
        "UPDATE job SET progress = 1.01",
        "UPDATE job SET attempt = max_attempts + 1",
        "UPDATE job SET input = 'not json'",
        "UPDATE job SET box_id = (SELECT id FROM training_box) WHERE kind = 'track'",
        "UPDATE result SET frames = 0",
        "UPDATE result SET duration_s = -1",
        "UPDATE result SET trajectory = 'missing'",
        "UPDATE feature SET value = NULL WHERE not_enough IS NULL",
        "UPDATE feature SET value = 0 WHERE not_enough IS NOT NULL",
        "UPDATE feature SET space = '4d'",
        "UPDATE trainee SET name = ''",
        "UPDATE audit SET address = ''",
        "UPDATE trainee SET level = 'wizard'",
        "UPDATE session SET created_at_ms = 'yesterday'",
        "INSERT INTO installation VALUES (2, '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', NULL)",
        "UPDATE installation SET backup_folder = ''",
        "DELETE FROM blob",
        "DELETE FROM calibration",
        "INSERT INTO upload SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', NULL, trainee_id, task_id, box_id, 'f',
         '', NULL, 10, 11, NULL, 1, 2, NULL, NULL, 0 FROM session",
        "UPDATE job SET turn = 0 WHERE kind = 'track'",
        "UPDATE job SET kind = 'rescore' WHERE kind = 'palette'",
        "UPDATE job SET kind = 'unknown'",
        "DELETE FROM job_kind",
        "UPDATE session SET tracker = ''",
        "INSERT INTO session (id, trainee_id, task_id, box_id, filename, media_type, video, recorded_at_ms,
         created_at_ms)
         SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', trainee_id, task_id, box_id, filename, media_type,
         video, recorded_at_ms, created_at_ms FROM session",
        "INSERT INTO result (id, session_id, pipeline, calibration_id, palette_id, model, width, height, frames,
         duration_s, tools, quality, score, trajectory, diagnostics, preview, created_at_ms)
         SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', session_id, pipeline, calibration_id, palette_id,
         model, width, height, frames, duration_s, tools, quality, score, trajectory, diagnostics, preview,
         created_at_ms FROM result",
        "UPDATE result SET width = 0",
        "INSERT INTO rescoring VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', (SELECT id FROM task), 'memory', 1, '8',
         NULL, NULL, 1, NULL, NULL)",
        "INSERT INTO standard SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 0, '{}', NULL, 1, 0 FROM task",
        "INSERT INTO standard SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 1, 'no json', NULL, 1, 0 FROM task",
        "INSERT INTO standard SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 1, '{}', NULL, 1, -1 FROM task",
        "UPDATE evidence SET rows = 'no json'",
        "INSERT INTO rating SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, NULL, 'charm', 1, '[]', NULL, 1, 1 \
         FROM session",
        "INSERT INTO rating SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, NULL, 'goals', 1, '[]', NULL, 2, 1 \
         FROM session",
        "INSERT INTO rating SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, NULL, 'goals', 1, '[]', '', 1, 1 \
         FROM session",
        "UPDATE task SET rating_forms = 'no json'",
        "INSERT INTO comment SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, NULL, 5, 4, 'x', 1 FROM session",
        "INSERT INTO comment SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, NULL, -1, 4, 'x', 1 FROM session",
        "INSERT INTO comment SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, NULL, 1, 4, '', 1 FROM session",
        "INSERT INTO error_list SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 1, 'no json', NULL, 1 FROM task",
        "INSERT INTO score_formula SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 1, '{}', 'soon', NULL, 1
         FROM task",
        "INSERT INTO error_sheet (id, session_id, list_id, is_blind, created_at_ms)
         SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', session.id, session.task_id, 1, 1 FROM session",
        "INSERT INTO error_mark SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 'drops', -1, NULL, 1 FROM session",
        "INSERT INTO skill_model SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 1, '8', printf('%064d', 0), NULL,
         '{}', NULL, 1, NULL FROM task",
        "INSERT INTO skill_model SELECT '0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', id, 1, '8', 'short', '{}', '{}', NULL,
         1, NULL FROM task",
        "INSERT INTO course VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', '', 1)",
        "INSERT INTO course_step SELECT 'nowhere', 0, id, NULL, NULL FROM task",
        "INSERT INTO course_step SELECT course.id, 0, task.id, -1, NULL FROM course, task",
        "INSERT INTO course_step SELECT course.id, 0, task.id, NULL, 0 FROM course, task",
        "INSERT INTO group_course SELECT training_group.id, course.id, 'tomorrow' FROM course, training_group",
        "INSERT INTO cohort VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', 'c', 'C', 1, 'expert', NULL, NULL, 1)",
        "INSERT INTO cohort VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', 'c', 'C', 0, NULL, NULL, 'nowhere', 1)",
        "INSERT INTO person \
         VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', 'eve', 'Eve', 'instructor', '$argon2id$x', NULL, 1, 'known')",
        "INSERT INTO person \
         VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', 'eve', 'Eve', 'administrator', 'plain text', NULL, 1, 'own')",
        "INSERT INTO person \
         VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', 'eve', 'Eve', 'trainee', '$argon2id$x', NULL, 1, 'own')",
        "INSERT INTO person \
         VALUES ('0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44', 'eve', 'Eve', 'agent', '$argon2id$x', NULL, 1, 'own')",
    ] {
        let written = sqlx::query(AssertSqlSafe(nonsense)).execute(&mut raw).await;
        let error = written.expect_err(nonsense).to_string();
        let expected = ["constraint failed", "cannot store TEXT"];
        assert!(expected.iter().any(|words| error.contains(words)), "{nonsense}: {error}");
    }
}

#[tokio::test]
async fn the_database_has_each_job_kind_and_no_other() {
    let centre = TestCentre::with_camera_and_colours().await;
    let sql = "SELECT name FROM job_kind ORDER BY name";
    let stored: Vec<String> = sqlx::query_scalar(sql).fetch_all(&mut raw(&centre).await).await.unwrap();
    let mut known: Vec<&str> = JobKind::ALL.iter().map(|kind| kind.name()).collect();
    known.sort_unstable();
    assert_eq!(stored, known);
}

/// The statements of the migration that change rows run again.
#[tokio::test]
async fn imported_sessions_get_the_hash_of_their_path_and_tokens_that_exceed_a_role_are_deleted() {
    let centre = TestCentre::with_camera_and_colours().await;
    let ana = centre.trainee("Ana").await.id;
    for content in ["imported", "recorded"] {
        let session = centre.session(ana, content).await;
        let lease = centre.claim().await.unwrap();
        centre.store.jobs().finish_track(&lease, centre.result(session.id).await).await.unwrap();
    }
    let ina = centre.person("ina", Role::Instructor, None).await;
    for name in ["fits", "exceeds"] {
        let acts_as = ActsAs::Person(ina.id, Role::Instructor);
        let secret = Secret::random().hash();
        let new = NewToken { name: name.parse().unwrap(), acts_as, expires_at_ms: None, secret };
        centre.store.tokens().create(&Scope::service(), new).await.unwrap();
    }
    let migration = include_str!("../../../migrations/0040_made_with.sql");
    let part = |from: &str| migration[migration.find(from).unwrap()..].split_inclusive(";\n").next().unwrap();
    let mut raw = raw(&centre).await;
    for sql in [
        "UPDATE session SET tracker = 'optical' WHERE id = (SELECT min(id) FROM session)",
        "UPDATE token SET role = 'administrator' WHERE name = 'exceeds'",
        part("DELETE FROM token"),
        part("UPDATE session"),
    ] {
        sqlx::query(AssertSqlSafe(sql)).execute(&mut raw).await.unwrap();
    }
    let sql = "SELECT path_hash = trajectory FROM session JOIN result ON session_id = session.id ORDER BY session.id";
    let is_hash: Vec<Option<bool>> = sqlx::query_scalar(sql).fetch_all(&mut raw).await.unwrap();
    assert_eq!(is_hash, [Some(true), None]);
    let left: Vec<String> = sqlx::query_scalar("SELECT name FROM token").fetch_all(&mut raw).await.unwrap();
    assert_eq!(left, ["fits"]);
}

#[tokio::test]
async fn a_kind_of_job_that_the_database_lacks_is_added_when_it_is_opened() {
    let centre = TestCentre::new().await;
    let (raw, path) = (&mut raw(&centre).await, centre.folder.path().join("trocar.sqlite"));
    sqlx::query("DELETE FROM job_kind WHERE name = 'advise'").execute(&mut *raw).await.unwrap();
    let _opened = Store::open(&path, &StoreSettings::default(), centre.clock.clone()).await.unwrap();
    let subject = "SELECT subject FROM job_kind WHERE name = 'advise'";
    assert_eq!(sqlx::query_scalar::<_, String>(subject).fetch_one(raw).await.unwrap(), "box");
}

#[tokio::test]
async fn a_database_with_a_kind_of_job_of_a_newer_program_is_refused() {
    let centre = TestCentre::new().await;
    let newer = "INSERT INTO job_kind (name, subject) VALUES ('foresee', 'box')";
    sqlx::query(newer).execute(&mut raw(&centre).await).await.unwrap();
    let path = centre.folder.path().join("trocar.sqlite");
    let opened = Store::open(&path, &StoreSettings::default(), centre.clock.clone()).await;
    assert!(matches!(opened, Err(StoreError::Unusable(why)) if why.contains("`foresee`") && why.contains("newer")));
}

#[tokio::test]
async fn a_database_of_a_newer_program_is_refused() {
    let centre = TestCentre::new().await;
    let newer = "INSERT INTO _sqlx_migrations VALUES (9999, 'later', '2027-01-01', TRUE, x'00', 1)";
    sqlx::query(newer).execute(&mut raw(&centre).await).await.unwrap();
    let path = centre.folder.path().join("trocar.sqlite");
    let opened = Store::open(&path, &StoreSettings::default(), centre.clock.clone()).await;
    assert!(matches!(opened, Err(StoreError::Unusable(why)) if why.contains("newer")));
}

#[tokio::test]
async fn a_database_without_a_write_ahead_log_is_refused() {
    let clock = ManualClock::at(NOW_MS);
    let opened = Store::open(":memory:".as_ref(), &StoreSettings::default(), Arc::clone(&clock) as _).await;
    assert!(matches!(opened, Err(StoreError::Unusable(why)) if why.contains("journal_mode")));
}

#[tokio::test]
async fn a_sound_database_has_no_findings_and_a_dangling_row_is_one() {
    let centre = TestCentre::with_camera_and_colours().await;
    centre.session(centre.trainee("Ana").await.id, "video").await;
    assert_eq!(centre.store.check().await.unwrap(), Vec::<String>::new());
    let mut raw = raw(&centre).await;
    sqlx::query("PRAGMA foreign_keys = OFF").execute(&mut raw).await.unwrap();
    sqlx::query("DELETE FROM task").execute(&mut raw).await.unwrap();
    assert_eq!(centre.store.check().await.unwrap(), ["a row of `session` refers to one that is not there"]);
}

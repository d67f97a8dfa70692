//! Versions of standards, and the queries behind a trainee's progress.

use sqlx::{AssertSqlSafe, Row};

use crate::domain::role::Role;
use crate::domain::scope::Scope;
use crate::domain::standard::{ChartDesign, StandardDefinition, StandardRule};
use crate::domain::text::Key;
use crate::store::StoreError;
use crate::store::cohorts::SELECT_VALUES;
use crate::store::sessions::practice::{SELECT_MEASURED, SELECT_PRACTICE, SELECT_PRACTICE_OF_MANY};
use crate::store::standards::SELECT_STANDARDS;
use crate::store::testing::TestCentre;

fn definition(in_a_row: usize) -> StandardDefinition {
    let rule = Some(StandardRule { in_a_row, then_more: 0, at_most: None });
    StandardDefinition { targets: Vec::new(), rule, charts: ChartDesign::default() }
}

#[tokio::test]
async fn a_standard_is_a_new_version_unless_it_says_the_same() {
    let centre = TestCentre::new().await;
    let (store, task) = (&centre.store, centre.task.id);
    let teacher = centre.person("ina", Role::Instructor, None).await;
    centre.group("Mondays", &[&teacher], &[]).await;
    centre.person("ada", Role::Administrator, None).await; // one administrator must stay
    assert_eq!(store.standards().in_use(&teacher.scope(), task).await.unwrap(), None);
    let first = store.standards().add(&teacher.scope(), task, definition(2), None).await.unwrap();
    assert_eq!((first.version, first.who.as_deref(), &first.definition), (1, Some("ina"), &definition(2)));
    assert_eq!(store.standards().add(&teacher.scope(), task, definition(2), None).await.unwrap(), first);
    let second = store.standards().add(&Scope::service(), task, definition(3), None).await.unwrap();
    assert_eq!((second.version, second.who.as_deref()), (2, None));
    assert_eq!(store.standards().list(&teacher.scope(), task).await.unwrap(), [second.clone(), first]);
    store.people().delete(&Scope::service(), teacher.id).await.unwrap();
    let left = store.standards().list(&Scope::service(), task).await.unwrap();
    assert_eq!((left[0].clone(), left[1].who.as_deref()), (second, None), "a standard outlives its author's account");
    store.tasks().delete(&Scope::service(), &Key::from(&task)).await.unwrap();
    assert!(store.standards().list(&Scope::service(), task).await.unwrap().is_empty());
}

#[tokio::test]
async fn trainees_read_standards_and_agents_do_not() {
    let centre = TestCentre::new().await;
    let (store, task) = (&centre.store, centre.task.id);
    store.standards().add(&Scope::service(), task, definition(2), None).await.unwrap();
    let ana = centre.person("ana", Role::Trainee, Some(centre.trainee("Ana").await.id)).await;
    assert!(store.standards().in_use(&ana.scope(), task).await.unwrap().is_some());
    let set = store.standards().add(&ana.scope(), task, definition(3), None).await;
    assert!(matches!(set, Err(StoreError::Forbidden { .. })), "{set:?}");
    assert!(store.standards().in_use(&Scope::agent(centre.the_box.id), task).await.unwrap().is_none());
}

/// Every table that progress reads is accessed by an index, from one person or one result.
#[tokio::test]
async fn progress_reads_no_table_from_end_to_end() {
    let centre = TestCentre::new().await;
    for (sql, wanted) in [
        (SELECT_PRACTICE, "SEARCH session USING INDEX session_practised (trainee_id=? AND task_id=?)"),
        (SELECT_MEASURED, "SEARCH feature USING COVERING INDEX feature_named (name=? AND result_id=?)"),
        (SELECT_STANDARDS, "SEARCH standard USING INDEX sqlite_autoindex_standard_2 (task_id=?)"),
        (SELECT_VALUES, "SEARCH recent USING COVERING INDEX session_practised (trainee_id=? AND task_id=?)"),
        (SELECT_PRACTICE_OF_MANY, "SEARCH recent USING COVERING INDEX session_practised (trainee_id=? AND task_id=?)"),
    ] {
        let rows = sqlx::query(AssertSqlSafe(format!("EXPLAIN QUERY PLAN {sql}")))
            .fetch_all(centre.store.readers())
            .await
            .unwrap();
        let plan: Vec<String> = rows.iter().map(|row| row.get("detail")).collect();
        // `make progress-load` shows this.
        println!("\n{}\n  {}", sql, plan.join("\n  "));
        assert!(plan.iter().any(|line| line == wanted), "{plan:#?}");
        let whole = ["SCAN session", "SCAN result", "SCAN feature", "SCAN job", "SCAN standard"];
        assert!(!plan.iter().any(|line| whole.iter().any(|scan| line.starts_with(scan))), "{plan:#?}");
        let edits = |line: &&String| line.contains("session_edit");
        assert!(
            plan.iter().filter(edits).all(|line| line.contains("INDEX session_set_aside (session_id=?)")),
            "{plan:#?}"
        );
    }
}

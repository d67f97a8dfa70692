//! Merges know every table that refers to trainees and boxes, and what belongs to accounts.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::domain::scope::Scope;
use crate::ids::{MergeId, TraineeId};
use crate::store::record_merges::take_statements;
use crate::store::testing::{TestCentre, open};

/// Columns whose rows stay where they are, with the reason.
const STAY: [(&str, &str, &str); 21] = [
    ("session_move", "from_trainee_id", "history; shown with the kept record"),
    ("session_move", "to_trainee_id", "history; shown with the kept record"),
    ("session_move", "from_box_id", "history; shown with the kept record"),
    ("session_move", "to_box_id", "history; shown with the kept record"),
    ("record_merge", "kept_trainee_id", "the merges themselves"),
    ("record_merge", "merged_trainee_id", "the merges themselves"),
    ("record_merge", "kept_box_id", "the merges themselves"),
    ("record_merge", "merged_box_id", "the merges themselves"),
    ("pending_erasure", "trainee_id", "refused: no record that waits for its erasure is merged"),
    ("skill_model_trainee", "trainee_id", "models of both are withdrawn"),
    ("cookie_session", "person_id", "signed out"),
    ("password_link", "person_id", "withdrawn"),
    ("password_link", "made_by", "of staff"),
    ("known_place", "person_id", "of the closed account"),
    ("upload", "person_id", "who sends; what a closed account has not finished expires"),
    ("attention_dismissal", "person_id", "of staff"),
    ("group_instructor", "person_id", "of staff"),
    ("check_in_pin", "person_id", "of the closed account"),
    ("box_agent", "box_id", "when it was seen last; its token follows, so it comes back as the kept box"),
    ("token", "made_with", "no person"),
    ("cookie_session", "identity_id", "no person"),
];

#[tokio::test]
async fn every_column_that_refers_to_a_merged_record_follows_or_is_named() {
    let centre = TestCentre::new().await;
    let references: Vec<(String, String)> = sqlx::query_as(
        "SELECT schema.name, key.\"from\" FROM sqlite_schema AS schema, pragma_foreign_key_list(schema.name) AS key
         WHERE schema.type = 'table'
           AND (key.\"table\" IN ('trainee', 'training_box') OR (key.\"table\" = 'person' AND key.on_delete = 'CASCADE'))",
    )
    .fetch_all(centre.store.readers())
    .await
    .unwrap();
    assert!(references.len() >= 25, "only {} references were found", references.len());
    let statements = take_statements();
    let follows = |table: &str, column: &str| {
        let updates = [format!("UPDATE OR IGNORE {table} SET {column} = "), format!("UPDATE {table} SET {column} = ")];
        statements.iter().any(|statement| updates.iter().any(|update| statement.contains(update)))
    };
    let unknown: BTreeSet<&(String, String)> = references
        .iter()
        .filter(|(table, column)| !follows(table, column))
        .filter(|(table, column)| !STAY.iter().any(|(known, of, _)| (known, of) == (&table.as_str(), &column.as_str())))
        .collect();
    assert!(unknown.is_empty(), "add them to a list of `record_merges`, or here with a reason: {unknown:?}");
}

/// A centre whose trainees keep their videos for 60, 48, 36, … months.
async fn with_months<const N: usize>() -> (TestCentre, [TraineeId; N]) {
    let (centre, service) = (TestCentre::new().await, Scope::service());
    let mut trainees = Vec::new();
    for number in 0..N {
        let trainee = centre.trainee(&format!("Trainee {number}")).await.id;
        let months = Some((60 - 12 * number as u32, Some("A study.".parse().unwrap())));
        centre.store.personal_retention().set(&service, trainee, months, (0, 0)).await.unwrap();
        trainees.push(trainee);
    }
    (centre, trainees.try_into().unwrap())
}

async fn merge(centre: &TestCentre, pair: [TraineeId; 2]) -> MergeId {
    centre.clock.advance(Duration::from_secs(1));
    let why = "One person.".parse().unwrap();
    centre.store.record_merges().merge_trainees(&Scope::service(), pair, why, (0, 0)).await.unwrap().id
}

async fn separate(centre: &TestCentre, kept: TraineeId, merge: MergeId) {
    let why = "Two people.".parse().unwrap();
    centre.store.record_merges().separate_trainees(&Scope::service(), kept, merge, why).await.unwrap();
}

/// Opens the database again as one that lacks the migration 75.
async fn update(mut centre: TestCentre) -> TestCentre {
    let take_back = "ALTER TABLE record_merge DROP COLUMN retention_after;
                     DELETE FROM _sqlx_migrations WHERE version = 75";
    centre
        .store
        .write(async move |tx| {
            sqlx::raw_sql(take_back).execute(tx).await?;
            Ok(())
        })
        .await
        .unwrap();
    centre.store.close().await;
    centre.store = open(&centre.folder, &centre.clock).await;
    centre
}

async fn months<const N: usize>(centre: &TestCentre, trainees: [TraineeId; N]) -> [Option<u32>; N] {
    let mut months = [None; N];
    for (own, trainee) in months.iter_mut().zip(trainees) {
        *own = centre.store.personal_retention().of_trainee(&Scope::service(), trainee, 0).await.unwrap().own_months;
    }
    months
}

#[tokio::test]
async fn merges_of_an_older_database_give_their_months_back_in_any_order() {
    for is_first_separated_first in [true, false] {
        let (centre, [ana, ben, cleo]) = with_months().await;
        let merges = [merge(&centre, [ana, ben]).await, merge(&centre, [ana, cleo]).await];
        let centre = update(centre).await;
        assert_eq!(months(&centre, [ana, ben, cleo]).await, [Some(36), None, None]);
        let [first, second] = if is_first_separated_first { [0, 1] } else { [1, 0] };
        separate(&centre, ana, merges[first]).await;
        let expected = if is_first_separated_first { [Some(36), Some(48), None] } else { [Some(48), None, Some(36)] };
        assert_eq!(months(&centre, [ana, ben, cleo]).await, expected);
        separate(&centre, ana, merges[second]).await;
        assert_eq!(months(&centre, [ana, ben, cleo]).await, [Some(60), Some(48), Some(36)]);
    }
}

#[tokio::test]
async fn a_merge_of_an_older_database_finds_its_months_with_the_record_that_they_followed_to() {
    let (centre, [zoe, ana, ben, cleo]) = with_months().await;
    let ben_into_ana = merge(&centre, [ana, ben]).await;
    let ana_into_zoe = merge(&centre, [zoe, ana]).await;
    let cleo_into_zoe = merge(&centre, [zoe, cleo]).await;
    let centre = update(centre).await;
    separate(&centre, zoe, ana_into_zoe).await;
    assert_eq!(months(&centre, [zoe, ana, ben, cleo]).await, [Some(24), Some(36), None, None]);
    separate(&centre, ana, ben_into_ana).await;
    separate(&centre, zoe, cleo_into_zoe).await;
    assert_eq!(months(&centre, [zoe, ana, ben, cleo]).await, [Some(60), Some(48), Some(36), Some(24)]);
}

#[tokio::test]
async fn months_that_were_set_since_a_merge_of_an_older_database_stay_with_the_kept_record() {
    let (centre, [ana, ben, cleo]) = with_months().await;
    let first = merge(&centre, [ana, ben]).await;
    centre.clock.advance(Duration::from_secs(1));
    let set = Some((47, Some("Another study.".parse().unwrap())));
    centre.store.personal_retention().set(&Scope::service(), ana, set, (0, 0)).await.unwrap();
    let second = merge(&centre, [ana, cleo]).await;
    let centre = update(centre).await;
    separate(&centre, ana, first).await;
    assert_eq!(months(&centre, [ana, cleo]).await, [Some(36), None]);
    separate(&centre, ana, second).await;
    assert_eq!(months(&centre, [ana, ben, cleo]).await, [Some(47), None, Some(36)]);
}

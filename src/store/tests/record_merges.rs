//! Merges know every table that refers to trainees and boxes, and what belongs to accounts.

use std::collections::BTreeSet;

use crate::store::record_merges::take_statements;
use crate::store::testing::TestCentre;

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

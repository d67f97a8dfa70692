//! `docs/schema.sql` is the schema of a fresh database: the migrations say how it came about, this file says what it is.
//!
//! `make schema` replaces the file after a new migration.

use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;
use trocar::store::{Store, StoreSettings};
use trocar::time::ManualClock;

use crate::golden;

const HEADER: &str = "\
-- The schema of a fresh database, as SQLite stores it once all files of migrations/ were applied: tables, indexes,
-- triggers, views. `make schema` writes this file and a test compares it. migrations/README.md has the conventions.
";

/// Statements of the schema without the tables of SQLite and of sqlx. Sorted by name, so that a table that a migration
/// makes again stays in its place.
const STATEMENTS: &str = r"
    SELECT sql FROM sqlite_schema
    WHERE sql IS NOT NULL AND tbl_name NOT LIKE 'sqlite!_%' ESCAPE '!' AND tbl_name <> '_sqlx_migrations'
    ORDER BY instr('table index trigger view', type), tbl_name, name";

#[tokio::test]
async fn the_documented_schema_is_that_of_a_fresh_database() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trocar.db");
    Store::open(&path, &StoreSettings::default(), ManualClock::at(0)).await.unwrap();
    let mut raw = SqliteConnection::connect(path.to_str().unwrap()).await.unwrap();
    let statements: Vec<String> = sqlx::query_scalar(STATEMENTS).fetch_all(&mut raw).await.unwrap();
    let schema: String = statements.iter().map(|statement| format!("\n{statement};\n")).collect();
    let difference = golden::compare("docs/schema.sql", &format!("{HEADER}{schema}"));
    assert_eq!(difference, None, "the schema changed: run `make schema`");
}
